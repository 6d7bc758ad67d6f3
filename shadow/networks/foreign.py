"""Normals and depth by third-party networks: ONNX files that users provide."""

from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt

from shadow.directions import CAMERA, from_axes
from shadow.files import AnyPath
from shadow.networks.checkpoints import Origin
from shadow.networks.onnx import OnnxFile, Preprocessing
from shadow.srgb import encode_srgb

# DAViD (Saleh et al., ICCV 2025) takes a square of 512 pixels with edge padding, in BGR; normals in our axes.
DAVID = Preprocessing(512, "pad", order="bgr")
MIN_OUTWARD = 0.05  # least mean product, in x and in y, of the rim's normals and the outward direction
RIM_PIXELS = 4  # pixels from the matte's edge


class OnnxNormals:
    """A network that writes normals, as `shadow.normals.load` returns it."""

    def __init__(self, path: AnyPath, *, axes: str = CAMERA, order: str | None = None) -> None:
        """Open the file.

        `axes`: the axes of the file's vectors. `order`: "rgb" or "bgr", the channel order of its input, which
        is the sRGB-encoded photograph in [0, 1], padded to a square by its edge. It is needed unless the
        inputs and outputs are those of DAViD.

        Raises the errors of `shadow.networks.onnx.OnnxFile`, and ValueError if no output has three channels.
        """
        self._file, self._matrix = OnnxFile(path), from_axes(axes)
        shape = self._file.inputs[self._file.picture]
        channels = self._file.channels
        if channels.count(3) != 1:
            raise ValueError(f"{path}: expected one output (N, 3, H, W), got {self._file.signature()}")
        self._output = channels.index(3)
        known = shape[2:] == (512, 512) and channels in ([3], [1, 3, 1])
        if order is None and not known:
            raise ValueError(
                f"{path}: is not DAViD's by its inputs and outputs: expected order, rgb or bgr, as well; its "
                f"{self._file.signature()}"
            )
        side = shape[2] if isinstance(shape[2], int) else DAVID.size
        self._preprocessing = Preprocessing(side, "pad", order=order or DAVID.order)
        self.origin = Origin(Path(path).name, None, {})

    def normals(self, rgb: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Infer unit normals (3, H, W), zero outside the mask, from rgb (3, H, W), linear, and mask (H, W).

        Raises ValueError if the output has NaN, or if the normals at the rim point into the person.
        """
        maps = self._file.maps(_encoded(rgb), self._preprocessing, self._output, 3)
        size = (mask.shape[0], mask.shape[1])
        vectors = self._preprocessing.restore(maps, size) @ self._matrix.T
        length = np.linalg.norm(vectors, axis=-1, keepdims=True)
        unit = np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 1e-6)
        coverage = mask.cpu().numpy()
        check_outward(self._file.path, unit, coverage)
        return _tensor(unit * (coverage > 0)[..., None], rgb.device)


class OnnxDepth:
    """A network that writes relative depth: DAViD's depth or multi-task model."""

    def __init__(self, path: AnyPath) -> None:
        """Open the file; raises the errors of `OnnxFile`, and ValueError if its signature is neither
        model's."""
        self._file = OnnxFile(path)
        shape = self._file.inputs[self._file.picture]
        if shape[2:] != (DAVID.size, DAVID.size) or self._file.channels not in ([1], [1, 3, 1]):
            raise ValueError(
                f"{path}: is neither DAViD's depth nor its multi-task model by its inputs and outputs; "
                f"expected one of these, or depth as an array; its {self._file.signature()}"
            )

    def depth(self, rgb: torch.Tensor) -> torch.Tensor:
        """Infer depth (1, H, W), up to scale, sign and shift, from rgb (3, H, W), linear.

        Raises ValueError if the output has NaN.
        """
        maps = self._file.maps(_encoded(rgb), DAVID, 0, 1)
        return _tensor(DAVID.restore(maps, (rgb.shape[1], rgb.shape[2])), rgb.device)


def _encoded(rgb: torch.Tensor) -> np.ndarray:
    """Convert rgb (3, H, W), linear, to (H, W, 3), sRGB-encoded in [0, 1]."""
    linear = rgb.permute(1, 2, 0).clamp(0, 1).cpu().numpy()
    return encode_srgb(linear)


def _tensor(maps: np.ndarray, device: torch.device) -> torch.Tensor:
    """Convert maps (H, W, C) to a float32 tensor (C, H, W) on a device."""
    return torch.from_numpy(np.ascontiguousarray(maps, np.float32)).permute(2, 0, 1).to(device)


def check_outward(path: Path, normals: np.ndarray, mask: np.ndarray) -> None:
    """Raise ValueError unless normals (H, W, 3) point outward at the rim of a matte (H, W), and to the
    camera.

    At the silhouette of a smooth body the normal lies in the image plane and points out of the body. The
    borders of the picture are not part of the rim.
    """
    inside = np.pad(mask > 0.5, RIM_PIXELS, mode="edge")
    depth = distance_transform_edt(inside) - distance_transform_edt(~inside)
    down, right = np.gradient(depth)
    sides = (slice(RIM_PIXELS, -RIM_PIXELS), slice(RIM_PIXELS, -RIM_PIXELS))
    rim = ((depth > 0) & (depth <= RIM_PIXELS))[sides]
    if not rim.any():
        return
    across = -(normals[..., 0] * right[sides])[rim].mean()
    along = (normals[..., 1] * down[sides])[rim].mean()
    wrong = [name for name, value in (("x", across), ("y", along)) if value < MIN_OUTWARD]
    if normals[..., 2][mask > 0.5].mean() <= 0:
        wrong.append("z")
    if wrong:
        raise ValueError(
            f"{path}: its normals do not turn outward at the matte's rim, and to the camera, in "
            f"{' and '.join(wrong)}; expected x right, y up, z to the camera: say its axes, such as +x-y-z"
        )
