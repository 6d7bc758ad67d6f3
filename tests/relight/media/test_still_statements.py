"""What stills state of their pictures: pages, animations, raw files, alpha, primaries and sizes."""

import io
import struct
import warnings

import numpy as np
import OpenImageIO as oiio
import pillow_heif
import pytest
import tifffile
from helpers.foreign_files import decode_srgb, disc, radiance, ramp
from PIL import Image

import relight

MOSAIC = np.full((64, 96), 2000, np.uint16)
THUMBNAIL = np.full((16, 24, 3), (10, 200, 10), np.uint8)
CAMERA = [
    (50706, "B", 4, (1, 4, 0, 0), True),
    (50708, "s", 0, "Test Cam", True),
    (50721, 10, 9, (19549, 10000, -7877, 10000, -2582, 10000, -5724, 10000, 10121, 10000, 1917, 10000, -1267,
                    10000, -110, 10000, 6621, 10000), True),
    (50728, 5, 3, (1, 1, 1, 1, 1, 1), True),
    (50778, 3, 1, 21, True),
    (271, "s", 0, "Test", True),
    (272, "s", 0, "Cam", True),
]  # fmt: skip
FILTERS = [
    (33421, 3, 2, (2, 2), True),
    (33422, 1, 4, (0, 1, 1, 2), True),
    (50714, 3, 1, 0, True),
    (50717, 3, 1, 4095, True),
]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    "suffix", ["tif", "tiff", "3fr", "iiq", "fff", "mos", "erf", "kdc", "dcr", "rwl", "jpg"]
)
@pytest.mark.states("Stills", "a camera raw, under any name of a TIFF", "honoured")
def test_a_camera_raw_is_developed_whatever_its_name(tmp_path, suffix, order):
    pytest.importorskip("rawpy")
    path = tmp_path / f"a.{suffix}"
    with tifffile.TiffWriter(path, byteorder=order) as file:
        file.write(THUMBNAIL, photometric="rgb", subfiletype=1, subifds=1, extratags=CAMERA, metadata=None)
        file.write(MOSAIC, photometric=32803, subfiletype=0, extratags=FILTERS, metadata=None)
    assert relight.read(path).shape == (64, 96, 3)


@pytest.mark.parametrize(
    ("said", "big"),
    [
        ({"subfiletype": 1}, False),
        ({"subfiletype": 1}, True),
        ({"subfiletype": 1, "tile": (16, 16)}, False),
        ({"extratags": [(255, 3, 1, 2, True)]}, False),  # TIFF 5.0's SubfileType
        ({"extratags": [(255, 3, 1, 2, True)]}, True),
    ],
)
@pytest.mark.states("Stills", "reduced pages of a TIFF", "honoured")
def test_a_reduced_page_is_passed_over(tmp_path, said, big):
    with tifffile.TiffWriter(tmp_path / "a.tif", bigtiff=big) as file:
        file.write(THUMBNAIL, photometric="rgb", metadata=None, **said)
        file.write(ramp(), photometric="rgb", subfiletype=0, metadata=None)
        file.write(THUMBNAIL, photometric="rgb", metadata=None, **said)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = relight.read(tmp_path / "a.tif")
    np.testing.assert_allclose(found, decode_srgb(ramp() / 255), atol=1e-4)


def test_the_largest_picture_of_an_icon_is_read(tmp_path):
    Image.fromarray(ramp()).save(tmp_path / "a.ico", sizes=[(16, 16), (64, 64), (32, 32)])
    np.testing.assert_allclose(
        relight.read(tmp_path / "a.ico")[..., :3], decode_srgb(ramp() / 255), atol=1e-3
    )


@pytest.mark.states("Stills", "further pages of a TIFF", "warned of")
def test_further_pages_are_warned_of_and_a_reduced_copy_alone_is_refused(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(ramp(), photometric="rgb", metadata=None)
        file.write(ramp(), photometric="rgb", metadata=None)
    with pytest.warns(UserWarning, match=r"a\.tif: holds 2 pages; the first is read"):
        relight.read(tmp_path / "a.tif")
    tifffile.imwrite(tmp_path / "b.tif", THUMBNAIL, photometric="rgb", subfiletype=1, metadata=None)
    with pytest.raises(ValueError, match=r"b\.tif: holds nothing but a reduced copy"):
        relight.read(tmp_path / "b.tif")


@pytest.mark.parametrize("name", ["a.png", "a.webp", "a.gif", "a.avif"])
@pytest.mark.states("Stills", "animation of PNG, WebP, GIF, AVIF", "warned of")
def test_an_animation_is_warned_of(tmp_path, name):
    first, second = Image.fromarray(ramp()), Image.fromarray(ramp()[::-1])
    first.save(tmp_path / name, save_all=True, append_images=[second])
    with pytest.warns(UserWarning, match=rf"{name}: is animated; its first frame is read"):
        assert relight.read(tmp_path / name).shape[:2] == (64, 64)
    first.save(tmp_path / name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        relight.read(tmp_path / name)


@pytest.mark.states("Stills", "further pictures of a HEIC", "warned of")
def test_further_pictures_of_a_heic_are_warned_of(tmp_path):
    file = pillow_heif.from_pillow(Image.fromarray(ramp()))
    file.save(tmp_path / "one.heic")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        one = relight.read(tmp_path / "one.heic")
    file.add_from_pillow(Image.fromarray(ramp()[::-1]))
    file.save(tmp_path / "two.heic", primary_index=0)
    with pytest.warns(UserWarning, match=r"two\.heic: holds 2 pictures; the main one is read"):
        np.testing.assert_array_equal(relight.read(tmp_path / "two.heic"), one)


@pytest.mark.parametrize(("name", "low"), [("a.png", 254), ("a.tif", 254), ("a.png", 200), ("a.webp", 253)])
def test_a_grey_matte_with_a_few_faint_pixels_is_its_grey(tmp_path, name, low):
    alpha = np.full((64, 64), 255, np.uint8)
    alpha[0, 3:6] = low
    options = {"lossless": True, "exact": True} if name == "a.webp" else {}
    Image.fromarray(np.dstack([disc(), disc(), disc(), alpha])).save(tmp_path / name, **options)
    np.testing.assert_allclose(relight.read_mask(tmp_path / name), disc() / 255, atol=0.01)


def targa(path, attributes, packed=False, pixel=(60, 20, 10, 128)):
    """A Targa file of one pixel (R, G, B, A) repeated, with an extension of some attributes type."""
    red, green, blue, alpha = pixel
    colour = bytes((blue, green, red, alpha))
    rows = (b"\x87" + colour) * 8 if packed else colour * 64  # 0x87: eight pixels alike
    body = struct.pack("<3B5x4H2B", 0, 0, 10 if packed else 2, 0, 0, 8, 8, 32, 8 | 32) + rows
    extension = struct.pack("<H", 495) + bytes(492) + bytes((attributes,))
    path.write_bytes(body + extension + struct.pack("<II", len(body), 0) + b"TRUEVISION-XFILE.\0")


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize(("attributes", "straight"), [(3, True), (4, False)])
@pytest.mark.states("Stills", "attributes type of a Targa file", "honoured")
def test_alpha_of_targa_is_what_its_attributes_say(tmp_path, attributes, straight, packed):
    targa(tmp_path / "a.tga", attributes, packed)
    found = relight.read(tmp_path / "a.tga")[0, 0]
    alpha = 128 / 255
    codes = np.array([60, 20, 10]) / 255 / (1 if straight else alpha)
    np.testing.assert_allclose(found, [*decode_srgb(codes) * alpha, alpha], atol=1e-3)
    if not straight:
        assert not np.allclose(found, relight.read(tmp_path / "a.tga", alpha="straight")[0, 0], atol=1e-3)


@pytest.mark.parametrize(
    ("lines", "light"),
    [
        (["PRIMARIES=0 0 0 0 0 0 0 0"], 0.5),
        (["GAMMA=1", "PRIMARIES=0.0 0 0 0 0 0 0 0.0"], 0.5),
        (["GAMMA=1.0"], 0.5),
        (["GAMMA=2.2"], 0.5**2.2),
        (["GAMMA=0.4545"], 0.5**2.2),
        (["GAMMA=1.8"], 0.5**1.8),
    ],
)
@pytest.mark.states("Stills", "eight zero primaries and GAMMA of a Radiance file", "honoured")
def test_radiance_headers_of_other_programs(tmp_path, lines, light):
    radiance(tmp_path / "a.hdr", (128, 128, 128, 128), *lines)
    np.testing.assert_allclose(relight.read(tmp_path / "a.hdr"), light, rtol=2e-3)


@pytest.mark.parametrize(
    ("count", "kind", "photometric", "order"),
    [
        (1, "uint8", "minisblack", "contig"),
        (2, "uint8", "minisblack", "contig"),
        (1, "uint16", "minisblack", "separate"),
        (1, "float32", "minisblack", "contig"),
        (1, "uint8", "miniswhite", "contig"),
    ],
)
@pytest.mark.states("Stills", "unspecified extra samples of a grey TIFF", "honoured")
def test_samples_that_a_grey_tiff_does_not_name_are_passed_over(tmp_path, count, kind, photometric, order):
    full = 1 if kind == "float32" else np.iinfo(kind).max
    matte = (disc() / 255 * full).astype(kind)
    samples = np.stack([matte] + [np.full_like(matte, 0.3 * full)] * count, 0 if order == "separate" else -1)
    tifffile.imwrite(
        tmp_path / "a.tif", samples, photometric=photometric, planarconfig=order, extrasamples=[0] * count
    )
    shown = 1 - disc() / 255 if photometric == "miniswhite" else disc() / 255
    np.testing.assert_allclose(relight.read_mask(tmp_path / "a.tif"), shown, atol=1e-4)
    assert relight.read(tmp_path / "a.tif").shape == (64, 64, 3)


@pytest.mark.parametrize(("extra", "channels"), [([0], 3), ([0, 0], 3), ([2, 0], 4), ([0, 2], 4)])
def test_samples_that_a_coloured_tiff_does_not_name_are_passed_over(tmp_path, extra, channels):
    samples = np.dstack([ramp()] + [np.full((64, 64), 90, np.uint8)] * len(extra))
    tifffile.imwrite(
        tmp_path / "a.tif", samples, photometric="rgb", planarconfig="contig", extrasamples=extra
    )
    assert relight.read(tmp_path / "a.tif").shape == (64, 64, channels)


@pytest.mark.parametrize(
    ("name", "kind", "layer"),
    [("a.exr", "half", ""), ("a.tif", "float", ""), ("a.exr", "float", "rgba."), ("a.exr", "half", "key.")],
)
@pytest.mark.states("Stills", "alpha more than 0.5 beyond 0 and 1", "refused")
def test_alpha_beyond_its_range_is_clipped_or_refused_by_name(tmp_path, name, kind, layer):
    pixels = np.full((8, 8, 4), 0.5, np.float32)
    pixels[0, 0, 3], pixels[0, 1, 3] = -0.09, 1.17
    for most in (1.17, 255.0):
        pixels[0, 1, 3] = most
        file = oiio.ImageOutput.create(str(tmp_path / name))
        spec = oiio.ImageSpec(8, 8, 4, kind)
        spec.channelnames = [f"{layer}{channel}" for channel in "RGBA"]
        file.open(str(tmp_path / name), spec)
        file.write_image(pixels)
        file.close()
        chosen = {"layer": "key"} if layer == "key." else {}
        if most == 255:
            with pytest.raises(ValueError, match=rf"{name}: expected alpha in \[0, 1\], got"):
                relight.read(tmp_path / name, **chosen)
        else:
            for alpha in (
                relight.read(tmp_path / name, **chosen)[..., 3],
                relight.read_mask(tmp_path / name, layer=layer[:-1] or None),
            ):
                assert (alpha.min(), alpha.max()) == (0, 1)


@pytest.mark.parametrize("size", [1, 16, 40])
@pytest.mark.states("Stills", "a JPEG XL of few bytes", "honoured")
def test_a_small_jpeg_xl_is_read(tmp_path, size):
    path = str(tmp_path / "a.jxl")
    file = oiio.ImageOutput.create(path)
    if file is None:
        pytest.skip("OpenImageIO without JPEG XL")
    file.open(path, oiio.ImageSpec(size, size, 3, "uint8"))
    file.write_image(np.full((size, size, 3), 100, np.uint8))
    file.close()
    np.testing.assert_allclose(relight.read(path), decode_srgb(np.array(100) / 255), atol=0.02)


@pytest.mark.parametrize("name", ["a.png", "a.gif", "a.webp", "a.avif"])
@pytest.mark.states("Stills", "more pixels than the file can mean", "refused")
def test_a_small_file_of_a_huge_picture_is_refused(tmp_path, name, monkeypatch):
    monkeypatch.setattr("relight.media.images.containers.pages.FREE_PIXELS", 1000)
    monkeypatch.setattr("relight.media.images.containers.pages.PIXELS_PER_BYTE", 1)
    file = io.BytesIO()
    Image.new("L", (512, 512)).save(file, name[2:])
    (tmp_path / name).write_bytes(file.getvalue())
    with pytest.raises(ValueError, match=rf"{name}: .*is too large: .* 512 x 512 .* RELIGHT_ANY_SIZE=1"):
        relight.read(tmp_path / name)
    monkeypatch.setenv("RELIGHT_ANY_SIZE", "1")
    assert relight.read(tmp_path / name).shape[:2] == (512, 512)
