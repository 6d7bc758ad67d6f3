"""The viewer's page in a real browser: the same light as Python's."""

import base64
import json
import shlex

import numpy as np
import pytest
import torch
from helpers import ROOT, browsing, shipped
from scipy.ndimage import binary_erosion

import relight
from relight.compositing.composite import backdrop
from relight.compositing.defocus import defocused
from relight.lights.plate import whole_field_of_view
from relight.media.colour import encode
from relight.pipeline.options import Lighting
from relight.rendering import background_factor
from relight.viewer.initial_state import parameters_of, scene_of
from relight.viewer.packing import pack
from relight.viewer.page import module, style

pytest.importorskip("playwright")
pytestmark = browsing.NEEDS_CHROMIUM

RMSE, LARGEST = 0.01, 0.08  # of the encoded picture; the largest away from the matte's rim


def subject_of(name):
    """The bundled person, or one of the light stage, analysed on the canvas of the networks."""
    if name == "person":
        person = relight.read(ROOT / "examples" / "person.png")
        return relight.Subject(np.ascontiguousarray(person[::2, ::2]))
    scene = next(scene for scene in shipped.scenes() if scene.name == name)
    matte = scene.mask.float().numpy()[..., None]
    return relight.Subject(
        np.concatenate([scene.photograph.numpy() * matte, matte], axis=-1, dtype=np.float32)
    )


def compare(found, truth):
    """(RMSE, largest difference away from the rim) of two pictures, encoded for a display of white 4."""
    assert np.abs(found[..., 3] - truth[..., 3]).max() < 3e-3
    covered = truth[..., 3] > 0
    shown, meant = (encode(picture[covered][None, :, :3].clip(0), white=4)[0] for picture in (found, truth))
    inside = binary_erosion(truth[..., 3] > 0.99, iterations=3)[covered]
    return float(np.sqrt(((shown - meant) ** 2).mean())), float(np.abs(shown - meant)[inside].max())


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("person", 3),
        pytest.param("person", 32, marks=pytest.mark.slow),
        pytest.param("body-generalisation-000007-00", 32, marks=pytest.mark.slow),
        pytest.param("body-generalisation-000023-00", 32, marks=pytest.mark.slow),
    ],
)
def test_the_page_relights_as_python_does(name, count, browser, tmp_path):
    subject = subject_of(name)
    random = np.random.default_rng(3)
    lights = [
        relight.DirectionalLight(
            random.normal(size=3),
            angle=0 if number % 8 else 40,
            intensity=2,
            colour=(1, 0.8, 0.6),
            temperature=None if number % 4 else 3000,
        )
        for number in range(count)
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
    ten = (lights * 4)[:10]  # more than the page has slots
    both = browsing.rendered(page, [list(map(parameters_of, ten))])[0]
    assert compare(both, subject.relit(ten))[0] <= RMSE
    assert not page.complaints
    page.context.close()


@pytest.mark.slow
def test_gloss_is_python_s(page, viewed):
    lights = [
        relight.DirectionalLight(azimuth=150, elevation=20, intensity=3),
        relight.DirectionalLight(azimuth=-120, elevation=30, angle=30, colour=(1, 0.8, 0.6)),
        relight.DirectionalLight(azimuth=180, elevation=50, intensity=2),
        relight.PointLight((0.6, 0.3, -0.6), radius=0.1),
    ]
    given = list(map(parameters_of, lights))
    for light, found in zip(lights, browsing.rendered(page, given, gloss=0.8), strict=True):
        truth = viewed.relit(light, gloss=0.8)
        rmse, largest = compare(found, truth)
        assert rmse <= RMSE
        assert largest <= LARGEST
        assert np.abs(truth - viewed.relit(light)).max() > 0.02
    assert browsing.state(page)["gloss"] == 0
    page.get_by_label("Gloss, exactly").fill("0.5")
    page.get_by_label("Gloss, exactly").press("Enter")
    browsing.settled(page)
    assert "--gloss 0.5" in page.evaluate("relight.command()")
    assert "gloss=0.5" in page.evaluate("relight.link()")


@pytest.mark.slow
def test_the_background_keeps_its_codes_in_bright_light(page, viewed):
    wall = [0.78, 0.79, 0.75]
    change = "(state) => { state.background = wall; state.lights[0].intensity = 20; }"
    page.evaluate(f"(wall) => relight.viewer.change({change})", wall)
    browsing.settled(page)
    data = page.evaluate(
        "() => Array.from(relight.viewer.engine.readShown('picture', { exposure: 0,"
        " background: relight.viewer.shownBackground() }).data)"
    )
    found = np.reshape(data, (*viewed.size, 4))
    expected = np.rint(encode(np.float32([[wall]]), white=1)[0, 0] * 255)
    np.testing.assert_allclose(found[0, 0], [*expected, 255], atol=1)
    assert found[viewed.matte == 1][:, :3].max() >= 254


@pytest.mark.slow
def test_near_lights_are_python_s(page, viewed):
    lights = [
        relight.PointLight((-0.6, 0.4, 0.8)),
        relight.PointLight((0.5, 0.2, 0.3), radius=0.2, colour=(1, 0.8, 0.6), exposure=-1),
        relight.PointLight((0.6, 0.3, -0.6), radius=0.1, temperature=3000),
        relight.PointLight((0, -0.7, 0.6), intensity=0.3),
    ]
    given = list(map(parameters_of, lights))
    for light, found in zip(lights, browsing.rendered(page, given), strict=True):
        rmse, largest = compare(found, viewed.relit(light))
        assert rmse <= RMSE
        assert largest <= LARGEST
    inside = given[0] | {"position": [0, 0, -0.05]}
    refused = page.evaluate("(light) => relight.render([light]).catch((error) => error.message)", inside)
    with pytest.raises(ValueError, match=refused.split(";")[0]):
        viewed.relit(relight.PointLight(inside["position"]))
    page.evaluate("(light) => relight.viewer.change((state) => (state.lights = [light]))", inside)
    browsing.wait(page, "document.querySelector('.message').textContent.includes('the person')", 20)
    browsing.press(page, "PageDown", *["Shift+PageDown"] * 3)
    assert browsing.state(page)["lights"][0]["position"][2] > 1
    assert page.locator(".message").inner_text() == ""


@pytest.mark.slow
def test_the_visibility_of_near_and_distant_lights_is_weighed_by_what_arrives(page, viewed):
    lights = [relight.PointLight((-0.6, 0.4, 0.8), radius=0.1), relight.DirectionalLight(azimuth=60)]
    page.evaluate(
        "(lights) => relight.viewer.change((state) => lights.forEach((light, at) => "
        "Object.assign((state.lights[at] = { muted: false, solo: false }), light)))",
        list(map(parameters_of, lights)),
    )
    browsing.settled(page)
    found = browsing.shown(page, "visibility")[..., 0]
    camera, depth = viewed.camera, torch.tensor(viewed.depth)
    rows, columns = torch.meshgrid(*(torch.arange(side) + 0.5 for side in viewed.size), indexing="ij")
    ways = torch.tensor(lights[0].position)[:, None, None] - camera.positions(columns, rows, depth)
    arriving = (1 / (ways**2).sum(dim=0)).numpy()
    near, far = map(viewed.unshadowed, lights)
    inside = binary_erosion(viewed.matte > 0.99, iterations=5)
    truth = (near * arriving + far) / (arriving + 1)
    assert np.sqrt(((found - truth)[inside] ** 2).mean()) < 0.02


def test_its_lights_file_gives_the_same_picture_and_its_png_is_apply_s(page, viewed, tmp_path):
    browsing.drag(page, -0.5, 0.6)
    browsing.press(page, "+", ".", ".", "2", "m", "a", "k")
    (tmp_path / "lights.yaml").write_text(page.evaluate("relight.lights()"))
    lights = relight.read_lights(tmp_path / "lights.yaml")
    assert [light.name for light in lights] == ["key", "rim"]  # the muted one does not shine
    assert lights[0].exposure == 0.25
    assert lights[0].angle == 4
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save PNG").click()
    saved.value.save_as(tmp_path / "page.png")
    picture = viewed.relit(lights)
    relight.write(tmp_path / "python.png", picture)
    found, truth = (relight.read(tmp_path / name) for name in ("page.png", "python.png"))
    rmse, largest = compare(found, truth)
    assert rmse <= RMSE
    assert largest <= LARGEST

    words = shlex.split(page.evaluate("relight.command()"))
    assert words[:3] == ["relight", "apply", "it's.png"]
    given = [words[at + 1] for at, word in enumerate(words) if word == "--light"]
    assert Lighting(light=tuple(given)).rig().lights == lights


@pytest.mark.slow
@pytest.mark.parametrize("with_sky", [False, True])
def test_the_background_fills_shadows_as_python_s(browser, viewed, tmp_path, with_sky):
    wall = np.full((60, 40, 3), (0.1, 0.3, 0.4), np.float32)
    wall[:, 25:] = 0.8, 0.3, 0.1
    sky = np.full((8, 16, 3), (0.1, 0.1, 0.3), np.float32)
    lights = [relight.DirectionalLight(azimuth=-70, elevation=15, name="key")]
    lights += [relight.EnvironmentLight(sky, rotation=30)] if with_sky else []
    file = viewed.view(tmp_path / "page.html", lights, background=wall, background_name="wall.png", fill=0.5)
    page = browsing.opened(browser, browsing.policed(file))
    whole = whole_field_of_view(wall.shape, viewed.size, viewed.camera.field_of_view)
    dark = viewed.relit(lights)
    for share in (0.5, 0, 1):
        page.get_by_label("Fill, exactly").fill(str(share))
        page.get_by_label("Fill, exactly").press("Enter")
        browsing.settled(page)
        data = page.evaluate("() => Array.from(relight.viewer.engine.read().data)")
        fill = relight.EnvironmentLight.from_plate(wall, whole, intensity=share)
        truth = viewed.relit([*lights, fill])
        rmse, largest = compare(np.reshape(data, truth.shape), truth)
        assert rmse <= RMSE
        assert largest <= LARGEST
        assert (np.abs(truth - dark).max() > 0.05) == (share > 0)
        words = shlex.split(page.evaluate("relight.command()"))
        given = words[words.index("--fill") :][:4] if share else []
        assert given == (["--fill", "background", "--fill-amount", str(share)] if share else [])
        assert (f"fill={share}" in page.evaluate("relight.link()")) == (share > 0)
    page.evaluate("relight.viewer.setBackgroundKind('colour')")
    browsing.settled(page)
    assert page.get_by_label("Fill, exactly").is_hidden()
    assert "--fill" not in page.evaluate("relight.command()")
    assert not page.complaints
    page.context.close()


@pytest.mark.slow
def test_the_background_is_out_of_focus_and_relit_as_python_has_it(browser, viewed, tmp_path):
    wall = (
        np.random.default_rng(0).uniform(0.05, 0.5, (30, 20, 3)).astype(np.float32).repeat(8, 0).repeat(8, 1)
    )
    key = relight.DirectionalLight(azimuth=-70, intensity=0.6, colour=(1, 0.6, 0.3), name="key")
    file = viewed.view(
        tmp_path / "page.html", key, background=wall, background_blur=0.05, background_light=0.8
    )
    page = browsing.opened(browser, browsing.policed(file))
    height, width, data = page.evaluate(
        """() => {
            const { viewer } = relight;
            viewer.redraw();
            const { exposure, blur, backgroundLight } = viewer.state;
            const settings = { exposure, blur, backgroundLight, background: viewer.shownBackground() };
            const { width, height, data } = viewer.engine.readShown("picture", settings);
            return [height, width, Array.from(data)];
        }"""
    )
    shown = np.reshape(np.array(data, np.float32), (height, width, 4))[..., :3] / 255
    factor = background_factor(viewed, viewed.relit(key), 0.8)
    back = defocused(backdrop(wall, viewed.size), 0.05)
    away = viewed.matte == 0
    difference = np.abs(shown - encode(np.clip(back * factor, 0, 1), white=1))[away]
    assert difference.mean() < 0.01
    assert np.abs(encode(back, white=1)[away] - shown[away]).mean() > 0.03
    assert "--background-blur 0.05 --background-light 0.8" in page.evaluate("relight.command()")
    assert {"blur=0.05", "backgroundLight=0.8"} <= set(page.evaluate("relight.link()").split("&"))
    assert not page.complaints
    page.context.close()


@pytest.mark.slow
def test_an_environment_lights_as_python_s(page, viewed, tmp_path):
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
    relight.write(tmp_path / "python.png", viewed.relit(lights))
    rmse, largest = compare(*(relight.read(tmp_path / name) for name in ("page.png", "python.png")))
    assert rmse <= RMSE
    assert largest <= LARGEST


@pytest.mark.slow
def test_the_widget_s_module_draws_with_a_model_of_a_notebook(browser, viewed, tmp_path):
    scene = scene_of(viewed.size, relight.DirectionalLight(azimuth=-40, name="key"))
    packed = pack(viewed.record, viewed.matte, viewed.albedo)
    stub = f"""
        const bytes = fromBase64("{base64.b64encode(packed).decode()}");
        const scene = {json.dumps(scene)};
        const values = {{ scene, pack: new DataView(bytes.buffer), lights: [], gloss: 0 }};
        const heard = {{}};
        window.model = {{
            get: (key) => values[key],
            set: (key, value) => (values[key] = value),
            save_changes: () => Object.assign(window, {{ saved: values.lights, glossy: values.gloss }}),
            on: (name, listener) => (heard[name] = listener),
            give: (lights) => {{ values.lights = lights; heard["change:lights"](); }},
            polish: (gloss) => {{ values.gloss = gloss; heard["change:gloss"](); }},
        }};
        await render({{ model: window.model, el: document.body }});
        window.relight = {{}};
    """
    text = f"<head></head><style>{style()}</style><body></body><script type=module>{module()}{stub}</script>"
    (tmp_path / "widget.html").write_text(text)
    page = browsing.opened(browser, browsing.policed(tmp_path / "widget.html"))
    page.locator(".stage").focus()
    browsing.press(page, "ArrowRight")
    assert page.evaluate("saved")[0]["azimuth"] == -39
    given = parameters_of(relight.DirectionalLight(azimuth=90, name="side"))
    page.evaluate("(light) => model.give([light])", given)
    browsing.settled(page)
    assert page.locator(".handle:not([hidden])").get_attribute("aria-label").startswith("side: azimuth 90°")
    # Python's lights take the place of those that shine; a muted one stays, and an echo is no change.
    browsing.press(page, "a", "m", "1")
    page.evaluate("(light) => model.give([{ ...light, azimuth: 80 }])", given)
    browsing.settled(page)
    assert page.locator(".handle:not([hidden])").count() == 2
    assert [light["azimuth"] for light in page.evaluate("saved")] == [80]
    page.locator(".stage").focus()
    browsing.press(page, "2", "m", "1", "s")  # both would shine but for the solo of the first
    page.evaluate("model.give([])")
    browsing.settled(page)
    assert page.locator(".handle:not([hidden])").count() == 1
    assert page.evaluate("saved") == []
    page.evaluate("(light) => model.give([light])", given)
    page.locator(".stage").focus()
    browsing.press(page, "Shift+ArrowRight")
    sent = page.evaluate("saved")
    assert all(round(light["azimuth"], 4) == light["azimuth"] for light in sent)
    slider = page.get_by_role("slider", name="Gloss")
    page.evaluate("model.polish(0.4)")
    browsing.settled(page)
    assert slider.input_value() == "0.4"
    slider.fill("0.7")
    browsing.settled(page)
    assert page.evaluate("glossy") == 0.7
    assert not page.complaints
    page.context.close()
