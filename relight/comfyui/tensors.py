"""ComfyUI's IMAGE and MASK tensors to the library's arrays and back.

An IMAGE is (B, H, W, 3), or 4 with straight alpha, floating, sRGB-encoded, with 1 as white. A MASK is
(B, H, W) in [0, 1]. ComfyUI expects what a node returns on the CPU.
"""

import logging
from collections.abc import Sequence

import numpy as np
import torch

from relight.media import colour
from relight.media.images.arrays import linearise
from relight.media.images.write_image import encoded

PERSON, BACKGROUND = "person", "background"  # what a mask shows
# Added to what is shown, 0.005 codes of 8 bits: Save Image cuts off the fraction of a code, and a rounding
# error must not take a pixel that comes out as it went in below its own.
ABOVE_ROUNDING = np.float32(2e-5)


def pictures(name: str, image: torch.Tensor) -> np.ndarray:
    """Return the values of an IMAGE as they are: (B, H, W, 3|4) float32; `name` is what an error calls it.

    Raises TypeError for no floating tensor; ValueError for another shape, or NaN or infinite values.
    """
    values = _array(name, image)
    if values.ndim != 4 or values.shape[-1] not in (3, 4) or 0 in values.shape:
        raise ValueError(f"{name}: expected an IMAGE of shape (B, H, W, 3), got {tuple(values.shape)}")
    return values


def light(name: str, picture: np.ndarray) -> np.ndarray:
    """Decode a picture (H, W, 3|4) to scene-linear Rec.709, premultiplied. Values above 1 are not clipped.

    Values below 0, which an upscaler's filter can leave, become 0.
    """
    linear = linearise(picture.clip(0), straight=True, space=colour.SRGB)
    if not np.isfinite(linear).all():
        raise ValueError(f"{name}: has values too bright for float32; expected about 1 for white")
    return linear


def mattes(name: str, mask: torch.Tensor, size: tuple[int, ...], shows: str = PERSON) -> np.ndarray:
    """Return a MASK (B, H, W) or (H, W) as mattes of the person: (B, H, W) float32 in [0, 1].

    `name`: what an error calls the mask. `size`: (H, W) of the image that it belongs to. `shows`: what is 1
    in the mask: "person", or "background" as in the MASK of ComfyUI's Load Image, which is one minus the
    alpha. A mask that seems to show the other is named in the console. Raises TypeError for no floating
    tensor; ValueError for another shape or size, or values outside [0, 1].
    """
    values = _array(name, mask)
    values = values[None] if values.ndim == 2 else values
    if values.ndim != 3 or 0 in values.shape:
        raise ValueError(f"{name}: expected a MASK of shape (B, H, W), got {tuple(values.shape)}")
    if values.shape[1:] != tuple(size):
        if values.shape[1:] == (64, 64) and not values.any():
            raise ValueError(
                f"{name}: is the empty mask that Load Image gives for a picture without alpha; disconnect it "
                "to have the person found, or connect the matte of a background removal node"
            )
        raise ValueError(
            f"{name}: expected the size of its image, {size[1]} x {size[0]} pixels, got "
            f"{values.shape[2]} x {values.shape[1]}"
        )
    low, high = float(values.min()), float(values.max())
    if low < -1e-3 or high > 1 + 1e-3:  # resizing overshoots a little
        raise ValueError(f"{name}: expected values in [0, 1], got [{low:g}, {high:g}]")
    values = values.clip(0, 1)
    values = 1 - values if shows == BACKGROUND else values
    edges = np.concatenate([values[:, 0], values[:, :, 0], values[:, :, -1]], axis=1)  # above and beside
    if edges.mean() > 0.5:
        other = PERSON if shows == BACKGROUND else BACKGROUND
        logging.getLogger(__name__).warning(
            "%s: covers the edges of the image, as a mask of the background does, such as Load Image's; if "
            "it is one, set mask_shows to %s",
            name,
            other,
        )
    return values


def to_image(linear: Sequence[np.ndarray], exposure: float = 0.0) -> torch.Tensor:
    """Encode scene-linear pictures for a display: an IMAGE (B, H, W, 3) in [0, 1], on the CPU.

    `linear`: one (H, W, 3) or premultiplied (H, W, 4) picture a frame. A picture with alpha becomes straight,
    as ComfyUI's compositing nodes expect. `exposure`: stops; doubles the light for each.

    As in the library's own PNG files, light up to 1 comes out exact and brighter highlights roll off. The
    roll-off is the same for all frames: a batch does not flicker.
    """
    brightest = max(float(picture[..., :3].max()) for picture in linear)
    white = max(1.0, brightest * 2.0**exposure)
    frames = []
    for picture in linear:
        shown = encoded(picture, exposure=exposure, white=white)[..., :3]
        frames.append(torch.from_numpy(np.where(shown > 0, (shown + ABOVE_ROUNDING).clip(max=1), shown)))
    return torch.stack(frames)


def as_grey(values: Sequence[np.ndarray]) -> torch.Tensor:
    """Show values (H, W) that are no colour as they are: an IMAGE (B, H, W, 3)."""
    return torch.stack([torch.from_numpy(np.repeat(frame[..., None], 3, axis=-1)) for frame in values])


def to_mask(values: Sequence[np.ndarray]) -> torch.Tensor:
    """Stack mattes (H, W) to a MASK (B, H, W)."""
    return torch.from_numpy(np.stack(values))


def frames_together(**counts: int) -> int:
    """Return how many frames batches make together: each has one picture, for all frames, or that many.

    Raises ValueError: two batches differ, and neither is a single picture.
    """
    longest = max(counts.values())
    if any(count not in (1, longest) for count in counts.values()):
        said = ", ".join(f"{name} has {count}" for name, count in counts.items())
        raise ValueError(f"batches: expected one picture or the same number in each; {said}")
    return longest


def _array(name: str, tensor: torch.Tensor) -> np.ndarray:
    if not isinstance(tensor, torch.Tensor) or not tensor.is_floating_point():
        kind = getattr(tensor, "dtype", type(tensor).__name__)
        raise TypeError(f"{name}: expected a floating tensor as ComfyUI's nodes give it, got {kind}")
    values = tensor.detach().float().cpu().numpy()
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: contains NaN or infinite values")
    return values
