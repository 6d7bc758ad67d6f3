"""A shot as a job for a farm: an Open Job Description template, as AWS Deadline Cloud and others run it.

Its steps are the commands of this package: `relight analyse`, `relight video`. See
https://github.com/OpenJobDescription/openjd-specifications, "Template Schemas", version 2023-09.
"""

import json
import os
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import torch
import yaml

from relight.lights.files import SUFFIXES as LIGHTS
from relight.lights.files import read_lights, write_lights
from relight.lights.light import Light
from relight.lights.moving import MovingLight
from relight.media import movies
from relight.media.sequences import Frames, Sequence
from relight.outputs import check
from relight.preparation import BACKGROUND, Preparation
from relight.shot import is_shot
from relight.video import frames_of
from shadow import files
from shadow.networks.precision import in_use

SUFFIXES = (".json", ".yaml", ".yml")
CHUNK = 10  # frames of a task, unless asked otherwise
ANALYSIS = (  # the options of `relight analyse`; the others are of `relight video` alone
    "mask", "key", "matte", "refine_matte", "person", "size", "placement", "scale", "offset", "colour_space",
    "normals", "axes", "depth", "height", "steady", "device",
)  # fmt: skip
SHARED = ("field_of_view",)  # what both take
FILES = {
    "mask": "IN",
    "normals": "IN",
    "depth": "IN",
    "background": "IN",
    "match": "IN",
    "match_mask": "IN",
    "save_matte": "OUT",
}  # options that may be files


def write_job(
    path: str | Path,
    source: str | Path,
    lights: str | Path | Light | MovingLight | Iterable[Light | MovingLight],
    outputs: str | Path | Iterable[str | Path],
    *,
    frames: tuple[int, int] | str | Frames | None = None,
    analysis: str | Path | None = None,
    save_lights: str | Path | None = None,
    chunk: int = CHUNK,
    precision: str | None = None,
    threads: int | None = None,
    options: Mapping[str, Any] | None = None,
) -> None:
    """Write a job that does what `relight.render_video` does, on many machines.

    Its steps are: Analyse, chunks of frames; Light, chunks of frames, each after all of Analyse; and where
    there is a movie or a script, Finish, after all of Light. Tasks keep what is there already, so the farm
    may run each again. Frames, chunk size, precision and threads are parameters of the job, as are plates,
    lights and outputs: other lights are the same job with another parameter.

    Parameters
    ----------
    path: the template, .json or .yaml. What lies in its folder is named relative to it, and the folder may
        lie elsewhere on the farm; other files need one path on all machines.
    source: a photograph, sequence or movie; or what `relight.analyse_shot` kept of one, and there is no step
        Analyse.
    lights, save_lights: a lights file; or lights, and the file to write them to, unless given beside the
        template: `job.lights.yaml`.
    outputs: as of `relight.render_video`.
    frames: as of `relight.render_video`.
    analysis: the folder in which the analysis is kept; unless given beside the template, called as the source
        is: `plate.relight`.
    chunk: frames of a task.
    precision, threads: as of `relight.analyse_shot`, of each task; unless given those of this process. The
        same on all machines: then frames are equal to the bit.
    options: further ones of `relight analyse` and `relight video`, by name: {"mask": "matte.%04d.png",
        "passes": "albedo,N", "steady": False}.

    Raises
    ------
    FileNotFoundError: no such files. OSError: it cannot be written. ValueError: bad arguments, outputs that
    are read as well.
    """
    path, options = files.check_writable(path, SUFFIXES), dict(options or {})
    paths = [Path(one) for one in ([outputs] if isinstance(outputs, str | Path) else outputs)]
    if chunk < 1:
        raise ValueError(f"chunk: expected at least 1 frame, got {chunk}")
    for name in ANALYSIS if is_shot(source) else ():
        if name in options:
            raise ValueError(f"{name}: {source} is analysed already; give it to `relight analyse`")
    if options.get("size") == BACKGROUND:
        raise ValueError("size: expected WIDTHxHEIGHT, since an analysis knows no background")
    lights_file, lamps = _lights(lights, save_lights or path.with_name(f"{path.stem}.lights.yaml"))
    save_matte = options.get("save_matte")
    given = [options.get(name) for name, flow in FILES.items() if flow == "IN"]
    read = (source, lights_file, *given, *lamps)
    check(paths, read, mattes=None if save_matte is None else Path(save_matte))
    prepared = Preparation(source, mask=options.get("mask"))
    numbers = frames_of(frames, prepared.span, lamps)
    _warn_of_missing(prepared.numbers, numbers, source)
    if not isinstance(lights, str | Path):
        write_lights(lights_file, lamps)
    kept = Path(source) if is_shot(source) else Path(analysis or path.with_name(f"{_stem(source)}.relight"))
    job = _Job(path, numbers, chunk, precision or in_use("cpu"), threads or torch.get_num_threads())
    words = job.options({name: value for name, value in options.items() if name not in ANALYSIS})
    place = job.path("Analysis", kept, "INOUT" if kept != Path(source) else "IN", "DIRECTORY")
    if kept != Path(source):
        run = job.options({name: value for name, value in options.items() if name in ANALYSIS + SHARED})
        plate = job.path("Plate", Path(source), "IN")
        computed = ["--precision", "{{Param.Precision}}", "--threads", "{{Param.Threads}}"]
        moving = prepared.numbers is not None
        job.step("Analyse", ["analyse", plate, "-o", place, *run, *computed], chunked=moving)
    lit = ["video", place, "--lights", job.path("Lights", lights_file, "IN")]
    places = [job.path(f"Output{n or ''}", one, "OUT") for n, one in enumerate(paths)]
    lit += [word for place in places for word in ("-o", place)] + words + ["--threads", "{{Param.Threads}}"]
    job.step("Light", [*lit, "--part", "frames", "--resume"])
    if any(movies.is_movie(one) or one.suffix.lower() == ".nk" for one in paths):
        job.step("Finish", [*lit, "--part", "end", "--frames", "{{Param.Frames}}"], chunked=False)
    job.write()


class _Job:
    """A template in the making."""

    def __init__(self, path: Path, frames: Frames, chunk: int, precision: str, threads: int) -> None:
        self._path, self._folder = path, Path(os.path.abspath(path.parent))
        self._contiguous = ":" not in str(frames)
        self.parameters: list[dict[str, Any]] = [
            {"name": "Frames", "type": "STRING", "default": str(frames)},
            {"name": "ChunkSize", "type": "INT", "minValue": 1, "default": chunk},
            {
                "name": "Precision", "type": "STRING", "default": precision,
                "allowedValues": ["bfloat16", "float32"],
            },
            {"name": "Threads", "type": "INT", "minValue": 1, "default": threads},
        ]  # fmt: skip
        self.steps: list[dict[str, Any]] = []

    def path(self, name: str, path: Path, flow: str, kind: str = "FILE") -> str:
        """A parameter for a path, and how a command names it. A folder and a name for sequences and outputs:
        no file is called like a sequence."""
        path = Path(os.path.abspath(path))
        if kind == "FILE" and (flow == "OUT" or Sequence.of(path) is not None):
            self.parameters.append({"name": name, "type": "STRING", "default": path.name})
            return f"{self.path(f'{name}Folder', path.parent, flow, 'DIRECTORY')}/{{{{Param.{name}}}}}"
        if path.is_relative_to(self._folder):  # only such paths may a template have as its defaults
            about = {"type": "PATH", "objectType": kind, "dataFlow": flow}
            path = path.relative_to(self._folder)
        else:
            about = {"type": "STRING"}
        self.parameters.append({"name": name, **about, "default": path.as_posix()})
        return f"{{{{Param.{name}}}}}"

    def options(self, options: Mapping[str, Any]) -> list[str]:
        """Options as the words of a command."""
        words = []
        for name, value in options.items():
            option = name.replace("_", "-")
            if isinstance(value, bool):
                words.append(f"--{option}" if value else f"--no-{option}")
            elif name in FILES and _is_file(value, FILES[name]):
                title = "".join(word.capitalize() for word in name.split("_"))
                words += [f"--{option}", self.path(title, Path(value), FILES[name])]
            elif value is not None:
                model, comma, rest = str(value).partition(",")
                model = os.path.abspath(model) if os.path.isfile(model) else model
                words += [f"--{option}", f"{model}{comma}{rest}"]
        return words

    def step(self, name: str, words: list[str], chunked: bool = True) -> None:
        """A step that runs `relight` with these words, for chunks of frames or once; after the last step."""
        space: dict[str, Any] = {}
        if chunked:
            words = [*words, "--frames", "{{Task.Param.Frames}}"]
            # Frames side by side share the analysis of those around them. With gaps none are.
            side_by_side = "CONTIGUOUS" if self._contiguous else "NONCONTIGUOUS"
            chunks = {"defaultTaskCount": "{{Param.ChunkSize}}", "rangeConstraint": side_by_side}
            numbers = {"name": "Frames", "type": "CHUNK[INT]", "range": "{{Param.Frames}}", "chunks": chunks}
            space = {"parameterSpace": {"taskParameterDefinitions": [numbers]}}
        after = {"dependencies": [{"dependsOn": self.steps[-1]["name"]}]} if self.steps else {}
        script = {"actions": {"onRun": {"command": "relight", "args": words}}}
        self.steps.append({"name": name, **after, **space, "script": script})

    def write(self) -> None:
        template = {
            "specificationVersion": "jobtemplate-2023-09",
            "extensions": ["TASK_CHUNKING"],
            "name": f"relight {self._path.stem}"[:128],
            "parameterDefinitions": self.parameters,
            "steps": self.steps,
        }
        if self._path.suffix.lower() == ".json":
            text = json.dumps(template, indent=2)
        else:
            text = yaml.safe_dump(template, sort_keys=False)
        with files.replacing(self._path) as beside:
            beside.write_text(text + "\n", encoding="utf-8")


def _lights(lights: Any, path: str | Path) -> tuple[Path, list[Light | MovingLight]]:
    """The lights file of a job, and the lights in it."""
    if isinstance(lights, str | Path):
        return Path(lights), read_lights(lights)
    lamps = [lights] if hasattr(lights, "at") or hasattr(lights, "samples") else list(lights)
    return files.check_writable(path, LIGHTS), lamps


def _warn_of_missing(there: Any, numbers: Frames, source: object) -> None:
    missing = [] if there is None else sorted(set(numbers).difference(there))
    if missing:
        warnings.warn(f"{source}: frames {Frames(missing)} are not there yet", stacklevel=3)


def _stem(source: str | Path) -> str:
    """What a source is called, without its frame number and suffix."""
    sequence = Sequence.of(source)
    return Path(source).stem if sequence is None else sequence.beside("").name


def _is_file(value: object, flow: str) -> bool:
    """Whether an option names a file or a sequence, not a colour or a network."""
    if flow == "OUT":
        return True
    return isinstance(value, str | Path) and (os.path.isfile(value) or Sequence.of(value) is not None)
