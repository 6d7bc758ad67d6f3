"""The example workflows, run by a small executor, against `relight.apply`."""

import json
import runpy

import numpy as np
import pytest
from helpers import ROOT
from helpers.comfyui import WORKFLOWS, codes_of, load_image, run

import relight
from relight.comfyui import tensors
from relight.media.colour import encode

EXAMPLES = ROOT / "examples"
BLUE = tensors.light("blue", np.float32([[[0xBC, 0xD4, 0xFF]]]) / 255)[0, 0].tolist()  # #bcd4ff


pytestmark = pytest.mark.usefixtures("comfyui")


def cropped(x, y, width, height):
    """The photograph, scene-linear, and its matte."""
    image, mask = load_image(EXAMPLES / "person.png")
    part = np.s_[0, y : y + height, x : x + width]
    return tensors.light("photograph", image[part].numpy()), 1 - mask[part].numpy()


def grey(code):
    return np.uint8([[[code >> 16, code >> 8 & 255, code & 255]]])


def assert_codes(saved, linear, white=None):
    """8-bit codes as Save Image writes them, off by one at most and that rarely, of a linear picture."""
    expected = np.floor(255 * encode(np.asarray(linear, np.float32), white=white) + 0.005)
    difference = np.abs(saved.astype(int) - expected)
    assert difference.max() <= 1
    assert (difference > 0).mean() < 0.005


@pytest.mark.parametrize("name", ["portrait", "place", "moving_light"])
def test_workflows_are_in_api_format(name):
    graph = json.loads((WORKFLOWS / f"{name}.json").read_text())
    for node in graph.values():
        assert set(node) == {"class_type", "inputs", "_meta"}
        for value in node["inputs"].values():
            assert not isinstance(value, list) or value[0] in graph


@pytest.mark.parametrize("name", ["portrait", "place", "moving_light"])
def test_workflows_of_the_interface_are_those_of_the_api(name):
    """Written by examples/comfyui/interface.py, and no node hides another."""
    graph = json.loads((WORKFLOWS / f"{name}.json").read_text())
    offered = ROOT / "relight" / "comfyui" / "example_workflows" / f"{name}.json"
    interface = runpy.run_path(str(WORKFLOWS / "interface.py"))
    shown = json.loads(offered.read_text())
    assert shown == interface["interface_of"](graph)
    nodes = {node["id"]: node for node in shown["nodes"]}
    assert set(nodes) == set(map(int, graph))
    for node in nodes.values():
        inputs, _ = interface["described"](node["type"])
        linked = {socket["name"]: socket["link"] for socket in node["inputs"]}
        widgets = [name for name in inputs if name not in linked]
        values = dict(zip(widgets, node["widgets_values"], strict=True))
        for _, source, slot, target, socket, kind in shown["links"]:
            if target == node["id"]:
                values[node["inputs"][socket]["name"]] = [str(source), slot]
                assert nodes[source]["outputs"][slot]["type"] == kind
        given = graph[str(node["id"])]["inputs"]
        assert {name: values[name] for name in given} == given
        for other in nodes.values():
            apart = [
                node["pos"][axis] + node["size"][axis] <= other["pos"][axis] - (30 if axis else 0)
                or other["pos"][axis] + other["size"][axis] <= node["pos"][axis] - (30 if axis else 0)
                for axis in (0, 1)
            ]
            assert node is other or any(apart)  # 30 pixels of title are above a node's place


@pytest.mark.slow
def test_the_portrait_workflow_equals_relight_apply(comfyui):
    results = run(WORKFLOWS / "portrait.json", EXAMPLES)
    photograph, mask = cropped(50, 20, 400, 520)
    lights = [
        relight.DirectionalLight(
            azimuth=-50, elevation=30, intensity=1.6, temperature=5000, angle=12, name="key"
        ),
        relight.DirectionalLight(azimuth=140, elevation=25, intensity=2.5, colour=BLUE, angle=6, name="rim"),
        relight.DirectionalLight(azimuth=50, intensity=0.15, angle=60, name="fill"),
    ]
    picture = relight.apply(
        photograph, lights, mask=mask, background=grey(0x23272D), height=0.95, field_of_view=22
    )
    assert_codes(results["11"][0][0], picture)
    layers = relight.read_layers(comfyui / "relight" / "portrait.exr")
    assert {"C_key", "C_rim", "C_fill", "C_background", "albedo", "N"} == set(layers)
    np.testing.assert_allclose(relight.read(comfyui / "relight" / "portrait.exr"), picture, atol=0.004)
    assert len(results["12"][0]) == 3


@pytest.mark.slow
def test_a_person_into_a_place():
    results = run(WORKFLOWS / "place.json", EXAMPLES)
    photograph = tensors.light("photograph", results["3"][0][0].numpy())
    place = tensors.light("place", results["14"][0][0].numpy())
    lights = [
        relight.DirectionalLight(
            azimuth=-118, elevation=35, intensity=2.2, temperature=4800, angle=4, name="sun"
        ),
        relight.EnvironmentLight.from_plate(place, 40, name="plate"),
    ]
    picture = relight.apply(
        photograph, lights, mask=1 - results["5"][0][0].numpy(), background=place,
        floor=relight.Floor(horizon=0.4), height=1.75,
    )  # fmt: skip
    assert_codes(results["18"][0][0], picture)
    in_shadow, beside = picture[1050, 800].mean(), picture[1050, 150].mean()
    assert in_shadow < 0.7 * beside  # the sun's shadow falls to the right, toward the camera


@pytest.mark.slow
def test_a_moving_light_as_a_video():
    results = run(WORKFLOWS / "moving_light.json", EXAMPLES, RelightOrbit={"frames": 12})  # of its 48
    frames, rate = results["7"]
    assert (len(frames), rate) == (12, 24)
    photograph, mask = cropped(0, 0, 502, 982)
    moving = relight.MovingLight(
        relight.PointLight, orbit=12, position=(-0.9, 0.7, 0.9), intensity=2, temperature=3600, radius=0.1
    )
    fill = relight.DirectionalLight(
        azimuth=20, elevation=10, intensity=0.1, colour=BLUE, angle=90, name="fill"
    )
    subject = relight.Subject(photograph, mask, height=1.75)
    pictures = [
        relight.over(subject.relit([moving.at(frame), fill]), grey(0x16181B)) for frame in range(1, 13)
    ]
    white = max(1.0, *(float(picture.max()) for picture in pictures))
    codes = codes_of(frames)
    for frame in range(12):
        assert_codes(codes[frame], pictures[frame], white)
    first = relight.apply(photograph, [moving.at(1), fill], mask=mask, background=grey(0x16181B), height=1.75)
    assert_codes(codes[0], first, white)
