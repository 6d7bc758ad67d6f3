"""Which camera of a scene is the plate's, where it sees the subject, and how much of a picture it sees."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple, TypeGuard, TypeVar

import numpy as np

Camera = TypeVar("Camera")

EXPAND = "expandAperture"


class CameraView(NamedTuple):
    """The angles of view of a film back, as tangents of half of them, and how it is fitted to a picture.

    `fit` is an `aspectRatioConformPolicy` of UsdRender. Its default, "expandAperture", is what glTF asks for
    too: nothing that the film back sees is lost.
    """

    horizontal: float
    vertical: float
    fit: str = EXPAND

    def vertical_degrees(self, aspect: float) -> float:
        """Return the vertical angle of view in degrees of a picture `aspect` times as wide as high.

        >>> full_frame = CameraView(18 / 50, 12 / 50)  # 36 x 24 mm behind 50 mm
        >>> round(full_frame.vertical_degrees(16 / 9), 1), round(full_frame.vertical_degrees(3 / 4), 1)
        (27.0, 51.3)
        """
        by_width = self.horizontal / aspect
        tangent = {
            EXPAND: max(self.vertical, by_width),
            "cropAperture": min(self.vertical, by_width),
            "adjustApertureHeight": by_width,
        }.get(self.fit, self.vertical)
        return math.degrees(2 * math.atan(tangent))


def choose_camera(path: Path, cameras: Sequence[tuple[str, Camera]], name: str | None) -> Camera | None:
    """Return the camera of a name, of pairs (name, camera), or the only one; None if there is none.

    Raises ValueError, which names the file, for an unknown name, or for several cameras and no name.
    """
    listed = ", ".join(each for each, _ in cameras[:20]) or "none"
    if name is None:
        if len(cameras) > 1:
            raise ValueError(f"{path}: has several cameras; expected one of {listed} (camera=NAME)")
        return cameras[0][1] if cameras else None
    for each, camera in cameras:
        if each == name:
            return camera
    raise ValueError(f"{path}: has no camera {name}; its cameras are {listed}")


def subject_point(subject_at: Iterable[float]) -> np.ndarray:
    """Return the subject's position (3,) in the scene; raises ValueError for other than three numbers."""
    point = np.array(list(subject_at), float)
    if point.shape != (3,) or not np.isfinite(point).all():
        expected = "the path of a prim, the name of a node, or three numbers"
        raise ValueError(f"subject_at: expected {expected}, got {subject_at!r}")
    return point


def of_gltf(path: Path, camera: object) -> CameraView | None:
    """Return what a camera of a glTF scene sees; None for an orthographic one.

    Raises ValueError, which names the file, for angles and aspects that are none.
    """
    perspective = camera.get("perspective") if isinstance(camera, dict) else None
    if not isinstance(perspective, dict):
        return None
    yfov, aspect = perspective.get("yfov"), perspective.get("aspectRatio")
    if not _is_positive(yfov) or yfov >= math.pi or not (aspect is None or _is_positive(aspect)):
        raise ValueError(
            f"{path}: its camera has the angle of view {yfov!r:.40} and the aspect {aspect!r:.40}; expected "
            "positive numbers, and less than pi radians"
        )
    tangent = math.tan(yfov / 2)
    width = 0.0 if aspect is None else tangent * aspect  # without an aspect, it has the picture's
    return CameraView(width, tangent)


def _is_positive(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < math.inf
