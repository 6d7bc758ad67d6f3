"""The person cut out of a plate: their coverage, their own colour, and which pixels show them."""

import functools
import itertools
import math
from typing import Self

import numpy as np
import torch
import torch.nn.functional as F

from relight.media.buffers import lazy_zeros
from relight.media.images import person_mask, scene_linear, without_empty_alpha
from relight.media.resampling import fill_unknown
from shadow import inputs
from shadow.framing import bounding_box
from shadow.matte_cleanup import clean_matte

OPAQUE_COVERAGE = 0.98  # above it, a photograph's pixel shows hardly any background
NEARLY_OPAQUE_COVERAGE = 0.9  # counts as opaque where no pixel within EDGE_PIXELS has less
EDGE_PIXELS = 2
MIN_COVERAGE = 0.05  # below it, premultiplied colour is too coarse to divide by, or a matte is noise
NEIGHBOURS = (2.0, 1.0)  # standard deviations, pixels, of the means that colours are solved from again
NEIGHBOUR_RADIUS = 2  # pixels
CONTINUED_WEIGHT = np.float32(0.1)  # of the continued colour in such a mean, where a covered pixel has 1
BACKGROUND_VARIANCE = 3.0  # of a continued background, relative to that of the person's continued colour


class Foreground:
    """The person's part of a plate: the box around the matte, and in it the P pixels with coverage.

    `size`: (H, W) of the plate; `left` and `top`: first column and row of the box on it. `alpha`: (h, w) in
    [0, 1], coverage in the box; `matte`: (h, w), the part of it that belongs to the person and is not noise.
    `edge`: (h, w), the coverage in the plate; `alpha` is it, or a feathered copy of it for the pictures.
    `photographed`: whether partly covered pixels show the background too, as they do beside a separate mask.
    `pixels`: (P,) indices into the box in row-major order; `coverage`: (P,), `alpha` at them.
    """

    def __init__(
        self,
        size: tuple[int, int],
        corner: tuple[int, int],
        alpha: torch.Tensor,
        matte: torch.Tensor,
        photographed: bool,
        edge: torch.Tensor | None = None,
    ) -> None:
        """Take the content of a box, whose first pixel is at `corner` (top, left) of the plate."""
        self.size, self.alpha, self.matte, self.photographed = size, alpha, matte, photographed
        self.edge = alpha if edge is None else edge
        self.top, self.left = corner
        rows, columns = alpha.shape
        self.box = np.s_[self.top : self.top + rows, self.left : self.left + columns]
        self.pixels = torch.from_numpy(np.flatnonzero(alpha.numpy() > 0))  # faster than torch's
        self.coverage = alpha.flatten()[self.pixels]
        row = self.pixels // columns
        self._plate_pixels = self.pixels + row * (size[1] - columns) + (self.top * size[1] + self.left)

    @classmethod
    def of(
        cls,
        alpha: torch.Tensor,
        matte: torch.Tensor,
        photographed: bool,
        edge: torch.Tensor | None = None,
    ) -> Self:
        """Cut the box out of a whole plate's `alpha`, `matte` and `edge`, (H, W) each.

        Without `edge` it is `alpha`.
        """
        height, width = alpha.shape
        top, left, bottom, right = bounding_box(alpha, threshold=0)
        # One empty pixel around the person, unless the plate ends there: it tells the framing which sides
        # the plate's frame cuts.
        top, left = max(top - 1, 0), max(left - 1, 0)
        box = np.s_[top : min(bottom + 1, height), left : min(right + 1, width)]
        # Copies: a view would hold the whole plate in memory.
        content = alpha[box].contiguous(), matte[box].contiguous()
        own_edge = None if edge is None else edge[box].contiguous()
        return cls((height, width), (top, left), *content, photographed, own_edge)

    def own_colour(self, plate: np.ndarray, photographed: bool | None = None) -> torch.Tensor:
        """Estimate the person's own colour, without the background, continued beyond the matte's edge.

        From (H, W, 3|4) float32, linear Rec.709, premultiplied: their plate, or another of its size, with its
        own `photographed`. Returns (3, h, w) in the box, linear Rec.709, not premultiplied, at least 0.
        Raises ValueError if the matte shows a person where the plate's own alpha is zero.
        """
        photographed = self.photographed if photographed is None else photographed
        return _own_colour(plate[self.box], self.edge, photographed)

    def crop(self, image: torch.Tensor) -> torch.Tensor:
        """Return the part (C, h, w) of a plate-sized image (C, H, W) that is in the box."""
        return image[(..., *self.box)]

    def take(self, image: torch.Tensor) -> torch.Tensor:
        """Return the person's pixels (P, C) of an image (C, h, w) of the box."""
        return image.flatten(1)[:, self.pixels].T

    def scatter(self, values: torch.Tensor) -> np.ndarray:
        """Put the person's pixels (P, C) into an image (H, W, C) float32 that is zero elsewhere."""
        image = lazy_zeros((self.size[0] * self.size[1], values.shape[1]))
        torch.from_numpy(image).index_copy_(0, self._plate_pixels, values)
        return image.reshape(*self.size, -1)


def linear_plate(image: inputs.Array) -> np.ndarray:
    """Return a plate as (H, W, 3|4) float32, linear Rec.709, premultiplied; see `relight.Subject`.

    Raises TypeError, ValueError: what `scene_linear` refuses, and values whose sums exceed float32.
    """
    pixels = without_empty_alpha("image", scene_linear("image", image))
    inputs.bounded("image", torch.from_numpy(pixels[..., :3]))
    return pixels


def plate_coverage(plate: np.ndarray, mask: inputs.Array | None = None) -> torch.Tensor:
    """Return the coverage (H, W) in [0, 1] of a linear plate: the mask if there is one, else its alpha.

    The mask is (H, W), floats or bools in [0, 1], or uint8 or uint16 over the full range. Raises TypeError or
    ValueError for another shape, dtype or range, and without mask and alpha; EmptyMatteError if no coverage
    is above one half.
    """
    if mask is not None:
        return person_mask("mask", mask, plate.shape[:2])
    if plate.shape[-1] == 3:
        raise ValueError(
            "mask: the image has no alpha channel, so give the person's matte as a mask, or have it found"
        )
    if plate[..., 3].min() == 1:
        raise ValueError("mask: the image is opaque everywhere, so give the person's matte as a mask")
    return person_mask("image's alpha", plate[..., 3], plate.shape[:2])


def person_matte(image: inputs.Array, mask: inputs.Array | None = None) -> torch.Tensor:
    """Return the matte (H, W) that the analysis works with: without noise and specks."""
    return clean_matte(plate_coverage(linear_plate(image), mask))


def without_alpha(plate: np.ndarray) -> torch.Tensor:
    """Return a plate's colour (3, H, W), divided by its alpha if it has one: what a foreign network sees."""
    rgb = torch.from_numpy(np.ascontiguousarray(plate)).permute(2, 0, 1)
    return rgb[:3] / rgb[3:].clamp_min(MIN_COVERAGE) if len(rgb) == 4 else rgb


def provided_albedo(albedo: inputs.Array, size: tuple[int, ...]) -> torch.Tensor:
    """Check the caller's albedo and return it as (3, H, W), linear in [0, 1]; `size` is (H, W)."""
    pixels = scene_linear("albedo", albedo)
    if pixels.shape != (*size, 3):
        raise ValueError(f"albedo: expected shape {(*size, 3)}, the size of the image, got {pixels.shape}")
    if pixels.min() < 0 or pixels.max() > 1:
        raise ValueError(f"albedo: expected values in [0, 1], got [{pixels.min():g}, {pixels.max():g}]")
    return torch.from_numpy(pixels).permute(2, 0, 1)


def _own_colour(plate: np.ndarray, alpha: torch.Tensor, photographed: bool) -> torch.Tensor:
    """See `Foreground.own_colour`.

    Premultiplied colour is divided by its alpha where there is enough of it. In a photograph with a separate
    mask, partly covered pixels show the background as well, so only nearly opaque ones are trusted. A hard
    mask calls the rim of the person opaque too: pixels next to an empty one are trusted only where no other
    is near. Push-pull fills the rest from the trusted pixels, so that neither background nor black gets in.
    Where the matte is soft, the photograph then corrects this colour, see `_solved`.
    """
    rgb, own_alpha = plate[..., :3], plate[..., 3:]
    if photographed and alpha.max() < OPAQUE_COVERAGE:
        alpha = _relative_coverage(alpha)
    known = alpha.numpy() >= (OPAQUE_COVERAGE if photographed else MIN_COVERAGE)
    if own_alpha.size:
        known &= own_alpha[..., 0] >= MIN_COVERAGE
        rgb = np.divide(rgb, own_alpha, out=np.zeros_like(rgb), where=known[..., None])
    if not known.any():
        raise ValueError("mask: the image is transparent where the mask shows a subject")
    if photographed:
        known = _away_from_the_rim(torch.from_numpy(known), alpha).numpy()
    filled = fill_unknown(rgb, known)
    if photographed and not own_alpha.size:
        filled = _solved(rgb, filled, alpha.numpy(), known)
    return torch.from_numpy(filled.clip(0)).permute(2, 0, 1)


def _solved(plate: np.ndarray, colour: np.ndarray, alpha: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Correct the person's continued colour (h, w, 3) where the matte is soft and it is not `known`.

    plate = alpha · colour + (1 - alpha) · background. The background is continued under the person, too. Of
    all pairs that satisfy the equation, the most likely one is taken, with Gaussian errors of both (as in
    Bayesian matting, Chuang et al. 2001). Then each pixel expects what its neighbours have found, the more
    they show of it, and is solved again: a hair has one colour, and so have the gaps beside it (in the spirit
    of Forte 2021, "Approximate fast foreground colour estimation").
    """
    empty = alpha <= 1 - OPAQUE_COVERAGE
    soft = (alpha > MIN_COVERAGE) & (alpha < OPAQUE_COVERAGE) & ~known
    if not empty.any() or not soft.any():
        return colour
    seen, coverage, pixels = plate[soft], alpha[soft][:, None], np.nonzero(soft)
    own, behind = colour.copy(), fill_unknown(plate, empty)
    continued = own[soft], behind[soft]
    own[soft], behind[soft] = _most_likely(seen, coverage, *continued, BACKGROUND_VARIANCE)
    for sigma in NEIGHBOURS:
        expected = (
            _mean_of_neighbours(own, alpha**2, pixels, continued[0], sigma),
            _mean_of_neighbours(behind, (1 - alpha) ** 2, pixels, continued[1], sigma),
        )
        own[soft], behind[soft] = _most_likely(seen, coverage, *expected, 1.0)
    hint = (alpha > 0) & (alpha <= MIN_COVERAGE)  # too little to solve, and enough to shine before black
    own[hint] = np.minimum(own[hint], plate[hint] / np.maximum(alpha[hint], 1e-6)[:, None])  # no overflow
    return own


def _most_likely(
    seen: np.ndarray, coverage: np.ndarray, own: np.ndarray, behind: np.ndarray, variance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the colours (n, 3) of person and background of pixels, which together are what is seen there.

    `coverage`: (n, 1). `own`, `behind`: (n, 3), what is expected of both. `variance`: of the second, relative
    to that of the first. Light is not negative, so neither gives more than what is seen.
    """
    left = seen - coverage * own - (1 - coverage) * behind
    left /= coverage**2 + variance * (1 - coverage) ** 2
    own, behind = own + coverage * left, behind + variance * (1 - coverage) * left
    return own.clip(0, seen / coverage), behind.clip(0, seen / (1 - coverage))


def _mean_of_neighbours(
    colour: np.ndarray,
    weight: np.ndarray,
    pixels: tuple[np.ndarray, ...],
    continued: np.ndarray,
    sigma: float,
) -> np.ndarray:
    """Return the means (n, 3) of an image (h, w, 3) around pixels; `continued` (n, 3) counts a little."""
    rows, columns = pixels
    total, sums = np.full(len(rows), CONTINUED_WEIGHT, np.float32), CONTINUED_WEIGHT * continued
    steps = range(-NEIGHBOUR_RADIUS, NEIGHBOUR_RADIUS + 1)
    for down, across in itertools.product(steps, steps):
        place = (rows + down).clip(0, len(weight) - 1), (columns + across).clip(0, weight.shape[1] - 1)
        share = weight[place] * np.float32(math.exp(-(down**2 + across**2) / (2 * sigma**2)))
        total += share
        sums += share[:, None] * colour[place]
    return sums / total[:, None]


def _relative_coverage(alpha: torch.Tensor) -> torch.Tensor:
    """Return a translucent matte (h, w), as in a fade, relative to the most coverage near each pixel."""
    side = 2 * EDGE_PIXELS + 1
    most = F.max_pool2d(alpha[None], side, stride=1, padding=EDGE_PIXELS)[0]
    return torch.where(alpha > 0.5, alpha / most.clamp_min(MIN_COVERAGE), alpha)


def _away_from_the_rim(known: torch.Tensor, alpha: torch.Tensor) -> torch.Tensor:
    """Return which opaque pixels (h, w) hold no background, from the opaque ones and the coverage."""
    # A compressed matte varies a little inside the person, far from any edge.
    covered = known | ~_dilated(alpha < NEARLY_OPAQUE_COVERAGE, EDGE_PIXELS)
    inner = covered & ~_dilated(alpha <= MIN_COVERAGE, 1)
    return inner | covered & ~_dilated(inner, 2)


def _dilated(pixels: torch.Tensor, radius: int) -> torch.Tensor:
    """Return where (H, W) one of these pixels is at most `radius` pixels away, diagonals included."""
    height, width = pixels.shape
    shifts = range(2 * radius + 1)
    padded = F.pad(pixels, (radius, radius, radius, radius))
    rows = functools.reduce(torch.logical_or, [padded[shift : shift + height] for shift in shifts])
    return functools.reduce(torch.logical_or, [rows[:, shift : shift + width] for shift in shifts])
