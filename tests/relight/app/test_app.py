"""The application in a browser, as a person uses it: drop, outline, light, save."""

import io
import os
import shlex
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT, browsing
from helpers.drawn import photographed, polygon
from helpers.finders import discs, small_finder
from helpers.onnx_models import channel
from helpers.serving import (
    LIT,
    OUTLINED,
    at_step,
    chosen,
    dropped,
    lasso,
    saved_picture,
    served,
    visited,
)
from PIL import Image
from typer.testing import CliRunner

import relight
from relight.cli.commands import app as command_line
from shadow.data.records import Records

pytestmark = [pytest.mark.slow, browsing.NEEDS_CHROMIUM]
SETTLED = """(({ picture, latest }) => picture && !latest.asking && latest.made === latest.wanted)(
    relightApp.parts.light.viewer.engine)"""

COVERED = """(({ greys }) => { // the share of the photograph that the matte covers
    const canvas = new OffscreenCanvas(greys.width, greys.height);
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(greys, 0, 0);
    const { data } = context.getImageData(0, 0, greys.width, greys.height);
    let sum = 0;
    for (let at = 0; at < data.length; at += 4) sum += data[at];
    return sum / 255 / (data.length / 4);
})(relightApp.parts.outline)"""
DRAWN = """[...document.querySelectorAll(".preset canvas")].every(
    (one) => one.getContext("2d").getImageData(64, 100, 1, 1).data[3] === 255)"""


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    """A photograph, .jpg, and a line around the person: places as shares of its width and height."""
    from skimage import data

    image, matte = photographed(Records([ROOT / "tests" / "data"])[1], data.coffee(), 1, height=320)
    path = tmp_path_factory.mktemp("photo") / "me.jpg"
    Image.fromarray(image).save(path, quality=95)
    return path, polygon(matte, 1) / 320


@pytest.fixture(scope="module")
def address(tmp_path_factory, photo):
    root = tmp_path_factory.mktemp("root")
    (root / "sub").mkdir()
    (root / "sub" / "me.jpg").write_bytes(photo[0].read_bytes())
    with served("--root", root) as (found, _):
        yield found


@pytest.fixture
def page(browser, address):
    found = visited(browser, address)
    yield found
    assert not found.complaints
    found.context.close()


def outlined(page, photo):
    """Choose the photograph, and draw the line around the person."""
    chosen(page, photo[0])
    at_step(page, "outline")
    browsing.wait(page, "Boolean(relightApp.parts.outline.image)")
    lasso(page, photo[1])
    browsing.wait(page, OUTLINED, 120)


def lit(page, photo):
    outlined(page, photo)
    page.get_by_role("button", name="Use this outline").click()
    at_step(page, "light")
    browsing.wait(page, LIT, 120)


def saved(page, name, folder):
    """Save a file of the last step; its path."""
    with page.expect_download(timeout=240000) as download:
        page.get_by_role("button", name=f"Save {name}", exact=True).click()
    path = Path(folder) / download.value.suggested_filename
    download.value.save_as(path)
    at_step(page, "save")
    return path


def without_advice(page):
    """Drop the browser's advice about the test's own reading of pixels."""
    page.complaints[:] = [line for line in page.complaints if "willReadFrequently" not in line]


def notice(page):
    browsing.wait(page, "!relightApp.message.hidden && !relightApp.aborting")
    return page.locator(".notice span").inner_text()


def test_from_a_photograph_to_the_files_that_the_copied_command_makes(page, photo, tmp_path, here):
    lit(page, photo)
    page.locator("[data-preset=stage]").click()
    page.evaluate("relightApp.parts.light.viewer.change((state) => (state.background = [0.2, 0.1, 0.05]))")
    page.get_by_role("button", name="Save files…").click()
    at_step(page, "save")
    page.get_by_role("checkbox", name="Albedo").check()
    exr, jpeg = saved(page, "OpenEXR", tmp_path), saved(page, "JPEG", tmp_path)
    assert relight.read(jpeg).shape == (320, 320, 3)
    with page.expect_download() as download:
        page.get_by_text("Save the matte").click()
    download.value.save_as(tmp_path / "me-matte.png")
    (tmp_path / "me.jpg").write_bytes(photo[0].read_bytes())
    words = shlex.split(page.get_by_label("Command line", exact=True).inner_text())
    assert words[:5] == ["relight", "apply", "me.jpg", "--mask", "me-matte.png"]
    words[-1] = "again.exr"
    result = CliRunner().invoke(command_line, [*words[1:], "--passes", "albedo"])
    assert result.exit_code == 0, result.output
    ours, theirs = relight.media.images.read_layers(exr), relight.media.images.read_layers("again.exr")
    assert set(ours) == set(theirs)
    assert {"C_spot", "C_left", "C_right", "albedo"} <= set(ours)
    for name in ours:  # to the last bit of a half float, since the two processes may sum in another order
        np.testing.assert_allclose(ours[name], theirs[name], rtol=2e-3, atol=1e-6)
    python = page.get_by_label("Python", exact=True).inner_text().replace("me-relit.jpg", "python.exr")
    exec(python, {})
    np.testing.assert_allclose(relight.read("python.exr"), relight.read("again.exr"), rtol=2e-3, atol=1e-6)


FOUND_BY = """
from relight.matting.people import files as person_files
person_files.are_fetched = lambda: True
person_files.fetched = lambda: ({detector!r}, {landmarks!r})
"""


@pytest.fixture(scope="module")
def finding(tmp_path_factory):
    """The application with two small networks, for which a person is a red disc."""
    pytest.importorskip("openvino")
    folder = tmp_path_factory.mktemp("finder")
    small_finder(folder)
    networks = {name: str(folder / f"{name}.xml") for name in ("detector", "landmarks")}
    (folder / "sitecustomize.py").write_text(FOUND_BY.format(**networks))
    with served(before=[str(folder)]) as (found, _):
        yield found


def test_one_drop_opens_the_light_and_one_click_saves(browser, finding, tmp_path):
    picture, _ = discs((300, 300), (150, 160, 30))
    for name, pixels in (("disc.png", picture), ("nobody.png", picture[:60])):
        Image.fromarray(np.round(255 * pixels).astype(np.uint8)).save(tmp_path / name)
    page = visited(browser, finding)
    dropped(page, tmp_path / "disc.png")
    at_step(page, "light")
    browsing.wait(page, LIT, 120)
    found, before = saved_picture(page, tmp_path / "saved.png"), np.round(255 * picture)
    assert found.shape == (300, 300, 3)
    changed = np.abs(found - before).max(axis=-1)
    y, x = np.mgrid[:300, :300] - [[[160]], [[150]]]
    assert changed[np.hypot(x, y) > 40].max() <= 2  # the photograph is behind them
    assert changed[np.hypot(x, y) < 25].mean() > 10  # in other light
    at_step(page, "light")
    state = "relightApp.parts.light.viewer.state"
    page.evaluate(
        "relightApp.parts.light.apply({ lights: [{ name: 'only', azimuth: 70, elevation: 5 }], gloss: 0 })"
    )
    page.reload()  # lights and background survive it
    browsing.wait(page, "Boolean(window.relightApp)")
    at_step(page, "light")
    browsing.wait(page, LIT, 120)
    assert page.evaluate(f"[{state}.lights[0].azimuth, {state}.background]") == [70, "original"]
    page.evaluate("relightApp.remove(relightApp.chosen)")
    page.get_by_role("button", name="Undo").click()
    at_step(page, "light")
    page.evaluate("relightApp.go('outline')")  # where the found matte can be corrected
    browsing.wait(page, OUTLINED, 120)
    chosen(page, tmp_path / "nobody.png")
    at_step(page, "outline")
    assert "No person was found" in notice(page)
    refused = [line for line in page.complaints if "status of 422" in line]
    assert page.complaints == refused
    page.context.close()


def test_one_of_several_people_is_chosen_by_a_click_and_a_key_turns_the_picture(browser, finding, tmp_path):
    picture, (_, second) = discs((300, 400), (110, 150, 45), (300, 170, 28))
    Image.fromarray(np.round(255 * picture).astype(np.uint8)).save(tmp_path / "two.png")
    page = visited(browser, finding)
    dropped(page, tmp_path / "two.png")
    at_step(page, "light")
    browsing.wait(page, LIT, 120)
    assert "2 people were found, and the largest is lit." in notice(page)
    page.get_by_role("button", name="Choose", exact=True).first.click()
    at_step(page, "outline")
    browsing.wait(page, OUTLINED, 120)
    outline = "relightApp.parts.outline"
    assert page.evaluate(f"{outline}.tool") == "people"
    click = f"""() => {{ const at = {outline}.canvas.getBoundingClientRect();
        const [x, y] = {outline}.paper.spot([300 / 400, 170 / 300]); return [at.left + x, at.top + y]; }}"""
    page.mouse.click(*page.evaluate(click))
    browsing.wait(page, f"{outline}.drawing.model === 'person-2' && !{outline}.solving", 120)
    page.get_by_role("button", name="Everyone").click()
    browsing.wait(
        page, f"{outline}.drawing.model === 'everyone' && !{outline}.solving && !relightApp.aborting", 120
    )
    page.keyboard.press("Control+z")
    browsing.wait(page, f"{outline}.drawing.model === 'person-2'")
    accept = page.get_by_role("button", name="Use this outline")
    page.evaluate(f"({outline}.solving = new AbortController(), {outline}.paint())")
    assert accept.is_enabled()  # a button that is disabled while it is pressed is not clicked
    accept.click()
    at_step(page, "light")
    address = page.evaluate("`photographs/${relightApp.chosen.id}/files/${relightApp.chosen.mask}`")
    matte = Image.open(io.BytesIO(page.request.get(f"{finding}{address}").body()))
    assert np.asarray(matte)[second].mean() > 200
    page.evaluate("relightApp.go('outline')")
    at_step(page, "outline")
    page.keyboard.press("r")
    at_step(page, "light")
    assert page.evaluate("[relightApp.chosen.width, relightApp.chosen.name]") == [300, "two-turned.png"]
    assert not page.complaints
    page.context.close()


def test_the_photograph_is_its_own_background_and_one_button_saves_all_of_it(page, photo, tmp_path):
    lit(page, photo)
    viewer = "relightApp.parts.light.viewer"
    assert page.evaluate(f"{viewer}.state.background") == "original"
    assert page.evaluate(f"{viewer}.state.lights.map((light) => light.name)") == ["key", "fill", "rim"]
    assert not page.evaluate(f"{viewer}.past.length")
    with page.expect_download(timeout=240000) as download:
        page.get_by_role("button", name="Save PNG").click()
    download.value.save_as(tmp_path / "saved.png")
    at_step(page, "light")
    found, before = np.asarray(Image.open(tmp_path / "saved.png"), int), np.asarray(Image.open(photo[0]), int)
    assert found.shape == (320, 320, 3)
    np.testing.assert_allclose(found[:40, :40], before[:40, :40], atol=2)


def test_an_example_and_a_file_of_the_folder_are_a_click_away_and_share_one_rig(page):
    page.get_by_role("button", name="Try the example").click()
    at_step(page, "light")
    browsing.wait(page, LIT, 120)
    browsing.wait(page, DRAWN, 120)
    without_advice(page)
    page.locator("[data-preset=split]").click()
    page.get_by_role("button", name="Photograph", exact=False).first.click()
    page.get_by_role("button", name="sub/me.jpg").click()
    at_step(page, "outline")
    page.locator(".strip .thumb").first.click()
    at_step(page, "light")
    azimuths = "relightApp.parts.light.viewer.state.lights.map((light) => light.azimuth)"
    assert page.evaluate(azimuths) == [-92, 50]


def test_a_models_matte_is_found_and_corrected(page, tmp_path):
    codes = np.full((240, 200, 3), (20, 20, 60), np.uint8)
    codes[40:200, 60:140] = (230, 20, 20)
    Image.fromarray(codes).save(tmp_path / "red.png")
    model = channel(tmp_path / "red.onnx", 0)
    chosen(page, tmp_path / "red.png")
    at_step(page, "outline")
    page.get_by_role("button", name="Find with a model…").click()
    page.get_by_label("Input options").fill("mean=0/0/0,std=1/1/1")
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Open an ONNX file…").click()
    chooser.value.set_files(str(model))
    browsing.wait(page, OUTLINED, 120)
    at_step(page, "outline")

    def seen(x, y):
        """How much of a place is dimmed, 0 to 255."""
        return page.evaluate(
            "([x, y]) => relightApp.parts.outline.matte.getContext('2d').getImageData(x, y, 1, 1).data[3]",
            [x, y],
        )

    assert seen(100, 120) < 60
    assert seen(20, 20) > 200
    page.get_by_role("button", name="Background", exact=True).click()
    page.evaluate(
        """relightApp.parts.outline.change({ ...relightApp.parts.outline.drawing,
             strokes: [{ person: false, points: [[0.5, 0.75], [0.5, 0.8]], radius: 0.1 }] })"""
    )
    time.sleep(0.3)
    browsing.wait(page, OUTLINED, 120)
    assert seen(100, 184) > 200
    assert seen(100, 80) < 60
    without_advice(page)


def test_the_outlines_edge_is_corrected_by_cuts_sliders_and_a_matte_from_a_file(page, photo, tmp_path):
    """The matte that is shown follows each, and Undo takes each back."""
    outline = "relightApp.parts.outline"
    chosen(page, photo[0])
    at_step(page, "outline")
    browsing.wait(page, f"Boolean({outline}.image)")
    matte = np.zeros((300, 240), np.uint8)
    matte[60:270, 60:180] = 255
    height, width = np.asarray(Image.open(photo[0])).shape[:2]
    Image.fromarray(matte).resize((width, height)).save(tmp_path / "matte.png")
    page.locator(".tools input[aria-label='A matte']").set_input_files(str(tmp_path / "matte.png"))
    browsing.wait(page, OUTLINED, 120)
    whole = page.evaluate(COVERED)
    assert whole == pytest.approx(0.35, abs=0.01)
    page.get_by_role("button", name="Matte", exact=True).click()
    assert page.evaluate(f"{outline}.grey")
    page.get_by_role("slider", name="Shift the edge").fill("100")
    browsing.wait(page, f"{outline}.drawing.shift === 0.01 && {OUTLINED}", 120)
    browsing.wait(page, f"{COVERED} > {1.03 * whole}", 120)
    page.get_by_role("button", name="Cut out").click()
    lasso(page, np.array([[0.4, 0.4], [0.6, 0.4], [0.6, 0.6], [0.4, 0.6]]))
    browsing.wait(page, f"{outline}.drawing.holes.length === 1 && {OUTLINED}", 120)
    browsing.wait(page, f"{COVERED} < {whole}", 120)
    for _ in range(2):
        page.keyboard.press("Control+z")
    browsing.wait(
        page, f"{outline}.drawing.shift === 0 && {OUTLINED} && Math.abs({COVERED} - {whole}) < 0.005", 120
    )
    assert not page.complaints


def test_an_analysis_can_be_cancelled_and_done_again(page, photo):
    outlined(page, photo)
    page.evaluate(  # as soon as the dialogue is open: a small photograph is analysed within a second
        """() => {
            new MutationObserver((_, observer) => {
                observer.disconnect();
                relightApp.cancel.click();
            }).observe(relightApp.progress, { attributes: true, attributeFilter: ["open"] });
        }"""
    )
    page.get_by_role("button", name="Use this outline").click()
    assert notice(page) == "Cancelled."
    assert page.evaluate("relightApp.step") == "outline"
    page.get_by_role("button", name="Use this outline").click()
    at_step(page, "light")


def test_two_tabs_and_one_that_is_closed_in_the_middle(browser, address, page, photo):
    other = visited(browser, address)
    outlined(other, photo)
    other.get_by_role("button", name="Use this outline").click()
    other.context.close()
    lit(page, photo)
    assert not page.evaluate("relightApp.message.hidden") or page.evaluate("relightApp.step") == "light"


def test_another_tab_shows_the_outline_and_a_new_analysis_keeps_undo(browser, address, page, photo):
    lit(page, photo)
    page.locator("[data-preset=split]").click()
    other = visited(browser, address)
    other.get_by_role("button", name="me.jpg", exact=True).last.click()
    at_step(other, "light")
    other.get_by_role("button", name="Outline").click()
    browsing.wait(other, OUTLINED, 120)
    drawings = [each.evaluate("relightApp.parts.outline.drawing") for each in (page, other)]
    assert drawings[0] == drawings[1]
    assert drawings[1]["lasso"]
    other.context.close()
    page.get_by_role("button", name="Outline").click()
    page.get_by_role("slider", name="Shift the edge").fill("50")
    browsing.wait(page, f"relightApp.parts.outline.drawing.shift && {OUTLINED}", 120)
    page.get_by_role("button", name="Use this outline").click()
    at_step(page, "light")
    names = "relightApp.parts.light.viewer.state.lights.map((light) => light.name)"
    assert page.evaluate(names) == ["key", "bounce"]
    page.get_by_role("button", name="Undo", exact=True).last.click()
    assert page.evaluate(names) == ["key", "fill", "rim"]


def test_bad_files_are_a_sentence_and_the_server_goes_on(page, photo, tmp_path):
    (tmp_path / "text.jpg").write_text("this is no picture")
    Image.fromarray(np.zeros((40, 40, 3), np.uint8)).save(tmp_path / "cut.png")
    (tmp_path / "cut.png").write_bytes((tmp_path / "cut.png").read_bytes()[:60])
    (tmp_path / "notes.txt").write_text("text")
    for name in ("text.jpg", "cut.png", "notes.txt"):
        chosen(page, tmp_path / name)
        said = notice(page)
        assert name in said
        assert "/" not in said
        page.evaluate("relightApp.hush()")
    outlined(page, photo)
    page.evaluate(
        """relightApp.parts.outline.change({ lasso: null, model: false,
             strokes: [{ person: false, points: [[0.5, 0.5]], radius: 0.1 }] })"""
    )
    assert "outline: nothing" in notice(page)
    refusals = [line for line in page.complaints if "status of 422" in line]  # as browsers log every refusal
    assert len(refusals) >= 3
    page.complaints[:] = [line for line in page.complaints if line not in refusals]


def test_where_there_is_no_webgl2_the_server_makes_the_pictures(browser, address, photo):
    without = """(() => {
        const own = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
            return kind === "webgl2" ? null : own.call(this, kind, ...rest);
        };
    })()"""
    page = visited(browser, address, before=without)
    outlined(page, photo)
    page.get_by_role("button", name="Use this outline").click()
    at_step(page, "light")
    assert "no WebGL 2" in notice(page)
    browsing.wait(page, SETTLED)
    browsing.settled(page)  # the picture has come; the next frame draws it

    def lopsided():
        """How much brighter the person's left half is than the right one."""
        return page.evaluate(
            """() => {
                const { engine, pack } = relightApp.parts.light.viewer;
                const { width, data } = engine.readShown();
                const [left, , across] = pack.description.box;
                const sums = [0, 0];
                for (let at = 0; at < data.length; at += 4) {
                    sums[Number((at / 4) % width > left + across / 2)] += data[at + 1];
                }
                return sums[0] / sums[1];
            }"""
        )

    page.evaluate(
        "relightApp.parts.light.viewer.change((state) => {"
        " state.lights.length = 1; state.selected = 0; state.background = null; })"
    )
    browsing.settled(page)
    browsing.wait(page, SETTLED)
    browsing.settled(page)
    before = lopsided()  # the key is at the left
    x, y = page.evaluate(
        """() => {
            const { element, middle, radius } = relightApp.parts.light.viewer.stage;
            const at = element.getBoundingClientRect();
            return [at.left + middle[0] + 0.9 * radius, at.top + middle[1]];
        }"""
    )
    page.mouse.move(x - 30, y)
    page.mouse.down()
    page.mouse.move(x, y)  # the light goes where the hand is, as it does with WebGL
    page.mouse.up()
    browsing.settled(page)
    browsing.wait(page, SETTLED)
    browsing.settled(page)
    assert lopsided() < 0.6 * before
    page.locator("[data-preset=golden-hour]").click()
    alpha = "relightApp.parts.light.viewer.engine.readShown().data[3]"
    for kind, expected in (("original", 255), ("none", 0), ("colour", 255)):
        page.evaluate(f"relightApp.parts.light.viewer.setBackgroundKind('{kind}')")
        browsing.settled(page)
        browsing.wait(page, SETTLED)
        browsing.settled(page)
        assert page.evaluate(alpha) == expected
    page.keyboard.press("n")
    assert "needs WebGL 2" in page.locator(".message").inner_text()
    browsing.wait(page, DRAWN, 120)  # the server's pictures of the presets
    page.get_by_role("button", name="Save files…").click()
    at_step(page, "save")
    without_advice(page)
    assert not page.complaints
    page.context.close()


def test_the_folder_goes_and_no_path_of_the_machine_is_in_a_page(photo, tmp_path):
    import urllib.request

    with served(TMPDIR=str(tmp_path)) as (address, process):
        assert [one.name for one in tmp_path.iterdir() if one.name.startswith("relight-app-")]
        post = urllib.request.Request(
            f"{address}photographs?name=me.jpg", photo[0].read_bytes(), method="POST"
        )
        said = urllib.request.urlopen(post).read().decode()
        for path in ("", "session", "viewer.js", "web/app.js"):
            said += urllib.request.urlopen(address + path).read().decode()
        assert str(tmp_path) not in said
        assert str(Path.home()) not in said
        os.kill(process.pid, signal.SIGTERM)
        process.wait(30)
    assert not [one.name for one in tmp_path.iterdir() if one.name.startswith("relight-app-")]
