"""Hostile inputs, and what must hold whatever comes: shared by test_fuzz.py and benchmarks/fuzz.py.

A kind of input is a function of a `random.Random` and a folder to write to. It draws an input, hands it to
the library, and checks the invariants of the answer. The library may refuse it, with one of the errors that
it documents. Whatever else is raised is a bug: `Violation` where an invariant broke.
"""

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

import hostile
import numpy as np
import torch
import yaml

import relight
from relight.lights.light import by_name
from shadow import analysis

REFUSED, ANSWERED = "refused", "answered"
ALLOWED = (ValueError, TypeError, OSError)
SMALL_CANVAS = 128  # pixels in height, on which seven of eight pictures are analysed
LONGEST = 2000  # characters of an error: a line that a person reads


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
    """Equal to `tolerance`, relative to the largest value of the other."""
    require(one.shape == other.shape, f"{what}: {one.shape} and {other.shape}")
    scale = np.abs(other).max(initial=1e-30).astype(np.float64)
    worst = np.abs(one.astype(np.float64) - other).max(initial=0) / scale
    require(worst <= tolerance, f"{what}: {worst:.3g} of the largest value apart")


# Lights


def light_text(random: Random, folder: Path) -> None:
    """A light as the command line takes it."""
    settings = []
    for key in random.sample(hostile.PARAMETERS, random.randrange(4)):
        count = (3 if key in hostile.VECTORS else 1) if random.random() < 0.9 else random.choice([1, 2, 3, 4])
        settings.append(f"{key}={'/'.join(hostile.text_value(random, key) for _ in range(count))}")
    name = random.choice(["", "key:", "key:", f"{random.choice(hostile.WORDS)}:"])
    text = name + ",".join(settings)
    if random.random() < 0.3:
        text = hostile.edited(random, text)
    if random.random() < 0.1:
        relight.EnvironmentLight.parse(text.replace("\n", ""))
        raise Violation(f"{text!r} made an environment without a file")
    _check_light(relight.DirectionalLight.parse(text))


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
    document: Any = {"lights": [hostile.light_entry(random) for _ in range(random.randrange(4))]}
    if random.random() < 0.15:
        document = random.choice(
            [document["lights"], None, 3, {"lights": {}}, {"lamps": []}, [], {"lights": 1}]
        )
    if suffix == ".json":
        text = json.dumps(document, default=str)
    else:
        text = yaml.safe_dump(document, allow_unicode=True, default_flow_style=random.choice([True, False]))
    if random.random() < 0.3:
        text = hostile.edited(random, text)
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    if random.random() < 0.1:
        path.write_bytes(hostile.damaged(random, path.read_bytes()))
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
    path = _damaged_file(random, folder, grey=random.random() < 0.7)
    try:
        mask = relight.read_mask(path)
    except ALLOWED as error:
        require(str(path) in str(error), f"an error that doesn't name the file: {error}")
        raise
    require(mask.ndim == 2 and mask.dtype == np.float32, "no matte")
    require(mask.min() >= 0 and mask.max() <= 1, "matte out of [0, 1]")


def _damaged_file(random: Random, folder: Path, grey: bool = False) -> Path:
    suffix, depth, alpha = random.choice(hostile.GREY if grey else hostile.FORMATS)
    whole = folder / f"whole-{grey}-{depth}-{alpha}{suffix}"  # the same for all inputs of a folder
    if grey and not whole.exists():
        relight.write_mask(whole, np.random.default_rng(1).uniform(0, 1, (24, 20)), depth=depth)
    elif not whole.exists():
        pixels = np.random.default_rng(1).uniform(0, 1, (24, 20, 4 if alpha else 3)).astype(np.float32)
        pixels[..., :3] *= pixels[..., 3:] if alpha else 1
        relight.write(whole, pixels, depth=depth)
    path = folder / f"damaged{random.choice([suffix] * 9 + ['.png', '.exr', '.jpg'])}"
    damaged = hostile.damaged(random, whole.read_bytes())
    path.write_bytes(hostile.resealed(damaged) if suffix == ".png" and random.random() < 0.7 else damaged)
    return path


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
    size = hostile.size(random)
    spoil = random.random() < 0.25
    image, mask = hostile.photograph(random, rng, size), hostile.matte(random, rng, size)
    if spoil:
        image, mask = hostile.spoilt(random, rng, image), hostile.spoilt(random, rng, mask)
    lights = [hostile.lamp(random, spoil) for _ in range(random.randrange(1, 4))]
    # The networks' own canvas costs nine times as much, and nothing else about it is different.
    height = random.choice([None, *[SMALL_CANVAS] * 7])
    field = analysis.load(device=torch.device("cpu"))
    with mock.patch.object(field, "size", height or field.size):
        _apply(random, folder, image, mask, lights)


def _apply(
    random: Random, folder: Path, image: np.ndarray, mask: np.ndarray, lights: list[relight.DirectionalLight]
) -> None:
    subject = relight.Subject(image, mask)
    picture = subject.relit(lights)
    require(picture.dtype == np.float32 and picture.shape == (*image.shape[:2], 4), "no picture")
    require_finite("relit", picture)
    require(np.array_equal(picture[..., 3], subject.matte), "alpha is not the matte")
    require_same("alpha and the mask given", picture[..., 3], _as_float(mask), 1e-3)
    require(not picture[..., :3][picture[..., 3] == 0].any(), "light where nobody is")
    layers = subject.layers([_scaled(light, 2) for light in by_name(lights).values()])
    total = sum(layer[..., :3].astype(np.float64) for layer in layers.values())
    require_same("sum of the layers of lights twice as bright", total, 2 * picture[..., :3])
    for name in ("albedo", "normals"):
        require_finite(name, getattr(subject, name))
    if random.random() < 0.05 and image.dtype in (np.uint8, np.uint16, np.float32):
        plate, depth = folder / ("plate.exr" if image.dtype == np.float32 else "plate.tif"), image.dtype.name
        relight.write(plate, image, depth=depth.replace("float32", "float"))
        same = relight.apply(relight.read(plate), lights, mask=mask)
        require_same("the plate from a file", same, picture, 1e-3)


def _as_float(mask: np.ndarray) -> np.ndarray:
    scale = np.iinfo(mask.dtype).max if mask.dtype.kind == "u" else 1
    return (mask / scale).astype(np.float32)


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
