import re
import shutil
import subprocess

import numpy as np
import pytest
from helpers.nuke_scripts import Player, Script

import relight
from relight.scene.nuke.light_groups import write_script
from relight.scene.nuke.relight_node import LiveLight

RNG = np.random.default_rng(2)


def play(script, folder):
    """What the script's last node shows, (H, W, 4)."""
    (last,) = Script(script).stack  # nothing is left over
    return Player(folder).rgba(last)


@pytest.fixture
def groups(tmp_path):
    """A file of three light groups, as `relight apply` writes it."""
    layers = {f"C_{name}": RNG.random((6, 8, 4), np.float32) for name in ("key", "rim light", "fill")}
    picture = sum(layers.values())
    picture[..., 3] = 0.5
    relight.write(tmp_path / "mix.exr", picture, layers=layers)
    return {name.removeprefix("C_"): (tmp_path / "mix.exr", name) for name in layers}


def test_the_script_rebuilds_the_picture(groups, tmp_path):
    write_script(tmp_path / "mix.nk", groups, (6, 8))
    script = (tmp_path / "mix.nk").read_text()
    beauty = relight.read(tmp_path / "mix.exr")
    np.testing.assert_allclose(play(script, tmp_path), beauty, rtol=2e-3)
    # A light at half its strength.
    dimmed = re.sub(r"value 1(\n name Multiply_key)", r"value 0.5\1", script)
    key = relight.read_layers(tmp_path / "mix.exr")["C_key"][..., :3]
    np.testing.assert_allclose(play(dimmed, tmp_path)[..., :3], beauty[..., :3] - 0.5 * key, rtol=2e-3)


def test_the_script_is_well_formed(groups, tmp_path):
    write_script(tmp_path / "mix.nk", groups, (6, 8), rate=23.976)
    script = (tmp_path / "mix.nk").read_text()
    assert script.count("{") == script.count("}")
    assert len(re.findall(r"^Multiply \{", script, re.MULTILINE)) == 3
    assert len(re.findall(r"^Merge2 \{", script, re.MULTILINE)) == 2
    names = re.findall(r"^ name (\S+)$", script, re.MULTILINE)
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r"[A-Za-z]\w*", name) for name in names)
    assert " fps 23.976\n" in script
    assert ' label "rim light"\n' in script
    assert str(tmp_path) not in script  # the folder may move


def test_sequences_keep_their_frame_number_and_range(tmp_path):
    (tmp_path / "shot").mkdir()
    groups = {"key": (tmp_path / "relit.%04d.exr", "C_key")}
    write_script(tmp_path / "shot" / "mix.nk", groups, (6, 8), frames=(1001, 1020))
    script = (tmp_path / "shot" / "mix.nk").read_text()
    assert ' file "../relit.%04d.exr"\n first 1001\n last 1020\n' in script
    assert " first_frame 1001\n last_frame 1020\n" in script


def test_a_file_a_light(groups, tmp_path):
    passes = {}
    for number, (name, (file, layer)) in enumerate(groups.items(), 1):
        path = tmp_path / f"pass.{number:04d}.exr"
        relight.write(path, relight.read_layers(file)[layer])
        passes[name] = (path, None)
    write_script(tmp_path / "passes.nk", passes, (6, 8))
    picture = play((tmp_path / "passes.nk").read_text(), tmp_path)
    np.testing.assert_allclose(picture[..., :3], relight.read(tmp_path / "mix.exr")[..., :3], rtol=2e-3)


@pytest.mark.skipif(shutil.which("tclsh") is None, reason="no Tcl on this machine")
def test_odd_names_survive_tcl(tmp_path):
    name = 'a "b" [c] {d} $e \\f'
    write_script(tmp_path / "m.nk", {name: (tmp_path / "m.exr", "C_x")}, (6, 8))
    label = re.findall(r"^ label (.*)$", (tmp_path / "m.nk").read_text(), re.MULTILINE)[-1]
    echoed = subprocess.run(
        ["tclsh"], input=f"puts [subst {label}]", capture_output=True, text=True, check=True
    ).stdout
    assert echoed == name + "\n"


def test_bad_arguments_leave_nothing(tmp_path):
    with pytest.raises(ValueError, match="groups: expected at least one"):
        write_script(tmp_path / "m.nk", {}, (6, 8))
    with pytest.raises(FileNotFoundError):
        write_script(tmp_path / "none" / "m.nk", {"key": (tmp_path / "m.exr", "C_key")}, (6, 8))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("first", "second"), [("主光", "辅光"), ("a b", "a_b"), ("key.1", "key-1")])
def test_layers_that_are_one_to_nuke_are_refused(tmp_path, first, second):
    groups = {name: (tmp_path / "m.exr", f"C_{name}") for name in (first, second)}
    with pytest.raises(ValueError, match=f"layers: 'C_{first}' and 'C_{second}' are one to Nuke, C_"):
        write_script(tmp_path / "m.nk", groups, (6, 8))
    assert list(tmp_path.iterdir()) == []
    # Each in a file of its own they are no layers, and told apart.
    files = {name: (tmp_path / f"{number}.exr", None) for number, name in enumerate((first, second))}
    write_script(tmp_path / "m.nk", files, (6, 8))
    nodes = re.findall(r"^ name (\S+)$", (tmp_path / "m.nk").read_text(), re.MULTILINE)
    assert len(set(nodes)) == len(nodes)


@pytest.mark.parametrize("pixel_aspect", [1, 2])
def test_nukes_own_light_sees_through_the_plates_camera(groups, tmp_path, pixel_aspect):
    live = LiveLight((0.1, -0.2, 2.5), 12.0)
    write_script(tmp_path / "mix.nk", groups, (6, 8), pixel_aspect=pixel_aspect, live=live)
    camera = Script((tmp_path / "mix.nk").read_text())["Camera"].knobs
    assert camera["translate"] == "0.1 -0.2 2.5"
    focal, across, up = (float(camera[name]) for name in ("focal", "haperture", "vaperture"))
    heights = focal / across * 8 * pixel_aspect, focal / up * 6  # of a pixel
    np.testing.assert_allclose(heights, 12.0)


def test_nukes_own_light_is_wired_and_off(groups, tmp_path):
    """The group passes the light groups on until it is enabled. The interpreter holds class and knobs to
    Foundry's reference."""
    live = LiveLight((0.1, -0.2, 2.5), 12.0)
    background = {"background": (tmp_path / "mix.exr", "C_key")}
    write_script(tmp_path / "mix.nk", groups | background, (6, 8), live=live)
    text = (tmp_path / "mix.nk").read_text()
    script = Script(text)
    expected = (
        relight.read(tmp_path / "mix.exr")[..., :3]
        + relight.read_layers(tmp_path / "mix.exr")["C_key"][..., :3]
    )
    np.testing.assert_allclose(play(text, tmp_path)[..., :3], expected, rtol=2e-3)
    group = script["LiveLight"]
    assert group.knobs["disable"] == "true"
    assert [node.name for node in group.inputs] == ["Plus_fill", "Light", "Camera"]
    assert script["Plus_background"].inputs[1] is group  # the background stays
    inside = group.inside
    colour, lights, camera, material = inside["ReLight1"].inputs
    assert (colour.kind, colour.knobs["in"]) == ("Shuffle", "albedo")
    numbers = [(node.kind, node.knobs["number"]) for node in (*colour.inputs, lights, camera)]
    assert numbers == [("Input", "0"), ("Input", "1"), ("Input", "2")]
    assert material.kind == "Phong"
    assert inside["ReLight1"].knobs["normal"] == "N"
    assert inside["ReLight1"].knobs["position"] == "P"
    assert script.layers["N"] == ["N.X", "N.Y", "N.Z"]  # as Nuke names the channels of such files
    assert script.layers["P"] == ["P.X", "P.Y", "P.Z"]
    assert inside["Matte"].inputs[0].name == "groups"


@pytest.mark.parametrize(
    ("size", "aspect", "name"),
    [((480, 640), 1, "relight_640x480"), ((576, 720), 1.094, "relight_720x576_1.094")],
)
def test_each_size_has_a_format_of_its_own(tmp_path, size, aspect, name):
    """Nuke takes the first format of a name for all scripts that are open or inserted."""
    write_script(tmp_path / "a b.nk", {"key": ("a.exr", None)}, size, pixel_aspect=aspect)
    script = (tmp_path / "a b.nk").read_text()
    height, width = size
    assert f' format "{width} {height} 0 0 {width} {height} {aspect} {name}"\n' in script
    assert ' label "relative to a b.nk"\n' in script
