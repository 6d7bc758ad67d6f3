"""Each ComfyUI node against the library that it stands for, on a small picture."""

import inspect

import numpy as np
import pytest
import torch
from helpers import ROOT
from helpers.comfyui import codes_of, load_image
from PIL import Image

import relight
from relight.comfyui import NODE_CLASS_MAPPINGS, NODE_DISPLAY_NAME_MAPPINGS, host, tensors
from relight.comfyui.analyse import Analyse
from relight.comfyui.clean_plate import CleanPlate
from relight.comfyui.lights import Environment, Lamp, LightNode, Preset
from relight.comfyui.match import Match
from relight.comfyui.render import Orbit, Passes, Render, orbiting
from relight.comfyui.save_exr import SaveEXR
from relight.comfyui.viewer import Viewer, held_lights

KEY = LightNode().add(-50.0, 30.0, intensity=1.5, colour="1/0.9/0.8", name="key")[0]
TWO = LightNode().add(120.0, 20.0, temperature=3200.0, softness=10.0, name="rim", lights=KEY)[0]


@pytest.fixture(scope="module")
def picture(tmp_path_factory):
    """IMAGE and MASK of a small picture, as Load Image gives them."""
    path = tmp_path_factory.mktemp("input") / "person.png"
    small = Image.open(ROOT / "examples" / "person.png")
    small.resize((126, 246), Image.Resampling.BOX).save(path)
    return load_image(path)


@pytest.fixture(scope="module")
def analysed(picture):
    image, mask = picture
    return Analyse().analyse(image, mask_shows="background", mask=mask)


@pytest.fixture(scope="module")
def batch(analysed):
    return analysed[0]


@pytest.fixture(scope="module")
def reference(picture):
    """The library's own Subject of the same picture, in the same floats: bfloat16 enlarges any difference."""
    image, mask = picture
    return relight.Subject(tensors.light("image", image[0].numpy()), 1 - mask[0].numpy(), height=1.75)


@pytest.fixture
def comfyui(monkeypatch, tmp_path):
    """ComfyUI's folders, which are three."""
    for kind in ("input", "output", "temp"):
        (tmp_path / kind).mkdir()
    monkeypatch.setattr(host, "folder", lambda kind: tmp_path / kind)
    return tmp_path


@pytest.mark.parametrize("name", NODE_CLASS_MAPPINGS)
def test_nodes_describe_what_their_functions_take(name):
    node = NODE_CLASS_MAPPINGS[name]
    inputs = node.INPUT_TYPES()
    described = inputs["required"] | inputs.get("optional", {})
    parameters = dict(inspect.signature(getattr(node, node.FUNCTION)).parameters)
    del parameters["self"]
    assert set(described) == set(parameters)
    for key, (kind, options) in described.items():
        assert len(options["tooltip"]) > 10, key
        default = parameters[key].default
        if "default" in options and default is not inspect.Parameter.empty:
            assert options["default"] == default, key
        if isinstance(kind, list):
            assert options["default"] in kind
    assert len(node.RETURN_TYPES) == len(node.RETURN_NAMES) == len(node.OUTPUT_TOOLTIPS)
    assert NODE_DISPLAY_NAME_MAPPINGS[name].startswith("Relight ")


def test_a_preset_is_that_of_the_library_and_chains():
    lights, gloss = Preset().add("firelight", 0.9, lights=KEY)
    assert [*lights[1:]] == relight.presets(0.9)["firelight"]
    assert lights[0] is KEY[0]
    assert 0 < gloss <= 1
    with pytest.raises(ValueError, match=r"preset: no preset is called .*; there are three-point"):
        Preset().add("candle")


def test_the_light_of_the_background_fills_the_shadows_of_render(batch, reference):
    behind = torch.full((1, 20, 30, 3), 0.6)
    behind[:, :, 15:] = torch.tensor([0.9, 0.4, 0.1])
    none, some, whole = (
        Render().render(batch, KEY, background=behind, fill=fill, exposure=-3)[2] for fill in (0.0, 0.5, 1.0)
    )
    assert float((some - none).mean()) > 0.01
    light = [tensors.light("image", each.numpy()) for each in (none, some, whole)]
    np.testing.assert_allclose(light[2] - light[0], 2 * (light[1] - light[0]), atol=0.01)
    for wrong, said in (
        ({"fill": 0.5}, "fill: expected a background too"),
        ({"fill": 1.5}, "fill: expected"),
    ):
        with pytest.raises(ValueError, match=said):
            Render().render(batch, KEY, **wrong)
        with pytest.raises(ValueError, match=said):
            Render().check_lazy_status(lights=KEY, **wrong)


def test_the_clean_plate_is_the_library_s_and_keeps_what_is_far_from_the_person(picture, batch):
    image, mask = picture
    (found,) = CleanPlate().clean(batch, image)
    plate = tensors.light("image", image[0].numpy())[..., :3]
    torch.testing.assert_close(found, tensors.to_image([batch[0].clean_plate(plate)]))
    far = mask[0] > 0.999  # of Load Image: one minus the alpha
    changed = (found[0] - image[0]).abs().amax(dim=-1) > 0.01
    assert changed[~far].float().mean() > 0.5
    assert changed[far].float().mean() < 0.1
    with pytest.raises(ValueError, match="expected one picture or the same number"):
        CleanPlate().clean([*batch, *batch], image.expand(3, -1, -1, -1))


def test_the_background_of_render_is_blurred_and_relit_as_a_shot_s(batch, reference):
    behind = torch.rand(1, 40, 40, 3, generator=torch.Generator().manual_seed(0)) * 0.5
    plain, blurred, relit = (
        Render().render(batch, KEY, background=behind, **look)[0][0]
        for look in ({}, {"background_blur": 0.1}, {"background_light": 1.0})
    )
    corner = np.s_[:8, :8]
    assert blurred[corner].std(dim=(0, 1)).max() < 0.5 * plain[corner].std(dim=(0, 1)).min()
    assert relit[..., 2][corner].mean() < 0.95 * plain[..., 2][corner].mean()  # the key is yellow


def test_an_orbit_and_files_are_filled_as_render_is(batch, tmp_path):
    behind = torch.full((1, 20, 30, 3), 0.6)
    rendered = Render().render(batch, KEY, background=behind, fill=0.5)[0]
    turned, _ = Orbit().orbit(batch, KEY, 2, turns=0.0, background=behind, fill=0.5)
    np.testing.assert_array_equal(turned[0], rendered[0])
    SaveEXR().save(batch, KEY, str(tmp_path / "filled.####.exr"), background=behind, fill=0.5)
    layers = relight.read_layers(tmp_path / "filled.0001.exr")
    assert {"C_key", "C_background_fill"} <= set(layers)
    picture = relight.read(tmp_path / "filled.0001.exr")[..., :3]
    np.testing.assert_allclose(tensors.to_image([picture], 0.0)[0], rendered[0], atol=0.005)


def test_the_gloss_of_render_and_of_files_is_relit_s(batch, reference, tmp_path):
    rim = (relight.DirectionalLight(azimuth=150, elevation=20, intensity=2, name="rim"),)
    background = torch.zeros((1, 50, 40, 3))
    plain, glossy = (Render().render(batch, rim, background=background, gloss=gloss)[0] for gloss in (0, 0.5))
    assert (glossy - plain).max() > 0.05
    assert (glossy - plain).min() >= -0.01
    SaveEXR().save(batch, rim, str(tmp_path / "rim.exr"), passes="gloss", gloss=0.5)
    expected = reference.relit(rim, gloss=0.5)
    np.testing.assert_allclose(relight.read(tmp_path / "rim.exr"), expected, rtol=2e-3, atol=1e-3)
    assert "gloss_rim" in relight.read_layers(tmp_path / "rim.exr")


def test_render_is_apply(batch, reference, tmp_path):
    lights = [
        relight.DirectionalLight(azimuth=-50, elevation=30, intensity=1.5, colour=(1, 0.9, 0.8), name="key"),
        relight.DirectionalLight(azimuth=120, elevation=20, temperature=3200, angle=10, name="rim"),
    ]
    assert list(TWO) == lights
    background = torch.full((1, 50, 40, 3), 0.5)
    image, mask, white = Render().render(batch, TWO, background=background, exposure=0.5)
    expected = relight.over(reference.relit(lights), background[0].numpy() ** 2.2)
    np.testing.assert_allclose(mask[0], reference.matte, atol=1e-6)
    assert image.shape == (1, 246, 126, 3)
    assert image.min() >= 0
    assert image.max() <= 1
    grey = float(tensors.light("grey", background[0].numpy())[0, 0, 0])
    expected = relight.over(reference.relit(lights), (grey,) * 3)
    relight.write(tmp_path / "expected.png", expected, exposure=0.5)
    written = np.asarray(Image.open(tmp_path / "expected.png"), np.float32)
    assert np.abs(image[0].numpy() * 255 - written).max() <= 0.51
    shading = reference.lighting(lights)
    relight.write(tmp_path / "white.png", shading, exposure=0.5)
    written = np.asarray(Image.open(tmp_path / "white.png"), np.float32)
    assert np.abs(white[0].numpy() * 255 - written).max() <= 0.51


def test_without_a_background_the_image_is_straight_colour_for_its_mask(batch, reference, tmp_path):
    image, mask, _ = Render().render(batch, KEY)
    relight.write(tmp_path / "expected.png", reference.relit(KEY))
    written = np.asarray(Image.open(tmp_path / "expected.png"), np.float32) / 255
    inside = written[..., 3] > 0.5
    assert np.abs(image[0].numpy() - written[..., :3])[inside].max() < 0.003
    assert np.abs(mask[0].numpy() - written[..., 3]).max() < 0.003


def test_masks_of_both_kinds_and_alpha(picture):
    image, mask = picture
    size = image.shape[1:3]
    person = tensors.mattes("mask", 1 - mask, size, "person")
    np.testing.assert_allclose(tensors.mattes("mask", mask, size, "background"), person, atol=1e-6)
    four = torch.cat([image, 1 - mask[..., None]], dim=-1)
    premultiplied = tensors.light("image", tensors.pictures("image", four)[0])
    np.testing.assert_allclose(premultiplied[..., 3], person[0], atol=1e-6)
    assert not premultiplied[..., :3][person[0] == 0].any()


def test_values_above_one_are_not_clipped():
    linear = tensors.light("image", np.full((2, 2, 3), 2.0, np.float32))
    assert linear.min() == pytest.approx(((2 + 0.055) / 1.055) ** 2.4, rel=1e-4)
    sky = torch.full((1, 8, 16, 3), 3.0)
    (light,) = Environment().add(image=sky, intensity=0.5)[0]
    assert light.image.pixels.max() == pytest.approx(((3 + 0.055) / 1.055) ** 2.4, rel=1e-4)
    frames = [np.full((4, 4, 3), value, np.float32) for value in (0.3, 5.0)]
    shown = tensors.to_image(frames)
    assert shown[1].max() == pytest.approx(1, abs=1e-5)
    assert shown[0].max() == pytest.approx(1.055 * 0.3 ** (1 / 2.4) - 0.055, abs=1e-4)


def test_a_pixel_that_is_not_changed_keeps_its_code_in_save_image():
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, axis=2)
    image = tensors.to_image([tensors.light("image", codes / np.float32(255))])
    np.testing.assert_array_equal(codes_of(image)[0], codes)


def test_halves_and_other_devices_come_back_on_the_cpu_in_floats(batch):
    image, mask, _ = Render().render(batch, KEY, background=torch.zeros(1, 8, 8, 3, dtype=torch.float16))
    assert {tensor.dtype for tensor in (image, mask)} == {torch.float32}
    assert {tensor.device.type for tensor in (image, mask)} == {"cpu"}


def test_pictures_of_the_maps(analysed, reference):
    _, albedo, normals, depth = analysed
    inside = reference.matte > 0.9
    np.testing.assert_allclose(normals[0].numpy()[inside] * 2 - 1, reference.normals[inside], atol=1e-5)
    assert normals[0, 0, 0].tolist() == [0.5, 0.5, 1.0]
    linear = tensors.light("albedo", albedo[0].numpy())
    np.testing.assert_allclose(linear[inside], reference.albedo[inside], atol=1e-3)
    near = depth[0, ..., 0].numpy()
    assert np.corrcoef(near[inside], -reference.depth[inside])[0, 1] > 0.999
    assert (near.min(), near.max()) == (0, 1)


def test_maps_from_elsewhere_take_the_place_of_what_is_found(picture, analysed):
    image, mask = picture
    batch, _, normals, depth = analysed
    turned = normals.clone()
    turned[..., 1] = 1 - turned[..., 1]
    _, _, same, near = Analyse().analyse(
        image, mask_shows="background", mask=mask, normals=turned, normal_axes="+x-y+z", depth=1 - depth
    )
    inside = batch[0].matte > 0.99
    cosine = ((same[0] * 2 - 1) * (normals[0] * 2 - 1)).sum(dim=-1).numpy()[inside]
    assert np.quantile(cosine, 0.05) > 0.95
    assert np.corrcoef(near[0, ..., 0].numpy()[inside], depth[0, ..., 0].numpy()[inside])[0, 1] > 0.97


def test_passes_sum_to_the_picture(batch, reference):
    visibility, shading, groups, names = Passes().passes(batch, TWO)
    assert names == "key\nrim"
    assert len(visibility) == len(shading) == len(groups) == 2
    np.testing.assert_allclose(visibility[0, ..., 0], reference.unshadowed(KEY[0]), atol=1e-4)
    inside = reference.matte > 0.99
    linear = sum(tensors.light("group", group.numpy())[inside] for group in groups)
    if float(groups.max()) < 1:  # no roll-off
        np.testing.assert_allclose(linear, reference.relit(TWO)[inside][:, :3], atol=0.01)


def test_orbit_turns_lights_as_moving_lights_turn(batch):
    sky = torch.rand(1, 8, 16, 3)
    lights = Lamp().add(-0.8, 0.5, 0.8, radius=0.05, name="lamp", lights=KEY)[0]
    lights = Environment().add(rotation=10.0, image=sky, name="sky", lights=lights)[0]
    key, lamp, turned = (orbiting(light, 4)(2) for light in lights)
    assert key.azimuth == pytest.approx(40)
    assert (key.elevation, key.name) == (pytest.approx(30), "key")
    assert lamp.position == pytest.approx((0.8, 0.5, 0.8))
    assert (turned.rotation, turned.image) == (100, lights[2].image)
    images, masks = Orbit().orbit(batch, KEY, 3)
    back, _ = Orbit().orbit(batch, KEY, 3, turns=-1.0)
    assert len(images) == len(masks) == 3
    np.testing.assert_allclose(images[0], Render().render(batch, KEY)[0][0], atol=1e-4)
    np.testing.assert_allclose(images[1], back[2], atol=1e-4)
    assert float((images[0] - images[1]).abs().mean()) > 0.01
    np.testing.assert_array_equal(*Orbit().orbit(batch, KEY, 2, turns=0.0)[0])


def test_match_finds_the_light_of_the_place(batch, reference):
    place = torch.zeros(2, 60, 120, 3)
    place[:, :, :40] = 0.9
    lights = Match().match(batch, background=place, lights=KEY)[0]
    assert [light.name for light in lights] == ["key", "plate"]
    bright = reference.lighting(lights[1]).sum(axis=-1)
    assert bright[:, :63].sum() > bright[:, 63:].sum()


@pytest.mark.slow
def test_match_finds_the_lights_of_a_reference(batch, picture):
    image, mask = picture
    found = Match().match(batch, "background", reference=image, reference_mask=mask)[0]
    expected = relight.match(batch[0], tensors.light("image", image[0].numpy()), mask=1 - mask[0].numpy())
    assert [light.name for light in found] == [light.name for light in expected]
    np.testing.assert_allclose(found[0].power, expected[0].power, rtol=1e-3)


@pytest.mark.filterwarnings("error:The given NumPy array is not writable")
def test_exr_holds_the_groups_of_each_frame(batch, comfyui):
    place = torch.rand(2, 20, 20, 3)
    saved = SaveEXR().save(
        batch, TWO, "shots/relit.####.exr", first_frame=7, passes="albedo, Z", background=place
    )
    files = [comfyui / "output" / "shots" / f"relit.{number:04d}.exr" for number in (7, 8)]
    assert saved["ui"]["text"] == [str(file) for file in files]
    assert saved["result"] == (str(files[0]),)
    for file in files:
        layers = relight.read_layers(file)
        assert {"C_key", "C_rim", "C_background", "albedo", "Z"} <= set(layers)
        total = sum(layers[name][..., :3] for name in ("C_key", "C_rim", "C_background"))
        np.testing.assert_array_equal(total.astype(np.float16), relight.read(file).astype(np.float16))


def test_the_viewer_keeps_its_page_and_gives_the_lights_that_it_holds(batch, comfyui, monkeypatch):
    def view(subject, path, lights, background):
        assert subject is batch.shown
        path.write_text(" ".join(light.name for light in lights))

    monkeypatch.setattr(relight.Subject, "view", view)  # the page itself is tested in test_extension.py
    node = Viewer()
    first = node.show(batch, lights=TWO)
    assert first["result"] == (TWO,)
    (page,) = first["ui"]["relight_viewer"]
    assert page["type"] == "temp"
    assert (comfyui / "temp" / page["filename"]).read_text() == "key rim"
    held = "light=key%3Aazimuth%3D60%2Celevation%3D10%2Cintensity%3D1.5&look=normals"
    second = node.show(batch, lights=TWO, held=held)
    assert second["ui"] == first["ui"]
    assert second["result"][0] == (
        relight.DirectionalLight(azimuth=60, elevation=10, intensity=1.5, name="key"),
    )
    assert node.show(batch, lights=KEY)["ui"] != first["ui"]


def test_what_is_held_reads_as_the_page_writes_it():
    sky = relight.EnvironmentLight(np.ones((4, 8, 3), np.float32), name="sky")
    held = "light=a:azimuth=1,elevation=2&light=b:position=0/1/2,radius=0.1&light=azimuth=9,elevation=0"
    a, b, c = held_lights(held, (sky,))
    assert b == relight.PointLight((0, 1, 2), radius=0.1, name="b")
    assert held_lights(f"{held}&muted=1", ()) == (b, c)
    assert held_lights(f"#{held}&muted=1&solo=1 3", ()) == (c,)
    assert held_lights("light=none", (sky, a)) == ()
    assert held_lights("light=none&environment=none", (sky,)) == held_lights(
        "environment=none&light=none", ()
    )
    assert held_lights("", (sky, a)) == (sky, a)
    (turned,) = held_lights("light=none&environment=rotation%3D30%2Cexposure%3D1", (sky,))
    assert (turned.image, turned.rotation, turned.exposure) == (sky.image, 30, 1)
    assert held_lights("light=none&environment=rotation%3D30&dark=1", (sky,)) == ()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda image, mask, batch: Analyse().analyse(image), "relight fetch person brings them"),
        (
            lambda image, mask, batch: Analyse().analyse(image, mask=torch.zeros(1, 64, 64)),
            "mask: is the empty mask that Load Image gives",
        ),
        (
            lambda image, mask, batch: Analyse().analyse(image, mask=mask[:, 1:]),
            "mask: expected the size of its image, 126 x 246 pixels, got 126 x 245",
        ),
        (
            lambda image, mask, batch: Analyse().analyse(image.repeat(3, 1, 1, 1), mask=mask.repeat(2, 1, 1)),
            "batches: expected one picture or the same number in each; image has 3, mask has 2",
        ),
        (lambda image, mask, batch: Analyse().analyse(image[0], mask=mask), "image: expected an IMAGE"),
        (lambda image, mask, batch: Analyse().analyse(image * np.nan, mask=mask), "image: contains NaN"),
        (lambda image, mask, batch: Render().render(batch, (*KEY, *KEY)), "lights: expected different names"),
        (
            lambda image, mask, batch: Render().render(batch, KEY, floor="height=1.5"),
            "floor: expected a back",
        ),
        (lambda image, mask, batch: Passes().passes(batch, ()), "lights: expected at least one"),
        (
            lambda image, mask, batch: LightNode().add(0.0, 0.0, colour="rde"),
            "colour: expected linear red",
        ),
        (
            lambda image, mask, batch: LightNode().add(0.0, 0.0, temperature=300.0),
            "temperature: expected a number of kelvin from 1000 to",
        ),
        (lambda image, mask, batch: Environment().add(), "environment: expected a path or an image"),
        (lambda image, mask, batch: Environment().add("none.exr"), "no such file"),
        (lambda image, mask, batch: Environment().add(image=image), "expected a map twice as wide as high"),
        (lambda image, mask, batch: Match().match(batch), "match: expected a reference or a background"),
        (lambda image, mask, batch: Match().match(batch, reference=image), "reference_mask: expected the"),
        (lambda image, mask, batch: SaveEXR().save(batch, KEY, "../a.exr"), "leads out of ComfyUI's output"),
        (lambda image, mask, batch: SaveEXR().save(batch, KEY, "a.png"), "ends in .exr"),
        (
            lambda image, mask, batch: SaveEXR().save(
                batch, KEY, "a.exr", background=image.repeat(2, 1, 1, 1)
            ),
            "expected a frame number such as #### for 2 frames",
        ),
        (lambda image, mask, batch: held_lights("light=none&environment=rotation=1", ()), "was dropped on"),
    ],
)
def test_errors_are_one_line(call, message, picture, batch, comfyui):
    with pytest.raises((ValueError, TypeError, FileNotFoundError, ImportError)) as error:
        call(*picture, batch)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
    assert not list((comfyui / "output").rglob("*.exr"))


@pytest.mark.slow
def test_a_batch_is_one_shot_or_separate_pictures(picture):
    image, mask = picture
    frames = torch.cat([image[:, :, x : x + 110] for x in (0, 2, 5)])
    masks = torch.cat([mask[:, :, x : x + 110] for x in (0, 2, 5)])
    shot = Analyse().analyse(frames, mask_shows="background", mask=masks)[0]
    assert {person.camera for person in shot} == {shot[0].camera}
    plates = [tensors.light("plate", frame.numpy()) for frame in frames]
    first = relight.Subject(plates[0], 1 - masks[0].numpy(), height=1.75)
    people = [first] + [relight.Subject(plates[n], 1 - masks[n].numpy(), camera=first.camera) for n in (1, 2)]
    light = relight.PointLight((-0.6, 0.4, 0.8))
    expected = people[1].temporally_filtered([people[0], people[2]]).relit(light)
    np.testing.assert_allclose(shot[1].relit(light), expected, atol=1e-6)
    separate = Analyse().analyse(frames, mask_shows="background", mask=masks, batch="separate pictures")[0]
    own = relight.Subject(plates[1], 1 - masks[1].numpy(), height=1.75)
    np.testing.assert_array_equal(separate[1].relit(light), own.relit(light))
    assert np.abs(own.relit(light) - expected).max() > 1e-3


@pytest.mark.parametrize("name", ["RelightRender", "RelightOrbit", "RelightPasses", "RelightSaveEXR"])
def test_what_does_not_fit_is_refused_before_the_person_is_analysed(name):
    """ComfyUI asks a node with a lazy input what it still needs, when it has the others."""
    kind = NODE_CLASS_MAPPINGS[name]
    assert kind.INPUT_TYPES()["required"]["subject"][1]["lazy"]
    (key,) = LightNode().add(-40.0, 30.0, name="key")
    assert kind().check_lazy_status(subject=None, lights=key) == ["subject"]
    assert kind().check_lazy_status(subject=3, lights=key) == []
    with pytest.raises(ValueError, match="lights: expected different names, got key, key"):
        kind().check_lazy_status(subject=None, lights=(*key, *key))
    with pytest.raises(ValueError, match="floor: expected a background too"):
        kind().check_lazy_status(subject=None, lights=key, floor="height=1.5")


def test_a_mask_of_the_background_is_named_in_the_console(caplog):
    person = torch.zeros(2, 30, 20)
    person[:, 5:, 4:16] = 1  # cut by the lower edge
    for mask, shows, wrong in (
        (person, tensors.PERSON, False), (1 - person, tensors.BACKGROUND, False),
        (1 - person, tensors.PERSON, True), (person, tensors.BACKGROUND, True),
    ):  # fmt: skip
        caplog.clear()
        tensors.mattes("mask", mask, (30, 20), shows)
        assert ("mask: covers the edges of the image" in caplog.text) == wrong
        other = tensors.PERSON if shows == tensors.BACKGROUND else tensors.BACKGROUND
        assert not wrong or f"set mask_shows to {other}" in caplog.text
