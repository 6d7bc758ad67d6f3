"""What stills say of their values: tables, white as zero, apertures, sensors, Cryptomatte."""

import json
import struct
import subprocess
import sys
import zlib

import numpy as np
import OpenImageIO as oiio
import pytest
import tifffile
from helpers.apertures import aperture, clip_heif
from helpers.foreign_files import decode_srgb, disc, exif, ramp
from helpers.icc_profiles import table_profile
from helpers.refusals import first_line
from PIL import Image

import relight
from relight.media.encodings import REC2020, Encoding, decode_hlg, decode_pq

CODES = ramp(64, 96)
LIGHT = decode_srgb(CODES / 255)
SWAPPED = (1, 2, 0)  # the primaries that a table makes right and the matrix beside it wrong


# ICC profiles


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif", "a.webp", "a.avif"])
@pytest.mark.parametrize("tag", [b"A2B0", b"A2B1"])
@pytest.mark.states(
    "Stills", "a colour table of an ICC profile beside curves and primaries (8 bits)", "honoured"
)
def test_a_table_of_a_profile_counts_before_its_matrix(tmp_path, name, tag):
    options = {"lossless": True} if name == "a.webp" else {} if name == "a.tif" else {"quality": 100}
    options |= {"subsampling": "4:4:4"} if name in ("a.jpg", "a.avif") else {}
    profile = table_profile(tag, columns=SWAPPED, intent=int(tag[3:]))
    Image.fromarray(CODES).save(tmp_path / name, icc_profile=profile, **options)
    np.testing.assert_allclose(relight.read(tmp_path / name), LIGHT, atol=0.02)


def test_a_profile_of_a_table_alone_and_transparent_pictures_are_read(tmp_path):
    codes = np.dstack([CODES, np.full((64, 96), 128, np.uint8)])
    Image.fromarray(codes).save(tmp_path / "a.png", icc_profile=table_profile(b"A2B0", columns=None))
    found = relight.read(tmp_path / "a.png")
    np.testing.assert_allclose(found[..., :3], LIGHT * 128 / 255, atol=0.006)
    assert (found[..., 3] == np.float32(128 / 255)).all()


@pytest.mark.states("Stills", "a colour table of an ICC profile, of 16 bits, or damaged", "refused")
def test_tables_of_more_bits_and_damaged_ones_are_refused(tmp_path):
    profile = table_profile(b"A2B0", columns=SWAPPED)
    tifffile.imwrite(tmp_path / "a.tif", CODES.astype(np.uint16) * 257, photometric="rgb", iccprofile=profile)
    assert "table, which is applied to 8 bits alone" in first_line(tmp_path / "a.tif")
    short = profile.replace(b"mft2", b"mft9")
    Image.fromarray(CODES).save(tmp_path / "b.png", icc_profile=short)
    assert "colour table that is damaged" in first_line(tmp_path / "b.png")


@pytest.mark.parametrize(("transfer", "decode"), [(16, decode_pq), (18, decode_hlg)])
@pytest.mark.parametrize("kind", ["uint8", "uint16"])
@pytest.mark.states("Stills", "PQ and HLG of a JPEG XL, by the tag cicp of its profile", "honoured")
def test_pq_and_hlg_of_jpeg_xl_are_light(tmp_path, transfer, decode, kind):
    spec = oiio.ImageSpec(32, 16, 3, kind)
    spec.attribute("CICP", oiio.TypeDesc("int[4]"), (9, transfer, 0, 1))
    spec.attribute("compression", "jpegxl:100")
    codes = np.full((16, 32, 3), 0.58, np.float32)
    codes[:8, :, 0] = 0.6
    file = oiio.ImageOutput.create(str(tmp_path / "a.jxl"))
    assert file.open(str(tmp_path / "a.jxl"), spec)
    assert file.write_image(codes)
    file.close()
    stored = np.rint(codes * np.iinfo(kind).max) / np.iinfo(kind).max
    expected = decode(stored) @ Encoding(REC2020).matrix.T
    np.testing.assert_allclose(relight.read(tmp_path / "a.jxl"), expected, rtol=0.04, atol=0.01)


@pytest.mark.parametrize("columns", [SWAPPED, None])
def test_cicp_of_a_profile_counts_before_its_table(tmp_path, columns):
    profile = table_profile(b"A2B0", columns=columns, cicp=(9, 16, 0, 1))
    Image.fromarray(CODES).save(tmp_path / "a.png", icc_profile=profile)
    expected = decode_pq(CODES / 255) @ Encoding(REC2020).matrix.T
    np.testing.assert_allclose(relight.read(tmp_path / "a.png"), expected, rtol=1e-3, atol=1e-5)


# TIFF


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.uint32])
@pytest.mark.parametrize("alpha", [False, True])
@pytest.mark.states("Stills", "white as zero of a TIFF, of integers", "honoured")
def test_white_as_zero_is_turned_over(tmp_path, kind, alpha):
    white = np.iinfo(kind).max
    grey = np.where(disc(), 0, white).astype(kind)
    matte = np.where(disc(), white, 0).astype(kind)
    pixels, extra = (np.dstack([grey, matte]), {"extrasamples": ["unassalpha"]}) if alpha else (grey, {})
    tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="miniswhite", planarconfig="contig", **extra)
    np.testing.assert_allclose(relight.read_mask(tmp_path / "a.tif"), disc() / 255, atol=1e-4)
    picture = relight.read(tmp_path / "a.tif")
    np.testing.assert_allclose(picture[..., 0], disc() / 255, atol=1e-4)
    assert picture.shape[2] == (4 if alpha else 3)


@pytest.mark.parametrize("kind", [np.float32, np.float16, np.int16])
@pytest.mark.states(
    "Stills", "white as zero of a TIFF of floats and signed integers, or times alpha", "refused"
)
def test_white_as_zero_without_a_known_black_is_refused(tmp_path, kind):
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((8, 8), kind), photometric="miniswhite")
    assert "white is zero" in first_line(tmp_path / "a.tif")
    assert "white is zero" in first_line(tmp_path / "a.tif", relight.read_mask)
    tifffile.imwrite(
        tmp_path / "b.tif", np.zeros((8, 8, 2), np.uint16), photometric="miniswhite",
        planarconfig="contig", extrasamples=["assocalpha"],
    )  # fmt: skip
    assert "multiplied by alpha" in first_line(tmp_path / "b.tif")


# Photoshop, Xcode


def psd(path, *resources):
    """A Photoshop file of CODES; resources are (number, name, content)."""
    data = b""
    for number, name, content in resources:
        label = bytes([len(name)]) + name
        data += b"8BIM" + struct.pack(">H", number) + label + bytes(len(label) % 2)
        data += struct.pack(">I", len(content)) + content + bytes(len(content) % 2)
    head = b"8BPS" + struct.pack(">H6xHIIHH", 1, 3, *CODES.shape[:2], 8, 3)
    planes = struct.pack(">H", 0) + CODES.transpose(2, 0, 1).tobytes()
    path.write_bytes(head + bytes(4) + struct.pack(">I", len(data)) + data + bytes(4) + planes)


def version_info(has_picture):
    return struct.pack(">IB", 1, has_picture) + struct.pack(">I", 0) * 2 + struct.pack(">I", 1)


@pytest.mark.parametrize(
    "before", [[], [(2996, b"", bytes(15))], [(2999, b"path", b"x"), (2997, b"abc", b"")]]
)
@pytest.mark.states("Stills", "a Photoshop file without a merged picture (resource 1057)", "refused")
def test_a_photoshop_file_without_a_merged_picture_is_refused(tmp_path, before):
    psd(tmp_path / "a.psd", *before, (1057, b"", version_info(True)))
    np.testing.assert_allclose(relight.read(tmp_path / "a.psd"), LIGHT, atol=1e-4)
    psd(tmp_path / "b.psd", *before, (1057, b"", version_info(False)), (2998, b"", b""))
    assert "no merged picture" in first_line(tmp_path / "b.psd")


XCODE = """
import sys, relight
for path in sys.argv[1:]:
    try: relight.read(path)
    except ValueError as error: print(error)
"""


@pytest.mark.states("Stills", "a PNG that Xcode converted (CgBI)", "refused")
def test_a_png_of_xcode_is_refused_in_one_line_whatever_its_name(tmp_path):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", 16, 16, 8, 6, 0, 0, 0))
    body = chunk(b"CgBI", b"\x50\0\x20\2") + head + chunk(b"IDAT", b"\x63\0\0") + chunk(b"IEND", b"")
    paths = [tmp_path / f"a.{suffix}" for suffix in ("png", "jpg", "tif")]
    for path in paths:
        path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)
    ran = subprocess.run([sys.executable, "-c", XCODE, *paths], capture_output=True, text=True, check=True)
    assert not ran.stderr  # libpng prints nothing of its own
    refused = ran.stdout.splitlines()
    for path, said in zip(paths, refused, strict=True):
        assert said.startswith(f"{path}: was converted for iOS by Xcode (chunk CgBI)")


# Clean apertures, sensors


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("suffix", ["avif", "heic"])
@pytest.mark.states(
    "Stills", "the clean aperture (clap) of an AVIF and a HEIC, before its rotation", "honoured"
)
def test_a_clean_aperture_is_what_is_shown(tmp_path, suffix, turned):
    path, tags = tmp_path / f"a.{suffix}", {"exif": exif(Orientation=6)} if turned else {}
    if suffix == "heic":
        pillow_heif = pytest.importorskip("pillow_heif")
        file = pillow_heif.from_pillow(Image.fromarray(CODES))
        file.info.update(tags)
        file.save(str(path), quality=-1, chroma=444)
    else:
        Image.fromarray(CODES).save(path, quality=100, subsampling="4:4:4", **tags)
    clip_heif(path, aperture(64, 40, -4, 2))
    expected = LIGHT[14:54, 12:76]
    np.testing.assert_allclose(relight.read(path), np.rot90(expected, -1) if turned else expected, atol=0.02)


@pytest.mark.states("Stills", "a clean aperture that does not lie in its picture", "refused")
def test_a_clean_aperture_beyond_the_picture_is_refused(tmp_path):
    Image.fromarray(CODES).save(tmp_path / "a.avif")
    clip_heif(tmp_path / "a.avif", aperture(200, 40, 0, 0))
    assert "clean aperture" in first_line(tmp_path / "a.avif")


@pytest.mark.parametrize("white", [4095, 16383, 60000])
@pytest.mark.states("Stills", "the white level of a camera raw, whatever its brightest pixel is", "honoured")
def test_a_camera_raw_is_as_bright_as_its_sensor_says(tmp_path, white):
    pytest.importorskip("rawpy")
    matrix = (32405, 10000, -15371, 10000, -4985, 10000, -9693, 10000, 18760, 10000, 416, 10000,
              556, 10000, -2040, 10000, 10572, 10000)  # fmt: skip
    tags = [
        (50706, "B", 4, (1, 4, 0, 0), True), (50708, "s", 0, "Test Cam", True),
        (50721, 10, 9, matrix, True), (50728, 5, 3, (1,) * 6, True), (50778, 3, 1, 21, True),
        (33421, 3, 2, (2, 2), True), (33422, 1, 4, (0, 1, 1, 2), True), (50714, 3, 1, 0, True),
        (50717, 4, 1, white, True),
    ]  # fmt: skip
    for peak in (0.3, 0.8, 0.95, 1.0):
        mosaic = np.full((64, 96), white // 4, np.uint16)
        mosaic[20:30, 20:30] = round(peak * white)
        tifffile.imwrite(
            tmp_path / "a.dng", mosaic, photometric=32803, subfiletype=0, extratags=tags, metadata=None
        )
        assert relight.read(tmp_path / "a.dng")[50, 60].mean() == pytest.approx(0.25, rel=0.02)


# Cryptomatte


def cryptomatte(path, name, layers, *, beauty=False, manifest=None):
    """An OpenEXR file of Cryptomatte layers, and the picture."""
    numbers, cover = np.full((16, 16), np.float32(-3.1e12)), np.full((16, 16), np.float32(0.7))
    names, planes = [], []
    for layer in layers:
        names += [f"{layer}.{channel}" for channel in "RGBA"]
        planes += [numbers, cover, numbers, 1 - cover]
    if beauty:
        names, planes = [*"RGBA", *names], [*[cover] * 3, cover * 0 + 1, *planes]
    spec = oiio.ImageSpec(16, 16, len(names), "float")
    spec.channelnames = names
    if name is not None:
        spec.attribute("cryptomatte/1234567/name", name)
        spec.attribute("cryptomatte/1234567/manifest", json.dumps(manifest or {}))
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec)
    assert file.write_image(np.ascontiguousarray(np.dstack(planes), np.float32))
    file.close()


@pytest.mark.parametrize(
    ("name", "layers"),
    [
        ("ViewLayer.CryptoObject", ["ViewLayer.CryptoObject00", "ViewLayer.CryptoObject01"]),
        ("uCryptoAsset", ["uCryptoAsset00"]),
        ("things", ["things00", "things01", "things02"]),
        (None, ["crypto_material00"]),
    ],
)
@pytest.mark.states("Stills", "layers of Cryptomatte as a matte, a plate or a map", "refused")
def test_cryptomatte_is_said_to_be_no_matte(tmp_path, name, layers):
    manifest = {"person": "d34d5e6f", "floor": "00000001"}
    cryptomatte(tmp_path / "a.exr", name, layers, manifest=manifest)
    cryptomatte(tmp_path / "b.exr", name, layers, manifest=manifest, beauty=True)
    named = f"{tmp_path / 'b.exr'}:{layers[0]}"
    for path in (tmp_path / "a.exr", named):
        for read in (relight.read_mask, relight.read) if path == named else (relight.read_mask,):
            with pytest.raises(
                ValueError, match=r"is Cryptomatte, the numbers of objects and no matte"
            ) as error:
                read(path)
            assert name is None or "extract the matte of one of person, floor" in str(error.value)
    assert relight.read(tmp_path / "b.exr").shape == (16, 16, 4)  # the picture itself
    assert set(relight.read_layers(tmp_path / "b.exr")) == set(layers)


def test_a_damaged_manifest_names_no_objects(tmp_path):
    cryptomatte(
        tmp_path / "a.exr", "CryptoObject", ["CryptoObject00"], manifest={"a\x1bb": "0", "x" * 99: "1"}
    )
    with pytest.raises(ValueError, match=r"extract the matte of one, such as"):
        relight.read_mask(tmp_path / "a.exr")
