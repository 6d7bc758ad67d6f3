"""The person as a closed triangle mesh: the front that the camera saw, and a back to go with it.

The front is a grid over the plate whose nodes lie at the depth that was inferred. Where depth jumps, as where
an arm passes before the chest, the grid is cut: the near sheet ends at its own nodes, and the far sheet goes
on one cell beneath it, so that no gap shows from the camera. The back lies behind the front by the thickness
that `relight.compositing.shadow_caster` takes a body to have, and walls join the two along every border.

The material cuts the mesh at half coverage. The front goes on beyond that outline, for those who blend it.
The back ends there, close behind the front: if the cut went through its steep rim, it would open the shell.
"""

import math
from typing import NamedTuple, Self

import numpy as np
import torch
from scipy.ndimage import binary_dilation, map_coordinates
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from relight.analysis.camera import Camera
from relight.analysis.record import AnalysisRecord
from relight.analysis.upsampling import EXTENSION_SHARE
from relight.compositing.shadow_caster import thickness
from shadow.framing import Extension, Framing

TRIANGLES = 120_000  # at most, unless said
FEWEST = 1_000  # triangles that a person can be made of
JUMP = 0.03  # metres of depth between neighbouring nodes beyond which the surface is cut
MIN_COVERAGE = 0.02  # coverage below which a part of the plate has no surface
THINNEST = 5e-4  # metres between front and back, so that no renderer sees them in one place
CUTOFF = 0.5  # coverage below which the material cuts the mesh away
BISECTIONS = 8  # that find where coverage crosses CUTOFF between two nodes
SMOOTH = 0.03  # metres: the standard deviation by which the back is smoothed, less close to the outline
STEP = 0.5  # of the variance that a mean over neighbours adds, in squares of the spacing of vertices
INSET = 0.75  # pixels from there to the back's rim: between two of its vertices the outline may turn inward


class PersonSurface(NamedTuple):
    """What a mesh is made from: maps on the networks' canvas, continued a little beyond the person."""

    depth: np.ndarray  # (h, w) metres from the subject's middle, along the camera's axis
    normals: np.ndarray  # (h, w, 3) unit vectors, camera frame
    known: np.ndarray  # (h, w) bool: the maps hold values here
    framing: Framing  # where the canvas lies on the plate
    camera: Camera
    matte: np.ndarray  # (H, W) in [0, 1], on the plate

    @classmethod
    def of(cls, record: AnalysisRecord, matte: np.ndarray) -> Self:
        """Take the maps of an analysis, continued as those of pictures are."""
        maps, geometry = record.maps, record.maps.geometry
        layers = torch.cat([geometry.depth[None], maps.normals, torch.ones_like(geometry.depth)[None]])
        depth, *normals, known = Extension(maps.known, EXTENSION_SHARE)(layers).numpy()
        facing = np.stack(normals, axis=-1)
        return cls(depth, facing, known > 0.5, geometry.framing, geometry.camera, matte)


class Mesh(NamedTuple):
    """Triangles in the camera frame, metres from the subject's middle."""

    points: np.ndarray  # (V, 3) float32
    normals: np.ndarray  # (V, 3) float32 unit vectors
    uv: np.ndarray  # (V, 2) float32 in [0, 1], from the lower left of the box
    faces: np.ndarray  # (F, 3) int32, counter-clockwise from outside
    box: tuple[int, int, int, int]  # top, left, bottom, right: the part of the plate that `uv` spans, pixels
    lowest: float  # y of the soles: nothing is lower


class _Grid(NamedTuple):
    """Nodes over the plate, and the cells between them that show the person."""

    x: np.ndarray  # (n,) columns of nodes, pixels
    y: np.ndarray  # (m,) rows of nodes
    cells: np.ndarray  # (m - 1, n - 1) bool
    depth: np.ndarray  # (m, n) metres
    normals: np.ndarray  # (m, n, 3)


class _Outline(NamedTuple):
    """Where coverage is `CUTOFF` on the lines between the nodes of a grid, or `INSET` inside of it."""

    inside: np.ndarray  # (m, n) bool: nodes with more coverage
    x: np.ndarray  # (P,) pixels
    y: np.ndarray  # (P,) pixels
    inner: np.ndarray  # (P,) the node inside, of the two between which a point lies
    share: np.ndarray  # (P,) of the way from there to the node outside


def build(surface: PersonSurface, triangles: int = TRIANGLES) -> Mesh:
    """Build the mesh of a person, from what the networks found of them.

    `triangles`: the most that the mesh may have, at least 1,000. The grid is as fine as the networks' canvas
    where that many allow it. Raises ValueError for fewer triangles than a person needs.
    """
    check_triangles(triangles)
    box = _box(surface.matte)
    spacing = max(1.0, 1 / surface.framing.scale)  # pixels: no finer than the canvas or the plate
    while True:
        grid = _grid(surface, box, spacing)
        mesh = _shell(surface, grid, box)
        if len(mesh.faces) <= triangles:
            return mesh
        spacing *= 1.01 * math.sqrt(len(mesh.faces) / triangles)


def check_triangles(triangles: int) -> None:
    """Raise ValueError where a person needs more triangles."""
    if not isinstance(triangles, int) or triangles < FEWEST:
        raise ValueError(f"triangles: expected a whole number of at least {FEWEST}, got {triangles!r}")


def _box(matte: np.ndarray) -> tuple[int, int, int, int]:
    """Return the part of the plate that shows the person: top, left, bottom, right."""
    seen = matte > MIN_COVERAGE
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    return int(rows[0]), int(columns[0]), int(rows[-1]) + 1, int(columns[-1]) + 1


def _grid(surface: PersonSurface, box: tuple[int, int, int, int], spacing: float) -> _Grid:
    """Return nodes at most `spacing` pixels apart over a part of the plate."""
    top, left, bottom, right = box
    x = np.linspace(left, right, math.ceil((right - left) / spacing) + 1)
    y = np.linspace(top, bottom, math.ceil((bottom - top) / spacing) + 1)
    seen = surface.matte[top:bottom, left:right] > MIN_COVERAGE
    middle_rows, middle_columns = (
        ((nodes[1:] + nodes[:-1]) / 2 - start).astype(int) for nodes, start in ((y, top), (x, left))
    )
    cells = seen[middle_rows[:, None], middle_columns]  # cells may be smaller than pixels
    rows, columns = np.nonzero(seen)
    of_row = ((np.arange(bottom - top) + 0.5) / (bottom - top) * (len(y) - 1)).astype(int)
    of_column = ((np.arange(right - left) + 0.5) / (right - left) * (len(x) - 1)).astype(int)
    cells[of_row[rows], of_column[columns]] = True
    depth, normals, known = _sampled(surface, x, y)
    cells &= known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
    return _Grid(x, y, cells, depth, normals)


def _sampled(
    surface: PersonSurface, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth (m, n), normals (m, n, 3) and whether they are known (m, n) at nodes of the plate.

    Between four pixels of the canvas the values are interpolated, unless depth jumps there: then they are the
    nearest pixel's.
    """
    framing, (height, width) = surface.framing, surface.depth.shape
    column = (x - framing.centre[0]) * framing.scale + width / 2 - 0.5
    row = (y - framing.centre[1]) * framing.scale + height / 2 - 0.5
    column, row = column.clip(0, width - 1), row.clip(0, height - 1)
    first_column = np.floor(column).astype(int).clip(0, width - 2)
    first_row = np.floor(row).astype(int).clip(0, height - 2)
    across, down = column - first_column, (row - first_row)[:, None]
    weights = [(1 - down) * (1 - across), (1 - down) * across, down * (1 - across), down * across]
    corners = [
        (first_row[:, None] + below, first_column[None] + beside) for below in (0, 1) for beside in (0, 1)
    ]
    depths = np.stack([surface.depth[corner] for corner in corners])
    there = np.stack([surface.known[corner] for corner in corners])
    shares = np.stack(weights) * there
    nearest = np.argmax(shares, axis=0)
    jumps = np.where(there, depths, -np.inf).max(axis=0) - np.where(there, depths, np.inf).min(axis=0) > JUMP
    shares = np.where(jumps, np.arange(4)[:, None, None] == nearest, shares)
    total = shares.sum(axis=0)
    shares = shares / np.maximum(total, 1e-9)
    depth = (shares * depths).sum(axis=0)
    normals = sum(
        share[..., None] * surface.normals[corner] for share, corner in zip(shares, corners, strict=True)
    )
    normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True).clip(1e-9)
    return depth, normals, total > 0


def _shell(surface: PersonSurface, grid: _Grid, box: tuple[int, int, int, int]) -> Mesh:
    """Return the closed mesh over a grid."""
    top, left, bottom, right = box
    node, depth, faces = _front(grid)
    rows, columns = np.divmod(node, len(grid.x))
    x, y = grid.x[columns], grid.y[rows]
    outline = _outline(surface.matte, grid)
    back_x, back_y, back_depth = _ended(outline, grid, node, x, y, depth)
    edge = _edge(outline, grid, surface.camera.metres_per_pixel).ravel()[node]
    away = np.maximum(thickness(edge), THINNEST)
    pixel = surface.camera.metres_per_pixel * (grid.x[-1] - grid.x[0]) / (len(grid.x) - 1)
    away = np.maximum(_smoothed(back_depth + away, edge, faces, pixel) - back_depth, THINNEST)
    front = _positions(surface.camera, x, y, depth)
    rim = _positions(surface.camera, back_x, back_y, back_depth)
    eye = np.array(surface.camera.eye)
    rays = (rim - eye) / np.linalg.norm(rim - eye, axis=1, keepdims=True)
    seen = rim[outline.inside.ravel()[node] | (back_x != x) | (back_y != y)]
    lowest = float((seen if len(seen) else front)[:, 1].min()) - INSET * surface.camera.metres_per_pixel
    points = _above(lowest, np.concatenate([front, rim + rays * away[:, None]]), eye).astype(np.float32)
    everything = np.concatenate([faces, faces[:, ::-1] + len(front), _walls(faces, len(front))])
    behind = _vertex_normals(points, everything)[len(front) :]
    across, down = np.concatenate([x, back_x]), np.concatenate([y, back_y])
    uv = np.stack([(across - left) / (right - left), (bottom - down) / (bottom - top)], axis=1)
    return Mesh(
        points,
        np.concatenate([grid.normals[rows, columns], behind]).astype(np.float32),
        uv.astype(np.float32).clip(0, 1),
        everything.astype(np.int32),
        box,
        lowest,
    )


def _positions(camera: Camera, x: np.ndarray, y: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Return positions (V, 3) in metres of points of the plate (V,) and their depths (V,)."""
    return camera.positions(torch.from_numpy(x), torch.from_numpy(y), torch.from_numpy(depth)).numpy().T


def _outline(matte: np.ndarray, grid: _Grid) -> _Outline:
    """Return where the person ends on the lines of a grid."""

    def covered(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return map_coordinates(matte, [y - 0.5, x - 0.5], order=1, mode="nearest") > CUTOFF

    across, down = np.meshgrid(grid.x, grid.y)
    inside = covered(across, down)
    node = np.arange(inside.size).reshape(inside.shape)
    first = np.concatenate([node[:, :-1].ravel(), node[:-1].ravel()])
    second = np.concatenate([node[:, 1:].ravel(), node[1:].ravel()])
    crossed = inside.ravel()[first] != inside.ravel()[second]
    first, second = first[crossed], second[crossed]
    inner = np.where(inside.ravel()[first], first, second)
    start = np.stack([across.ravel()[inner], down.ravel()[inner]])
    outer = first + second - inner
    way = np.stack([across.ravel()[outer], down.ravel()[outer]]) - start
    share = np.zeros(len(inner))
    for step in 0.5 ** np.arange(1, BISECTIONS + 1):
        share += np.where(covered(*(start + way * (share + step))), step, 0.0)
    share = (share - INSET / np.linalg.norm(way, axis=0)).clip(0)
    x, y = start + way * share
    return _Outline(inside, x, y, inner, share)


def _ended(
    outline: _Outline, grid: _Grid, node: np.ndarray, x: np.ndarray, y: np.ndarray, depth: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y and depth (V,) of the vertices where those just outside the outline are moved onto it.

    There they have the depth of the front, which lies between that of the nodes inside and outside.
    """
    beside = binary_dilation(outline.inside, np.ones((3, 3))) & ~outline.inside
    moved = np.flatnonzero(beside.ravel()[node])
    x, y, depth = x.copy(), y.copy(), depth.copy()
    if len(moved):
        tree = cKDTree(np.stack([outline.x, outline.y], axis=1))
        nearest = tree.query(np.stack([x[moved], y[moved]], axis=1))[1]
        x[moved], y[moved] = outline.x[nearest], outline.y[nearest]
        rise = grid.depth.ravel()[outline.inner[nearest]] - depth[moved]
        depth[moved] += np.where(abs(rise) > JUMP, 0, rise * (1 - outline.share[nearest]))
    return x, y, depth


def _edge(outline: _Outline, grid: _Grid, pixel: float) -> np.ndarray:
    """Return the metres (m, n) from each node inside to the outline, of pixels of `pixel` metres; else 0."""
    inside = outline.inside.copy()
    inside[[0, -1]], inside[:, [0, -1]] = False, False
    ends = outline.inside & ~inside  # the frame of the plate cuts the person
    across, down = np.meshgrid(grid.x, grid.y)
    edge = np.zeros(inside.shape)
    points = np.concatenate(
        [np.stack([outline.x, outline.y], axis=1), np.stack([across[ends], down[ends]], axis=1)]
    )
    if inside.any():
        edge[inside] = cKDTree(points).query(np.stack([across[inside], down[inside]], axis=1))[0] * pixel
    return edge


def _smoothed(depth: np.ndarray, edge: np.ndarray, faces: np.ndarray, spacing: float) -> np.ndarray:
    """Return the depth (V,) of the back, smooth but for a third of SMOOTH along the outline.

    Folds of the front and bends of the outline would go through to the back, which looks ragged where it is
    seen beside the front. `edge`: (V,) metres to the outline. `spacing`: metres between vertices.
    """
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    ends = np.concatenate([ends, ends[:, ::-1], np.arange(len(depth))[:, None].repeat(2, axis=1)])
    near = csr_array((np.ones(len(ends)), ends.T), shape=(len(depth),) * 2)
    total, smooth = near.sum(axis=1), depth
    for _ in range(round((SMOOTH / spacing) ** 2 / STEP)):
        smooth = near @ smooth / total
    share = (3 * edge / SMOOTH).clip(0, 1)
    return depth + (smooth - depth) * share * share * (3 - 2 * share)


def _above(lowest: float, points: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Return points (V, 3) of which those below the ground are moved to it, along the camera's rays."""
    if eye[1] <= lowest:
        return points
    share = (eye[1] - lowest) / np.maximum(eye[1] - points[:, 1], eye[1] - lowest)
    return eye + (points - eye) * share[:, None]


def _front(grid: _Grid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the front sheet: the node (V,) and depth (V,) of each vertex, and triangles (F, 3).

    A cell over which depth jumps belongs to the far sheet. Its near nodes have a second vertex there, at the
    depth of the far ones.
    """
    width = len(grid.x)
    row, column = np.nonzero(grid.cells)
    first = row * width + column
    corners = np.stack([first, first + width, first + width + 1, first + 1], axis=1)  # counter-clockwise
    own = grid.depth.ravel()
    depths = own[corners]
    farthest = depths.max(axis=1, keepdims=True)
    near = depths < farthest - JUMP
    away = np.where(near, 0, depths).sum(axis=1) / (~near).sum(axis=1)
    cells, corner = np.nonzero(near)
    beneath = corners[cells, corner]
    sums = np.bincount(beneath, away[cells], len(own))
    counts = np.bincount(beneath, minlength=len(own))
    second = np.divide(sums, counts, out=np.zeros(len(own)), where=counts > 0)
    corners = corners + len(own) * near
    faces = _halved(corners, np.concatenate([own, second]))
    used, faces = np.unique(faces, return_inverse=True)
    return used % len(own), np.concatenate([own, second])[used], faces.reshape(-1, 3)


def _halved(corners: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Divide cells (C, 4) into triangles (2 C, 3) along the diagonal with the smaller change of depth."""
    values = depth[corners]
    along = np.abs(values[:, 0] - values[:, 2]) <= np.abs(values[:, 1] - values[:, 3])
    a, b, c, d = corners.T
    one = np.where(along, [a, b, c], [a, b, d]).T
    two = np.where(along, [a, c, d], [b, c, d]).T
    return np.concatenate([one, two])


def _walls(faces: np.ndarray, count: int) -> np.ndarray:
    """Return triangles that join the boundaries of the front and back sheets of `count` vertices each."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    code, other = edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]
    start, end = edges[~np.isin(code, other)].T
    down = np.stack([start, start + count, end + count], axis=1)
    up = np.stack([start, end + count, end], axis=1)
    return np.concatenate([down, up])


def _vertex_normals(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals (V, 3): the mean of the faces around a vertex, weighted by their areas."""
    a, b, c = (points[faces[:, corner]].astype(np.float64) for corner in range(3))
    normals = np.cross(b - a, c - a)
    sums = np.stack(
        [
            sum(np.bincount(faces[:, corner], normals[:, axis], len(points)) for corner in range(3))
            for axis in range(3)
        ],
        axis=1,
    )
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.divide(sums, lengths, out=np.tile([0.0, 0.0, -1.0], (len(sums), 1)), where=lengths > 1e-30)
