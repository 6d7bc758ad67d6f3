"""A shot as a job for a farm: an Open Job Description template, which AWS Deadline Cloud and others run.

Its steps are the commands of this package, `relight analyse` and `relight apply`. Files are parameters of the
job, and arguments of the commands; all other options are JSON files that the template embeds. See
https://github.com/OpenJobDescription/openjd-specifications, "Template Schemas", version 2023-09.
"""

import json
import os
import re
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import torch
import yaml

from relight import quantities
from relight.arguments import checks_arguments
from relight.distributed.shared_source import shared_source
from relight.media.sequences import FrameRange, FrameSequence, GivenFrames
from relight.pipeline.frame_numbers import frames_for
from relight.pipeline.option_fields import BACKGROUND, Options, file_options, to_json
from relight.pipeline.options import Compute, GivenLighting, GivenOutput, Lighting, Output, Source
from relight.pipeline.shot import Shot
from relight.scene.lights import SUFFIXES as LIGHTS_SUFFIXES
from relight.scene.lights import write_lights
from shadow import files
from shadow.networks.precision import in_use

SUFFIXES = (".json", ".yaml", ".yml")
CHUNK_FRAMES = 10  # of a task, unless asked otherwise


@checks_arguments
def write_job(
    path: quantities.File,
    source: Source | str | Path,
    lighting: GivenLighting,
    output: GivenOutput,
    *,
    compute: Compute | None = None,
    frames: GivenFrames | None = None,
    analysis: quantities.File | None = None,
    chunk: int = CHUNK_FRAMES,
) -> None:
    """Write a job that does what `relight.render_shot` does, on many machines.

    Its steps are Analyse, in chunks of frames; Light, in chunks of frames, after all of Analyse; and Finish,
    after all of Light, if there is a movie or a script. Tasks keep existing frames, so the farm can run each
    one again. Frames, chunk size, precision, threads, plates, lights and outputs are parameters of the job:
    for other lights, run the same job with another parameter. Where the person is found, they are
    followed through the shot now, half a second a frame, and `job.track.json` beside the template says where
    they are, see `relight.write_track`: for other plates, write another job.

    Parameters
    ----------
    path
        The template, .json or .yaml. Files in its folder are relative to it, and the folder may have another
        path on the farm; other files need the same path on all machines.
    source
        Source, or the path of a plate. With an analysis cache there is no step Analyse.
    lighting
        Lighting, or lights. Unless the lights are those of one lights file, all lights are written to a
        lights file: `save_lights` of the output, or `job.lights.yaml` beside the template.
    output, frames
        See `relight.render_shot`.
    compute
        Compute of each task. Precision and threads are by default those of this process; they are the same on
        all machines, so that frames are bit-identical.
    analysis
        The folder of the analysis cache; by default beside the template, and named after the source:
        `plate.relight`.
    chunk
        Number of frames in a task.

    Raises
    ------
    FileNotFoundError
        No such files.
    OSError
        It cannot be written.
    ValueError
        Bad arguments, outputs that are also inputs.

    Examples
    --------
    >>> source = relight.Source("plate.%04d.exr", mask="matte.%04d.png")
    >>> relight.write_job("job.json", source, "lights.yaml", "relit.%04d.exr")
    """
    path = files.check_writable(path, SUFFIXES)
    lighting, output, compute = Lighting.of(lighting), Output.of(output), compute or Compute()
    if chunk < 1:
        raise ValueError(f"chunk: expected at least 1 frame, got {chunk}")
    if Source.of(source).size == BACKGROUND:
        raise ValueError("size: expected WIDTHxHEIGHT, since an analysis knows no background")
    lighting.check_any()
    shot = Shot(source, lighting, compute)
    alone = not (lighting.light or lighting.environment)
    # One file of all lights.
    given = Path(lighting.lights) if alone and files.is_path(lighting.lights) else None
    lights_path = given or files.check_writable(
        output.save_lights or path.with_name(f"{path.stem}.lights.yaml"), LIGHTS_SUFFIXES
    )
    output = replace(output, save_lights=None)
    shot.check_outputs(output, lights_path)
    lighting = shot.lighting_of_analysed(output)
    shot.check_not_read([path] if given else [path, lights_path])
    numbers = frames_for(shot, output, frames)
    missing = [] if shot.is_still else sorted(set(numbers).difference(shot.numbers))
    if missing:
        warnings.warn(f"{shot.source.plate}: frames {FrameRange(missing)} are not there yet", stacklevel=2)
    if given is None and shot.lights.given:  # a preset's lights follow from the person
        write_lights(lights_path, shot.lights.given)
        lighting = lighting.with_lights(lights_path)
    job, plate = _Job(path, numbers, chunk, compute), shot.source.plate
    cache = Path(str(plate) if shot.is_analysed else analysis or _analysis_beside(path, plate))
    source = shared_source(shot, path.with_name(f"{path.stem}.track.json"))
    _add_steps(job, shot, source, lighting, output, cache)
    job.write()


def _add_steps(
    job: "_Job", shot: Shot, source: Source, lighting: Lighting, output: Output, kept: Path
) -> None:
    """Add the steps of a job. `kept`: folder of the analysis."""
    threads = ["--threads", "{{Param.Threads}}"]
    compute = Compute(device=shot.compute.device)
    analysis = job.path("Analysis", kept, "IN" if shot.is_analysed else "INOUT", "DIRECTORY")
    if not shot.is_analysed:
        plate = job.path("Plate", Path(str(source.plate)), "IN")
        words = ["analyse", plate, "-o", analysis, *job.files(source, "plate")]
        words += ["--precision", "{{Param.Precision}}", *threads]
        job.step("Analyse", words, {"source": source, "compute": compute}, chunked=not shot.is_still)
    words = ["apply", analysis, *job.files(lighting)]
    for number, path in enumerate(output.paths):
        words += ["-o", job.path(f"Output{number or ''}", path, "OUT")]
    finishes, reported, output = output.needs_all_frames, output.report, replace(output, report=None)
    words += [*job.files(output, "paths"), *threads]
    options: dict[str, Options] = {"lighting": lighting, "output": output, "compute": compute}
    job.step("Light", [*words, "--phase", "frames", "--resume"], options)
    if finishes:
        words += [] if reported is None else ["--report", job.path("Report", reported, "OUT")]
        words += ["--phase", "finalize", "--frames", "{{Param.Frames}}"]
        job.step("Finish", words, options, chunked=False)


class _Job:
    """A template that is being put together."""

    def __init__(self, path: Path, frames: FrameRange, chunk: int, compute: Compute) -> None:
        self._path, self._folder = path, Path(os.path.abspath(path.parent))
        self._contiguous = ":" not in str(frames)
        self.parameters: list[dict[str, object]] = [
            {"name": "Frames", "type": "STRING", "default": str(frames)},
            {"name": "ChunkSize", "type": "INT", "minValue": 1, "default": chunk},
            {
                "name": "Precision", "type": "STRING", "default": compute.precision or in_use("cpu"),
                "allowedValues": ["bfloat16", "float32"],
            },
            {
                "name": "Threads", "type": "INT", "minValue": 1,
                "default": compute.threads or torch.get_num_threads(),
            },
        ]  # fmt: skip
        self.steps: list[dict[str, object]] = []

    def path(self, name: str, path: Path, flow: str, kind: str = "FILE") -> str:
        """Add a parameter for a path, and return the text by which a command refers to it.

        Sequences and outputs have a parameter for the folder and one for the name, because no file has the
        name of a sequence.
        """
        path = Path(os.path.abspath(path))
        if kind == "FILE" and (flow == "OUT" or FrameSequence.of(path) is not None):
            self.parameters.append({"name": name, "type": "STRING", "default": path.name})
            return f"{self.path(f'{name}Folder', path.parent, flow, 'DIRECTORY')}/{{{{Param.{name}}}}}"
        if path.is_relative_to(self._folder):  # only such paths may a template have as its defaults
            about = {"type": "PATH", "objectType": kind, "dataFlow": flow}
            path = path.relative_to(self._folder)
        else:
            about = {"type": "STRING"}
        self.parameters.append({"name": name, **about, "default": path.as_posix()})
        return f"{{{{Param.{name}}}}}"

    def files(self, options: Options, *apart: str) -> Iterator[str]:
        """Yield the words that name the files of options, except those of the fields `apart`."""
        flow = "OUT" if isinstance(options, Output) else "IN"
        for name, path in _files_in(options).items():
            if name not in apart:
                yield f"--{name.replace('_', '-')}"
                yield self.path("".join(word.capitalize() for word in name.split("_")), Path(path), flow)

    def step(self, name: str, words: list[str], options: dict[str, Options], chunked: bool = True) -> None:
        """Add a step that runs `relight` with these words and options, for chunks of frames or once."""
        space: dict[str, object] = {}
        if chunked:
            words = [*words, "--frames", "{{Task.Param.Frames}}"]
            # Frames side by side share the analysis of those around them. With gaps none are.
            side_by_side = "CONTIGUOUS" if self._contiguous else "NONCONTIGUOUS"
            chunks = {"defaultTaskCount": "{{Param.ChunkSize}}", "rangeConstraint": side_by_side}
            numbers = {"name": "Frames", "type": "CHUNK[INT]", "range": "{{Param.Frames}}", "chunks": chunks}
            space = {"parameterSpace": {"taskParameterDefinitions": [numbers]}}
        embedded: dict[str, object] = {}
        document = {group: stored for group, each in options.items() if (stored := _without_files(each))}
        if document:
            data = _without_expressions(json.dumps(document, indent=1))
            file = {"name": "Options", "type": "TEXT", "filename": "options.json", "data": data}
            embedded = {"embeddedFiles": [file]}
            words = [*words, "--options", "{{Task.File.Options}}"]
        after = {"dependencies": [{"dependsOn": self.steps[-1]["name"]}]} if self.steps else {}
        script = embedded | {"actions": {"onRun": {"command": "relight", "args": words}}}
        self.steps.append({"name": name, **after, **space, "script": script})

    def write(self) -> None:
        template = {
            "specificationVersion": "jobtemplate-2023-09",
            "extensions": ["TASK_CHUNKING"],
            "name": f"relight {_plain(self._path.stem)}"[:128],
            "parameterDefinitions": self.parameters,
            "steps": self.steps,
        }
        if self._path.suffix.lower() == ".json":
            text = json.dumps(template, indent=2)
        else:
            text = yaml.safe_dump(template, sort_keys=False)
        with files.replacing(self._path) as beside:
            beside.write_text(text + "\n", encoding="utf-8")


def _without_expressions(text: str) -> str:
    """Return JSON, indented, without the double braces that a template would take for its own expressions."""
    return text.replace("{{", "\\u007b\\u007b").replace("}}", "\\u007d\\u007d")


def _plain(name: str) -> str:
    """Return a name as a job may have it: without control characters and double braces."""
    return re.sub(r"([{}])\1+", r"\1", re.sub(r"[\x00-\x1f\x7f-\x9f]+", " ", name))


def _analysis_beside(path: Path, plate: object) -> Path:
    """Return the folder of the analysis, beside the job and named after the plate."""
    sequence = FrameSequence.of(str(plate))
    stem = Path(str(plate)).stem if sequence is None else sequence.beside("").name
    return path.with_name(f"{stem}.relight")


def _without_files(options: Options) -> dict[str, object]:
    """Return options as JSON without files that are parameters of the job; other paths become absolute."""
    apart = {"plate", "paths", *_files_in(options)}
    return {name: value for name, value in to_json(options.absolute()).items() if name not in apart}


def _files_in(options: Options) -> dict[str, files.AnyPath]:
    """Return the options whose values are files or sequences, not colours or names of networks."""

    def is_file(value: object) -> bool:
        if isinstance(options, Output):
            return isinstance(value, Path)
        return files.is_path(value) and (os.path.isfile(value) or FrameSequence.of(value) is not None)

    names = file_options(type(options))
    return {name: value for name in names if is_file(value := getattr(options, name))}
