"""Hostile requests to the app, and hostile files and drawings for its worker, in one process.

A kind of hostile inputs, as `fuzzing` describes them.
"""

import asyncio
import json
import os
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from PIL import Image
from starlette.applications import Starlette
from starlette.routing import Mount

from helpers import hostile
from helpers.damage import SMALL_CANVAS, small_canvas
from helpers.invariants import require
from relight.app import tasks, worker
from relight.app.server import Server
from relight.app.session import Session

# They need a network, or seconds.
UNASKED = (
    "fetch_person",
    "fetch_silhouette",
    "find_person",
    "matte_by_model",
    "analyse",
    "match",
    "preset_picture",
)
VALUES: list[Any] = [
    None, True, 0, -1, 1e300, float("nan"), "", "x", "a" * 3000, "\ud800", "../../etc/passwd", [], {}, [[]],
    [1, 2], [[0.1, 0.2], [0.9, 0.1], [0.5, 0.9]], {"file": 3}, {"file": "x", "settings": "rotation=3"},
    "original",
]  # fmt: skip

OF_ONE = (
    *("", "/outline", "/model", "/matte", "/analyse", "/still", "/save", "/back", "/files/x", "/preview"),
    *("/paint", "/confidence", "/plot", "/scene", "/pack", "/person"),
    *("/match", "/turn", "/presets/rim"),
)  # fmt: skip
OTHERS = (
    *("photographs", "root", "environments", "backgrounds", "models", "session", "web/page.css"),
    "nowhere",
)  # fmt: skip


class InProcess:
    """A worker without a process: what a task answers, and nothing that is a defect."""

    async def run(
        self, task: str, folder: Path, arguments: Any, report: Any = None, *, brief: bool = False
    ) -> Any:
        if task in UNASKED:
            raise worker.Refused("is not asked here")
        before, place, given = os.getcwd(), tasks, dict(arguments)
        if task in ("still", "save", "paint", "plot"):  # no picture is made, but its light is read
            place, task, given = _Looks, "lighting", {"look": given["look"]}
        elif task == "confidence":
            place, task, given = _Looks, "lighting", {"look": {"lights": [given["light"]]}}
        try:
            kind, value = worker.answer_to(place, task, str(folder), given, _Wire())
        finally:
            os.chdir(before)
        if kind == "done":
            return value
        require(value != worker.DEFECT, f"{task}: a defect")
        require(value.strip() and "\n" not in value and str(folder) not in value, f"{task}: {value!r}")
        raise worker.Refused(value)


class _Looks:
    @staticmethod
    def lighting(look: Any, report: Any) -> dict[str, Any]:
        """Read the lights, the background and the exposure of a look."""
        lighting, _ = tasks.lighting_of(look), tasks.exposure_of(look)
        lighting.rig()
        return {"png": b"", "output": "", "file": ""}


class _Wire:
    def send(self, what: Any) -> None:
        """Progress is not looked at."""


def app_request(random: Random, folder: Path) -> None:
    """A few requests to one session, each an endpoint with a body that hardly fits."""
    before = os.getcwd()
    session = Session(folder)
    try:
        server = Server(session, InProcess())
        routes = Starlette(routes=[Mount("/t", routes=server.routes())])
        photograph = session.new_photograph("person.png")
        with Image.new("RGBA", (24, 32), (120, 90, 70, 255)) as picture:
            picture.putpixel((0, 0), (0, 0, 0, 0))
            picture.save(photograph.folder / photograph.name)
        np.save(photograph.folder / tasks.REDUCED, np.zeros((32, 24, 3), np.float16))
        photograph.about = {
            "cut_out": random.random() < 0.5,
            "preview": "none.png",
            "width": 24,
            "height": 32,
        }
        photograph.scene = random.choice([None, {}])
        identity, path = session.new_file("sky.png", (".png",))
        path.write_bytes((photograph.folder / photograph.name).read_bytes())
        for _ in range(4):
            with small_canvas(SMALL_CANVAS):
                _ask(random, routes, photograph.id, identity)
    finally:
        session.close()
        os.chdir(before)


def _ask(random: Random, routes: Starlette, photograph: str, file: str) -> None:
    place = random.choice([*(f"photographs/{{id}}{name}" for name in OF_ONE), *OTHERS, f"backgrounds/{file}"])
    asked = random.choice([photograph] * 8 + ["x", "%00", "..", "%2e%2e%2fx"])
    place = place.replace("{id}", asked)
    uploads = place in ("photographs", "environments", "backgrounds", "models") or place.endswith("matte")
    name = random.choice(
        ["a.png", "a.exr", "a.onnx", "a.hdr", "a.jpg", "", "..", "x" * 300 + ".png", "%d.png", "[b].tif"]
    )
    body = _file(random, name) if uploads else _json(random, file)
    method = random.choice(["GET", "POST", "POST", "POST", "POST", "DELETE"])
    status = asyncio.run(_status(routes, method, f"/t/{place}", f"name={name}".encode(), body))
    require(status < 500 or status == 507, f"{method} {place}: {status}")


def _file(random: Random, name: str) -> bytes:
    suffix = Path(name).suffix.lower()
    codes = np.zeros((20, 16, 3), np.uint8)
    import io

    file = io.BytesIO()
    Image.fromarray(codes).save(file, "JPEG" if suffix == ".jpg" else "PNG")
    content = file.getvalue()
    return (
        hostile.damaged(random, content)
        if random.random() < 0.7
        else random.choice([b"", b"\0" * 100, content])
    )


def _json(random: Random, file: str) -> bytes:
    """A body: what the page sends, with values exchanged, or no JSON."""
    look = {
        "lights": ["key:azimuth=40"], "environment": {"file": file, "settings": "rotation=20"}, "gloss": 0.2,
        "background": [0.1, 0.1, 0.1], "exposure": 0.5,
    }  # fmt: skip
    drawn = {
        "lasso": [[0.2, 0.1], [0.8, 0.1], [0.5, 0.9]], "holes": [], "shift": 0, "feather": 0,
        "strokes": [{"person": True, "points": [[0.5, 0.5], [0.6, 0.6]], "radius": 0.02}],
    }  # fmt: skip
    body: dict[str, Any] = {
        **look, **drawn, "drawn": drawn, "look": look, "suffix": ".png", "passes": ["N"], "path": "a.png",
        "name": "x",
    }  # fmt: skip
    for _ in range(random.randrange(4)):
        branch: Any = body
        for _ in range(random.randrange(3)):
            below = [value for value in branch.values() if isinstance(value, dict) and value]
            branch = random.choice(below) if below else branch
        branch[random.choice([*branch])] = random.choice(VALUES)
    content = json.dumps(body).encode("utf-8", "surrogatepass")
    if random.random() < 0.15:
        content = hostile.damaged(random, content)
    return content


async def _status(routes: Starlette, method: str, path: str, query: bytes, body: bytes) -> int:
    parts = [{"type": "http.request", "body": body, "more_body": False}]
    found: list[int] = []

    async def receive() -> Any:
        if parts:
            return parts.pop()
        await asyncio.sleep(3600)  # the page stays

    async def send(message: Any) -> None:
        if message["type"] == "http.response.start":
            found.append(message["status"])

    scope = {
        "type": "http", "method": method, "path": path.replace("%00", "\0"), "raw_path": path.encode(),
        "query_string": query.replace(b"%d", b"%25d"), "root_path": "", "scheme": "http", "headers": [],
        "server": ("x", 80), "client": ("x", 1), "http_version": "1.1",
    }  # fmt: skip
    await routes(scope, receive, send)
    return found[0]
