"""ONNX networks of odd inputs, outputs, types and answers, and damaged ones; a kind of hostile inputs."""

from pathlib import Path
from random import Random

import numpy as np

import relight
from helpers import hostile
from helpers.invariants import require, require_finite, require_named

SIZES = (1, 3, 32, 0, -1, "n", "height", 100000)
SCALES = (1, 1, 1, 1, 255, 255, -4, float("nan"), 1e30)
PHOTOGRAPH = np.zeros((40, 32, 3), np.float32)
PHOTOGRAPH[8:36, 8:24] = 0.9


def onnx_model(random: Random, folder: Path) -> None:
    """A matting network: it is refused, or its matte is one."""
    path = folder / "odd.onnx"
    content = _model(random)
    path.write_bytes(hostile.damaged(random, content) if random.random() < 0.15 else content)
    options = {"mean": (0, 0, 0), "std": (1, 1, 1), "size": random.choice([32, 64])}
    options |= {"output": random.choice([0, 1, 9])} if random.random() < 0.3 else {}
    options |= {"sigmoid": True} if random.random() < 0.3 else {}
    try:
        found = relight.matte(PHOTOGRAPH, path, **options)
    except (ValueError, TypeError, OSError) as error:
        if "output:" not in str(error):
            require_named(path, error)
        raise
    require(found.shape == PHOTOGRAPH.shape[:2] and found.dtype == np.float32, "no matte")
    require_finite("matte", found)
    require(found.min() >= 0 and found.max() <= 1, "matte out of [0, 1]")


def _model(random: Random) -> bytes:
    import onnx
    from onnx import helper

    types = [onnx.TensorProto.FLOAT] * 6 + [
        onnx.TensorProto.FLOAT16, onnx.TensorProto.DOUBLE, onnx.TensorProto.UINT8, onnx.TensorProto.BFLOAT16,
    ]  # fmt: skip
    kind = random.choice(types)
    shape = [1, 3, "h", "w"] if random.random() < 0.5 else [1, 3, 32, 32]
    if random.random() < 0.15:
        shape[random.randrange(4)] = random.choice(SIZES)
    node = random.choice(["ReduceMean", "ReduceMean", "ReduceMax", "ReduceMin", "Identity", "Shape"])
    inner = {"axes": [1], "keepdims": 1} if node.startswith("Reduce") else {}
    nodes = [helper.make_node(node, ["x"], ["m"], **inner)]
    factor = helper.make_tensor("k", onnx.TensorProto.FLOAT, [], [random.choice(SCALES)])
    nodes += [helper.make_node("Cast", ["m"], ["f"], to=onnx.TensorProto.FLOAT)]
    nodes += [helper.make_node("Mul", ["f", "k"], ["y"])]
    answer = random.choice([[1, 1, "h", "w"]] * 3 + [None, [1, 3, "h", "w"], [1]])
    outputs = ["y"] + ["f"] * (random.random() < 0.3)
    graph = helper.make_graph(
        nodes, "odd", [helper.make_tensor_value_info("x", kind, shape)],
        [helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, answer) for name in outputs], [factor],
    )  # fmt: skip
    return helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8
    ).SerializeToString()
