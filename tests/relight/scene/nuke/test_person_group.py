"""The exported Nuke group against `Subject.relit`, by an interpreter of scripts."""

import functools

import numpy as np
import pytest
from helpers import ROOT, damage, nuke_scripts, shipped
from helpers.nuke_scripts import NukeModule, Player, Script

import relight
from relight.scene.nuke import callback
from shadow.networks.field import KAPPA

KEY = relight.DirectionalLight(azimuth=-40, elevation=30, name="key")
RIM = relight.DirectionalLight(
    azimuth=150, elevation=20, colour=(0.4, 0.6, 1), intensity=1.5, exposure=1, angle=20, name="rim"
)
# Directions of each person; and each how many pixels of the photograph are seen.
FEW_OR_MANY = [(4, 2), pytest.param(12, 1, marks=pytest.mark.slow)]


@functools.cache
def people(step=2):
    """Three people of the light stage, analysed by the shipped weights, in every `step`-th pixel."""
    with damage.small_canvas(damage.SHIPPED_CANVAS // step):
        return [
            relight.Subject(scene.photograph[::step, ::step].numpy(), scene.mask[::step, ::step].numpy())
            for scene in shipped.scenes()
        ]


@pytest.fixture
def subjects():
    return people()


def exported(subject, folder, lights=None, **settings):
    path = subject.export(folder / "person.nk", lights, **settings)
    script = Script(path.read_text())
    return script, script["Relight"], Player(folder)


def difference(picture, subject, lights, gloss=0.0, amount=1.0):
    """RMS over the matte."""
    inside = subject.matte > 0
    return float(np.sqrt(((picture - subject.relit(lights, gloss, amount))[inside][:, :3] ** 2).mean()))


@pytest.mark.parametrize(("directions", "step"), FEW_OR_MANY)
def test_the_group_is_what_relit_gives(tmp_path, directions, step):
    """For directions all around, set by the callback; beside it the script as it was written."""
    rng, errors = np.random.default_rng(0), []
    for subject in people(step):
        _, group, player = exported(subject, tmp_path, KEY)
        assert difference(player.rgba(group), subject, KEY) <= 0.01
        for _ in range(directions):
            light = relight.DirectionalLight(rng.normal(size=3))
            group.knobs |= {"light1_azimuth": repr(light.azimuth), "light1_elevation": repr(light.elevation)}
            NukeModule(group).run()
            errors.append(difference(player.rgba(group), subject, light))
    assert max(errors) <= 0.003
    assert callback.KAPPA == KAPPA
    np.testing.assert_allclose(player.rgba(group)[..., 3], subject.matte, atol=1e-3)


def test_four_lights_with_colour_exposure_and_softness(subjects, tmp_path):
    subject = subjects[0]
    lights = [
        KEY,
        RIM,
        relight.DirectionalLight(azimuth=60, elevation=-10, angle=60, intensity=0.3, temperature=3200),
        relight.DirectionalLight(azimuth=10, elevation=80, angle=30),
    ]
    _, group, player = exported(subject, tmp_path, lights)
    assert difference(player.rgba(group), subject, lights) <= 0.01
    # A light that is switched off, and one whose colour changes: no callback takes part.
    group.knobs |= {"light1_on": "false", "light2_colour": "1 1 1", "light2_exposure": "0"}
    white = relight.DirectionalLight(azimuth=150, elevation=20, angle=20)
    assert difference(player.rgba(group), subject, [white, *lights[2:]]) <= 0.01
    # Softness alone: the callback spreads the light's directions.
    group.knobs |= {"light2_on": "false", "light3_on": "false", "light4_softness": "0"}
    before = player.rgba(group)
    NukeModule(group).run()
    hard = relight.DirectionalLight(azimuth=10, elevation=80)
    assert difference(player.rgba(group), subject, hard) <= 0.005 < difference(before, subject, hard)


@pytest.mark.parametrize(("directions", "step"), FEW_OR_MANY)
def test_the_gloss_is_that_of_relit(tmp_path, directions, step):
    """Of lights behind, where it is strongest; the knob alone changes it."""
    rng, errors, added = np.random.default_rng(1), [], []
    for subject in people(step):
        _, group, player = exported(subject, tmp_path, KEY, gloss=1)
        for _ in range(directions // 2):
            light = relight.DirectionalLight(azimuth=180 + rng.uniform(-60, 60), elevation=rng.uniform(0, 60))
            group.knobs |= {"light1_azimuth": repr(light.azimuth), "light1_elevation": repr(light.elevation)}
            NukeModule(group).run()
            picture = player.rgba(group)
            errors.append(difference(picture, subject, light, gloss=1))
            added.append(difference(picture, subject, light))
            group.knobs["gloss"] = "0.5"
            errors.append(difference(player.rgba(group), subject, light, gloss=0.5))
            group.knobs["gloss"] = "1"
    assert max(errors) <= 0.005
    assert max(added) > 0.02


def test_the_amount_mixes_with_the_photograph(subjects, tmp_path):
    """The script begins with it; the knob alone changes it, down to the photograph itself."""
    subject = subjects[0]
    _, group, player = exported(subject, tmp_path, [KEY, RIM], amount=0.3)
    assert difference(player.rgba(group), subject, [KEY, RIM], amount=0.3) <= 0.005
    group.knobs["amount"] = "0"
    assert difference(player.rgba(group), subject, [], amount=0) <= 0.0005
    np.testing.assert_allclose(player.rgba(group)[..., 3], subject.matte, atol=1e-3)
    with pytest.raises(ValueError, match=r"amount: .*person\.glb holds lights alone.*got 0\.3"):
        subject.export(tmp_path / "person.glb", KEY, amount=0.3)


def test_an_axis_on_an_input_moves_its_light(subjects, tmp_path):
    subject = subjects[1]
    _, group, player = exported(subject, tmp_path, [KEY, RIM])
    axis = nuke_scripts.spherical(70, 40)
    NukeModule(group, {2: axis}).run("updateUI")
    moved = relight.DirectionalLight(azimuth=70, elevation=40, colour=RIM.colour, intensity=3, angle=20)
    assert difference(player.rgba(group), subject, [KEY, moved]) <= 0.01


def test_animated_knobs_become_keys(subjects, tmp_path):
    subject = subjects[1]
    _, group, player = exported(subject, tmp_path, KEY)
    group.knobs["light1_azimuth"] = "{curve x1 -60 x5 60}"
    NukeModule(group, frames=(1, 5)).run()
    for frame, azimuth in ((1, -60), (4, 30)):
        light = relight.DirectionalLight(azimuth=azimuth, elevation=30)
        picture = Player(tmp_path, frame, player.files).rgba(group)
        assert difference(picture, subject, light) <= 0.01, frame


def test_a_callback_that_changes_nothing_sets_nothing(subjects, tmp_path):
    """Nuke calls it for every knob, its own changes included."""
    _, group, _ = exported(subjects[0], tmp_path, KEY)
    NukeModule(group).run()
    group.inside["light1_3"].knobs["matrix"] = "{1 0 0} {0 1 0} {0 0 1}"
    NukeModule(group).run()
    assert group.inside["light1_3"].knobs["matrix"] == "{1 0 0} {0 1 0} {0 0 1}"


def test_the_script_uses_what_nuke_brings_along(subjects, tmp_path):
    script, group, _ = exported(subjects[0], tmp_path, [KEY])
    kinds = {node.kind for node in [*script.nodes, *group.inside.nodes]}
    assert kinds == {
        "Root", "Read", "Group", "Input", "ColorMatrix", "Expression", "Multiply", "Merge2",
        "Remove", "Output", "Shuffle",
    }  # fmt: skip
    assert script.stack == [group]
    names = [node.name for node in group.inside.nodes]
    assert len(set(names)) == len(names)
    assert script["Layers"].knobs["raw"] == "true"  # no colour space is applied to the layers
    assert str(tmp_path) not in (tmp_path / "person.nk").read_text()


@pytest.mark.parametrize(
    ("lights", "said"),
    [
        ([KEY] * 5, "lights: a Nuke script takes up to 4, got 5"),
        ([relight.PointLight((0, 0, 2))], "lights: a Nuke script takes DirectionalLight.*got PointLight"),
    ],
)
def test_lights_that_the_knobs_cannot_hold(subjects, tmp_path, lights, said):
    with pytest.raises(ValueError, match=said):
        subjects[0].export(tmp_path / "person.nk", lights)
    with pytest.raises(ValueError, match="holds no mesh"):
        subjects[0].export(tmp_path / "person.nk", texture="photograph")
    assert list(tmp_path.iterdir()) == []


def test_a_relit_still_has_nukes_light_beside_its_groups(tmp_path, here):
    """The camera in the script sees the positions of the pass P where the plate shows them."""
    plate = relight.read(ROOT / "examples" / "person.png")[::6, ::6]
    plate = np.pad(plate, ((0, 20), (0, 40), (0, 0)))  # the person is not in the middle
    output = relight.Output(["relit.exr", "relit.nk"], passes=["albedo", "N", "P"])
    relight.render_shot(plate, [KEY, RIM], output)
    script = Script((tmp_path / "relit.nk").read_text())
    (last,) = script.stack
    np.testing.assert_allclose(Player(tmp_path).rgba(last), relight.read("relit.exr"), atol=2e-3)
    knobs, layers = script["Camera"].knobs, relight.read_layers("relit.exr")
    eye = np.array(knobs["translate"].split(), float)
    rows, columns = np.nonzero(plate[..., 3] > 0.9)
    rays = layers["P"][rows, columns] - eye
    pixels = plate.shape[1] * float(knobs["focal"]) / float(knobs["haperture"])
    x = plate.shape[1] / 2 - rays[:, 0] / rays[:, 2] * pixels
    y = plate.shape[0] / 2 + rays[:, 1] / rays[:, 2] * pixels
    np.testing.assert_allclose(x, columns + 0.5, atol=0.1)
    np.testing.assert_allclose(y, rows + 0.5, atol=0.1)
    # Without the passes there is no such group.
    relight.render_shot(plate, KEY, ["plain.exr", "plain.nk"])
    assert "ReLight" not in (tmp_path / "plain.nk").read_text()
