"""Small ONNX networks. A test that asks for one is skipped where ONNX or its runtime is not installed."""

import numpy as np
import pytest

from relight.matting import networks


def onnx_package():
    """Return the package `onnx`, or skip the test that needs it."""
    pytest.importorskip("onnxruntime")
    return pytest.importorskip("onnx")


def save(path, nodes, inputs, outputs, kind="FLOAT", **constants):
    """An ONNX file of these nodes; inputs and outputs as {name: shape}, of the type `kind`."""
    onnx = onnx_package()
    helper, number = onnx.helper, getattr(onnx.TensorProto, kind)
    graph = helper.make_graph(
        nodes,
        "small",
        [helper.make_tensor_value_info(name, number, shape) for name, shape in inputs.items()],
        [helper.make_tensor_value_info(name, number, shape) for name, shape in outputs.items()],
        [onnx.numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
    return path


def channel(
    path, index, shape=(1, 3, 64, 64), name="x", outputs=("y",), then=None, extra=0, kind="FLOAT"
):  # fmt: skip
    """A network whose matte is a channel of what it is fed; `extra` more outputs are all zero."""
    helper = onnx_package().helper
    nodes = [helper.make_node("Slice", [name, "from", "to", "axis"], [outputs[0] if then is None else "c"])]
    if then is not None:
        nodes.append(helper.make_node(then, ["c"], [outputs[0]]))
    plane = [shape[0], 1, *shape[2:]]
    names = [outputs[0], *(f"e{number}" for number in range(extra))]
    nodes += [helper.make_node("Mul", ["zero", outputs[0]], [more]) for more in names[1:]]
    constants = {"from": np.int64([index]), "to": np.int64([index + 1]), "axis": np.int64([1])}
    constants |= {"zero": np.float32(0)} if extra else {}
    return save(path, nodes, {name: list(shape)}, dict.fromkeys(names, plane), kind, **constants)


def recurrent(path):
    """As RVM's files are: its matte is the red channel plus a tenth for each frame before."""
    helper = onnx_package().helper
    sizes = ["n", "c", "h", "w"]
    inputs = {"src": ["n", 3, "H", "W"], **dict.fromkeys(networks.STATES, sizes), "downsample_ratio": [1]}
    nodes = [
        helper.make_node("Slice", ["src", "a", "b", "axis"], ["red"]),
        helper.make_node("Add", ["red", "r1i"], ["pha"]),
        helper.make_node("Identity", ["src"], ["fgr"]),
        helper.make_node("Add", ["r1i", "tenth"], ["r1o"]),
        *(helper.make_node("Identity", [f"r{n}i"], [f"r{n}o"]) for n in (2, 3, 4)),
    ]
    outputs = {"fgr": ["n", 3, "H", "W"], "pha": ["n", 1, "H", "W"]}
    outputs |= {name.replace("i", "o"): sizes for name in networks.STATES}
    numbers = {"a": np.int64([0]), "b": np.int64([1]), "axis": np.int64([1]), "tenth": np.float32(0.1)}
    return save(path, nodes, inputs, outputs, **numbers)
