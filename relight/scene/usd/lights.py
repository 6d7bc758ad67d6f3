"""Our lights as UsdLux prims of a stage."""

from __future__ import annotations

import math
import shutil
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from relight.lights.directional import DirectionalLight
from relight.lights.environment import EnvironmentLight
from relight.lights.light import Light
from relight.lights.moving import MovingLight
from relight.lights.near import NearLight, PointLight, RectLight
from relight.media import images
from relight.scene import units

if TYPE_CHECKING:
    from pxr import Usd

Time: TypeAlias = "Usd.TimeCode | float"
HOTTEST = 10_000.0  # kelvin, of UsdLux


class Place(NamedTuple):
    """Where a stage is written: first in a folder of its own."""

    target: Path  # where it will be
    folder: Path  # where it and its files are until then


def add_lights(
    stage: Usd.Stage,
    parent: str,
    lights: Iterable[Light | MovingLight],
    place: Place,
    frames: tuple[int, int] | None = None,
) -> None:
    """Add lights to a stage whose axes are the camera's, in metres from the subject's middle.

    They come below the prim `parent`. `place`: where the stage is written; maps of environments that are not
    in its folder are written there too. `frames`: the first and the last frame of the stage, each of which
    has a time sample of lights that move. Without them one turn of an orbit and all keyframes are written,
    and a warning says that USD holds the end.
    """
    from pxr import Tf, UsdLux

    taken: set[str] = set()
    for number, light in enumerate(lights, 1):
        name = light.name or f"light{number}"
        word = Tf.MakeValidIdentifier(name)
        while word in taken:
            word += "_"
        taken.add(word)
        times = [(time, still.plain) for time, still in moments(light, frames)]
        if frames is None and isinstance(light, MovingLight) and light.orbit is not None:
            warnings.warn(
                f"{name}: orbit: written for frames {times[0][0]:g} to {times[-1][0]:g}; then it stops",
                stacklevel=2,
            )
        schema, _ = _kind(times[0][1])
        prim = getattr(UsdLux, schema).Define(stage, f"{parent}/{word}").GetPrim()
        prim.SetDisplayName(name)
        stills = [still for _, still in times]
        kelvins = all(map(_has_usd_temperature, stills))
        if all(isinstance(still, PointLight) and still.radius == 0 for still in stills):
            UsdLux.SphereLight(prim).CreateTreatAsPointAttr(True)
        for time, still in times:
            _write(prim, still, time, place, kelvins)


def moments(light: Light | MovingLight, frames: tuple[int, int] | None) -> list[tuple[Time, Light]]:
    """Return pairs (time, light): the default time of a still light, every frame of a moving one."""
    from pxr import Usd

    if not isinstance(light, MovingLight):
        return [(Usd.TimeCode.Default(), light)]
    ends = list(light.span or ())
    if light.orbit is not None:
        ends += frames or (1.0, 1.0 + abs(light.orbit))
    ends = ends or [1.0]
    times = {float(frame) for frame in range(math.floor(min(ends)), math.ceil(max(ends)) + 1)}
    for keyframes in light.moves.values():
        times |= set(keyframes)
    return [(time, light.at(time)) for time in sorted(times)]


def _has_usd_temperature(light: Light) -> bool:
    """Return whether a light has a temperature that UsdLux can state."""
    kelvin = light.temperature
    return kelvin is not None and light.locus == "planckian" and kelvin <= HOTTEST


def _kind(light: Light) -> Kind:
    """Return the schema of a light and its writer."""
    for light_type, kind in KINDS.items():
        if isinstance(light, light_type):
            return kind
    raise TypeError(f"lights: expected lights, e.g. DirectionalLight, got {type(light).__name__}")


def _write(prim: Usd.Prim, light: Light, time: Time, place: Place, kelvins: bool) -> None:
    """Set what UsdLux has for a light at one time, its temperature as kelvins or in its colour."""
    from pxr import Gf, UsdGeom, UsdLux

    api = UsdLux.LightAPI(prim)
    colour = np.array(light.colour)
    strength = light.intensity * 2.0**light.exposure
    if light.temperature is not None and not kelvins and strength:
        colour = light.power / strength
    api.CreateColorAttr().Set(Gf.Vec3f(*map(float, colour)), time)
    api.CreateExposureAttr().Set(light.exposure, time)
    if kelvins:
        api.CreateEnableColorTemperatureAttr(True)
        api.CreateColorTemperatureAttr().Set(light.temperature, time)
    _, write = _kind(light)
    scale, matrix = write(prim, light, time, place)
    api.CreateIntensityAttr().Set(light.intensity * scale, time)
    xform = UsdGeom.Xformable(prim)
    operations = xform.GetOrderedXformOps()
    operation = operations[0] if operations else xform.AddTransformOp()
    operation.Set(Gf.Matrix4d(*matrix.T.ravel().tolist()), time)


def _write_distant(
    prim: Usd.Prim, light: DirectionalLight, time: Time, place: Place
) -> tuple[float, np.ndarray]:
    """Set what only a distant light has; return the scale of its intensity and its transform (4, 4)."""
    from pxr import UsdLux

    UsdLux.LightAPI(prim).CreateNormalizeAttr(True)
    UsdLux.DistantLight(prim).CreateAngleAttr().Set(light.angle, time)
    return units.DISTANT, _frame(np.array(light.direction), np.zeros(3))


def _write_sphere(prim: Usd.Prim, light: PointLight, time: Time, place: Place) -> tuple[float, np.ndarray]:
    from pxr import Sdf, UsdLux

    UsdLux.SphereLight(prim).CreateRadiusAttr().Set(light.radius, time)
    if light.profile is None:
        return units.SPHERE, _near_frame(prim, light, time)
    shaping = UsdLux.ShapingAPI.Apply(prim)
    if not shaping.GetShapingIesFileAttr().Get():
        shaping.CreateShapingIesFileAttr(Sdf.AssetPath(f"./{_beside(prim, light.profile.path, place)}"))
    shaping.CreateShapingIesAngleScaleAttr().Set(light.angle_scale, time)
    # UsdLux multiplies by candela, our light by their share of the brightest direction's.
    return units.SPHERE / light.profile.peak, _near_frame(prim, light, time)


def _beside(prim: Usd.Prim, path: Path | None, place: Place) -> str:
    """Return the name, relative to the stage, of a file that is in its folder or copied there."""
    if path is None:
        raise ValueError("profile: is in no file; write it to one and make the light of that")
    home = place.target.resolve().parent
    if place.target.suffix.lower() != ".usdz" and home in path.resolve().parents:
        return path.resolve().relative_to(home).as_posix()
    name = f"{place.target.stem}_{prim.GetName()}{path.suffix}"
    shutil.copyfile(path, place.folder / name)
    return name


def _write_rect(prim: Usd.Prim, light: RectLight, time: Time, place: Place) -> tuple[float, np.ndarray]:
    from pxr import UsdLux

    rect = UsdLux.RectLight(prim)
    rect.CreateWidthAttr().Set(light.width, time)
    rect.CreateHeightAttr().Set(light.height, time)
    return units.RECT, _near_frame(prim, light, time)


def _write_dome(
    prim: Usd.Prim, light: EnvironmentLight, time: Time, place: Place
) -> tuple[float, np.ndarray]:
    _texture(prim, light, place)
    turn = math.radians(light.rotation)
    return 1.0, _frame(np.array([math.sin(turn), 0.0, math.cos(turn)]), np.zeros(3))


def _near_frame(prim: Usd.Prim, light: NearLight, time: Time) -> np.ndarray:
    """Set what all near lights have, and return the transform (4, 4)."""
    from pxr import UsdLux

    UsdLux.LightAPI(prim).CreateNormalizeAttr(True)
    if light.has_cone:
        shaping = UsdLux.ShapingAPI.Apply(prim)
        shaping.CreateShapingConeAngleAttr().Set(light.cone, time)
        shaping.CreateShapingConeSoftnessAttr().Set(light.softness, time)
    light.check_placed()
    return _frame(-light.axis, np.array(light.position))


Kind = tuple[str, Callable[..., tuple[float, np.ndarray]]]
KINDS: dict[type[Light], Kind] = {
    DirectionalLight: ("DistantLight", _write_distant),
    PointLight: ("SphereLight", _write_sphere),
    RectLight: ("RectLight", _write_rect),
    EnvironmentLight: ("DomeLight", _write_dome),
}  # the schema of UsdLux, and what sets its attributes


def _frame(z: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return a transform (4, 4), for column vectors, with z along a unit vector and a horizontal x."""
    x = np.cross((0.0, 1.0, 0.0), z)
    length = np.linalg.norm(x)
    x = x / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
    matrix = np.eye(4)
    matrix[:3] = np.stack([x, np.cross(z, x), z, place], axis=1)
    return matrix


def _texture(prim: Usd.Prim, light: EnvironmentLight, place: Place) -> None:
    """Name the map of an environment, which is put beside the stage unless it is there already."""
    from pxr import Sdf, UsdLux

    dome = UsdLux.DomeLight(prim)
    if dome.GetTextureFileAttr().Get():
        return
    dome.CreateTextureFormatAttr(UsdLux.Tokens.latlong)
    pixels, path = light.image.pixels, light.image.path
    layered = path is not None and images.split_layer(path)[1] is not None
    if layered or light.image.cube or light.colour_space is not None:
        path = None  # renderers would read the file in another way: the map is written by itself
    if path is None and pixels.min() == pixels.max() == 1:
        return  # an even sky of radiance 1 is what a dome without a texture is
    home = place.target.resolve().parent
    if path is not None and place.target.suffix.lower() != ".usdz" and home in path.resolve().parents:
        name = path.resolve().relative_to(home).as_posix()
    else:
        name = f"{place.target.stem}_{prim.GetName()}{'.exr' if path is None else path.suffix}"
        if path is None:
            images.write(place.folder / name, pixels)
        else:
            shutil.copyfile(path, place.folder / name)
    dome.CreateTextureFileAttr(Sdf.AssetPath(f"./{name}"))
