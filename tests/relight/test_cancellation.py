"""Cancelled tasks and interrupted threads leave whole files, and later calls as they were."""

import asyncio
import contextlib
import ctypes
import threading
from concurrent.futures import ThreadPoolExecutor
from random import Random

import numpy as np
import pytest
import torch
from helpers.killing import differences, pictures
from helpers.rising import STILL

import relight

OUTPUTS = ("r.%04d.exr", "r.%04d.png", "r.mov")
MOMENTS = [("Relighting", 1), ("Relighting", 4), ("Encoding r.mov", 2)]


@pytest.fixture(scope="module")
def photograph():
    """Somebody of 96 x 72 pixels."""
    person = np.random.default_rng(0).uniform(0.2, 0.6, (96, 72, 4)).astype(np.float32)
    person[..., 3] = 0
    person[8:90, 20:52, 3] = 1
    return person * person[..., 3:]


@pytest.fixture
def whole(stub, plates, tmp_path):
    """The folder of a run that nobody interrupted."""
    folder = tmp_path / "whole"
    folder.mkdir()
    render(stub, plates, folder)
    return folder


def render(stub, plates, folder, **options):
    stub.render(plates, STILL, [folder / name for name in OUTPUTS], **options)


def at(step, done, act):
    """A progress function that calls `act` at a moment."""
    return lambda number, total, name: act() if (name, number) == (step, done) else None


def interrupt():
    raise KeyboardInterrupt


def test_a_cancelled_task_leaves_later_calls_and_the_callers_settings_as_they_were(photograph):
    async def cancelled():
        task = asyncio.create_task(asyncio.to_thread(relight.apply, photograph, STILL))
        await asyncio.sleep(0.02)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        return await asyncio.to_thread(relight.apply, photograph, STILL)  # beside the one that goes on

    expected = relight.apply(photograph, STILL)
    torch.set_default_dtype(torch.float64)
    try:
        found = asyncio.run(cancelled())
        assert torch.get_default_dtype() == torch.float64
    finally:
        torch.set_default_dtype(torch.float32)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(relight.apply(photograph, STILL), expected)


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_shot_whose_task_is_cancelled_is_written_to_its_end(stub, plates, whole, tmp_path, moment):
    folder = tmp_path / "cancelled"
    folder.mkdir()

    async def cancelled():
        loop, reached = asyncio.get_running_loop(), asyncio.Event()
        progress = at(*moment, lambda: loop.call_soon_threadsafe(reached.set))
        task = asyncio.create_task(asyncio.to_thread(render, stub, plates, folder, progress=progress))
        await reached.wait()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(cancelled())  # which waits for its threads
    assert differences(folder, whole) == []


@pytest.mark.parametrize("moment", MOMENTS)
def test_an_interrupt_in_a_pool_leaves_whole_files_and_the_other_threads_alone(
    stub, plates, whole, tmp_path, moment
):
    stopped, other = tmp_path / "stopped", tmp_path / "other"
    for folder in (stopped, other):
        folder.mkdir()
    with ThreadPoolExecutor(2) as pool:
        failing = pool.submit(render, stub, plates, stopped, progress=at(*moment, interrupt))
        going = pool.submit(render, stub, plates, other)
        assert isinstance(failing.exception(), KeyboardInterrupt)
        going.result()
    assert differences(other, whole) == []
    check_whole(stopped, whole)
    render(stub, plates, stopped, resume=True)
    assert differences(stopped, whole) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_an_interrupt_at_any_moment_leaves_whole_files(stub, plates, whole, tmp_path, seed):
    folder, random = tmp_path / "stopped", Random(seed)
    folder.mkdir()
    steps, delay, timers = random.randrange(1, 13), random.uniform(0, 0.01), []

    def raise_in(thread):
        ctypes.pythonapi.PyThreadState_SetAsyncExc(
            ctypes.c_ulong(thread), ctypes.py_object(KeyboardInterrupt)
        )

    def progress(*_):
        nonlocal steps
        steps -= 1
        if steps == 0:  # the interrupt comes a little later, wherever the thread is then
            timers.append(threading.Timer(delay, raise_in, [threading.get_ident()]))
            timers[0].start()

    def run():
        with contextlib.suppress(KeyboardInterrupt):
            with contextlib.suppress(KeyboardInterrupt):
                render(stub, plates, folder, progress=progress)
            timers[0].join()
            for _ in range(1000):  # where one that comes after the run is raised
                pass

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    check_whole(folder, whole)
    render(stub, plates, folder, resume=True)
    assert differences(folder, whole) == []


def check_whole(folder, whole):
    """Check that each file is the one of an uninterrupted run."""
    for path in folder.glob("[!.]*"):
        if path.is_file():
            for found, expected in zip(pictures(path), pictures(whole / path.name), strict=True):
                np.testing.assert_array_equal(found, expected)
