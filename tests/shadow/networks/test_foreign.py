"""Normals by ONNX files, which are made here: what they answer is the photograph's own colours."""

import numpy as np
import pytest
from helpers.onnx_models import channel, save
from typer.testing import CliRunner

pytest.importorskip("onnxruntime")
helper = pytest.importorskip("onnx").helper

import relight
import shadow
from relight.cli.commands import app
from shadow import normals


def ball(size=(120, 90)):
    """A sphere whose colours, sRGB-encoded, say its normals as n = 2v - 1: blue, green, red are x, y, z."""
    y, x = np.mgrid[: size[0], : size[1]]
    x, y = (x - 44.5) / 36, (59.5 - y) / 36
    mask = x**2 + y**2 < 1
    true = np.stack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))], axis=-1) * mask[..., None]
    codes = np.rint((true[..., ::-1] + 1) / 2 * 255).astype(np.uint8)
    return relight.media.colour.decode(codes, "sRGB"), mask.astype(np.float32), true


def network(path, shape=(1, 3, 512, 512), scale=(2, 2, 2), shift=(-1, -1, -1), multitask=False):
    """A network whose normals are scale × picture + shift, channel by channel."""
    nodes = [helper.make_node("Mul", ["x", "scale"], ["s"]), helper.make_node("Add", ["s", "shift"], ["n"])]
    outputs = {"n": list(shape)}
    numbers = {"scale": np.float32(scale).reshape(1, 3, 1, 1), "shift": np.float32(shift).reshape(1, 3, 1, 1)}
    if multitask:
        plane = [shape[0], 1, *shape[2:]]
        numbers |= {"a": np.int64([0]), "b": np.int64([1]), "axis": np.int64([1])}
        nodes += [helper.make_node("Slice", ["x", "a", "b", "axis"], [name]) for name in ("d", "f")]
        outputs = {"d": plane, "n": list(shape), "f": plane}
    return save(path, nodes, {"x": list(shape)}, outputs, **numbers)


@pytest.mark.parametrize("multitask", [False, True])
def test_david_is_known_by_its_inputs_and_outputs(tmp_path, multitask):
    rgb, mask, true = ball()
    found = shadow.infer_normals(rgb, mask, model=network(tmp_path / "m.onnx", multitask=multitask))
    inner = true[..., 2] > 0.3
    assert np.abs(found - true)[inner].max() < 0.08
    assert not found[mask == 0].any()


def test_any_other_says_axes_and_order(tmp_path):
    rgb, mask, true = ball()
    shape, turned = (1, 3, "h", "w"), {"scale": (2, -2, -2), "shift": (-1, 1, 1)}
    model = network(tmp_path / "m.onnx", shape, **turned)
    source = normals.load(model, axes="+x-y-z", order="bgr")
    found = shadow.infer_normals(rgb, mask, model=source)
    assert np.abs(found - true)[true[..., 2] > 0.3].max() < 0.08
    with pytest.raises(ValueError, match="is not DAViD's by its inputs and outputs: expected order"):
        normals.load(model)


@pytest.mark.parametrize(
    ("scale", "shift", "wrong"),
    [
        ((-2, 2, 2), (1, -1, -1), "in x;"),
        ((2, -2, 2), (-1, 1, -1), "in y;"),
        ((2, 2, -2), (-1, -1, 1), "in z;"),
        ((2, -2, -2), (-1, 1, 1), "in y and z;"),
    ],
)
def test_a_wrong_sign_shows_at_the_rim(tmp_path, scale, shift, wrong):
    rgb, mask, _ = ball()
    model = network(tmp_path / "m.onnx", scale=scale, shift=shift)
    with pytest.raises(ValueError, match=rf"do not turn outward at the matte's rim, .* {wrong}"):
        shadow.infer_normals(rgb, mask, model=model)


def test_a_person_cut_by_the_frame_is_no_error(tmp_path):
    rgb, mask, _ = (value[40:100, 20:] for value in ball())
    found = shadow.infer_normals(rgb, mask, model=network(tmp_path / "m.onnx"))
    assert found[20, 20, 2] > 0.9


def test_the_command_takes_a_file(tmp_path):
    rgb, mask, true = ball()
    relight.write(tmp_path / "ball.exr", np.concatenate([rgb * mask[..., None], mask[..., None]], -1))
    model = network(tmp_path / "m.onnx")
    arguments = ["apply", str(tmp_path / "ball.exr"), "--light", "azimuth=10", "-o", str(tmp_path / "o.exr")]
    result = CliRunner().invoke(app, [*arguments, "--normals", str(model), "--passes", "N"])
    assert result.exit_code == 0, result.output
    found = relight.read_layers(tmp_path / "o.exr")["N"]
    assert np.abs(found - true)[true[..., 2] > 0.5].mean() < 0.05
    wrong = network(tmp_path / "w.onnx", scale=(-2, 2, 2), shift=(1, -1, -1))
    (tmp_path / "o.exr").unlink()
    result = CliRunner().invoke(app, [*arguments, "--normals", str(wrong)])
    assert (result.exit_code, result.output.count("\n")) == (2, 1)
    assert not (tmp_path / "o.exr").exists()


def test_bad_files_are_one_line(tmp_path):
    rgb, mask, _ = ball()
    with pytest.raises(ValueError, match=r"expected one output \(N, 3, H, W\)"):
        normals.load(channel(tmp_path / "m.onnx", 0))
    nan = network(tmp_path / "n.onnx", scale=(np.nan,) * 3)
    with pytest.raises(ValueError, match="'n' holds NaN"):
        shadow.infer_normals(rgb, mask, model=nan)
    with pytest.raises(ValueError, match=r"order: applies to \.onnx files only"):
        normals.load("field", order="bgr")
