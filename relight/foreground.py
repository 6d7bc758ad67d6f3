"""The person cut out of a plate: coverage, their own colour, and which pixels show them."""

from typing import Any, Self

import numpy as np
import OpenImageIO as oiio
import torch
import torch.nn.functional as F

from relight.media.images import scene_linear
from shadow import inputs
from shadow.framing import bounding_box

CLEAN = 0.98  # coverage above which a photograph's pixel holds no background to speak of
NEARLY = 0.9  # coverage that counts as CLEAN where no pixel within EDGE has less
EDGE = 2  # pixels
FAINT = 0.05  # coverage below which premultiplied colour is too coarse to divide by, or a matte is noise


class Foreground:
    """The person's part of a plate: the box around the matte, and in it P pixels above zero.

    Attributes
    ----------
    size: (H, W) of the plate. left, top: of the box, whole pixels.
    alpha: (h, w) tensor in the box. matte: (h, w) tensor, what of the alpha is the person's and not noise.
    pixels: (P,) tensor, in the box in row order. coverage: (P,) tensor, their alpha.
    """

    def __init__(
        self,
        size: tuple[int, int],
        corner: tuple[int, int],
        alpha: torch.Tensor,
        matte: torch.Tensor,
        photographed: bool,
    ) -> None:
        """From what is in the box, whose first pixel is at `corner` (top, left).

        `photographed`: partly covered pixels show the background too, as they do beside a separate mask.
        """
        self.size, self.alpha, self.matte, self.photographed = size, alpha, matte, photographed
        self.top, self.left = corner
        rows, columns = alpha.shape
        self._box = np.s_[self.top : self.top + rows, self.left : self.left + columns]
        self.pixels = torch.from_numpy(np.flatnonzero(alpha.numpy() > 0))  # faster than torch's
        self.coverage = alpha.flatten()[self.pixels]
        row = self.pixels // columns
        self._where = self.pixels + row * (size[1] - columns) + (self.top * size[1] + self.left)

    @classmethod
    def of(cls, alpha: torch.Tensor, matte: torch.Tensor, photographed: bool) -> Self:
        """From the alpha (H, W) of a whole plate, in [0, 1], and what of that is the person's, `matte`."""
        height, width = alpha.shape
        top, left, bottom, right = bounding_box(alpha, threshold=0)
        # An empty pixel around it, unless the plate ends there: so the framing sees which sides are cut.
        top, left = max(top - 1, 0), max(left - 1, 0)
        box = np.s_[top : min(bottom + 1, height), left : min(right + 1, width)]
        return cls((height, width), (top, left), alpha[box], matte[box], photographed)

    def own_colour(self, pixels: np.ndarray, photographed: bool | None = None) -> torch.Tensor:
        """The person's own colour (3, h, w) in the box, linear, not premultiplied, continued beyond the
        matte's edge: of their plate (H, W, 3|4), scene-linear and premultiplied, or of another of its size.

        Raises ValueError where the matte shows a subject and the plate's own alpha none.
        """
        photographed = self.photographed if photographed is None else photographed
        return _own_colour(pixels[self._box], self.alpha, photographed)

    def crop(self, image: torch.Tensor) -> torch.Tensor:
        """What of an image (C, H, W) is in the box: (C, h, w)."""
        return image[(..., *self._box)]

    def take(self, image: torch.Tensor) -> torch.Tensor:
        """The person's pixels (P, C) of an image (C, h, w) of the box."""
        return image.flatten(1)[:, self.pixels].T

    def scatter(self, values: torch.Tensor) -> np.ndarray:
        """The person's pixels (P, C) as an image (H, W, C) that is zero elsewhere."""
        image = np.zeros((self.size[0] * self.size[1], values.shape[1]), np.float32)
        torch.from_numpy(image).index_copy_(0, self._where, values)
        return image.reshape(*self.size, -1)


def matte_of(pixels: np.ndarray, mask: np.ndarray | None) -> torch.Tensor:
    """The person's coverage (H, W), from the mask if given, else from the plate's alpha channel."""
    if mask is not None:
        given = np.asarray(mask)
        if given.dtype.kind == "u" and given.dtype.itemsize <= 2:  # in either byte order
            given = given / np.float32(np.iinfo(given.dtype).max)
        return inputs.mask("mask", given, pixels.shape[:2])
    if pixels.shape[-1] == 3:
        raise ValueError("mask: the image has no alpha channel, so give the person's matte as a mask")
    if pixels[..., 3].min() == 1:
        raise ValueError("mask: the image is opaque everywhere, so give the person's matte as a mask")
    return inputs.mask("image's alpha", pixels[..., 3], pixels.shape[:2])


def plate_of(image: np.ndarray) -> np.ndarray:
    """The plate as `scene_linear` gives it; ValueError where sums of it would be beyond float32."""
    pixels = scene_linear("image", image)
    inputs.bounded("image", torch.from_numpy(pixels[..., :3]))
    return pixels


def photograph(pixels: np.ndarray) -> torch.Tensor:
    """The plate's colour (3, H, W), its own alpha, if any, taken out: what a foreign normals network sees."""
    rgb = torch.from_numpy(np.ascontiguousarray(pixels)).permute(2, 0, 1)
    return rgb[:3] / rgb[3:].clamp_min(FAINT) if len(rgb) == 4 else rgb


def given_albedo(albedo: np.ndarray, size: tuple[int, ...]) -> torch.Tensor:
    """The caller's albedo as (3, H, W) in [0, 1], checked."""
    pixels = scene_linear("albedo", albedo)
    if pixels.shape != (*size, 3):
        raise ValueError(f"albedo: expected shape {(*size, 3)}, the size of the image, got {pixels.shape}")
    if pixels.min() < 0 or pixels.max() > 1:
        raise ValueError(f"albedo: expected values in [0, 1], got [{pixels.min():g}, {pixels.max():g}]")
    return torch.from_numpy(pixels).permute(2, 0, 1)


def _own_colour(pixels: np.ndarray, alpha: torch.Tensor, photographed: bool) -> torch.Tensor:
    """The person's own colour (3, h, w), not premultiplied, continued beyond the matte's edge.

    Premultiplied colour is divided by its alpha where there is enough of it. In a photograph with a separate
    mask, partly covered pixels show the background as well. So only nearly covered ones are trusted; and
    those beside an empty pixel, which a hard mask only calls covered, where there are no others near. The
    rest is filled from the trusted ones by push-pull (Gortler et al. 1996): no background, and no black,
    gets in.
    """
    rgb, own_alpha = pixels[..., :3], pixels[..., 3:]
    matte = alpha.numpy()[..., None]
    known = matte >= (min(CLEAN, matte.max()) if photographed else FAINT)
    if own_alpha.size:
        known &= own_alpha >= FAINT
        rgb = np.divide(rgb, own_alpha, out=np.zeros_like(rgb), where=known)
    if not known.any():
        raise ValueError("mask: the image is transparent where the mask shows a subject")
    if photographed:
        # A compressed matte trembles inside the person, where no edge is near.
        covered = torch.from_numpy(known[None, ..., 0]) | ~_within(EDGE, alpha[None] < NEARLY)
        empty = alpha[None] <= FAINT
        inner = covered & ~_within(1, empty)
        known = (inner | covered & ~_within(2, inner))[0, ..., None].numpy()
    trusted = np.concatenate([rgb * known, known], axis=-1, dtype=np.float32)
    filled: Any = oiio.ImageBufAlgo.fillholes_pushpull(oiio.ImageBuf(np.ascontiguousarray(trusted)))
    filled = filled.get_pixels("float")[..., :3]
    return torch.from_numpy(np.where(known, rgb, filled).clip(0)).permute(2, 0, 1)


def _within(reach: int, pixels: torch.Tensor) -> torch.Tensor:
    """Where (1, H, W) one of these pixels is at most `reach` pixels away."""
    return F.max_pool2d(pixels.float(), 2 * reach + 1, stride=1, padding=reach) > 0
