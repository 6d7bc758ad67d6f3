"""Write a person for 3D programs and for Nuke, from files to a file; `relight export` calls it."""

from collections.abc import Callable
from pathlib import Path

from relight import quantities
from relight.arguments import checks_arguments
from relight.lights.directional import DirectionalLight
from relight.lights.light import Light
from relight.lights.moving import MovingLight
from relight.media.movies import RATE
from relight.media.sequences import FrameRange, GivenFrames
from relight.pipeline.frame_numbers import frame_range
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Compute, GivenLighting, GivenSource
from relight.pipeline.run import Job, Problems, run
from relight.pipeline.shot import Shot
from relight.scene import mesh
from relight.scene import write as writing
from relight.scene.asset import Asset, checked
from relight.scene.nuke import person_group
from relight.scene.nuke.light_groups import is_script
from relight.subject import Subject
from shadow.torch_settings import isolated


@isolated
@checks_arguments
def export_person(
    output: quantities.File,
    source: GivenSource,
    lighting: GivenLighting = (),
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
    job = Exporting(checked(output, texture, triangles), triangles, texture)
    with Shot.open(source, lighting, compute) as shot:
        return run(job, shot, frames, progress)


class Exporting(Job[Path]):
    """Writes the person of one frame or of several for 3D programs or for Nuke."""

    def __init__(self, path: Path, triangles: int, texture: str) -> None:
        super().__init__()
        self._path, self._triangles, self._texture = path, triangles, texture
        self._add: Callable[[int, Subject], None] | None = None  # writes one frame of several

    def check(self, shot: Shot, frames: GivenFrames | None) -> FrameRange:
        """Refuse lights and frames that the file cannot hold, and files that are read."""
        person_group.check_amount(self._path, shot.lighting.amount)
        self._knobs(shot.lights.stated())
        shot.check_not_read([self._path, *writing.companions(self._path, self._texture)])
        numbers = self._numbers(shot, frames)
        shot.check_lights(numbers[0])
        return numbers

    def prepare(self, shot: Shot, numbers: FrameRange, report: Report) -> None:
        """Open the file of several frames."""
        path, rate = self._path, float(shot.rate or RATE)
        self.step = "Analysing" if len(numbers) == 1 else "Frames"
        report(0, len(numbers), self.step)
        self._lights, self._gloss = shot.lights.exposed(), shot.lighting.effective_gloss
        self._amount = shot.lighting.amount
        if len(numbers) == 1:
            return
        if is_script(path):
            knobs, chosen = self._knobs(self._lights), writing.spread(numbers)
            people = {number: shot.person(number) for number in chosen}
            several = writing.script_sequence(path, people, numbers, knobs, rate, self._gloss, self._amount)
            self._add = self.opened.enter_context(several)
        else:
            self._add = self.opened.enter_context(writing.stage_sequence(path, self._asset, rate))

    def frame(self, shot: Shot, number: int) -> None:
        """Write one frame of several; the only one is written at the end."""
        if self._add is None:
            self._subject = shot.persons.shown(number)
        else:
            self._add(number, shot.person(number))

    def finish(self, shot: Shot, numbers: FrameRange, problems: Problems, report: Report) -> Path:
        """Write the only frame; the file of several is complete once it is closed."""
        if self._add is None and is_script(self._path):
            knobs = self._knobs(self._lights)
            writing.write_script(self._path, self._subject, knobs, self._gloss, self._amount)
        elif self._add is None:
            writing.write(self._path, self._asset(self._subject))
        return self._path

    def _knobs(self, lights: list[Light | MovingLight]) -> list[DirectionalLight]:
        """Return the lights with which the knobs of a script begin; raises for those that it cannot have."""
        return person_group.checked_lights(lights) if is_script(self._path) else []

    def _asset(self, subject: Subject) -> Asset:
        """Return the mesh, camera and lights of a frame."""
        return subject.asset(
            self._lights, triangles=self._triangles, texture=self._texture, gloss=self._gloss
        )

    def _numbers(self, shot: Shot, frames: GivenFrames | None) -> FrameRange:
        """Return the frames to write, 0 for a still; ValueError for those that are not there or too many."""
        if shot.is_still:
            return FrameRange((0,))
        holds_one = self._path.suffix.lower() == ".glb"
        if frames is None:
            return FrameRange(shot.numbers[:1] if holds_one else shot.numbers)
        numbers = frame_range(shot, frames)
        if missing := sorted(set(numbers) - set(shot.numbers)):
            raise ValueError(f"frames: {FrameRange(missing)} are not there")
        if len(numbers) > 1 and holds_one:
            raise ValueError(f"{self._path}: holds one frame; choose it (frames=7), or write USD")
        return numbers
