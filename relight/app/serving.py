"""The server of `relight app`, on this machine's loopback address unless another one is chosen."""

import contextlib
import errno
import ipaddress
import os
import secrets
import signal
import socket
import sys
import threading
from collections.abc import AsyncIterator, Callable, Generator
from pathlib import Path
from types import FrameType

import uvicorn
from starlette.applications import Starlette
from starlette.routing import Mount

from relight.app.guard import ALL, HOST, Guard
from relight.app.server import Server
from relight.app.session import Session
from relight.app.worker import Worker


def application(session: Session, worker: Worker, token: str, port: int, host: str = HOST) -> Guard:
    """Return the ASGI application, behind its guard."""

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        worker.start()
        try:
            yield
        finally:
            worker.stop()
            session.close()

    server = Server(session, worker)
    app = Starlette(routes=[Mount(f"/{token}", routes=server.routes())], lifespan=lifespan)
    return Guard(app, token, port, host)


class _Server(uvicorn.Server):
    """The server, which a second signal ends at once: uvicorn would print the traces of all requests."""

    def __init__(self, config: uvicorn.Config, session: Session, worker: Worker) -> None:
        super().__init__(config)
        self._session, self._worker = session, worker

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        if self.should_exit:
            self._worker.stop()
            self._session.close()
            os._exit(128 + sig)
        super().handle_exit(sig, frame)

    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None, None, None]:
        """Do nothing: `serve` captures them before there is an event loop, which an exception would break."""
        yield


def _end_by_exceptions() -> None:
    """Let SIGTERM, which uvicorn handles once it runs, end the program as an exception, so that files go."""
    if _handles_signals() and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))


def _end_undisturbed() -> None:
    """Ignore further signals: the program ends, and would print a trace of what they interrupt."""
    if _handles_signals():
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)


def _handles_signals() -> bool:
    """Return whether this thread is the one that may say what signals do."""
    return threading.current_thread() is threading.main_thread()


def address_of(host: str) -> str:
    """Return the IPv4 address that `host` means: an address of this machine, 0.0.0.0 or localhost.

    Raises ValueError for anything else.
    """
    if host == "localhost":
        return HOST
    try:
        return str(ipaddress.IPv4Address(host))
    except ValueError:
        raise ValueError(
            f"host: expected an IPv4 address of this machine, or {ALL} for all of them, got {host!r}"
        ) from None


def is_private(host: str) -> bool:
    """Return whether only this machine itself can reach an address."""
    return ipaddress.IPv4Address(host).is_loopback


def reachable(host: str) -> str:
    """Return the address by which other machines reach a server at `host`."""
    if host != ALL:
        return host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as route:
        try:
            route.connect(("192.0.2.1", 9))  # nothing is sent: the system tells where it would go out
            return str(route.getsockname()[0])
        except OSError:  # there is no network
            return HOST


def serve(root: str | Path | None, port: int, opened: Callable[[str], None], host: str = HOST) -> None:
    """Serve the application until it is interrupted.

    `root`: the folder that the page lists pictures of; None for none. `port`: of the address; 0 for any that
    is free. `host`: the address to listen on, see `address_of`. `opened`: called with the page's address,
    token included, once requests can come. Raises NotADirectoryError if `root` is no folder, ValueError for
    another host, OSError if the port is in use, or the address is none of this machine's.
    """
    host = address_of(host)
    _end_by_exceptions()
    folder = None if root is None else Path(root)
    if folder is not None and not folder.is_dir():
        raise NotADirectoryError(f"{folder}: expected a folder to choose pictures from")
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
    except OSError as error:
        listening.close()
        if error.errno == errno.EADDRNOTAVAIL:
            raise OSError(f"host {host}: is no address of this machine") from error
        raise OSError(
            f"port {port}: cannot be used ({error.strerror}); choose another (port=NUMBER)"
        ) from error
    port = listening.getsockname()[1]
    token, session, worker = secrets.token_urlsafe(24), Session(folder), Worker()
    config = uvicorn.Config(
        application(session, worker, token, port, host), log_level="warning", access_log=False,
        server_header=False, limit_concurrency=200, timeout_graceful_shutdown=2,
    )  # fmt: skip
    server = _Server(config, session, worker)
    hangup = getattr(signal, "SIGHUP", None)  # when its terminal is closed
    if hangup is not None and signal.getsignal(hangup) is signal.SIG_DFL:
        signal.signal(hangup, lambda number, frame: setattr(server, "should_exit", True))
    try:
        listening.listen()  # so that requests wait until the server has started
        with uvicorn.Server.capture_signals(server):
            opened(f"http://{reachable(host)}:{port}/{token}/")
            server.run(sockets=[listening])
    except (KeyboardInterrupt, SystemExit):
        _end_undisturbed()
        raise
    finally:
        session.close()
        listening.close()
