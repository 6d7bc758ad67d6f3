"""The brush of the page: its light at points of the person, and the lights that strokes become."""

import numpy as np
import pytest
from helpers import browsing

import relight
from relight.media.colour import luminance

pytestmark = [pytest.mark.slow, browsing.NEEDS_CHROMIUM]
SIZE = "relight.viewer.engine.size"
VIEW = "(({ left, top, scale }) => [left, top, scale])(relight.viewer.stage.view)"
POINTS = """(direction) => {
    const { points } = relight.viewer.brush;
    return [points.places, [...points.picture([{ toward: direction, power: [1, 1, 1] }])]];
}"""


@pytest.fixture
def page(browser, page_file):
    page = browsing.opened(browser, page_file)
    page.get_by_role("button", name="Paint the light").click()
    browsing.settled(page)
    yield page
    assert not page.complaints
    page.context.close()


def stroke(page, x, brighter):
    """Paint a vertical stroke over the person, at a share of the picture's width."""
    page.get_by_role("button", name="Brighter" if brighter else "Darker").click()
    box = page.locator("canvas.strokes").bounding_box()
    left, top, scale = page.evaluate(
        "(({ left, top, scale }) => [left, top, scale])(relight.viewer.stage.view)"
    )
    width, height = page.evaluate(SIZE)
    across = box["x"] + left + x * width * scale
    down = [box["y"] + top + y * height * scale for y in (0.25, 0.6)]
    page.mouse.move(across, down[0])
    page.mouse.down()
    page.mouse.move(across, down[1], steps=3)
    page.mouse.up()
    browsing.settled(page)


def test_the_page_knows_the_light_at_points_of_the_person(page, viewed):
    for azimuth in (-60, 20, 150):
        light = relight.DirectionalLight(azimuth=azimuth, elevation=25)
        places, values = page.evaluate(POINTS, list(light.direction))
        height, width = viewed.size
        columns, rows = (np.array(places) * (width, height)).astype(int).T
        true = viewed.albedo[rows, columns] * viewed.lighting(light)[rows, columns]
        inside = viewed.matte[rows, columns] > 0.99
        error = np.abs(luminance(true) - values)[inside]
        assert error.mean() < 0.02
        assert len(values) > 500


def test_strokes_become_lights_that_do_what_they_say(page):
    begun = page.evaluate("relight.viewer.state")
    stroke(page, 0.45, True)
    stroke(page, 0.45, True)
    stroke(page, 0.62, False)
    after = page.evaluate("relight.viewer.state")
    assert 1 <= len(after["lights"]) <= 4
    assert all(light["intensity"] > 0 for light in after["lights"])
    asked = page.evaluate(
        """() => {
            const { brush } = relight.viewer;
            let answer = null;
            brush.take = (given) => (answer = given);
            brush.want();
            return new Promise((done) => requestAnimationFrame(() => {
                delete brush.take;
                done(answer.strokes);
            }));
        }"""
    )
    more, less = asked
    assert more["asked"] == pytest.approx(2, rel=0.2)
    assert more["reached"] > 1.3
    assert less["reached"] < 1
    for _ in range(3):
        page.get_by_role("button", name="Undo stroke").click()
    assert page.evaluate("relight.viewer.state.lights") == begun["lights"]
    page.get_by_role("button", name="Done").click()
    assert page.locator("canvas.strokes").is_hidden()
