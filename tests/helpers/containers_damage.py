"""Damaged files of what other programs write: pictures of every container, scenes, and analysed shots.

Kinds of hostile inputs, as `fuzzing` describes them.
"""

import json
import re
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import OpenImageIO as oiio
from PIL import Image

import relight
from helpers import hostile
from helpers.damage import kept_person
from helpers.invariants import ALLOWED, require, require_finite, require_named
from relight.lights.moving import MovingLight
from relight.pipeline.cache import AnalysisCache, frame_file
from relight.pipeline.plate_metadata import VERSION
from relight.subject import weights

# By OpenImageIO: the suffix, its type, and an attribute of the file.
WRITTEN = (
    ("bmp", "uint8", ""), ("tga", "uint8", ""), ("tga", "uint8", "compression=rle"), ("webp", "uint8", ""),
    ("gif", "uint8", ""), ("jxl", "uint8", ""), ("dpx", "uint10", ""), ("dpx", "uint16", ""),
    ("hdr", "float", ""), ("ppm", "uint8", ""), ("pfm", "float", ""), ("j2c", "uint8", ""),
    ("sgi", "uint16", ""), ("iff", "uint8", ""), ("ico", "uint8", ""), ("fits", "float", ""),
    ("rla", "uint16", ""), ("tx", "half", ""), ("tif", "float", "tiff:bigtiff=1"),
    *(("tif", "uint8", f"compression={name}") for name in ("lzw", "zip", "jpeg", "packbits")),
    *(("exr", "half", f"compression={name}") for name in ("piz", "dwaa", "b44a", "pxr24", "rle", "htj2k")),
)  # fmt: skip
BY_PILLOW = (
    ("avif", "AVIF"),
    ("heic", "HEIF"),
    ("webp", "WEBP"),
    ("jpg", "JPEG"),
    ("png", "PNG"),
    ("gif", "GIF"),
)
SCENES = (".gltf", ".glb", ".usda", ".usdc", ".usdz")
LIGHTS = (
    relight.DirectionalLight(azimuth=-40, elevation=30, angle=5, name="key"),
    relight.PointLight((0.5, 0.2, 1), toward=(0, 0, 0), radius=0.1, cone=40, temperature=3000, name="lamp"),
    relight.RectLight((-0.5, 0.2, 1), (0, 0, 0), 0.4, 0.3, name="panel"),
)


def foreign_image(random: Random, folder: Path) -> None:
    """A damaged picture of any container that is read."""
    whole = random.choice(_pictures(folder))
    path = folder / f"foreign{whole.suffix}"
    path.write_bytes(hostile.damaged(random, whole.read_bytes()))
    try:
        picture = relight.read(path)
    except ALLOWED as error:
        require_named(path, error)
        raise
    require(picture.ndim == 3 and picture.shape[-1] in (3, 4) and picture.dtype == np.float32, "no picture")
    require_finite("read", picture)


def _pictures(folder: Path) -> list[Path]:
    """Return the whole pictures; they are written once for a folder."""
    whole = folder / "whole"
    if not whole.exists():
        whole.mkdir()
        pixels = np.random.default_rng(1).uniform(0, 1, (24, 20, 4)).astype(np.float32)
        for number, (suffix, kind, stated) in enumerate(WRITTEN):
            path = whole / f"{number}.{suffix}"
            file, spec = oiio.ImageOutput.create(str(path)), oiio.ImageSpec(20, 24, 3, kind)
            if stated:
                name, value = stated.split("=")
                spec.attribute(name, int(value) if value.isdecimal() else value)
            require(file.open(str(path), spec), f"{path.name} can be written")
            file.write_image(np.ascontiguousarray(pixels[..., :3]))
            file.close()
        _save_by_pillow(whole, (pixels * 255).astype(np.uint8))
    return sorted(whole.iterdir())


def _save_by_pillow(folder: Path, codes: np.ndarray) -> None:
    try:
        import pillow_heif
    except ImportError:
        pass
    else:
        pillow_heif.register_heif_opener()
    for suffix, kind in BY_PILLOW:
        if kind not in Image.SAVE:
            continue
        picture = Image.fromarray(codes if kind not in ("JPEG", "GIF") else codes[..., :3])
        picture.save(folder / f"pillow.{suffix}", kind)
        if kind in ("GIF", "PNG", "WEBP", "AVIF"):
            more = Image.fromarray(255 - np.array(picture))
            picture.save(folder / f"animated.{suffix}", kind, save_all=True, append_images=[more])


def scene(random: Random, folder: Path) -> None:
    """The lights of a damaged glTF or USD scene."""
    whole = folder / f"scene{random.choice(SCENES)}"
    if not whole.exists():
        lights = LIGHTS if whole.suffix.startswith(".usd") else LIGHTS[:2]
        relight.write_lights(whole, lights)
    path = folder / f"damaged{whole.suffix}"
    content = whole.read_bytes()
    if whole.suffix in (".gltf", ".usda") and random.random() < 0.7:
        path.write_bytes(_edited_text(random, content.decode()).encode("utf-8", "surrogatepass"))
    else:
        path.write_bytes(hostile.damaged(random, content))
    try:
        lights = relight.read_lights(path)
    except ALLOWED as error:
        require_named(path, error)
        raise
    for light in lights:
        still = light.at(1) if isinstance(light, MovingLight) else light
        require(np.isfinite(still.power).all() and np.min(still.power) >= 0, "NaN or negative light")
        if isinstance(still, relight.DirectionalLight):
            require(np.isfinite(still.direction).all(), "no direction")


def usd_crate(random: Random, folder: Path) -> None:
    """The lights of a USD stage whose binary layer has a few other bytes, or which draws in such a layer."""
    whole = folder / "crate.usdc"
    if not whole.exists():
        _write_stage(whole)
    data = bytearray(whole.read_bytes())
    for _ in range(random.choice([1, 1, 2, 3, 8])):
        at = random.randrange(len(data))
        data[at] = random.choice([0, 1, 127, 255, data[at] ^ 1 << random.randrange(8), random.randrange(256)])
    damaged = folder / "spoilt.usdc"
    damaged.write_bytes(data if random.random() < 0.95 else data[: random.randrange(len(data))])
    path = folder / random.choice(["spoilt.usdc", "spoilt.usdc", "drawn.usda"])
    if path.suffix == ".usda":
        path.write_text("#usda 1.0\n(\n    subLayers = [@./spoilt.usdc@]\n)\n")
    try:
        lights = relight.read_lights(path, subject_at=(0, 0, 0))
    except ALLOWED as error:
        require_named(path, error)
        raise
    for light in lights:
        require(isinstance(light.name, str), "no name")


def _write_stage(path: Path) -> None:
    """A stage of lights that move, a camera, a variant, a reference and arrays."""
    from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, Vt

    stage: Any = Usd.Stage.CreateNew(str(path))
    world = UsdGeom.Xform.Define(stage, "/World")
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 4))
    for number, kind in enumerate((UsdLux.SphereLight, UsdLux.RectLight, UsdLux.DistantLight)):
        light = kind.Define(stage, f"/World/light{number}")
        light.CreateIntensityAttr(3.0)
        for time in (1, 2, 5):
            light.GetIntensityAttr().Set(float(time), time)
        UsdGeom.Xformable(light).AddTranslateOp().Set(Gf.Vec3d(number, 1, 2))
    copy = stage.DefinePrim("/World/copy")
    copy.GetReferences().AddInternalReference(Sdf.Path("/World/light0"))
    mesh = UsdGeom.Mesh.Define(stage, "/World/mesh")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.random.default_rng(2).normal(size=(99, 3)).astype("f4")))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.arange(99, dtype=np.int32)))
    variants = world.GetPrim().GetVariantSets().AddVariantSet("look")
    variants.AddVariant("night")
    variants.SetVariantSelection("night")
    stage.GetRootLayer().Save()


def _edited_text(random: Random, text: str) -> str:
    """Exchange a number of a scene for another one, or edit its text."""
    numbers = list(re.finditer(r"(?<![\w.])-?\d[\d.e+-]*", text))
    if numbers and random.random() < 0.6:
        number = random.choice(numbers)
        other = str(random.choice([*hostile.NUMBERS, '"x"', "[]", "()", "null", "true", "1" * 400]))
        return text[: number.start()] + other + text[number.end() :]
    return hostile.edited(random, text)


def analysed_shot(random: Random, folder: Path) -> None:
    """The analysis cache of a shot that is damaged, or says other things of what it was made from."""
    shot = folder / "shot.relight"
    shot.mkdir(exist_ok=True)
    kept = frame_file(shot, 1)
    content = kept_person(folder).read_bytes()
    end = 8 + int.from_bytes(content[:8], "little")
    header = json.loads(content[8:end])
    about = json.loads(header["__metadata__"]["relight"])
    about["provenance"] = _provenance()
    _spoil(random, about["provenance"])
    header["__metadata__"]["relight"] = json.dumps(about)
    text = json.dumps(header).encode()
    content = len(text).to_bytes(8, "little") + text + content[end:]
    kept.write_bytes(hostile.damaged(random, content) if random.random() < 0.2 else content)
    cache = AnalysisCache(shot)
    try:
        for stated in (cache.rate, cache.field_of_view, cache.pixel_aspect):
            require(stated is None or stated > 0, f"{stated} is no rate, angle or aspect")
        cache.plate_metadata(1)
        person = cache.read(1)
    except ALLOWED as error:
        require_named(shot, error)
        raise
    require_finite("relit", person.relit([relight.DirectionalLight()]))


def _provenance() -> dict[str, Any]:
    return {
        "weights": list(weights()), "content_hash": "0" * 32, "options": {"mask": None}, "sources": [],
        "precision": "float32", "rate": "24", "field_of_view": 25.0, "pixel_aspect": 1.0,
        "plate_metadata": {
            "version": VERSION, "header": {"owner": ["string", "x"], "lens": ["float", 35.0]},
            "timecode": "01:00:00:00", "tags": {"title": "x"}, "sound": "sound.mov", "shown": ["0", "1/24"],
        },
    }  # fmt: skip


def _spoil(random: Random, tree: dict[str, Any]) -> None:
    """Exchange a value, or leave it out, once or twice, somewhere in nested objects."""
    for _ in range(random.randrange(1, 3)):
        branch = tree
        key = random.choice([*branch])
        while isinstance(branch[key], dict) and branch[key] and random.random() < 0.7:
            branch = branch[key]
            key = random.choice([*branch])
        if random.random() < 0.2 and len(branch) > 1:
            del branch[key]
        else:
            branch[key] = random.choice(
                [
                    *hostile.NUMBERS[:30],
                    *hostile.WORDS[:20],
                    None,
                    [],
                    {},
                    [[]],
                    [1, "x"],
                    {"path": 3},
                    "1/0",
                    "24/1",
                ]
            )
