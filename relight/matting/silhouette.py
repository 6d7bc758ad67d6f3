"""What belongs to a person: their hair, their hands and what they hold, by a network of 1024 pixels a side.

The pose networks (`relight.matting.people.finder`) say who is meant and where, with a mask of 256 pixels.
IS-Net cuts whatever stands out from a picture with all its detail, but knows no persons (Qin et al., "Highly
Accurate Dichotomous Image Segmentation", ECCV 2022). It sees a crop around the mask, so that a small person
in a large picture has its full resolution too. Then

- what lies nearer to other people than to the person belongs to them;
- where both networks disagree, each region is decided as a whole, see `silhouette_regions`: a white shirt
  before a white wall is opaque, and a motorcycle behind the person goes;
- so does what does not touch the inside of the mask, such as a logo on the wall.
"""

import functools
from collections.abc import Callable
from typing import Protocol

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter, label

from relight.matting import silhouette_files
from relight.matting.openvino_runtime import compiled
from relight.matting.people.choice import Choice
from relight.matting.refine import linear_coverage, upsampled
from relight.matting.silhouette_regions import CERTAIN, reconciled
from relight.media import colour
from relight.media.resampling import reduced_size, resize, size_within
from shadow.networks import precision

SIDE = 1024  # pixels of the network's square input
MARGIN = 0.25  # of the longer side of the mask's box: how far the crop reaches beyond it, and grows
WHOLE = 0.75  # of the picture's area, from which a crop is the picture: it could only grow a little
CROPS = 3  # that the network sees, at most, until nothing that is kept reaches the crop's border
CONNECTED = 0.15  # coverage from which pixels that touch are one part
DISPUTED = 0.05  # of the person, that one network shows and the other one does not: from there more views
OPAQUE = 0.8  # coverage from which the network is certain
HAZE = 0.05  # of that side: what is uncertain so far from what is certain is not the person's
CLEAR = 0.02  # coverage up to which a pixel is empty, and opaque from 1 - CLEAR
LEAST = 0.3  # of what was drawn: the network sees no person there if it sees less
MENDED = 0.5  # share of the network in a mended mask; with 0.7 it adds pieces of plain walls
MASK_SIDE, SLOPE = 256, 2.0  # pixels of a coarse mask; how much steeper its edge is in the picture
AROUND = 8  # pixels of the copy around what a matte shows, in which the photograph's edges are looked for
BORDER = 1.0  # standard deviation in pixels of the blur of the border between people
FILTER = "triangle"  # of `resize`, for copies


class Silhouette(Protocol):
    """A network that cuts out what stands before the background.

    It takes a crop (h, w, 3), sRGB-encoded in [0, 1], and the person's coarse mask in it, (h, w) in [0, 1],
    and returns coverage (h, w) in [0, 1].
    """

    def __call__(self, crop: np.ndarray, mask: np.ndarray) -> np.ndarray: ...


class IsNet:
    """IS-Net as `relight fetch silhouette` brings it; it has no use for the mask."""

    def __init__(self) -> None:
        self._path = silhouette_files.fetched()

    def __call__(self, crop: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """Return the coverage (h, w) of a crop; see `Silhouette`."""
        codes = 255 * resize(crop, (SIDE, SIDE), FILTER)
        seen = ((codes - 128) / 256).transpose(2, 0, 1)[None]
        network = compiled(str(self._path), precision.in_use("cpu"))
        found = network(np.ascontiguousarray(seen, np.float32))[0][0, 0]
        found = resize(found[..., None], crop.shape[:2], FILTER)[..., 0].clip(0, 1)
        return linear_coverage(found, crop)


def load() -> IsNet | None:
    """Return IsNet; None if it has not been fetched.

    Raises DamagedFileError for another file than the published one.
    """
    return _isnet() if silhouette_files.are_fetched() else None


@functools.lru_cache(maxsize=1)
def _isnet() -> IsNet:
    return IsNet()


def person_matte(
    encoded: np.ndarray,
    choice: Choice,
    network: Silhouette,
    with_more_views: Callable[[Choice], Choice] | None = None,
) -> np.ndarray:
    """Return the matte (H, W) of whoever is chosen in a photograph (H, W, 3), sRGB-encoded in [0, 1].

    `with_more_views` returns the choice with a better mask; it is asked where the networks disagree. Zero if
    nothing of the person is in the picture.
    """
    matte = np.zeros(encoded.shape[:2], np.float32)
    grow = _margin(choice)
    box = _within(choice.box() + grow, encoded.shape)
    for number in range(CROPS):
        crop = encoded[box[0] : box[2], box[1] : box[3]]
        seen, shrink = _copy(crop)
        place = (box[0], box[1]), shrink
        found = network(seen, choice.masks(*place, seen.shape[:2])[0])
        alpha, disputed = _theirs(
            found, seen, *choice.masks(*place, seen.shape[:2]), choice.landmarks(*place)
        )
        if number == 0 and disputed > DISPUTED and with_more_views is not None:
            choice = with_more_views(choice)
            alpha, _ = _theirs(found, seen, *choice.masks(*place, seen.shape[:2]), choice.landmarks(*place))
        wider = _within(box + grow * _touched(alpha), encoded.shape)
        if number == CROPS - 1 or (wider == box).all():
            break
        box = wider
    matte[box[0] : box[2], box[1] : box[3]] = _at_full_size(alpha, seen, crop)
    return matte


def _margin(choice: Choice) -> np.ndarray:
    """Return by how much the crop exceeds a person's box (top, left, bottom, right) at each end."""
    top, left, bottom, right = choice.box()
    step = round(MARGIN * max(bottom - top, right - left))
    return np.array([-step, -step, step, step])


def _within(box: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return what a picture (H, W, ...) has of a box (top, left, bottom, right); all if it is most."""
    whole = np.array([0, 0, *shape[:2]])
    box = np.clip(box, [0, 0, 0, 0], [*shape[:2], *shape[:2]])
    return whole if np.prod(box[2:] - box[:2]) > WHOLE * np.prod(shape[:2]) else box


def rough_matte(encoded: np.ndarray, choice: Choice) -> np.ndarray:
    """Return the coarse mask (H, W) of a person, whose edge follows that of the photograph."""
    seen, shrink = _copy(encoded)
    mask = _with_edges_of(seen, choice.masks((0, 0), shrink, seen.shape[:2])[0])
    return resize(mask, encoded.shape[:2], "triangle").clip(0, 1)


def mended_mask(encoded: np.ndarray, choice: Choice, network: Silhouette) -> np.ndarray:
    """Return the coarse mask (H, W) of who is chosen in a photograph, mended by what a network sees there.

    It is the mean of both: the mask knows best who is meant, the network knows hands and gaps. The photograph
    is (H, W, 3), sRGB-encoded in [0, 1]. The mask of everybody together stays as it is.
    """
    mask = choice.mask()
    if choice.index is None:
        return mask
    box = _within(choice.box() + _margin(choice), encoded.shape)
    crop = encoded[box[0] : box[2], box[1] : box[3]]
    seen, shrink = _copy(crop)
    theirs, rivals = choice.masks((box[0], box[1]), shrink, seen.shape[:2])
    found = network(seen, theirs)
    if (rivals > 0.5).any():
        found = found * _nearer(theirs, rivals)
    mended = (1 - MENDED) * mask
    mended[box[0] : box[2], box[1] : box[3]] += MENDED * _at_full_size(found, seen, crop)
    return mended


def matte_within(encoded: np.ndarray, outer: np.ndarray, network: Silhouette) -> np.ndarray | None:
    """Return the matte (H, W) of what somebody drew around a person in a photograph (H, W, 3), sRGB-encoded.

    Nothing is beyond `outer`, (H, W) in [0, 1]. None where the network sees nothing of that size: then the
    drawing is to be solved by its colours.
    """
    rows, columns = np.nonzero(outer > 0.5)
    if not len(rows):
        return None
    margin = round(MARGIN * (max(np.ptp(rows), np.ptp(columns)) + 1))
    box = np.s_[
        max(rows.min() - margin, 0) : rows.max() + margin + 1,
        max(columns.min() - margin, 0) : columns.max() + margin + 1,
    ]
    crop = encoded[box]
    seen, _ = _copy(crop)
    drawn = resize(outer[box].astype(np.float32), seen.shape[:2], FILTER)
    alpha = np.minimum(_without_noise(network(seen, drawn)), drawn)
    if (alpha > 0.5).sum() < LEAST * (drawn > 0.5).sum():
        return None
    matte = np.zeros(encoded.shape[:2], np.float32)
    matte[box] = _at_full_size(alpha, seen, crop)
    return matte


def _copy(crop: np.ndarray) -> tuple[np.ndarray, float]:
    """Return a copy (h, w, 3) of a crop, of the network's size at most, and its scale."""
    shrink = min(1.0, SIDE / max(crop.shape[:2]))
    return resize(crop, reduced_size(crop.shape, shrink), FILTER), shrink


def _at_full_size(alpha: np.ndarray, seen: np.ndarray, crop: np.ndarray) -> np.ndarray:
    """Return a matte (h, w) of a copy `seen` of a crop at the crop's size; it follows the crop's edges."""
    if seen.shape == crop.shape:
        return alpha
    # Only around what the matte shows, since a large photograph takes time.
    ends = []
    for axis in (0, 1):
        shown = np.flatnonzero(alpha.any(axis=1 - axis))
        if not len(shown):
            return np.zeros(crop.shape[:2], np.float32)
        ends.append((max(shown[0] - AROUND, 0), min(shown[-1] + 1 + AROUND, alpha.shape[axis])))
    scales = (crop.shape[0] / alpha.shape[0], crop.shape[1] / alpha.shape[1])
    small = tuple(slice(*each) for each in ends)
    large = tuple(
        slice(*(round(end * scale) for end in each)) for each, scale in zip(ends, scales, strict=True)
    )
    matte = np.zeros(crop.shape[:2], np.float32)
    matte[large] = upsampled(
        colour.decode(seen[small], "sRGB"), alpha[small], colour.decode(crop[large], "sRGB")
    )
    return matte


def _without_noise(found: np.ndarray) -> np.ndarray:
    """Return coverage with what is nearly none or nearly full made so."""
    return ((found - CLEAR) / (1 - 2 * CLEAR)).clip(0, 1)


def _theirs(
    found: np.ndarray, seen: np.ndarray, mask: np.ndarray, rivals: np.ndarray, landmarks: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return what of the coverage that a network found in a picture (h, w, 3) belongs to a person.

    `mask` and `rivals` are the coarse masks of the person and of the others; all are (h, w) in [0, 1].
    `landmarks` and the share that is disputed are as in `reconciled`.
    """
    alpha = _without_noise(found)
    rows, columns = np.nonzero(mask > 0.5)
    if not len(rows):
        return np.zeros_like(alpha), 0.0
    if (rivals > 0.5).any():
        alpha = alpha * _nearer(mask, rivals)
    alpha, disputed = reconciled(alpha, mask, _with_edges_of(seen, mask), landmarks)
    parts, count = label(alpha > CONNECTED, np.ones((3, 3)))
    kept = np.zeros(count + 1, bool)
    kept[parts[mask > CERTAIN * min(1.0, float(mask.max()))]] = True
    kept[0] = False
    alpha = np.where(binary_dilation(kept[parts], np.ones((3, 3))), alpha, 0)
    side = max(np.ptp(rows), np.ptp(columns)) + 1
    alpha = np.where(distance_transform_edt(alpha < OPAQUE) > HAZE * side, 0, alpha)
    return alpha.astype(np.float32), disputed


def _with_edges_of(seen: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return a coarse mask (h, w) whose edge follows that of a picture (h, w, 3)."""
    size = size_within(mask.shape, MASK_SIDE)
    small = resize(np.dstack([seen, mask]).astype(np.float32), size, FILTER)
    return (0.5 + SLOPE * (upsampled(small[..., :3], small[..., 3], seen) - 0.5)).clip(0, 1)


def _nearer(mask: np.ndarray, rivals: np.ndarray) -> np.ndarray:
    """Return where pixels are nearer to a person's mask than to the others': (h, w) in [0, 1]."""
    theirs = (rivals > 0.5) & (rivals > mask)
    known = theirs | (mask > 0.5)
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return gaussian_filter(np.float32(~theirs[tuple(nearest)]), BORDER)


def _touched(alpha: np.ndarray) -> list[bool]:
    """Return whether a matte (h, w) reaches the top, the left, the bottom and the right of its crop."""
    return [bool((edge > 0.5).any()) for edge in (alpha[0], alpha[:, 0], alpha[-1], alpha[:, -1])]
