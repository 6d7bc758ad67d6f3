"""Hostile inputs, and what must hold whatever comes: shared by test_fuzz.py and benchmarks/fuzz.py.

A kind of input is a function of a `random.Random` and a folder to write to. It draws an input, hands it to
the library, and checks the invariants of the answer. The library may refuse it, with one of the errors that
it documents. Whatever else is raised is a bug: `Violation` where an invariant broke.
"""

import json
import struct
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import yaml

import relight
from relight.lights.light import by_name

REFUSED, ANSWERED = "refused", "answered"
ALLOWED = (ValueError, TypeError, OSError)
LONGEST = 2000  # characters of an error: a line that a person reads

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


class Violation(AssertionError):
    """An answer that breaks an invariant, or an error that no person could use."""


def outcome(kind: str, random: Random, folder: Path) -> str:
    """What became of one input of a kind: REFUSED or ANSWERED; raises whatever is a bug."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            KINDS[kind](random, folder)
        except ALLOWED as error:
            if isinstance(error, UnicodeError):
                raise
            text = str(error)
            require(text.strip() and "\n" not in text and len(text) < LONGEST, f"error of no use: {text!r}")
            return REFUSED
    return ANSWERED


def require(holds: Any, what: str) -> None:
    if not holds:
        raise Violation(what)


def require_finite(name: str, array: np.ndarray) -> None:
    require(np.isfinite(array).all(), f"{name}: NaN or infinite")


def require_same(what: str, one: np.ndarray, other: np.ndarray, tolerance: float = 1e-5) -> None:
    """Equal to `tolerance`, relative to each value and to the largest value of the picture."""
    require(one.shape == other.shape, f"{what}: {one.shape} and {other.shape}")
    scale = np.abs(other).max(initial=1e-30).astype(np.float64)
    worst = np.abs(one.astype(np.float64) - other).max(initial=0) / scale
    require(worst <= tolerance, f"{what}: {worst:.3g} of the largest value apart")


# Lights


def light_text(random: Random, folder: Path) -> None:
    """A light as the command line takes it."""
    settings = []
    for key in random.sample(PARAMETERS, random.randrange(4)):
        count = (3 if key in VECTORS else 1) if random.random() < 0.9 else random.choice([1, 2, 3, 4])
        settings.append(f"{key}={'/'.join(_text_value(random, key) for _ in range(count))}")
    name = random.choice(["", "key:", "key:", f"{random.choice(WORDS)}:"])
    text = name + ",".join(settings)
    if random.random() < 0.3:
        text = _edited(random, text)
    if random.random() < 0.1:
        relight.EnvironmentLight.parse(text.replace("\n", ""))
        raise Violation(f"{text!r} made an environment without a file")
    _check_light(relight.DirectionalLight.parse(text))


def _text_value(random: Random, key: str) -> str:
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


def _check_light(light: Any) -> None:
    """What comes of a light: unit directions, light that is no NaN and not negative."""
    directions, powers = light.samples()
    require(len(directions) == len(powers) > 0, "no directions")
    require(
        np.allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-4), "directions of other lengths than 1"
    )
    require(not np.isnan(powers).any() and powers.min() >= 0, "NaN or negative light")


def lights_file(random: Random, folder: Path) -> None:
    """A lights file, YAML or JSON: well-formed with odd values, or broken text."""
    suffix = random.choice([".yaml", ".yml", ".json"])
    path = folder / f"lights{suffix}"
    document: Any = {"lights": [_entry(random) for _ in range(random.randrange(4))]}
    if random.random() < 0.15:
        document = random.choice(
            [document["lights"], None, 3, {"lights": {}}, {"lamps": []}, [], {"lights": 1}]
        )
    if suffix == ".json":
        text = json.dumps(document, default=str)
    else:
        text = yaml.safe_dump(document, allow_unicode=True, default_flow_style=random.choice([True, False]))
    if random.random() < 0.3:
        text = _edited(random, text)
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    if random.random() < 0.1:
        path.write_bytes(_damaged(random, path.read_bytes()))
    try:
        lights = relight.read_lights(path)
    except ALLOWED as error:
        require(str(path) in str(error), f"an error that doesn't name the file: {error}")
        raise
    for light in lights:
        _check_light(light.at(random.choice([1, 7, 50])) if hasattr(light, "at") else light)
    again = folder / f"again{random.choice(['.yaml', '.json'])}"
    relight.write_lights(again, lights)
    back = relight.read_lights(again)
    require(len(back) == len(lights), "written and read again, other lights")
    for one, other in zip(lights, back, strict=True):
        require(
            type(one) is type(other) and one.settings() == other.settings(),
            "written and read again, another light",
        )


def _entry(random: Random) -> Any:
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


def _edited(random: Random, text: str) -> str:
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


# Files


def damaged_image(random: Random, folder: Path) -> None:
    """A picture's file with bytes changed, cut off, doubled or shuffled."""
    path = _damaged_file(random, folder)
    try:
        picture = relight.read(path)
    except ALLOWED as error:
        require(str(path) in str(error), f"an error that doesn't name the file: {error}")
        raise
    require(picture.ndim == 3 and picture.shape[-1] in (3, 4) and picture.dtype == np.float32, "no picture")
    require_finite("read", picture)


def damaged_mask(random: Random, folder: Path) -> None:
    """The same as a matte."""
    path = _damaged_file(random, folder)
    try:
        mask = relight.read_mask(path)
    except ALLOWED as error:
        require(str(path) in str(error), f"an error that doesn't name the file: {error}")
        raise
    require(mask.ndim == 2 and mask.dtype == np.float32, "no matte")
    require(mask.min() >= 0 and mask.max() <= 1, "matte out of [0, 1]")


def _damaged_file(random: Random, folder: Path) -> Path:
    suffix, depth, alpha = random.choice(FORMATS)
    whole = folder / f"whole-{depth}-{alpha}{suffix}"  # the same for all inputs of a folder
    if not whole.exists():
        pixels = np.random.default_rng(1).uniform(0, 1, (24, 20, 4 if alpha else 3)).astype(np.float32)
        pixels[..., :3] *= pixels[..., 3:] if alpha else 1
        relight.write(whole, pixels, depth=depth)
    path = folder / f"damaged{random.choice([suffix] * 9 + ['.png', '.exr', '.jpg'])}"
    damaged = _damaged(random, whole.read_bytes())
    path.write_bytes(_resealed(damaged) if suffix == ".png" and random.random() < 0.7 else damaged)
    return path


FORMATS = [
    (".png", "uint8", False), (".png", "uint8", True), (".png", "uint16", True), (".tif", "uint16", True),
    (".tif", "float", False), (".jpg", "uint8", False), (".exr", "half", True), (".exr", "float", False),
    (".hdr", "float", False),
]  # fmt: skip


def _damaged(random: Random, content: bytes) -> bytes:
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


def _resealed(content: bytes) -> bytes:
    """A PNG whose chunks have the checksums that fit, so that damage gets past them."""
    data, here = bytearray(content), 8
    while here + 12 <= len(data):
        end = here + 8 + struct.unpack_from(">I", data, here)[0]
        if end + 4 > len(data):
            break
        struct.pack_into(">I", data, end, zlib.crc32(data[here + 4 : end]))
        here = end + 4
    return bytes(data)


def containers(random: Random, folder: Path) -> None:
    """The same pixels in two files, and in a file and none."""
    rng = np.random.default_rng(random.randrange(2**32))
    shape = (random.randrange(1, 40), random.randrange(1, 40), random.choice([3, 4]))
    dtype = random.choice([np.uint8, np.uint16])
    pixels = rng.integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)
    depth = np.dtype(dtype).name
    pictures = []
    for name in ("one.png", "other.tif"):
        relight.write(folder / name, pixels, depth=depth)
        pictures.append(relight.read(folder / name))
        require_finite(name, pictures[-1])
    require_same("PNG and TIFF", *pictures)
    relight.write(folder / "light.exr", pictures[0], depth="float")
    require(
        np.array_equal(relight.read(folder / "light.exr"), pictures[0]), "other floats from an OpenEXR file"
    )
    relight.write(folder / "light.tif", pictures[0], depth="float")
    require_same("floats from a TIFF", relight.read(folder / "light.tif"), pictures[0], 1e-6)
    opaque = pictures[0][..., :3]
    relight.write(folder / "light.hdr", opaque)
    require_same("HDR", relight.read(folder / "light.hdr"), opaque, 0.01)


# Pictures


def apply(random: Random, folder: Path) -> None:
    """A photograph, a matte and lights, through the networks; half of them such as may be refused."""
    rng = np.random.default_rng(random.randrange(2**32))
    size = random.randrange(8, 64), random.randrange(8, 64)
    hostile = random.random() < 0.3
    image, mask = _photograph(random, rng, size), _matte(random, rng, size)
    if hostile:
        image, mask = _spoilt(random, rng, image), _spoilt(random, rng, mask)
    lights = [_lamp(random, hostile) for _ in range(random.randrange(1, 4))]
    subject = relight.Subject(image, mask)
    picture = subject.relit(lights)
    require(picture.dtype == np.float32 and picture.shape == (*image.shape[:2], 4), "no picture")
    require_finite("relit", picture)
    require(np.array_equal(picture[..., 3], subject.matte), "alpha is not the matte")
    require_same("alpha and the mask given", picture[..., 3], _as_float(mask), 1e-3)
    require(not picture[..., :3][picture[..., 3] == 0].any(), "light where nobody is")
    layers = subject.layers(by_name(lights).values())
    total = sum(layer[..., :3].astype(np.float64) for layer in layers.values())
    require_same("sum of the layers", total, picture[..., :3])
    brighter = subject.relit([_scaled(light, 2) for light in lights])
    require_same("twice the intensity", brighter[..., :3], 2 * picture[..., :3])
    for name in ("albedo", "normals"):
        require_finite(name, getattr(subject, name))
    if random.random() < 0.2 and image.dtype in (np.uint8, np.uint16):
        relight.write(folder / "plate.tif", image, depth=image.dtype.name)
        same = relight.apply(relight.read(folder / "plate.tif"), lights, mask=mask)
        require_same("the plate from a file", same, picture, 1e-3)


def _photograph(random: Random, rng: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
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


def _matte(random: Random, rng: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
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


def _spoilt(random: Random, rng: np.random.Generator, array: np.ndarray) -> Any:
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


def _as_float(mask: np.ndarray) -> np.ndarray:
    scale = np.iinfo(mask.dtype).max if mask.dtype.kind == "u" else 1
    return (mask / scale).astype(np.float32)


def _lamp(random: Random, hostile: bool) -> relight.DirectionalLight:
    """A light, seldom one that is too bright for any picture."""
    intensity = random.choice(
        [*NUMBERS[:20]] if hostile and random.random() < 0.3 else [0, 0.1, 1, 1, 2.5, 100]
    )
    direction = [random.gauss(0, 1) for _ in range(3)]
    return relight.DirectionalLight(
        direction,
        intensity=intensity,
        colour=[random.uniform(0, 1) for _ in range(3)],
        angle=random.choice([0, 0, 0, 10, 180]),
        temperature=random.choice([None, None, 1000, 5000, 40000]),
    )


def _scaled(light: relight.DirectionalLight, factor: float) -> relight.DirectionalLight:
    return relight.DirectionalLight(
        light.direction,
        **{
            key: getattr(light, key)
            for key in ("colour", "angle", "temperature", "exposure", "locus", "name")
        },
        intensity=factor * light.intensity,
    )


KINDS: dict[str, Callable[[Random, Path], None]] = {
    "light text": light_text,
    "lights file": lights_file,
    "damaged image": damaged_image,
    "damaged mask": damaged_mask,
    "containers": containers,
    "apply": apply,
}
