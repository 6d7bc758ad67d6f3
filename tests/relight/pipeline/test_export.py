from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT, nuke_scripts
from typer.testing import CliRunner

import relight
from relight.cli.commands import app
from relight.pipeline.options import Source

pxr = pytest.importorskip("pxr")
pytest.importorskip("trimesh")

KEY = relight.DirectionalLight(azimuth=-40, elevation=30, name="key")


@pytest.fixture
def person(tmp_path, here):
    """A small photograph with alpha, in the working folder."""
    picture = np.ascontiguousarray(relight.read(ROOT / "examples" / "person.png")[::6, ::6])
    relight.write("person.png", picture)
    return picture


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_the_command_writes_what_another_command_lights_from(person):
    """A scene's camera and lights give the picture that the lights themselves give, at its angle of view."""
    light = "lamp:position=0.8/0.4/0.9,intensity=0.6"
    lit = ("--light", light, "--field-of-view", 25)
    assert run("export", "person.png", *lit, "-o", "set.usdz", "--triangles", 2000).exit_code == 0
    assert run("apply", "person.png", *lit, "-o", "one.exr", "--exr-type", "float").exit_code == 0
    scene = ("--lights", "set.usdz", "--camera", "/World/Camera", "--subject-at", "/World/Person")
    done = run("apply", "person.png", *scene, "-o", "two.exr", "--exr-type", "float")
    assert done.exit_code == 0, done.output
    np.testing.assert_allclose(relight.read("two.exr"), relight.read("one.exr"), atol=1e-4)


def test_lights_are_saved_to_a_stage(person):
    assert (
        run(
            "apply", "person.png", "--light", "azimuth=-40", "-o", "a.exr", "--save-lights", "rig.usda"
        ).exit_code
        == 0
    )
    (light,) = relight.read_lights("rig.usda")
    np.testing.assert_allclose(light.azimuth, -40, atol=1e-4)


def test_a_place_may_be_numbers(person):
    relight.write_lights("rig.usda", [relight.PointLight((1, 2, 3), name="lamp")])
    done = run("apply", "person.png", "--lights", "rig.usda", "--subject-at", "1/2/2", "-o", "a.exr")
    assert done.exit_code == 0, done.output
    near = relight.Subject(person).relit(relight.PointLight((0, 0, 1)))
    np.testing.assert_allclose(relight.read("a.exr"), near, atol=2e-3)


@pytest.mark.slow
def test_a_sequence_becomes_one_stage(person):
    from pxr import Usd, UsdGeom

    for number in (7, 9):
        relight.write(f"plate.{number:04d}.png", np.roll(person, number - 7, axis=1))
    moving = relight.MovingLight(relight.DirectionalLight, azimuth={7: -40, 9: 40}, name="key")
    source = Source("plate.%04d.png", temporal_filter=False)
    path = relight.export_person("shot.usdc", source, moving, triangles=2000)
    stage = Usd.Stage.Open(str(path))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (7, 9)
    people = [prim for prim in stage.GetPrimAtPath("/World/Person").GetChildren()]
    assert [prim.GetName() for prim in people] == ["frame_0007", "frame_0009"]
    for time, shown in ((6, 7), (7, 7), (8, None), (9, 9), (10, 9)):
        seen = [p.GetName() for p in people if UsdGeom.Imageable(p).ComputeVisibility(time) != "invisible"]
        assert seen == ([] if shown is None else [f"frame_{shown:04d}"]), time
    textures = {str(shader.GetAttribute("inputs:file").Get().path) for shader in stage.Traverse()
                if shader.GetName() == "Texture"}  # fmt: skip
    assert len(textures) == 2
    (light,) = relight.read_lights(path, subject_at="/World/Person")
    np.testing.assert_allclose(light.at(8).azimuth, 0, atol=1e-3)
    with pytest.raises(ValueError, match=r"shot\.glb: holds one frame"):
        relight.export_person("shot.glb", source, frames="7,9")
    with pytest.raises(ValueError, match="frames: 8 are not there"):
        relight.export_person("shot.usda", source, frames="7-9")


@pytest.mark.slow
def test_a_kept_shot_becomes_a_script_for_nuke(person):
    """The frames share the components, so that one light moves through all of them."""
    for number in (7, 8):
        picture = np.roll(person, 3 * (number - 7), axis=1)
        relight.write(f"plate.{number:04d}.png", picture if number == 7 else picture[:, ::-1])
    relight.write("plate.0009.png", np.zeros_like(person))  # nobody
    relight.analyse_shot(Source("plate.%04d.png", temporal_filter=False), "kept.relight")
    done = run("export", "kept.relight", "--light", "azimuth=-40,elevation=30,angle=10", "-o", "shot.nk")
    assert done.exit_code == 0, done.output
    script = nuke_scripts.Script(Path("shot.nk").read_text())
    group, layers = script["Relight"], script["Layers"].knobs
    assert (layers["file"], layers["first"], layers["last"]) == ("shot_layers.%04d.exr", "7", "9")
    moved = relight.DirectionalLight(azimuth=50, elevation=10, angle=10)
    group.knobs |= {"light1_azimuth": "50", "light1_elevation": "10"}
    nuke_scripts.NukeModule(group, frames=(7, 9)).run()
    for number in (7, 8):
        kept = relight.Subject.load(f"kept.relight/{number:06d}.safetensors")
        picture = nuke_scripts.Player(Path(), number).rgba(group)
        inside = kept.matte > 0
        error = np.sqrt(((picture - kept.relit(moved))[inside] ** 2).mean())
        assert error <= 0.01, (number, error)
    assert not nuke_scripts.Player(Path(), 9).rgba(group).any()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("export", "person.png", "-o", "person.obj"), "expected a file name that ends in .glb"),
        (
            ("export", "person.png", "-o", "person.glb", "--triangles", "10"),
            "triangles: expected a whole number",
        ),
        (("export", "none.png", "-o", "person.glb"), "none.png"),
        (("export", "person.png", "-o", "person.nk", "--triangles", "5000"), "person.nk: holds no mesh"),
        (
            ("export", "person.png", "-o", "person.nk", "--light", "position=0/0/2"),
            "lights: a Nuke script takes DirectionalLight",
        ),
        (
            ("apply", "person.png", "--light", "azimuth=3", "--camera", "/cam", "-o", "a.exr"),
            "camera: expected a USD",
        ),
        (
            ("apply", "person.png", "--lights", "rig.usda", "--camera", "/cam", "-o", "a.exr"),
            "has no camera /cam",
        ),
    ],
)
def test_bad_input_is_one_line(person, words, said):
    relight.write_lights("rig.usda", [KEY])
    done = run(*words)
    assert done.exit_code == 2
    assert said in done.output
    assert len(done.output.strip().splitlines()) == 1


def test_the_stage_of_the_lights_is_not_overwritten(person):
    relight.write_lights("rig.usda", [KEY])
    before = Path("rig.usda").read_bytes()
    done = run("export", "person.png", "--lights", "rig.usda", "-o", "rig.usda")
    assert done.exit_code == 2
    assert "rig.usda: is read as well" in done.output
    assert Path("rig.usda").read_bytes() == before


@pytest.mark.parametrize(
    ("plate", "output"), [("person_layers.exr", "person.nk"), ("person_albedo.png", "person.usda")]
)
def test_a_plate_is_not_overwritten_by_what_lies_beside_an_export(person, plate, output):
    relight.write(plate, person)
    before = Path(plate).read_bytes()
    done = run("export", plate, "-o", output)
    assert done.exit_code != 0
    assert f"{plate}: is read as well, and would be overwritten" in " ".join(done.output.split())
    assert Path(plate).read_bytes() == before
