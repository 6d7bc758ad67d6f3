"""What the boxes of JPEG 2000 files say: colour space, alpha, shape of pixels."""

import io
import struct

import numpy as np
import pytest
from helpers.foreign_files import RED_OF_BT2020, decode_srgb, disc
from helpers.icc_profiles import SRGB, icc_profile
from PIL import Image

import relight

CODES = (200, 100, 50)
LIGHT = decode_srgb(np.array(CODES) / 255)
P3 = icc_profile("P3", SRGB, "Display P3")


def boxes(kind, content):
    return struct.pack(">I4s", 8 + len(content), kind) + content


def save(path, pixel=CODES, colour=None, more=b"", **options):
    """A JPEG 2000 of one colour; `colour`: what its box `colr` holds, `more`: further boxes of its header."""
    file = io.BytesIO()
    Image.fromarray(np.full((16, 24, len(pixel)), pixel, np.uint8)).save(file, "JPEG2000", **options)
    content = file.getvalue()
    before, header, after = content.partition(boxes(b"colr", b"\1\0\0\0\0\0\x10"))
    assert header
    header = (header if colour is None else boxes(b"colr", colour)) + more
    start = before.index(b"jp2h") - 4
    (size,) = struct.unpack_from(">I", before, start)
    size += len(before + header + after) - len(content)
    path.write_bytes(before[:start] + struct.pack(">I", size) + before[start + 4 :] + header + after)


@pytest.mark.parametrize(
    ("colour", "light"),
    [
        (b"\1\0\0\0\0\0\x10", LIGHT),
        (b"\2\0\0" + P3, (0.679, 0.108, 0.014)),
        (b"\3\0\0" + P3, (0.679, 0.108, 0.014)),
        (b"\5\0\0" + struct.pack(">3HB", 12, 13, 0, 0x80), (0.679, 0.108, 0.014)),
        (b"\5\0\0" + struct.pack(">3HB", 1, 8, 0, 0x80), np.array(CODES) / 255),
        (b"\4\0\0vendor", LIGHT),
    ],
)
@pytest.mark.states("Stills", "colour space, profile and code points of JPEG 2000", "honoured")
def test_jpeg_2000_says_its_colour(tmp_path, colour, light):
    save(tmp_path / "a.jp2", colour=colour)
    np.testing.assert_allclose(relight.read(tmp_path / "a.jp2")[5, 5], light, atol=2e-3)


def test_the_first_of_several_colour_spaces_counts(tmp_path):
    save(tmp_path / "a.jp2", more=boxes(b"colr", b"\1\0\0\0\0\0\x0c"))
    np.testing.assert_allclose(relight.read(tmp_path / "a.jp2")[5, 5], LIGHT, atol=1e-3)


def test_syccs_equations_are_undone(tmp_path):
    """Those of BT.601 over the full range (IEC 61966-2-1, annex F)."""
    red, green, blue = CODES
    luma = 0.299 * red + 0.587 * green + 0.114 * blue
    pixel = [round(v) for v in (luma, 128 + (blue - luma) / 1.772, 128 + (red - luma) / 1.402)]
    save(tmp_path / "a.jp2", pixel, b"\1\0\0\0\0\0\x12", mct=0)
    np.testing.assert_allclose(relight.read(tmp_path / "a.jp2")[5, 5], LIGHT, atol=0.02)


@pytest.mark.parametrize(
    ("colour", "message"),
    [
        (b"\1\0\0\0\0\0\x0c", "states the colour space 12 of JPEG 2000, expected sRGB"),  # CMYK
        (b"\1\0\0\0\0\0\x15", "states the colour space 21 of JPEG 2000, expected sRGB"),  # ROMM-RGB
        (b"\5\0\0" + struct.pack(">3HB", 9, 16, 9, 0x80), "states matrix 9 and range 1"),
        (b"\5\0\0" + struct.pack(">3HB", 9, 3, 0, 0x80), "has the transfer function 3"),
    ],
)
@pytest.mark.states("Stills", "other colour spaces of JPEG 2000, such as CMYK, Lab and ROMM-RGB", "refused")
def test_other_colour_spaces_are_refused_unless_they_are_given(tmp_path, colour, message):
    save(tmp_path / "a.jp2", colour=colour)
    with pytest.raises(ValueError, match=rf"a\.jp2: .*{message}"):
        relight.read(tmp_path / "a.jp2")
    red = np.array(CODES) / 255
    np.testing.assert_allclose(
        relight.read(tmp_path / "a.jp2", colour_space="lin_rec709")[5, 5], red, atol=1e-3
    )
    with pytest.raises(ValueError, match="opaque colour"):
        relight.read_mask(tmp_path / "a.jp2")  # a matte has no colour space


@pytest.mark.parametrize(("kind", "straight"), [(1, True), (2, False)])
@pytest.mark.states("Stills", "premultiplied alpha of JPEG 2000", "honoured")
def test_alpha_is_what_its_definition_says(tmp_path, kind, straight):
    save(tmp_path / "a.jp2", (60, 20, 10, 128))
    content = (tmp_path / "a.jp2").read_bytes()
    alpha = struct.pack(">3H", 3, 1, 0)
    assert alpha in content
    (tmp_path / "a.jp2").write_bytes(content.replace(alpha, struct.pack(">3H", 3, kind, 0)))
    share = 128 / 255
    codes = np.array([60, 20, 10]) / 255 / (1 if straight else share)
    found = relight.read(tmp_path / "a.jp2")[5, 5]
    np.testing.assert_allclose(found, [*decode_srgb(codes) * share, share], atol=1e-3)


def test_pixels_that_are_not_square_are_resampled(tmp_path):
    """Resolutions in points a metre: twice as many rows as columns, so a pixel is twice as wide as high."""
    stated = boxes(b"resc", struct.pack(">4H2b", 20, 1, 1, 1, 2, 3))
    save(tmp_path / "a.jp2", more=boxes(b"res ", stated))
    with pytest.warns(UserWarning, match=r"a\.jp2: its pixels are 2 times as wide as high"):
        assert relight.read(tmp_path / "a.jp2").shape == (16, 48, 3)


@pytest.mark.parametrize("name", ["a.jp2", "a.j2k"])
@pytest.mark.parametrize("bits", [8, 16])
def test_a_grey_jpeg_2000_is_a_matte(tmp_path, name, bits):
    codes = disc() if bits == 8 else disc().astype(np.uint16) * 257
    Image.fromarray(codes).save(tmp_path / name)
    np.testing.assert_allclose(relight.read_mask(tmp_path / name), disc() / 255, atol=1e-3)
    assert relight.read(tmp_path / name).shape == (64, 64, 3)


def test_primaries_beyond_srgb_are_kept(tmp_path):
    save(tmp_path / "a.jp2", (255, 0, 0), b"\5\0\0" + struct.pack(">3HB", 9, 8, 0, 0x80))
    np.testing.assert_allclose(relight.read(tmp_path / "a.jp2")[5, 5], RED_OF_BT2020, atol=1e-3)
