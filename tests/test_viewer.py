"""The viewer's page in a real browser: the same light as Python's, and hands on it."""

import base64
import json
import shlex
from pathlib import Path

import browsing
import numpy as np
import pytest
import shipped
import torch
from scipy.ndimage import binary_erosion

import relight
from relight.cli.options import Look
from relight.media.colour import encode
from relight.viewer.packing import pack
from relight.viewer.page import module, style
from relight.viewer.scene import parameters_of, scene_of

pytest.importorskip("playwright")
pytestmark = pytest.mark.skipif(browsing.chromium() is None, reason="no chromium: apt-get install chromium")

ROOT = Path(__file__).parent.parent
RMSE, LARGEST = 0.01, 0.08  # of the encoded picture; the largest away from the matte's rim
HOSTILE = "<script>window.hostile = 1</script><img src=x onerror='window.hostile = 1'>"


@pytest.fixture(scope="module")
def browser():
    with browsing.browser() as found:
        yield found


@pytest.fixture(scope="module")
def subjects():
    """The bundled person, small, and two of the light stage; each is a picture with its own alpha."""
    person = relight.read(ROOT / "examples" / "person.png")
    images = {"person": np.ascontiguousarray(person[::2, ::2])}
    for scene in shipped.scenes()[1:]:
        matte = scene.mask.float().numpy()[..., None]
        images[scene.name] = np.concatenate(
            [scene.photograph.numpy() * matte, matte], axis=-1, dtype=np.float32
        )
    return {name: relight.Subject(image) for name, image in images.items()}


@pytest.fixture(scope="module")
def person(subjects):
    return subjects["person"]


@pytest.fixture(scope="module")
def path(person, tmp_path_factory):
    lights = [
        relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2, temperature=4500, name="key"),
        relight.DirectionalLight(azimuth=140, elevation=20, colour=(0.5, 0.7, 1), name=HOSTILE[:80]),
    ]
    file = tmp_path_factory.mktemp("page") / "person.html"
    return browsing.policed(
        person.view(file, lights, title=HOSTILE, command=["relight", "apply", "it's.png"])
    )


@pytest.fixture
def page(browser, path):
    found = browsing.opened(browser, path)
    yield found
    assert not found.complaints
    found.context.close()


def drag(page, right, up):
    """Press in the middle of the stage and drag: `right` and `up` in radii of the inner ring."""
    x, y, radius = page.evaluate(
        """() => { const { stage } = relight.viewer, at = stage.element.getBoundingClientRect();
                   return [at.left + stage.middle[0], at.top + stage.middle[1], stage.radius]; }"""
    )
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + right * radius / 2, y - up * radius / 2)
    page.mouse.move(x + right * radius, y - up * radius)
    page.mouse.up()
    browsing.settled(page)


def state(page):
    return page.evaluate("relight.viewer.state")


def press(page, *keys):
    for key in keys:
        page.keyboard.press(key)
    browsing.settled(page)


def compare(found, truth):
    """(RMSE, largest difference away from the rim) of two pictures, encoded for a display of white 4."""
    assert np.abs(found[..., 3] - truth[..., 3]).max() < 3e-3
    covered = truth[..., 3] > 0
    shown, meant = (encode(picture[covered][None, :, :3].clip(0), white=4)[0] for picture in (found, truth))
    inside = binary_erosion(truth[..., 3] > 0.99, iterations=3)[covered]
    return float(np.sqrt(((shown - meant) ** 2).mean())), float(np.abs(shown - meant)[inside].max())


@pytest.mark.parametrize("name", ["person", "body-generalisation-000007-00", "body-generalisation-000023-00"])
def test_the_page_relights_as_python_does(name, subjects, browser, tmp_path):
    subject, random = subjects[name], np.random.default_rng(3)
    lights = [
        relight.DirectionalLight(
            random.normal(size=3),
            angle=0 if number % 8 else 40,
            intensity=2,
            colour=(1, 0.8, 0.6),
            temperature=None if number % 4 else 3000,
        )
        for number in range(32)
    ]
    page = browsing.opened(browser, browsing.policed(subject.view(tmp_path / "page.html")))
    errors = [
        compare(found, subject.relit(light))
        for light, found in zip(
            lights, browsing.rendered(page, list(map(parameters_of, lights))), strict=True
        )
    ]
    rmse, largest = np.max(errors, axis=0)
    print(f"{name}: RMSE {rmse:.4f}, largest {largest:.3f}")
    assert rmse <= RMSE
    assert largest <= LARGEST
    both = browsing.rendered(page, [list(map(parameters_of, lights[:10]))])[0]  # more than the page has slots
    assert compare(both, subject.relit(lights[:10]))[0] <= RMSE
    assert not page.complaints
    page.context.close()


def test_near_lights_are_python_s(page, person):
    lights = [
        relight.PointLight((-0.6, 0.4, 0.8)),
        relight.PointLight((0.5, 0.2, 0.3), radius=0.2, colour=(1, 0.8, 0.6), exposure=-1),
        relight.PointLight((0.6, 0.3, -0.6), radius=0.1, temperature=3000),
        relight.PointLight((0, -0.7, 0.6), intensity=0.3),
    ]
    given = list(map(parameters_of, lights))
    for light, found in zip(lights, browsing.rendered(page, given), strict=True):
        rmse, largest = compare(found, person.relit(light))
        assert rmse <= RMSE
        assert largest <= LARGEST
    inside = given[0] | {"position": [0, 0, -0.05]}
    refused = page.evaluate("(light) => relight.render([light]).catch((error) => error.message)", inside)
    with pytest.raises(ValueError, match=refused.split(";")[0]):
        person.relit(relight.PointLight(inside["position"]))
    page.evaluate("(light) => relight.viewer.change((state) => (state.lights = [light]))", inside)
    browsing.wait(page, "document.querySelector('.message').textContent.includes('the person')", 20)
    press(page, "PageDown", *["Shift+PageDown"] * 3)
    assert state(page)["lights"][0]["position"][2] > 1
    assert page.locator(".message").inner_text() == ""


def test_the_visibility_of_near_and_distant_lights_is_weighed_by_what_arrives(page, person):
    lights = [relight.PointLight((-0.6, 0.4, 0.8), radius=0.1), relight.DirectionalLight(azimuth=60)]
    page.evaluate(
        "(lights) => relight.viewer.change((state) => lights.forEach((light, at) => "
        "Object.assign((state.lights[at] = { muted: false, solo: false }), light)))",
        list(map(parameters_of, lights)),
    )
    browsing.settled(page)
    found = browsing.shown(page, "visibility")[..., 0]
    camera, depth = person.camera, torch.from_numpy(person.depth)
    rows, columns = torch.meshgrid(*(torch.arange(side) + 0.5 for side in person.size), indexing="ij")
    ways = torch.tensor(lights[0].position)[:, None, None] - camera.positions(columns, rows, depth)
    arriving = (1 / (ways**2).sum(dim=0)).numpy()
    near, far = map(person.unshadowed, lights)
    inside = binary_erosion(person.matte > 0.99, iterations=5)
    truth = (near * arriving + far) / (arriving + 1)
    assert np.sqrt(((found - truth)[inside] ** 2).mean()) < 0.02


def test_a_near_light_is_where_the_hand_holds_it(page, person, tmp_path):
    page.evaluate("relight.viewer.change((state) => state.lights.pop())")
    page.get_by_label("Near").check(force=True)
    browsing.settled(page)
    assert np.linalg.norm(state(page)["lights"][0]["position"]) > 0.3
    middles = {}
    for side, right in {"left": -1.1, "right": 1.1}.items():
        drag(page, right, 0.2)
        handle = page.locator(".handle.near").bounding_box()
        middles[side] = handle["x"] + handle["width"] / 2
        place = state(page)["lights"][0]["position"]
        assert np.sign(place[0]) == np.sign(right)
        bright = browsing.shown(page)[..., :3].sum(axis=-1)
        assert np.sign(lopsided(bright)) == np.sign(right)
    x = page.evaluate(
        "relight.viewer.stage.element.getBoundingClientRect().left + relight.viewer.stage.middle[0]"
    )
    assert middles["left"] < x - 50 < x + 50 < middles["right"]
    page.mouse.wheel(0, -300)
    press(page, "ArrowUp", "PageDown", ".")
    lamp = state(page)["lights"][0]
    assert lamp["position"][2] < place[2] - 0.1
    assert page.locator(".handle.near").bounding_box()["x"] == pytest.approx(handle["x"], abs=1)

    (tmp_path / "lights.yaml").write_text(page.evaluate("relight.lights()"))
    (read,) = relight.read_lights(tmp_path / "lights.yaml")
    assert isinstance(read, relight.PointLight)
    np.testing.assert_allclose(read.position, lamp["position"], atol=1e-4)
    words = shlex.split(page.evaluate("relight.command()"))
    assert Look(light=[words[words.index("--light") + 1]]).lighting() == [read]
    browsing.wait(page, "location.hash.includes('radius')")  # which the last key gave it
    page.reload()
    browsing.wait(page, "Boolean(window.relight)")
    np.testing.assert_allclose(state(page)["lights"][0]["position"], lamp["position"], atol=1e-4)
    press(page, "d")
    assert "azimuth" in state(page)["lights"][0]
    press(page, "Control+z")
    assert "position" in state(page)["lights"][0]


def lopsided(bright):
    """How much more of it is on the right than on the left of the picture's middle."""
    half = bright.shape[1] // 2
    return bright[:, -half:].sum() - bright[:, :half].sum()


def test_two_fingers_make_a_light_softer_and_bring_it_nearer(page):
    touch = page.context.new_cdp_session(page)
    x, y = page.evaluate("relight.viewer.stage.middle")

    def pinch(start, end):
        for kind, apart in (("touchStart", start), ("touchMove", end)):
            points = [{"x": x + side * apart, "y": y, "id": side + 1} for side in (-1, 1)]
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        browsing.settled(page)

    before = state(page)["lights"][0]
    pinch(50, 150)
    assert state(page)["lights"][0] == before | {"angle": pytest.approx(20, abs=1)}
    press(page, "d")
    before = state(page)["lights"][0]
    pinch(50, 60)
    assert state(page)["lights"][0]["position"][2] > before["position"][2] + 0.1


def test_what_is_dropped_on_the_person_is_behind_them_and_on_the_panel_around_them(page):
    drop = """async ([where, name, width]) => {
        const canvas = Object.assign(document.createElement("canvas"), { width, height: 16 });
        canvas.getContext("2d").fillRect(0, 0, width, 16);
        const png = await new Promise((done) => canvas.toBlob(done));
        const dataTransfer = new DataTransfer();
        dataTransfer.items.add(new File([png], name));
        document.querySelector(where).dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true }));
    }"""
    page.evaluate(drop, [".picture", "wall.png", 24])
    browsing.wait(page, "relight.viewer.state.background === 'picture'")
    page.evaluate(drop, [".panel", "sky.png", 32])
    browsing.wait(page, "relight.viewer.environment?.path === 'sky.png'")
    x, y = page.evaluate("relight.viewer.stage.middle")
    page.mouse.move(x, y)
    page.mouse.down(button="right")
    page.mouse.move(x + 40, y)
    page.mouse.up(button="right")
    assert state(page)["environment"]["rotation"] > 1


def test_the_light_follows_the_hand_on_all_four_sides(page):
    page.evaluate("relight.viewer.change((state) => state.lights.pop())")
    centres = {}
    for side, where in {"left": (-0.9, 0), "right": (0.9, 0), "top": (0, 0.9), "bottom": (0, -0.9)}.items():
        drag(page, *where)
        bright = browsing.shown(page)[..., :3].sum(axis=-1)
        rows, columns = np.indices(bright.shape)
        centres[side] = np.array([(columns * bright).sum(), (rows * bright).sum()]) / bright.sum()
    assert centres["left"][0] < centres["right"][0] - 8
    assert centres["top"][1] < centres["bottom"][1] - 8
    assert state(page)["lights"][0]["elevation"] < -30


def test_beyond_the_ring_the_light_is_behind_and_leaves_a_rim(page):
    page.evaluate("relight.viewer.change((state) => state.lights.pop())")
    drag(page, 1.25, 0)
    light = state(page)["lights"][0]
    assert 100 < light["azimuth"] < 170
    found = browsing.shown(page)
    covered = found[..., 3] > 0.99
    deep = binary_erosion(covered, iterations=20)
    rim = covered & ~binary_erosion(covered, iterations=5)
    rim[:, : found.shape[1] // 2] = False  # the lit side is the right one
    assert found[rim, 0].mean() > 2 * found[deep, 0].mean() + 0.05


def test_its_lights_file_gives_the_same_picture_and_its_png_is_apply_s(page, person, tmp_path):
    drag(page, -0.5, 0.6)
    press(page, "+", ".", ".", "2", "m", "a", "k")
    (tmp_path / "lights.yaml").write_text(page.evaluate("relight.lights()"))
    lights = relight.read_lights(tmp_path / "lights.yaml")
    assert [light.name for light in lights] == ["key", "rim"]  # the muted one does not shine
    assert lights[0].exposure == 0.25
    assert lights[0].angle == 4
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save PNG").click()
    saved.value.save_as(tmp_path / "page.png")
    picture = person.relit(lights)
    relight.write(tmp_path / "python.png", picture)
    found, truth = (relight.read(tmp_path / name) for name in ("page.png", "python.png"))
    rmse, largest = compare(found, truth)
    assert rmse <= RMSE
    assert largest <= LARGEST

    words = shlex.split(page.evaluate("relight.command()"))
    assert words[:3] == ["relight", "apply", "it's.png"]
    given = [words[at + 1] for at, word in enumerate(words) if word == "--light"]
    assert Look(light=given).lighting() == lights


def test_a_link_is_a_lighting(page, browser, path):
    drag(page, 0.3, -0.4)
    press(page, "a", "s", "w", "v", "x", "g")
    browsing.wait(page, "location.hash.includes('look=visibility')")
    before, fragment = state(page), page.evaluate("location.hash.slice(1)")
    page.reload()
    browsing.wait(page, "Boolean(window.relight)")
    found = state(page)
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


def test_a_link_that_is_wrong_is_a_sentence(page):
    for fragment, words in {
        "light=key:azimuth=NaN,elevation=3": "azimuth: expected a number, got NaN",
        "light=key:azimuth=1,elevation=100": "elevation: expected a number from -90 to 90",
        "light=key:wattage=3": "wattage: is no parameter",
        "light=a:temperature=3": "temperature: expected 1000 to 40000",
        "look=sideways": "look: expected picture",
        "exposure=x": "exposure: expected a number",
    }.items():
        page.evaluate(f"location.hash = {fragment!r}")
        browsing.wait(page, f"document.querySelector('.message').textContent.includes({words!r})", 20)
        assert len(state(page)["lights"]) == 2


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
    page.complaints = [
        text for text in page.complaints if "CONTEXT_LOST" not in text
    ]  # the browser's own word
    np.testing.assert_array_equal(browsing.shown(page, "picture"), before)


def test_a_name_is_text_whatever_it_says(page):
    assert page.evaluate("window.hostile") is None
    assert page.title() == HOSTILE
    names = page.locator(".lights li:not([hidden]) .name")
    assert names.nth(1).input_value() == HOSTILE[:80]
    assert page.locator("img").count() == 0


def test_a_browser_without_webgl_says_so(browser, path):
    for before, words in (
        ("HTMLCanvasElement.prototype.getContext = () => null", "has no WebGL 2"),
        ("WebGL2RenderingContext.prototype.getExtension = () => null", "float images"),
    ):
        page = browsing.opened(browser, path, ready=False, before=before)
        page.wait_for_selector("[role=alert]")
        assert words in page.locator("[role=alert]").inner_text()
        page.context.close()


def test_an_environment_lights_as_python_s(page, person, tmp_path):
    sky = np.full((32, 64, 3), (0.2, 0.3, 0.5), np.float32)
    sky[8:10, 20:23] = (60, 50, 30)
    relight.write(tmp_path / "sky.hdr", sky)
    page.locator("[aria-label=Environment] input[type=file]").set_input_files(tmp_path / "sky.hdr")
    browsing.wait(page, "Boolean(relight.viewer.state.environment)")
    page.evaluate("relight.viewer.change((state) => { state.lights = []; state.environment.rotation = 70; })")
    browsing.settled(page)
    with page.expect_download() as saved:
        page.keyboard.press("Control+s")
    saved.value.save_as(tmp_path / "page.png")
    (tmp_path / "lights.yaml").write_text(page.evaluate("relight.lights()"))
    lights = relight.read_lights(tmp_path / "lights.yaml")  # which names the map beside it
    assert lights[0].rotation == 70
    relight.write(tmp_path / "python.png", person.relit(lights))
    rmse, largest = compare(*(relight.read(tmp_path / name) for name in ("page.png", "python.png")))
    assert rmse <= RMSE
    assert largest <= LARGEST


def test_a_file_that_is_no_map_is_a_sentence(page, tmp_path):
    for name, words in {
        "sky.exr": "OpenEXR files cannot be opened",
        "notes.png": "is no picture",
        "sky.hdr": "is no Radiance picture",
    }.items():
        (tmp_path / name).write_bytes(b"nothing of the kind")
        page.locator("[aria-label=Environment] input[type=file]").set_input_files(tmp_path / name)
        browsing.wait(page, f"document.querySelector('.message').textContent.includes({words!r})", 20)


def test_all_of_it_by_keyboard(page):
    begun = state(page)
    press(page, "ArrowRight", "Shift+ArrowUp", "+", ".", "j")
    light = state(page)["lights"][0]
    assert (light["azimuth"], light["elevation"], light["exposure"], light["angle"]) == (-39, 40, 0.25, 2)
    assert light["temperature"] < 4500
    press(page, "2", "m", "1", "Delete", "n")
    assert [len(state(page)["lights"]), state(page)["look"]] == [1, "normals"]
    press(page, *["Control+z"] * 9)
    assert state(page)["lights"] == begun["lights"]
    press(page, *["Control+Shift+z"] * 9)
    assert state(page)["look"] == "normals"
    press(page, "?")
    assert page.locator("dialog").is_visible()
    press(page, "Escape")
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


def test_the_panel_fits_a_phone(browser, path):
    page = browsing.opened(browser, path, size=(390, 844))
    parts = "[...document.querySelectorAll('.panel *')]"
    assert max(page.evaluate(f"{parts}.map((one) => one.getBoundingClientRect().right)")) <= 390
    assert page.evaluate("document.querySelector('.picture').getBoundingClientRect().height") > 200
    page.context.close()


def test_the_widget_s_module_draws_with_a_model_of_a_notebook(browser, person, tmp_path):
    scene = scene_of(person.size, relight.DirectionalLight(azimuth=-40, name="key"))
    stub = f"""
        const bytes = fromBase64("{base64.b64encode(pack(person)).decode()}");
        const listeners = [], scene = {json.dumps(scene)};
        const values = {{ scene, pack: new DataView(bytes.buffer), lights: [] }};
        window.model = {{
            get: (key) => values[key],
            set: (key, value) => (values[key] = value),
            save_changes: () => (window.saved = values.lights),
            on: (name, listener) => listeners.push(listener),
            give: (lights) => {{ values.lights = lights; listeners.forEach((listener) => listener()); }},
        }};
        await render({{ model: window.model, el: document.body }});
        window.relight = {{}};
    """
    text = f"<head></head><style>{style()}</style><body></body><script type=module>{module()}{stub}</script>"
    (tmp_path / "widget.html").write_text(text)
    page = browsing.opened(browser, browsing.policed(tmp_path / "widget.html"))
    page.locator(".stage").focus()
    press(page, "ArrowRight")
    assert page.evaluate("saved")[0]["azimuth"] == -39
    given = parameters_of(relight.DirectionalLight(azimuth=90, name="side"))
    page.evaluate("(light) => model.give([light])", given)
    browsing.settled(page)
    assert page.locator(".handle:not([hidden])").get_attribute("aria-label").startswith("side: azimuth 90°")
    assert not page.complaints
    page.context.close()
