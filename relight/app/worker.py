"""The process that computes for the server: one task at a time, started again when a task is cancelled."""

import asyncio
import contextlib
import functools
import multiprocessing
import os
import re
import traceback
import warnings
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from relight.app.messages import Answer, Progress, Said

EXPECTED = (ImportError, OSError, TypeError, ValueError)  # what bad input raises; anything else is a defect
STOPPED = "The computation ended unexpectedly; there may be too little memory. Try a smaller photograph."
DEFECT = "The computation failed, and that is a defect of relight. The terminal says more."


class Refused(Exception):
    """A request that cannot be met: a sentence for the page, and the status of HTTP."""

    def __init__(self, sentence: str, status: int = 422) -> None:
        super().__init__(as_text(sentence))
        self.status = status


def as_text(sentence: str) -> str:
    """Return a sentence with question marks for bytes that are no UTF-8, as names of files may have."""
    return sentence.encode(errors="replace").decode()


class Worker:
    """Runs the functions of `relight.app.tasks` in a process of its own.

    The server answers while the networks run, a task can be cancelled at any time, and a crash or a lack of
    memory ends a task and not the server.
    """

    def __init__(self) -> None:
        self._process: BaseProcess | None = None
        self._connection: Connection  # to the process that was started last
        self._turn = asyncio.Lock()

    def start(self) -> None:
        """Start the process unless it runs; it loads its libraries before the first task."""
        if self._process is not None and self._process.is_alive():
            return
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(theirs,), daemon=True, name="relight app: worker"
        )
        self._process.start()
        theirs.close()

    def stop(self) -> None:
        """End the process at once, whatever it does."""
        if self._process is None:
            return
        self._process.kill()
        self._process.join()
        self._connection.close()
        self._process = None

    async def run(
        self,
        task: str,
        folder: Path,
        arguments: Mapping[str, object],
        report: Callable[[Progress], None] = lambda said: None,
        *,
        brief: bool = False,
    ) -> Answer:
        """Run a task in `folder` when those before it are done; return what it returns.

        `report` gets {"what": what is done, "share": of the task that is done, or None}.
        A task whose caller is cancelled is ended with its process, unless it is `brief`.
        Raises Refused for what the task refuses, with no path of this machine in its sentence.
        """
        async with self._turn:
            self.start()
            try:
                # A thread waits: a pipe takes large arguments only as fast as the process reads them.
                ask: Callable[[], Said] = functools.partial(
                    _asked, self._connection, (task, str(folder), dict(arguments))
                )
                while True:
                    answer = asyncio.ensure_future(asyncio.to_thread(ask))
                    ask = self._connection.recv
                    try:
                        said = await asyncio.shield(answer)
                    except asyncio.CancelledError:
                        if not brief:
                            self.stop()
                        while brief and (await answer)[0] == "progress":
                            answer = asyncio.ensure_future(asyncio.to_thread(self._connection.recv))
                        with contextlib.suppress(Exception):
                            await answer
                        raise
                    if said[0] == "progress":
                        report(said[1])
                    elif said[0] == "done":
                        return said[1]
                    else:
                        raise Refused(said[1])
            except (EOFError, OSError) as error:
                self.stop()
                raise Refused(STOPPED) from error
            finally:
                self.start()


def _asked(connection: Connection, task: tuple[str, str, dict[str, object]]) -> Said:
    """Send a task, and return the first answer."""
    connection.send(task)
    return connection.recv()


def _serve(connection: Connection) -> None:
    """Run the tasks that arrive, until the server is gone; this is what the process does.

    Until the first ones arrive, and between them, it loads what they will need.
    """
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl C ends the server, which ends this process
    from relight.app import pictures, tasks
    from relight.media.images import limit_pixels

    limit_pixels(pictures.PIXELS)
    waiting = list(tasks.PREPARATIONS)
    while True:
        while waiting and not connection.poll():
            with contextlib.suppress(Exception):  # the task that needs it says what is wrong
                waiting.pop(0)()
        try:
            task, folder, arguments = connection.recv()
        except EOFError:
            return
        connection.send(answer_to(tasks, task, folder, arguments, connection))


def answer_to(
    tasks: object, task: str, folder: str, arguments: dict[str, object], connection: Connection
) -> tuple[str, object]:
    """Run a task and return its answer: ("done", its value) or ("refused", a sentence)."""

    def report(what: str, share: float | None = None) -> None:
        connection.send(("progress", {"what": what, "share": share}))

    try:
        os.chdir(folder)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", UserWarning)
            value = getattr(tasks, task)(**arguments, report=report)
        notes = [
            as_sentence(str(one.message), folder) for one in said if issubclass(one.category, UserWarning)
        ]
        return "done", {**value, "notes": list(dict.fromkeys(notes))}
    except EXPECTED as error:
        return "refused", as_sentence(str(error), folder)
    except MemoryError:
        return "refused", STOPPED
    except Exception:
        traceback.print_exc()
        return "refused", DEFECT


def as_sentence(text: str, folder: str) -> str:
    """Return a message in one line, without the paths of this machine."""
    for path in (folder, os.path.realpath(folder)):
        text = text.replace(f"{path}{os.sep}", "").replace(path, "the session's folder")
    with contextlib.suppress(RuntimeError):  # there is no home
        home = str(Path.home())
        if len(Path(home).parts) > 1:  # that of a system's own user may be /
            text = re.sub(rf"(?<![\w./-]){re.escape(home)}(?![\w-]|\.\w)", "~", text)
    return as_text(" ".join(text.split()))
