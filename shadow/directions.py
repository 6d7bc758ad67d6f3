"""The camera frame, and light directions in it.

Camera frame: x to image right, y up, z from the scene toward the camera. A light direction is the unit
vector from the subject *to* the light; (0, 0, 1) is at the camera. Azimuth (degrees) turns from +z toward
+x, so -40 is a light at image left; elevation (degrees) rises from the horizon toward +y. Directions with
z > 0 form the frontal hemisphere; lights behind the subject (z < 0) are legal and give rims.
"""

import re

import numpy as np
from numpy.typing import ArrayLike

CAMERA = "+x+y+z"  # the camera frame itself, as `axes` names it
OLAT_FRONT = 64  # Section 3: 64 uniformly sampled directions on the hemisphere facing the camera
OLAT_BEHIND = 32


def from_spherical(azimuth: ArrayLike, elevation: ArrayLike) -> np.ndarray:
    """Return unit vectors (..., 3), float32, of an azimuth and elevation (...) in degrees."""
    azimuth, elevation = np.radians(np.broadcast_arrays(azimuth, elevation))
    horizontal = np.cos(elevation)
    vectors = [horizontal * np.sin(azimuth), np.sin(elevation), horizontal * np.cos(azimuth)]
    return np.stack(vectors, axis=-1).astype(np.float32)


def to_spherical(directions: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return azimuth (...) in [-180, 180] and elevation (...) in [-90, 90], degrees, of vectors (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    return np.degrees(np.arctan2(x, z)), np.degrees(np.arctan2(y, np.hypot(x, z)))


def from_axes(axes: str) -> np.ndarray:
    """Return the (3, 3) float32 matrix that converts vectors of another axis convention to the camera frame.

    `axes` names the camera-frame axis of each of a vector's three components: "+x+y+z" is the camera frame
    itself; "+x-y-z" is OpenCV's, x right, y down, z into the scene; "+x-y+z" is a normal map with inverted
    green. Raises ValueError if it is none of the 48 conventions.
    """
    match = re.fullmatch(3 * "([+-])([xyz])", axes) if isinstance(axes, str) else None
    if match is None or len(set(match.groups()[1::2])) < 3:
        raise ValueError(f"axes: expected each of x, y and z once, signed, such as '+x-y-z'; got {axes!r}")
    matrix = np.zeros((3, 3), np.float32)
    for component in range(3):
        sign, axis = match.groups()[2 * component : 2 * component + 2]
        matrix["xyz".index(axis), component] = float(sign + "1")
    return matrix


def _spiral(count: int, z: np.ndarray) -> np.ndarray:
    """Return directions at heights `z` (count,) above the image plane, each turned by the golden angle.

    Equal steps of z are equal areas of the sphere (Archimedes), so the spiral is nearly uniform.
    """
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    radius = np.sqrt(1 - z**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1).astype(np.float32)


def olat(behind: bool = False) -> np.ndarray:
    """Return the OLAT direction set: (64, 3) on the frontal hemisphere, or (96, 3) with 32 more behind.

    The first 64 are the same either way. Float32 unit vectors, ordered from the camera outward.
    """
    front = _spiral(OLAT_FRONT, 1 - (np.arange(OLAT_FRONT) + 0.5) / OLAT_FRONT)
    if not behind:
        return front
    return np.concatenate([front, _spiral(OLAT_BEHIND, -(np.arange(OLAT_BEHIND) + 0.5) / OLAT_BEHIND)])


def stratified(count: int, rng: np.random.Generator, behind: bool = False) -> np.ndarray:
    """Return random directions (count, 3), float32: one in each of `count` equal areas of the frontal half.

    With `behind`, a third of them are on the other half of the sphere, as in `olat`. Each half is covered
    uniformly for any count, and is rotated about the camera's axis by a random angle.
    """
    back = count // 3 if behind else 0
    parts = []
    for number, side in ((count - back, 1), (back, -1)):
        z = side * (1 - (np.arange(number) + rng.uniform(size=number)) / max(1, number))
        angle, turned = rng.uniform(0, 2 * np.pi), _spiral(number, z)
        cosine, sine = np.cos(angle), np.sin(angle)
        parts.append(turned @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]]))
    return np.concatenate(parts).astype(np.float32)
