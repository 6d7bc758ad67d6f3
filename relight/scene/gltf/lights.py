"""Our lights as those of glTF, KHR_lights_punctual: directional ones, points and spots, without a size."""

import json
import math
import struct
import warnings
from collections.abc import Callable, Iterable

import numpy as np

from relight.lights.directional import DirectionalLight
from relight.lights.environment import EnvironmentLight
from relight.lights.light import Light
from relight.lights.moving import MovingLight
from relight.lights.near import NearLight, PointLight, RectLight
from relight.scene import units
from relight.scene.gltf.read import EXTENSION, JSON_CHUNK, MAGIC, SUFFIXES
from shadow.files import AnyPath, check_writable, replacing


def write_lights(path: AnyPath, lights: Iterable[Light | MovingLight]) -> None:
    """Write lights alone as a glTF scene: its axes are the camera's, its origin is the subject's middle."""
    path = check_writable(path, SUFFIXES)
    entries, places = punctual_lights(lights)
    if not entries:
        raise ValueError(f"{path}: expected lights that glTF has: directional ones and points")
    nodes = place_nodes(entries, places)
    tree = {
        "asset": {"version": "2.0", "generator": "relight"},
        "extensionsUsed": [EXTENSION],
        "extensions": {EXTENSION: {"lights": entries}},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
    }
    text = json.dumps(tree, indent=1 if path.suffix.lower() == ".gltf" else None).encode()
    if path.suffix.lower() == ".glb":
        text += b" " * (-len(text) % 4)
        text = struct.pack("<5I", MAGIC, 2, 20 + len(text), len(text), JSON_CHUNK) + text
    with replacing(path) as written:
        written.write_bytes(text)


def punctual_lights(lights: Iterable[Light | MovingLight]) -> tuple[list[dict[str, object]], list[Light]]:
    """Return glTF's description of each light that it can express, and those lights; warn of the others."""
    entries: list[dict[str, object]] = []
    ours: list[Light] = []
    for number, given in enumerate(lights, 1):
        light = given
        name = light.name or f"light{number}"
        if isinstance(light, MovingLight):
            warnings.warn(f"{name}: glTF's lights do not move; it is written as at frame 1", stacklevel=3)
            light = light.at(1)
        if isinstance(light, EnvironmentLight):
            warnings.warn(f"{name}: glTF has no environments; it is left out", stacklevel=3)
            continue
        power = np.asarray(light.power) * units.GLTF
        brightest = float(power.max())
        entry = {
            "name": name,
            "color": (power / brightest if brightest > 0 else np.ones(3)).tolist(),
            "intensity": brightest,
        }
        own = next((kind for light_type, kind in KINDS.items() if isinstance(light, light_type)), None)
        if own is None:
            raise TypeError(f"lights: expected lights, e.g. DirectionalLight, got {type(light).__name__}")
        entries.append(entry | own(light, name))
        ours.append(light)
    return entries, ours


def place_nodes(entries: list[dict[str, object]], lights: list[Light]) -> list[dict[str, object]]:
    """Return a node for each light, which shines along its own -z."""
    nodes = []
    for index, (entry, light) in enumerate(zip(entries, lights, strict=True)):
        node: dict[str, object] = {"name": entry["name"], "extensions": {EXTENSION: {"light": index}}}
        if isinstance(light, DirectionalLight):
            node["rotation"] = _facing(np.array(light.direction))
        elif isinstance(light, NearLight):
            light.check_placed()
            node["translation"] = list(map(float, light.position))
            node["rotation"] = _facing(-light.axis)
        nodes.append(node)
    return nodes


def _directional(light: DirectionalLight, name: str) -> dict[str, object]:
    """Return what is said of a directional light alone."""
    if light.angle:
        warnings.warn(f"{name}: glTF's lights have no size; it is written as a hard one", stacklevel=4)
    return {"type": "directional"}


def _spot(light: RectLight, name: str) -> dict[str, object]:
    warnings.warn(f"{name}: glTF has no rectangles; it is written as a spot of 180 degrees", stacklevel=4)
    return {"type": "spot", "spot": {"innerConeAngle": 0.0, "outerConeAngle": math.pi / 2}}


def _point(light: PointLight, name: str) -> dict[str, object]:
    """Return what is said of a point or a spotlight, whose cone glTF has not wider than a hemisphere."""
    if light.radius:
        warnings.warn(f"{name}: glTF's lights have no size; it is written as a point", stacklevel=4)
    if light.profile is not None:
        warnings.warn(
            f"{name}: glTF's lights have no profile; it shines alike in all directions", stacklevel=4
        )
    if not light.has_cone:
        return {"type": "point"}
    if light.cone > 90:
        warnings.warn(f"{name}: glTF's cones end at 90 degrees; it is written so", stacklevel=4)
    outer = math.radians(min(light.cone, 90))
    return {"type": "spot", "spot": {"innerConeAngle": outer * (1 - light.softness), "outerConeAngle": outer}}


KINDS: dict[type, Callable[..., dict[str, object]]] = {
    DirectionalLight: _directional,
    PointLight: _point,
    RectLight: _spot,
}


def _facing(z: np.ndarray) -> list[float]:
    """Return the quaternion (x, y, z, w) that turns +z to a unit vector."""
    if z[2] < -1 + 1e-12:
        return [0.0, 1.0, 0.0, 0.0]
    quaternion = np.array([-z[1], z[0], 0.0, 1 + z[2]])
    return (quaternion / np.linalg.norm(quaternion)).tolist()
