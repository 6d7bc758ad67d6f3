"""Fill concavities that cloth spans: the cleft of the seat, creases of bent joints, the gap between the legs.

Cloth that enters them would be wedged between two surfaces that both push it.
"""

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.linalg import spsolve

from shadow.lightstage.figure import vertex_normals
from shadow.lightstage.mesh import adjacency
from shadow.lightstage.people.body.anatomy import Person

BODY_ROUNDS = 16  # iterations of filling, which reach about 3 cm on the mesh of the tights
GARMENT_ROUNDS = 32  # the same on a garment, whose mesh is finer
LAP_ROWS, LAP_COLUMNS = 14, 9
LAP = 0.0, -0.3  # metres from the crotch to the top and to the bottom of a lap


def seat_film(person: Person) -> csr_matrix:
    """Return the operator (V, V) over the tights that fills the cleft of the seat by a minimal surface."""
    points, faces = person.tights_rest, person.base.tights.faces
    x, y, z = points.T
    hip = person.skeleton.head("upperleg01.L")[1]
    lowest = crotch(person)
    hollow = (np.abs(x) < 0.04) & (y > lowest[1] - 0.01) & (y < hip + 0.1) & (z < lowest[2])
    graph = adjacency(faces, len(points))
    laplacian = (diags(np.asarray(graph.sum(axis=1)).ravel()) - graph).tocsr()
    inside, rim = np.flatnonzero(hollow), np.flatnonzero(~hollow)
    film = csr_matrix(spsolve(laplacian[inside][:, inside].tocsc(), -laplacian[inside][:, rim].tocsc()))
    # Fill only where that moves the surface outward.
    filled = np.zeros(len(points), bool)
    outwards = (film @ points[rim] - points[inside]) * person.tights_normals[inside]
    filled[inside] = outwards.sum(axis=1) > 0
    whole, film = diags((~filled).astype(float)).tocoo(), (diags(filled[inside].astype(float)) @ film).tocoo()
    rows = np.concatenate([whole.row, inside[film.row]])
    columns = np.concatenate([whole.col, rim[film.col]])
    return coo_matrix((np.concatenate([whole.data, film.data]), (rows, columns)), whole.shape).tocsr()


def crotch(person: Person) -> np.ndarray:
    """Return the lowest point (3,) of the tights in the median plane, at rest."""
    rest = person.tights_rest
    middle = rest[(np.abs(rest[:, 0]) < 0.01) & (rest[:, 1] < person.skeleton.head("upperleg01.L")[1])]
    return middle[np.argmin(middle[:, 1])]


class CreaseFilling:
    """Fills creases of a bent surface: vertices only move outward, to the mean of their neighbours."""

    def __init__(self, faces: np.ndarray, count: int) -> None:
        self.faces = faces
        graph = adjacency(faces, count)
        self.mean = diags(1 / np.maximum(np.asarray(graph.sum(axis=1)).ravel(), 1)) @ graph

    def filled(self, points: np.ndarray, rounds: int = BODY_ROUNDS) -> np.ndarray:
        """Return points (V, 3), in any pose, with the creases filled."""
        for step in range(rounds):
            if step % (rounds // 2) == 0:
                normals = vertex_normals(points, self.faces)
            outwards = ((self.mean @ points - points) * normals).sum(axis=1)
            points = points + normals * np.maximum(outwards, 0)[:, None]
        return points


def lap_sheets(person: Person) -> tuple[csr_matrix, np.ndarray]:
    """Return two sheets between the legs, at the front and at the back: an operator (P, V) and faces.

    The operator is over the vertices of the tights. The sheets sag more the lower they are, so that a skirt
    can fold in between the knees.
    """
    x, y, z = person.tights_rest.T
    arms = person.tights_regions[:, 1:3].sum(axis=1) > 0.1
    low = crotch(person)[1]
    share = np.linspace(0, 1, LAP_COLUMNS)
    bulge = 4 * share * (1 - share)
    rows, columns, values, faces = [], [], [], []
    for sheet, facing in enumerate((1, -1)):
        for row, height in enumerate(np.linspace(low + LAP[0], low + LAP[1], LAP_ROWS)):
            near = ~arms & (np.abs(y - height) < 0.02)
            crest = {}
            for side in (1, -1):
                for way in (1, -1):
                    score = np.where(near & (side * x > 0), way * z - 0.15 * np.abs(x), -np.inf)
                    crest[side, way] = int(np.argmax(score))
            sag = (0.1 + 0.6 * row / (LAP_ROWS - 1)) * bulge
            ends = ((1, share), (-1, 1 - share))
            for side, part in ends:
                for way in (1, -1):
                    weight = part * np.where(way == facing, 1 - sag / 2, sag / 2)
                    rows.append((sheet * LAP_ROWS + row) * LAP_COLUMNS + np.arange(LAP_COLUMNS))
                    columns.append(np.full(LAP_COLUMNS, crest[side, way]))
                    values.append(weight)
        first = sheet * LAP_ROWS * LAP_COLUMNS
        grid = first + np.arange(LAP_ROWS * LAP_COLUMNS).reshape(LAP_ROWS, LAP_COLUMNS)
        a, b, c, d = (q.ravel() for q in (grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]))
        # Columns run to the person's left, so this winding is counter-clockwise seen from the front.
        both = np.concatenate([np.stack([a, c, d], 1), np.stack([a, d, b], 1)])
        faces.append(both if facing > 0 else both[:, ::-1])
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return csr_matrix(entries, (2 * LAP_ROWS * LAP_COLUMNS, len(x))), np.concatenate(faces)
