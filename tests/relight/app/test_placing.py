"""A person who stands elsewhere before a new background: in the server's pictures, and in the page."""

import io

import numpy as np
import pytest
from helpers import ROOT, browsing
from helpers.serving import LIT, at_step, chosen, saved_picture, served, visited
from PIL import Image

import relight
from relight.app import tasks

LOOK = {
    "lights": ["key:azimuth=-40,elevation=30"], "background": [0.1, 0.1, 0.1], "size": [240, 160],
    "placement": {"scale": 0.5, "offset": [30, -20]},
}  # fmt: skip
VIEWER = "relightApp.parts.light.viewer"


def silent(what, share=None):
    """Take a report of progress."""


@pytest.fixture
def photograph(here, monkeypatch):
    """Somebody in the middle of a photograph of 240 x 160 pixels, whose reduced copy is half as large."""
    codes = np.zeros((240, 160, 4), np.uint8)
    codes[60:180, 50:110] = (180, 140, 120, 255)
    Image.fromarray(codes).save("me.png")
    monkeypatch.setattr(tasks, "PREVIEW_SIDE", 120)
    tasks.subjects.clear()
    tasks.read("me.png", silent)


def box(picture):
    """Left, top, right and bottom of what is not the background."""
    rows, columns = np.nonzero(np.abs(picture[..., :3].astype(int) - picture[0, 0, :3]).max(axis=-1) > 12)
    return columns.min(), rows.min(), columns.max() + 1, rows.max() + 1


def test_still_and_file_show_them_where_the_command_puts_them(photograph):
    still = np.asarray(Image.open(io.BytesIO(tasks.still("me.png", None, LOOK, silent)["png"])))
    np.testing.assert_allclose(box(still), np.array([95, 110, 125, 170]) / 2, atol=2)
    tasks.save("me.png", None, LOOK, "me-relit.png", [], silent)
    saved = np.asarray(Image.open("me-relit.png"))
    np.testing.assert_allclose(box(saved), (95, 110, 125, 170), atol=2)
    tasks.save("me.png", None, {**LOOK, "placement": None}, "me-relit.png", [], silent)
    back = np.asarray(Image.open("me-relit.png"))  # the analysis that was kept is of another place
    np.testing.assert_allclose(box(back), (50, 60, 110, 180), atol=2)


@pytest.mark.slow
@browsing.NEEDS_CHROMIUM
def test_the_page_puts_them_where_the_file_has_them(browser, tmp_path):
    person = np.asarray(Image.open(ROOT / "examples" / "person.png"))[::2, ::2]
    Image.fromarray(person).save(tmp_path / "me.png")
    with served() as (address, _):
        page = visited(browser, address)
        chosen(page, tmp_path / "me.png")
        at_step(page, "light")
        browsing.wait(page, LIT, 240)
        page.evaluate(f"{VIEWER}.setBackgroundKind('colour')")
        for label, value in (("Size", "0.6"), ("Move right", "0.15"), ("Move up", "-0.1")):
            page.get_by_label(f"{label}, exactly").fill(value)
            page.get_by_label(f"{label}, exactly").press("Enter")
        browsing.settled(page)
        data = page.evaluate(
            f"""() => {{ {VIEWER}.redraw();
                const {{ width, height, data }} = {VIEWER}.engine.readShown("picture",
                    {{ exposure: 0, background: {VIEWER}.shownBackground() }});
                return [height, width, ...data]; }}"""
        )
        shown = np.array(data[2:], int).reshape(data[0], data[1], 4)
        saved = saved_picture(page, tmp_path / "saved.png")
        assert shown.shape[:2] == saved.shape[:2]
        np.testing.assert_allclose(box(shown), box(saved), atol=2)
        command = page.evaluate(
            "relightApp.go('save').then(() => relightApp.parts.save.command.text.textContent)"
        )
        assert (
            f"--scale 0.6 --offset {round(0.15 * shown.shape[1])}/{-round(0.1 * shown.shape[0])}" in command
        )
        assert np.abs(shown[..., :3] - saved[..., :3]).mean() < 4
        assert relight.read(tmp_path / "saved.png").shape[:2] == shown.shape[:2]
        page.context.close()
