"""The package's own network that cuts people out: a crop and a coarse mask become a matte.

It was trained on rendered people (see shadow/weights/MODEL_CARD.md), and sees at most 512 pixels a side. Its
matte is the mean of those of the crop and of its mirror image.
"""

import functools
from pathlib import Path

import numpy as np
import torch

from relight.media.resampling import resize
from shadow.networks import checkpoints
from shadow.networks.backbone import COARSEST_STRIDE
from shadow.networks.matting import MattingNetwork
from shadow.networks.precision import autocast

OWN = "matting"  # the weights in the package
SIDE = 512  # pixels, the longer side of what the network sees
FILTER = "triangle"  # of `resize`, for copies


def is_one(name: str) -> bool:
    """Return whether a name or path is of such a network."""
    return name == OWN or Path(name).suffix.lower() == ".safetensors"


def identity() -> str:
    """Return a name of the shipped weights that no other ones have."""
    return f"{OWN} {checkpoints.checksum(OWN, package='shadow')}"


@functools.lru_cache(maxsize=1)
def load() -> "CutoutNetwork":
    """Return the network whose weights are in the package, read once in a process."""
    return CutoutNetwork()


class CutoutNetwork:
    """A `relight.matting.silhouette.Silhouette`.

    `name`: OWN, or the path of weights that `relight train matting` wrote. Raises FileNotFoundError or
    ValueError as `shadow.networks.checkpoints.load` does.
    """

    def __init__(self, name: str = OWN) -> None:
        self._network: MattingNetwork = checkpoints.load(name, {OWN: MattingNetwork}, package="shadow")

    def __call__(self, crop: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """Return the coverage (h, w) in [0, 1] of the person that a mask (h, w) shows, in a crop (h, w, 3).

        The crop is sRGB-encoded in [0, 1]. It should reach a quarter of the person's size beyond the mask.
        """
        longest = max(mask.shape)
        height, width = (
            max(1, round(length * SIDE / longest / COARSEST_STRIDE)) * COARSEST_STRIDE
            for length in mask.shape
        )
        seen = resize(np.dstack([crop, mask]).astype(np.float32), (height, width), FILTER).clip(0, 1)
        planes = torch.from_numpy(seen.transpose(2, 0, 1).copy())[None]
        both = torch.cat([planes, planes.flip(3)])
        with torch.no_grad(), autocast("cpu"):
            found = self._network(both[:, :3], both[:, 3:]).fine.float().sigmoid()
        matte = (found[0, 0] + found[1, 0].flip(1)) / 2
        return resize(matte[..., None].numpy(), mask.shape, FILTER)[..., 0].clip(0, 1)
