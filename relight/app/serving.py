"""The server of `relight app`, on this machine's loopback address alone."""

import contextlib
import secrets
import signal
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.routing import Mount

from relight.app.guard import HOST, Guard
from relight.app.server import Server
from relight.app.session import Session
from relight.app.worker import Worker


def application(session: Session, worker: Worker, token: str, port: int) -> Guard:
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
    return Guard(app, token, port)


def serve(root: str | Path | None, port: int, opened: Callable[[str], None]) -> None:
    """Serve the application until it is interrupted.

    `root`: the folder that the page lists pictures of; None for none. `port`: of the loopback address; 0 for
    any that is free. `opened`: called with the address, token included, once requests can come. Raises
    NotADirectoryError if `root` is no folder, OSError if the port is in use.
    """
    folder = None if root is None else Path(root)
    if folder is not None and not folder.is_dir():
        raise NotADirectoryError(f"{folder}: expected a folder to choose pictures from")
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
    except OSError as error:
        listening.close()
        raise OSError(f"port {port}: cannot be used ({error.strerror}); choose another by --port") from error
    port = listening.getsockname()[1]
    token, session = secrets.token_urlsafe(24), Session(folder)
    config = uvicorn.Config(
        application(session, Worker(), token, port), log_level="warning", access_log=False,
        server_header=False, limit_concurrency=200, timeout_graceful_shutdown=2,
    )  # fmt: skip
    server = uvicorn.Server(config)
    hangup = getattr(signal, "SIGHUP", None)  # when its terminal is closed
    if hangup is not None and signal.getsignal(hangup) is signal.SIG_DFL:
        signal.signal(hangup, lambda number, frame: setattr(server, "should_exit", True))
    try:
        listening.listen()  # so that requests wait until the server has started
        opened(f"http://{HOST}:{port}/{token}/")
        server.run(sockets=[listening])
    finally:
        session.close()
        listening.close()
