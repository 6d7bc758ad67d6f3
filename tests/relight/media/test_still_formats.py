"""Stills of every format say what they hold: types of numbers, orders of bytes, positions and values."""

import base64
import io
import struct
import zlib

import numpy as np
import OpenImageIO as oiio
import pytest
import tifffile
from helpers.foreign_files import (
    ADOBE_GREEN,
    BT2020,
    RED_OF_BT2020,
    bmp,
    chromaticity_chunk,
    decode_srgb,
    disc,
    exif,
    gain_map_jpeg,
    parts,
    ramp,
    unsigned_exr,
    with_segments,
)
from helpers.icc_profiles import SRGB, icc_profile
from helpers.refusals import first_line
from helpers.stored import store
from PIL import Image

import relight
from relight.media import images
from relight.pipeline.shot import Shot

CODES = ramp(32, 48)
LIGHT = decode_srgb(CODES / 255).astype(np.float32)
RGB = ("R", "G", "B")
TO_XYZ = np.array([[0.41239, 0.35758, 0.18048], [0.21264, 0.71517, 0.07219], [0.01933, 0.11919, 0.95053]])
# 10 bits, one grey plane, code 594 of 1023 in PQ; made with libaom
GREY_AVIF = (
    "c-muNU{FXasVqn=%S>Yc0uY^>nP!-qnV9D5Xy^zO`ktFwlE?r7`WY!XMNl?FL1uCZ0}==T@=J?SJreU$a#F#n_zE&ha=~(pKrEM;"
    "lb;OYxPbVK5K%^XAT0vK8kw1SX>hetKu#(Xl$Tg$VCbBmlMgmCBeS5W07!dg79{6`^kx<pq(WUF0L4IiD>A{Fxqt*uVws_HBSQ>G"
    "KsY%+rzkHur-FeKsFJe*C?uX)kPGu4&{-^uOwBAnrc7>1VhI<A1keB550w~Aj5vS>%Zawte*yrCj5o3"
)


def mean(path):
    pixels = relight.read(path)
    return pixels.reshape(-1, pixels.shape[-1]).mean(0)


# A JPEG with a gain map


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({"Orientation": 6}, np.rot90(LIGHT, -1)),
        ({"Orientation": 3}, LIGHT[::-1, ::-1]),
        ({"ColorSpace": 1}, LIGHT),
    ],
)
def test_gain_map_jpegs_stand_upright(tmp_path, tags, expected):
    gain_map_jpeg(tmp_path / "a.jpg", CODES, np.full((16, 24), 200, np.uint8))
    content = with_segments((tmp_path / "a.jpg").read_bytes(), (0xE1, exif(**tags)))
    (tmp_path / "a.jpg").write_bytes(content + b"\0\0\0\x18ftypmp42" + bytes(500))  # and a motion photo
    np.testing.assert_allclose(relight.read(tmp_path / "a.jpg"), expected, atol=0.02)


@pytest.mark.parametrize("colour", [True, False])
def test_gain_maps_of_iso_21496_leave_the_base_picture_alone(tmp_path, colour):
    def jpeg(codes):
        file = io.BytesIO()
        Image.fromarray(codes).save(file, "JPEG", quality=97, progressive=True)
        return file.getvalue()

    urn, base = b"urn:iso:std:iso:ts:21496:-1\0", jpeg(CODES if colour else CODES[..., 0])
    ratios = struct.pack(">IIII", 0, 1, 2, 1) + struct.pack(">iIiIIIiIiI", 0, 1, 2, 1, 1, 1, 1, 64, 1, 64)
    gain = with_segments(
        jpeg(np.full((16, 24), 200, np.uint8)), (0xE2, urn + struct.pack(">HHB", 0, 0, 0) + ratios)
    )
    directory = struct.pack(">HHI4sHHII", 0xB000, 7, 4, b"0100", 0xB001, 4, 1, 2)
    directory += struct.pack(">HHIII", 0xB002, 7, 32, 50, 0)
    first = len(base) + len(urn) + 8 + 94
    entries = struct.pack(">IIIHHIIIHH", 0x030000, first, 0, 0, 0, 0, len(gain), first - len(urn) - 18, 0, 0)
    index = b"MPF\0MM\0*" + struct.pack(">IH", 8, 3) + directory + entries
    content = with_segments(base, (0xE2, urn + bytes(4)), (0xE2, index))
    (tmp_path / "a.jpg").write_bytes(content + gain)
    expected = LIGHT if colour else LIGHT[..., :1].repeat(3, -1)
    np.testing.assert_allclose(relight.read(tmp_path / "a.jpg"), expected, atol=0.02)
    if not colour:
        matte = relight.read_mask(tmp_path / "a.jpg")
        np.testing.assert_allclose(matte, CODES[..., 0] / 255, atol=0.01)


# OpenEXR: parts and CIE XYZ


@pytest.mark.parametrize(
    "specs",
    [
        [("rgba.left", RGB, LIGHT, {"view": "left"}), ("rgba.right", RGB, LIGHT / 2, {"view": "right"})],
        [
            ("ViewLayer.Depth", ("ViewLayer.Depth.Z",), LIGHT[..., :1], {}),
            ("ViewLayer.Combined", [f"ViewLayer.Combined.{channel}" for channel in RGB], LIGHT, {}),
        ],
        [("N", ("N.X", "N.Y", "N.Z"), LIGHT * 0, {}), ("beauty", ("r", "g", "b"), LIGHT, {})],
        [
            ("crypto_object00", [f"crypto_object00.{channel}" for channel in RGB], LIGHT / 2, {}),
            ("C", ("C.red", "C.green", "C.blue"), LIGHT, {}),
        ],
    ],
    ids=["views", "Blender", "lower case", "words"],
)
def test_the_picture_is_found_among_parts(tmp_path, specs):
    parts(tmp_path / "a.exr", *specs)
    np.testing.assert_allclose(relight.read(tmp_path / "a.exr"), LIGHT, atol=1e-3)


def test_parts_have_data_windows_of_their_own(tmp_path):
    path, specs = tmp_path / "a.exr", []
    for name, (top, left, bottom, right) in {"N": (0, 0, 8, 8), "C": (4, 10, 20, 40)}.items():
        spec = oiio.ImageSpec(right - left, bottom - top, 3, "half")
        spec.attribute("oiio:subimagename", name)
        spec.x, spec.y, spec.full_width, spec.full_height = left, top, 48, 32
        specs.append(spec)
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), tuple(specs))
    assert file.write_image(np.zeros((8, 8, 3), np.float32))
    assert file.open(str(path), specs[1], "AppendSubimage")
    assert file.write_image(np.ascontiguousarray(LIGHT[4:20, 10:40]))
    file.close()
    expected = np.zeros_like(LIGHT)
    expected[4:20, 10:40] = LIGHT[4:20, 10:40]
    np.testing.assert_allclose(relight.read(path), expected, atol=1e-3)
    assert {name: layer.shape for name, layer in relight.read_layers(path).items()} == {
        "N": (32, 48, 3),
        "C": (32, 48, 3),
    }


@pytest.mark.parametrize(
    ("names", "white", "layer"),
    [(RGB, 0.3333, None), (("R", "G", "B", "A"), 1 / 3, None), (("sky.R", "sky.G", "sky.B"), 1 / 3, "sky")],
)
def test_xyz_is_read_whatever_its_channels(tmp_path, names, white, layer):
    xyz = (LIGHT @ TO_XYZ.T).astype(np.float32)
    pixels = np.dstack([xyz * 0.5, np.full((32, 48), 0.5, np.float32)]) if len(names) == 4 else xyz
    corners = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, white, white)
    store(tmp_path / "a.exr", pixels, "half", channelnames=names, chromaticities=corners)
    found = relight.read(tmp_path / "a.exr", layer=layer)
    np.testing.assert_allclose(found[..., :3], LIGHT * (0.5 if len(names) == 4 else 1), atol=2e-3)


# AVIF


def test_ten_bits_of_a_grey_avif_are_kept(tmp_path):
    (tmp_path / "a.avif").write_bytes(zlib.decompress(base64.b85decode(GREY_AVIF)))
    np.testing.assert_allclose(relight.read(tmp_path / "a.avif"), 0.9996, atol=5e-4)  # 8 bits: 0.9971


@pytest.mark.parametrize(("primaries", "transfer", "white"), [(9, 16, 49.26), (9, 18, 3.774), (12, 13, 1.0)])
def test_transparent_avif_says_its_colour_by_numbers(tmp_path, primaries, transfer, white):
    Image.new("RGBA", (32, 32), (255, 255, 255, 128)).save(tmp_path / "a.avif", quality=100)
    content = (tmp_path / "a.avif").read_bytes()
    at = content.index(b"nclx") + 4
    numbers = struct.pack(">HH", primaries, transfer)
    (tmp_path / "a.avif").write_bytes(content[:at] + numbers + content[at + 4 :])
    np.testing.assert_allclose(
        mean(tmp_path / "a.avif"), np.array([white, white, white, 1]) * 128 / 255, rtol=0.01
    )


def test_a_damaged_avif_is_named_wherever_it_is_given(tmp_path):
    Image.fromarray(CODES).save(tmp_path / "a.avif")
    content = (tmp_path / "a.avif").read_bytes()
    for damaged in (b"", content[:40], content[: len(content) // 2], content.replace(b"av1C", b"av1X")):
        (tmp_path / "a.avif").write_bytes(damaged)
        for read in (relight.read, relight.read_mask, relight.read_normals, images.read_depth):
            first_line(tmp_path / "a.avif", read)


# Adobe RGB by Exif


def exif_of(order, tags, index):
    """Exif data in an order of bytes, as cameras write it: an interoperability directory behind its own."""
    end = {"II": "<", "MM": ">"}[order]
    entries = [struct.pack(end + "HHIHH", tag, 3, 1, value, 0) for tag, value in tags]
    entries.append(struct.pack(end + "HHII", 0xA005, 4, 1, 26 + 2 + 12 * (len(tags) + 1) + 4))
    data = order.encode() + struct.pack(end + "HI", 42, 8)
    data += struct.pack(end + "HHHIII", 1, 0x8769, 4, 1, 26, 0)
    data += struct.pack(end + "H", len(entries)) + b"".join(entries) + bytes(4)
    return b"Exif\0\0" + data + struct.pack(end + "HHHI4sI", 1, 1, 2, 4, index, 0)


@pytest.mark.parametrize(
    ("kind", "order", "tags", "index", "expected"),
    [
        ("JPEG", "MM", [(0xA001, 65535)], b"R03\0", ADOBE_GREEN),
        ("JPEG", "II", [], b"R03\0", ADOBE_GREEN),
        ("MPO", "MM", [(0xA001, 65535)], b"R03\0", ADOBE_GREEN),
        ("PNG", "II", [(0xA001, 65535)], b"R03\0", ADOBE_GREEN),
        ("JPEG", "MM", [(0xA001, 65535)], b"THM\0", (0.0452, 0.5776, 0)),
        ("JPEG", "MM", [(0xA001, 1)], b"R03\0", (0.0452, 0.5776, 0)),
    ],
)
def test_adobe_rgb_by_exif_in_either_order_of_bytes(tmp_path, kind, order, tags, index, expected):
    options = {} if kind == "PNG" else {"quality": 100, "subsampling": 0}
    options |= {"save_all": True, "append_images": [Image.new("RGB", (8, 8))]} if kind == "MPO" else {}
    picture = Image.new("RGB", (32, 32), (60, 200, 0))
    picture.save(tmp_path / "a", kind, exif=exif_of(order, tags, index), **options)
    np.testing.assert_allclose(mean(tmp_path / "a"), expected, atol=0.01)


# PNG


def png(path, depth, kind, row, **chunks):
    """A PNG of four rows of bytes: kind 0 is grey, 2 RGB, 3 a palette, 4 grey with alpha, 6 RGBA."""
    width = 8 * len(row) // (depth * {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[kind])
    content = b"\x89PNG\r\n\x1a\n"
    header = struct.pack(">IIBBBBB", width, 4, depth, kind, 0, 0, 0)
    for name, data in {
        "IHDR": header,
        **chunks,
        "IDAT": zlib.compress((b"\0" + row) * 4),
        "IEND": b"",
    }.items():
        typed = name.encode() + data
        content += struct.pack(">I", len(data)) + typed + struct.pack(">I", zlib.crc32(typed))
    path.write_bytes(content)


LINEAR = {"gAMA": struct.pack(">I", 100000)}


@pytest.mark.parametrize(
    ("depth", "kind", "row", "chunks", "expected"),
    [
        (8, 3, bytes(4), {"cHRM": chromaticity_chunk(BT2020), "PLTE": b"\xff\0\0"}, RED_OF_BT2020),
        (8, 3, bytes(4), {"cICP": bytes([9, 1, 0, 1]), "PLTE": b"\xff\0\0"}, RED_OF_BT2020),
        (16, 0, b"\x80\0" * 4, LINEAR, (0.5,) * 3),
        (4, 0, b"\x88" * 4, {"gAMA": struct.pack(">I", 62500)}, ((8 / 15) ** 1.6,) * 3),
        (8, 6, bytes([128, 64, 0, 128]) * 4, LINEAR, (0.252, 0.126, 0, 0.502)),
        (16, 4, struct.pack(">HH", 38055, 65535) * 4, {"cICP": bytes([9, 16, 0, 1])}, (1,) * 4),
        (8, 2, b"\x80\x80\x80" * 4, {"cICP": bytes([1, 8, 0, 1])}, (0.502,) * 3),
        (
            8, 2, b"\xff\0\0" * 4,
            {"cHRM": chromaticity_chunk(BT2020), "iCCP": b"s\0\0" + zlib.compress(icc_profile("s", SRGB))},
            (1, 0, 0),
        ),
        (
            8, 2, b"\xff\0\0" * 4,
            {"cICP": bytes([9, 1, 0, 1]), "iCCP": b"s\0\0" + zlib.compress(icc_profile("s", SRGB))},
            RED_OF_BT2020,
        ),
    ],
    ids=["palette", "cICP", "grey 16", "grey 4", "RGBA", "grey PQ", "linear", "profile", "cICP first"],
)  # fmt: skip
def test_png_of_every_kind_says_its_colour(tmp_path, depth, kind, row, chunks, expected):
    png(tmp_path / "a.png", depth, kind, row, **chunks)
    np.testing.assert_allclose(mean(tmp_path / "a.png"), expected, atol=2e-3)


# Radiance


def runs(pixel, width):
    """A row of one pixel in Radiance's run-length encoding."""
    return bytes([2, 2, width >> 8, width & 255]) + b"".join(bytes([128 + width, value]) for value in pixel)


@pytest.mark.parametrize(
    ("magic", "lines", "expected"),
    [
        (b"#?RGBE", [b"FORMAT=32-bit_rle_rgbe", b"EXPOSURE=2"], (0.5, 0.25, 0.125)),
        (b"#?RADIANCE", [b"EXPOSURE=2\r", b"FORMAT=32-bit_rle_rgbe\r"], (0.5, 0.25, 0.125)),
        (b"#?RADIANCE", [b"FORMAT=32-bit_rle_rgbe", b"EXPOSURE=2", b"COLORCORR=1 2 4"], (0.5, 0.125, 1 / 32)),
        (
            b"#?RADIANCE",
            [b"COLORCORR=1 2 4", b"COLORCORR=2 1 1", b"FORMAT=32-bit_rle_rgbe"],
            (0.5, 0.25, 1 / 16),
        ),
    ],
)
def test_radiance_headers_in_any_order(tmp_path, magic, lines, expected):
    head = b"\n".join([magic, *lines, b"", b"-Y 4 +X 16\n"])
    (tmp_path / "a.hdr").write_bytes(head + runs((128, 64, 32, 129), 16) * 4)
    np.testing.assert_allclose(mean(tmp_path / "a.hdr"), expected, rtol=0.02)


def test_run_lengths_of_xyze(tmp_path):
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\nEXPOSURE=2\n\n-Y 4 +X 16\n"
    (tmp_path / "a.hdr").write_bytes(head + runs((122, 128, 139, 128), 16) * 4)
    np.testing.assert_allclose(mean(tmp_path / "a.hdr"), 0.25, atol=0.005)


@pytest.mark.parametrize(
    ("size", "turn"),
    [
        (b"-Y 2 +X 3", lambda grid: grid.reshape(2, 3)),
        (b"+Y 2 +X 3", lambda grid: grid.reshape(2, 3)[::-1]),
        (b"-Y 2 -X 3", lambda grid: grid.reshape(2, 3)[:, ::-1]),
        (b"+X 3 -Y 2", lambda grid: grid.reshape(3, 2).T),
        (b"-X 3 +Y 2", lambda grid: grid.reshape(3, 2)[::-1, ::-1].T),
    ],
)
def test_radiance_pictures_begin_in_any_corner(tmp_path, size, turn):
    values = np.array([200, 180, 160, 140, 120, 100])
    pixels = b"".join(bytes([value, value, value, 129]) for value in values)
    (tmp_path / "a.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n" + size + b"\n" + pixels)
    np.testing.assert_allclose(relight.read(tmp_path / "a.hdr")[..., 0], turn(values / 128), atol=0.01)


# BMP


def uncompressed_bmp(path, height, bits, pixels, *, compression=0, masks=b""):
    fields = struct.pack("<IiiHHIIiiII", 40, 8, height, 1, bits, compression, len(pixels), 0, 0, 0, 0) + masks
    start = 14 + len(fields)
    path.write_bytes(b"BM" + struct.pack("<IHHI", start + len(pixels), 0, 0, start) + fields + pixels)


def test_bmp_of_every_kind_is_opaque(tmp_path):
    codes = CODES[:8, :8]
    unused = np.dstack([codes, np.zeros((8, 8), np.uint8)])
    flipped = codes[::-1, :, ::-1]
    red, green, blue = (codes[::-1, :, channel].astype("<u2") for channel in range(3))
    uncompressed_bmp(tmp_path / "top_down.bmp", -8, 32, unused[:, :, [2, 1, 0, 3]].tobytes())
    uncompressed_bmp(tmp_path / "24.bmp", 8, 24, flipped.tobytes())
    five = (red >> 3) << 10 | (green >> 3) << 5 | blue >> 3
    uncompressed_bmp(tmp_path / "555.bmp", 8, 16, five.tobytes())
    six, masks = (red >> 3) << 11 | (green >> 2) << 5 | blue >> 3, struct.pack("<3I", 0xF800, 0x7E0, 0x1F)
    uncompressed_bmp(tmp_path / "565.bmp", 8, 16, six.tobytes(), compression=3, masks=masks)
    bmp(tmp_path / "v5.bmp", unused, header=124, alpha_mask=0xFF000000, colour=b"BGRs")  # BI_RGB has no masks
    core = struct.pack("<IHHHH", 12, 8, 8, 1, 24)
    (tmp_path / "os2.bmp").write_bytes(b"BM" + struct.pack("<IHHI", 218, 0, 0, 26) + core + flipped.tobytes())
    for path in tmp_path.iterdir():
        found = relight.read(path)
        assert found.shape == (8, 8, 3), path.name
        np.testing.assert_allclose(found, LIGHT[:8, :8], atol=0.02, err_msg=path.name)


# Integers


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"byteorder": ">"}, (0.2159,) * 3),
        ({"tile": (16, 16), "compression": "zlib", "planarconfig": "separate"}, (0.2159,) * 3),
        ({"extrasamples": ["unassalpha"]}, (0.1084, 0.1084, 0.1084, 0.502)),
        ({"extrasamples": ["assocalpha"]}, (0.502,) * 4),  # the codes were multiplied: white
    ],
)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.uint32])
def test_integers_of_any_layout(tmp_path, dtype, settings, expected):
    half = dtype(np.iinfo(dtype).max // 255 * 128)
    shape = (3, 16, 16) if "planarconfig" in settings else (16, 16, len(expected))
    tifffile.imwrite(tmp_path / "a.tif", np.full(shape, half, dtype), photometric="rgb", **settings)
    np.testing.assert_allclose(mean(tmp_path / "a.tif"), expected, atol=1e-3)


@pytest.mark.parametrize("channels", ["A", "RGB", "mask.Y"])
def test_object_numbers_of_any_channel_are_mattes(tmp_path, channels):
    numbers, names = np.eye(8, dtype=np.uint32), [channels] if "mask" in channels else channels
    unsigned_exr(tmp_path / "a.exr", **dict.fromkeys(names, numbers))
    layer = "mask" if "mask" in channels else None
    np.testing.assert_array_equal(relight.read_mask(tmp_path / "a.exr", layer=layer), numbers)
    assert "UINT" in first_line(tmp_path / "a.exr", lambda path: relight.read(path, layer=layer))


# PPM, PGM, PBM, PFM


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"P3\n# plain\n2 1\n255\n255 0 0  0 255 0\n", [[1, 0, 0], [0, 1, 0]]),
        (b"P6 # comment\n2 # another\n1\n255\n\xff\0\0\0\xff\0", [[1, 0, 0], [0, 1, 0]]),
        (b"P2 2 1 15\n15 0", [[1] * 3, [0] * 3]),
        (b"P1\n2 1\n1 0\n", [[0] * 3, [1] * 3]),  # 1 is black
        (b"P4\n2 1\n\x80", [[0] * 3, [1] * 3]),
        (b"Pf\n2 1\n-1.0\n" + np.float32([3, 0.25]).tobytes(), [[3] * 3, [0.25] * 3]),
    ],
)
def test_pnm_of_every_kind(tmp_path, content, expected):
    (tmp_path / "a.pnm").write_bytes(content)
    np.testing.assert_allclose(relight.read(tmp_path / "a.pnm")[0], expected, atol=1e-6)
    if content[:2] in (b"P1", b"P2", b"P4"):
        np.testing.assert_array_equal(
            relight.read_mask(tmp_path / "a.pnm")[0], np.array(expected, float)[:, 0]
        )


# Depth


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (("R", "G", "B", "Z"), 0.5),
        (("V.Combined.R", "V.Combined.G", "V.Combined.B", "V.Depth.Z"), 0.5),  # as Blender names them
        (("R", "G", "depth.Z", "Z"), 0.5),
        (("R", "G", "A.Depth.Z", "B.Depth.Z"), None),
    ],
)
def test_the_depth_of_a_file_of_layers_is_found(tmp_path, names, found):
    pixels = np.tile(np.float32([0.1, 0.2, 0.3, 0.5]), (8, 8, 1))
    store(tmp_path / "a.exr", pixels, "float", channelnames=names)
    if found is None:
        assert "expected a channel Z" in first_line(tmp_path / "a.exr", images.read_depth)
    else:
        np.testing.assert_array_equal(images.read_depth(tmp_path / "a.exr"), np.float32(found))


@pytest.mark.parametrize("far", [-1e30, -np.inf, 0.0, 65504.0])
@pytest.mark.parametrize("name", ["a.exr", "a.tif", "a.pfm", "parts.exr"])
def test_depth_beside_the_person_in_any_file(tmp_path, name, far):
    matte = disc(32) > 0
    depth = np.where(matte, np.float32(2.5), np.float32(far))
    if name == "a.pfm":
        (tmp_path / name).write_bytes(b"Pf\n32 32\n-1.0\n" + depth[::-1].astype("<f4").tobytes())
    elif name == "a.tif":
        tifffile.imwrite(tmp_path / name, depth)
    elif name == "parts.exr":
        light = np.zeros((32, 32, 3), np.float32)
        parts(tmp_path / name, ("rgba", RGB, light, {}), ("depth", ("Z",), depth[..., None].clip(-65504), {}))
    else:
        store(tmp_path / name, depth[..., None], "float", channelnames=("Z",))
    assert (images.read_depth(tmp_path / name)[matte] == 2.5).all()
    source = relight.Source(np.dstack([ramp(32, 32), disc(32)]), depth=str(tmp_path / name), size=(40, 40))
    frame = Shot(source).frame(0)  # placed, the person's depth is mixed with nothing behind them
    np.testing.assert_allclose(frame.depth[frame.plate[..., 3] > 0.01], 2.5, atol=1e-3)


SIMPLE = ("SIMPLE", "T")


@pytest.mark.parametrize(
    "cards",
    [
        [("BITPIX", 8), ("NAXIS", 0)],
        [("BITPIX", 8), ("NAXIS", 2), ("NAXIS1", 0), ("NAXIS2", 4)],
        [("BITPIX", 8), ("NAXIS", 2), ("NAXIS1", -4), ("NAXIS2", 4)],
        [("BITPIX", 8), ("NAXIS", 2), ("NAXIS1", 4), ("NAXIS2", "!")],
        [("BITPIX", 8), ("NAXIS", 3), ("NAXIS1", 4), ("NAXIS2", 4), ("NAXIS3", 0)],
        [("BITPIX", 8), ("NAXIS", 2), ("NAXIS1", 10**9), ("NAXIS2", 10**9)],
        [("BITPIX", 7), ("NAXIS", 2), ("NAXIS1", 4), ("NAXIS2", 4)],
    ],
)
@pytest.mark.parametrize("read", [relight.read, relight.read_mask])
def test_a_header_of_no_pixels_is_damaged(tmp_path, read, cards):
    """FITS: OpenImageIO opens some of them as pictures without rows, columns or channels."""
    lines = [*(f"{name:<8}= {value:>20}" for name, value in (SIMPLE, *cards)), "END"]
    header = "".join(f"{line:<80}" for line in lines).encode()
    (tmp_path / "a.fits").write_bytes(header.ljust(2880) + bytes(2880))
    with pytest.raises(ValueError, match=r"a\.fits: ") as caught:
        read(tmp_path / "a.fits")
    assert "\n" not in str(caught.value)
