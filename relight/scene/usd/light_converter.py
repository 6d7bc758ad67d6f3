"""One UsdLux light at one time, as the settings of one of ours."""

from __future__ import annotations

import math
import os
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from relight.lights.directional import DirectionalLight
from relight.lights.environment import EnvironmentLight, Panorama
from relight.lights.light import Light, Settings
from relight.lights.near import FULL_CONE, HALF_CONE, MIN_CONE, PointLight, RectLight
from relight.media import images
from relight.media.cubemap import latlong_directions
from relight.media.photometry import read_profile
from relight.scene import blender, units
from relight.scene.usd.stage import check_inside
from relight.scene.usd.view import StageView, rotation

if TYPE_CHECKING:
    from pxr import Sdf, Usd

TRANSFORM_TOLERANCE = 1e-5  # between the entries of axes that count as equal
ROLL = 1.0  # degrees that a rectangle may lean before a warning says so
Found = tuple[type[Light], Settings]


class LightConverter:
    """Converts the lights of a stage. `external`: textures may be outside the stage's folder."""

    def __init__(self, view: StageView, external: bool) -> None:
        self.view, self.path, self.external = view, view.path, external
        self.said: set[str] = set()

    def cannot(self, prim: Usd.Prim, reason: str) -> None:
        """Warn, once, about what our lights cannot represent."""
        message = f"{self.path}: {prim.GetPath()}: {reason}"
        if message not in self.said:
            self.said.add(message)
            warnings.warn(message, stacklevel=2)

    def kind(self, prim: Usd.Prim) -> Callable[[Usd.Prim, float], Found] | None:
        """Return the function that converts such a light; None, with a warning, if there is none."""
        from pxr import UsdLux

        if prim.IsA(UsdLux.DistantLight):
            return self._distant
        if prim.IsA(UsdLux.SphereLight):
            return self._sphere
        if prim.IsA(UsdLux.RectLight):
            return self._rect
        if prim.IsA(UsdLux.DiskLight):
            return self._disk
        if prim.IsA(UsdLux.DomeLight) or prim.IsA(UsdLux.DomeLight_1):
            return self._dome
        kind = str(prim.GetTypeName()) or "a light"
        self.cannot(prim, f"there is no light like {kind} here; it is left out")
        return None

    def check_extras(self, prim: Usd.Prim) -> None:
        """Warn about features of a light that our lights do not have."""
        from pxr import UsdLux

        light = UsdLux.LightAPI(prim)
        if light.GetFiltersRel().GetTargets():
            self.cannot(prim, "light filters are not applied")
        for collection in (light.GetLightLinkCollectionAPI(), light.GetShadowLinkCollectionAPI()):
            if collection.GetIncludeRootAttr().Get() is False or collection.GetExcludesRel().GetTargets():
                self.cannot(prim, "light linking is not applied: it lights the person")
        shaping = UsdLux.ShapingAPI(prim)
        ies = shaping.GetShapingIesFileAttr().Get()
        if ies is not None and ies.path and not prim.IsA(UsdLux.SphereLight):
            self.cannot(prim, "an IES profile is applied to sphere lights alone")
        if (shaping.GetShapingFocusAttr().Get() or 0) != 0:
            self.cannot(prim, "the focus of its shaping is not applied")
        if (enable := UsdLux.ShadowAPI(prim).GetShadowEnableAttr().Get()) is not None and not enable:
            self.cannot(prim, "lights without shadows are not supported: it casts them")
        if (portals := prim.GetRelationship("portals")) and portals.GetTargets():
            self.cannot(prim, "portals guide a renderer's samples; they are not used")
        texture = prim.GetAttribute("inputs:texture:file")
        if prim.IsA(UsdLux.RectLight) and texture and (asset := texture.Get()) and asset.path:
            self.cannot(prim, "the texture of a rectangle is not applied: it shines evenly")
        space = light.GetColorAttr().GetColorSpace()
        if space and space not in ("lin_rec709_scene", "lin_rec709", "linear", "raw", "identity"):
            self.cannot(prim, f"its colour is taken for linear Rec.709, not {space}")

    def _common(self, prim: Usd.Prim, time: float, power: float) -> Settings:
        """Return the parameters that all lights have. `power`: that of our light of intensity 1."""
        from pxr import UsdGeom, UsdLux

        light = UsdLux.LightAPI(prim)
        visible = UsdGeom.Imageable(prim).ComputeVisibility(time) != UsdGeom.Tokens.invisible
        diffuse = light.GetDiffuseAttr().Get(time)
        strength = light.GetIntensityAttr().Get(time) * (1.0 if diffuse is None else diffuse)
        settings: Settings = {
            "intensity": float(strength) * power * visible,
            "exposure": float(light.GetExposureAttr().Get(time)),
            "colour": tuple(map(float, light.GetColorAttr().Get(time))),
        }
        enabled, kelvins = light.GetEnableColorTemperatureAttr(), light.GetColorTemperatureAttr()
        switched_off = blender.authored(enabled) and not kelvins.HasAuthoredValue()
        if enabled.Get(time) and not switched_off:
            settings["temperature"] = float(kelvins.Get(time))
        if settings["intensity"] < 0:
            raise ValueError(f"{self.path}: {prim.GetPath()}: has a negative intensity")
        return settings

    def _normalize(self, prim: Usd.Prim, time: float) -> bool:
        from pxr import UsdLux

        return bool(UsdLux.LightAPI(prim).GetNormalizeAttr().Get(time))

    def _distant(self, prim: Usd.Prim, time: float) -> Found:
        from pxr import UsdLux

        light = UsdLux.DistantLight(prim)
        angle = float(light.GetAngleAttr().Get(time))
        if blender.authored(light.GetAngleAttr()):
            angle *= blender.SUN_ANGLE
        if angle > 180:
            self.cannot(prim, f"an angle of {angle:g} degrees is taken for 180")
        world = rotation(self.view.matrix(prim, time))
        power = units.distant(angle, self._normalize(prim, time))
        if blender.authored(light.GetIntensityAttr()):
            power *= blender.SUN_STRENGTH
        return DirectionalLight, self._common(prim, time, power) | {
            "direction": self.view.at(time).direction(world[:, 2]),
            "angle": min(max(angle, 0.0), 180.0),
        }

    def _sphere(self, prim: Usd.Prim, time: float) -> Found:
        from pxr import UsdLux

        light = UsdLux.SphereLight(prim)
        matrix = self.view.matrix(prim, time)
        scales = np.linalg.norm(matrix[:3, :3], axis=0)
        if np.ptp(scales) > 1e-3 * scales.max():
            self.cannot(prim, "a sphere that is scaled unevenly is taken for a round one")
        radius = float(light.GetRadiusAttr().Get(time) * scales.mean() * self.view.scale)
        point = bool(light.GetTreatAsPointAttr().Get(time))
        power = units.sphere(radius, self._normalize(prim, time) or (point and radius == 0))
        settings = self._common(prim, time, power) | {
            "position": self.view.at(time).position(matrix[:3, 3]),
            "radius": 0.0 if point else radius,
        }
        settings |= self._cone(prim, time, matrix)
        return PointLight, settings | self._profile(prim, time, matrix, settings["intensity"])

    def _profile(self, prim: Usd.Prim, time: float, matrix: np.ndarray, intensity: float) -> Settings:
        """Return the profile of a light's shaping, with its intensity in the brightest direction."""
        from pxr import Ar, UsdLux

        shaping = UsdLux.ShapingAPI(prim)
        asset = shaping.GetShapingIesFileAttr().Get(time)
        if asset is None or not asset.path:
            return {}
        if Ar.IsPackageRelativePath(asset.resolvedPath):
            self.cannot(prim, "an IES profile within a package is not read")
            return {}
        profile = read_profile(self._checked_asset(prim, asset, "profile"))
        strength = profile.peak / (profile.flux if shaping.GetShapingIesNormalizeAttr().Get(time) else 1.0)
        scale = float(shaping.GetShapingIesAngleScaleAttr().Get(time) or 0.0)
        if scale <= -1:
            self.cannot(prim, f"an angle scale of {scale:g} is not applied")
        return {
            "intensity": intensity * strength,
            "profile": profile,
            "angle_scale": max(scale, 0.0) if scale <= -1 else min(scale, 100.0),
            "toward": self._a_metre_ahead(matrix, time),
        }

    def _a_metre_ahead(self, matrix: np.ndarray, time: float) -> tuple[float, ...]:
        """Return the point a metre along the axis of a light with a transform (4, 4)."""
        point = matrix[:3, 3] - rotation(matrix)[:, 2] / self.view.scale
        return self.view.at(time).position(point)

    def _rect(self, prim: Usd.Prim, time: float) -> Found:
        from pxr import UsdLux

        light = UsdLux.RectLight(prim)
        return self._flat(
            prim, time, float(light.GetWidthAttr().Get(time)), float(light.GetHeightAttr().Get(time))
        )

    def _disk(self, prim: Usd.Prim, time: float) -> Found:
        """Convert a disk light to a square of the same area."""
        from pxr import UsdLux

        side = math.sqrt(math.pi) * float(UsdLux.DiskLight(prim).GetRadiusAttr().Get(time))
        return self._flat(prim, time, side, side, turns=True)

    def _flat(self, prim: Usd.Prim, time: float, width: float, height: float, turns: bool = False) -> Found:
        """Convert a light that shines from a rectangle. `turns`: whether it is symmetric about its axis."""
        matrix, view = self.view.matrix(prim, time), self.view.at(time)
        right, up = (matrix[:3, axis] for axis in (0, 1))
        sides = [
            width * float(np.linalg.norm(right)) * self.view.scale,
            height * float(np.linalg.norm(up)) * self.view.scale,
        ]
        axis = np.cross(up, right)
        axis = view.axes @ (axis / np.linalg.norm(axis).clip(1e-30))
        if np.linalg.det(matrix[:3, :3]) < 0:
            axis = -axis
        if not turns:
            sides = self._levelled(prim, view.axes @ right, axis, sides)
        position = view.position(matrix[:3, 3])
        power = units.flat(sides[0] * sides[1], self._normalize(prim, time))
        settings = self._common(prim, time, power) | {
            "position": position,
            "toward": tuple((np.array(position) + axis).tolist()),
            "width": sides[0],
            "height": sides[1],
        }
        return RectLight, settings | self._cone(prim, time, matrix)

    def _levelled(
        self, prim: Usd.Prim, right: np.ndarray, axis: np.ndarray, sides: list[float]
    ) -> list[float]:
        """Return the sides of a rectangle of horizontal width, as ours have; warns if it was tilted."""
        level = np.cross(axis, (0.0, 1.0, 0.0))
        length = np.linalg.norm(level)
        level = level / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
        across = abs(float(right @ level) / float(np.linalg.norm(right)))
        roll = math.degrees(math.acos(min(across, 1.0)))
        if ROLL < roll < 90 - ROLL:
            self.cannot(prim, f"leans by {roll:.0f} degrees; it is taken to stand level")
        return sides if roll < 45 else sides[::-1]

    def _cone(self, prim: Usd.Prim, time: float, matrix: np.ndarray) -> Settings:
        """Return the cone of a light's shaping; empty if it has none."""
        from pxr import UsdLux

        shaping = UsdLux.ShapingAPI(prim)
        angle = shaping.GetShapingConeAngleAttr().Get(time)
        if angle is None or not prim.HasAPI(UsdLux.ShapingAPI):
            return {}
        softness = float(shaping.GetShapingConeSoftnessAttr().Get(time) or 0.0)
        if softness > 1:
            self.cannot(prim, f"a cone's softness of {softness:g} is taken for 1")
        round_ = prim.IsA(UsdLux.SphereLight)
        settings: Settings = {
            "cone": min(max(float(angle), MIN_CONE), FULL_CONE if round_ else HALF_CONE),
            "softness": min(max(softness, 0.0), 1.0),
        }
        if round_:
            settings["toward"] = self._a_metre_ahead(matrix, time)
        return settings

    def _dome(self, prim: Usd.Prim, time: float) -> Found:
        from pxr import UsdLux

        light = UsdLux.DomeLight_1(prim) if prim.IsA(UsdLux.DomeLight_1) else UsdLux.DomeLight(prim)
        form = light.GetTextureFormatAttr().Get(time)
        if form not in (None, "automatic", "latlong"):
            raise ValueError(
                f"{self.path}: {prim.GetPath()}: has a {form} texture; expected latlong, convert it first"
            )
        asset = light.GetTextureFileAttr().Get(time)
        axes = self.view.at(time).axes @ rotation(self.view.matrix(prim, time), mirrored=True)
        if prim.IsA(UsdLux.DomeLight_1):
            pole = light.GetPoleAxisAttr().Get()
            if pole == "Z" or (pole == "scene" and self.view.z_up):
                axes = axes @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        settings = self._common(prim, time, 1.0)
        if not light.GetIntensityAttr().HasAuthoredValue() and blender.authored(light.GetTextureFileAttr()):
            self.cannot(
                prim, "Blender does not write the strength of a world with an image; it is taken for 1"
            )
        if asset is None or not asset.path:
            return EnvironmentLight, settings | {"image": np.ones((32, 64, 3), np.float32)}
        image = self._texture(prim, asset)
        if blender.authored(light.GetTextureFileAttr()):
            image = _even(image)
        upright = np.array([0.0, 1.0, 0.0])
        if np.abs(axes[:, 1] - upright).max() < TRANSFORM_TOLERANCE and np.linalg.det(axes) > 0:
            turn = math.degrees(math.atan2(axes[0, 2], axes[2, 2]))
            return EnvironmentLight, settings | {"image": image, "rotation": turn}
        return EnvironmentLight, settings | {"image": _turned(EnvironmentLight(image).image, axes)}

    def _texture(self, prim: Usd.Prim, asset: Sdf.AssetPath) -> Path | np.ndarray:
        """Return the texture of a dome: its file, or the content of a package."""
        from pxr import Ar

        path = self._checked_asset(prim, asset, "texture")
        if not Ar.IsPackageRelativePath(asset.resolvedPath):
            return path
        packed = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(asset.resolvedPath))
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / f"texture{Path(asset.path).suffix}"
            file.write_bytes(bytes(packed.GetBuffer()))
            return images.read(file)

    def _checked_asset(self, prim: Usd.Prim, asset: Sdf.AssetPath, what: str) -> Path:
        """Return the path of a light's file; refuse one that is missing, or outside the stage's folder."""
        where = f"{self.path}: {prim.GetPath()}: "
        if not asset.resolvedPath:
            raise FileNotFoundError(f"{where}its {what} {asset.path} is missing")
        if not self.external:
            if os.path.isabs(asset.path):
                raise ValueError(
                    f"{where}has the absolute path {asset.path}; expected one relative to the stage, or "
                    "allow external files (allow_external=True)"
                )
            check_inside(self.path, asset.resolvedPath, f"{prim.GetPath()}: its {what}")
        return Path(asset.resolvedPath)


def _turned(image: Panorama, axes: np.ndarray) -> np.ndarray:
    """Return a map (H, 2 H, 3) whose x, y and z point along the columns of `axes` (3, 3) afterwards.

    They are orthogonal; a reflection is allowed.
    """
    height = len(image.pixels)
    # The transpose takes directions back to the map.
    x, y, z = np.moveaxis(latlong_directions(height) @ axes, -1, 0)
    column, elevation = 180 - np.degrees(np.arctan2(x, z)), np.degrees(np.arcsin(y.clip(-1, 1)))
    return image.at(column, elevation, 180 / height)


def _even(image: Path | np.ndarray) -> Path | np.ndarray:
    """Return a map of one colour instead of a picture of one colour, which may have any shape."""
    pixels = images.read(image)[..., :3] if isinstance(image, Path) else image[..., :3]
    if (pixels != pixels[0, 0]).any():
        return image
    return np.broadcast_to(pixels[0, 0], (32, 64, 3)).astype(np.float32)
