"""Mattes of the reduced copy of a photograph, from what the page draws and shifts."""

import functools
import json
import os
import re

import numpy as np

from relight.app.messages import Drawing, Points
from relight.matting import outline, silhouette
from relight.matting.refine import encoded_srgb

REDUCED, MODEL = "reduced.npy", "model.npy"  # the copy, and the matte that a network found on it
FILE = "file"  # in place of a model: the matte is that of a file
FOUND, SOLVED = "found", "solved"  # other kinds of edges than that of a file, see `edge_kind`
PERSON = re.compile(r"person-\d{1,3}|everyone")  # a matte of who was found, which has a file of its own
EDGE_SIDE = 0.05  # of the picture's longer side, that an edge may be shifted or blurred by, at most


def reduced() -> np.ndarray:
    """Return the reduced copy of the photograph in the working folder."""
    return np.load(REDUCED).astype(np.float32)


def matte_file(model: object) -> str:
    """Return the file of the matte that a drawing begins with; `model` is the drawing's."""
    return f"{model}.npy" if isinstance(model, str) and PERSON.fullmatch(model) else MODEL


def forget() -> None:
    """Forget the solved drawing, since the network found another matte."""
    _solve.cache_clear()
    _found_within.cache_clear()


def solved(drawn: Drawing) -> np.ndarray:
    """Return the matte of the reduced copy that was drawn; an outline that is accepted is not solved again.

    Positions are fractions of width and height.
    """
    lines = {key: value for key, value in drawn.items() if key not in ("shift", "feather")}
    return _solve(os.getcwd(), json.dumps(lines, sort_keys=True))


def edge_of(drawn: Drawing) -> tuple[float, float]:
    """Return by how much the edge is to be shifted and blurred, as shares of the picture's longer side."""
    shift, feather = float(drawn.get("shift") or 0), float(drawn.get("feather") or 0)
    if not (abs(shift) <= EDGE_SIDE and 0 <= feather <= EDGE_SIDE):
        raise ValueError(f"edge: expected shares of up to {EDGE_SIDE}, got {shift} and {feather}")
    return shift, feather


def shifted(matte: np.ndarray, shift: float, feather: float = 0.0) -> np.ndarray:
    """Return a matte (h, w) with its edge moved and blurred by shares of its longer side.

    `Subject(feather=)` blurs it after the analysis.
    """
    side = max(matte.shape)
    return outline.shift_edge(matte, shift * side, feather * side)


def is_drawn(drawn: Drawing) -> bool:
    """Return whether a drawing has lines or strokes, and is not a matte as it was found or loaded."""
    return any(drawn.get(key) for key in ("lasso", "strokes", "holes"))


def edge_kind(drawn: Drawing) -> str:
    """Return where the edge of a drawing's matte comes from: a file, a network, or lines that are solved."""
    if drawn.get("model") == FILE and not is_drawn(drawn):
        return FILE
    return FOUND if drawn.get("model") or silhouette.load() else SOLVED


@functools.lru_cache(maxsize=1)
def _solve(folder: str, drawing: str) -> np.ndarray:
    """Solve what was drawn, as JSON, for the matte of the reduced copy.

    The copy is in `folder`, the working folder, which is named because the result is kept.
    """
    drawn = json.loads(drawing)
    try:
        return _meant(drawn, reduced())
    except (AttributeError, KeyError, OverflowError, TypeError) as error:
        raise ValueError("drawn: expected an outline as the page draws it") from error


def _meant(drawn: Drawing, picture: np.ndarray) -> np.ndarray:
    """Return the matte (h, w) that a drawing means on the reduced copy."""
    height, width = picture.shape[:2]
    scale = np.array([width, height], float)

    def places(points: Points) -> np.ndarray:
        relative = np.reshape(np.asarray(points, float), (-1, 2))
        return relative.clip(-4, 5) * scale

    strokes = [
        outline.Stroke(bool(stroke["person"]), places(stroke["points"]), float(stroke["radius"]) * width)
        for stroke in drawn.get("strokes") or []
    ]
    lasso = drawn.get("lasso") or None
    holes = [places(points) for points in drawn.get("holes") or []]
    rough = None
    if drawn.get("model"):
        rough = np.load(matte_file(drawn["model"])).astype(np.float32)
    elif picture.shape[-1] == 4:
        rough = picture[..., 3]
    if rough is not None and not is_drawn(drawn):
        return rough
    found = None if rough is not None or lasso is None else _found_within(os.getcwd(), json.dumps(lasso))
    meant = outline.Outline(
        None if lasso is None else places(lasso),
        strokes,
        rough if found is None else found,
        holes,
        tolerance=None if rough is None and found is None else 0,
    )
    return outline.outlined(picture[..., :3], meant)


@functools.lru_cache(maxsize=1)
def _found_within(folder: str, lasso: str) -> np.ndarray | None:
    """Return the matte of what a network finds within a line, as JSON; None without a network.

    `folder` is named because the result is kept while strokes are drawn.
    """
    network, points = silhouette.load(), np.reshape(np.asarray(json.loads(lasso), float), (-1, 2))
    if network is None or len(points) < 3 or not np.isfinite(points).all():  # which `outlined` refuses
        return None
    picture = reduced()[..., :3]
    points = points.clip(-4, 5) * picture.shape[1::-1]
    inside = outline.inside_of(points, picture.shape[:2])
    return silhouette.matte_within(encoded_srgb(picture), inside, network)
