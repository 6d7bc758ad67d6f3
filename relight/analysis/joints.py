"""Where parts of the person's body are, in metres, for lights that follow them.

They are those of MediaPipe's landmark network, at the depth of the surface that is seen there.
"""

from collections.abc import Mapping

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt

from relight.analysis import skin
from relight.analysis.maps import AnalysisMaps
from relight.lights.near import NearLight, Point
from shadow.installing import install_command

# Rows of the landmarks whose mean is the part: ears; hips; wrist, little finger and forefinger.
ROWS = {"head": [7, 8], "hips": [23, 24], "left-hand": [15, 17, 19], "right-hand": [16, 18, 20]}


def find(maps: AnalysisMaps) -> dict[str, Point]:
    """Return where the parts are that are seen, {name: (x, y, z)} in metres; left is the person's left."""
    points = skin.joints(maps.image, maps.known)
    if points is None:
        return {}
    unknown = (~maps.known).numpy()
    rows, columns = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    found: dict[str, Point] = {}
    framing, depths = maps.geometry.framing, maps.geometry.depth
    for name, parts in ROWS.items():
        x, y = points[parts].mean(axis=0)
        if not np.isfinite([x, y]).all():
            continue
        row, column = (int(min(max(each, 0), n - 1)) for each, n in zip((y, x), unknown.shape, strict=True))
        depth = depths[rows[row, column], columns[row, column]]
        across, down = (
            (place - length / 2) / framing.scale + middle
            for place, length, middle in zip((x, y), unknown.shape[::-1], framing.centre, strict=True)
        )
        position = maps.geometry.camera.positions(torch.tensor(across), torch.tensor(down), depth)
        found[name] = tuple(map(float, position))
    return found


def check_available(light: NearLight) -> None:
    """Raise ValueError where no part of a body can be found, for a light that follows one."""
    if not skin.is_available():
        extra = install_command("auto")
        raise ValueError(
            f"{light.name or 'a light'}: at={light.at} needs the networks that find people "
            f"(relight fetch person; {extra}); or leave out at: its position is from the subject's middle"
        )


def placed(light: NearLight, joints: Mapping[str, Point], where: str = "") -> NearLight:
    """Return a light that follows a part of the body as it stands there.

    Raises ValueError if that part is not seen. `where`: what the message says of the place.
    """
    assert light.at is not None
    if light.at not in joints:
        check_available(light)
        raise ValueError(
            f"{light.name or 'a light'}: {where}at={light.at} is not seen; choose another part, or leave out "
            "at, and give its position from the subject's middle"
        )
    return light.standing_at(joints[light.at])
