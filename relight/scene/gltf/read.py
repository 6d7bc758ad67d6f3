"""Lights of glTF scenes, KHR_lights_punctual: directional ones and points, with photometric units."""

import json
import math
import re
import struct
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from relight.lights.directional import DirectionalLight
from relight.lights.files import MOST_LIGHTS
from relight.lights.light import Light
from relight.lights.moving import MovingLight
from relight.lights.near import PointLight
from relight.media.regular_file import check_regular_file
from relight.scene import blender, camera_view, units
from relight.scene.usd.read import Rig, renamed
from shadow.files import AnyPath

SUFFIXES = (".gltf", ".glb")
EXTENSION, VISIBILITY = "KHR_lights_punctual", "KHR_node_visibility"
# Beginnings of the names of extensions that lights and cameras can be read without.
APART_FROM_LIGHTS = (
    EXTENSION, VISIBILITY, "KHR_draco", "KHR_materials", "KHR_mesh", "KHR_texture", "KHR_gaussian",
    "EXT_mesh", "EXT_texture", "MSFT_texture",
)  # fmt: skip
POINTER = "KHR_animation_pointer"
MOVED = re.compile(r"^(?:/extensions/KHR_lights_punctual)?/(nodes|lights|cameras)/(\d{1,9})/")
MAGIC, JSON_CHUNK = 0x46546C67, 0x4E4F534A
LARGEST_JSON = 2**28  # bytes


Tree: TypeAlias = dict[str, Any]  # a scene or a part of it, in the types of JSON: any, until it is checked


class Node(NamedTuple):
    """A node of a scene, and where it is."""

    description: Tree
    world: np.ndarray  # (4, 4) of column vectors
    visible: bool  # as KHR_node_visibility says; its children are hidden with it
    line: tuple[int, ...]  # indices of the nodes from the root to it


def read_rig(
    path: AnyPath, camera: str | None = None, subject_at: str | Iterable[float] | None = None
) -> Rig:
    """Read the lights of a glTF scene into a camera's frame; see `relight.read_lights`.

    Raises FileNotFoundError, and ValueError for what is not glTF 2.0, no lights or too many, unknown nodes,
    or several cameras and none named.
    """
    path = Path(path)
    tree = _tree(path)
    nodes = list(_nodes(path, tree))
    cameras = [(str(node.description.get("name")), node) for node in nodes if "camera" in node.description]
    seen = camera_view.choose_camera(path, cameras, camera)
    view = np.eye(3)  # from world to camera
    if seen is not None:
        view = (seen.world[:3, :3] / np.linalg.norm(seen.world[:3, :3], axis=0)).T
    origin = _mark(path, nodes, subject_at)
    if origin is None:
        if seen is not None and any(
            _entry(path, tree, node).get("type") != "directional" for node in _lit(nodes)
        ):
            raise ValueError(
                f"{path}: glTF has no focus distance; say where the subject is (subject_at=X/Y/Z)"
            )
        origin = np.zeros(3)
    lights: list[Light | MovingLight] = [_light(path, tree, node, view, origin) for node in _lit(nodes)]
    lights = _with_different_names(lights)
    _warn_of_the_rest(path, tree, [*_lit(nodes), *([] if seen is None else [seen])])
    if lights and _by_blender(tree):
        warnings.warn(
            f"{path}: Blender's lights are taken for those of its lighting mode Standard, "
            f"{blender.LUMENS_PER_WATT:g} "
            "lm/W; the file does not tell the mode. If they are dark, export in that mode",
            stacklevel=2,
        )
    if not lights:
        raise ValueError(f"{path}: holds no lights ({EXTENSION})")
    if len(lights) > MOST_LIGHTS:
        raise ValueError(f"{path}: holds {len(lights)} lights; expected at most {MOST_LIGHTS}")
    if seen is None:
        return Rig(lights)
    camera_sees = camera_view.of_gltf(path, _item(path, tree, "cameras", seen.description["camera"]))
    return Rig(lights, seen.description.get("name"), camera_sees)


def _tree(path: Path) -> Tree:
    """Read the JSON of a .gltf or .glb."""
    content = check_regular_file(path).read_bytes()
    if path.suffix.lower() == ".glb":
        if len(content) < 20 or struct.unpack_from("<I", content)[0] != MAGIC:
            raise ValueError(f"{path}: is not a .glb file")
        length, kind = struct.unpack_from("<2I", content, 12)
        if kind != JSON_CHUNK or length > min(LARGEST_JSON, len(content) - 20):
            raise ValueError(f"{path}: is damaged: its first chunk is no JSON of {length} bytes")
        content = content[20 : 20 + length]
    try:
        tree = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: is not glTF: {' '.join(str(error).split())[:200]}") from error
    if not isinstance(tree, dict) or not str(_get(tree, "asset", "version", default="")).startswith("2."):
        raise ValueError(f"{path}: expected glTF 2.0")
    return tree


def _get(tree: object, *keys: str, default: object = None) -> Any:
    """Return a value in nested objects, or `default`."""
    for key in keys:
        if not isinstance(tree, dict) or key not in tree:
            return default
        tree = tree[key]
    return tree


def _items(path: Path, tree: object, *keys: str) -> list[Any]:
    """Return a list in nested objects, empty where there is none."""
    found = _get(tree, *keys, default=[])
    if not isinstance(found, list):
        raise ValueError(f"{path}: is damaged: {keys[-1]} is no list")
    return found


def _item(path: Path, tree: object, key: str, index: object) -> Any:
    """Return what a file's list has at an index."""
    items = _items(path, tree, key)
    if not isinstance(index, int) or not 0 <= index < len(items):
        raise ValueError(f"{path}: is damaged: {key} has nothing at {index!r:.40}")
    return items[index]


def _nodes(path: Path, tree: Tree) -> Iterable[Node]:
    """Yield the nodes of the file's scene with their transforms to the world, parents first."""
    nodes, scenes = _items(path, tree, "nodes"), _items(path, tree, "scenes")
    try:
        chosen = _item(path, tree, "scenes", tree.get("scene", 0)) if scenes else {}
        roots = chosen.get("nodes", []) if scenes else range(len(nodes))
        stack: list[tuple[int, Node]] = [(index, Node({}, np.eye(4), True, ())) for index in reversed(roots)]
        visited = set()
        while stack:
            index, above = stack.pop()
            if index in visited or index < 0:
                raise ValueError(f"{path}: node {index} is there twice; expected a tree of nodes")
            visited.add(index)
            node = nodes[index]
            world = above.world @ _local(node)
            if not np.isfinite(world).all():
                raise ValueError(f"{path}: node {index}: has a transform that is not finite")
            shown = _get(node, "extensions", VISIBILITY, "visible", default=True) is not False
            placed = Node(node, world, above.visible and shown, (*above.line, index))
            yield placed
            stack += [(child, placed) for child in reversed(node.get("children", []))]
    except (AttributeError, IndexError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: is damaged: its nodes do not form a tree") from error
    except (ArithmeticError, ValueError) as error:
        if str(error).startswith(str(path)):
            raise
        raise ValueError(f"{path}: is damaged: a node's transform: {error}") from error


def _local(node: Tree) -> np.ndarray:
    """Return a node's own transform (4, 4)."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    matrix = np.eye(4)
    quaternion = np.array(node.get("rotation", [0, 0, 0, 1]), float)
    if not quaternion.any():
        raise ValueError("rotation: expected a unit quaternion, got zeros")
    from scipy.spatial.transform import Rotation  # with scipy.sparse, a tenth of a second that few calls need

    rotation = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, :3] = rotation * np.array(node.get("scale", [1, 1, 1]), float).reshape(3)
    matrix[:3, 3] = np.array(node.get("translation", [0, 0, 0]), float).reshape(3)
    return matrix


def _with_different_names(lights: list[Light | MovingLight]) -> list[Light | MovingLight]:
    """Return the lights; of those with one name, which glTF allows, all but the first get a number."""
    taken: set[str] = set()
    named = []
    for light in lights:
        name, number = light.name, 2
        while name in taken:
            name, number = f"{light.name}_{number}", number + 1
        taken |= {name} if name else set()
        named.append(light if name is None or name == light.name else renamed(light, name))
    return named


def _mark(path: Path, nodes: list[Node], subject_at: str | Iterable[float] | None) -> np.ndarray | None:
    """Return where the middle of the subject is in the world, or None if it is not said."""
    if subject_at is None:
        return None
    if isinstance(subject_at, str):
        node = next((node for node in nodes if node.description.get("name") == subject_at), None)
        if node is None:
            raise ValueError(f"{path}: has no node {subject_at}, where the subject was to be")
        return node.world[:3, 3]
    return camera_view.subject_point(subject_at)


def _lit(nodes: list[Node]) -> list[Node]:
    """Return the nodes with a light that shines."""
    return [n for n in nodes if n.visible and _get(n.description, "extensions", EXTENSION) is not None]


def _warn_of_the_rest(path: Path, tree: Tree, nodes: list[Node]) -> None:
    """Warn of what the file says of its lights and camera that is not read.

    nodes: those of the lights and of the camera.
    """
    required = _items(path, tree, "extensionsRequired")
    foreign = [name for name in map(str, required) if not name.startswith(APART_FROM_LIGHTS)]
    if foreign:
        warnings.warn(
            f"{path}: requires {', '.join(foreign)}, which is not read: lights may be missing or elsewhere",
            stacklevel=3,
        )
    moved = {
        target
        for animation in _items(path, tree, "animations")
        for channel in _items(path, animation, "channels")
        for target in _targets(channel)
    }
    names = [str(node.description.get("name")) for node in nodes if moved & _parts_of(node)]
    if names:
        warnings.warn(
            f"{path}: animations are not read; {', '.join(names[:8])} stay where they are without them. USD "
            "carries moving lights",
            stacklevel=3,
        )
    if any(_get(_camera_of(path, tree, node), "type") == "orthographic" for node in nodes):
        warnings.warn(f"{path}: its camera is orthographic; the picture is seen in perspective", stacklevel=3)


def _targets(channel: object) -> Iterator[tuple[str, int]]:
    """Yield what a channel of an animation moves: ("nodes" or "lights" or "cameras", its number)."""
    node = _get(channel, "target", "node")
    if isinstance(node, int):
        yield "nodes", node
    pointer = _get(channel, "target", "extensions", POINTER, "pointer")
    for kind, number in MOVED.findall(pointer) if isinstance(pointer, str) else ():
        yield kind, int(number)


def _parts_of(node: Node) -> set[tuple[str, int]]:
    """Return what may move a node with a light or a camera, as `_targets` does."""
    light, camera = _get(node.description, "extensions", EXTENSION, "light"), node.description.get("camera")
    own = {(kind, at) for kind, at in (("lights", light), ("cameras", camera)) if isinstance(at, int)}
    return own | {("nodes", index) for index in node.line}


def _camera_of(path: Path, tree: Tree, node: Node) -> object:
    """Return the file's description of a node's camera; None without one."""
    index = node.description.get("camera")
    return None if index is None else _item(path, tree, "cameras", index)


def _by_blender(tree: Tree) -> bool:
    return blender.exported_gltf(_get(tree, "asset", "generator"))


def _entry(path: Path, tree: Tree, node: Node) -> Tree:
    """Return the file's description of a node's light."""
    lights = _get(tree, "extensions", EXTENSION, "lights", default=[])
    index = _get(node.description, "extensions", EXTENSION, "light")
    if not isinstance(index, int) or not isinstance(lights, list) or not 0 <= index < len(lights):
        raise ValueError(f"{path}: node {node.description.get('name')}: has no such light, {index}")
    if not isinstance(lights[index], dict):
        raise ValueError(f"{path}: is damaged: light {index} is no object")
    return lights[index]


def _light(path: Path, tree: Tree, node: Node, view: np.ndarray, origin: np.ndarray) -> Light:
    """Return a node's light as a light of relight."""
    unit = units.GLTF * (blender.LUMENS_PER_WATT if _by_blender(tree) else 1)
    entry = _entry(path, tree, node)
    name = node.description.get("name") or entry.get("name")
    where = f"{path}: node {name}"
    try:
        settings: Tree = {
            "intensity": float(entry.get("intensity", 1.0)) / unit,
            "colour": tuple(entry.get("color", (1.0, 1.0, 1.0))),
            "name": name,
        }
        if entry["type"] == "directional":
            return DirectionalLight(tuple((view @ node.world[:3, 2]).tolist()), **settings)
        if entry["type"] not in ("point", "spot"):
            raise ValueError(f"type: expected directional, point or spot, got {entry['type']!r}")
        position = tuple((view @ (node.world[:3, 3] - origin)).tolist())
        if entry["type"] == "spot":
            spot = entry.get("spot", {})
            outer = float(spot.get("outerConeAngle", math.pi / 4))
            inner = float(spot.get("innerConeAngle", 0.0))
            if not 0 <= inner <= outer <= math.pi / 2 + 1e-6 or outer == 0:
                raise ValueError(f"spot: expected 0 <= inner <= outer <= pi / 2, got {inner:g} and {outer:g}")
            axis = view @ node.world[:3, 2]
            toward = np.array(position) - axis / np.linalg.norm(axis)
            settings |= {
                "toward": tuple(toward.tolist()),
                "cone": math.degrees(outer),
                "softness": 1 - inner / outer,
            }
        if entry.get("range") is not None:
            warnings.warn(f"{where}: the range of a light is not applied", stacklevel=2)
        return PointLight(position, **settings)
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{where}: {error}") from error
