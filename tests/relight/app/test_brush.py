"""The brush of light: what the server makes of strokes, and painting in a browser."""

import numpy as np
import pytest
from helpers import browsing
from helpers.serving import lit_example, served

import relight
from relight.app.painting import painted

VIEWER = "relightApp.parts.light.viewer"
BRUSH = "relightApp.parts.light.brush"
KEY = relight.DirectionalLight(azimuth=10, elevation=20, name="key")


def stroke(x, brighter=True, radius=0.2):
    return {"points": [[x, 0.3], [x, 0.7]], "radius": radius, "brighter": brighter}


def test_strokes_become_lights_of_the_page(viewed):
    answer = painted(
        "one",
        viewed,
        [KEY],
        [stroke(0.4, radius=0.06), stroke(0.4, radius=0.06), stroke(0.62, False, 0.04)],
        0.0,
    )
    assert 1 <= len(answer["lights"]) <= 4
    assert all(
        {"azimuth", "elevation", "intensity", "colour", "angle", "name"} <= set(light)
        for light in answer["lights"]
    )
    more, less = answer["strokes"]
    assert more["asked"] > 1.4
    assert more["reached"] > 1.1
    assert less["asked"] == pytest.approx(2**-0.5, rel=0.3)
    sky = relight.EnvironmentLight(np.ones((8, 16, 3), np.float32), intensity=0.3, name="environment")
    both = painted("two", viewed, [KEY, sky], [stroke(0.5, radius=1)], 0.0)
    assert both["environment"] == pytest.approx(0.3 * 2**0.5, rel=0.1)


@pytest.mark.parametrize(
    ("strokes", "message"),
    [
        (None, "expected a list of 1 to 200"),
        ([], "expected a list of 1 to 200"),
        ([3], "expected points, a radius and brighter"),
        ([{"points": [], "radius": 0.1}], "at least one point"),
        ([{"points": [[0.5, "x"]], "radius": 0.1}], "y: expected a number"),
        ([{"points": [[0.5, 0.5]], "radius": 9}], "radius: expected a number"),
        ([stroke(0.5), stroke(0.5, False)], "cancel each other"),
        ([stroke(-0.9, radius=0.01)], "cancel each other|outside the person"),
    ],
)
def test_other_strokes_are_refused_in_one_line(viewed, strokes, message):
    with pytest.raises((TypeError, ValueError), match=message) as refused:
        painted("bad", viewed, [KEY], strokes, 0.0)
    assert "\n" not in str(refused.value)


@pytest.mark.slow
@browsing.NEEDS_CHROMIUM
def test_the_brush_moves_the_handles_and_can_be_undone(browser):
    with served() as (address, _):
        page = lit_example(browser, address)
        begun = page.evaluate(f"{VIEWER}.state.lights")
        page.get_by_role("button", name="Paint the light").click()
        box = page.locator("canvas.strokes").bounding_box()
        x, y = box["x"] + 0.47 * box["width"], box["y"] + 0.35 * box["height"]
        for _ in range(2):
            page.mouse.move(x, y)
            page.mouse.down()
            page.mouse.move(x, y + 0.3 * box["height"], steps=8)
            page.mouse.up()
        page.wait_for_function(
            f"(b) => JSON.stringify({VIEWER}.state.lights) !== JSON.stringify(b)", arg=begun
        )
        painted_lights = page.evaluate(f"{VIEWER}.state.lights")
        assert 1 <= len(painted_lights) <= 8
        page.get_by_role("button", name="Undo stroke").click()
        page.get_by_role("button", name="Undo stroke").click()
        assert page.evaluate(f"{VIEWER}.state.lights") == begun
        assert page.evaluate(f"{BRUSH}.strokes.length") == 0
        page.get_by_role("button", name="Done").click()
        assert page.locator("canvas.strokes").is_hidden()
        assert not [line for line in page.complaints if "willReadFrequently" not in line]
        page.context.close()
