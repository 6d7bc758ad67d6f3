"""Hostile inputs, and what must hold whatever comes: shared by test_fuzz.py and benchmarks/fuzz.py.

A kind of input is a function of a `random.Random` and a folder to write to. It draws an input, hands it to
the library, and checks the invariants of the answer. The library may refuse it, with one of the errors that
it documents. Whatever else is raised is a bug: `Violation` where an invariant broke.
"""

import json
import warnings
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import yaml

import relight
from helpers import hostile
from helpers.app_requests import app_request
from helpers.commandlines import command_line
from helpers.containers_damage import analysed_shot, foreign_image, scene, usd_crate
from helpers.damage import (
    containers,
    damaged_analysis,
    damaged_image,
    damaged_mask,
    damaged_movie,
    damaged_weights,
    kept_person,
    kept_shapes,
    small_canvas,
)
from helpers.foreign_networks import onnx_model
from helpers.fragments import page_fragment
from helpers.invariants import (
    ALLOWED,
    Violation,
    require,
    require_finite,
    require_named,
    require_same,
    require_usable,
)
from helpers.statements import container_tags, exif_bytes, icc_bytes
from relight.lights.moving import MovingLight, parse
from relight.lights.rig import by_name

REFUSED, ANSWERED = "refused", "answered"


def outcome(kind: str, random: Random, folder: Path) -> str:
    """What became of one input of a kind: REFUSED or ANSWERED; raises whatever is a bug."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            KINDS[kind](random, folder)
        except ALLOWED as error:
            if isinstance(error, UnicodeError):
                raise
            require_usable(str(error))
            return REFUSED
    return ANSWERED


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


def lamp_text(random: Random, folder: Path) -> None:
    """A light of any kind as the command line takes it, most of them in the room, on a person who is kept."""
    kinds = {"radius": ["position"], "height": ["position", "toward", "width"], "angle": [], "orbit": []}
    last = random.choice([*kinds])
    keys = [*kinds[last], last, *random.sample(["intensity", "colour", "exposure", "temperature"], 1)]
    settings = []
    for key in keys:
        count = 3 if key in ("position", "toward", "colour") else 1
        settings.append(f"{key}={'/'.join(_lamp_value(random, key) for _ in range(count))}")
    text = random.choice(["", "lamp:"]) + ",".join(settings)
    light = parse(hostile.edited(random, text) if random.random() < 0.1 else text)
    if isinstance(light, MovingLight):
        light = light.at(random.choice([1, 2, 50]))
    subject, sun = relight.Subject.load(kept_person(folder)), relight.DirectionalLight(azimuth=40)
    picture = subject.relit(light)
    require_finite("relit", picture)
    require(picture[..., :3].min() >= 0, "negative light")
    require_same(
        "sum of two lights", subject.relit([light, sun])[..., :3], (picture + subject.relit(sun))[..., :3]
    )


def _lamp_value(random: Random, key: str) -> str:
    if random.random() < 0.1:
        return str(random.choice(hostile.NUMBERS))
    if key in ("position", "toward"):
        return str(random.choice([0, round(random.uniform(-1, 1), 2), random.uniform(-4, 4)]))
    if key in ("radius", "width", "height"):
        return str(random.choice([0, 1e-4, 0.1, random.uniform(0, 3)]))
    return hostile.text_value(random, key)


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
        require_named(path, error)
        raise
    for light in lights:
        _check_light(light.at(random.choice([1, 7, 50])) if hasattr(light, "orbit") else light)
    again = folder / f"again{random.choice(['.yaml', '.json'])}"
    relight.write_lights(again, lights)
    back = relight.read_lights(again)
    require(len(back) == len(lights), "written and read again, other lights")
    for one, other in zip(lights, back, strict=True):
        require(
            type(one) is type(other) and one.settings() == other.settings(),
            "written and read again, another light",
        )


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
    with random.choice([nullcontext, *[small_canvas] * 7])():
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
    "lamp text": lamp_text,
    "lights file": lights_file,
    "damaged image": damaged_image,
    "damaged mask": damaged_mask,
    "foreign image": foreign_image,
    "scene": scene,
    "USD crate": usd_crate,
    "analysed shot": analysed_shot,
    "app request": app_request,
    "damaged movie": damaged_movie,
    "damaged weights": damaged_weights,
    "damaged analysis": damaged_analysis,
    "containers": containers,
    "ICC bytes": icc_bytes,
    "Exif bytes": exif_bytes,
    "container tags": container_tags,
    "ONNX model": onnx_model,
    "kept shapes": kept_shapes,
    "page fragment": page_fragment,
    "apply": apply,
    "command line": command_line,
}
