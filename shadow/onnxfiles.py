"""Networks of others, as ONNX files: opened, fed a photograph, and their answers laid back over it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F

from shadow.files import AnyPath

Shape = tuple[int | str | None, ...]


class OnnxFile:
    """An ONNX file on the CPU.

    inputs, outputs: {name: shape}, in the file's order; a size that is free is a name or None.
    """

    def __init__(self, path: AnyPath) -> None:
        """ImportError without onnxruntime (extra `matte`), FileNotFoundError, ValueError for no model."""
        self.path = Path(path)
        if not self.path.is_file():
            raise FileNotFoundError(f"{path}: no such file")
        try:
            import onnxruntime
        except ImportError as error:
            raise ImportError(
                f"{path}: needs onnxruntime; install it with: pip install 'relight[matte]'"
            ) from error
        settings = onnxruntime.SessionOptions()
        settings.log_severity_level = 4  # what goes wrong is raised as well
        try:
            self._session = onnxruntime.InferenceSession(
                str(path), settings, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # classes of its own for each kind of damage, below Exception alone
            raise ValueError(f"{path}: is no ONNX model that can be opened: {_line(error)}") from error
        self.inputs: dict[str, Shape] = {put.name: tuple(put.shape) for put in self._session.get_inputs()}
        self.outputs: dict[str, Shape] = {put.name: tuple(put.shape) for put in self._session.get_outputs()}

    def run(self, feeds: Mapping[str, np.ndarray]) -> list[np.ndarray]:
        """All outputs, in the file's order; ValueError where the model does not take these inputs."""
        try:
            return self._session.run(None, dict(feeds))
        except Exception as error:
            raise ValueError(f"{self.path}: does not run on this photograph: {_line(error)}") from error

    def signature(self) -> str:
        """Inputs and outputs in words, for an error."""
        return f"inputs {_puts(self.inputs)}; outputs {_puts(self.outputs)}"

    @property
    def picture(self) -> str:
        """The name of the one input (N, 3, H, W); ValueError where there is another number of inputs."""
        name, shape = next(iter(self.inputs.items()), ("", ()))
        if len(self.inputs) != 1 or len(shape) != 4 or (shape[1] not in (3, None) and not _free(shape[1])):
            raise ValueError(f"{self.path}: expected one input (N, 3, H, W), got {self.signature()}")
        return name


@dataclass(frozen=True)
class Feeding:
    """How a photograph becomes a network's input.

    size: of the input, a square's side in pixels; with "short" that of the shorter side.
    fit: "stretch" to the square; "pad" to a square by repeating the edge, then scale; "short": the shorter
        side scaled to `size`, both to multiples of 32.
    mean, std: of red, green and blue in [0, 1], sRGB-encoded: what goes in is (value - mean) / std.
    order: "rgb" or "bgr".
    """

    size: int
    fit: str = "stretch"
    mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    std: tuple[float, ...] = (1.0, 1.0, 1.0)
    order: str = "rgb"

    def __post_init__(self) -> None:
        for name in ("mean", "std"):
            value = getattr(self, name)
            if len(value) != 3 or not np.isfinite(value).all() or (name == "std" and min(value) <= 0):
                raise ValueError(f"{name}: expected three numbers{' > 0' * (name == 'std')}, got {value}")
        if self.order not in ("rgb", "bgr"):
            raise ValueError(f"order: expected rgb or bgr, got {self.order!r}")
        if self.fit not in ("stretch", "pad", "short"):
            raise ValueError(f"fit: expected stretch, pad or short, got {self.fit!r}")
        if not 1 <= self.size <= 8192:
            raise ValueError(f"size: expected 1 to 8192 pixels, got {self.size}")

    def fed(self, encoded: np.ndarray) -> np.ndarray:
        """A photograph (H, W, 3), sRGB-encoded in [0, 1], as the input (1, 3, h, w) float32."""
        mean, std = np.array(self.mean, np.float32), np.array(self.std, np.float32)
        pixels = (np.float32(encoded) - mean) / std
        picture = torch.from_numpy(np.ascontiguousarray(pixels)).permute(2, 0, 1)[None]
        height, width = encoded.shape[:2]
        if self.fit == "pad":
            left, top, right, bottom = _margins(height, width)
            picture = F.pad(picture, (left, right, top, bottom), mode="replicate")
        size = (self.size, self.size)
        if self.fit == "short":
            scale = self.size / min(height, width)
            size = (_multiple(height * scale), _multiple(width * scale))
        picture = F.interpolate(picture, size, mode="bilinear", antialias=True, align_corners=False)
        return picture.numpy()[:, :: -1 if self.order == "bgr" else 1].copy()

    def laid(self, answer: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        """An answer (C, h, w) back over the photograph: (H, W, C) float32."""
        height, width = size
        left, top, right, bottom = _margins(height, width) if self.fit == "pad" else (0, 0, 0, 0)
        whole = (height + top + bottom, width + left + right)
        maps = torch.from_numpy(np.ascontiguousarray(answer, np.float32))[None]
        maps = F.interpolate(maps, whole, mode="bilinear", antialias=True, align_corners=False)[0]
        return maps[:, top : top + height, left : left + width].permute(1, 2, 0).contiguous().numpy()


def checked_maps(path: Path, name: str, answer: Any, channels: int) -> np.ndarray:
    """An output as (channels, h, w); ValueError for another shape, NaN or infinite values."""
    maps = np.asarray(answer)
    while maps.ndim > 3 and maps.shape[0] == 1:
        maps = maps[0]
    maps = maps[None] if maps.ndim == 2 else maps
    if maps.ndim != 3 or maps.shape[0] != channels:
        shape = np.asarray(answer).shape
        raise ValueError(f"{path}: expected output {name!r} of shape (1, {channels}, H, W), got {shape}")
    if not np.isfinite(maps).all():
        raise ValueError(f"{path}: its output {name!r} holds NaN or infinite values")
    return maps.astype(np.float32)


def _margins(height: int, width: int) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of what makes a picture square, in pixels."""
    side = max(height, width)
    left, top = (side - width) // 2, (side - height) // 2
    return left, top, side - width - left, side - height - top


def _multiple(length: float) -> int:
    return max(32, int(length / 32) * 32)


def _free(size: int | str | None) -> bool:
    return not isinstance(size, int)


def _puts(puts: Mapping[str, Shape]) -> str:
    return ", ".join(f"{name} {tuple(shape)}" for name, shape in puts.items())


def _line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0]
