"""The lighting plot and the confidence over the picture: what the worker makes, and both in a browser."""

import io

import numpy as np
import pytest
from helpers import ROOT, browsing
from helpers.serving import lit_example, served
from PIL import Image

import relight
from relight.app import tasks

CONFIDENCE = "relightApp.parts.light.confidence"
COLOURS = f"""() => {{
    const {{ canvas }} = {CONFIDENCE};
    const {{ data }} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    return [canvas.height, canvas.width, Array.from(data)];
}}"""


def silent(what, share=None):
    """Take a report of progress."""


@pytest.fixture
def kept(viewed, here):
    """A photograph in the working folder that has been analysed."""
    (here / tasks.PREVIEWS).mkdir()
    tasks.keep("me.png", viewed)
    yield viewed
    tasks.subjects.clear()


@pytest.mark.parametrize("azimuth", [None, -60])
def test_the_page_gets_the_confidence_in_codes(kept, azimuth):
    light = None if azimuth is None else f"key:azimuth={azimuth}"
    codes = np.asarray(Image.open(io.BytesIO(tasks.confidence("me.png", None, light, silent)["png"])))
    of = None if azimuth is None else relight.DirectionalLight(azimuth=azimuth)
    np.testing.assert_allclose(codes / 255, kept.confidence(of), atol=0.003)


def test_the_plot_shows_the_lights_of_the_page(kept):
    look = {"lights": ["key:azimuth=-40", "lamp:position=1/0.5/1,intensity=2"]}
    text = (tasks.Path(tasks.plot("me.png", None, look, silent)["file"])).read_text()
    assert text.startswith("<?xml")
    assert all(f">{word}</text>" in text for word in ("me.png", "key", "lamp", "40° left, 0° up"))


@pytest.mark.slow
@browsing.NEEDS_CHROMIUM
def test_confidence_lies_over_the_picture_and_the_plot_is_shown_and_printed(browser):
    with served() as (address, _):
        page = lit_example(browser, address)
        switch = page.get_by_role("button", name="Confidence")
        switch.click()
        browsing.wait(page, f"!{CONFIDENCE}.canvas.hidden")
        height, width, data = page.evaluate(COLOURS)
        opacity = np.reshape(data, (height, width, 4))[..., 3]
        matte = np.asarray(Image.open(ROOT / "examples" / "person.png").resize((width, height)))[..., 3]
        assert (opacity[matte == 0] == 0).mean() > 0.99
        assert (opacity[matte == 255] > 0).mean() > 0.99
        page.get_by_label("Shadows of").select_option("key")
        browsing.wait(page, f"{CONFIDENCE}.latest.wanted.includes('azimuth=-40')")
        switch.click()
        assert page.evaluate(f"{CONFIDENCE}.canvas.hidden")

        page.get_by_role("button", name="Lighting plot").click()
        drawing = page.locator("dialog.plot img")
        drawing.wait_for()
        assert drawing.evaluate("image => image.naturalWidth") > 800
        assert not browsing.low_contrast(page)
        with page.expect_download() as download:
            page.get_by_role("link", name="Save SVG").click()
        assert "key" in download.value.path().read_text()
        page.evaluate("window.print = () => (window.printed = true)")
        page.get_by_role("button", name="Print").click()
        assert page.evaluate("window.printed")
        page.emulate_media(media="print")
        assert drawing.is_visible()
        assert page.get_by_role("button", name="Print").is_hidden()
        assert page.locator("main").is_hidden()
        assert not page.complaints
        page.context.close()
