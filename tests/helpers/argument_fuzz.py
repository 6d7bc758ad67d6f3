"""Calls of all public functions with one wrong argument: shared by test_arguments.py and a benchmark.

A call is answered, or refused by TypeError, ValueError or OSError, whose text is one line that names the
argument or the file. `small_canvas` makes the networks' part cheap.
"""

import warnings
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import torch

import relight
import shading
import shadow
from helpers.damage import kept_person, small_canvas
from helpers.invariants import require_usable
from relight.arguments import parameters
from relight.errors import EmptyMatteError

ALLOWED = (TypeError, ValueError, OSError)
FIELDS = {"source": "plate", "lighting": "lights", "model": "normals"}  # what a plain value is taken for
DIRECTIONS = [[0.0, 0.6, 0.8]]


class Opaque:
    """An object that nothing is known of."""


def recursive() -> list[Any]:
    """A list that holds itself."""
    several: list[Any] = []
    several.append(several)
    return several


def nested() -> Any:
    """A list in a list, and so on, deeper than Python recurses."""
    value: Any = []
    for _ in range(5000):
        value = [value]
    return value


NUMBERS = (0, 1, -1, 3, 2**70, -(2**70), 10**400, 0.5, -0.5, 1.5, float("nan"), float("inf"), 1e300, 1j)
TEXTS = ("", "x", "1", "nan", "a/b", "1/2/3", "left", "\0", "\ud800", "x" * 5000, "none.exr", b"x")
SEVERAL = ([], [1, 2], [1, "a"], (1, 2, 3), (1, 2, 3, 4), (None,), (True, False, True), {}, {"a": 1}, {1: 2})
OTHERS = (
    None,
    True,
    False,
    {1: 2, 9: 3},
    {"x"},
    Path("gone.png"),
    type,
    Opaque,
    len,
    range(3),
    Fraction(1, 3),
)
VALUES: list[Callable[[], Any]] = [
    *(lambda value=value: value for value in (*NUMBERS, *TEXTS, *SEVERAL, *OTHERS)),
    recursive, nested, Opaque, lambda: iter([]), lambda: iter([1, 2, 3]), lambda: lambda *_: None,
    lambda: np.zeros(3), lambda: np.zeros((2, 2)), lambda: np.zeros((4, 4, 3), np.float32),
    lambda: np.ones((64, 48, 4), np.uint8), lambda: np.array("a"), lambda: np.array([None]),
    lambda: np.float32(0.5), lambda: np.int64(3), lambda: np.bool_(True), lambda: np.zeros(0),
    lambda: torch.zeros(3), lambda: torch.zeros(64, 48), lambda: torch.tensor(0.5), relight.DirectionalLight,
    lambda: relight.PointLight((0, 1, 1)), lambda: relight.MovingLight(azimuth={1: 0, 9: 90}),
    lambda: relight.Floor(height=1.5),
]  # fmt: skip


class Calls:
    """The public functions, each with arguments that are right."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.photo = np.zeros((64, 48, 4), np.float32)
        self.photo[6:60, 10:38] = 0.4, 0.3, 0.2, 1
        rgb, mask = self.photo[..., :3], self.photo[..., 3]
        plate = folder / "plate.exr"
        if not plate.exists():
            relight.write(plate, self.photo)
            relight.write_lights(folder / "lights.yaml", [relight.DirectionalLight()])
        subject = relight.Subject.load(kept_person(folder))
        key = relight.DirectionalLight(azimuth=-40, name="key")
        sky = np.ones((8, 16, 3), np.float32)
        sides, floor = {"width": 1, "height": 1}, relight.Floor(height=1.5, horizon=0.4)
        out, compute = folder / "out.exr", relight.Compute(threads=1)
        shot = {"source": str(plate), "lighting": key, "output": out, "compute": compute}
        self.all: list[tuple[str, Callable[..., Any], dict[str, Any]]] = [
            ("DirectionalLight", relight.DirectionalLight, {}),
            ("PointLight", relight.PointLight, {"position": (0, 1, 1)}),
            ("RectLight", relight.RectLight, {"position": (0, 1, 1), "toward": (0, 0, 0), **sides}),
            ("EnvironmentLight", relight.EnvironmentLight, {"image": sky}),
            ("MovingLight", relight.MovingLight, {"orbit": 9, "azimuth": 3, "colour": (1, 1, 1)}),
            ("Floor", relight.Floor, {"height": 1.5}),
            ("Source", relight.Source, {"plate": str(plate)}),
            ("Lighting", relight.Lighting, {"lights": key}),
            ("Output", relight.Output, {"paths": out}),
            ("Compute", relight.Compute, {}),
            ("apply", relight.apply, {"image": self.photo, "lights": key}),
            ("render", relight.render, {"image": self.photo, "lights": key}),
            ("Subject", relight.Subject, {"image": self.photo}),
            ("Subject.relit", subject.relit, {"lights": key}),
            ("Subject.layers", subject.layers, {"lights": key}),
            ("Subject.shadows", subject.shadows, {"lights": key, "floor": floor}),
            ("Subject.preset", subject.preset, {"name": "rim"}),
            ("Subject.visibility", subject.visibility, {"directions": DIRECTIONS}),
            ("Subject.shading", subject.shading, {"directions": DIRECTIONS}),
            ("Subject.lighting", subject.lighting, {"lights": key}),
            ("Subject.save", subject.save, {"path": folder / "kept.safetensors"}),
            ("Subject.load", relight.Subject.load, {"path": kept_person(folder)}),
            ("Subject.view", subject.view, {"path": folder / "page.html", "lights": key}),
            ("Subject.export", subject.export, {"path": folder / "person.glb"}),
            ("Subject.fit_lighting", subject.fit_lighting, {"image": np.zeros((24, 20, 3), np.float32)}),
            ("over", relight.over, {"foreground": self.photo, "background": (0.1, 0.1, 0.1)}),
            ("place", relight.place, {"image": self.photo, "size": (32, 32)}),
            ("presets", relight.presets, {}),
            ("read", relight.read, {"path": plate}),
            ("read_mask", relight.read_mask, {"path": plate}),
            ("read_layers", relight.read_layers, {"path": plate}),
            ("read_normals", relight.read_normals, {"path": plate}),
            ("read_lights", relight.read_lights, {"path": folder / "lights.yaml"}),
            ("write", relight.write, {"path": out, "image": self.photo}),
            ("write_mask", relight.write_mask, {"path": folder / "mask.png", "mask": mask}),
            ("write_lights", relight.write_lights, {"path": folder / "written.yaml", "lights": [key]}),
            ("match", relight.match, {"subject": subject, "reference": self.photo}),
            ("render_shot", relight.render_shot, shot),
            ("write_job", relight.write_job, {"path": folder / "job.json", **shot}),
            ("analyse_shot", relight.analyse_shot, {"source": str(plate), "output": folder / "shot.relight"}),
            ("write_olat", relight.write_olat, {"source": str(plate), "output": folder / "olat.exr"}),
            ("write_view", relight.write_view, {"output": folder / "shot.html", "source": str(plate)}),
            ("export_person", relight.export_person, {"output": folder / "shot.glb", "source": str(plate)}),
            ("shadow.infer", shadow.infer, {"rgb": rgb, "mask": mask, "directions": DIRECTIONS}),
            ("shadow.analyse", shadow.analyse, {"rgb": rgb, "mask": mask}),
            ("shadow.infer_normals", shadow.infer_normals, {"rgb": rgb, "mask": mask}),
            ("shadow.baseline", shadow.baseline, {"normals": rgb, "directions": DIRECTIONS}),
            ("shading.infer", shading.infer, {"rgb": rgb, "mask": mask, "directions": DIRECTIONS}),
            ("shading.analyse", shading.analyse, {"rgb": rgb, "mask": mask}),
            ("shading.infer_albedo", shading.infer_albedo, {"rgb": rgb, "mask": mask}),
        ]  # fmt: skip

    def attempt(self, random: Random) -> str | None:
        """Try one call; return what is wrong with its answer."""
        name, function, right = random.choice(self.all)
        known = [each for each in parameters(function) if each not in ("progress", "compute")]
        argument = random.choice(known if random.random() < 0.97 else ["color", "speed"])
        value = random.choice(VALUES)()
        if argument in ("normals", "model") and callable(value):
            return None  # the caller's own network
        call = f"{name}({argument}={_short(value)})"
        with warnings.catch_warnings(), np.errstate(all="ignore"), small_canvas():
            warnings.simplefilter("ignore")
            try:
                function(**right | {argument: value})
            except ALLOWED as error:
                try:
                    require_usable(str(error))
                except AssertionError as violation:
                    return f"{call}: {violation}"
                words = [argument, *(right if hasattr(value, "shape") or hasattr(value, "rays") else ())]
                words += [FIELDS.get(argument, argument)]
                words += [str(value), repr(value)[1:-1]] if isinstance(value, str | Path) else []
                named = isinstance(error, OSError | EmptyMatteError) or any(
                    word in str(error) for word in words
                )
                return None if named else f"{call}: {type(error).__name__}: {str(error)[:150]}"
            except Exception as error:
                return f"{call}: {type(error).__name__}: {str(error)[:150]}"
        return None


def _short(value: Any) -> str:
    try:
        return " ".join(repr(value)[:60].split())
    except (RecursionError, ValueError):
        return type(value).__name__
