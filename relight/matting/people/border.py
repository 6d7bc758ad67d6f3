"""The border between a person and the people who touch them, along the picture's edges.

The bones that the landmark network finds are surely of one or of the others. From each other pixel of their
masks a random walk, which seldom crosses edges, reaches the person's bones or the others' first (Grady,
"Random Walks for Image Segmentation", 2006).
"""

from typing import TYPE_CHECKING

import numpy as np
import torch
from PIL import Image, ImageDraw
from scipy.ndimage import distance_transform_edt
from scipy.special import expit
from torch.nn import functional as F

from relight.matting.people.region import DetectedPerson
from relight.media.resampling import resize

if TYPE_CHECKING:
    from scipy.sparse import spmatrix

BONES = (
    *((7, 8), (11, 12), (23, 24), (11, 23), (12, 24)),  # ears, shoulders, hips, and both sides
    *((11, 13), (13, 15), (12, 14), (14, 16)),  # arms
    *((23, 25), (25, 27), (24, 26), (26, 28)),  # legs
)  # pairs of the network's landmarks
TORSO = (11, 12, 24, 23)
WIDTH = 0.1  # of the radius: that of a bone
SHRINK = 2  # pixels of the masks to one in which walks are counted
COVERED = 0.4  # of a pixel by a mask, from which walks go through it
EDGE = 300.0  # of the squared difference of encoded colours: how seldom a walk crosses an edge
LEAST_STEP = 1e-3  # of a walk, across any edge, relative to one between equal colours
SURE, LIKELY = 1e3, 3e-4  # weights of the bones, and of what the masks say elsewhere
SHARPNESS = 64.0  # of the border, whose masks are as soft as the networks' ones otherwise


def bones(person: DetectedPerson, size: tuple[int, int]) -> np.ndarray:
    """Return where a picture (h, w) shows a person's bones within their mask, bool; nowhere if not known."""
    drawn = Image.new("1", size[::-1])
    if person.landmarks is not None:
        pen, points = ImageDraw.Draw(drawn), [tuple(point) for point in person.landmarks]
        pen.polygon([points[each] for each in TORSO], fill=1)
        for first, last in BONES:
            pen.line([points[first], points[last]], fill=1, width=max(1, round(WIDTH * person.circle.radius)))
    return np.asarray(drawn) & (person.on(size) > 0.5)


def within(
    seen: np.ndarray, mask: np.ndarray, rival: np.ndarray, own: np.ndarray, others: np.ndarray
) -> np.ndarray:
    """Return where the person is, and not one of the others: (h, w) in [0, 1], divided within their masks.

    `seen` is the picture (h, w, 3), encoded in [0, 1], `mask` what may be the person and `rival` the others,
    (h, w) in [0, 1]; `own` and `others` their bones, bool.
    """
    layers = np.dstack([seen, mask, rival, own & ~others, others & ~own]).astype(np.float32)
    small = F.avg_pool2d(torch.from_numpy(layers).permute(2, 0, 1), SHRINK).permute(1, 2, 0).numpy()
    mask, rival, own, others = *np.moveaxis(small[..., 3:5], -1, 0), *np.moveaxis(small[..., 5:] > 0.5, -1, 0)
    person = (mask + 0.05) / (mask + rival + 0.1)
    if own.any() and others.any():
        from scipy.sparse import diags  # the import takes time, and somebody alone needs none
        from scipy.sparse.linalg import spsolve

        known = own | others
        region = (np.maximum(mask, rival) > COVERED) | known
        weight = np.where(known, SURE, LIKELY)[region]
        system = _laplacian(small[..., :3], region) + diags(weight)
        person[region] = spsolve(system.tocsc(), weight * np.where(known, own, person)[region])
        nearest = distance_transform_edt(~region, return_distances=False, return_indices=True)
        person = person[tuple(nearest)]
    return expit(SHARPNESS * (resize(person, seen.shape[:2], "triangle") - 0.5))


def _laplacian(colours: np.ndarray, region: np.ndarray) -> "spmatrix":
    """Return the sparse Laplacian of walks from pixel to pixel of a region (h, w) of a picture (h, w, 3)."""
    from scipy.sparse import coo_matrix, csgraph

    number = np.cumsum(region).reshape(region.shape) - 1
    ends, weights = [], []
    for this, that in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        both = region[this] & region[that]
        ends.append((number[this][both], number[that][both]))
        weights.append(np.exp(-EDGE * ((colours[this] - colours[that])[both] ** 2).sum(axis=-1)) + LEAST_STEP)
    steps = coo_matrix((np.concatenate(weights), np.concatenate(ends, axis=1)), (region.sum(),) * 2)
    return csgraph.laplacian(steps + steps.T)
