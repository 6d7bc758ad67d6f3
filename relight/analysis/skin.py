"""Where skin is seen on a person: what MediaPipe's landmark network says of face, neck, forearms and calves.

The network is one of the two that find people (`relight fetch person`). It sees the person on the canvas,
once or twice. Where it has not been fetched, no skin is known.
"""

import functools
import importlib.util
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F

from relight.errors import DamagedFileError, MissingNetworksError
from relight.matting.openvino_runtime import Network, compiled
from relight.matting.people import files as person_files
from relight.matting.people.region import LANDMARK_SIDE, Circle, sampled

# Rows of the landmarks.
LEFT_EYE, RIGHT_EYE, EYES, MOUTH, SHOULDERS = map(slice, (1, 4, 1, 9, 11), (4, 7, 7, 11, 13))
LIMBS = ((13, 15), (14, 16), (15, 19), (16, 20), (25, 27), (26, 28))  # forearms, hands, calves
VALUES = 5  # x, y, z, visibility, presence
PRESENT = 0.5  # the network's opinion from which somebody is there
CLOSE = (1.6, 2.6)  # height of a person whom the frame cuts, in widths of what it shows: two tries
STEP, HALF = 4, 2  # canvas pixels of one of these maps, and of what the network is shown
# In distances from the eyes to the mouth: half the height and the width of a face, the radius of the neck.
FACE, HEAD, NECK = (1.25, 0.95), (1.75, 1.35), 0.5
LIMB, SLEEVE = 0.16, 0.3  # radius of a limb, of its length; the share of it that a sleeve may cover
BODY = 0.7  # certainty of skin outside the head
TURNED = 0.1  # distance of the left eye to the right of the right one, below which the face is turned away
EYE, LIPS = 0.38, (0.7, 0.3)  # half an eye's width; of the mouth's width, half its own width and its height

# Of a picture (1, 3, h, w): its outputs are the landmarks, their presence, and others.
Landmarks = Network


class Skin(NamedTuple):
    """Where on the canvas, (h, w): `face`, bool; in [0, 1], without eyes and mouth, `places`, where skin may
    be, and `sure`, where it is."""

    face: torch.Tensor
    places: torch.Tensor
    sure: torch.Tensor


def find(image: torch.Tensor, known: torch.Tensor, network: Landmarks | None = None) -> Skin | None:
    """Return where skin may be on a canvas image (3, h, w), encoded in about [0, 1].

    `known`: (h, w), where it shows the person. `network`: of landmarks, the fetched one by default. None: it
    has not been fetched, or sees nobody.
    """
    points = joints(image, known, network)
    return None if points is None else _skin(points / STEP, known)


def joints(image: torch.Tensor, known: torch.Tensor, network: Landmarks | None = None) -> np.ndarray | None:
    """Return the joints (33, 2) as (x, y) on a canvas; those that are not seen are not finite.

    The arguments, and None, are as in `find`.
    """
    network = network or _network()
    if network is None or not known.any():
        return None
    # Half the rows of a canvas are about those that the network sees.
    small = F.avg_pool2d(torch.where(known, image.clamp(0, 1), torch.tensor(0.5)), HALF)
    points = _landmarks(network, small, known[::HALF, ::HALF])
    return None if points is None else points * HALF


def is_available() -> bool:
    """Return whether the network is there: what an analysis finds depends on it."""
    try:
        return person_files.are_fetched() and importlib.util.find_spec("openvino") is not None
    except OSError:  # no home folder
        return False


@functools.cache
def _network() -> Landmarks | None:
    """Return the landmark network; None where it has not been fetched, or OpenVINO is missing."""
    if not is_available():
        return None
    try:
        return compiled(str(person_files.fetched()[1]))
    except (ImportError, OSError, MissingNetworksError, DamagedFileError):
        return None


def _landmarks(network: Landmarks, image: torch.Tensor, known: torch.Tensor) -> np.ndarray | None:
    """Return the joints (33, 2) as (x, y) on an image (3, h, w); those that are not seen are not finite."""
    ys, xs = (values.numpy() for values in known.nonzero(as_tuple=True))
    top, height, width = ys.min(), np.ptp(ys), np.ptp(xs)
    is_cut = ys.max() >= len(known) - 2 or width > height / 1.3
    for widths in CLOSE if is_cut else (0.0,):
        middle = np.array([np.median(xs), top + max(height, widths * width) / 2])
        circle = Circle.of(middle, np.array([middle[0], top - 0.05 * height]))
        square = circle.square(LANDMARK_SIDE)
        seen = sampled(image, square, LANDMARK_SIDE, "border")
        landmarks, presence, *_ = network(np.ascontiguousarray(seen)).values()
        if float(presence.ravel()[0]) >= PRESENT:
            values = landmarks.reshape(-1, VALUES)[:33].astype(float)
            points = values[:, :2] @ square[:, :2].T + square[:, 2]
            points[values[:, 3] < 0] = np.nan  # a logit
            return points
    return None


def _skin(points: np.ndarray, known: torch.Tensor) -> Skin | None:
    """Return where skin is, of joints on a canvas of `STEP` times fewer pixels.

    Of somebody who turns their face away, head and neck are hair and collar to the camera.
    """
    eyes, mouth = points[EYES].mean(axis=0), points[MOUTH].mean(axis=0)
    size = float(np.hypot(*(eyes - mouth)))
    if not size >= 1:
        return None
    up, middle = (eyes - mouth) / size, (eyes + mouth) / 2
    rows, columns = np.mgrid[: len(known) // STEP, : known.shape[1] // STEP]
    place = np.stack([columns, rows]).astype(np.float32) + np.float32(0.5)

    def ellipse(centre: np.ndarray, along: float, across: float) -> np.ndarray:
        x, y = place[0] - centre[0], place[1] - centre[1]
        return ((x * up[0] + y * up[1]) / along) ** 2 + ((y * up[0] - x * up[1]) / across) ** 2 < 1

    def capsule(start: np.ndarray, end: np.ndarray, radius: float) -> np.ndarray:
        way = end - start
        x, y = place[0] - start[0], place[1] - start[1]
        along = ((x * way[0] + y * way[1]) / max(float(way @ way), 1e-6)).clip(0, 1)
        return (x - along * way[0]) ** 2 + (y - along * way[1]) ** 2 < radius**2

    right, left = (points[eye].mean(axis=0) for eye in (RIGHT_EYE, LEFT_EYE))
    is_seen = (left - right) @ np.array([-up[1], up[0]]) > TURNED * size
    face = is_seen & ellipse(middle + 0.05 * size * up, FACE[0] * size, FACE[1] * size)
    head = is_seen & ellipse(middle + 0.25 * size * up, HEAD[0] * size, HEAD[1] * size)
    places = np.zeros_like(face)
    shoulders = points[SHOULDERS].mean(axis=0)
    if is_seen and np.isfinite(shoulders).all():
        places |= capsule(mouth, mouth + 0.75 * (shoulders - mouth), NECK * size)
    for start, end in LIMBS:
        length = float(np.hypot(*(points[end] - points[start])))
        if np.isfinite(length):
            begin = points[start] + SLEEVE * (points[end] - points[start])
            places |= capsule(begin, points[end], max(LIMB * length, 1.0))
    likely = np.stack([np.maximum(BODY * places, head), np.maximum(BODY * places, face)])
    for eye in (left, right):
        likely *= ~ellipse(eye, 0.6 * EYE * size, EYE * size)
    wide = max(float(np.hypot(*np.diff(points[MOUTH], axis=0)[0])), 0.5 * size)
    likely *= ~ellipse(mouth, LIPS[1] * wide, LIPS[0] * wide)
    soft = F.avg_pool2d(torch.from_numpy(likely).float(), 3, stride=1, padding=1)
    soft = F.interpolate(soft[None], known.shape, mode="bilinear")[0] * known
    whole = F.interpolate(torch.from_numpy(np.float32(face))[None, None], known.shape)[0, 0]
    return Skin((whole > 0) & known, *soft)
