"""Environments as the six faces of a cube, in a strip or a cross, resampled to a latitude-longitude map.

Directions are those of the camera frame, and of OpenEXR's maps: the front face looks along +z, and the face
to its left along +x.
"""

import numpy as np

from relight.media.resampling import sample

X, Y, Z = np.eye(3)
Face = tuple[np.ndarray, np.ndarray, np.ndarray]  # where it looks, its right, its top; seen from inside
FRONT, BACK = (Z, -X, Y), (-Z, X, Y)
LEFT, RIGHT = (X, Z, Y), (-X, -Z, Y)
UP, DOWN = (Y, -X, -Z), (-Y, -X, Z)  # their sides toward the front are below and above
BACK_TURNED = (-Z, -X, -Y)  # below the bottom face of a vertical cross
# Faces by row and column. A strip has OpenGL's and Direct3D's order +X, -X, +Y, -Y, +Z, -Z, with +X at the
# right of +Z; OpenEXR's vertical strip has +X at the left (ImfEnvmap.h).
STRIP = (RIGHT, LEFT, UP, DOWN, FRONT, BACK)
OPENEXR_STRIP = (LEFT, RIGHT, (Y, X, Z), (-Y, X, -Z), FRONT, BACK)
CROSS = {(0, 1): UP, (1, 0): LEFT, (1, 1): FRONT, (1, 2): RIGHT, (2, 1): DOWN}
LAYOUTS: dict[tuple[int, int], dict[tuple[int, int], Face]] = {  # by rows and columns of faces
    (1, 6): {(0, column): face for column, face in enumerate(STRIP)},
    (6, 1): {(row, 0): face for row, face in enumerate(STRIP)},
    (3, 4): CROSS | {(1, 3): BACK},
    (4, 3): CROSS | {(3, 1): BACK_TURNED},
}
UNUSED = 0.02  # most that the unused corners of a cross vary, of the mean: else it is a picture of 4:3


def is_cube(pixels: np.ndarray) -> bool:
    """Return whether a picture (H, W, C) is a cube's strip or cross by its shape and its unused corners."""
    return _layout(pixels) is not None


def to_latlong(pixels: np.ndarray, *, openexr: bool = False) -> np.ndarray:
    """Resample a cube's faces of F pixels to a latitude-longitude map (2 F, 4 F, C) float32 around its front.

    `pixels`: (H, W, C), linear: a strip of 6:1 or 1:6, in the order +X, -X, +Y, -Y, +Z, -Z; or a cross of 4:3
    or 3:4, whose front is the second face of its second row. `openexr`: whether a vertical strip is an
    OpenEXR file's, whose +X is at the left of its +Z. Raises ValueError for another shape, or a cross whose
    unused corners hold a picture.
    """
    counts = _layout(pixels)
    if counts is None:
        raise ValueError("expected six faces of a cube, in a strip or a cross")
    layout = LAYOUTS[counts]
    if openexr and counts == (6, 1):
        layout = {(row, 0): face for row, face in enumerate(OPENEXR_STRIP)}
    side = pixels.shape[0] // counts[0]
    directions = latlong_directions(2 * side)
    result = np.zeros((*directions.shape[:2], pixels.shape[2]), np.float32)
    nearest = np.argmax([directions @ face[0] for face in layout.values()], axis=0)
    for index, ((row, column), (forward, right, top)) in enumerate(layout.items()):
        chosen = nearest == index
        towards = directions[chosen]
        depth = towards @ forward
        face = pixels[row * side : (row + 1) * side, column * side : (column + 1) * side]
        across, down = towards @ right / depth, -(towards @ top) / depth
        result[chosen] = sample(face, across[None], down[None])[0]
    return result


def _layout(pixels: np.ndarray) -> tuple[int, int] | None:
    """Return the rows and columns of faces, None where a picture is no cube."""
    height, width = pixels.shape[:2]
    for rows, columns in LAYOUTS:
        side = height // rows
        if side and (height, width) == (rows * side, columns * side):
            return (rows, columns) if _is_unused(pixels, rows, columns) else None
    return None


def _is_unused(pixels: np.ndarray, rows: int, columns: int) -> bool:
    """Return whether the cells without a face have one colour each."""
    side, cells = pixels.shape[0] // rows, LAYOUTS[rows, columns]
    limit = UNUSED * float(np.abs(pixels[..., :3]).mean())
    for row in range(rows):
        for column in range(columns):
            cell = pixels[row * side : (row + 1) * side, column * side : (column + 1) * side, :3]
            if (row, column) not in cells and np.ptp(cell, axis=(0, 1)).max() > limit:
                return False
    return True


def latlong_directions(height: int) -> np.ndarray:
    """Return the unit directions (H, 2 H, 3) of a latitude-longitude map's pixels."""
    latitude = np.pi / 2 - (np.arange(height) + 0.5)[:, None] * np.pi / height
    longitude = np.pi - (np.arange(2 * height) + 0.5)[None] * np.pi / height
    x, z = np.sin(longitude) * np.cos(latitude), np.cos(longitude) * np.cos(latitude)
    return np.stack([x, np.broadcast_to(np.sin(latitude), x.shape), z], axis=-1)
