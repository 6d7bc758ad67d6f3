"""The requests of `relight app`: each method of `Server` is an endpoint."""

import asyncio
import contextlib
import os
from collections.abc import AsyncIterable, Awaitable, Callable
from functools import partial
from importlib.resources import files
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import cast
from urllib.parse import quote, unquote_to_bytes

from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from relight.app.answers import Report, json_of, picture, refusing, streamed
from relight.app.messages import Drawing, Look
from relight.app.session import (
    LISTED,
    MASK_SUFFIX,
    MODELS,
    MOVIE_OUTPUTS,
    MOVIES,
    PHOTOGRAPHED,
    PICTURES,
    Photograph,
    Session,
)
from relight.app.worker import Refused, Worker
from relight.lights import presets
from relight.viewer.page import module, style

OUTPUTS = (".png", ".jpg", ".webp", ".tif", ".exr", ".html", ".glb", *MOVIE_OUTPUTS)
KINDS = {".js": "text/javascript", ".css": "text/css", ".html": "text/html", ".png": "image/png"}
VIEWER_NAMES = (
    "Brush", "Engine", "SHADERS", "Viewer", "checkedLight", "environmentText", "fillOf", "fitting",
    "floorText", "h", "iconButton", "keyDown", "keyUp", "lightTexts", "panned", "power", "preferredSurround",
    "readImage", "samples", "short", "surround", "toCommand", "wheeled", "zoomed", "backdropOf",
    "lampsOfRows", "mapOf", "blurOf", "fewer", "placeOf", "placementOf",
    "reducedPack", "strided", "stridedRoom",
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
            Route(f"{one}/back", refusing(self.bring_back), methods=["POST"]),
            Route(f"{one}/person", refusing(self.person), methods=["POST"]),
            Route(f"{one}/turn", refusing(self.turn), methods=["POST"]),
            Route(f"{one}/outline", refusing(self.outline), methods=["POST"]),
            Route(f"{one}/model", refusing(self.model), methods=["POST"]),
            Route(f"{one}/matte", refusing(self.matte), methods=["POST"]),
            Route(f"{one}/analyse", refusing(self.analyse), methods=["POST"]),
            Route(f"{one}/pack", refusing(self.pack)),
            Route(f"{one}/scene", refusing(self.scene)),
            Route(f"{one}/still", refusing(partial(self.lit, "still")), methods=["POST"]),
            Route(f"{one}/match", refusing(self.match), methods=["POST"]),
            Route(f"{one}/presets/{{preset}}", refusing(self.preset_picture)),
            Route(f"{one}/paint", refusing(self.paint), methods=["POST"]),
            Route(f"{one}/floor", refusing(partial(self.lit, "floor_shadow")), methods=["POST"]),
            Route(f"{one}/confidence", refusing(self.confidence), methods=["POST"]),
            Route(f"{one}/plot", refusing(self.plot), methods=["POST"]),
            Route(f"{one}/save", refusing(self.save), methods=["POST"]),
            Route(f"{one}/files/{{name}}", refusing(self.download)),
            Route("/environments", refusing(partial(self.surroundings, "environment")), methods=["POST"]),
            Route("/backgrounds", refusing(partial(self.surroundings, "background")), methods=["POST"]),
            Route("/environments/{id}", refusing(partial(self.surroundings_again, "environment"))),
            Route("/backgrounds/{id}", refusing(partial(self.surroundings_again, "background"))),
            Route("/person", refusing(partial(self.fetch, "fetch_person")), methods=["POST"]),
            Route("/silhouette", refusing(partial(self.fetch, "fetch_silhouette")), methods=["POST"]),
            Route("/references", refusing(self.add_reference), methods=["POST"]),
            Route("/models", refusing(self.add_model), methods=["POST"]),
        ]

    # --- the page

    async def page(self, request: Request) -> Response:
        return HTMLResponse(files("relight.app").joinpath("web", "page.html").read_text(encoding="utf-8"))

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
                "root": [
                    {"path": quote(os.fsencode(name)), "name": name.encode(errors="replace").decode()}
                    for name in islice(self.session.in_root(), LISTED)
                ],
                "models": _models(),
                "presets": presets.document(),
                "suffixes": PHOTOGRAPHED,
                "outputs": [suffix for suffix in OUTPUTS if suffix != ".glb" or find_spec("trimesh")],
                **_finder(),
            }
        )

    async def add(self, request: Request) -> Response:
        photograph = self.session.new_photograph(request.query_params.get("name", ""))
        return await self._added(photograph, request.stream())

    async def add_from_root(self, request: Request) -> Response:
        relative = os.fsdecode(unquote_to_bytes(str((await json_of(request)).get("path", ""))))
        return await self._added(await asyncio.to_thread(self.session.copy_from_root, relative))

    async def add_example(self, request: Request) -> Response:
        photograph = self.session.new_photograph("example.png")
        path = photograph.folder / photograph.name
        path.write_bytes(files("relight.app").joinpath("web", "example.png").read_bytes())
        return await self._added(photograph)

    async def _added(self, photograph: Photograph, chunks: AsyncIterable[bytes] | None = None) -> Response:
        """Read a new photograph; where that fails, nothing of it stays."""
        try:
            if chunks is not None:
                await self.session.receive(chunks, photograph.folder / photograph.name)
            if Path(photograph.name).suffix.lower() in MOVIES:
                clip = await self.worker.run(
                    "read_clip", photograph.folder, {"name": photograph.name}, brief=True
                )
                photograph.movie, photograph.name = photograph.name, clip["still"]
            photograph.about = await self.worker.run(
                "read", photograph.folder, {"name": photograph.name}, brief=True
            )
        except BaseException:
            self.session.discard(photograph)
            raise
        return JSONResponse(photograph.to_json())

    async def remove(self, request: Request) -> Response:
        self.session.remove(self._of(request))
        return JSONResponse({})

    async def bring_back(self, request: Request) -> Response:
        return JSONResponse(self.session.bring_back(request.path_params["id"]).to_json())

    async def preview(self, request: Request) -> Response:
        photograph = self._of(request)
        return _file_answer(photograph.folder / photograph.about["preview"])

    def _of(self, request: Request) -> Photograph:
        return self.session.photograph(request.path_params["id"])

    # --- outline

    async def outline(self, request: Request) -> Response:
        photograph, drawn = self._of(request), await json_of(request)
        work = self.worker.run("outline_of", photograph.folder, {"drawn": drawn}, brief=True)
        return await picture(request, work)

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
        return await picture(request, self.worker.run("matte_by_model", photograph.folder, {"model": name}))

    async def matte(self, request: Request) -> Response:
        photograph = self._of(request)
        identity, path = self.session.new_file(request.query_params.get("name", ""), PICTURES)
        try:
            await self.session.receive(request.stream(), path)
            name = self.session.lend(identity, photograph)
            work = self.worker.run("load_matte", photograph.folder, {"name": name}, brief=True)
            return await picture(request, work)
        finally:
            self.session.remove_file(identity)

    async def add_model(self, request: Request) -> Response:
        async def opened(identity: str, path: Path) -> dict[str, object]:
            return {"file": identity, "name": path.name}

        return await self._other(request, MODELS, opened)

    async def add_reference(self, request: Request) -> Response:
        async def opened(identity: str, path: Path) -> dict[str, object]:
            return {"file": identity}

        return await self._other(request, PICTURES, opened)

    async def person(self, request: Request) -> Response:
        """Find the people, and take one of them, or everybody."""
        photograph = self._of(request)
        person = (await json_of(request)).get("person", 1)
        if person != "everyone" and (isinstance(person, bool) or not isinstance(person, int)):
            raise Refused('person: expected a number, or "everyone"', 400)

        async def work(report: Report) -> dict[str, object]:
            answer = await self.worker.run("find_person", photograph.folder, {"person": person}, report)
            photograph.people = answer["people"]
            return answer

        return streamed(work)

    async def turn(self, request: Request) -> Response:
        """Turn a photograph by quarters, clockwise; it begins again without an outline."""
        photograph = self._of(request)
        turns = (await json_of(request)).get("turns", 1)
        if isinstance(turns, bool) or turns not in (1, 2, 3):
            raise Refused("turns: expected 1, 2 or 3", 400)
        if photograph.movie is not None:
            raise Refused("A movie cannot be turned here.")
        source, turns = photograph.source or photograph.name, (photograph.turns + turns) % 4
        arguments = {"name": source, "turns": turns}
        name = (await self.worker.run("turn", photograph.folder, arguments, brief=True))["name"]
        about = await self.worker.run("read", photograph.folder, {"name": name}, brief=True)
        photograph.source, photograph.name, photograph.turns, photograph.about = source, name, turns, about
        photograph.mask = photograph.drawn = photograph.scene = None
        photograph.people, photograph.outputs = [], {name} if turns else set()
        return JSONResponse(photograph.to_json())

    async def fetch(self, task: str, request: Request) -> Response:
        async def work(report: Report) -> dict[str, object]:
            return {**await self.worker.run(task, self.session.folder, {}, report), **_finder()}

        return streamed(work)

    async def analyse(self, request: Request) -> Response:
        photograph, asked = self._of(request), await json_of(request)
        drawn: Drawing | None = asked.get("drawn")
        if drawn is not None and not isinstance(drawn, dict):
            raise Refused("drawn: expected an object", 400)
        uses_own = photograph.about["cut_out"] and not drawn
        mask = None if uses_own else f"{photograph.stem}{MASK_SUFFIX}"
        if not uses_own and not drawn:
            raise Refused("The photograph has no outline yet: draw a line around the person.")

        async def work(report: Report) -> dict[str, object]:
            arguments = {"name": photograph.name, "mask": mask, "drawn": drawn}
            answer = await self.worker.run("analyse", photograph.folder, arguments, report)
            photograph.mask, photograph.drawn, photograph.scene = mask, drawn, answer["scene"]
            if mask is not None:
                photograph.outputs.add(mask)
            return {"photograph": photograph.to_json(), "notes": answer["notes"]}

        return streamed(work)

    # --- light

    async def pack(self, request: Request) -> Response:
        from relight.app.tasks import PACK

        return _file_answer(self._analysed(request).folder / PACK)

    async def scene(self, request: Request) -> Response:
        return JSONResponse(self._analysed(request).scene)

    async def surroundings(self, task: str, request: Request) -> Response:
        """Take an environment or a background, as the worker's task of that name opens it."""
        return await self._other(request, PICTURES, partial(self._opened, task))

    async def surroundings_again(self, task: str, request: Request) -> Response:
        identity = request.path_params["id"]
        return JSONResponse(await self._opened(task, identity, self.session.file(identity)))

    async def _opened(self, task: str, identity: str, path: Path) -> dict[str, object]:
        answer = await self.worker.run(task, path.parent, {"name": path.name}, brief=True)
        return {"file": identity, **answer}

    async def _other(
        self,
        request: Request,
        suffixes: tuple[str, ...],
        opened: Callable[[str, Path], Awaitable[dict[str, object]]],
    ) -> Response:
        """Take another file and open it; where that fails, nothing of it stays."""
        identity, path = self.session.new_file(request.query_params.get("name", ""), suffixes)
        try:
            await self.session.receive(request.stream(), path)
            return JSONResponse(await opened(identity, path))
        except BaseException:
            self.session.remove_file(identity)
            raise

    async def lit(self, task: str, request: Request) -> Response:
        """Answer with a picture of the person in the light that the page asks for."""
        photograph = self._analysed(request)
        look = self._look(await json_of(request), photograph)
        arguments = {"name": photograph.name, "mask": photograph.mask, "look": look}
        return await picture(request, self.worker.run(task, photograph.folder, arguments, brief=True))

    async def match(self, request: Request) -> Response:
        """Find the lights of the background, or of another photograph."""
        photograph, asked = self._analysed(request), await json_of(request)
        look, file = self._look(asked.get("look") or {}, photograph), asked.get("file")
        reference = None if file is None else self.session.lend(str(file), photograph)
        arguments = {"name": photograph.name, "mask": photograph.mask, "look": look, "reference": reference}
        return streamed(lambda report: self.worker.run("match", photograph.folder, arguments, report))

    async def preset_picture(self, request: Request) -> Response:
        """Answer with the person in the light of a preset, for browsers that cannot draw it themselves."""
        photograph, preset = self._analysed(request), request.path_params["preset"]
        arguments = {"name": photograph.name, "mask": photograph.mask, "preset": preset}
        work = self.worker.run("preset_picture", photograph.folder, arguments, brief=True)
        return await picture(request, work)

    async def paint(self, request: Request) -> Response:
        """Answer with the lights that strokes on the person ask for."""
        photograph, asked = self._analysed(request), await json_of(request)
        look = self._look(asked.get("look") or {}, photograph)
        arguments = {
            "name": photograph.name, "mask": photograph.mask, "look": look, "strokes": asked.get("strokes"),
        }  # fmt: skip
        return JSONResponse(await self.worker.run("paint", photograph.folder, arguments, brief=True))

    async def confidence(self, request: Request) -> Response:
        """Answer with a grey PNG: how sure the shadows of a light are, or those of all directions."""
        photograph, asked = self._analysed(request), await json_of(request)
        arguments = {"name": photograph.name, "mask": photograph.mask, "light": asked.get("light")}
        return await picture(request, self.worker.run("confidence", photograph.folder, arguments, brief=True))

    async def plot(self, request: Request) -> Response:
        """Answer with the lighting plot of the lights that the page asks for, an SVG."""
        photograph = self._analysed(request)
        look = self._look(await json_of(request), photograph)
        arguments = {"name": photograph.name, "mask": photograph.mask, "look": look}
        answer = await self.worker.run("plot", photograph.folder, arguments, brief=True)
        return _file_answer(photograph.folder / answer["file"])

    # --- files

    async def save(self, request: Request) -> Response:
        photograph, asked = self._analysed(request), await json_of(request)
        suffix = str(asked.get("suffix"))
        if suffix not in OUTPUTS:
            raise Refused(f"suffix: expected one of {', '.join(OUTPUTS)}")
        if suffix in MOVIE_OUTPUTS and photograph.movie is None:
            raise Refused(f"suffix: {suffix} is of movies, and this is a photograph")
        look = self._look(asked.get("look") or {}, photograph)
        passes = [str(name) for name in asked.get("passes") or []] if suffix == ".exr" else []
        look["plate"] = suffix == ".exr" and asked.get("plate") is True
        output = photograph.output(suffix)
        form = {key: asked[key] for key in ("quality", "longest_side") if asked.get(key) is not None}

        async def work(report: Report) -> dict[str, object]:
            arguments = {
                "name": photograph.name, "mask": photograph.mask, "look": look, "output": output,
                "passes": passes, "form": form,
            }  # fmt: skip
            answer = await self.worker.run("save", photograph.folder, arguments, report)
            photograph.outputs.add(output)
            return {"file": output, "notes": answer["notes"]}

        return streamed(work)

    async def download(self, request: Request) -> Response:
        photograph, name = self._of(request), request.path_params["name"]
        if name not in photograph.outputs:
            return Response("There is no such file.", 404)
        if name == photograph.mask:
            arguments = {"name": photograph.name, "mask": name}
            await self.worker.run("full_matte", photograph.folder, arguments, brief=True)
        disposition = f"attachment; filename*=UTF-8''{quote(name)}"
        return _file_answer(photograph.folder / name, {"Content-Disposition": disposition})

    def _analysed(self, request: Request) -> Photograph:
        photograph = self._of(request)
        if photograph.scene is None:
            raise Refused("The person has not been analysed yet.", 409)
        return photograph

    def _look(self, given: object, photograph: Photograph) -> Look:
        """Return the lights and background that a page asks for; put their files beside the photograph."""
        if not isinstance(given, dict):
            raise Refused("look: expected an object", 400)
        names = (
            "lights", "environment", "background", "floor", "exposure", "gloss", "amount", "fill", "blur",
            "backgroundLight", "placement",
        )  # fmt: skip
        look = cast(Look, {key: given.get(key) for key in names})
        look["size"] = [photograph.about["height"], photograph.about["width"]]
        if sky := given.get("environment"):
            look["environment"] = f"{self.session.lend(str(sky['file']), photograph)},{sky['settings']}"
        if isinstance(behind := given.get("background"), dict):
            look["background"] = {"file": self.session.lend(str(behind["file"]), photograph)}
        return look


def _file_answer(path: Path, headers: dict[str, str] | None = None) -> Response:
    """Answer with a file; raise Refused if something removed it, such as a program that cleans up."""
    if not path.is_file():
        raise Refused("This file is no longer here: drop the photograph again.", 404)
    return FileResponse(path, headers=headers)


def _finder() -> dict[str, str | None]:
    """Return whether people can be found and cut out, and by what.

    Each is "ready", "fetch" for what is to be fetched, or None for what is not to be had.
    """
    from relight.matting import silhouette_files
    from relight.matting.people import files as person_files

    states: dict[str, str | None] = {"finder": None, "silhouette": None}
    if find_spec("openvino") is not None:
        with contextlib.suppress(OSError):  # there is no folder for them
            for name, files_of in (("finder", person_files), ("silhouette", silhouette_files)):
                states[name] = "ready" if files_of.are_fetched() else "fetch"
    about = f"{silhouette_files.ABOUT}: {silhouette_files.LICENCE}"
    return {**states, "finder_about": person_files.ABOUT, "silhouette_about": about}


def _models() -> list[dict[str, str]]:
    """Return the models of rembg, with size and licence of each; an empty list without rembg."""
    if find_spec("rembg") is None:
        return []
    from relight.matting.networks import DOWNLOADS

    return [{"name": name, "about": about} for name, about in DOWNLOADS.items()]
