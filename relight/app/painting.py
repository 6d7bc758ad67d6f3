"""Strokes of light that a page's brush draws on a person, as lights that the page shows."""

from collections import OrderedDict
from collections.abc import Iterable, Mapping

import numpy as np
from PIL import Image, ImageDraw

from relight.arguments import checked_number
from relight.light_painting import COUNT, LightPainter
from relight.lights.environment import EnvironmentLight
from relight.lights.light import Light
from relight.subject import Subject
from relight.viewer.constants import MAX_LIGHTS
from relight.viewer.initial_state import parameters_of

STOPS = 0.5  # by which a stroke makes the light brighter or darker; strokes over each other add up
MOST_STROKES, MOST_POINTS = 200, 5000
MOST_STOPS = 4.0
KEPT = 2  # painters, of the light with which painting began

_painters: OrderedDict[str, tuple[Subject, LightPainter]] = OrderedDict()


def painted(
    began: str, subject: Subject, lights: list[Light], strokes: object, gloss: float
) -> dict[str, object]:
    """Return the lights that strokes ask for, as the page has them, and how near they came.

    `began` tells the light with which painting began from others. `strokes`: mappings of `points`, shares of
    the picture's width and height, `radius`, a share of its height, and `brighter`. Raises TypeError or
    ValueError for other strokes, and as `paint_lights` does.
    """
    person, painter = _painters.pop(began, (None, None))
    if painter is None or person is not subject:
        painter = LightPainter(subject, lights, gloss=gloss, reduced=True)
    pairs = _pairs(strokes, painter.size)
    _painters[began] = subject, painter
    while len(_painters) > KEPT:
        _painters.popitem(last=False)
    lamps = [light for light in lights if not isinstance(light, EnvironmentLight)]
    count = min(MAX_LIGHTS, max(COUNT, len(lamps))) + (len(lights) - len(lamps))
    found = painter.solve(pairs, count)
    skies = [light for light in found.lights if isinstance(light, EnvironmentLight)]
    shown = [light for light in found.lights if not isinstance(light, EnvironmentLight)][:MAX_LIGHTS]
    return {
        "lights": [parameters_of(light) for light in shown],  # type: ignore[arg-type]  # what the page sent
        "environment": skies[0].intensity if skies else 0.0,
        "strokes": [{"asked": each.asked, "reached": each.reached} for each in found.strokes],
    }


def _pairs(strokes: object, size: tuple[int, int]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return masks and factors: of what is brighter, and of what is darker."""
    if not isinstance(strokes, list) or not 1 <= len(strokes) <= MOST_STROKES:
        raise ValueError(f"strokes: expected a list of 1 to {MOST_STROKES}")
    stops = np.zeros(size, np.float32)
    for stroke in strokes:
        if not isinstance(stroke, Mapping) or not isinstance(stroke.get("points"), list):
            raise ValueError("strokes: expected points, a radius and brighter")
        mask = _drawn(stroke["points"], checked_number("radius", stroke.get("radius"), 0.001, 1), size)
        stops += np.where(mask, STOPS if stroke.get("brighter") is True else -STOPS, 0)
    factors = 2.0 ** stops.clip(-MOST_STOPS, MOST_STOPS)
    masks = [(stops > 0).astype(np.float32), (stops < 0).astype(np.float32)]
    pairs = [(mask, factors) for mask in masks if mask.any()]
    if not pairs:
        raise ValueError("strokes: cancel each other; expected light that is brighter or darker somewhere")
    return pairs


def _drawn(points: Iterable[Iterable[float]], radius: float, size: tuple[int, int]) -> np.ndarray:
    """Return where a stroke is (H, W), bool."""
    height, width = size
    places = [
        (checked_number("x", x, -1, 2) * width, checked_number("y", y, -1, 2) * height)
        for x, y in list(points)[:MOST_POINTS]
    ]
    if not places:
        raise ValueError("strokes: expected at least one point")
    wide = max(1.0, radius * height)
    canvas = Image.new("1", (width, height))
    draw = ImageDraw.Draw(canvas)
    draw.line(places, fill=1, width=max(1, round(2 * wide)), joint="curve")
    for x, y in (places[0], places[-1]):
        draw.ellipse((x - wide, y - wide, x + wide, y + wide), fill=1)
    return np.asarray(canvas)
