"""Write a person for 3D programs and for Nuke, from files to a file; `relight export` calls it."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from relight.media.movies import RATE
from relight.media.sequences import FrameRange
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Compute, Lighting, Source
from relight.pipeline.shot import Shot
from relight.scene import mesh
from relight.scene import write as writing
from relight.scene.asset import Asset, checked
from relight.scene.nuke import person_group
from relight.scene.nuke.light_groups import is_script
from relight.subject import Subject
from shadow.torch_settings import isolated


@isolated
def export_person(
    output: str | Path,
    source: Source | Any,
    lighting: Lighting | Any = (),
    *,
    frames: int | tuple[int, int] | str | FrameRange | None = None,
    triangles: int = mesh.TRIANGLES,
    texture: str = "albedo",
    compute: Compute | None = None,
    progress: Report | None = None,
) -> Path:
    """Write a person as a textured mesh with the plate's camera and lights, or as a Nuke script.

    See `relight.Subject.export` for the contents. A source with several frames becomes one stage with a mesh
    for each frame, or a script that reads a sequence; a .glb holds one frame.

    Parameters
    ----------
    output
        The file: .glb, .usda, .usdc, .usdz or .nk.
    source
        Source, or a plate or analysis cache, see `relight.render_shot`.
    lighting
        Lighting, or lights, that are also written; none by default.
    frames
        The frame or frames of a moving source; by default the first for .glb, else all.
    triangles
        Largest number of triangles of a mesh.
    texture
        "albedo" or "photograph".
    compute
        Compute: device, precision and threads.
    progress
        Called with (frames done, number of frames, name of the step).

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    FileNotFoundError
        No such file or frames.
    OSError
        A file cannot be written.
    TypeError, ValueError
        Bad arguments, several frames for a .glb, a frame that shows no person.

    Examples
    --------
    >>> import relight
    >>> key = relight.DirectionalLight(azimuth=-40, name="key")
    >>> relight.export_person("person.glb", "examples/person.png", key).name
    'person.glb'
    """
    report = progress or (lambda done, total, what: None)
    path = checked(output, texture, triangles)
    with Shot.open(source, lighting, compute) as shot:
        lights, gloss, rate = shot.all_lights(), shot.lighting.effective_gloss, float(shot.rate or RATE)
        knobs = person_group.checked_lights(lights) if is_script(path) else []
        shot.check_not_read([path, *writing.companions(path, texture)])
        numbers = _numbers(path, shot, frames)
        shot.check_lights(numbers[0])
        shot.prepare(report)
        lights = shot.all_lights(shot.preset_gain)
        knobs = person_group.checked_lights(lights) if is_script(path) else []
        asset: Any = partial(Subject.asset, lights=lights, triangles=triangles, texture=texture, gloss=gloss)
        if len(numbers) == 1:
            report(0, 1, "Analysing")
            subject = shot.subject(numbers[0])
            report(1, 1, "Analysing")
            if is_script(path):
                return writing.write_script(path, subject, knobs, gloss)
            return writing.write(path, asset(subject))
        if is_script(path):
            return writing.write_script_sequence(path, shot.person, numbers, knobs, rate, report, gloss)

        def assets() -> Iterator[tuple[int, Asset]]:
            for done, number in enumerate(numbers):
                report(done, len(numbers), "Frames")
                person = shot.person(number)
                if not person.is_empty:
                    yield number, asset(person)
            report(len(numbers), len(numbers), "Frames")

        return writing.write_sequence(path, assets(), rate)


def _numbers(path: Path, shot: Shot, frames: int | tuple[int, int] | str | FrameRange | None) -> list[int]:
    """Return the frames to write, 0 for a still; raises ValueError for those that are not or do not fit."""
    if shot.is_still:
        return [0]
    holds_one = path.suffix.lower() == ".glb"
    if frames is None:
        return list(shot.numbers[:1] if holds_one else shot.numbers)
    numbers = [frames] if isinstance(frames, int) else list(FrameRange.of(frames))
    if missing := sorted(set(numbers) - set(shot.numbers)):
        raise ValueError(f"frames: {FrameRange(missing)} are not there")
    if len(numbers) > 1 and holds_one:
        raise ValueError(f"{path}: holds one frame; choose it (--frames 7), or write USD")
    return numbers
