"""What containers of stills say of colour, alpha, layers and pixel shape is honoured or refused."""

import io
import struct

import numpy as np
import pytest
from helpers.foreign_files import (
    ADOBE_GREEN,
    BT2020,
    RED_OF_BT2020,
    avif,
    bmp,
    chromaticity_chunk,
    decode_srgb,
    disc,
    exif,
    gain_map_jpeg,
    png,
    radiance,
    ramp,
)
from helpers.icc_profiles import SRGB, icc_profile
from helpers.refusals import first_line
from helpers.stored import store
from PIL import Image

import relight

RED = np.tile(np.uint8([255, 0, 0]), (8, 8, 1))
P3_RED = (1.2249, -0.0420, -0.0196)
LIGHT = decode_srgb(ramp() / 255).astype(np.float32)


def mean(picture):
    return picture[..., :3].mean((0, 1))


# JPEG


@pytest.mark.parametrize("shape", [(128, 128), (96, 128), (64, 64)])
@pytest.mark.states("Stills", "a gain map of a JPEG: the base picture", "honoured")
def test_a_gain_map_leaves_the_base_picture_alone(tmp_path, shape):
    codes = ramp(*shape)
    gain_map_jpeg(tmp_path / "u.jpg", codes, np.full((shape[0] // 2, shape[1] // 2), 200, np.uint8))
    found = relight.read(tmp_path / "u.jpg")
    assert found.shape == (*shape, 3)  # no alpha
    np.testing.assert_allclose(found, decode_srgb(codes / 255), atol=0.03)


def test_the_base_picture_of_a_gain_map_keeps_its_profile(tmp_path):
    codes = np.full((64, 64, 3), (200, 100, 100), np.uint8)
    profile = icc_profile("P3", SRGB, "Display P3")
    gain_map_jpeg(tmp_path / "u.jpg", codes, disc(32), icc_profile=profile)
    Image.fromarray(codes).save(tmp_path / "p.jpg", quality=97, subsampling=0, icc_profile=profile)
    np.testing.assert_allclose(
        mean(relight.read(tmp_path / "u.jpg")), mean(relight.read(tmp_path / "p.jpg")), atol=1e-3
    )


@pytest.mark.parametrize("name", ["a.jpg", "a.webp", "a.png", "a.tif"])
@pytest.mark.parametrize(
    "tags",
    [
        {"ColorSpace": 65535, "InteroperabilityIndex": "R03"},
        {"ColorSpace": 2},
        {
            "ColorSpace": 65535,
            "Gamma": 2.2,
            "PrimaryChromaticities": (0.64, 0.33, 0.21, 0.71, 0.15, 0.06),
            "WhitePoint": (0.3127, 0.329),
        },
    ],
)
@pytest.mark.states("Stills", "Adobe RGB by Exif", "honoured")
def test_adobe_rgb_by_exif(tmp_path, name, tags):
    if name == "a.tif" and "InteroperabilityIndex" in tags:
        tags = {"ColorSpace": 2}  # Pillow writes no interoperability directory into a TIFF
    options = {"quality": 100, "subsampling": "4:4:4"} if name.endswith("jpg") else {}
    options |= {"lossless": True} if name.endswith("webp") else {}
    Image.new("RGB", (32, 32), (60, 200, 0)).save(tmp_path / name, exif=exif(**tags), **options)
    np.testing.assert_allclose(mean(relight.read(tmp_path / name)), ADOBE_GREEN, atol=0.01)


@pytest.mark.parametrize(
    "tags", [{"ColorSpace": 1}, {"ColorSpace": 65535, "InteroperabilityIndex": "R98"}, {"ColorSpace": 65535}]
)
def test_other_exif_is_srgb_and_a_profile_precedes_it(tmp_path, tags):
    Image.new("RGB", (32, 32), (60, 200, 0)).save(
        tmp_path / "a.jpg", exif=exif(**tags), quality=100, subsampling=0
    )
    srgb = decode_srgb(np.array([60, 200, 0]) / 255)
    np.testing.assert_allclose(mean(relight.read(tmp_path / "a.jpg")), srgb, atol=0.01)
    adobe = exif(ColorSpace=65535, InteroperabilityIndex="R03")
    Image.new("RGB", (32, 32), (60, 200, 0)).save(
        tmp_path / "b.png", exif=adobe, icc_profile=icc_profile("s", SRGB)
    )
    np.testing.assert_allclose(mean(relight.read(tmp_path / "b.png")), srgb, atol=0.01)


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.webp", "a.tif", "a.avif"])
@pytest.mark.parametrize("orientation", [0, 9, 4711])
def test_unknown_orientations_turn_nothing(tmp_path, name, orientation):
    Image.fromarray(ramp(32, 48)).save(tmp_path / name, exif=exif(Orientation=orientation))
    assert relight.read(tmp_path / name).shape == (32, 48, 3)


def test_a_gain_map_that_cannot_be_applied_leaves_the_base_picture(tmp_path):
    gain_map_jpeg(tmp_path / "u.jpg", ramp(128, 128), np.full((64, 64), 200, np.uint8))
    content = (tmp_path / "u.jpg").read_bytes()
    (tmp_path / "u.jpg").write_bytes(content.replace(b'hdrgm:Version="1.0"', b'hdrgm:Version="9.9"'))
    light = decode_srgb(ramp(128, 128) / 255)
    np.testing.assert_allclose(relight.read(tmp_path / "u.jpg"), light, atol=0.02)


# PNG


@pytest.mark.parametrize(
    ("chunks", "expected"),
    [
        ({"cICP": bytes([9, 1, 0, 1])}, RED_OF_BT2020),
        ({"cICP": bytes([12, 13, 0, 1])}, P3_RED),
        ({"cICP": bytes([1, 13, 0, 1]), "cHRM": chromaticity_chunk(BT2020)}, (1, 0, 0)),
        ({"gAMA": struct.pack(">I", 45455), "cHRM": chromaticity_chunk(BT2020)}, RED_OF_BT2020),
        ({"cHRM": chromaticity_chunk(BT2020)}, RED_OF_BT2020),
        ({"sRGB": b"\0", "cHRM": chromaticity_chunk(BT2020)}, (1, 0, 0)),
    ],
)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.states("Stills", "cICP, iCCP, sRGB, gAMA and cHRM of a PNG, in this order", "honoured")
def test_primaries_of_a_png_count_in_the_order_of_its_specification(tmp_path, chunks, expected, dtype):
    red = RED.astype(dtype) * (257 if dtype == np.uint16 else 1)
    png(tmp_path / "a.png", red, **chunks)
    np.testing.assert_allclose(mean(relight.read(tmp_path / "a.png")), expected, atol=2e-3)


@pytest.mark.parametrize("gamma", [1.0, 1.6, 1.8, 2.2, 2.6])
def test_gamma_of_a_png_counts(tmp_path, gamma):
    png(tmp_path / "a.png", np.full((4, 4, 3), 128, np.uint8), gAMA=struct.pack(">I", round(100000 / gamma)))
    np.testing.assert_allclose(relight.read(tmp_path / "a.png"), (128 / 255) ** gamma, atol=1e-3)


@pytest.mark.parametrize("transfer", [16, 18])
def test_pq_and_hlg_of_a_png_are_light(tmp_path, transfer):
    codes = np.full((4, 4, 3), {16: 38055, 18: 49151}[transfer], np.uint16)  # white, of 203 cd/m² in PQ
    png(tmp_path / "a.png", codes, cICP=bytes([9, transfer, 0, 1]))
    np.testing.assert_allclose(relight.read(tmp_path / "a.png"), 1, atol=0.01)


@pytest.mark.parametrize(
    ("chunk", "message"),
    [
        ({"cICP": bytes([9, 1, 9, 1])}, "matrix 9"),
        ({"cICP": bytes([3, 1, 0, 1])}, "primaries 3"),
        ({"gAMA": bytes(4)}, "an exponent of inf"),
        ({"cHRM": bytes(32)}, "span no colours"),
    ],
)
@pytest.mark.states("Stills", "cICP of a PNG that is not full-range RGB, odd exponents", "refused")
def test_what_a_png_says_in_vain_is_one_line(tmp_path, chunk, message):
    png(tmp_path / "a.png", RED, **chunk)
    assert message in first_line(tmp_path / "a.png")
    assert relight.read(tmp_path / "a.png", colour_space="sRGB")[0, 0, 0] == 1


# AVIF


@pytest.mark.parametrize(
    ("layout", "primaries", "transfer", "matrix", "codes", "expected", "tolerance"),
    [
        ("yuv420p10le", 9, 16, 9, (38055,) * 3, (1, 1, 1), 0.03),  # white of 203 cd/m²
        ("yuv420p10le", 9, 16, 9, (33290, 33290, 33290), (0.49, 0.49, 0.49), 0.03),
        ("yuv420p", 12, 13, 1, (65535, 0, 0), P3_RED, 0.04),
        ("yuv420p10le", 9, 18, 9, (49151,) * 3, (1, 1, 1), 0.03),
        ("yuv420p", 1, 13, 1, (32896,) * 3, (0.2159,) * 3, 0.01),
        ("yuv420p", 9, 1, 9, (65535, 0, 0), RED_OF_BT2020, 0.06),
    ],
)
@pytest.mark.states("Stills", "code points of an AVIF", "honoured")
def test_avif_says_its_colour_by_numbers(
    tmp_path, layout, primaries, transfer, matrix, codes, expected, tolerance
):
    avif(tmp_path / "a.avif", np.tile(np.uint16(codes), (64, 64, 1)), layout, primaries, transfer, matrix)
    np.testing.assert_allclose(mean(relight.read(tmp_path / "a.avif")), expected, atol=tolerance)


def test_ten_bits_of_an_avif_are_kept(tmp_path):
    wide = np.tile(np.linspace(20000, 45000, 256).astype(np.uint16)[None, :, None], (64, 1, 3))
    avif(tmp_path / "a.avif", wide, "yuv420p10le", 9, 16, 9)
    assert len(np.unique(relight.read(tmp_path / "a.avif")[32, :, 0])) > 150  # 8 bits have 98


def test_every_damaged_byte_of_an_avif_is_a_picture_or_one_line(tmp_path):
    file = io.BytesIO()
    Image.fromarray(ramp(64, 64)).save(file, "AVIF", quality=50)
    whole, refused = file.getvalue(), 0
    for position in range(0, len(whole), 2):
        damaged = bytearray(whole)
        damaged[position] ^= 0xFF
        (tmp_path / "a.avif").write_bytes(damaged)
        try:
            assert relight.read(tmp_path / "a.avif").ndim == 3
        except ValueError as error:
            refused += 1
            assert str(error).startswith(f"{tmp_path / 'a.avif'}: ")  # noqa: PT017
            assert "\n" not in str(error)  # noqa: PT017
    assert refused > 20


# BMP, Targa


@pytest.mark.parametrize("fourth", [0, 128, 255])
def test_the_fourth_byte_of_a_bmp_is_unused(tmp_path, fourth):
    codes = np.dstack([ramp(), np.full((64, 64), fourth, np.uint8)])
    bmp(tmp_path / "a.bmp", codes)
    found = relight.read(tmp_path / "a.bmp")
    assert found.shape == (64, 64, 3)
    np.testing.assert_allclose(found, LIGHT, atol=1e-3)


def test_alpha_of_a_bmp_is_alpha_where_its_mask_says_so(tmp_path):
    codes = np.dstack([ramp(), disc()])
    bmp(tmp_path / "a.bmp", codes, compression=3, alpha_mask=0xFF000000, header=108, colour=b"BGRs")
    found = relight.read(tmp_path / "a.bmp")
    np.testing.assert_allclose(found[..., 3], disc() / 255, atol=1e-6)
    bmp(tmp_path / "b.bmp", codes, compression=3, alpha_mask=0, header=108, colour=b"BGRs")
    assert relight.read(tmp_path / "b.bmp").shape[-1] == 3


def test_alpha_of_integers_is_straight(tmp_path):
    picture = Image.new("RGBA", (16, 16), (200, 100, 50, 128))
    codes = np.asarray(picture)
    bmp(tmp_path / "a.bmp", codes, compression=3, alpha_mask=0xFF000000, header=108, colour=b"BGRs")
    bmp(tmp_path / "b.bmp", codes, compression=6, alpha_mask=0xFF000000)
    for name, kind in (("a.dds", "DDS"), ("a.sgi", "SGI"), ("a.jp2", "JPEG2000"), ("a.tga", "TGA")):
        picture.save(tmp_path / name, kind)
    expected = (*decode_srgb(np.array([200, 100, 50]) / 255) * (128 / 255), 128 / 255)
    for path in sorted(tmp_path.iterdir()):
        np.testing.assert_allclose(relight.read(path)[8, 8], expected, atol=2e-3, err_msg=path.name)


@pytest.mark.parametrize("masks", [(0xFF, 0xFF00, 0xFF0000), (0x3FF00000, 0xFFC00, 0x3FF)])
@pytest.mark.states("Stills", "masks of a BMP in another order", "refused")
def test_masks_of_a_bmp_in_another_order_are_refused(tmp_path, masks):
    bmp(tmp_path / "a.bmp", np.full((8, 8, 4), 128, np.uint8), compression=3, masks=masks)
    assert "its header states the masks 0x" in first_line(tmp_path / "a.bmp")


def test_a_bmp_says_its_colour(tmp_path):
    codes = np.full((8, 8, 4), 128, np.uint8)
    points = [0.4124, 0.2126, 0.0193, 0.3576, 0.7152, 0.1192, 0.1805, 0.0722, 0.9505]
    calibrated = bytes(4) + struct.pack("<9i", *(round(value * 2**30) for value in points))
    calibrated += struct.pack("<3I", *[round(1.8 * 65536)] * 3)
    bmp(tmp_path / "a.bmp", codes, compression=3, header=108, colour=calibrated)
    np.testing.assert_allclose(relight.read(tmp_path / "a.bmp"), (128 / 255) ** 1.8, atol=2e-3)
    linked = (b"KNIL" + bytes(48)).ljust(68, b"\0")
    bmp(tmp_path / "b.bmp", codes, compression=3, header=124, colour=linked)
    assert "its colour profile is in another file" in first_line(tmp_path / "b.bmp")


@pytest.mark.parametrize(("bits", "channels"), [(0, 3), (8, 4)])
def test_alpha_of_a_targa_is_alpha_where_its_header_says_so(tmp_path, bits, channels):
    head = struct.pack("<BBB5xHHHHBB", 0, 0, 2, 0, 0, 8, 8, 32, 0x20 | bits)
    (tmp_path / "a.tga").write_bytes(head + bytes([40, 50, 60, 0]) * 64)
    assert relight.read(tmp_path / "a.tga").shape == (8, 8, channels)


# DPX


def test_a_damaged_dpx_is_named(tmp_path):
    store(tmp_path / "a.dpx", LIGHT, "uint16")
    whole = (tmp_path / "a.dpx").read_bytes()
    for damaged in (whole[:3000], whole[:900], b"SDPX" + bytes(2048), b"XXXX" + whole[4:]):
        (tmp_path / "b.dpx").write_bytes(damaged)
        first_line(tmp_path / "b.dpx")
        first_line(tmp_path / "b.dpx", relight.read_mask)


# Radiance, PNM


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ([], (1, 0.5, 0.25)),
        (["EXPOSURE=4"], (0.25, 0.125, 0.0625)),
        (["EXPOSURE=4", "COMMENT=x", "EXPOSURE= 0.5"], (0.5, 0.25, 0.125)),
        (["COLORCORR=2 1 0.5"], (0.5, 0.5, 0.5)),
        (["pcomb a.hdr", "\tEXPOSURE=4", "EXPOSURE=2"], (0.5, 0.25, 0.125)),  # indented: of a.hdr
    ],
)
@pytest.mark.states("Stills", "EXPOSURE and COLORCORR of a Radiance file", "honoured")
def test_exposure_of_a_radiance_picture_is_divided_out(tmp_path, lines, expected):
    radiance(tmp_path / "a.hdr", (128, 64, 32, 129), *lines)
    np.testing.assert_allclose(mean(relight.read(tmp_path / "a.hdr")), expected, atol=0.005)


def test_primaries_and_xyz_of_a_radiance_picture(tmp_path):
    radiance(tmp_path / "p.hdr", (128, 0, 0, 129), "PRIMARIES=" + " ".join(map(str, BT2020)))
    np.testing.assert_allclose(mean(relight.read(tmp_path / "p.hdr")), RED_OF_BT2020, atol=5e-3)
    radiance(tmp_path / "x.hdr", (122, 128, 139, 128), kind="32-bit_rle_xyze")
    np.testing.assert_allclose(mean(relight.read(tmp_path / "x.hdr")), 0.5, atol=0.01)
    radiance(tmp_path / "x.pic", (122, 128, 139, 128), "EXPOSURE=2", kind="32-bit_rle_xyze")
    np.testing.assert_allclose(mean(relight.read(tmp_path / "x.pic")), 0.25, atol=0.01)
    radiance(tmp_path / "w.hdr", (128, 0, 0, 129), "EXPOSURE=none")
    assert "EXPOSURE='none', expected 1 numbers > 0" in first_line(tmp_path / "w.hdr")


@pytest.mark.parametrize("maximum", [255, 1023, 65535])
def test_pnm_is_srgb_and_a_matte_as_it_is_stored(tmp_path, maximum):
    kind = ">u2" if maximum > 255 else "u1"
    codes = np.rint(ramp() / 255 * maximum)
    (tmp_path / "a.ppm").write_bytes(b"P6\n64 64\n%d\n" % maximum + codes.astype(kind).tobytes())
    np.testing.assert_allclose(relight.read(tmp_path / "a.ppm"), LIGHT, atol=0.005)
    matte = np.rint(disc() / 255 * maximum)
    (tmp_path / "m.pgm").write_bytes(b"P5\n64 64\n%d\n" % maximum + matte.astype(kind).tobytes())
    np.testing.assert_allclose(relight.read_mask(tmp_path / "m.pgm"), disc() / 255, atol=1e-3)


@pytest.mark.parametrize(("order", "scale"), [("<f4", "-1.0"), (">f4", "1.0")])
def test_pfm_is_light_from_the_bottom_up(tmp_path, order, scale):
    head = f"PF\n64 64\n{scale}\n".encode()
    (tmp_path / "a.pfm").write_bytes(head + LIGHT[::-1].astype(order).tobytes())
    np.testing.assert_allclose(relight.read(tmp_path / "a.pfm"), LIGHT, atol=1e-6)


# Integers


@pytest.mark.parametrize("photometric", ["cielab", "logluv"])
@pytest.mark.states("Stills", "CIE Lab and LogLuv of a TIFF", "refused")
def test_colours_that_are_not_red_green_and_blue_are_refused(tmp_path, photometric):
    tifffile = pytest.importorskip("tifffile")
    tifffile.imwrite(tmp_path / "a.tif", np.full((8, 8, 3), 128, np.uint8), photometric=photometric)
    first_line(tmp_path / "a.tif")


def test_integers_are_over_the_full_range_of_their_type(tmp_path):
    tifffile = pytest.importorskip("tifffile")  # OpenImageIO writes no 32 bits
    for dtype in (np.uint8, np.uint16, np.uint32):
        codes = np.full((8, 8, 3), 128, dtype) * dtype(np.iinfo(dtype).max // 255)
        tifffile.imwrite(tmp_path / "a.tif", codes, photometric="rgb")
        np.testing.assert_allclose(relight.read(tmp_path / "a.tif"), 0.2159, atol=1e-3)
        tifffile.imwrite(tmp_path / "m.tif", np.where(disc(), np.iinfo(dtype).max, 0).astype(dtype))
        np.testing.assert_array_equal(np.unique(relight.read_mask(tmp_path / "m.tif")), [0, 1])
