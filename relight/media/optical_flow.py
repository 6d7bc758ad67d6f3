"""Dense motion from one picture to the next, by OpenCV's DIS optical flow.

Kroeger, Timofte, Dai and Van Gool, "Fast Optical Flow using Dense Inverse Search", ECCV 2016. It needs no
network. OpenCV is in the extra `video`.
"""

import functools
import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import torch
import torch.nn.functional as F

from shadow.installing import install_command

RETURN_SIGMA = 1.0  # pixels between a position and its way there and back, at which certainty falls to 60 %


def is_installed() -> bool:
    """Return whether OpenCV is there, without importing it."""
    return importlib.util.find_spec("cv2") is not None


@functools.cache
def opencv() -> ModuleType:
    """Return the module `cv2`. Raises ImportError with the command that installs it."""
    try:
        import cv2
    except ImportError as error:
        raise ImportError(f"the motion between frames needs OpenCV: {install_command('video')}") from error
    return cv2


@dataclass(frozen=True)
class Motion:
    """Where the content of each pixel of one picture is in another one."""

    positions: torch.Tensor  # (2, h, w) x and y in pixels of the other one; centres at half-integers
    certainty: torch.Tensor  # (1, h, w) in [0, 1]: 0 where the other picture does not show the content

    @classmethod
    def none(cls, size: Sequence[int]) -> "Motion":
        """Return the motion between two pictures of a size (h, w) that show the same at the same place."""
        return cls(_centres(size), torch.ones(1, *size))

    def moved(self, maps: torch.Tensor) -> torch.Tensor:
        """Return maps (C, H, W) of the other picture, moved onto this: (C, h, w), zero beyond its frame."""
        extent = torch.tensor([maps.shape[-1], maps.shape[-2]])[:, None, None]
        grid = (self.positions * 2 / extent - 1).permute(1, 2, 0)
        return F.grid_sample(maps[None].float(), grid[None], align_corners=False)[0]

    def resized(self, size: Sequence[int]) -> "Motion":
        """Return the motion between two pictures of another size (H, W) with the same content."""
        ratio = torch.tensor([size[1] / self.positions.shape[2], size[0] / self.positions.shape[1]])
        flow = (self.positions - _centres(self.positions.shape[1:])) * ratio[:, None, None]
        layers = F.interpolate(torch.cat([flow, self.certainty])[None], tuple(size), mode="bilinear")[0]
        return Motion(_centres(size) + layers[:2], layers[2:])


def motion(first: torch.Tensor, second: torch.Tensor) -> Motion:
    """Return the motion from the first picture to the second: (3, h, w) each, display-encoded in [0, 1].

    Certainty falls where the motion to the second picture and back misses the pixel that it began at: there
    one of the pictures shows what the other hides.
    """
    return both_motions(first, second)[0]


def both_motions(first: torch.Tensor, second: torch.Tensor) -> tuple[Motion, Motion]:
    """Return the motions from the first picture to the second and back, see `motion`."""
    there, back = dense_flow(first, second), dense_flow(second, first)
    return _checked(there, back), _checked(back, there)


def _checked(there: torch.Tensor, back: torch.Tensor) -> Motion:
    """Return the motion of a flow (2, h, w), less certain where the flow back does not return."""
    positions = _centres(there.shape[1:]) + there
    missed = there + Motion(positions, torch.empty(0)).moved(back)
    certainty = torch.exp(-(missed**2).sum(dim=0, keepdim=True) / (2 * RETURN_SIGMA**2))
    return Motion(positions, certainty)


def dense_flow(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """Return the flow (2, h, w) in pixels, on one thread: the result depends on their number."""
    cv2 = opencv()
    grey = [
        cv2.cvtColor(np.ascontiguousarray(_codes(picture)), cv2.COLOR_RGB2GRAY) for picture in (first, second)
    ]
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(*grey, None)
    finally:
        cv2.setNumThreads(threads)
    return torch.from_numpy(flow).permute(2, 0, 1)


def _centres(size: Sequence[int]) -> torch.Tensor:
    """Return the centres (2, h, w) of pixels, x and y."""
    y, x = torch.meshgrid(*(torch.arange(length) + 0.5 for length in size), indexing="ij")
    return torch.stack([x, y])


def _codes(picture: torch.Tensor) -> np.ndarray:
    return (255 * picture.clamp(0, 1)).round().byte().permute(1, 2, 0).numpy()
