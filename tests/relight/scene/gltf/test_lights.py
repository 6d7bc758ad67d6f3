import json
import warnings

import numpy as np
import pytest

import relight
from relight.scene.gltf.read import EXTENSION
from relight.scene.lights import read_lights, read_rig, write_lights


def scene(path, nodes, lights=(), **more):
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        "nodes": nodes,
        "extensions": {EXTENSION: {"lights": list(lights)}},
    }
    path.write_text(json.dumps(tree | more))
    return path


def lit(index, **node):
    return {"extensions": {EXTENSION: {"light": index}}} | node


SUN = {"type": "directional", "intensity": 6.0, "color": [1, 0.5, 0.25]}
BULB = {"type": "point", "intensity": 2.0}
SPOT = {"type": "spot", "intensity": 3.0, "spot": {"innerConeAngle": 0.3, "outerConeAngle": 0.6}}
CAMERA = {"type": "perspective", "perspective": {"yfov": 0.6, "aspectRatio": 1.5, "znear": 0.1}}
QUARTER = [0, np.sqrt(0.5), 0, np.sqrt(0.5)]  # a quarter turn about the vertical


def test_photometric_units_and_places(tmp_path):
    nodes = [
        {"name": "root", "translation": [0, 1, 0], "children": [1, 2, 3], "rotation": QUARTER},
        lit(0, name="sun"),
        lit(1, name="bulb", translation=[0, 0, 2]),
        lit(2, name="spot", translation=[1, 0, 0]),
    ]
    sun, bulb, spot = read_lights(scene(tmp_path / "set.gltf", nodes, [SUN, BULB, SPOT]))
    # 6 lux on a white surface are the radiance 6 / pi.
    np.testing.assert_allclose(sun.power, 6 / np.pi * np.array([1, 0.5, 0.25]))
    np.testing.assert_allclose(sun.direction, (1, 0, 0), atol=1e-6)  # it shines along -z, turned
    np.testing.assert_allclose(bulb.position, (2, 1, 0), atol=1e-6)
    np.testing.assert_allclose(bulb.power, 2 / np.pi)
    np.testing.assert_allclose(spot.axis, (-1, 0, 0), atol=1e-6)
    np.testing.assert_allclose((spot.cone, spot.softness), (np.degrees(0.6), 0.5))


@pytest.mark.parametrize("version", ["3.6.28", "5.0.21"])
@pytest.mark.states("glTF", "683 lm/W of Blender, by its generator", "warned of")
def test_blender_writes_lumens_for_watts(tmp_path, version):
    """Cycles gives a white surface 40 / 4 pi^2 at a metre from a lamp of 40 W, and 3 / pi in a sun of 3."""
    lights = [
        {"type": "point", "intensity": 683 * 40 / (4 * np.pi)},
        {"type": "directional", "intensity": 683 * 3},
    ]
    asset = {"version": "2.0", "generator": f"Khronos glTF Blender I/O v{version}"}
    path = scene(tmp_path / "set.gltf", [{"children": [1, 2]}, lit(0), lit(1)], lights, asset=asset)
    with pytest.warns(UserWarning, match=r"set.gltf: Blender's lights .* export in that mode") as said:
        lamp, sun = read_lights(path)
    np.testing.assert_allclose(lamp.power, 40 / (4 * np.pi**2), rtol=1e-6)
    np.testing.assert_allclose(sun.power, 3 / np.pi, rtol=1e-6)
    assert len(said) == 1


@pytest.mark.parametrize("generator", ["Khronos glTF Blender I/O v3.5.30", "relight", "Unreal", 7, None])
def test_other_programs_mean_lux_and_candela(tmp_path, generator):
    """So did Blender before it had lighting modes, in its own watts."""
    path = scene(tmp_path / "set.gltf", [lit(0)], [SUN], asset={"version": "2.0", "generator": generator})
    (sun,) = read_lights(path)
    np.testing.assert_allclose(sun.power[0], 6 / np.pi)


def test_the_cameras_frame(tmp_path):
    nodes = [
        {"name": "root", "children": [1, 2, 3]},
        {"name": "cam", "camera": 0, "translation": [5, 1, 0], "rotation": QUARTER},
        {"name": "mark", "translation": [2, 1, 0]},
        lit(0, name="bulb", translation=[2, 1, -1]),
    ]
    path = scene(tmp_path / "set.gltf", nodes, [BULB], cameras=[CAMERA])
    rig = read_rig(path, camera="cam", subject_at="mark")
    np.testing.assert_allclose(rig.lights[0].position, (1, 0, 0), atol=1e-6)  # the camera looks along -x
    np.testing.assert_allclose(rig.view.vertical_degrees(1.5), np.degrees(0.6))
    with pytest.raises(ValueError, match="say where the subject is"):
        read_lights(path)


@pytest.mark.parametrize("suffix", [".gltf", ".glb"])
def test_lights_come_back_as_they_were(tmp_path, suffix):
    before = [
        relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2, colour=(1, 0.9, 0.8), name="key"),
        relight.DirectionalLight((0, 0, -1), exposure=1, name="behind"),
        relight.PointLight((0.5, 1, -2), temperature=3200, name="lamp"),
        relight.PointLight((0, 2, 1), toward=(0, 0, 0), cone=25, softness=0.4, name="spot"),
    ]
    path = tmp_path / f"rig{suffix}"
    write_lights(path, before)
    for one, other in zip(before, read_lights(path), strict=True):
        assert type(one) is type(other)
        assert one.name == other.name
        np.testing.assert_allclose(other.power, one.power, rtol=1e-6)
        for field in set(one.__dataclass_fields__) & {"direction", "position", "cone", "softness"}:
            np.testing.assert_allclose(getattr(other, field), getattr(one, field), atol=1e-6, err_msg=field)
    np.testing.assert_allclose(other.axis, one.axis, atol=1e-6)


def test_lights_of_one_name_get_numbers(tmp_path):
    nodes = [{"children": [1, 2, 3]}, lit(0), lit(0), lit(0, name="key")]
    lights = read_lights(scene(tmp_path / "set.gltf", nodes, [SUN | {"name": "bulb"}]))
    assert [light.name for light in lights] == ["bulb", "bulb_2", "key"]


def test_a_camera_without_a_name_has_its_field_of_view(tmp_path):
    nodes = [{"children": [1, 2]}, {"camera": 0}, lit(0)]
    rig = read_rig(scene(tmp_path / "set.gltf", nodes, [SUN], cameras=[CAMERA]))
    assert rig.camera is None
    assert rig.view.vertical_degrees(1.5) == pytest.approx(np.degrees(0.6))


def check_refused(match, path, kind=ValueError, **keywords):
    with pytest.raises(kind, match=match) as caught:
        read_lights(path, **keywords)
    assert "\n" not in str(caught.value)


def test_bad_input_is_named_in_one_line(tmp_path):
    path = tmp_path / "set.gltf"
    check_refused("no such file", path, FileNotFoundError)
    path.write_text("{")
    check_refused("is not glTF", path)
    path.write_text('{"asset": {"version": "1.0"}}')
    check_refused("expected glTF 2.0", path)
    check_refused("holds no lights", scene(path, [{"mesh": 0}]))
    check_refused("node 0 is there twice", scene(path, [{"children": [0]}]))
    check_refused("nodes do not form a tree", scene(path, [{"children": [7]}]))
    check_refused("node sun: has no such light, 3", scene(path, [lit(3, name="sun")], [SUN]))
    check_refused("node sun: colour", scene(path, [lit(0, name="sun")], [SUN | {"color": [-1, 0, 0]}]))
    check_refused("node sun: type: expected", scene(path, [lit(0, name="sun")], [{"type": "area"}]))
    check_refused("has no camera x; its cameras are none", scene(path, [lit(0)], [SUN]), camera="x")
    check_refused("has no node x", scene(path, [lit(0)], [SUN]), subject_at="x")
    (tmp_path / "set.glb").write_bytes(b"glTF")
    check_refused("is not a .glb file", tmp_path / "set.glb")
    with pytest.raises(TypeError, match="a lights file has no cameras"):
        relight.read_lights(tmp_path / "set.yaml", camera="x")
    with pytest.raises(ValueError, match="expected lights that glTF has"):
        write_lights(tmp_path / "none.gltf", [])


@pytest.mark.parametrize("hidden", ["the light", "what it hangs from"])
@pytest.mark.states("glTF", "KHR_node_visibility", "honoured")
def test_lights_of_hidden_nodes_do_not_shine(tmp_path, hidden):
    """KHR_node_visibility hides a node with its children."""
    off = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    lamp = lit(1, name="bulb")
    if hidden == "the light":
        lamp["extensions"] |= off["extensions"]
    between = {"children": [3]} | (off if hidden == "what it hangs from" else {})
    nodes = [{"children": [1, 2]}, lit(0, name="sun"), between, lamp]
    assert [light.name for light in read_lights(scene(tmp_path / "set.gltf", nodes, [SUN, BULB]))] == ["sun"]


@pytest.mark.parametrize("node", [0, 1])
@pytest.mark.states("glTF", "animated lights", "warned of")
def test_an_animated_light_is_named(tmp_path, node):
    """The light, or what it hangs from, moves; the animation of another node does not matter."""
    nodes = [{"children": [1]}, lit(0, name="sun"), {"name": "other"}]
    target = {"animations": [{"channels": [{"target": {"node": node, "path": "rotation"}}]}]}
    with pytest.warns(UserWarning, match=r"set.gltf: animations are not read; sun stay"):
        read_lights(scene(tmp_path / "set.gltf", nodes, [SUN], **target))
    target["animations"][0]["channels"][0]["target"]["node"] = 2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_lights(scene(tmp_path / "still.gltf", nodes, [SUN], **target))


@pytest.mark.parametrize(
    ("pointer", "moves"),
    [
        ("/extensions/KHR_lights_punctual/lights/0/intensity", True),
        ("/extensions/KHR_lights_punctual/lights/1/color", False),
        ("/nodes/0/translation", True),
        ("/nodes/1/extensions/KHR_node_visibility/visible", True),
        ("/nodes/2/rotation", False),
        ("/materials/0/emissiveFactor", False),
    ],
)
def test_a_light_that_a_pointer_animates_is_named(tmp_path, pointer, moves):
    """KHR_animation_pointer animates what is no transform of a node, too."""
    nodes = [{"children": [1]}, lit(0, name="sun"), {"name": "other"}]
    target = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}}
    path = scene(tmp_path / "set.gltf", nodes, [SUN, BULB], animations=[{"channels": [{"target": target}]}])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        read_lights(path)
    assert [str(one.message).partition(": ")[2][:28] for one in said] == [
        "animations are not read; sun"
    ] * moves


@pytest.mark.states("glTF", "an orthographic camera", "warned of")
def test_an_orthographic_camera_is_named(tmp_path):
    nodes = [{"children": [1, 2]}, {"camera": 0}, lit(0)]
    camera = {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 9}}
    with pytest.warns(UserWarning, match=r"set\.gltf: its camera is orthographic"):
        assert read_rig(scene(tmp_path / "set.gltf", nodes, [SUN], cameras=[camera])).view is None


HUGE = 10**400
WRONG_NODES = [
    {"matrix": [1]}, {"matrix": ["a"] * 16}, {"matrix": [HUGE] * 16}, {"matrix": None},
    {"rotation": [0, 0, 0]}, {"rotation": [0, 0, 0, 0]}, {"rotation": "xyzw"}, {"scale": [HUGE, 1, 1]},
    {"scale": [0, 0, 0]},
    {"translation": [1]}, {"translation": {}}, {"children": 5}, {"children": ["a"]}, {"children": [1.5]},
    {"camera": 3}, {"camera": "a"},
]  # fmt: skip
WRONG_LIGHTS = [
    {"color": "red"}, {"color": [1]}, {"color": [[1], 2, 3]}, {"color": [HUGE, 1, 1]}, {"intensity": "x"},
    {"intensity": None}, {"intensity": HUGE}, {"intensity": float("nan")}, {"intensity": -1}, {"type": []},
    {"type": "spot", "spot": []}, {"type": "spot", "spot": {"outerConeAngle": HUGE}},
    {"type": "spot", "spot": {"innerConeAngle": "a"}},
]  # fmt: skip
WRONG_SCENES = [
    {"scenes": 5}, {"scenes": [5]}, {"scene": 9}, {"scene": -1}, {"scene": "x"},
    {"animations": 5}, {"animations": [{"channels": 5}]}, {"extensionsRequired": 5},
    {"extensionsRequired": None}, {"asset": 5}, {"extensions": []},
    {"extensions": {EXTENSION: {"lights": {}}}},
]  # fmt: skip


@pytest.mark.parametrize(
    ("node", "light", "more"),
    [
        *((node, {}, {}) for node in WRONG_NODES),
        *(({}, light, {}) for light in WRONG_LIGHTS),
        *(({}, {}, more) for more in WRONG_SCENES),
    ],
)
@pytest.mark.states("glTF", "numbers, indices and types that are none", "refused")
def test_what_means_nothing_is_one_line_that_names_the_file(tmp_path, node, light, more):
    path = scene(tmp_path / "set.gltf", [lit(0, **node)], [SUN | light], **more)
    check_refused(r"set\.gltf", path)
    for nodes, lights in ((5, [SUN]), ([5], [SUN]), ([lit(0)], [5])):
        check_refused(r"set\.gltf", scene(path, nodes, lights))


def test_a_rotation_that_is_no_unit_is_made_one(tmp_path):
    turn = [3 * value for value in QUARTER]
    (sun,) = read_lights(scene(tmp_path / "set.gltf", [lit(0, rotation=turn)], [SUN]))
    np.testing.assert_allclose(sun.direction, (1, 0, 0), atol=1e-6)


@pytest.mark.states("glTF", "unknown `extensionsRequired`", "warned of")
def test_an_extension_that_the_file_requires_is_named(tmp_path):
    """Compressed meshes do not concern lights; unknown extensions may."""
    nodes = [lit(0, name="sun")]
    required = {"extensionsRequired": ["KHR_draco_mesh_compression", "ACME_lamps"]}
    with pytest.warns(UserWarning, match="requires ACME_lamps, which is not read"):
        read_lights(scene(tmp_path / "set.gltf", nodes, [SUN], **required))
