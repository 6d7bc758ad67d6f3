"""Files that state hostile things of themselves: ICC profiles, Exif data, and the tags of containers.

Kinds of hostile inputs, as `fuzzing` describes them.
"""

import struct
from pathlib import Path
from random import Random

import numpy as np
from PIL import Image

import relight
from helpers import foreign_files, hostile
from helpers.icc_profiles import SRGB, icc_profile
from helpers.invariants import ALLOWED, require, require_finite, require_named
from helpers.stored import store

CODES = foreign_files.ramp(24, 20)
PROFILES: list[bytes] = []
KEPT = {"jpg": "JPEG", "png": "PNG", "webp": "WEBP", "tif": "TIFF", "avif": "AVIF"}
CHUNKS = ("cICP", "gAMA", "cHRM", "sRGB", "pHYs", "sBIT", "tRNS", "eXIf", "mDCV", "cLLI")
RADIANCE = ("EXPOSURE", "COLORCORR", "PRIMARIES", "PIXASPECT", "FORMAT", "GAMMA", "SOFTWARE", "VIEW")
EXR = (
    "chromaticities", "adoptedNeutral", "PixelAspectRatio", "oiio:ColorSpace", "whiteLuminance",
    "acesImageContainerFlag", "Orientation", "framesPerSecond", "colorInteropID",
)  # fmt: skip


def icc_bytes(random: Random, folder: Path) -> None:
    """A picture whose ICC profile is damaged."""
    if not PROFILES:
        table = struct.pack(">4s4xI4H", b"curv", 4, 0, 9000, 30000, 65535)
        PROFILES.extend(icc_profile("x", curve, "Display P3") for curve in (SRGB, table))
        PROFILES.append(icc_profile("x", SRGB, kind=b"GRAY"))
    suffix = random.choice([*KEPT])
    profile = hostile.damaged(random, random.choice(PROFILES))
    path = folder / f"profile.{suffix}"
    Image.fromarray(CODES).save(path, KEPT[suffix], icc_profile=profile)
    _read(path)


def exif_bytes(random: Random, folder: Path) -> None:
    """A picture whose Exif data is damaged."""
    exif = foreign_files.exif(
        Orientation=random.choice([0, 1, 6, 9, 65535]), ColorSpace=random.choice([1, 2, 65535, 7]),
        InteroperabilityIndex=random.choice(["R03", "R98", ""]), Gamma=random.choice([0.1, 2.2, 0.0, 99.0]),
        WhitePoint=(0.31, 0.33), PrimaryChromaticities=(0.64, 0.33, 0.3, 0.6, 0.15, 0.06),
    )  # fmt: skip
    suffix = random.choice(["jpg", "png", "webp"])  # of an AVIF, Pillow parses it to write it
    path = folder / f"exif.{suffix}"
    Image.fromarray(CODES).save(path, KEPT[suffix], exif=hostile.damaged(random, exif)[:60000])
    _read(path)


def container_tags(random: Random, folder: Path) -> None:
    """A picture whose header says odd things, each as its container stores it."""
    kind = random.choice([_png, _radiance, _bmp, _exr, _pnm, _targa, _tiff])
    _read(kind(random, folder))


def _read(path: Path) -> None:
    read = relight.read if path.suffix != ".pgm" else relight.read_mask
    try:
        picture = read(path)
    except ALLOWED as error:
        require_named(path, error)
        raise
    require(picture.dtype == np.float32 and min(picture.shape) > 0, "no picture")
    require_finite("read", picture)


def _bytes(random: Random, count: int) -> bytes:
    return bytes(random.choice([0, 1, 2, 9, 16, 18, 128, 255, random.randrange(256)]) for _ in range(count))


def _png(random: Random, folder: Path) -> Path:
    sizes = {"cICP": 4, "gAMA": 4, "cHRM": 32, "sRGB": 1, "pHYs": 9}
    names = random.sample(CHUNKS, random.randrange(1, 4))
    chunks = {
        name: _bytes(random, sizes.get(name, 6) if random.random() < 0.9 else random.randrange(40))
        for name in names
    }
    path = folder / "tags.png"
    foreign_files.png(path, CODES.astype(random.choice([np.uint8, np.uint16])), **chunks)
    return path


def _radiance(random: Random, folder: Path) -> Path:
    def value(name: str) -> str:
        count = {"COLORCORR": 3, "PRIMARIES": 8}.get(name, 1)
        words = [str(random.choice([*hostile.NUMBERS, 0.3, 0.6, *hostile.WORDS[:8]])) for _ in range(count)]
        return " ".join(words).encode("ascii", "replace").decode()

    lines = [f"{name}={value(name)}" for name in random.sample(RADIANCE, random.randrange(4))]
    path = folder / "tags.hdr"
    kind = random.choice(["32-bit_rle_rgbe", "32-bit_rle_xyze", "32-bit_rle_xyz", ""])
    foreign_files.radiance(path, _bytes(random, 4), *lines, kind=kind)
    return path


def _bmp(random: Random, folder: Path) -> Path:
    path = folder / "tags.bmp"
    foreign_files.bmp(
        path, np.dstack([CODES, CODES[..., 0]]), compression=random.choice([0, 0, 1, 2, 3, 3, 6, 99]),
        alpha_mask=random.choice([0, 0xFF000000, 0xFF]), header=random.choice([40, 52, 56, 108, 124]),
        colour=random.choice([b"BGRs", bytes(4), b"KNIL", b"DEBM", b" niW"]) + _bytes(random, 48),
    )  # fmt: skip
    return path


def _exr(random: Random, folder: Path) -> Path:
    stated = {}
    for name in random.sample(EXR, random.randrange(1, 4)):
        count = {"chromaticities": 8, "adoptedNeutral": 2}.get(name, 0)
        numbers = [float(random.choice([*hostile.NUMBERS[:18], 0.3, 0.3, 0.6, 0.6])) for _ in range(count)]
        single = random.choice([1.0, 2.0, 3, 1e-3, "lin_ap1", "x", "日本"])
        stated[name.replace(":", "__")] = tuple(numbers) if count else single
    return store(folder / "tags.exr", CODES.astype(np.float32) / 255, "half", **stated)


def _pnm(random: Random, folder: Path) -> Path:
    kind = random.choice(["P1", "P2", "P3", "P4", "P5", "P6", "PF", "Pf", "P7"])
    words = [random.choice(["4", "3", "0", "-1", "255", "65535", "99999999", "-1.0", "x"]) for _ in range(3)]
    path = folder / f"tags.{'pfm' if 'f' in kind.lower() else random.choice(['ppm', 'pgm'])}"
    path.write_bytes("\n".join([kind, *words, ""]).encode() + _bytes(random, random.choice([0, 12, 200])))
    return path


def _targa(random: Random, folder: Path) -> Path:
    path = folder / "tags.tga"
    head = bytearray(struct.pack("<BBB5xHHHHBB", 0, 0, 2, 0, 0, 8, 8, 32, 0x28))
    for _ in range(random.randrange(4)):
        head[random.randrange(len(head))] = _bytes(random, 1)[0]
    path.write_bytes(bytes(head) + _bytes(random, 256))
    return path


def _tiff(random: Random, folder: Path) -> Path:
    stated = {
        "Orientation": random.choice([0, 1, 6, 9, 65535]),
        "PixelAspectRatio": random.choice([0.0, 1.0, 2.0, -1.0, 1e9, float("nan")]),
        "ICCProfile__x": random.choice(hostile.WORDS[:6]),
    }
    depth = random.choice(["uint8", "uint16", "uint32", "int8", "half", "float", "double"])
    return store(folder / "tags.tif", CODES.astype(np.float32) / 255, depth, **stated)
