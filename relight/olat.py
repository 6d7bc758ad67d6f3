"""One light at a time: the person in each direction of the OLAT set, for a mix that is made elsewhere."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from relight.cutting import Cutting
from relight.lights.directional import DirectionalLight
from relight.lights.files import write_lights
from relight.media import images, nuke
from relight.media.sequences import Sequence
from relight.outputs import check
from relight.preparation import Preparation, Source
from relight.subject import Subject
from shadow import directions, inputs


def olat_lights(behind: bool = False) -> list[DirectionalLight]:
    """Lights of intensity 1, `olat_01`, `olat_02`..., from the 64 OLAT directions; with `behind` 32 more."""
    return [
        DirectionalLight(direction, name=f"olat_{number:02d}")
        for number, direction in enumerate(directions.olat(behind).tolist(), 1)
    ]


def write_olat(
    output: str | Path,
    image: Source,
    mask: Source | None = None,
    *,
    cutting: Cutting | None = None,
    colour_space: str | None = None,
    behind: bool = False,
    script: str | Path | None = None,
    device: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Write the person in each OLAT light alone.

    Parameters
    ----------
    output: an .exr file, in which each light is a layer `C_olat_01.R`... and the picture their sum; or a
        sequence such as `olat.%04d.exr`, whose frame 1 is the first light.
    image: the photograph, as an image that `relight.Subject` takes, or a file.
    mask: the person's matte, as a mask or a file; needed unless the image has alpha.
    cutting: as of `relight.preparation.Preparation`.
    colour_space: of the photograph, where its file does not say; see `relight.read`.
    behind: 32 directions behind the person too.
    script: a Nuke script (.nk) to write as well: a Multiply for each light, and their sum.
    device: where the networks run, such as "cuda"; the CPU unless given.
    progress: called with (lights done, lights in all).

    Beside the output, a .json of the same name is the lights file (see `relight.read_lights`) that gives the
    passes' directions; in the headers they are vectors, `relight:direction` or `relight:olat_01`. One file
    holds all passes in memory, 6 bytes a pixel and light; a sequence one at a time.

    Returns
    -------
    The paths written.

    Raises
    ------
    TypeError, ValueError: as `relight.Subject` does; an output that is not .exr, or is read as well. OSError:
    as `relight.write`.
    """
    output, sequence = Path(output), Sequence.of(output)
    if output.suffix.lower() != ".exr":
        raise ValueError(f"{output}: expected a file name that ends in .exr")
    description = output.with_suffix(".json") if sequence is None else sequence.beside(".json")
    check([output, *([] if script is None else [Path(script)])], (image, mask), lights=description)
    inputs.device("device", device)
    lights = olat_lights(behind)
    person = Preparation(image, mask=mask, cutting=cutting, colour_space=colour_space).person(0)
    subject = Subject(person.plate, person.matte, device=device)
    report = progress or (lambda done, total: None)
    written, layers = [], {}
    picture: Any = 0
    for number, light in enumerate(lights, 1):
        relit = subject.relit(light)
        if sequence is not None:
            written.append(sequence.path(number))
            images.write(written[-1], relit, metadata={"relight:direction": light.direction})
        else:
            layers[f"C_{light.name}"] = relit[..., :3].astype(np.float16)
            picture += layers[f"C_{light.name}"].astype(np.float32)
            alpha = relit[..., 3:]
        report(number, len(lights))
    if sequence is None:
        metadata = {f"relight:{light.name}": light.direction for light in lights}
        images.write(output, np.concatenate([picture, alpha], axis=-1), layers=layers, metadata=metadata)
        written.append(output)
    write_lights(description, lights)
    written.append(description)
    if script is not None:
        files: dict[Any, Any] = {light.name: (output, f"C_{light.name}") for light in lights}
        if sequence is not None:
            files = {light.name: (sequence.path(number), None) for number, light in enumerate(lights, 1)}
        nuke.write_script(script, files, relit.shape[:2])
        written.append(Path(script))
    return written
