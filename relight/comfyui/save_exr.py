"""The node that saves OpenEXR files: scene-linear, with light groups and passes."""

from pathlib import Path
from typing import Annotated

from annotated_types import Interval

from relight.arguments import About
from relight.comfyui import host, tensors
from relight.comfyui.render import Amount, Analysed, Backdrop, Behind, CheckedNode, Fill, Given, Gloss, Ground
from relight.media.images import write
from relight.media.sequences import FrameSequence
from relight.rendering import PASSES, check_names, metadata_of, render_subject


class SaveEXR(CheckedNode):
    """The picture in scene-linear half floats, with its light groups."""

    DESCRIPTION = "Saves multi-layer OpenEXR: the picture, a layer C_<light> for each light, and passes."
    RETURN_TYPES = ("STRING",)
    RETURN_NAMES = ("path",)
    OUTPUT_TOOLTIPS = ("The file, or the first of a batch.",)
    OUTPUT_NODE = True
    FUNCTION = "save"

    def save(
        self,
        subject: Analysed,
        lights: Given,
        path: Annotated[
            str,
            About(
                "The file, .exr, in ComfyUI's output folder, or a whole path. #### or %04d is the number of "
                "the frame; a batch needs it. Files of that name are replaced."
            ),
        ] = "relight/relit.####.exr",
        first_frame: Annotated[int, Interval(ge=0, le=1000000), About("The number of the first frame.")] = 1,
        passes: Annotated[
            str, About(f"Further layers, any of {', '.join(PASSES)}, with commas between.")
        ] = "",
        *,
        background: Behind = None,
        floor: Ground = "",
        gloss: Gloss = 0.0,
        amount: Amount = 1.0,
        fill: Fill = 0.0,
    ) -> dict[str, object]:
        """Write a file for each frame, as `relight apply` does."""
        names = check_names(filter(None, (name.strip() for name in passes.split(","))))
        backdrop = Backdrop(background, floor, fill)
        count = tensors.frames_together(subject=len(subject), background=len(backdrop))
        files = _files(path, first_frame, count)
        for number, file in host.progress(enumerate(files), count):
            person = subject[number]
            picture, layers = render_subject(
                person,
                backdrop.with_fill(lights, person, number),
                background=backdrop.picture(number),
                passes=names,
                floor=backdrop.floor,
                gloss=gloss,
                amount=amount,
            )
            write(file, picture, layers=layers, metadata=metadata_of(person, names))
        return {"ui": {"text": [str(file) for file in files]}, "result": (str(files[0]),)}


def _files(path: str, first: int, count: int) -> list[Path]:
    """Return the checked file of each frame; the folders of a relative path are created."""
    output = host.folder("output").resolve()
    file = (output / path).resolve()
    if file.suffix.lower() != ".exr":
        raise ValueError(f"path: expected a file name that ends in .exr, got {path!r}")
    if not Path(path).is_absolute():
        if not file.is_relative_to(output):
            raise ValueError(f"path: leads out of ComfyUI's output folder: {path}; give the whole path")
        file.parent.mkdir(parents=True, exist_ok=True)
    sequence = FrameSequence.of(file)
    if sequence is None and count > 1:
        raise ValueError(f"path: expected a frame number such as #### for {count} frames, got {path!r}")
    return [file if sequence is None else sequence.path(first + number) for number in range(count)]
