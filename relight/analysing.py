"""The analysis of a still or a shot, kept: a file a frame, which is relit without a network."""

import warnings
from pathlib import Path

from relight import __version__, keeping
from relight.cutting import Cutting
from relight.lights.environment import FIELD_OF_VIEW
from relight.media.identity import identity
from relight.media.sequences import Frames
from relight.outputs import Report
from relight.people import People, computing
from relight.preparation import Placement, Preparation, Source, Surface
from relight.shot import SUFFIX, described, frame_file, is_shot
from relight.subject import weights
from shadow import inputs
from shadow.directions import CAMERA
from shadow.networks.precision import in_use


def analyse_shot(
    source: Source,
    output: str | Path,
    *,
    frames: tuple[int, int] | str | Frames | None = None,
    mask: Source | None = None,
    key: str | None = None,
    cutting: Cutting | None = None,
    placement: Placement | None = None,
    colour_space: str | None = None,
    normals: Surface | None = None,
    axes: str = CAMERA,
    depth: Source | None = None,
    height: float | None = None,
    field_of_view: float = FIELD_OF_VIEW,
    steady: bool = True,
    device: str | None = None,
    precision: str | None = None,
    threads: int | None = None,
    progress: Report | None = None,
) -> dict[int, str]:
    """Analyse the person of a still or of each frame of a shot, and keep that: `render_video` takes the
    folder as its source and relights it without a network, as often as the lights change.

    Frames that are there, whole, and analysed from just these sources, with these options and weights, stay
    as they are. So an interrupted run goes on where it was, and several machines may analyse ranges of one
    shot into one folder; each analyses the frames beyond its range that steady those in it.

    Parameters
    ----------
    source, mask, key, cutting, placement, colour_space, normals, axes, depth, height, field_of_view: as of
        `relight.preparation.Preparation`; the placement's size in pixels.
    output: a folder, such as `shot.relight`, which is made: `000101.safetensors` is frame 101,
        `still.safetensors` a still. What a frame's file holds is described in `relight.keeping`.
    frames: of a shot, as of `relight.render_video`; all there are unless given.
    steady: average what the networks find of a moving person over 5 frames, where it is alike.
    device: where the networks run, such as "cuda"; the CPU unless given.
    precision: "bfloat16" or "float32", in which the networks run; what is fast on this processor unless
        given.
    threads: of this process; torch's own choice unless given.
    progress: called with (frames done, frames in all, what is done) after every frame.

    Returns
    -------
    {frame number: what is wrong}: the frames that could not be analysed. The others are there.

    Raises
    ------
    FileNotFoundError: no such file or frames. OSError: the folder cannot be made or written.
    TypeError, ValueError: bad arguments, or no frame could be analysed.
    """
    folder = Path(output)
    if folder.suffix.lower() != SUFFIX:
        raise ValueError(f"{folder}: expected the name of a folder that ends in {SUFFIX}")
    if is_shot(source):
        raise ValueError(f"{source}: is analysed already")
    inputs.device("device", device)
    with computing(precision, threads):
        prepared = Preparation(
            source, mask=mask, key=key, cutting=cutting, colour_space=colour_space, normals=normals,
            axes=axes, depth=depth, height=height, field_of_view=field_of_view, placement=placement,
        )  # fmt: skip
        numbers = _numbers(frames, prepared)
        folder.mkdir(parents=True, exist_ok=True)
        people = People(prepared, steady, device, in_room=True)
        run = _Analysing(prepared, people, folder, steady, in_use(device or "cpu"), threads)
        return run.make(numbers, progress or (lambda done, total, what: None))


class _Analysing:
    """The frames of a shot on their way to their folder."""

    def __init__(
        self,
        prepared: Preparation,
        people: People,
        folder: Path,
        steady: bool,
        precision: str,
        threads: int | None,
    ) -> None:
        self._prepared, self._people, self._folder = prepared, people, folder
        self._computing = {"precision": precision, "threads": threads}
        self._options = identity(prepared.options, steady, __version__)

    def make(self, numbers: Frames | list[int], report: Report) -> dict[int, str]:
        """All frames; {frame number: what is wrong}. ValueError if none could be made."""
        problems: dict[int, str] = {}
        others = 0
        for done, number in enumerate(numbers, 1):
            try:
                others += self._make(number)
            except (OSError, ValueError) as error:
                problems[number] = str(error)
            report(done, len(numbers), "Analysing")
        if len(problems) == len(numbers):
            first = f"frame {numbers[0]}: {problems[numbers[0]]}"
            raise ValueError(f"none of {len(numbers)} frames could be analysed; {first}")
        if others:
            warnings.warn(
                f"{self._folder}: {others} of {len(numbers)} frames were damaged, or made from other plates, "
                "with other options or weights or by another version, and were analysed anew",
                stacklevel=3,
            )
        return problems

    def _make(self, number: int) -> bool:
        """Analyse a frame, unless it is there; whether that replaced another."""
        path = frame_file(self._folder, None if self._prepared.numbers is None else number)
        around = self._people.around(number)
        made = identity(
            self._prepared.identity(number, around),
            self._people.camera,
            self._options,
            *weights(),
            *self._computing.values(),
        )
        made_of = self._computing | {
            "identity": made,
            "options": self._options,
            "version": __version__,
            "rate": None if self._prepared.rate is None else str(self._prepared.rate),
        }
        there = path.exists()
        if there and _holds(path, made):
            return False
        person = self._people.at(number)
        person.save(
            path, made_of=made_of | {"sources": described(self._folder, self._prepared.files(around))}
        )
        return there


def _holds(path: Path, made_of: str) -> bool:
    """Whether a frame is there, whole, and made of just that."""
    try:
        about = keeping.read_about(path)
        if "nobody" not in about:
            keeping.read(path)
        return about["made_of"].get("identity") == made_of
    except (OSError, ValueError):
        return False


def _numbers(frames: tuple[int, int] | str | Frames | None, prepared: Preparation) -> Frames | list[int]:
    """The numbers of the frames to analyse; of a still, 0."""
    if prepared.numbers is None:
        if frames is not None:
            raise ValueError("frames: a still has none")
        return [0]
    return Frames.of(frames or (prepared.numbers[0], prepared.numbers[-1]))
