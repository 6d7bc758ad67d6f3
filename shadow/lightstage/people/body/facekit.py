"""Heads of ICT-FaceKit's light model: identities from light-stage scans, and expressions, over one mesh.

Li et al., "Learning Formation of Physically-Based Face Attributes", CVPR 2020 (github.com/ICT-VGL, MIT). The
model is one file, `ict.npz`: the mean head, 100 identity components of one standard deviation each, 55
expression shapes, and the texture coordinates. It has neither textures nor hair. The stage does not need it,
and it is not part of the package.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix

from shadow.lightstage.figure import normalize, vertex_normals
from shadow.lightstage.mesh import clip

FILE = "ict.npz"
METRES = 0.01  # of the file's unit
MOST = 2.5  # standard deviations of a component
SKIN = ("face", "head_neck", "mouth_socket", "eye_socket_left", "eye_socket_right")
MOUTH, EYES = ("gums_tongue", "teeth"), ("eyeball_left", "eyeball_right")
BELOW, TILT = 3.2, 22.0  # the cut through the neck: centimetres below the chin, degrees it rises to the nape
CHIN = 8  # of the 68 landmarks
# Expressions as ranges of the strengths of shapes, both sides of the face alike. One is drawn at a time.
MOODS: tuple[dict[str, tuple[float, float]], ...] = (
    {},
    {"mouthSmile": (0.3, 0.9), "cheekSquint": (0.1, 0.5)},
    {"mouthSmile": (0.2, 0.6), "jawOpen": (0.05, 0.25), "mouthUpperUp": (0.05, 0.3)},
    {"jawOpen": (0.1, 0.5), "mouthFunnel": (0, 0.3)},
    {"jawOpen": (0.2, 0.5), "browInnerUp": (0.3, 0.8), "browOuterUp": (0.2, 0.6), "eyeWide": (0.2, 0.6)},
    {"browDown": (0.3, 0.9), "noseSneer": (0.1, 0.4), "mouthPress": (0, 0.5)},
    {"mouthFrown": (0.3, 0.8), "browInnerUp": (0.2, 0.6)},
    {"mouthPucker": (0.3, 0.8)},
    {"cheekPuff": (0.2, 0.7), "mouthPress": (0, 0.4)},
    {"eyeSquint": (0.3, 0.8), "browDown": (0.1, 0.5)},
)
BLINK = 0.1  # share of heads with closed eyes


@dataclass(frozen=True)
class FaceKit:
    """The model. Lengths are centimetres, y up; the face looks to +z, the figure's left is +x."""

    neutral: np.ndarray  # (V, 3) the mean head
    identity: np.ndarray  # (100, V, 3)
    expression: dict[str, np.ndarray]  # {shape: (V, 3)}
    polygons: dict[str, np.ndarray]  # {part: (P, 4, 2)} vertices and texture coordinates of the corners
    uv: np.ndarray  # (T, 2)
    landmarks: np.ndarray  # (68,) vertices

    def head(self, rng: np.random.Generator, shape_rng: np.random.Generator) -> "Head":
        """Draw a head: `shape_rng` draws who it is, `rng` the expression."""
        weights = np.clip(shape_rng.normal(size=len(self.identity)), -MOST, MOST)
        rest = self.neutral + np.tensordot(weights.astype(np.float32), self.identity, 1)
        moved = sum(
            (strength * self.expression[name] for name, strength in self._mood(rng).items()),
            np.zeros_like(rest),
        )
        return Head(self, rest.astype(float), (rest + moved).astype(float))

    def _mood(self, rng: np.random.Generator) -> dict[str, float]:
        strengths: dict[str, float] = {}
        for name, (low, high) in MOODS[rng.integers(len(MOODS))].items():
            both = rng.uniform(low, high)
            if name in self.expression:
                strengths[name] = both
            else:  # faces are slightly asymmetric
                strengths |= {f"{name}_{side}": both * rng.uniform(0.8, 1) for side in "LR"}
        if rng.random() < BLINK:
            strengths |= {f"eyeBlink_{side}": 1.0 for side in "LR"}
        else:
            glance = float(np.clip(rng.normal(0, 0.35), -0.8, 0.8))
            sides = ("Out_L", "In_R") if glance > 0 else ("In_L", "Out_R")
            strengths |= {f"eyeLook{side}": abs(glance) for side in sides}
        return strengths


@dataclass(frozen=True)
class Mesh:
    """Some parts of a head, cut at the neck. There are V vertices and F faces."""

    points: np.ndarray  # (V, 3) with the expression
    rest: np.ndarray  # (V, 3) without it
    mean: np.ndarray  # (V, 3) the same places on the mean head, on which colours are painted
    normals: np.ndarray  # (V, 3) unit, those of `points`
    faces: np.ndarray  # (F, 3)
    uv: np.ndarray  # (F, 3, 2)


@dataclass(frozen=True)
class Head:
    """One head, in centimetres. rest, points: (V, 3) without and with its expression."""

    model: FaceKit
    rest: np.ndarray
    points: np.ndarray

    @property
    def eyes(self) -> np.ndarray:
        """The middle (3,) between the eyeballs."""
        return np.mean(
            [self.rest[np.unique(self.model.polygons[eye][..., 0])].mean(0) for eye in EYES], axis=0
        )

    @property
    def chin(self) -> np.ndarray:
        """The lowest landmark (3,) of the chin, without the expression."""
        return self.rest[self.model.landmarks[CHIN]]

    @property
    def crown(self) -> float:
        """Height of the highest point."""
        return float(self.rest[:, 1].max())

    def above_neck(self, points: np.ndarray, below: float = BELOW) -> np.ndarray:
        """Return how far (N,) points (N, 3) lie above the cut through the neck, in centimetres.

        The cut begins `below` centimetres under the chin at the throat, and rises to the nape.
        """
        tilt = np.radians(TILT)
        throat = self.chin + [0, -below, -4.5]
        return (points - throat) @ np.array([0, np.cos(tilt), np.sin(tilt)])

    def mesh(self, parts: tuple[str, ...], below: float | None = BELOW) -> Mesh:
        """Return some parts as a mesh, without what is below the cut of `above_neck`; None keeps all."""
        quads = np.concatenate([self.model.polygons[name] for name in parts])
        corners = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        corners = corners[corners[:, 1, 0] != corners[:, 2, 0]]  # a triangle repeats its last corner
        corners = corners[corners[:, 0, 0] != corners[:, 2, 0]]
        pairs, faces = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
        vertex, faces = pairs[:, 0], faces.reshape(-1, 3)
        normals = vertex_normals(self.points, corners[..., 0])[vertex]
        columns = np.hstack([self.points[vertex], self.rest[vertex], self.model.neutral[vertex], normals])
        columns = np.hstack([columns, self.model.uv[pairs[:, 1]]])
        if below is not None:
            faces, operator = clip(faces, self.above_neck(self.rest[vertex], below))
            columns = csr_matrix(operator) @ columns
        points, rest, mean, normals, uv = np.split(columns, [3, 6, 9, 12], axis=1)
        return Mesh(points, rest, mean, normalize(normals), faces, uv[faces])


@lru_cache(maxsize=1)
def load(folder: Path) -> FaceKit:
    """Read the model from a folder. Raises ValueError if it is not there."""
    path = folder / FILE
    if not path.is_file():
        raise ValueError(f"heads: expected {FILE} of ICT-FaceKit in {folder}")
    with np.load(path, allow_pickle=False) as arrays:
        both = np.stack([arrays["quads"], arrays["quads_uv"]], axis=-1).astype(int)
        ranges = dict(zip(arrays["part_names"].tolist(), arrays["part_ranges"], strict=True))
        return FaceKit(
            arrays["neutral"],
            arrays["identity"].astype(np.float32),
            dict(
                zip(arrays["expression_names"].tolist(), arrays["expression"].astype(np.float32), strict=True)
            ),
            {name: both[first:last] for name, (_, _, first, last) in ranges.items()},
            arrays["uv"],
            arrays["landmarks68"],
        )
