"""Draws hostile inputs: odd numbers and words, edited texts, damaged bytes, spoilt pictures.

Everything is drawn from a `random.Random`, which is a seed's or Hypothesis's own.
"""

import re
import struct
import zlib
from random import Random
from typing import Any

import numpy as np

import relight

NUMBERS = [
    0, -0.0, 1, -1, 0.5, 2, 90, -90, 180, 360, 1e-6, 1e-38, 1e-45, 1e15, 1e38, 3e38, 1e39, 1e300, -1e300,
    1000, 6504, 40000, 64, -64, 10**30, float("nan"), float("inf"), -float("inf"),
]  # fmt: skip
WORDS = [
    "", " ", "on", "~", "nan", "1e3", "0x1f", "010", "1/2/3", "1//2", "日本", "a b", "a\nb", "\x00", "\ud800",
    "x" * 300, "٣", "1_0", "key:", ":", "=", ",", "daylight", "planckian", "é\u0301", "../..", "%d", "null",
]  # fmt: skip
VECTORS = ("direction", "colour")
PARAMETERS = [
    "azimuth",
    "elevation",
    "intensity",
    "colour",
    "exposure",
    "temperature",
    "locus",
    "angle",
    "name",
] * 3
PARAMETERS += ["direction", "rotation", "orbit", "image", "type"]


def text_value(random: Random, key: str) -> str:
    if random.random() < 0.1:
        return str(random.choice(NUMBERS + WORDS))
    return str(_fitting(random, key))


def _fitting(random: Random, key: str) -> Any:
    """One value that a parameter is likely to take."""
    if key == "temperature":
        return random.choice([1000, 2500.5, 6504, 40000])
    if key == "locus":
        return random.choice(["planckian", "daylight"])
    if key == "name":
        return random.choice(["key", "naïve: 3", "日本", "a b", "010", "on"])
    digits = random.randrange(6)
    low = -90 if key in ("azimuth", "elevation", "rotation", "orbit") else -1 if key == "direction" else 0
    return round(random.uniform(low, 2 if key in VECTORS else 90), digits)


def light_entry(random: Random) -> Any:
    if random.random() < 0.05:
        return random.choice([None, 3, "key", [], {}])
    keys = random.sample([*PARAMETERS, *PARAMETERS, "orbit", "colour ", 3], random.randrange(5))
    return {key: _setting(random, key) for key in keys}


def _setting(random: Random, key: Any) -> Any:
    """What stands behind a key: likely what fits, keyframes of it, or anything."""
    if random.random() < 0.1 or not isinstance(key, str):
        return _value(random)
    if random.random() < 0.15:
        return {
            random.choice([1, 2, 10, 100, 0.5]): _fitting_all(random, key)
            for _ in range(random.randrange(1, 4))
        }
    return _fitting_all(random, key)


def _fitting_all(random: Random, key: str) -> Any:
    return [_fitting(random, key) for _ in range(3)] if key in VECTORS else _fitting(random, key)


def _value(random: Random, depth: int = 0) -> Any:
    draw = random.random()
    if draw < 0.5:
        return round(random.uniform(-200, 200), random.randrange(6))
    if draw < 0.65:
        return [_value(random, 2) for _ in range(random.choice([0, 2, 3, 3, 3, 4]))]
    if draw < 0.75 and depth < 2:
        return {
            random.choice([1, 2, 10, 100, -5, 0.5, "a"]): _value(random, depth + 1)
            for _ in range(random.randrange(4))
        }
    return random.choice([*NUMBERS, *(word for word in WORDS if word != "\ud800"), None, True, False])


def edited(random: Random, text: str) -> str:
    """The text with a few pieces taken out, doubled, or of other characters."""
    pieces = list("[]{}:,-&*!|>%@`#'\"\\\t\n =/.") + [
        "<<",
        "!!python/object",
        "&a",
        "*a",
        "? ",
        "---\n",
        *WORDS,
    ]
    for _ in range(random.randrange(1, 4)):
        start = random.randrange(len(text) + 1)
        end = min(len(text), start + random.choice([0, 0, 1, 1, 5]))
        text = text[:start] + random.choice([*pieces, text[start:end] * 2, ""]) + text[end:]
    return text


FORMATS = [
    (".png", "uint8", False), (".png", "uint8", True), (".png", "uint16", True), (".tif", "uint16", True),
    (".tif", "float", False), (".jpg", "uint8", False), (".exr", "half", True), (".exr", "float", False),
    (".hdr", "float", False),
]  # fmt: skip
GREY = [
    (suffix, depth, False)
    for suffix, depth in ((".png", "uint8"), (".png", "uint16"), (".tif", "uint16"), (".exr", "half"))
]


def damaged(random: Random, content: bytes) -> bytes:
    """Bytes flipped, most in the header; cut off; pieces taken out, doubled, zeroed or set to 255."""
    data = bytearray(content)
    for _ in range(random.choice([1, 1, 1, 1, 2, 4, 16])):
        here = random.randrange(min(len(data), random.choice([64, 512, len(data), len(data)])))
        end = min(len(data), here + random.choice([1, 2, 4, 32]))
        piece = data[here:end]
        noise = [random.randrange(256) for _ in piece]
        flipped = [value ^ 1 << random.randrange(8) for value in piece]
        data[here:end] = bytes(
            random.choice([noise, flipped, flipped, [0] * len(piece), [255] * len(piece), [], [*piece] * 2])
        )
        if not data:
            break
    return bytes(data[: random.randrange(len(data) + 1)] if random.random() < 0.2 else data)


def resealed(content: bytes) -> bytes:
    """A PNG whose chunks have the checksums that fit, so that damage gets past them."""
    data, here = bytearray(content), 8
    while here + 12 <= len(data):
        end = here + 8 + struct.unpack_from(">I", data, here)[0]
        if end + 4 > len(data):
            break
        struct.pack_into(">I", data, end, zlib.crc32(data[here + 4 : end]))
        here = end + 4
    return bytes(data)


def edited_header(random: Random, content: bytes) -> bytes:
    """A safetensors file whose JSON says something else: a number exchanged, or the text edited."""
    end = 8 + int.from_bytes(content[:8], "little")
    text = content[8:end].decode(errors="replace")
    numbers = list(re.finditer(r"-?[0-9][0-9.e+-]*", text))
    if numbers and random.random() < 0.7:
        number = random.choice(numbers)
        other = random.choice([*NUMBERS, number[0] + "0", number[0][:-1], "[]", "null", "true"])
        text = text[: number.start()] + str(other) + text[number.end() :]
    else:
        text = edited(random, text)
    header = text.encode("utf-8", "surrogatepass")
    return len(header).to_bytes(8, "little") + header + content[end:]


def size(random: Random) -> tuple[int, int]:
    """(height, width) of a small picture. Two of three are upright, as persons are, and cheap."""
    height = random.randrange(4, 64)
    upright = random.random() < 2 / 3
    return height, max(2, round(height * random.uniform(0.15, 0.5))) if upright else random.randrange(4, 64)


def photograph(random: Random, rng: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
    low = rng.uniform(0, random.choice([0.01, 0.5, 1, 1, 10]), (4, 4, random.choice([3, 3, 4])))
    rows, columns = (np.linspace(0, 3.999, side).astype(int) for side in size)
    pixels = low[rows][:, columns] + rng.uniform(0, 0.05, (*size, low.shape[-1]))
    kind = random.choice(["uint8", "uint16", "float16", "float32", "float64", "black", "constant"])
    if kind.startswith("uint"):
        return (pixels.clip(0, 1) * np.iinfo(kind).max).astype(kind)
    if pixels.shape[-1] == 4:
        pixels[..., 3] = 1
    if kind == "black":
        pixels[..., :3] = 0
    if kind == "constant":
        pixels[..., :3] = 0.2
    return pixels.astype(kind if kind.startswith("float") else "float32")


def matte(random: Random, rng: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
    matte = np.zeros(size, np.float32)
    for _ in range(random.randrange(1, 4)):
        top, left = (random.randrange(side) for side in size)
        height, width = (random.randrange(1, side + 1) for side in size)
        matte[top : top + height, left : left + width] = random.choice([1, 1, 1, 0.7, 0.02])
    if random.random() < 0.3:
        matte = np.clip(matte + rng.normal(0, 0.02, size), 0, 1).astype(np.float32)
    kind = random.choice(["float32", "float32", "float64", "float16", "uint8", "uint16"])
    return (
        (matte * np.iinfo(kind).max).round().astype(kind) if kind.startswith("uint") else matte.astype(kind)
    )


def spoilt(random: Random, rng: np.random.Generator, array: np.ndarray) -> Any:
    """The array with odd values, or of another dtype, shape or order of bytes."""
    array = array.copy()
    how = random.randrange(10)
    if how < 3 and array.dtype.kind == "f":
        array[tuple(random.randrange(side) for side in array.shape)] = float(random.choice(NUMBERS[:-4]))
    elif how == 3:
        array = array[: random.randrange(array.shape[0])]
    elif how == 4:
        array = array.astype(random.choice(["bool", "int32", "complex64", "object", ">f4", ">u2", "str"]))
    elif how == 5:
        array = array[..., None]
    elif how == 6:
        array = array[::-1, ::-1].T.copy().T
    elif how == 7 and array.dtype.kind == "f":
        array *= array.dtype.type(random.choice([1e-30, 1e4, -1]))
    return array


def lamp(random: Random, spoil: bool) -> relight.DirectionalLight:
    """A light, seldom one that is too bright for any picture."""
    intensity = random.choice(
        [*NUMBERS[:20]] if spoil and random.random() < 0.3 else [0, 0.1, 1, 1, 2.5, 100]
    )
    direction = [random.gauss(0, 1) for _ in range(3)]
    return relight.DirectionalLight(
        direction,
        intensity=intensity,
        colour=[random.uniform(0, 1) for _ in range(3)],
        angle=random.choice([0, 0, 0, 0, 0, 10, 180]),
        temperature=random.choice([None, None, 1000, 5000, 40000]),
    )
