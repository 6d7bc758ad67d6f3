"""Normals and depth by networks of others: ONNX files that users bring themselves."""

from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt

from shadow.directions import CAMERA, from_axes
from shadow.files import AnyPath
from shadow.networks.checkpoints import Origin
from shadow.onnxfiles import Feeding, OnnxFile, Shape, checked_maps

# DAViD (Saleh et al., ICCV 2025): a square of 512, padded by the edge, blue first; normals in our axes.
DAVID = Feeding(512, "pad", order="bgr")
SURE = 0.05  # least mean product, in x and in y, of normals at the rim with the way out of the matte
RIM = 4  # pixels from the matte's edge


class OnnxNormals:
    """A network that writes normals, as `shadow.normals.load` returns it."""

    def __init__(self, path: AnyPath, *, axes: str = CAMERA, order: str | None = None) -> None:
        """`axes`: what the file's vectors are measured along.

        `order`: "rgb" or "bgr", in which it wants the photograph, sRGB-encoded from 0 to 1, in a square
        padded by the edge; needed unless inputs and outputs are DAViD's.

        Raises as `shadow.onnxfiles.OnnxFile`; ValueError for a file without an output of three channels.
        """
        self._file, self._matrix = OnnxFile(path), from_axes(axes)
        shape = self._file.inputs[self._file.picture]
        outputs = list(self._file.outputs.values())
        maps = [index for index, output in enumerate(outputs) if _channels(output) == 3]
        if len(maps) != 1:
            raise ValueError(f"{path}: expected one output (N, 3, H, W), got {self._file.signature()}")
        self._output = maps[0]
        known = shape[2:] == (512, 512) and [_channels(o) for o in outputs] in ([3], [1, 3, 1])
        if order is None and not known:
            raise ValueError(
                f"{path}: is not DAViD's by its inputs and outputs: expected order, rgb or bgr, as well; its "
                f"{self._file.signature()}"
            )
        side = shape[2] if isinstance(shape[2], int) else DAVID.size
        self._feeding = Feeding(side, "pad", order=order or DAVID.order)
        self.origin = Origin(Path(path).name, None, {})

    def normals(self, rgb: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """rgb (3, H, W), linear, and mask (H, W) to unit normals (3, H, W), zero outside the mask.

        ValueError where the file answers with NaN, or with normals that point into the person at the rim.
        """
        answer = self._file.run({self._file.picture: self._feeding.fed(_encoded(rgb))})[self._output]
        maps = checked_maps(self._file.path, [*self._file.outputs][self._output], answer, 3)
        size = (mask.shape[0], mask.shape[1])
        vectors = self._feeding.laid(maps, size) @ self._matrix.T
        length = np.linalg.norm(vectors, axis=-1, keepdims=True)
        unit = np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 1e-6)
        coverage = mask.cpu().numpy()
        check_outward(self._file.path, unit, coverage)
        unit = unit * (coverage > 0)[..., None]
        return torch.from_numpy(np.ascontiguousarray(unit, np.float32)).permute(2, 0, 1).to(rgb.device)


class OnnxDepth:
    """A network that writes relative depth: DAViD's depth or multi-task model."""

    def __init__(self, path: AnyPath) -> None:
        """Raises as `shadow.onnxfiles.OnnxFile`; ValueError for a file that is neither by its signature."""
        self._file = OnnxFile(path)
        shape = self._file.inputs[self._file.picture]
        channels = [_channels(output) for output in self._file.outputs.values()]
        if shape[2:] != (DAVID.size, DAVID.size) or channels not in ([1], [1, 3, 1]):
            raise ValueError(
                f"{path}: is neither DAViD's depth nor its multi-task model by its inputs and outputs; "
                f"expected one of these, or depth as an array; its {self._file.signature()}"
            )

    def depth(self, rgb: torch.Tensor) -> torch.Tensor:
        """rgb (3, H, W), linear, to depth (1, H, W) up to scale and shift, either way up.

        ValueError where the file answers with NaN.
        """
        answer = self._file.run({self._file.picture: DAVID.fed(_encoded(rgb))})[0]
        maps = checked_maps(self._file.path, next(iter(self._file.outputs)), answer, 1)
        laid = DAVID.laid(maps, (rgb.shape[1], rgb.shape[2]))
        return torch.from_numpy(np.ascontiguousarray(laid, np.float32)).permute(2, 0, 1).to(rgb.device)


def _encoded(rgb: torch.Tensor) -> np.ndarray:
    """rgb (3, H, W), linear, as (H, W, 3), sRGB-encoded in [0, 1]."""
    linear = rgb.permute(1, 2, 0).clamp(0, 1).cpu().numpy()
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def check_outward(path: Path, normals: np.ndarray, mask: np.ndarray) -> None:
    """ValueError unless normals (H, W, 3) turn outward at the rim of a matte (H, W), and to the camera.

    At the silhouette of a smooth body the normal lies in the picture and points out of it. Sides where the
    picture ends are none.
    """
    inside = np.pad(mask > 0.5, RIM, mode="edge")  # the picture's own sides are no rim
    depth = distance_transform_edt(inside) - distance_transform_edt(~inside)
    down, right = np.gradient(depth)
    sides = (slice(RIM, -RIM), slice(RIM, -RIM))
    rim = ((depth > 0) & (depth <= RIM))[sides]
    if not rim.any():
        return
    across = -(normals[..., 0] * right[sides])[rim].mean()
    along = (normals[..., 1] * down[sides])[rim].mean()
    wrong = [name for name, value in (("x", across), ("y", along)) if value < SURE]
    if normals[..., 2][mask > 0.5].mean() <= 0:
        wrong.append("z")
    if wrong:
        raise ValueError(
            f"{path}: its normals do not turn outward at the matte's rim, and to the camera, in "
            f"{' and '.join(wrong)}; expected x right, y up, z to the camera: say its axes, such as +x-y-z"
        )


def _channels(shape: Shape) -> int | str | None:
    return shape[1] if len(shape) == 4 else 1
