"""PIFuHD's front-normal generator, from a user's own checkpoint: the normals that the paper used.

The network is the global generator of pix2pixHD (Wang et al. 2018), trained as a part of PIFuHD (SSSJ20); its
weights are not ours to ship. Layout of the checkpoint and the image it expects: lib/networks.py and
lib/data/EvalDataset.py of github.com/facebookresearch/pifuhd.
"""

import argparse
import functools
import itertools
import os
import pickle
import re
import zipfile
from pathlib import Path
from typing import Any

import torch
import torch.nn.functional as F
from torch import nn

from shadow.framing import Framing, bounding_box, extend
from shadow.networks import checkpoints

SIZE = 512  # pixels of the square canvas
# Side of the canvas over the longer side of the person. PIFuHD's own crop is 1.3 times the extent of the
# key points, which leaves out the crown of the head and the soles.
ROOM = 1.2
GREY = 0.5  # display-encoded, behind the person
PREFIX = "netG.netF."  # the generator among the parts of PIFuHD


class Residual(nn.Module):
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

    The layers stand in one sequence, so that their numbers are the checkpoint's keys.
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
        layers += [Residual(widths[-1]) for _ in range(9)]
        for coarse, fine in itertools.pairwise(reversed(widths)):
            up = nn.ConvTranspose2d(coarse, fine, 3, stride=2, padding=1, output_padding=1)
            layers += [up, nn.InstanceNorm2d(fine), nn.ReLU()]
        layers += [nn.ReflectionPad2d(3), nn.Conv2d(width, 3, 7), nn.Tanh()]
        self.model = nn.Sequential(*layers)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Display-encoded image (B, 3, H, W) in [-1, 1] to normals (B, 3, H, W) in [-1, 1], of any length."""
        return self.model(image)

    @torch.no_grad()
    def normals(self, rgb: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """rgb (3, H, W), linear, and mask (H, W) to unit normals (3, H, W), zero outside the mask.

        Any size; the person is framed here. The generator learned from pictures as they are displayed, so 1
        must be the display's white: unlike our networks it minds the exposure.
        """
        framing = _framing(mask)
        behind = _display(rgb) * mask + GREY * (1 - mask)
        framed = 2 * framing.crop(behind) - 1  # zero beyond the plate, so black, as PIFuHD pads
        vectors = F.normalize(self(framed[None])[0], dim=0)
        known = framing.crop(mask[None])[0]
        return F.normalize(framing.restore(extend(vectors, known)), dim=0) * (mask > 0)


def _framing(mask: torch.Tensor) -> Framing:
    """A square canvas centred on the subject that `mask` (H, W) shows."""
    top, left, bottom, right = bounding_box(mask)
    scale = SIZE / (ROOM * max(bottom - top, right - left))
    return Framing(
        ((left + right) / 2, (top + bottom) / 2), scale, (SIZE, SIZE), (mask.shape[0], mask.shape[1])
    )


def _display(rgb: torch.Tensor) -> torch.Tensor:
    """Linear to sRGB, clipped to [0, 1] (IEC 61966-2-1)."""
    rgb = rgb.clamp(0, 1)
    return torch.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * rgb ** (1 / 2.4) - 0.055)


def load(path: str | os.PathLike, device: torch.device | str = "cpu") -> FrontNormals:
    """The front-normal generator in a PIFuHD checkpoint, ready for inference on `device`. It is shared:
    nobody may change it.

    Nothing in the file is run: of pickled objects, only its options (argparse.Namespace) are let in.

    Raises
    ------
    FileNotFoundError: no such file. ValueError: it is damaged, holds pickled code, holds no front-normal
    generator, or one that wants more than the photograph, as those of ICON and ECON.
    """
    return _load(Path(path).resolve(strict=True), torch.device(device))


@functools.lru_cache(maxsize=1)
def _load(path: Path, device: torch.device) -> FrontNormals:
    parameters = _generator(path, _read(path))
    with torch.device("meta"):
        network = FrontNormals(parameters["model.1.weight"].shape[0])
    try:
        network.load_state_dict(parameters, strict=True, assign=True)
    except RuntimeError as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"normals: {path} holds another generator than PIFuHD's: {reason}") from error
    checkpoints.check_finite(f"normals: {path}", network)
    network.origin = checkpoints.Origin(path.stem, checkpoints.sha256(path), {})
    return network.eval().requires_grad_(False).to(device)


def _read(path: Path) -> Any:
    """What is in the checkpoint, tensors on the CPU."""
    try:
        with torch.serialization.safe_globals([argparse.Namespace]):
            # Mapped where the format allows, for the generator is half of the file.
            return torch.load(path, map_location="cpu", weights_only=True, mmap=zipfile.is_zipfile(path))
    except Exception as error:  # bytes that are no checkpoint fail in many ways
        code = re.search(r"GLOBAL (\S+)", str(error))
        if isinstance(error, pickle.UnpicklingError) and code:
            raise ValueError(f"normals: {path} holds pickled code, {code[1]}, which is not run") from error
        raise ValueError(f"normals: {path} is no PyTorch checkpoint, or is truncated") from error


def _generator(path: Path, checkpoint: Any) -> dict[str, torch.Tensor]:
    """The front-normal generator's own parameters, as float32 copies."""
    checkpoint = checkpoint if isinstance(checkpoint, dict) else {}
    parameters = checkpoint.get("model_state_dict", checkpoint.get("state_dict"))  # the second is ICON's
    found = {
        key.removeprefix(PREFIX): value.float().clone()
        for key, value in (parameters.items() if isinstance(parameters, dict) else ())
        if isinstance(key, str) and key.startswith(PREFIX) and isinstance(value, torch.Tensor)
    }
    if "model.1.weight" not in found or found["model.1.weight"].ndim != 4:
        raise ValueError(
            f"normals: {path} holds no front-normal generator: model_state_dict has no {PREFIX}model.1.weight"
        )
    channels = found["model.1.weight"].shape[1]
    if channels != 3:
        raise ValueError(
            f"normals: the generator in {path} takes {channels} channels, expected 3, the photograph; "
            "those of ICON and ECON also take a rendered body and are not supported"
        )
    return found
