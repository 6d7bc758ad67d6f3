"""What cloth spans instead of following it: the cleft of the seat, the creases of bent joints, the gap
between two legs. Cloth that enters them is wedged between surfaces that both push it."""

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.linalg import spsolve

from shadow.lightstage.figure import vertex_normals
from shadow.lightstage.people.anatomy import Person
from shadow.lightstage.people.cloth import edges_of

ROUNDS = 16  # of filling creases: about 3 cm on the tights' mesh
FOLDS = 32  # the same on a garment, whose mesh is finer
LAP_ROWS, LAP_COLUMNS = 14, 9
LAP = 0.0, -0.3  # metres from the crotch between which a lap hangs


def seat(person: Person) -> csr_matrix:
    """The operator (V, V) over the tights that fills the cleft of the seat with a soap film from its rim."""
    points, faces = person.tights_rest, person.base.tights.faces
    x, y, z = points.T
    hip = person.skeleton.head("upperleg01.L")[1]
    lowest = crotch(person)
    hollow = (np.abs(x) < 0.04) & (y > lowest[1] - 0.01) & (y < hip + 0.1) & (z < lowest[2])
    graph = _graph(faces, len(points))
    laplacian = (diags(np.asarray(graph.sum(axis=1)).ravel()) - graph).tocsr()
    inside, rim = np.flatnonzero(hollow), np.flatnonzero(~hollow)
    film = csr_matrix(spsolve(laplacian[inside][:, inside].tocsc(), -laplacian[inside][:, rim].tocsc()))
    # A film over what is convex would cut it off.
    filled = np.zeros(len(points), bool)
    outwards = (film @ points[rim] - points[inside]) * person.tights_normals[inside]
    filled[inside] = outwards.sum(axis=1) > 0
    whole, film = diags((~filled).astype(float)).tocoo(), (diags(filled[inside].astype(float)) @ film).tocoo()
    rows = np.concatenate([whole.row, inside[film.row]])
    columns = np.concatenate([whole.col, rim[film.col]])
    return coo_matrix((np.concatenate([whole.data, film.data]), (rows, columns)), whole.shape).tocsr()


def crotch(person: Person) -> np.ndarray:
    """The lowest point (3,) of the tights on the middle line, at rest."""
    rest = person.tights_rest
    middle = rest[(np.abs(rest[:, 0]) < 0.01) & (rest[:, 1] < person.skeleton.head("upperleg01.L")[1])]
    return middle[np.argmin(middle[:, 1])]


class Creases:
    """Fills what bending folds into a surface: vertices move outwards, never inwards, to the mean of their
    neighbours."""

    def __init__(self, faces: np.ndarray, count: int) -> None:
        self.faces = faces
        graph = _graph(faces, count)
        self.mean = diags(1 / np.maximum(np.asarray(graph.sum(axis=1)).ravel(), 1)) @ graph

    def filled(self, points: np.ndarray, rounds: int = ROUNDS) -> np.ndarray:
        """points (V, 3), in any pose."""
        for step in range(rounds):
            if step % (rounds // 2) == 0:
                normals = vertex_normals(points, self.faces)
            outwards = ((self.mean @ points - points) * normals).sum(axis=1)
            points = points + normals * np.maximum(outwards, 0)[:, None]
        return points


def lap(person: Person) -> tuple[csr_matrix, np.ndarray]:
    """Two sheets that hang between the legs, one at the front and one at the back: the operator (P, V) over
    the tights, and faces. They sag the more the lower they are: a skirt can fold in between the knees."""
    x, y, z = person.tights_rest.T
    arms = person.tights_member[:, 1:3].sum(axis=1) > 0.1
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
        # Columns run to the person's left, so that seen from the front this winding is counter-clockwise.
        both = np.concatenate([np.stack([a, c, d], 1), np.stack([a, d, b], 1)])
        faces.append(both if facing > 0 else both[:, ::-1])
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return csr_matrix(entries, (2 * LAP_ROWS * LAP_COLUMNS, len(x))), np.concatenate(faces)


def _graph(faces: np.ndarray, count: int) -> csr_matrix:
    """Which vertices (V, V) share an edge."""
    edges, _, _ = edges_of(faces)
    both = np.concatenate([edges, edges[:, ::-1]])
    return csr_matrix((np.ones(len(both)), (both[:, 0], both[:, 1])), (count, count))
