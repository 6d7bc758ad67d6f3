"""Files carry what photographs carry: when, with what lens, an ICC profile, rating and keywords."""

import io

import numpy as np
import pytest
from PIL import ExifTags, Image, ImageCms

import relight
from relight.media import images

XMP = b"""<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">
<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about=""
xmlns:xmp="http://ns.adobe.com/xap/1.0/" xmlns:dc="http://purl.org/dc/elements/1.1/"><xmp:Rating>4</xmp:Rating>
<dc:subject><rdf:Bag><rdf:li>sea</rdf:li><rdf:li>Bo &amp; Co</rdf:li></rdf:Bag></dc:subject>
</rdf:Description></rdf:RDF></x:xmpmeta><?xpacket end="w"?>"""


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
def test_what_a_photograph_states_is_kept_except_whose_and_where_it_is(tmp_path, suffix):
    stated = {ExifTags.Base.DateTimeOriginal: "2024:05:06 07:08:09", ExifTags.Base.LensModel: "A lens"}
    private = {ExifTags.Base.CameraOwnerName: "Ada", ExifTags.Base.BodySerialNumber: "12345"}
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif).update({**stated, **private})
    exif.get_ifd(ExifTags.IFD.GPSInfo)[ExifTags.GPS.GPSLatitudeRef] = "N"
    Image.fromarray(np.full((32, 24, 3), 120, np.uint8)).save(tmp_path / "a.jpg", exif=exif, xmp=XMP)
    path, pixels = tmp_path / f"b{suffix}", relight.read(tmp_path / "a.jpg")
    relight.write(path, pixels, metadata=images.read_metadata(tmp_path / "a.jpg"))
    again = images.read_metadata(path)
    assert again["Exif:DateTimeOriginal"].value == "2024:05:06 07:08:09"
    assert again["Exif:LensModel"].value == "A lens"
    assert (again["IPTC:Rating"].value, again["Keywords"].value) == (4, "sea; Bo & Co")
    written = path.read_bytes()
    assert not any(word in written for word in (b"Ada", b"12345"))
    assert b"<rdf:li>Bo &amp; Co</rdf:li>" in written
    with Image.open(path) as file:
        assert not file.getexif().get_ifd(ExifTags.IFD.GPSInfo)
        if suffix == ".png":  # which states its colour space by a chunk of its own
            assert "srgb" in file.info
        else:
            profile = ImageCms.ImageCmsProfile(io.BytesIO(file.info["icc_profile"]))
            assert "sRGB" in ImageCms.getProfileDescription(profile)
    np.testing.assert_allclose(relight.read(path), pixels, atol=0.01)


@pytest.mark.parametrize("suffix", [".tif", ".png"])
def test_a_matte_has_no_colour_profile(tmp_path, suffix):
    images.write_mask(tmp_path / f"a{suffix}", np.full((8, 8), 0.5, np.float32))
    with Image.open(tmp_path / f"a{suffix}") as file:
        assert "icc_profile" not in file.info
    np.testing.assert_allclose(images.read_mask(tmp_path / f"a{suffix}"), 0.5, atol=2e-3)


@pytest.mark.parametrize("depth", ["uint8", "float"])
def test_a_tiff_keeps_rating_and_keywords(tmp_path, depth):
    Image.fromarray(np.full((32, 24, 3), 120, np.uint8)).save(tmp_path / "a.jpg", xmp=XMP)
    metadata = images.read_metadata(tmp_path / "a.jpg")
    pixels = relight.read(tmp_path / "a.jpg")
    relight.write(tmp_path / "b.tif", pixels, depth=depth, metadata=metadata)
    again = images.read_metadata(tmp_path / "b.tif")
    assert (again["IPTC:Rating"].value, again["Keywords"].value) == (4, "sea; Bo & Co")
    if depth == "uint8":  # the only one that Pillow reads
        with Image.open(tmp_path / "b.tif") as file:
            assert b"<rdf:li>Bo &amp; Co</rdf:li>" in file.tag_v2[700]
    np.testing.assert_allclose(relight.read(tmp_path / "b.tif"), pixels, atol=5e-3)
