"""From a phone's photograph to a person who stands in a street: cut out by a network, lit by a lamp and by
the street, a shadow at their feet. All of it is made here; the place is one of benchmarks/places.py."""

import importlib.util

import numpy as np
import pytest
from helpers import ROOT
from helpers.packages import NEEDS_PYMATTING
from PIL import Image
from typer.testing import CliRunner

pytest.importorskip("onnxruntime")
onnx = pytest.importorskip("onnx")

import relight
from relight.cli.commands import app
from relight.media import colour

pytestmark = NEEDS_PYMATTING
TURNED = Image.Exif()
TURNED[0x112] = 6  # the camera was turned: the picture's top is on the right


def write_photograph(path, step=2):
    """The person of the examples before a wall that is bluer than anybody, as a phone writes it."""
    person = np.ascontiguousarray(relight.read(ROOT / "examples" / "person.png")[::step, ::step])
    height, width = person.shape[:2]
    shade = np.linspace(1.2, 0.7, width)[None, :, None]
    grain = np.random.default_rng(0).normal(1, 0.04, (height, width, 1))
    photograph = relight.over(person, np.float32((0.05, 0.12, 0.35) * shade * grain))
    codes = np.uint8(colour.encode(photograph, white=1.0) * 255 + 0.5)
    Image.fromarray(np.rot90(codes)).save(path, quality=93, exif=TURNED.tobytes())
    return person[..., 3]


def write_model(path):
    """A network whose matte is what is not bluer than it is red; its input (1, 3, 320, 320) in [0, 1]."""
    shape, flat = [1, 3, 320, 320], [1, 1, 320, 320]
    nodes = [
        onnx.helper.make_node("Conv", ["x", "weight", "bias"], ["matte"]),
        onnx.helper.make_node("Clip", ["matte", "zero", "one"], ["y"]),
    ]
    constants = {
        "weight": np.float32([8, 0, -8]).reshape(1, 3, 1, 1),
        "bias": np.float32([2]),
        "zero": np.float32(0),
        "one": np.float32(1),
    }
    graph = onnx.helper.make_graph(
        nodes,
        "bluer",
        [onnx.helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, shape)],
        [onnx.helper.make_tensor_value_info("y", onnx.TensorProto.FLOAT, flat)],
        [onnx.numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    onnx.save(
        onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8),
        str(path),
    )


def places():
    spec = importlib.util.spec_from_file_location("places", ROOT / "benchmarks" / "places.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_a_photograph_becomes_a_picture_in_a_street(tmp_path, here):
    matte = write_photograph(tmp_path / "photo.jpg")
    write_model(tmp_path / "bluer.onnx")
    street = places().Place("street", 7).plate((300, 450))
    Image.fromarray(street).save(tmp_path / "street.jpg", quality=95)
    command = (
        "apply photo.jpg --matte bluer.onnx,mean=0/0/0,std=1/1/1 --refine-matte 6 "
        "--light lamp:position=-0.9/0.6/0.9,radius=0.1,intensity=0.6,colour=1/0.7/0.4 "
        "--background street.jpg --match-plate --floor height=1.5,horizon=0.5 "
        "--size background --scale 0.6 --offset 38/-58 --save-matte matte.png -o out.png -o out.exr -o out.nk"
    )
    result = CliRunner().invoke(app, command.split())
    assert result.exit_code == 0, result.output
    picture, layers = relight.read("out.exr"), relight.read_layers("out.exr")
    assert picture.shape == (300, 450, 3)
    assert relight.read("out.png").shape == picture.shape
    groups = {name: layer for name, layer in layers.items() if name.startswith("C_")}
    assert set(groups) == {"C_lamp", "C_plate", "C_background"}
    np.testing.assert_allclose(sum(layer[..., :3] for layer in groups.values()), picture, atol=2e-3)
    assert {"shadow_floor_lamp", "shadow_floor_plate"} < set(layers)

    cut = relight.read_mask("matte.png")
    truth = relight.place(matte, (300, 450), scale=0.6, offset=(38, -58))
    assert np.abs(cut - truth).mean() < 0.01  # upright, and cut out
    behind, inside = relight.media.images.scene_linear("street", street), cut > 0.9
    feet = np.flatnonzero(inside.any(axis=1))[-1]
    ground = groups["C_background"][feet - 6 : feet + 4] / behind[feet - 6 : feet + 4]
    assert np.quantile(ground[(cut < 0.02)[feet - 6 : feet + 4]], 0.02) < 0.85  # there is a shadow
    person = (picture[inside].mean(), behind.mean())
    assert 0.25 < person[0] / person[1] < 2  # of the place's own brightness
