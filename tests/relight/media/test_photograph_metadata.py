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


def test_what_a_photograph_states_is_kept_except_whose_it_is(tmp_path):
    stated = {
        ExifTags.Base.DateTimeOriginal: "2024:05:06 07:08:09",
        ExifTags.Base.LensModel: "A lens",
        ExifTags.Base.ISOSpeedRatings: 200,
        ExifTags.Base.CameraOwnerName: "Ada",
        ExifTags.Base.BodySerialNumber: "12345",
    }
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif).update(stated)
    exif.get_ifd(ExifTags.IFD.GPSInfo)[ExifTags.GPS.GPSLatitudeRef] = "N"
    Image.fromarray(np.full((32, 24, 3), 120, np.uint8)).save(tmp_path / "a.jpg", exif=exif, xmp=XMP)
    metadata = images.read_metadata(tmp_path / "a.jpg")
    relight.write(tmp_path / "b.jpg", relight.read(tmp_path / "a.jpg"), metadata=metadata)
    with Image.open(tmp_path / "b.jpg") as written:
        kept = written.getexif().get_ifd(ExifTags.IFD.Exif)
        places, profile = written.getexif().get_ifd(ExifTags.IFD.GPSInfo), written.info["icc_profile"]
    assert {tag: kept.get(tag) for tag in stated} == {
        **stated,
        ExifTags.Base.CameraOwnerName: None,
        ExifTags.Base.BodySerialNumber: None,
    }
    assert not places
    assert "sRGB" in ImageCms.getProfileDescription(ImageCms.ImageCmsProfile(io.BytesIO(profile)))
    again = images.read_metadata(tmp_path / "b.jpg")
    assert (again["IPTC:Rating"].value, again["Keywords"].value) == (4, "sea; Bo & Co")
    np.testing.assert_allclose(relight.read(tmp_path / "b.jpg"), relight.read(tmp_path / "a.jpg"), atol=0.01)


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
