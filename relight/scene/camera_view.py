"""What a scene's camera sees in a picture of another shape than its film back."""

import math
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

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


def of_gltf(path: Path, camera: Any) -> CameraView | None:
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


def _is_positive(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < math.inf
