"""MediaPipe's pose detector: where people are in a picture, and in parts of it for small people."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import torch
from scipy.special import expit

from relight.matting.openvino_runtime import Network
from relight.matting.people.region import sampled

DETECTOR_SIDE = 224  # pixels of the network's square input
STRIDES = (8, 16, 32, 32, 32)  # pixels of the detector's layers of anchors; each cell has two anchors
SAME_FACE = 0.3  # intersection over union of two detections' boxes from which they are of one person
SHARES = (1.0, 1.4, 0.5, 0.25)  # sides of the parts that the detector sees, of the picture's longer side


class Detector:
    """The detector: `network` is what OpenVINO compiled of its file."""

    def __init__(self, network: Network) -> None:
        self._network, self.anchor_centres = network, anchor_centres()

    def __call__(
        self, picture: torch.Tensor, share: float, least: float
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the hips and the circle's rim, (x, y), of everybody that the detector sees in the parts.

        `least` is the least score.
        """
        return self.look(picture, picture_parts(picture.shape[2], picture.shape[1], share), least)

    def look(
        self,
        picture: torch.Tensor,
        squares: Iterable[tuple[float, float, float]],
        least: float,
        same_face: float = SAME_FACE,
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return whom the detector sees in squares (left, top, side) of a picture, as `__call__` does.

        Of faces that overlap more than `same_face`, the one of the highest score counts.
        """
        scores, boxes, points = [], [], []
        for left, top, side in squares:
            step = side / DETECTOR_SIDE
            seen = sampled(picture, np.array([[step, 0, left], [0, step, top]]), DETECTOR_SIDE)
            answers, odds = self._network(seen * 2 - 1).values()
            score = expit(odds[0, :, 0].clip(-100, 100))
            kept = score > least
            values = answers[0][kept].reshape(-1, 6, 2) / DETECTOR_SIDE  # a centre, a size, four points
            values[:, [0, 2, 3, 4, 5]] += self.anchor_centres[kept][:, None]
            corner = np.array([left, top])
            scores.append(score[kept])
            boxes.append(np.stack([values[:, 0] * side + corner, values[:, 1] * side], axis=1))
            points.append(values[:, 2:4] * side + corner)
        score, box, point = map(np.concatenate, (scores, boxes, points))
        found, order = [], np.argsort(-score, kind="stable")
        while len(order):
            best, others = order[0], order[1:]
            found.append((point[best, 0], point[best, 1]))
            order = others[_overlaps(box[best], box[others]) < same_face]
        return found


def picture_parts(width: int, height: int, share: float) -> Iterator[tuple[float, float, float]]:
    """Yield the squares (left, top, side) in pixels that cover a picture, half overlapping.

    A square that is larger than the picture has room below it, where a body that the frame cuts goes on.
    """
    side = share * max(width, height)
    if share > 1:
        yield (width - side) / 2, 0.0, side
        return
    for top in _starts(height, side):
        for left in _starts(width, side):
            yield left, top, side


def _starts(length: float, side: float) -> Sequence[float]:
    """Return where squares begin along a length, the only one centred."""
    if length <= side:
        return [(length - side) / 2]
    return [
        float(start) for start in np.linspace(0, length - side, int(np.ceil(2 * (length / side - 1))) + 1)
    ]


def anchor_centres() -> np.ndarray:
    """Return the centres (2254, 2) of the detector's anchors, as fractions of its input."""
    centres = []
    for stride in STRIDES:
        cells = DETECTOR_SIDE // stride
        rows, columns = np.mgrid[:cells, :cells] + 0.5
        centres.append(np.repeat(np.stack([columns, rows], axis=-1).reshape(-1, 2) / cells, 2, axis=0))
    return np.concatenate(centres).astype(np.float32)


def _overlaps(box: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return the intersection over union (N,) of a box with others; a box is a centre and a size (2, 2)."""
    low = np.maximum(box[0] - box[1] / 2, others[:, 0] - others[:, 1] / 2)
    high = np.minimum(box[0] + box[1] / 2, others[:, 0] + others[:, 1] / 2)
    shared = (high - low).clip(0).prod(axis=1)
    return shared / (box[1].prod() + others[:, 1].prod(axis=1) - shared).clip(1e-9)
