"""A picture as its file stores it, in parts and layers: which channels are the beauty, which are a layer's.

A layer is what stands before the last dot of a channel's name, `albedo` in `albedo.R`; in a file of several
parts (OpenEXR 2.0) also a part's name, where its channels have no layer.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight.arguments import shown
from relight.media import colour
from shadow.files import AnyPath

# Names of the picture itself: Nuke, Houdini and Karma, RenderMan, Blender, Arnold, Unreal.
BEAUTY = ("rgba", "rgb", "beauty", "c", "ci", "combined", "finalimage", "main", "composite", "default")
SUFFIXES = {"RED": "R", "GREEN": "G", "BLUE": "B", "ALPHA": "A"}
FILE_AND_LAYER = re.compile(r"(?P<file>.*\.exr):(?P<layer>[^/\\:]+)", re.IGNORECASE | re.DOTALL)
DEPTH = "Z"  # OpenEXR's name of the channel, and of the layer


@dataclass(frozen=True)
class Part:
    """A part of a file: its number, name and channels."""

    index: int
    name: str
    channels: tuple[str, ...]


@dataclass(frozen=True)
class Layer:
    """The channels of a layer: {R, G, B, A, X, Y, Z or another name: number of the channel in the part}."""

    part: Part
    channels: dict[str, int]

    def has_colours(self) -> bool:
        """Return whether the layer has red, green and blue, or grey."""
        grey = "Y" in self.channels and "X" not in self.channels  # X and Y are of a vector
        return {"R", "G", "B"} <= self.channels.keys() or grey


@dataclass(frozen=True)
class StoredPicture:
    """Pixels as their file stores them, with nothing made of their code values, and what it says of them."""

    pixels: np.ndarray  # (H, W, C), uint8, uint16 or float32, upright, filling the display window
    names: tuple[str, ...]  # of the channels, such as R, G, B, A, or N.X
    space: colour.Space  # that the file states, or that its type implies
    straight: bool = False  # whether colours are not multiplied by alpha
    aspect: float = 1.0  # how many times as wide as high the pixels are
    unsigned: bool = False  # whether values are OpenEXR's UINT: counts or object numbers, and no light


def split_layer(path: AnyPath) -> tuple[Path, str | None]:
    """Return the file and the layer that `plate.exr:albedo` names; the layer is None where there is none.

    A file of that very name is what it is.
    """
    match = FILE_AND_LAYER.fullmatch(str(path))
    if match is None or Path(path).exists():
        return Path(path), None
    return Path(match["file"]), match["layer"]


def index_layers(parts: Iterable[Part]) -> dict[str, Layer]:
    """Return the layers of a file by name, in its order; the channels without any name are the layer "".

    A depth without a layer, the channel Z, is a layer of its own.
    """
    parts = list(parts)
    layers: dict[str, Layer] = {}
    for part in parts:
        for number, channel in enumerate(part.channels):
            layer, _, suffix = channel.rpartition(".")
            layer = layer or (part.name if len(parts) > 1 else "")
            if suffix == DEPTH and (not layer or layer.lower() in BEAUTY):
                layer = DEPTH
            if layer in layers and layers[layer].part is not part:
                continue  # two parts of one name, such as two views: the first
            key = SUFFIXES.get(suffix.upper(), suffix.upper() if len(suffix) == 1 else suffix)
            layers.setdefault(layer, Layer(part, {})).channels.setdefault(key, number)
    return layers


def find_beauty(layers: dict[str, Layer]) -> Layer:
    """Return the picture itself: the channels without a layer, else the only layer with a name of `BEAUTY`.

    ValueError that names the layers there are.
    """
    if "" in layers and layers[""].has_colours():
        return layers[""]
    for word in BEAUTY:
        for name, layer in layers.items():
            if layer.has_colours() and word in name.lower().split("."):
                return layer
    if "" in layers and len(layers) == 1:
        return layers[""]
    names = ", ".join(name for name in layers if name) or "none"
    raise ValueError(
        f"holds no picture that is known by its name, but the layers {names}; choose one with layer=, or as "
        "in plate.exr:NAME"
    )


def find_layer(layers: dict[str, Layer], name: str) -> Layer:
    """Return a layer by its name; ValueError that names the layers.

    Where only one fits, its case does not count, and `Combined` is enough for `ViewLayer.Combined`.
    """
    if name in layers:
        return layers[name]
    wanted = name.lower()
    for fits in (lambda other: other == wanted, lambda other: other.endswith(f".{wanted}")):
        alike = [layer for other, layer in layers.items() if fits(other.lower())]
        if len(alike) == 1:
            return alike[0]
    names = ", ".join(other for other in layers if other)
    expected = f"expected one of {names}" if names else "the file has no layers"
    raise ValueError(f"layer: {expected}, got {shown(name)}")
