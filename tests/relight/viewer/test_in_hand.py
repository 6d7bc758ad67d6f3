"""The viewer's page in a browser, as a hand holds it: mouse, touch, keyboard, links and files."""

import shlex

import numpy as np
import pytest
from helpers import browsing
from scipy.ndimage import binary_erosion

import relight
from relight.pipeline.options import Lighting

pytest.importorskip("playwright")
pytestmark = browsing.NEEDS_CHROMIUM


def leave_one_light(page):
    page.evaluate("relight.viewer.change((state) => state.lights.pop())")
    browsing.settled(page)  # the row of the light that goes moves all that is below it


@pytest.mark.slow
def test_a_near_light_is_where_the_hand_holds_it(page, viewed, tmp_path):
    leave_one_light(page)
    page.get_by_label("Near").check(force=True)
    browsing.settled(page)
    assert np.linalg.norm(browsing.state(page)["lights"][0]["position"]) > 0.3
    middles = {}
    for side, right in {"left": -1.1, "right": 1.1}.items():
        browsing.drag(page, right, 0.2)
        handle = page.locator(".handle.near").bounding_box()
        middles[side] = handle["x"] + handle["width"] / 2
        place = browsing.state(page)["lights"][0]["position"]
        assert np.sign(place[0]) == np.sign(right)
        bright = browsing.shown(page)[..., :3].sum(axis=-1)
        assert np.sign(lopsided(bright)) == np.sign(right)
    x = page.evaluate(
        "relight.viewer.stage.element.getBoundingClientRect().left + relight.viewer.stage.middle[0]"
    )
    assert middles["left"] < x - 50 < x + 50 < middles["right"]
    browsing.press(page, "ArrowUp", "PageUp", "PageUp", "PageUp", ".")
    lamp = browsing.state(page)["lights"][0]
    assert lamp["position"][2] < place[2] - 0.1
    assert page.locator(".handle.near").bounding_box()["x"] == pytest.approx(handle["x"], abs=1)

    (tmp_path / "lights.yaml").write_text(page.evaluate("relight.lights()"))
    (read,) = relight.read_lights(tmp_path / "lights.yaml")
    assert isinstance(read, relight.PointLight)
    np.testing.assert_allclose(read.position, lamp["position"], atol=1e-4)
    words = shlex.split(page.evaluate("relight.command()"))
    assert Lighting(light=(words[words.index("--light") + 1],)).rig().lights == [read]
    browsing.wait(page, "location.hash.includes('radius')")  # which the last key gave it
    page.reload()
    browsing.wait(page, "Boolean(window.relight)")
    np.testing.assert_allclose(browsing.state(page)["lights"][0]["position"], lamp["position"], atol=1e-4)
    browsing.press(page, "d")
    assert "azimuth" in browsing.state(page)["lights"][0]
    browsing.press(page, "Control+z")
    assert "position" in browsing.state(page)["lights"][0]


@pytest.mark.slow
def test_near_is_near_where_the_key_came_first(page):
    page.evaluate("""() => {
        relight.viewer.actions.switch(); // which the panel does not show yet
        document.querySelector("[aria-label=Distance] [value=near]").click();
    }""")
    browsing.settled(page)
    assert "position" in browsing.state(page)["lights"][0]


def lopsided(bright):
    """How much more of it is on the right than on the left of the picture's middle."""
    half = bright.shape[1] // 2
    return bright[:, -half:].sum() - bright[:, :half].sum()


VIEW = "(({ view }) => [view.scale / view.fitted, view.left, view.top])(relight.viewer.stage)"


@pytest.mark.slow
def test_wheel_and_fingers_zoom_and_another_button_moves_the_picture_and_no_light(page):
    before = browsing.state(page)
    touch = page.context.new_cdp_session(page)
    x, y = page.evaluate("relight.viewer.stage.middle")
    for kind, apart in (("touchStart", 50), ("touchMove", 100)):
        points = [{"x": x + side * apart, "y": y, "id": side + 1} for side in (-1, 1)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    assert page.evaluate(VIEW)[0] == pytest.approx(2, abs=0.05)
    page.mouse.move(x, y)
    page.mouse.wheel(0, -300)
    browsing.wait(page, f"{VIEW}[0] > 2.5")
    zoom, left, top = page.evaluate(VIEW)
    page.mouse.down(button="right")
    page.mouse.move(x + 40, y - 10)
    page.mouse.up(button="right")
    assert page.evaluate(VIEW) == pytest.approx([zoom, left + 40, top - 10])
    page.get_by_role("button", name="Show all of the picture").click()
    assert page.evaluate(VIEW)[0] == 1
    page.mouse.click(x + 90, y)  # a click that holds no light does nothing
    browsing.settled(page)
    assert browsing.state(page) == before
    assert not page.evaluate("relight.viewer.past")


@pytest.mark.slow
def test_before_is_a_button_and_a_key_also_after_the_help(page):
    held = "relight.viewer.held"
    x, y = (page.locator(".before").bounding_box()[side] + 5 for side in "xy")
    page.mouse.move(x, y)
    page.mouse.down()
    assert page.evaluate(held)
    page.mouse.up()
    assert not page.evaluate(held)
    page.get_by_role("button", name="Help").click()
    page.keyboard.press("Escape")
    browsing.wait(page, "!relight.viewer.help.open")
    browsing.settled(page)
    page.keyboard.down(" ")
    assert page.evaluate(held)
    page.keyboard.up(" ")
    assert not page.evaluate(held)
    assert not page.evaluate("relight.viewer.help.open")


@pytest.mark.slow
def test_the_focus_is_where_it_was_after_the_help(page):
    page.get_by_role("button", name="Solo key").focus()
    browsing.press(page, "?", "Escape")
    browsing.wait(page, "!relight.viewer.help.open")
    browsing.settled(page)
    assert page.evaluate("document.activeElement.getAttribute('aria-label')") == "Solo key"


@pytest.mark.slow
def test_the_picture_can_be_copied(page):
    page.evaluate("""() => { window.copied = []; navigator.clipboard.write = async ([item]) => {
        const png = await item.getType("image/png");
        window.copied.push((await createImageBitmap(png)).width);
    }; }""")
    page.get_by_label("Softness, exactly").click()  # which selects its text
    browsing.press(page, "Tab", "Control+c")
    browsing.wait(page, "window.copied.length === 1", 20)
    assert page.evaluate("window.copied[0] === relight.viewer.pack.description.size[0]")


@pytest.mark.slow
def test_an_orbit_ends_where_another_light_is_chosen(page):
    browsing.press(page, "d", "t")
    browsing.wait(page, "relight.viewer.playing !== null")
    page.get_by_label("Name of light 2").click()
    browsing.settled(page)
    assert page.evaluate("relight.viewer.playing") is None
    lights = browsing.state(page)["lights"]
    assert "position" in lights[0]
    assert "position" not in lights[1]
    browsing.press(page, "Escape")
    page.evaluate("relight.viewer.play()")
    page.evaluate("relight.viewer.actions.remove(1); relight.viewer.actions.remove(0)")
    browsing.settled(page)
    assert browsing.state(page)["lights"] == []


@pytest.mark.slow
def test_the_focus_stays_on_the_page_when_its_button_goes(page):
    page.locator(".lights li").nth(1).locator("button").last.click()
    browsing.settled(page)
    assert page.evaluate("document.activeElement === relight.viewer.stage.element")


@pytest.mark.slow
def test_what_is_dropped_on_the_person_is_behind_them_and_on_the_panel_around_them(page):
    browsing.dropped(page, ".picture", "wall.png", 24)
    assert browsing.state(page)["background"] == "picture"
    browsing.dropped(page, ".panel", "sky.png")
    assert page.evaluate("relight.viewer.environment.path") == "sky.png"
    x, y = page.evaluate("relight.viewer.stage.middle")
    page.mouse.move(x, y)
    page.keyboard.down("Shift")
    page.mouse.down(button="right")
    page.mouse.move(x + 40, y)
    page.mouse.up(button="right")
    page.keyboard.up("Shift")
    assert browsing.state(page)["environment"]["rotation"] > 1


def test_the_light_follows_the_hand_on_all_four_sides(page):
    leave_one_light(page)
    centres = {}
    for side, where in {"left": (-0.9, 0), "right": (0.9, 0), "top": (0, 0.9), "bottom": (0, -0.9)}.items():
        browsing.drag(page, *where)
        bright = browsing.shown(page)[..., :3].sum(axis=-1)
        rows, columns = np.indices(bright.shape)
        centres[side] = np.array([(columns * bright).sum(), (rows * bright).sum()]) / bright.sum()
    assert centres["left"][0] < centres["right"][0] - 8
    assert centres["top"][1] < centres["bottom"][1] - 8
    assert browsing.state(page)["lights"][0]["elevation"] < -30


@pytest.mark.slow
@pytest.mark.parametrize("near", [False, True])
def test_what_is_said_of_a_dragged_light_lies_beside_the_tools(page, near):
    """Or takes their place, where there is no room for both."""
    if near:
        page.get_by_label("Near").check(force=True)
    browsing.drag(page, 0.3, 0.2, release=False)
    shared = page.viewport_size
    for width in (1280, 1080, 900, 420):
        page.set_viewport_size({"width": width, "height": 700})
        said, tools = (page.locator(name).bounding_box() for name in (".readout", ".view-tools"))
        hidden = page.locator(".view-tools").evaluate("(tools) => getComputedStyle(tools).visibility")
        assert hidden == "hidden" or said["x"] + said["width"] <= tools["x"], width
        assert said["x"] >= 0
        assert (hidden == "hidden") == (width < 1080)
    page.mouse.up()
    page.set_viewport_size(shared)


@pytest.mark.slow
def test_beyond_the_ring_the_light_is_behind_and_leaves_a_rim(page):
    leave_one_light(page)
    browsing.drag(page, 1.25, 0)
    light = browsing.state(page)["lights"][0]
    assert 100 < light["azimuth"] < 170
    found = browsing.shown(page)
    covered = found[..., 3] > 0.99
    deep = binary_erosion(covered, iterations=20)
    rim = covered & ~binary_erosion(covered, iterations=5)
    rim[:, : found.shape[1] // 2] = False  # the lit side is the right one
    assert found[rim, 0].mean() > 2 * found[deep, 0].mean() + 0.05


def test_a_link_is_a_lighting(page, browser, page_file):
    browsing.drag(page, 0.3, -0.4)
    browsing.press(page, "a", "s", "w", "v", "x", "g")
    browsing.wait(page, "location.hash.includes('look=visibility')")
    before, fragment = browsing.state(page), page.evaluate("location.hash.slice(1)")
    page.reload()
    browsing.wait(page, "Boolean(window.relight)")
    found = browsing.state(page)
    for key in ("look", "wipe", "selected"):
        assert found[key] == before[key]
    assert found["exposure"] == pytest.approx(0.25)
    np.testing.assert_allclose(found["background"], before["background"], atol=1e-4)
    for one, other in zip(found["lights"], before["lights"], strict=True):
        assert one["azimuth"] == pytest.approx(other["azimuth"], abs=1e-3)
        assert {key: one[key] for key in ("name", "solo", "colour")} == {
            key: other[key] for key in ("name", "solo", "colour")
        }
    assert fragment


@pytest.mark.slow
def test_a_link_that_is_wrong_is_a_sentence(page):
    for fragment, words in {
        "light=key:azimuth=NaN,elevation=3": "azimuth: expected a number, got NaN",
        "light=key:azimuth=1,elevation=100": "elevation: expected a number from -90 to 90",
        "light=key:wattage=3": "wattage: is no parameter",
        "light=a:temperature=3": "temperature: expected 1000 to 40000",
        "look=sideways": "look: expected picture",
        "exposure=x": "exposure: expected a number",
    }.items():
        # A change that is written at that moment does not replace it.
        page.evaluate(f"() => {{ location.hash = {fragment!r}; relight.viewer.writeLink(); }}")
        browsing.wait(page, f"document.querySelector('.message').textContent.includes({words!r})", 20)
        assert len(browsing.state(page)["lights"]) == 2


@pytest.mark.slow
def test_the_picture_comes_back_after_the_context_was_lost(page):
    before = browsing.shown(page, "picture")
    page.evaluate(
        """() => new Promise((done) => {
            const { gl, canvas } = relight.viewer.engine, lose = gl.getExtension("WEBGL_lose_context");
            canvas.addEventListener("webglcontextrestored", () => setTimeout(done));
            lose.loseContext();
            setTimeout(() => lose.restoreContext(), 50);
        })"""
    )
    page.complaints[:] = [text for text in page.complaints if "CONTEXT_LOST" not in text]  # the browser's own
    np.testing.assert_array_equal(browsing.shown(page, "picture"), before)


@pytest.mark.slow
def test_a_name_is_text_whatever_it_says(page):
    assert page.evaluate("window.hostile") is None
    assert page.title() == browsing.HOSTILE
    names = page.locator(".lights li:not([hidden]) .name")
    assert names.nth(1).input_value() == browsing.HOSTILE[:80]
    assert page.locator("img").count() == 0


@pytest.mark.slow
def test_a_browser_without_webgl_says_so(browser, page_file):
    for before, words in (
        ("HTMLCanvasElement.prototype.getContext = () => null", "has no WebGL 2"),
        ("WebGL2RenderingContext.prototype.getExtension = () => null", "float images"),
    ):
        page = browsing.opened(browser, page_file, ready=False, before=before)
        page.wait_for_selector("[role=alert]")
        assert words in page.locator("[role=alert]").inner_text()
        page.context.close()


@pytest.mark.slow
def test_a_file_that_is_no_map_is_a_sentence(page, tmp_path):
    for name, words in {
        "sky.exr": "OpenEXR files cannot be opened",
        "notes.png": "is no picture",
        "sky.hdr": "is no Radiance picture",
    }.items():
        (tmp_path / name).write_bytes(b"nothing of the kind")
        page.locator("[aria-label=Environment] input[type=file]").set_input_files(tmp_path / name)
        browsing.wait(page, f"document.querySelector('.message').textContent.includes({words!r})", 20)


@pytest.mark.slow
def test_all_of_it_by_keyboard(page):
    begun = browsing.state(page)
    browsing.press(page, "ArrowRight", "Shift+ArrowUp", "+", ".", "j")
    light = browsing.state(page)["lights"][0]
    assert (light["azimuth"], light["elevation"], light["exposure"], light["angle"]) == (-39, 40, 0.25, 2)
    assert light["temperature"] < 4500
    browsing.press(page, "2", "m", "1", "Delete", "n")
    assert [len(browsing.state(page)["lights"]), browsing.state(page)["look"]] == [1, "normals"]
    browsing.press(page, *["Control+z"] * 9)
    assert browsing.state(page)["lights"] == begun["lights"]
    browsing.press(page, *["Control+Shift+z"] * 9)
    assert browsing.state(page)["look"] == "normals"
    browsing.press(page, "?")
    assert page.locator("dialog").is_visible()
    browsing.press(page, "Escape")
    page.keyboard.down(" ")
    assert page.evaluate("relight.viewer.held")
    page.keyboard.up(" ")
    assert not page.evaluate("relight.viewer.held")
    unnamed = page.evaluate(
        """() => [...document.querySelectorAll("button, input, select, [tabindex]")]
            .filter((one) => !one.hidden && !(one.getAttribute("aria-label") || one.textContent.trim()
                || one.closest("label")?.textContent.trim())).map((one) => one.outerHTML)"""
    )
    assert not unnamed
