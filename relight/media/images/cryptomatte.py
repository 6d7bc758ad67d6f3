"""Cryptomatte in OpenEXR files: layers that hold numbers of objects, and no matte (Friedman and Jones 2015).

Red and blue of a layer of it are the numbers of two objects, green and alpha how much of a pixel each covers.
The attributes `cryptomatte/ID/name` name its layers, `cryptomatte/ID/manifest` the objects.
"""

import json
import re
from collections.abc import Iterable

import OpenImageIO as oiio

ATTRIBUTE = re.compile(r"cryptomatte/(?P<id>[^/]+)/name")
RANKED = re.compile(r"(?P<name>.*?)\d\d")  # CryptoObject00, CryptoObject01...
USUAL = re.compile(r"(.*\.)?crypto_?(object|material|asset)", re.IGNORECASE)  # where no attribute says so
SHOWN = 5  # names of objects in an error
LONGEST = 40  # characters of a name in an error


def check_no_cryptomatte(spec: oiio.ImageSpec, layers: Iterable[str]) -> None:
    """Raise ValueError if one of the layers that are read is Cryptomatte; the message names objects of it."""
    stated = {
        match["id"]: str(attribute.value)
        for attribute in spec.extra_attribs
        if (match := ATTRIBUTE.fullmatch(attribute.name))
    }
    for layer in layers:
        ranked = RANKED.fullmatch(layer)
        if ranked is None:
            continue
        ids = [identity for identity, name in stated.items() if _is_of(ranked["name"], name)]
        if not ids and USUAL.fullmatch(ranked["name"]) is None:
            continue
        names = _objects(spec.get_string_attribute(f"cryptomatte/{ids[0]}/manifest") if ids else "")
        found = f" of {', '.join(names)}" if names else ""
        raise ValueError(
            f"layer {layer} is Cryptomatte, the numbers of objects and no matte: extract the matte of one"
            f"{found}, such as by Nuke's or Blender's node Cryptomatte, and give that"
        )


def _is_of(layer: str, name: str) -> bool:
    """Return whether a layer without its rank is the one that is named, whatever their view layers are."""
    return layer == name or layer.endswith(f".{name}") or name.endswith(f".{layer}")


def _objects(manifest: str) -> list[str]:
    """Return a few names of objects of a manifest; none of a damaged one."""
    try:
        names = json.loads(manifest)
    except (ValueError, RecursionError):
        return []
    if not isinstance(names, dict):
        return []
    fitting = [name for name in names if name.isprintable() and 0 < len(name) <= LONGEST]
    return fitting[:SHOWN] + (["..."] if len(fitting) > SHOWN else [])
