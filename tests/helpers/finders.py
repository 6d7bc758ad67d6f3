"""Two small networks with the inputs and outputs of MediaPipe's pose networks: a person is what is red."""

import numpy as np

from relight.matting import openvino_runtime
from relight.matting.people import finder
from relight.matting.people import region as person_region

CELLS = 28  # of the detector's finest layer
REACH = 20 / 224  # from the hips to the circle's rim, straight up, as a share of what the detector sees


def small_finder(folder, presence=None):
    """A `PersonFinder` for whom a person is a red disc; `presence` in place of the redness of the middle."""
    openvino = openvino_runtime.openvino()
    ops = openvino.opset13

    def redness(side):
        picture = ops.parameter([1, side, side, 3], np.float32)
        red, green = (ops.gather(picture, np.int64([channel]), np.int64(3)) for channel in (0, 1))
        return picture, ops.reshape(ops.subtract(red, green), np.int64([1, 1, side, side]), False)

    picture, red = redness(224)
    cells = ops.avg_pool(red, [8, 8], [0, 0], [0, 0], [8, 8], False)
    fine = ops.reshape(cells, np.int64([1, CELLS**2, 1]), False)
    twice = ops.reshape(ops.concat([fine, fine], 2), np.int64([1, 2 * CELLS**2, 1]), False)
    logits = ops.multiply(
        ops.subtract(twice, np.float32(1.0)), np.float32(20)
    )  # -1..1 is seen: red is 2 more
    others = np.full((1, 2254 - 2 * CELLS**2, 1), -100, np.float32)
    boxes = np.zeros((1, 2254, 12), np.float32)
    boxes[..., 2:4], boxes[..., 7] = 24, -REACH * 224
    answer = ops.add(
        ops.constant(boxes),
        ops.multiply(ops.reduce_mean(picture, np.int64([0, 1, 2, 3]), False), np.float32(0)),
    )
    detector = openvino.Model([answer, ops.concat([logits, ops.constant(others)], 1)], [picture], "detector")

    picture, red = redness(256)
    landmarks = np.zeros((39, 5), np.float32)
    landmarks[finder.HIPS, :2] = 128
    landmarks[finder.RIM, :2] = 128, 128 - 128 / person_region.ROOM
    middle = ops.reshape(
        ops.gather(ops.reshape(red, np.int64([-1]), False), np.int64([128 * 257]), np.int64(0)),
        np.int64([1, 1]),
        False,
    )
    there = middle if presence is None else ops.add(ops.multiply(middle, np.float32(0)), np.float32(presence))
    mask = ops.multiply(
        ops.subtract(ops.reshape(red, np.int64([1, 256, 256, 1]), False), np.float32(0.4)), np.float32(50)
    )
    still = ops.add(ops.constant(landmarks.reshape(1, -1)), ops.multiply(middle, np.float32(0)))
    network = openvino.Model([still, there, mask], [picture], "landmarks")
    paths = [folder / "detector.xml", folder / "landmarks.xml"]
    for model, path in zip((detector, network), paths, strict=True):
        openvino.save_model(model, path, compress_to_fp16=False)
    return finder.PersonFinder(*paths)


def discs(size, *people):
    """A grey photograph (H, W, 3), encoded in [0, 1], with red discs (x, y, radius); and where each is."""
    picture, y, x = np.full((*size, 3), 0.3, np.float32), *np.mgrid[: size[0], : size[1]]
    where = [np.hypot(x + 0.5 - left, y + 0.5 - top) < radius for left, top, radius in people]
    for disc in where:
        picture[disc] = (1.0, 0.0, 0.0)
    return picture, where
