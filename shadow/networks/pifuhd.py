"""PIFuHD's front-normal generator, from a checkpoint of the user: the auxiliary normals of Section 3.

The network is the global generator of pix2pixHD (Wang et al. 2018), trained as a part of PIFuHD (SSSJ20). Its
licence does not let us distribute the weights. The layout of the checkpoint and of the input image is that of
lib/networks.py and lib/data/EvalDataset.py in github.com/facebookresearch/pifuhd.
"""

import argparse
import functools
import itertools
import os
import pickle
import re
import zipfile
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import nn

from shadow.files import file_version
from shadow.framing import Extension, Framing, bounding_box
from shadow.networks import checkpoints
from shadow.srgb import LAST_LINEAR, SLOPE

SIZE = 512  # pixels of the square canvas
# Side of the canvas over the longer side of the person. PIFuHD's own crop is 1.3 times the extent of the
# key points, which leaves out the crown of the head and the soles.
CANVAS_PER_PERSON = 1.2
GREY_BACKGROUND = 0.5  # display-encoded, behind the person
PREFIX = "netG.netF."  # of the generator's keys in a checkpoint


class ResidualBlock(nn.Module):
    """Residual block of pix2pixHD; `conv_block` is its name in the checkpoint."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        first, second = (
            [nn.ReflectionPad2d(1), nn.Conv2d(channels, channels, 3), nn.InstanceNorm2d(channels)]
            for _ in range(2)
        )
        self.conv_block = nn.Sequential(*first, nn.ReLU(), *second)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x + self.conv_block(x)


class FrontNormals(nn.Module):
    """The global generator of pix2pixHD: 4 down-samplings, 9 residual blocks, 4 up-samplings.

    The layers form one sequence, so that their indices match the checkpoint's keys.
    """

    origin: checkpoints.Origin

    def __init__(
        self,
        width: int = 64,  # channels at full resolution, doubled by each down-sampling; 64 in PIFuHD
    ) -> None:
        super().__init__()
        widths = [width * 2**level for level in range(5)]
        layers = [nn.ReflectionPad2d(3), nn.Conv2d(3, width, 7), nn.InstanceNorm2d(width), nn.ReLU()]
        for fine, coarse in itertools.pairwise(widths):
            layers += [nn.Conv2d(fine, coarse, 3, stride=2, padding=1), nn.InstanceNorm2d(coarse), nn.ReLU()]
        layers += [ResidualBlock(widths[-1]) for _ in range(9)]
        for coarse, fine in itertools.pairwise(reversed(widths)):
            up = nn.ConvTranspose2d(coarse, fine, 3, stride=2, padding=1, output_padding=1)
            layers += [up, nn.InstanceNorm2d(fine), nn.ReLU()]
        layers += [nn.ReflectionPad2d(3), nn.Conv2d(width, 3, 7), nn.Tanh()]
        self.model = nn.Sequential(*layers)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Map a display-encoded image (B, 3, H, W) in [-1, 1] to normals (B, 3, H, W) of any length."""
        return self.model(image)

    @torch.no_grad()
    def normals(self, rgb: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Infer unit normals (3, H, W), zero outside the mask, from linear rgb (3, H, W) and a mask (H, W).

        The image may have any size, since this method frames the person. The generator was trained on
        display-encoded images, so 1 must be the display's white. Unlike our networks, it depends on exposure.
        """
        framing = _framing(mask)
        behind = _display(rgb) * mask + GREY_BACKGROUND * (1 - mask)
        framed = 2 * framing.crop(behind) - 1  # black beyond the plate, as in PIFuHD's padding
        vectors = F.normalize(self(framed[None])[0], dim=0)
        known = framing.crop(mask[None])[0]
        return F.normalize(framing.restore(Extension(known)(vectors)), dim=0) * (mask > 0)


def _framing(mask: torch.Tensor) -> Framing:
    """Return a square canvas centred on the subject of `mask` (H, W)."""
    top, left, bottom, right = bounding_box(mask)
    scale = SIZE / (CANVAS_PER_PERSON * max(bottom - top, right - left))
    return Framing(
        ((left + right) / 2, (top + bottom) / 2), scale, (SIZE, SIZE), (mask.shape[0], mask.shape[1])
    )


def _display(rgb: torch.Tensor) -> torch.Tensor:
    """Encode linear values as sRGB, clipped to [0, 1] (IEC 61966-2-1)."""
    rgb = rgb.clamp(0, 1)
    return torch.where(rgb <= LAST_LINEAR, SLOPE * rgb, 1.055 * rgb ** (1 / 2.4) - 0.055)


def load(path: str | os.PathLike, device: torch.device | str = "cpu") -> FrontNormals:
    """Load the front-normal generator of a PIFuHD checkpoint for inference on `device`.

    The network is shared between callers, who must not change it. No code in the file is executed: the only
    pickled object that is accepted is the training options (argparse.Namespace).

    Raises FileNotFoundError, and ValueError if the file is damaged, contains pickled code or no front-normal
    generator, or its generator takes more than the photograph, as those of ICON and ECON do.
    """
    path = Path(path).resolve(strict=True)
    return _load(path, file_version(path), torch.device(device))


@functools.lru_cache(maxsize=1)
def _load(path: Path, version: tuple[int, ...], device: torch.device) -> FrontNormals:
    """Load a file; `version` tells the cache when it has been written again, see `file_version`."""
    parameters = _generator(path, _read(path))
    with torch.device("meta"):
        network = FrontNormals(parameters["model.1.weight"].shape[0])
    try:
        network.load_state_dict(parameters, strict=True, assign=True)
    except RuntimeError as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"normals: {path} does not contain PIFuHD's generator: {reason}") from error
    checkpoints.check_finite(f"normals: {path}", network)
    network.origin = checkpoints.Origin(path.stem, checkpoints.sha256(path), {})
    return network.eval().requires_grad_(False).to(device)


def _read(path: Path) -> object:
    """Read the checkpoint, with tensors on the CPU."""
    try:
        with torch.serialization.safe_globals([argparse.Namespace]):
            # Memory-mapped where the format allows it, since half of the file is not the generator.
            return torch.load(path, map_location="cpu", weights_only=True, mmap=zipfile.is_zipfile(path))
    except Exception as error:  # damaged files raise many kinds of errors
        code = re.search(r"GLOBAL (\S+)", str(error))
        if isinstance(error, pickle.UnpicklingError) and code:
            raise ValueError(f"normals: {path} contains pickled code, {code[1]}, which is not run") from error
        raise ValueError(f"normals: {path} is not a PyTorch checkpoint, or is truncated") from error


def _generator(path: Path, checkpoint: object) -> dict[str, torch.Tensor]:
    """Return the parameters of the front-normal generator, as float32 copies."""
    checkpoint = checkpoint if isinstance(checkpoint, dict) else {}
    parameters = checkpoint.get("model_state_dict", checkpoint.get("state_dict"))  # the second is ICON's
    weights = {
        key.removeprefix(PREFIX): value.float().clone()
        for key, value in (parameters.items() if isinstance(parameters, dict) else ())
        if isinstance(key, str) and key.startswith(PREFIX) and isinstance(value, torch.Tensor)
    }
    if "model.1.weight" not in weights or weights["model.1.weight"].ndim != 4:
        raise ValueError(
            f"normals: {path} has no front-normal generator: model_state_dict lacks {PREFIX}model.1.weight"
        )
    channels = weights["model.1.weight"].shape[1]
    if channels != 3:
        raise ValueError(
            f"normals: the generator in {path} takes {channels} channels, expected 3, the photograph; "
            "those of ICON and ECON also take a rendered body and are not supported"
        )
    return weights
