"""Lights of a USD stage as ours: UsdLux, brought into the camera's frame."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from relight.lights.files import MOST_LIGHTS
from relight.lights.light import Light, Settings
from relight.lights.moving import FILES, MovingLight
from relight.scene.camera_view import CameraView
from relight.scene.usd import old_names
from relight.scene.usd.light_converter import Found, LightConverter
from relight.scene.usd.stage import first_line, open_stage
from relight.scene.usd.view import StageView
from shadow.files import AnyPath

if TYPE_CHECKING:
    from pxr import Usd

MOST_FRAMES = 10_000
REASON = 200  # characters of what USD says of a bad value
ORIENTATION = ("image", "rotation")  # of an environment: one that is not upright turns its image


class Rig(NamedTuple):
    """What a stage says of the light, and of the camera that sees the person in it."""

    lights: list[Light | MovingLight]
    camera: str | None = None  # the camera's path or name
    view: CameraView | None = None  # what it sees


def read_rig(
    path: AnyPath,
    camera: str | None = None,
    subject_at: str | Iterable[float] | None = None,
    *,
    allow_external: bool = False,
) -> Rig:
    """Read the lights of a USD stage into a camera's frame; see `relight.read_lights`.

    `camera` is the path of the one that took the plate. Where the stage has none, its own axes are taken for
    the camera's, and its origin for the subject's middle. `allow_external`: as in `open_stage`, whose errors
    it raises. Raises ValueError for no lights or too many, and an unknown camera or prim. Warns of what our
    lights cannot represent, with the path of its prim.
    """
    stage = open_stage(path, allow_external=allow_external)
    from pxr import Tf

    try:
        view = StageView(Path(path), stage, camera, subject_at)
        return _Reader(view, allow_external).rig()
    except Tf.ErrorException as error:
        raise ValueError(f"{path}: is damaged: {first_line(error)}") from error


class _Reader:
    def __init__(self, view: StageView, external: bool) -> None:
        self.view, self.path = view, view.path
        self.convert = LightConverter(view, external)

    def rig(self) -> Rig:
        lights = []
        prims = [prim for prim in self.view.prims() if self._is_light(prim)]
        if len(prims) > MOST_LIGHTS:
            raise ValueError(f"{self.path}: holds {len(prims)} lights; expected at most {MOST_LIGHTS}")
        for prim in prims:
            old_names.honour(prim)
            light = self._light(prim)
            if light is not None:
                lights.append((prim, light))
        if not lights:
            kinds = sorted({str(prim.GetTypeName()) for prim in self.view.prims() if prim.GetTypeName()})
            raise ValueError(
                f"{self.path}: holds no light that shines; found {', '.join(kinds[:8]) or 'nothing'}"
            )
        if self.view.camera is None:
            return Rig(self._named(lights))
        return Rig(self._named(lights), str(self.view.camera.GetPath()), self._camera_view())

    def _camera_view(self) -> CameraView | None:
        """Return the angles of view of the camera's film back, and how it is fitted to a picture."""
        from pxr import Usd, UsdGeom

        seen = UsdGeom.Camera(self.view.camera).GetCamera(Usd.TimeCode.EarliestTime())
        if seen.projection != seen.Perspective:
            self.convert.cannot(self.view.camera, "is an orthographic camera; its angle of view is not used")
            return None
        if seen.horizontalApertureOffset or seen.verticalApertureOffset:
            self.convert.cannot(
                self.view.camera, "has a shifted film back; its angle of view is used, the shift is not"
            )
        lens = 2 * seen.focalLength
        if not (lens > 0 and seen.horizontalAperture > 0 and seen.verticalAperture > 0):
            self.convert.cannot(
                self.view.camera, "has no film back or focal length; its angle of view is not used"
            )
            return None
        return CameraView(seen.horizontalAperture / lens, seen.verticalAperture / lens, self.view.fit())

    def _is_light(self, prim: Usd.Prim) -> bool:
        from pxr import UsdGeom, UsdLux

        if prim.IsA(UsdLux.PortalLight):
            self.convert.cannot(prim, "a portal guides a renderer's samples; it is left out")
            return False
        if not prim.HasAPI(UsdLux.LightAPI):
            return False
        above = prim.GetParent()
        while above and not above.IsPseudoRoot():
            if above.IsA(UsdGeom.PointInstancer):
                self.convert.cannot(prim, "copies of a point instancer are not read; the light is left out")
                return False
            above = above.GetParent()
        return True

    def _light(self, prim: Usd.Prim) -> Light | MovingLight | None:
        """Convert one light, still or moving; None if it is hidden, or we have no such light."""
        kind = self.convert.kind(prim)
        if kind is None:
            return None
        self.convert.check_extras(prim)
        frames = self._frames(prim)
        try:
            samples = [kind(prim, time) for time in frames]
        except (TypeError, ValueError) as error:
            if str(self.path) in str(error):
                raise
            what = "holds a value of another type than the schema's"
            reason = shorten(str(error), REASON)  # a bad value may be an array of thousands
            raise ValueError(f"{self.path}: {prim.GetPath()}: {what}: {reason}") from error
        if not any(settings["intensity"] > 0 for _, settings in samples):
            return None
        if _changes_image(samples):
            self.convert.cannot(prim, "changes its texture in time; the first one is used")
        elif _tilts(samples):
            self.convert.cannot(
                prim,
                "tilts against the camera, or changes its texture, in time; it stays as in its first frame",
            )
            samples = _untilted(samples)
        try:
            return _assembled(samples, frames)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{self.path}: {prim.GetPath()}: {error}") from error

    def _frames(self, prim: Usd.Prim) -> list[float]:
        """Return the times at which a light is sampled: one, or every whole frame of a moving light."""
        from pxr import UsdGeom

        times: set[float] = set()
        for start in filter(
            None, (prim, self.view.camera, None if isinstance(self.view.mark, np.ndarray) else self.view.mark)
        ):
            attributes = list(start.GetAttributes()) if start == prim else []
            if start == self.view.camera and self.view.mark is None:
                attributes.append(UsdGeom.Camera(start).GetFocusDistanceAttr())
            above = start
            while above and not above.IsPseudoRoot():
                if xform := UsdGeom.Xformable(above):
                    times.update(xform.GetTimeSamples())
                    attributes.append(UsdGeom.Imageable(above).GetVisibilityAttr())
                above = above.GetParent()
            for attribute in attributes:
                times.update(attribute.GetTimeSamples())
        if len(times) < 2:
            return sorted(times) or [0.0]
        first, last = math.floor(min(times)), math.ceil(max(times))
        if last - first > MOST_FRAMES or not math.isfinite(last - first):
            raise ValueError(
                f"{self.path}: {prim.GetPath()}: has time samples from {first} to {last}; expected at most "
                f"{MOST_FRAMES} frames"
            )
        return sorted(times | set(map(float, range(first, last + 1))))

    def _named(self, lights: list[tuple[Usd.Prim, Light | MovingLight]]) -> list[Light | MovingLight]:
        """Return the lights with names: their display names, or those of their prims."""
        taken: set[str] = set()
        named = []
        for prim, light in lights:
            name = prim.GetDisplayName() or prim.GetName()
            above = prim.GetParent()
            while name in taken:
                name = f"{above.GetName()}_{name}"
                above = above.GetParent() if above.GetParent() else above
            taken.add(name)
            named.append(renamed(light, name))
        return named


def renamed(light: Light | MovingLight, name: str) -> Light | MovingLight:
    """Return the same light under another name."""
    if isinstance(light, MovingLight):
        return MovingLight(light.kind, orbit=light.orbit, **light.rests | light.moves | {"name": name})
    return dataclasses.replace(light, name=name)


def _changes_image(found: list[Found]) -> bool:
    """Return whether an environment is upright to the camera in all frames, and not of one image."""
    return all("rotation" in settings for _, settings in found) and not _has_one_image(found)


def _tilts(found: list[Found]) -> bool:
    """Return whether an environment is not upright to the camera in the same way in all frames."""
    upright = {"rotation" in settings for _, settings in found}
    return "image" in found[0][1] and (len(upright) > 1 or not _has_one_image(found))


def _has_one_image(found: list[Found]) -> bool:
    images = [settings.get("image") for _, settings in found]
    return all(
        each is images[0] or np.array_equal(np.asarray(each), np.asarray(images[0])) for each in images
    )


def _untilted(found: list[Found]) -> list[Found]:
    """Return the settings of an environment with the orientation of the first frame."""
    first = {key: value for key, value in found[0][1].items() if key in ORIENTATION}
    return [
        (kind, {key: value for key, value in settings.items() if key not in ORIENTATION} | first)
        for kind, settings in found
    ]


def _assembled(found: list[Found], frames: list[float]) -> Light | MovingLight:
    """Return one light from its settings at some frames."""
    kind, first = found[0]
    if len(frames) == 1:
        return kind(**first)
    every = [settings for _, settings in found]
    if any(settings.keys() != first.keys() for settings in every):
        raise ValueError("has a temperature in some frames only; expected one in all of them, or in none")
    moving: Settings = {}
    rests: Settings = {}
    for key in first:
        values = [settings[key] for settings in every]
        if key == "rotation":
            values = np.rad2deg(np.unwrap(np.deg2rad(values))).tolist()
        if key in FILES or all(np.allclose(value, values[0], rtol=1e-7, atol=1e-9) for value in values):
            rests[key] = values[0]
        else:
            moving[key] = dict(zip(frames, values, strict=True))
    return MovingLight(kind, **rests | moving) if moving else kind(**rests)
