"""A shot on many machines by Dask, for who has a cluster and no farm manager."""

import importlib
import os
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any

from relight import __version__
from relight.lights.light import Light
from relight.lights.moving import MovingLight
from relight.media import movies
from relight.media.sequences import Frames, Sequence
from relight.outputs import END, FRAMES, Report
from relight.people import computing
from relight.preparation import Preparation, Source
from relight.subject import weights
from relight.video import frames_of, render_video
from shadow.networks.precision import in_use

CHUNK = 10  # frames that are made together, at most: each chunk also analyses the two before it and after it
TRIES = 3  # times that a frame is made alone, or fails with a reason, before it is given up
FILES = "mask", "background", "normals", "depth", "save_matte"  # settings that may be files
PATIENCE = 30  # seconds for a scheduler to answer


def render_distributed(
    source: Source,
    lights: Light | MovingLight | Iterable[Light | MovingLight],
    outputs: str | Path | Iterable[str | Path],
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    frames: tuple[int, int] | str | Frames | None = None,
    chunk: int | None = None,
    precision: str | None = None,
    threads: int = 1,
    resume: bool = False,
    progress: Report | None = None,
    **settings: Any,
) -> dict[int, str]:
    """As `relight.render_video`, by the workers of a Dask cluster; the result is the same to the bit.

    Parameters
    ----------
    source, lights, outputs, frames, resume, progress, settings: as of `relight.render_video`.
    scheduler: address of a Dask scheduler, such as "tcp://farm:8786". Its workers need the same version of
        relight, and see all files under the same paths.
    workers: instead of a scheduler, so many processes on this machine.
    chunk: frames of a task; unless given 10, or fewer so that each worker has four tasks.
    precision, threads: as of `relight.analyse_shot`, of every worker; the precision is this machine's unless
        given.

    A worker that dies loses at most the frame that it was making: what its chunk lacks goes to others, frame
    by frame. A frame that fails three times is given up. Movies and scripts are made in the end, by this
    process.

    Returns
    -------
    {frame number: what is wrong}: the frames that were given up.

    Raises
    ------
    ImportError: Dask is missing (extra `farm`). ConnectionError: the scheduler does not answer, or goes away;
    the frames that are there stay, and `resume` goes on from them. Else as `relight.render_video`.
    """
    _needs("distributed")
    if (scheduler is None) == (workers is None):
        raise ValueError("scheduler: expected either the address of a scheduler or a number of workers")
    paths = [Path(path).absolute() for path in ([outputs] if isinstance(outputs, str | Path) else outputs)]
    source = _absolute(source)
    settings = settings | {name: _absolute(settings.get(name)) for name in FILES}
    cutting = settings.get("cutting")
    if cutting is not None and cutting.model is not None:
        settings["cutting"] = replace(cutting, model=_absolute(cutting.model))
    matching = settings.get("matching")
    if matching is not None:
        found = {"reference": _absolute(matching.reference), "mask": _absolute(matching.mask)}
        settings["matching"] = replace(matching, **found)
    lamps: Any = lights
    lamps = [lamps] if hasattr(lamps, "at") or hasattr(lamps, "samples") else list(lamps)
    with computing(precision, threads):
        settings |= {"threads": threads}
        known = signature(Preparation).parameters
        prepared = Preparation(source, **{name: settings[name] for name in settings if name in known})
        if prepared.kept is None:
            settings["precision"] = in_use(settings.get("device") or "cpu")
    numbers = frames_of(frames, prepared.span, lamps)
    report = progress or (lambda done, total, what: None)
    # What can be refused is refused here: of no frames, that is all there is to do.
    render_video(source, lamps, paths, frames=Frames(), part=FRAMES, **settings)
    settings["save_lights"] = None
    with _client(scheduler, workers) as client:
        run = _Run(client, (source, lamps, paths), settings, resume)
        problems = run.make(numbers.chunks(chunk or _chunk(len(numbers), client)), report)
    if any(movies.is_movie(path) or path.suffix.lower() == ".nk" for path in paths):
        missing = render_video(source, lamps, paths, frames=numbers, part=END, progress=report, **settings)
        problems = missing | problems
    elif len(problems) == len(numbers):
        first = f"frame {numbers[0]}: {problems[numbers[0]]}"
        raise ValueError(f"none of {len(numbers)} frames could be made; {first}")
    return dict(sorted(problems.items()))


@contextmanager
def executor(scheduler: str) -> Iterator[Executor]:
    """The workers of a Dask cluster as a pool, for `shadow.lightstage.stage.render_all`.

    ImportError: Dask is missing (extra `farm`). ConnectionError: no scheduler answers at that address.
    """
    _needs("distributed")
    with _client(scheduler, None) as client, client.get_executor(pure=False) as pool:
        yield pool


class _Run:
    """The chunks of a shot on the workers of a cluster."""

    def __init__(self, client: Any, arguments: tuple, settings: dict[str, Any], resume: bool) -> None:
        self._client, self._arguments, self._settings = client, arguments, settings
        self._resume = resume
        self._scheduler = client.scheduler.addr  # a client that has given up no longer knows
        self._failed: Counter[int] = Counter()  # times that a frame failed
        self._avoid: defaultdict[int, set[str]] = defaultdict(set)  # workers at which it did

    def make(self, chunks: list[Frames], report: Report) -> dict[int, str]:
        """All frames; {frame number: what is wrong}. ConnectionError where the scheduler goes away.

        A worker has one chunk at a time, so that its death is the fault of no other.
        """
        from distributed import as_completed

        waiting, total = chunks[::-1], sum(map(len, chunks))
        problems: dict[int, str] = {}
        jobs: dict[Any, Frames] = {}
        made, running = 0, as_completed()
        while waiting or jobs:
            while waiting and len(jobs) < max(1, sum(self._workers().values())):
                future = self._submit(waiting[-1])
                jobs[future] = waiting.pop()
                running.add(future)
            future = next(running)
            frames = jobs.pop(future)
            failed = self._failures(future, frames)
            again = [Frames([number]) for number in failed if self._failed[number] < TRIES]
            problems |= {number: why for number, why in failed.items() if self._failed[number] == TRIES}
            waiting += again[::-1]
            made += len(frames) - len(again)
            report(made, total, "Relighting")
        return problems

    def _submit(self, frames: Frames) -> Any:
        """A chunk on its way to a worker; where one failed, to another if there is one."""
        avoid = self._avoid[frames[0]]
        others = [address for address in self._workers() if address not in avoid]
        place = {"workers": others, "allow_other_workers": True} if avoid and others else {}
        resume = self._resume or bool(avoid)
        made_with = (__version__, *weights())
        return self._client.submit(
            _make, self._arguments, self._settings, frames, resume, made_with, pure=False, **place
        )

    def _failures(self, future: Any, frames: Frames) -> dict[int, str]:
        """What is wrong with the frames of a chunk that has come back."""
        from distributed import KilledWorker
        from distributed.comm import CommClosedError

        counted = True
        try:
            worker, failed = future.result()
        except KilledWorker as death:
            worker, reason = death.last_worker.address, "the worker died, perhaps for want of memory"
            failed = dict.fromkeys(frames, f"{worker}: {reason}")
            counted = len(frames) == 1  # of several nobody knows which it was
        except (CancelledError, CommClosedError, TimeoutError) as error:
            raise self._gone() from error
        for number in failed:
            self._avoid[number].add(worker)
            self._failed[number] += counted
        return failed

    def _workers(self) -> dict[str, int]:
        """{address: tasks at a time} of the workers that there are."""
        try:
            found = self._client.scheduler_info(n_workers=-1)["workers"]
        except (OSError, KeyError) as error:
            raise self._gone() from error
        return {address: about["nthreads"] for address, about in found.items()}

    def _gone(self) -> ConnectionError:
        why = "the scheduler went away; the frames that are there stay (--resume)"
        return ConnectionError(f"{self._scheduler}: {why}")


def _make(
    arguments: tuple, settings: dict[str, Any], frames: Frames, resume: bool, made_with: tuple[str, ...]
) -> tuple[str, dict[int, str]]:
    """What a worker does: the frames of a chunk. Its address, and what is wrong with frames."""
    from distributed import get_worker

    address = get_worker().address
    try:
        if (here := (__version__, *weights())) != made_with:
            differs = "version of relight" if here[0] != made_with[0] else "weights"
            raise ValueError(f"has another {differs}, expected {made_with}, got {here}")
        return address, render_video(*arguments, frames=frames, part=FRAMES, resume=resume, **settings)
    except (ImportError, MemoryError, OSError, TypeError, ValueError) as error:
        return address, dict.fromkeys(frames, f"{address}: {error}")


@contextmanager
def _client(scheduler: str | None, workers: int | None) -> Iterator[Any]:
    """A client of a cluster, which is started for it unless it is there."""
    import dask
    from distributed import Client, LocalCluster

    # A task whose worker died is sent again from here, with what is there of it kept.
    own = {"distributed.scheduler.allowed-failures": 0, "distributed.comm.timeouts.connect": PATIENCE}
    quiet = {"distributed.logging.distributed": "critical"}
    with dask.config.set(own | quiet):
        if scheduler is None:
            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, memory_limit=0, dashboard_address="127.0.0.1:0",
                silence_logs="CRITICAL",
            )  # fmt: skip
            cluster.adapt(
                minimum=len(cluster.workers), maximum=len(cluster.workers)
            )  # one that is killed as it starts is replaced
            with cluster, Client(cluster) as client:
                yield client
            return
        try:
            client = Client(scheduler, timeout=PATIENCE)
        except (OSError, ValueError) as error:
            raise ConnectionError(f"{scheduler}: no Dask scheduler answers there") from error
        try:
            yield client
        finally:
            client.close(timeout=1)


def _chunk(frames: int, client: Any) -> int:
    """Frames of a task: few enough that each worker has four of these, at least one."""
    workers = sum(about["nthreads"] for about in client.scheduler_info(n_workers=-1)["workers"].values())
    return max(1, min(CHUNK, frames // (4 * max(1, workers))))


def _absolute(value: Any) -> Any:
    """A path that means the same on each machine; what is no path of a file as it is."""
    if not isinstance(value, str | Path) or not (os.path.exists(value) or Sequence.of(value)):
        return value
    return type(value)(os.path.abspath(value))


def _needs(package: str) -> None:
    """ImportError that names the extra, where it is missing."""
    try:
        importlib.import_module(package)
    except ImportError as error:
        raise ImportError(f"dask: needs {package}; install it with: pip install 'relight[farm]'") from error
