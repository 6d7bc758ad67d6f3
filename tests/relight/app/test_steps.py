"""The application's four steps by keyboard alone, at the widths of phones, and in every surround."""

import numpy as np
import pytest
from helpers import browsing
from helpers.serving import LIT, OUTLINED, at_step, chosen, served, visited
from PIL import Image

pytestmark = [pytest.mark.slow, browsing.NEEDS_CHROMIUM]
STEPS = ("drop", "outline", "light", "save")
SHOWN = "main > section:not([hidden]) *, .bar *"
WIDER = """([shown, width]) => [...document.querySelectorAll(shown)].filter((one) => {
    for (let up = one.parentElement; up; up = up.parentElement) {
        if (/auto|hidden|scroll/.test(getComputedStyle(up).overflowX)) return false; // it scrolls there
    }
    return one.checkVisibility() && one.getBoundingClientRect().right > width + 1;
}).map((one) => one.outerHTML.slice(0, 120))"""


@pytest.fixture(scope="module")
def address():
    with served() as (found, _):
        yield found


def focused(page):
    return page.evaluate(
        "document.activeElement.getAttribute('aria-label') ?? document.activeElement.textContent"
    )


def tab_to(page, name):
    """Press Tab until an element of this name has the focus, which can be seen."""
    for _ in range(80):
        page.keyboard.press("Tab")
        if focused(page).strip() == name:
            assert page.evaluate(
                "((style) => style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) >= 2)"
                "(getComputedStyle(document.activeElement))"
            ), f"the focus on {name} cannot be seen"
            return
    raise AssertionError(f"no {name} on the way of the Tab key")


def test_all_four_steps_by_keyboard(browser, address, tmp_path):
    codes = np.full((240, 200, 3), (40, 90, 60), np.uint8)
    codes[40:200, 60:140] = (200, 60, 40)
    Image.fromarray(codes).save(tmp_path / "me.png")
    page = visited(browser, address)
    tab_to(page, "Try the example")
    chosen(page, tmp_path / "me.png")  # what the system's own dialogue answers
    at_step(page, "outline")
    browsing.wait(page, "Boolean(relightApp.parts.outline.image)")
    assert focused(page).startswith("The photograph.")
    for keys in (
        ["ArrowLeft"] * 5 + ["ArrowUp"] * 8,
        ["ArrowRight"] * 10,
        ["ArrowDown"] * 16,
        ["ArrowLeft"] * 10,
    ):
        for key in keys:
            page.keyboard.press(f"Shift+{key}")
        page.keyboard.press("Enter")
    page.keyboard.press("c")
    browsing.wait(page, OUTLINED, 120)
    tab_to(page, "Use this outline")
    page.keyboard.press("Enter")
    at_step(page, "light")
    browsing.wait(page, LIT, 120)
    before = page.evaluate("relightApp.parts.light.viewer.state.lights[0].azimuth")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("relightApp.parts.light.viewer.state.lights[0].azimuth") == before + 1
    tab_to(page, "Save files…")
    page.keyboard.press("Enter")
    at_step(page, "save")
    tab_to(page, "Save PNG")
    with page.expect_download(timeout=240_000) as download:
        page.keyboard.press("Enter")
    assert download.value.suggested_filename == "me-relit.png"
    assert not page.complaints
    page.context.close()


def test_each_step_fits_phones_and_can_be_read_in_every_surround(browser, address):
    page = visited(browser, address, size=(390, 844), has_touch=True, is_mobile=True)
    page.get_by_role("button", name="Try the example").tap()
    at_step(page, "light")
    browsing.wait(page, LIT, 120)
    page.evaluate("relightApp.progress.showModal()")
    assert browsing.moving(page) == []
    page.evaluate("relightApp.progress.close()")
    page.evaluate("relightApp.parts.light.viewer.play()")
    page.evaluate("relightApp.go('drop')")
    assert page.evaluate("relightApp.parts.light.viewer.playing") is None  # no orbit goes on out of sight
    for step in STEPS:
        page.evaluate(f"relightApp.go('{step}')")
        at_step(page, step)
        for width, height in ((390, 844), (320, 568), (844, 390)):
            page.set_viewport_size({"width": width, "height": height})
            browsing.settled(page)
            assert page.evaluate(WIDER, [SHOWN, width]) == []
            assert page.evaluate("document.documentElement.scrollWidth") <= width
        for name in ("dark", "grey", "light"):
            page.evaluate(f"relightApp.parts.light.viewer.setSurround('{name}')")
            browsing.settled(page)
            assert browsing.low_contrast(page) == []
    assert not page.complaints
    page.context.close()


def test_photographs_stay_at_hand_when_the_chosen_one_goes(browser, address, tmp_path):
    for name in ("one.png", "two.png"):
        Image.fromarray(np.full((80, 60, 3), 90, np.uint8)).save(tmp_path / name)
    page = visited(browser, address, size=(390, 844), has_touch=True, is_mobile=True)
    chosen(page, tmp_path / "one.png", tmp_path / "two.png")
    browsing.wait(page, "relightApp.photographs.length >= 2 && Boolean(relightApp.chosen)")
    at_step(page, "outline")
    # Without a mouse, only the chosen one shows what removes it.
    shown = (
        "[...document.querySelectorAll('.strip .icon')]"
        ".map((one) => one.checkVisibility({ visibilityProperty: true }))"
    )
    chosen_one = "relightApp.photographs.map((one) => one === relightApp.chosen)"
    assert page.evaluate(shown) == page.evaluate(chosen_one)
    while page.evaluate("relightApp.photographs.length") > 1:
        page.evaluate("relightApp.remove(relightApp.chosen ?? relightApp.photographs[0])")
        browsing.settled(page)
    assert page.evaluate("relightApp.chosen") is None
    assert page.locator(".strip .thumb").count() == 1
    page.locator(".strip .thumb").tap()
    at_step(page, "outline")
    page.context.close()
