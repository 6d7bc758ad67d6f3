"""The lights file: lights as YAML or JSON, for people and for programs.

    lights:
      - name: key
        azimuth: -40
        elevation: 30
        intensity: 2
        colour: [1, 0.9, 0.8]
      - name: rim
        azimuth: 140
        temperature: 9000
        angle: 20
      - name: sky
        type: environment
        image: sky.exr
        rotation: 90
      - name: lamp
        type: point
        position: [-0.6, 0.4, 0.8]
        radius: 0.1

Each light has the parameters of its class, by name. Its type is "directional" unless it is given or follows
from the parameters. The path of an environment's image is relative to the lights file. A value may be
keyframes by frame, and `orbit: 200` turns a light once around the subject in 200 frames (see
`relight.MovingLight`):

      - name: sun
        azimuth: {1: -90, 100: 60}
        elevation: {1: 5, 50: 40, 100: 10}
"""

import json
import os
import re
import reprlib
from collections.abc import Hashable, Iterable
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import yaml

from relight import quantities
from relight.arguments import unknown
from relight.lights.directional import DirectionalLight
from relight.lights.environment import EnvironmentLight
from relight.lights.light import Light
from relight.lights.moving import FILES, MovingLight, kind_of
from relight.lights.near import PointLight, RectLight
from relight.media.regular_file import check_regular_file
from shadow.files import AnyPath, replacing

TYPES: dict[str, type[Light]] = {
    "directional": DirectionalLight,
    "environment": EnvironmentLight,
    "point": PointLight,
    "rect": RectLight,
}
Key = TypeVar("Key")
Value = TypeVar("Value")
SUFFIXES = (".yaml", ".yml", ".json")
MOST_LIGHTS = 1000  # of a file: each is a layer of a picture, and takes its memory
MAX_KEYS = 1000  # of a mapping, merged ones included
MERGE_TAG = "tag:yaml.org,2002:merge"


def read_lights(path: AnyPath) -> list[Light | MovingLight]:
    """Read a lights file: a list of lights, in the file's order.

    It is a .yaml, .yml or .json: `lights`, a list, each a mapping of a light's parameters (see
    `relight.DirectionalLight`, `relight.EnvironmentLight` and `relight.MovingLight`), with `type:
    environment` where it is one. Raises FileNotFoundError, and ValueError, which names the file, the light
    and the key, for what is not YAML or JSON, unknown or repeated keys, and values that the light refuses.
    """
    return [_light(path, number, entry) for number, entry in enumerate(_entries(path), 1)]


def write_lights(path: AnyPath, lights: Iterable[Light | MovingLight]) -> None:
    """Write lights to a .yaml, .yml or .json, which `read_lights` reads back to the same lights.

    Directions are written as azimuth and elevation, rounded to 1e-4 degrees; an environment's image by its
    path, relative to the lights file unless it is absolute. The file is written whole, or not at all. Raises
    ValueError for another suffix and for an environment that is an array and no file, TypeError for what is
    no light, OSError if the file cannot be written.
    """
    path = _lights_path(path)
    document = {"lights": [_entry(path, light) for light in lights]}
    if path.suffix.lower() == ".json":
        text = json.dumps(document, indent=2) + "\n"
    else:
        text = yaml.dump(document, Dumper=_Dumper, sort_keys=False, allow_unicode=True)
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8")


Entry: TypeAlias = dict[str, Any]  # a light's parameters, in the types of YAML and JSON


def to_entries(lights: Iterable[Light | MovingLight]) -> list[Entry]:
    """Return lights as the entries of a lights file, with absolute paths. Raises as `write_lights` does."""
    folder = Path.cwd()
    entries = [_entry(folder / "lights.json", light) for light in lights]
    return [
        entry | {key: os.path.abspath(entry[key]) for key in FILES.intersection(entry)} for entry in entries
    ]


def from_entries(entries: Iterable[object]) -> list[Light | MovingLight]:
    """Return the lights of entries that `to_entries` returned. Raises as `read_lights` does."""
    return [_light("lights", number, entry) for number, entry in enumerate(entries, 1)]


def _lights_path(path: AnyPath) -> Path:
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{path}: expected a lights file, whose name ends in {', '.join(SUFFIXES)}")
    return path


def _entries(path: AnyPath) -> list[object]:
    """Read the lights of a file as mappings, whose keys and values are still unchecked."""
    path = check_regular_file(_lights_path(path))
    try:
        text = path.read_text(encoding="utf-8-sig")  # with or without a byte order mark
        if path.suffix.lower() == ".json":
            document = json.loads(text, object_pairs_hook=_unique)
        else:
            document = yaml.load(text, _Loader)  # a SafeLoader
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is not a lights file: it is no UTF-8; save it as UTF-8") from error
    except (ValueError, RecursionError, yaml.YAMLError, AttributeError, LookupError, TypeError) as error:
        # PyYAML raises the last three for tags that do not fit: `!!bool perhaps`, `!!float ""`.
        problem = " ".join(str(error).split())
        raise ValueError(f"{path}: is not a lights file: {problem}") from error
    if not isinstance(document, dict) or "lights" not in document:
        raise ValueError(f"{path}: expected 'lights:' and a list of lights, got {reprlib.repr(document)}")
    for key in document:
        if key != "lights":
            raise ValueError(f"{path}: {unknown(key, ['lights'])}")
    if not isinstance(document["lights"], list):
        raise ValueError(f"{path}: lights: expected a list, got {reprlib.repr(document['lights'])}")
    if len(document["lights"]) > MOST_LIGHTS:
        raise ValueError(f"{path}: holds {len(document['lights'])} lights; expected at most {MOST_LIGHTS}")
    return document["lights"]


def _light(path: AnyPath, number: int, entry: object) -> Light | MovingLight:
    """Make a light of its mapping in a file."""
    where = f"{path}: light {number}"
    if not isinstance(entry, dict):
        raise ValueError(f"{where}: expected parameters and their values, got {reprlib.repr(entry)}")
    if isinstance(entry.get("name"), str):
        where = f"{where} ({_shown(entry['name'])})"
    usual = next(name for name, kind in TYPES.items() if kind is kind_of(map(str, entry)))
    kind = entry.get("type", usual)
    if not isinstance(kind, str) or kind not in TYPES:
        raise ValueError(f"{where}: type: expected {' or '.join(TYPES)}, got {reprlib.repr(kind)}")
    arguments = {key: value for key, value in entry.items() if key != "type"}
    known = TYPES[kind].parameters()
    for key in arguments:
        if key not in known and key != "orbit":
            raise ValueError(f"{where}: {unknown(key, (*known, 'orbit'))}")
    for key, parameter in known.items():
        if parameter.is_required and key not in arguments:
            raise ValueError(f"{where}: {key}: is missing")
    for key in FILES.intersection(arguments):
        if not isinstance(arguments[key], str):
            raise ValueError(f"{where}: {key}: expected a file, got {reprlib.repr(arguments[key])}")
        arguments[key] = Path(path).parent / arguments[key]
    try:
        if "orbit" in arguments or any(isinstance(value, dict) for value in arguments.values()):
            return MovingLight(TYPES[kind], **arguments)
        return TYPES[kind](**arguments)
    except (OSError, TypeError, ValueError) as error:
        problem = " ".join(str(error).splitlines())  # the name of an image may have several
        raise ValueError(f"{where}: {problem}") from error


def _shown(word: object) -> str:
    """Return a name or key of a file for an error; shortened and quoted where it would break the line."""
    if isinstance(word, str) and word.isprintable() and len(word) <= quantities.MAX_NAME_BYTES:
        return word
    return reprlib.repr(word)


def _entry(path: Path, light: Light | MovingLight) -> Entry:
    """Return a light's mapping for the file `path`: what is not the default, its name first."""
    made = light.kind if isinstance(light, MovingLight) else type(light)
    kinds = {kind for kind, cls in TYPES.items() if issubclass(made, cls)}
    if not kinds:
        raise TypeError(f"lights: expected lights, e.g. DirectionalLight, got {type(light).__name__}")
    settings = light.settings()
    entry = {"name": settings.pop("name")} if "name" in settings else {}
    entry |= {"type": kinds.pop()} if kinds != {"directional"} else {}
    for key in FILES.intersection(settings):
        if not Path(settings[key]).is_absolute():
            settings[key] = Path(os.path.relpath(settings[key], path.parent)).as_posix()
    return entry | {key: _plain(value) for key, value in settings.items()}


def _plain(value: object) -> object:
    """Return a value as a person would write it: 40 instead of 40.0."""
    if isinstance(value, tuple):
        return tuple(map(_plain, value))
    if isinstance(value, dict):
        return {_plain(frame): _plain(setting) for frame, setting in value.items()}
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _unique(pairs: Iterable[tuple[Key, Value]]) -> dict[Key, Value]:
    """Return a JSON object as a dictionary; raises ValueError for a repeated key."""
    members: dict[Key, Value] = {}
    for key, value in pairs:
        if key in members:
            raise ValueError(f"{reprlib.repr(key)} is there twice")
        members[key] = value
    return members


class _Loader(yaml.SafeLoader):
    """Safe YAML 1.2 without repeated keys, and with few merged ones.

    PyYAML reads YAML 1.1, where 010 is eight, 1:30 is ninety, 1e3 is a text and `on` is true.
    ruamel.yaml reads 1.2, but with dates, 1_000 and merges without bound, and what it writes reads otherwise
    in YAML 1.1 (`on`, 1:30): to keep these would take as many lines.
    """

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(None, None, "a key is no text", key.start_mark)
        _unique([(self.construct_object(key), None) for key, _ in node.value if key.tag != MERGE_TAG])
        return super().construct_mapping(node, deep)

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        super().flatten_mapping(node)
        if len(node.value) > MAX_KEYS:  # merges of merges grow exponentially
            raise yaml.constructor.ConstructorError(None, None, "merges too many keys", node.start_mark)

    def construct_integer(self, node: yaml.ScalarNode) -> int:
        digits = self.construct_scalar(node).lower()
        return int(digits, {"0x": 16, "0o": 8}.get(digits[:2], 10))


class _Dumper(yaml.SafeDumper):
    """YAML with vectors on one line."""

    def ignore_aliases(self, data: object) -> bool:
        return True


# The core schema: YAML 1.2.2, section 10.3.2, and merge keys. What is written is quoted where either version
# of YAML would take a text for something else.
_Loader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in (
    ("null", "null|Null|NULL|~|", ["n", "N", "~", ""]),
    ("bool", "true|True|TRUE|false|False|FALSE", list("tTfF")),
    ("int", "[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", list("-+0123456789")),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
    ("merge", "<<", ["<"]),
):
    for _class in (_Loader, _Dumper):
        _class.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(rf"(?:{_pattern})\Z"), _first)
_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_integer)
_Dumper.add_representer(
    tuple, lambda dumper, value: dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=True)
)
