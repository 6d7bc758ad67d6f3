"""Photographs as phones and cameras write them, each file made here."""

import struct

import numpy as np
import pytest
from helpers.icc_profiles import SRGB, icc_profile
from PIL import Image

import relight
from relight.media import colour

# Orange at the top left, white at the bottom right, blue elsewhere.
CODES = np.full((64, 96, 3), (40, 60, 200), np.uint8)
CODES[:32, :48] = 230, 120, 30
CODES[40:, 60:] = 255
LIGHT = colour.decode(CODES, "sRGB")
TURNED = Image.Exif()
TURNED[0x112] = 6  # the camera was turned: the picture's top is on the right


def heic(path, picture, **info):
    pillow_heif = pytest.importorskip("pillow_heif")
    file = pillow_heif.from_pillow(picture)
    file.info.update(info)
    file.save(str(path), quality=-1, chroma=444)


def webp(path, picture, **info):
    picture.save(path, lossless=True, **info)


def avif(path, picture, **info):
    picture.save(path, quality=100, subsampling="4:4:4", **info)


def jpeg(path, picture, **info):
    picture.save(path, quality=97, subsampling=0, **info)


FORMATS = {"heic": heic, "webp": webp, "avif": avif, "jpg": jpeg}


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("turned", [False, True])
def test_photographs_stand_upright_in_their_own_colours(tmp_path, suffix, turned):
    path = tmp_path / f"a.{suffix}"
    FORMATS[suffix](path, Image.fromarray(CODES), **({"exif": TURNED.tobytes()} if turned else {}))
    expected = np.rot90(LIGHT, -1) if turned else LIGHT
    found = relight.read(path)
    assert found.shape == expected.shape
    assert np.abs(found - expected).max() < 0.05
    relight.write(tmp_path / "b.jpg", found)
    with Image.open(tmp_path / "b.jpg") as again:  # what is upright is not turned once more
        assert again.getexif().get(0x112, 1) == 1
    assert relight.read(tmp_path / "b.jpg").shape == expected.shape


@pytest.mark.parametrize("suffix", FORMATS)
def test_embedded_profiles_count(tmp_path, suffix):
    grey = Image.fromarray(np.full((64, 64, 3), (200, 100, 100), np.uint8))
    FORMATS[suffix](tmp_path / f"a.{suffix}", grey, icc_profile=icc_profile("P3", SRGB, "Display P3"))
    wide = relight.read(tmp_path / f"a.{suffix}")[32, 32]
    assert wide[0] > LIGHT.dtype.type(colour.decode(np.uint8([[[200, 100, 100]]]), "sRGB")[0, 0, 0]) + 0.02
    assert wide[1] < colour.decode(np.uint8([[[200, 100, 100]]]), "sRGB")[0, 0, 1] - 0.01


@pytest.mark.parametrize(("primaries", "higher"), [(12, True), (1, False), (9, True)])
def test_colour_said_by_numbers_counts(tmp_path, primaries, higher):
    pillow_heif = pytest.importorskip("pillow_heif")
    file = pillow_heif.from_pillow(Image.fromarray(np.full((64, 64, 3), (200, 100, 100), np.uint8)))
    file.save(str(tmp_path / "a.heic"), quality=-1, chroma=444, color_primaries=primaries)
    srgb = colour.decode(np.uint8([[[200, 100, 100]]]), "sRGB")[0, 0, 0]
    assert (relight.read(tmp_path / "a.heic")[32, 32, 0] > srgb + 0.02) == higher


@pytest.mark.parametrize("suffix", ["jpg", "heic", "avif"])
def test_what_is_in_a_file_counts_before_its_name(tmp_path, suffix):
    for kind in ("jpg", "heic", "avif"):
        FORMATS[kind](tmp_path / f"true.{kind}", Image.fromarray(CODES), exif=TURNED.tobytes())
        named = (tmp_path / f"true.{kind}").rename(tmp_path / f"{kind}.{suffix}")
        found = relight.read(named)
        assert found.shape == (96, 64, 3)
        np.testing.assert_allclose(found, np.rot90(LIGHT, -1), atol=0.09)


def test_ten_bits_are_kept_and_white_is_white(tmp_path):
    pillow_heif = pytest.importorskip("pillow_heif")
    ramp = np.linspace(0, 65535, 1024).astype(np.uint16)[None, :, None].repeat(64, 0).repeat(3, -1)
    file = pillow_heif.from_bytes("RGB;16", (1024, 64), np.ascontiguousarray(ramp).tobytes())
    file.save(str(tmp_path / "a.heic"), quality=-1, chroma=444)
    found = relight.read(tmp_path / "a.heic")
    assert found.max() == pytest.approx(1, abs=1e-3)
    assert len(np.unique(found[..., 1])) > 800  # 8 bits have 256
    np.testing.assert_allclose(found[32, :, 1], colour.decode(ramp, "sRGB")[0, :, 1], atol=0.01)


CONVERTED = {
    "cmyk.jpg": ("CMYK", LIGHT, 0.06),
    "palette.png": ("P", LIGHT, 0.02),
    "grey.jpg": ("L", None, 0.02),
    "grey_alpha.png": ("LA", None, 0.02),
}


@pytest.mark.parametrize("name", CONVERTED)
def test_every_mode_becomes_light(tmp_path, name):
    mode, expected, tolerance = CONVERTED[name]
    picture = Image.fromarray(CODES)
    grey = np.asarray(picture.convert("L"))[..., None].repeat(3, -1)
    (picture.quantize(16) if mode == "P" else picture.convert(mode)).save(tmp_path / name)
    found = relight.read(tmp_path / name)[..., :3]
    expected = colour.decode(grey, "sRGB") if expected is None else expected
    inside = np.s_[8:24, 8:40]  # away from what JPEG blurs
    np.testing.assert_allclose(found[inside], expected[inside], atol=tolerance)


def test_sixteen_bits_of_grey(tmp_path):
    codes = np.linspace(0, 65535, 4096).astype(np.uint16).reshape(64, 64)
    Image.fromarray(codes).save(tmp_path / "a.png")
    found = relight.read(tmp_path / "a.png")
    assert len(np.unique(found[..., 0])) == 4096
    np.testing.assert_allclose(found[..., 0], colour.decode(codes[..., None].repeat(3, -1), "sRGB")[..., 0])


def dng(path, mosaic, orientation=1):
    """An uncompressed DNG of a Bayer mosaic (H, W) uint16, red at the top left, whose camera is sRGB."""
    height, width = mosaic.shape
    xyz_to_camera = np.linalg.inv(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    )
    matrix = [value for number in np.rint(xyz_to_camera.ravel() * 10000) for value in (int(number), 10000)]
    tags = [
        (254, "I", [0]), (256, "I", [width]), (257, "I", [height]), (258, "H", [16]), (259, "H", [1]),
        (262, "H", [32803]), (271, "s", b"Maker\0"), (272, "s", b"Model\0"), (273, "I", [None]),
        (274, "H", [orientation]), (277, "H", [1]), (278, "I", [height]), (279, "I", [mosaic.nbytes]),
        (284, "H", [1]), (33421, "H", [2, 2]), (33422, "B", [0, 1, 1, 2]), (50706, "B", [1, 4, 0, 0]),
        (50707, "B", [1, 1, 0, 0]), (50708, "s", b"Maker Model\0"), (50714, "H", [0]), (50717, "I", [65535]),
        (50721, "r", matrix), (50728, "R", [1, 1] * 3), (50778, "H", [21]),
    ]  # fmt: skip
    kinds = {"B": (1, 1), "s": (2, 1), "H": (3, 2), "I": (4, 4), "R": (5, 8), "r": (10, 8)}
    start = 8 + 2 + 12 * len(tags) + 4
    extra, directory = b"", b""
    for tag, kind, values in tags:
        code, size = kinds[kind]
        values = [1024 if value is None else value for value in values]
        letter = {"s": "B", "R": "I", "r": "i"}.get(kind, kind)
        data = struct.pack(f"<{len(values)}{letter}", *values)
        count = len(data) // size
        if len(data) > 4:
            data, extra = struct.pack("<I", start + len(extra)), extra + data + bytes(len(data) % 2)
        directory += struct.pack("<HHI", tag, code, count) + data.ljust(4, b"\0")
    head = b"II*\0" + struct.pack("<IH", 8, len(tags)) + directory + bytes(4) + extra
    assert len(head) <= 1024
    path.write_bytes(head.ljust(1024, b"\0") + mosaic.astype("<u2").tobytes())


@pytest.mark.parametrize(("orientation", "shape"), [(1, (64, 96, 3)), (6, (96, 64, 3))])
def test_raw_is_linear_and_upright(tmp_path, orientation, shape):
    pytest.importorskip("rawpy")
    mosaic = np.full((64, 96), 16384, np.uint16)
    mosaic[:, 48:] = 32768
    dng(tmp_path / "a.dng", mosaic, orientation)
    found = relight.read(tmp_path / "a.dng")
    assert found.shape == shape
    upright = found if orientation == 1 else np.rot90(found)
    dark, bright = upright[20:44, 10:30].mean(), upright[20:44, 66:86].mean()
    assert bright / dark == pytest.approx(2, rel=0.02)  # twice the light, no curve


@pytest.mark.parametrize(("name", "package"), [("a.heic", "pillow_heif"), ("a.dng", "rawpy")])
def test_without_the_extra_one_line_names_it(tmp_path, missing, name, package):
    (tmp_path / name).write_bytes(b"x")
    missing(package)
    with pytest.raises(ImportError, match=r"needs .*; install it with: python -m pip install '.*\[phone\]'"):
        relight.read(tmp_path / name)


@pytest.mark.parametrize("name", ["a.heic", "a.avif", "a.dng", "a.cr2", "a.webp"])
def test_damaged_files_are_one_line(tmp_path, name):
    (tmp_path / name).write_bytes(b"no picture" * 20)
    with pytest.raises(ValueError, match=f"{name}: cannot be read as") as caught:
        relight.read(tmp_path / name)
    assert "\n" not in str(caught.value)
