"""Renders a shot on many machines with Dask, where there is a cluster and no farm manager."""

import asyncio
import importlib
from collections import Counter, defaultdict
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, cast

from relight.arguments import checks_arguments
from relight.distributed.shared_source import shared_source
from relight.media.sequences import FrameRange, FrameSequence, GivenFrames
from relight.pipeline.frame_numbers import frames_for
from relight.pipeline.option_fields import Report
from relight.pipeline.options import (
    Compute,
    GivenLighting,
    GivenOutput,
    GivenSource,
    Lighting,
    Output,
    Source,
)
from relight.pipeline.render import render_shot
from relight.pipeline.shot import Shot
from relight.subject import weights
from relight.version import __version__
from shadow.installing import install_command

if TYPE_CHECKING:
    from distributed import Client, Future

ShotOptions: TypeAlias = tuple[Source, Lighting, Output, Compute]
MAX_CHUNK_FRAMES = 10  # each chunk also analyses the two frames before it and the two after it
MAX_FAILURES = 3  # of a frame, alone or with a reason, before it is given up
CONNECT_TIMEOUT = 30  # seconds for a scheduler to answer


@checks_arguments
def render_distributed(
    source: GivenSource,
    lighting: GivenLighting,
    output: GivenOutput,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    compute: Compute | None = None,
    frames: GivenFrames | None = None,
    chunk: int | None = None,
    resume: bool = False,
    progress: Report | None = None,
) -> dict[int, str]:
    """Render a shot as `relight.render_shot` does, with the workers of a Dask cluster. The result is
    bit-identical.

    Parameters
    ----------
    source, lighting, output, frames, resume, progress
        See `relight.render_shot`.
    scheduler
        Address of a Dask scheduler, such as "tcp://farm:8786". Its workers need the same version of relight,
        and see all files under the same paths.
    workers
        Instead of a scheduler, the number of processes on this machine.
    compute
        Compute of every worker; by default one thread, and this machine's default precision.
    chunk
        Number of frames in a task; by default at most 10, and few enough for four tasks for each worker.

    Returns
    -------
    dict[int, str]
        {frame number: error} of the frames that were given up.

    Raises
    ------
    ImportError
        Dask is missing (extra `farm`).
    ConnectionError
        The scheduler does not answer, or stops. Existing frames are kept, and `resume` continues from them.
        Other errors are those of `relight.render_shot`.

    Notes
    -----
    Where the person is found, they are followed through the shot first, and `relit.track.json` beside the
    first output says where they are; a run with `resume` takes that file. Pictures are those of one process
    with `Source(track=)` of it.

    A worker that dies loses at most the frame that it was making: the missing frames of its chunk go to other
    workers, one by one. A frame that fails three times is given up. This process writes movies and scripts at
    the end.

    Examples
    --------
    >>> lights = relight.read_lights("lights.yaml")
    >>> relight.render_distributed("plate.%04d.exr", lights, "relit.%04d.exr", workers=2)  # doctest: +SKIP
    """
    _needs("distributed")
    if (scheduler is None) == (workers is None):
        raise ValueError("scheduler: expected either the address of a scheduler or a number of workers")
    _check_address(scheduler)
    source, output = Source.of(source).absolute(), Output.of(output).absolute()
    lighting, compute = Lighting.of(lighting).absolute(), compute or Compute()
    lighting.check_any()
    compute = replace(compute, threads=1 if compute.threads is None else compute.threads)
    with Shot.open(source, lighting, compute) as shot:
        shot.check_outputs(output)
        precision, _ = shot.computed_in
        numbers = frames_for(shot, output, frames)
    stated = shot.stated_source
    chosen = cast(Literal["bfloat16", "float32"] | None, precision or compute.precision)
    compute = replace(compute, precision=chosen)
    lighting = lighting.with_lights(shot.lights.given)
    report = progress or (lambda done, total, what: None)
    # With no frames to make, this refuses what can be refused.
    in_chunks = replace(output, report=None)
    render_shot(stated, lighting, in_chunks, compute=compute, frames=FrameRange(), phase="frames")
    output, in_chunks = (replace(each, save_lights=None) for each in (output, in_chunks))
    source = shared_source(shot, _track_beside(output.paths[0]), report, keep=resume)
    with _client(scheduler, workers) as client:
        run = _Run(client, (source, lighting, in_chunks, compute), resume)
        problems = run.make(numbers.chunks(chunk or _chunk(len(numbers), client)), report)
    if output.needs_all_frames:
        missing = render_shot(
            source, lighting, output, compute=compute, frames=numbers, phase="finalize", progress=report
        )
        problems = missing | problems
    elif len(problems) == len(numbers):
        first = f"frame {numbers[0]}: {problems[numbers[0]]}"
        raise ValueError(f"none of {len(numbers)} frames could be made; {first}")
    return dict(sorted(problems.items()))


def _track_beside(path: Path) -> Path:
    """Return the file beside an output that says where the person of the shot is in each frame."""
    sequence = FrameSequence.of(path)
    return path.with_suffix(".track.json") if sequence is None else sequence.beside(".track.json")


@contextmanager
def executor(scheduler: str) -> Iterator[Executor]:
    """Return the workers of a Dask cluster as a pool, for `shadow.lightstage.stage.render_all`.

    ImportError: Dask is missing (extra `farm`). ConnectionError: no scheduler answers at that address.
    """
    _needs("distributed")
    _check_address(scheduler)
    with _client(scheduler, None) as client, client.get_executor(pure=False) as pool:
        yield pool


class _Run:
    """The chunks of a shot on the workers of a cluster."""

    def __init__(self, client: "Client", options: ShotOptions, resume: bool) -> None:
        """Take the options of the shot (source, lighting, output, compute), which are sent to each worker."""
        self._client, self._options, self._resume = client, options, resume
        self._scheduler = client.scheduler.addr  # a client that has given up no longer knows
        self._failed: Counter[int] = Counter()  # times that a frame failed
        self._avoid: defaultdict[int, set[str]] = defaultdict(set)  # workers at which it did

    def make(self, chunks: list[FrameRange], report: Report) -> dict[int, str]:
        """Render all frames; return {frame number: error}. Raises ConnectionError if the scheduler stops.

        A worker has one chunk at a time, so that its death is the fault of no other.
        """
        from distributed import as_completed

        waiting, total = chunks[::-1], sum(map(len, chunks))
        problems: dict[int, str] = {}
        jobs: dict[Future, FrameRange] = {}
        made, running = 0, as_completed()
        while waiting or jobs:
            while waiting and len(jobs) < max(1, sum(self._workers().values())):
                future = self._submit(waiting[-1])
                jobs[future] = waiting.pop()
                running.add(future)
            future = next(running)
            frames = jobs.pop(future)
            failed = self.failures(future, frames)
            again = [FrameRange([number]) for number in failed if self._failed[number] < MAX_FAILURES]
            problems |= {
                number: why for number, why in failed.items() if self._failed[number] == MAX_FAILURES
            }
            waiting += again[::-1]
            made += len(frames) - len(again)
            report(made, total, "Relighting")
        return problems

    def _submit(self, frames: FrameRange) -> "Future":
        """Submit a chunk to a worker; after a failure, to another worker if there is one."""
        avoid = self._avoid[frames[0]]
        others = [address for address in self._workers() if address not in avoid]
        preference = {"workers": others, "allow_other_workers": True} if avoid and others else {}
        resume = self._resume or bool(avoid)
        made_with = (__version__, *weights())
        return self._client.submit(
            make_frames, self._options, frames, resume, made_with, pure=False, **preference
        )

    def failures(self, future: "Future", frames: FrameRange) -> dict[int, str]:
        """Return {frame number: error} of a finished chunk."""
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
            workers = self._client.scheduler_info(n_workers=-1)["workers"]
        except (OSError, KeyError) as error:
            raise self._gone() from error
        return {address: about["nthreads"] for address, about in workers.items()}

    def _gone(self) -> ConnectionError:
        why = "the scheduler went away; the frames that are there stay (resume=True)"
        return ConnectionError(f"{self._scheduler}: {why}")


def make_frames(
    options: ShotOptions, frames: FrameRange, resume: bool, made_with: tuple[str, ...]
) -> tuple[str, dict[int, str]]:
    """Make the frames of a chunk, on a worker; return its address, and what is wrong with frames."""
    from distributed import get_worker

    address = get_worker().address
    try:
        if (here := (__version__, *weights())) != made_with:
            differs = "version of relight" if here[0] != made_with[0] else "weights"
            raise ValueError(f"has another {differs}, expected {made_with}, got {here}")
        source, lighting, output, compute = options
        problems = render_shot(
            source, lighting, output, compute=compute, frames=frames, phase="frames", resume=resume
        )
        return address, problems
    except (ImportError, MemoryError, OSError, RuntimeError, TypeError, ValueError) as error:
        return address, dict.fromkeys(frames, f"{address}: {error}")


@contextmanager
def _client(scheduler: str | None, workers: int | None) -> "Iterator[Client]":
    """Return a client of a cluster, and start a local cluster if no address is given."""
    import dask
    from distributed import Client, LocalCluster

    # A task whose worker died is sent again from here, with what is there of it kept.
    own = {"distributed.scheduler.allowed-failures": 0, "distributed.comm.timeouts.connect": CONNECT_TIMEOUT}
    quiet = {"distributed.logging.distributed": "critical"}
    with dask.config.set(own | quiet):
        if scheduler is None:
            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, memory_limit=0, dashboard_address="127.0.0.1:0",
                silence_logs="CRITICAL",
            )  # fmt: skip
            count = len(cluster.workers)
            cluster.adapt(minimum=count, maximum=count)  # one that is killed as it starts is replaced
            with cluster, Client(cluster) as client:
                yield client
            return
        try:
            with ThreadPoolExecutor(1) as pool:  # in a notebook, this thread runs an event loop
                pool.submit(asyncio.run, _ask(scheduler)).result()
            client = Client(scheduler, timeout=CONNECT_TIMEOUT)
        except (OSError, ValueError) as error:
            waited = f" within {CONNECT_TIMEOUT} s" if isinstance(error, TimeoutError) else ""
            raise ConnectionError(f"{scheduler}: no Dask scheduler answers there{waited}") from error
        try:
            yield client
        finally:
            client.close(timeout=1)


def _check_address(scheduler: str | None) -> None:
    """Raise ValueError for an address without content."""
    if scheduler is not None and not scheduler.strip():
        raise ValueError(f"scheduler: expected an address, such as tcp://farm:8786, got {scheduler!r}")


async def _ask(scheduler: str) -> None:
    """Ask the scheduler for its identity.

    Raises TimeoutError if it accepts a connection and does not answer, for which a `Client` would wait
    forever.
    """
    from distributed.core import rpc

    remote = rpc(scheduler, timeout=CONNECT_TIMEOUT)
    try:
        await asyncio.wait_for(remote.identity(), CONNECT_TIMEOUT)
    finally:
        await remote.close_rpc()


def _chunk(frames: int, client: "Client") -> int:
    """Return the number of frames in a task: at least one, and few enough for four tasks for each worker."""
    workers = sum(about["nthreads"] for about in client.scheduler_info(n_workers=-1)["workers"].values())
    return max(1, min(MAX_CHUNK_FRAMES, frames // (4 * max(1, workers))))


def _needs(package: str) -> None:
    """ImportError that names the extra, where it is missing."""
    try:
        importlib.import_module(package)
    except ImportError as error:
        raise ImportError(f"dask: needs {package}; install it with: {install_command('farm')}") from error
