"""Write a person for 3D programs and for Nuke, from files to a file; `relight export` calls it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from relight.media.movies import RATE
from relight.media.nuke import is_script
from relight.media.sequences import FrameRange
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Compute, Lighting, Source
from relight.pipeline.shot import Shot
from relight.scene import asset, mesh, nuke_script, writing
from relight.scene.asset import Asset


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
    ValueError
        Bad arguments, several frames for a .glb, a frame that shows no person.
    TypeError
        Not lights.

    Examples
    --------
    >>> import relight
    >>> key = relight.DirectionalLight(azimuth=-40, name="key")
    >>> relight.export_person("person.glb", "examples/person.png", key).name
    'person.glb'
    """
    report = progress or (lambda done, total, what: None)
    path = asset.checked(output, texture, triangles)
    with Shot.open(source, lighting, compute) as shot:
        lights = shot.every_light
        mesh: dict[str, Any] = {"triangles": triangles, "texture": texture, "gloss": shot.lighting.gloss}
        knobs = nuke_script.checked_lights(lights) if is_script(path) else []
        shot.check_not_read([path, *writing.companions(path, texture)])
        numbers = _numbers(path, shot, frames)
        shot.check_lights(numbers[0])
        shot.prepare(report)
        rate = float(shot.rate or RATE)
        if len(numbers) == 1:
            report(0, 1, "Analysing")
            subject = shot.subject(numbers[0])
            report(1, 1, "Analysing")
            if is_script(path):
                return writing.write_script(path, subject, knobs, shot.lighting.gloss)
            return writing.write(path, subject.asset(lights, **mesh))

        def subject_at(number: int) -> Any:
            person = shot.person(number)
            return None if person.is_empty else person

        if is_script(path):
            return writing.write_script_sequence(
                path, subject_at, numbers, knobs, rate, report, shot.lighting.gloss
            )

        def assets() -> Iterator[tuple[int, Asset]]:
            for done, number in enumerate(numbers):
                report(done, len(numbers), "Frames")
                subject = subject_at(number)
                if subject is not None:
                    yield number, subject.asset(lights, **mesh)
            report(len(numbers), len(numbers), "Frames")

        return writing.write_sequence(path, assets(), rate)


def _numbers(path: Path, shot: Shot, frames: int | tuple[int, int] | str | FrameRange | None) -> list[int]:
    """Return the frames to write; 0 for a still.

    Raises ValueError if the file cannot hold several frames, or if there are none.
    """
    if shot.is_still:
        return [0]
    if frames is None:
        numbers = list(shot.numbers)
        numbers = numbers[:1] if path.suffix.lower() == ".glb" else numbers
    else:
        numbers = [frames] if isinstance(frames, int) else list(FrameRange.of(frames))
    missing = sorted(set(numbers) - set(shot.numbers))
    if missing:
        raise ValueError(f"frames: {FrameRange(missing)} are not there")
    if len(numbers) > 1 and path.suffix.lower() == ".glb":
        raise ValueError(f"{path}: holds one frame; choose it (--frames 7), or write USD")
    return numbers
