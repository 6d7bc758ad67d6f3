"""The server of `relight app`: its pages and their requests, on this machine's loopback address alone."""

import asyncio
import contextlib
import secrets
import socket
from collections.abc import AsyncIterator, Callable, Iterable
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route

from relight.app.answers import json_of, notes_of, refusing, streamed, while_connected
from relight.app.guard import HOST, Guard
from relight.app.session import MASK_SUFFIX, MODELS, PICTURES, Photograph, Session
from relight.app.worker import Refused, Worker
from relight.viewer.page import module, style

ORIGINAL = "original"  # as a background: the photograph itself
OUTPUTS = (".png", ".jpg", ".tif", ".exr", ".html", ".glb")
KINDS = {".js": "text/javascript", ".css": "text/css", ".html": "text/html", ".png": "image/png"}
VIEWER_NAMES = (
    "Engine", "SHADERS", "Viewer", "checkedLight", "environmentText", "fitting", "h", "iconButton",
    "keyDown", "keyUp", "lightTexts", "panned", "power", "preferredSurround", "readImage", "samples", "short",
    "surround", "toCommand", "wheeled", "zoomed",
)  # fmt: skip


class Server:
    """The application's requests: each method is an endpoint."""

    def __init__(self, session: Session, worker: Worker) -> None:
        self.session, self.worker = session, worker

    def routes(self) -> list[Route]:
        """Return what is under the token."""
        one = "/photographs/{id}"
        return [
            Route("/", self.page),
            Route("/viewer.js", self.viewer),
            Route("/viewer.css", self.viewer_style),
            Route("/web/{name}", self.file_of_page),
            Route("/session", refusing(self.about)),
            Route("/photographs", refusing(self.add), methods=["POST"]),
            Route("/root", refusing(self.add_from_root), methods=["POST"]),
            Route("/example", refusing(self.add_example), methods=["POST"]),
            Route(one, refusing(self.remove), methods=["DELETE"]),
            Route(f"{one}/preview", refusing(self.preview)),
            Route(f"{one}/outline", refusing(self.outline), methods=["POST"]),
            Route(f"{one}/model", refusing(self.model), methods=["POST"]),
            Route(f"{one}/analyse", refusing(self.analyse), methods=["POST"]),
            Route(f"{one}/pack", refusing(self.pack)),
            Route(f"{one}/scene", refusing(self.scene)),
            Route(f"{one}/still", refusing(self.still), methods=["POST"]),
            Route(f"{one}/save", refusing(self.save), methods=["POST"]),
            Route(f"{one}/files/{{name}}", refusing(self.download)),
            Route("/environments", refusing(self.environment), methods=["POST"]),
            Route("/backgrounds", refusing(self.background), methods=["POST"]),
            Route("/models", refusing(self.add_model), methods=["POST"]),
        ]

    # --- the page

    async def page(self, request: Request) -> Response:
        return HTMLResponse(_web("page.html"))

    async def viewer(self, request: Request) -> Response:
        return Response(
            f"{module()}\nexport {{ {', '.join(VIEWER_NAMES)} }};\n", media_type="text/javascript"
        )

    async def viewer_style(self, request: Request) -> Response:
        return Response(style(), media_type="text/css")

    async def file_of_page(self, request: Request) -> Response:
        name = request.path_params["name"]
        if name not in {path.name for path in files("relight.app").joinpath("web").iterdir()}:
            return Response("There is no such file.", 404)
        kind = KINDS.get(Path(name).suffix, "application/octet-stream")
        return Response(files("relight.app").joinpath("web", name).read_bytes(), media_type=kind)

    # --- photographs

    async def about(self, request: Request) -> Response:
        return JSONResponse(
            {
                "photographs": [one.to_json() for one in self.session.photographs.values() if one.about],
                "root": list(self.session.in_root()),
                "models": _models(),
                "suffixes": PICTURES,
                "outputs": _outputs(),
            }
        )

    async def add(self, request: Request) -> Response:
        photograph = self.session.new_photograph(request.query_params.get("name", ""))
        return await self._added(photograph, request.stream())

    async def add_from_root(self, request: Request) -> Response:
        relative = str((await json_of(request)).get("path", ""))
        return await self._added(await asyncio.to_thread(self.session.copy_from_root, relative))

    async def add_example(self, request: Request) -> Response:
        photograph = self.session.new_photograph("example.png")
        path = photograph.folder / photograph.name
        path.write_bytes(files("relight.app").joinpath("web", "example.png").read_bytes())
        return await self._added(photograph)

    async def _added(self, photograph: Photograph, chunks: Any = None) -> Response:
        """Read a new photograph; where that fails, nothing of it stays."""
        try:
            if chunks is not None:
                await self.session.receive(chunks, photograph.folder / photograph.name)
            photograph.about = await self.worker.run(
                "read", photograph.folder, {"name": photograph.name}, brief=True
            )
        except BaseException:
            self.session.remove(photograph)
            raise
        return JSONResponse(photograph.to_json())

    async def remove(self, request: Request) -> Response:
        self.session.remove(self._of(request))
        return JSONResponse({})

    async def preview(self, request: Request) -> Response:
        photograph = self._of(request)
        return FileResponse(photograph.folder / photograph.about["preview"])

    def _of(self, request: Request) -> Photograph:
        return self.session.photograph(request.path_params["id"])

    # --- outline

    async def outline(self, request: Request) -> Response:
        photograph, drawn = self._of(request), await json_of(request)
        work = self.worker.run("outline_of", photograph.folder, {"drawn": drawn}, brief=True)
        found = await while_connected(request, work)
        return Response(found["png"], media_type="image/png", headers=notes_of(found))

    async def model(self, request: Request) -> Response:
        photograph, asked = self._of(request), await json_of(request)
        if "file" in asked:
            name = ",".join(
                filter(None, [self.session.lend(str(asked["file"]), photograph), asked.get("options")])
            )
        else:
            name = str(asked.get("name"))
            if name not in {model["name"] for model in _models()}:
                raise Refused("This model is not offered here.", 404)
        work = self.worker.run("matte_by_model", photograph.folder, {"model": name})
        found = await while_connected(request, work)
        return Response(found["png"], media_type="image/png", headers=notes_of(found))

    async def add_model(self, request: Request) -> Response:
        identity, path = self.session.new_file(request.query_params.get("name", ""), MODELS)
        await self.session.receive(request.stream(), path)
        return JSONResponse({"file": identity, "name": path.name})

    async def analyse(self, request: Request) -> Response:
        photograph, asked = self._of(request), await json_of(request)
        drawn = asked.get("drawn")
        uses_own = photograph.about["cut_out"] and not drawn
        mask = None if uses_own else f"{photograph.stem}{MASK_SUFFIX}"
        if not uses_own and not drawn:
            raise Refused("The photograph has no outline yet: draw a line around the person.")

        async def work(report: Callable[[str], None]) -> dict[str, Any]:
            arguments = {"name": photograph.name, "mask": mask, "drawn": drawn}
            found = await self.worker.run("analyse", photograph.folder, arguments, report)
            photograph.mask, photograph.scene = mask, found["scene"]
            if mask is not None:
                photograph.outputs.add(mask)
            return {"photograph": photograph.to_json(), "notes": found["notes"]}

        return streamed(work)

    # --- light

    async def pack(self, request: Request) -> Response:
        from relight.app.tasks import PACK

        return FileResponse(self._analysed(request).folder / PACK)

    async def scene(self, request: Request) -> Response:
        return JSONResponse(self._analysed(request).scene)

    async def environment(self, request: Request) -> Response:
        identity, path = self.session.new_file(request.query_params.get("name", ""), PICTURES)
        await self.session.receive(request.stream(), path)
        found = await self.worker.run("environment", path.parent, {"name": path.name}, brief=True)
        return JSONResponse({"file": identity, **found})

    async def background(self, request: Request) -> Response:
        identity, path = self.session.new_file(request.query_params.get("name", ""), PICTURES)
        await self.session.receive(request.stream(), path)
        found = await self.worker.run("background", path.parent, {"name": path.name}, brief=True)
        return JSONResponse({"file": identity, **found})

    async def still(self, request: Request) -> Response:
        photograph = self._analysed(request)
        look = self._look(await json_of(request), photograph)
        arguments = {"name": photograph.name, "mask": photograph.mask, "look": look}
        found = await self.worker.run("still", photograph.folder, arguments, brief=True)
        return Response(found["png"], media_type="image/png")

    # --- files

    async def save(self, request: Request) -> Response:
        photograph, asked = self._analysed(request), await json_of(request)
        suffix = str(asked.get("suffix"))
        if suffix not in OUTPUTS:
            raise Refused(f"suffix: expected one of {', '.join(OUTPUTS)}")
        look = self._look(asked.get("look") or {}, photograph)
        passes = [str(name) for name in asked.get("passes") or []] if suffix == ".exr" else []
        output = photograph.output(suffix)

        async def work(report: Callable[[str], None]) -> dict[str, Any]:
            arguments = {
                "name": photograph.name, "mask": photograph.mask, "look": look, "output": output,
                "passes": passes,
            }  # fmt: skip
            found = await self.worker.run("save", photograph.folder, arguments, report)
            photograph.outputs.add(output)
            return {"file": output, "notes": found["notes"]}

        return streamed(work)

    async def download(self, request: Request) -> Response:
        photograph, name = self._of(request), request.path_params["name"]
        if name not in photograph.outputs:
            return Response("There is no such file.", 404)
        if name == photograph.mask:
            arguments = {"name": photograph.name, "mask": name}
            await self.worker.run("full_matte", photograph.folder, arguments, brief=True)
        disposition = f"attachment; filename*=UTF-8''{quote(name)}"
        return FileResponse(photograph.folder / name, headers={"Content-Disposition": disposition})

    def _analysed(self, request: Request) -> Photograph:
        photograph = self._of(request)
        if photograph.scene is None:
            raise Refused("The person has not been analysed yet.", 409)
        return photograph

    def _look(self, given: Any, photograph: Photograph) -> dict[str, Any]:
        """Return the lights and background that a page asks for; put their files beside the photograph."""
        look = {key: given.get(key) for key in ("lights", "environment", "background", "exposure", "gloss")}
        if look["environment"]:
            name = self.session.lend(str(look["environment"]["file"]), photograph)
            look["environment"] = f"{name},{look['environment']['settings']}"
        if look["background"] == ORIGINAL:
            look["background"] = {"file": photograph.name}
        elif isinstance(look["background"], dict):
            look["background"] = {"file": self.session.lend(str(look["background"]["file"]), photograph)}
        return look


def _models() -> list[dict[str, str]]:
    """Return the models of rembg, with size and licence of each; an empty list without rembg."""
    from importlib.util import find_spec

    if find_spec("rembg") is None:
        return []
    from relight.matting.networks import DOWNLOADS

    return [{"name": name, "about": about} for name, about in DOWNLOADS.items()]


def _outputs() -> list[str]:
    """Return the suffixes of the files that can be saved."""
    from importlib.util import find_spec

    meshes = find_spec("trimesh") is not None
    return [suffix for suffix in OUTPUTS if meshes or suffix != ".glb"]


def _web(name: str) -> str:
    return files("relight.app").joinpath("web", name).read_text(encoding="utf-8")


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


def serve(
    root: str | Path | None = None,
    port: int = 0,
    opened: Iterable[Callable[[str], Any]] = (),
) -> None:
    """Serve the application until it is interrupted.

    Parameters
    ----------
    root:
        The folder that the page lists pictures of; None for none.
    port:
        Of the loopback address; 0 for any that is free.
    opened:
        Called with the address, token included, once the server listens.

    Raises
    ------
    NotADirectoryError
        `root` is no folder.
    OSError
        The port is in use.
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
    server = _Announcing(config, f"http://{HOST}:{port}/{token}/", opened)
    try:
        server.run(sockets=[listening])
    finally:
        session.close()
        listening.close()


class _Announcing(uvicorn.Server):
    """A server that reports its address once it listens."""

    def __init__(self, config: uvicorn.Config, address: str, opened: Iterable[Callable[[str], Any]]) -> None:
        super().__init__(config)
        self._address, self._opened = address, opened

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        for tell in self._opened:
            tell(self._address)
