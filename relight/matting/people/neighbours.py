"""One of several people who stand side by side: their mask without pieces of the others.

The landmark network shows whoever is near the middle of its square, and takes close neighbours for a part of
them. So the detector looks once more, at both sides of the person. Where it sees several faces, the picture
is divided among them: each pixel belongs to the nearest body's axis. The network then looks at everybody
with the other bodies painted over. This second look counts beside the others; farther away the first one
does, unless it took somebody else for a part of the person. Where the masks overlap, the border follows the
picture's edges, see `person_border`.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt, gaussian_filter, label
from torch.nn import functional as F

from relight.matting.people import border as person_border
from relight.matting.people.choice import CERTAIN
from relight.matting.people.detector import Detector
from relight.matting.people.region import ROOM, Circle, DetectedPerson
from relight.matting.refine import distance_inside
from shadow.framing import affine_sample

WIDTH = 2  # side of the scene that is divided, of the square around the person
VIEW = 2.2  # of the radius: side of what the detector sees
RAISED = 0.22  # of the radius: how far its middle is above the hips
ASIDE = (-0.6, 0.0, 0.6)  # of the radius: how far aside it is
SCORE, SAME_FACE = 0.5, 0.24  # of detections, at least; overlap of two boxes from which they are of one face
LEAST_SIZE = 0.4  # of another body, of the person's
HEAD = 0.6  # of the radius: how far the head is from the hips
AXIS = (1.7, -0.3)  # ends of a body's axis below the head, of the radius
MARGIN = 0.1  # of the radius: how far beyond the middle between two axes each body is still shown
BLUR = 3.0  # pixels of the scene, of the edge of what is painted over
CONFUSED = 0.1  # of a mask, that lies on other people: from there it is one of several people
BESIDE = (0.1, 0.3)  # of the radius: how far beside others the second look counts fully, and at all


def alone(
    copy: tuple[torch.Tensor, np.ndarray],
    person: DetectedPerson,
    detector: Detector,
    look: Callable[[torch.Tensor, Circle], Sequence[DetectedPerson]],
    at: np.ndarray | None = None,
) -> DetectedPerson:
    """Return a person without the people beside them, whose masks are `rivals` then.

    The same person if nobody is there.

    `copy`: the picture or a reduced one, (3, h, w), encoded in [0, 1], and the scale (x, y) from it to the
    picture, in whose pixels `person` is the one who is meant. `look`
    returns whom the landmark network sees in a circle of a picture. `at`: a point (x, y) on the person, if it
    was given.
    """
    picture, scale = copy
    side, size = len(person.mask), (WIDTH * len(person.mask),) * 2
    circle = person.circle
    matrix = Circle(circle.centre, WIDTH * circle.radius, circle.up).square(size[0])
    # After that the scene has about the picture's pixels, and sampling it takes no mean of many.
    onto = matrix / scale[:, None]
    shrink = max(1, min(int(np.hypot(*onto[:, 0])), *picture.shape[1:]))
    small, within = F.avg_pool2d(picture, shrink), torch.tensor(onto / shrink, dtype=torch.float32)
    radius = side / ROOM / 2
    corner = (size[0] - VIEW * radius) / 2
    squares = [(corner + aside * radius, corner - RAISED * radius, VIEW * radius) for aside in ASIDE]
    seen = detector.look(affine_sample(small, within, size), squares, SCORE, SAME_FACE)
    bodies = [body for body in (Circle.of(*each) for each in seen) if body.radius > LEAST_SIZE * radius]
    if len(bodies) < 2:
        return person
    scene = affine_sample(small, within, size, "border")
    shares, paint = _shares(bodies, size), scene.mean((1, 2), keepdim=True)
    views = [torch.lerp(paint, scene, torch.from_numpy(share)) for share in shares]
    everybody = [next(iter(look(view, body)), None) for view, body in zip(views, bodies, strict=True)]
    middle = (np.s_[(size[0] - side) // 2 : (size[0] + side) // 2],) * 2
    masks = [
        np.zeros_like(person.mask) if found is None else (found.on(size) * share)[middle]
        for found, share in zip(everybody, shares, strict=True)
    ]
    if at is None:
        own = int(np.argmax([(mask * person.mask).sum() / max(mask.sum(), 1) for mask in masks]))
    else:
        x, y = np.linalg.solve(matrix[:, :2], at - matrix[:, 2]) - (size[0] - side) / 2
        own = int(np.argmin([_distance(mask, x, y) for mask in masks]))
    certain = {index: found for index, found in enumerate(everybody) if found and found.certainty >= CERTAIN}
    others = [index for index in certain if index != own]
    if not others or own not in certain:
        return person
    rival = np.max([masks[index] for index in others], axis=0)
    mask = second_look_beside(rival, person.mask, masks[own], shares[own][middle])
    ours, *theirs = (person_border.bones(certain[index], size)[middle] for index in (own, *others))
    seen_here = scene.permute(1, 2, 0).numpy()[middle]
    border = person_border.within(seen_here, mask, rival, ours, np.any(theirs, axis=0))
    return replace(person, mask=_in_one_piece(np.minimum(mask, border), masks[own]), rivals=rival)


def _shares(bodies: Sequence[Circle], size: tuple[int, int]) -> list[np.ndarray]:
    """Return for each body where it is shown, around what is nearest to its axis: (h, w) in [0, 1]."""
    places = np.moveaxis(np.mgrid[: size[0], : size[1]][::-1], 0, -1) + 0.5
    distances = []
    for body in bodies:
        head = body.centre + HEAD * body.radius * body.up
        low, high = (head + [0, end * body.radius] for end in AXIS)
        along = ((places - low) @ (high - low) / ((high - low) @ (high - low))).clip(0, 1)
        distances.append(np.linalg.norm(places - low - along[..., None] * (high - low), axis=-1))
    return [
        gaussian_filter(
            np.float32(
                own < np.min(distances[:index] + distances[index + 1 :], axis=0) + MARGIN * body.radius
            ),
            BLUR,
        )
        for index, (own, body) in enumerate(zip(distances, bodies, strict=True))
    ]


def second_look_beside(
    rival: np.ndarray, first: np.ndarray, second: np.ndarray, share: np.ndarray
) -> np.ndarray:
    """Return a person's mask of two looks, the second one with the neighbours painted over: (h, w) in [0, 1].

    `rival` are the neighbours' masks, and `share` where they are not painted over. What is painted over can
    mislead the network anywhere. So a first mask that has little of the neighbours is replaced beside them
    only.
    """
    theirs = (rival > 0.5) & (rival > share * second)
    if first[theirs].sum() < CONFUSED * first.sum():
        near, far = (reach * len(first) / ROOM / 2 for reach in BESIDE)
        away = -distance_inside(rival > 0.5)
        share = share * ((far - away) / (far - near)).clip(0, 1)
    return share * second + (1 - share) * first


def _in_one_piece(mask: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Return the piece of a mask (h, w) that has most of the person's `own` one, with its soft edge."""
    pieces, count = label(mask > 0.5)
    if count > 1:
        largest = 1 + int(np.argmax(np.bincount(pieces.ravel(), own.ravel())[1:]))
        nearest = distance_transform_edt(pieces == 0, return_distances=False, return_indices=True)
        mask = np.where(pieces[tuple(nearest)] == largest, mask, 0)
    return mask.astype(np.float32)


def _distance(mask: np.ndarray, x: float, y: float) -> float:
    """Return how far a point is from what a mask (h, w) shows, in pixels."""
    rows, columns = np.nonzero(mask > 0.5)
    return float(np.hypot(columns + 0.5 - x, rows + 0.5 - y).min(initial=np.inf))
