"""How a USD stage stands before the plate's camera: transforms, the camera, the subject's place."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from relight.scene.camera_view import EXPAND, choose_camera, subject_point

if TYPE_CHECKING:
    from pxr import Usd


@dataclass(frozen=True)
class CameraFrame:
    """The camera's frame at one time: world positions to metres from the subject's middle."""

    axes: np.ndarray  # (3, 3): world directions to the camera's
    origin: np.ndarray  # (3,) in the world, stage units: the subject's middle
    scale: float  # metres a stage unit

    def position(self, world: np.ndarray) -> tuple[float, ...]:
        return tuple((self.axes @ (world - self.origin) * self.scale).tolist())

    def direction(self, world: np.ndarray) -> tuple[float, ...]:
        return tuple((self.axes @ world).tolist())


class StageView:
    """A stage, its units, and the camera's frame in it at any time."""

    def __init__(
        self, path: Path, stage: Usd.Stage, camera: str | None, subject_at: str | Iterable[float] | None
    ) -> None:
        from pxr import UsdGeom

        self.path, self.stage = path, stage
        self.scale = float(UsdGeom.GetStageMetersPerUnit(stage))
        self.z_up = UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z
        cameras = [(str(prim.GetPath()), prim) for prim in self.prims() if prim.IsA(UsdGeom.Camera)]
        self.camera: Usd.Prim = choose_camera(path, cameras, camera)
        self.mark = self._mark(subject_at)

    def prims(self) -> Iterable[Usd.Prim]:
        """Yield the prims of the stage, those of instances included."""
        from pxr import Usd

        return self.stage.Traverse(Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate))

    def _mark(self, subject_at: str | Iterable[float] | None) -> Usd.Prim:
        """Return the subject's position: a prim, a point (3,) of the stage, or None."""
        from pxr import Sdf

        if subject_at is None:
            return None
        if isinstance(subject_at, str):
            prim = self.stage.GetPrimAtPath(subject_at) if Sdf.Path.IsValidPathString(subject_at) else None
            if not prim:
                raise ValueError(f"{self.path}: has no prim {subject_at}, where the subject was to be")
            return prim
        return subject_point(subject_at)

    def fit(self) -> str:
        """Return how the stage's render settings fit the film back to a picture."""
        from pxr import UsdRender

        settings = UsdRender.Settings.GetStageRenderSettings(self.stage)
        policy = settings.GetAspectRatioConformPolicyAttr().Get() if settings else None
        return str(policy or EXPAND)

    def at(self, time: float) -> CameraFrame:
        """Return the camera's frame at a time."""
        from pxr import UsdGeom

        axes = np.eye(3)
        if self.camera is None:
            if self.z_up:
                axes = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
            origin = np.zeros(3)
        else:
            world = self.matrix(self.camera, time)
            axes = rotation(world).T
            distance = UsdGeom.Camera(self.camera).GetFocusDistanceAttr().Get(time) or 0.0
            if self.mark is None and distance <= 0:
                raise ValueError(
                    f"{self.path}: {self.camera.GetPath()} has no focus distance; say where the subject is "
                    "(subject_at=X/Y/Z)"
                )
            origin = world[:3, 3] - axes[2] * distance
        if isinstance(self.mark, np.ndarray):
            origin = self.mark
        elif self.mark is not None:
            origin = self.matrix(self.mark, time)[:3, 3]
        return CameraFrame(axes, origin, self.scale)

    def matrix(self, prim: Usd.Prim, time: float) -> np.ndarray:
        """Return the transform (4, 4) of a prim to the world, for column vectors."""
        from pxr import UsdGeom

        matrix = np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(prim)).T
        if not np.isfinite(matrix).all():
            raise ValueError(f"{self.path}: {prim.GetPath()}: has a transform that is not finite")
        return matrix


def rotation(matrix: np.ndarray, mirrored: bool = False) -> np.ndarray:
    """Return the rotation (3, 3) closest to a transform, by polar decomposition.

    `mirrored`: a reflection stays; otherwise the axis x gives way.
    """
    left, _, right = np.linalg.svd(matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0).clip(1e-30))
    closest = left @ right
    if not mirrored and np.linalg.det(closest) < 0:
        closest[:, 0] *= -1
    return closest
