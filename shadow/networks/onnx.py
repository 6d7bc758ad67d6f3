"""ONNX files: open them, prepare a photograph as their input, and bring their output back to its pixels."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F

from shadow.files import AnyPath
from shadow.installing import install_command

Shape = tuple[int | str | None, ...]
# ONNX Runtime's names of the types that a photograph can be cast to.
FLOATS = {"tensor(float16)": np.float16, "tensor(float)": np.float32, "tensor(double)": np.float64}

MAX_SIDE = 8192  # pixels of a network's input


class OnnxFile:
    """An ONNX file on the CPU.

    inputs, outputs: {name: shape}, in the file's order; a dynamic size is a name or None.
    """

    def __init__(self, path: AnyPath) -> None:
        """Open the file.

        Raises ImportError without onnxruntime (extra `matte`), FileNotFoundError, or ValueError if the file
        is not a model.
        """
        self.path = Path(path)
        if not self.path.is_file():
            raise FileNotFoundError(f"{path}: no such file")
        try:
            import onnxruntime
        except ImportError as error:
            raise ImportError(
                f"{path}: needs onnxruntime; install it with: {install_command('matte')}"
            ) from error
        settings = onnxruntime.SessionOptions()
        settings.log_severity_level = 4  # errors are raised, so they need not be logged
        try:
            # Without the fallback: a second attempt after an error would print.
            self._session = onnxruntime.InferenceSession(
                str(path), settings, providers=["CPUExecutionProvider"], enable_fallback=0
            )
        except Exception as error:  # ONNX Runtime's errors have no base class but Exception
            raise ValueError(f"{path}: is no ONNX model that can be opened: {_line(error)}") from error
        puts = self._session.get_inputs()
        self.inputs: dict[str, Shape] = {put.name: tuple(put.shape) for put in puts}
        self._types: dict[str, str] = {put.name: put.type for put in puts}
        self.outputs: dict[str, Shape] = {put.name: tuple(put.shape) for put in self._session.get_outputs()}

    def run(self, feeds: Mapping[str, np.ndarray]) -> list[np.ndarray]:
        """Return all outputs, in the file's order.

        Floats are cast to the type of each input, such as float16. Raises ValueError for an input of another
        type, and if the model does not accept these inputs.
        """
        cast = {name: self._cast(name, value) for name, value in feeds.items()}
        try:
            return self._session.run(None, cast)
        except Exception as error:
            raise ValueError(f"{self.path}: does not run on this photograph: {_line(error)}") from error

    def maps(
        self, encoded: np.ndarray, preprocessing: "Preprocessing", output: int, channels: int
    ) -> np.ndarray:
        """Return the maps (channels, h, w) of one output for a photograph (H, W, 3), sRGB-encoded.

        Raises ValueError as `run` does, and for an output of another shape, or with NaN or infinite values.
        """
        answer = self.run({self.picture: preprocessing.preprocess(encoded)})[output]
        return checked_maps(self.path, [*self.outputs][output], answer, channels)

    def _cast(self, name: str, value: np.ndarray) -> np.ndarray:
        """Return a value in the type of its input."""
        kind = self._types.get(name, "tensor(float)")
        if kind not in FLOATS:
            raise ValueError(
                f"{self.path}: its input {name!r} is of {kind}, expected floats: {', '.join(FLOATS)}"
            )
        return np.asarray(value).astype(FLOATS[kind], copy=False)

    def signature(self) -> str:
        """Describe inputs and outputs for an error message."""
        return f"inputs {_puts(self.inputs)}; outputs {_puts(self.outputs)}"

    @property
    def channels(self) -> list[int | str | None]:
        """The number of channels of each output; 1 for one that has no axis of channels."""
        return [shape[1] if len(shape) == 4 else 1 for shape in self.outputs.values()]

    @property
    def picture(self) -> str:
        """Return the name of the only input (N, 3, H, W); raises ValueError for any other inputs."""
        name, shape = next(iter(self.inputs.items()), ("", ()))
        is_picture = (
            len(self.inputs) == 1 and len(shape) == 4 and (shape[1] == 3 or not isinstance(shape[1], int))
        )
        if not is_picture or any(isinstance(size, int) and size < 1 for size in shape):
            raise ValueError(f"{self.path}: expected one input (N, 3, H, W), got {self.signature()}")
        return name


@dataclass(frozen=True)
class Preprocessing:
    """The preprocessing that turns a photograph into a network's input, and its inverse for the output."""

    size: int  # side of the square input in pixels; with "short", the shorter side
    # "stretch" to the square; "pad" to a square by repeating the edge, then scale; "short": the shorter side
    # scaled to `size`, both to multiples of 32.
    fit: str = "stretch"
    # Of red, green and blue in [0, 1], sRGB-encoded: the input is (value - mean) / std.
    mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    std: tuple[float, ...] = (1.0, 1.0, 1.0)
    order: str = "rgb"  # or "bgr"

    def __post_init__(self) -> None:
        for name in ("mean", "std"):
            value = getattr(self, name)
            if len(value) != 3 or not np.isfinite(value).all() or (name == "std" and min(value) <= 0):
                raise ValueError(f"{name}: expected three numbers{' > 0' * (name == 'std')}, got {value}")
        if self.order not in ("rgb", "bgr"):
            raise ValueError(f"order: expected rgb or bgr, got {self.order!r}")
        if self.fit not in ("stretch", "pad", "short"):
            raise ValueError(f"fit: expected stretch, pad or short, got {self.fit!r}")
        if not 1 <= self.size <= MAX_SIDE:
            raise ValueError(f"size: expected 1 to {MAX_SIDE} pixels, got {self.size}")

    def preprocess(self, encoded: np.ndarray) -> np.ndarray:
        """Turn a photograph (H, W, 3), sRGB-encoded in [0, 1], into the input (1, 3, h, w) float32."""
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

    def restore(self, answer: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        """Bring an output (C, h, w) to the photograph's `size` (H, W): (H, W, C) float32."""
        height, width = size
        left, top, right, bottom = _margins(height, width) if self.fit == "pad" else (0, 0, 0, 0)
        whole = (height + top + bottom, width + left + right)
        maps = torch.from_numpy(np.ascontiguousarray(answer, np.float32))[None]
        maps = F.interpolate(maps, whole, mode="bilinear", antialias=True, align_corners=False)[0]
        return maps[:, top : top + height, left : left + width].permute(1, 2, 0).contiguous().numpy()


def checked_maps(path: Path, name: str, answer: object, channels: int) -> np.ndarray:
    """Return an output as (channels, h, w); raises ValueError for another shape, NaN or infinite values."""
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
    """Return the left, top, right and bottom padding, in pixels, that makes a picture square."""
    side = max(height, width)
    left, top = (side - width) // 2, (side - height) // 2
    return left, top, side - width - left, side - height - top


def _multiple(length: float) -> int:
    return max(32, int(length / 32) * 32)


def _puts(puts: Mapping[str, Shape]) -> str:
    return ", ".join(f"{name} {tuple(shape)}" for name, shape in puts.items())


def _line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0]
