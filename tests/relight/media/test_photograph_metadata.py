"""Files carry what photographs carry: when, with what lens, an ICC profile, rating and keywords."""

import io
import struct
from contextlib import nullcontext

import numpy as np
import pytest
import tifffile
from PIL import ExifTags, Image, ImageCms
from PIL.TiffImagePlugin import IFDRational

import relight
from relight.media import images
from relight.media.images.containers import tiff_fields
from relight.media.images.containers.tiff_fields import Field

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


EXPOSED = {
    "ExposureTime": 1 / 125, "FNumber": 2.8, "Exif:PhotographicSensitivity": 400,
    "Exif:ExposureBiasValue": -1 / 3, "Exif:FocalLength": 50.0, "Exif:Flash": 16,
    "Exif:LensSpecification": (24.0, 70.0, 2.8, 4.0),
}  # fmt: skip


def photograph(path, stated=EXPOSED):
    """A JPEG that states its exposure as a camera does: in fractions, in Exif's own directory."""
    exif = Image.Exif()
    for name, value in stated.items():
        name = name.removeprefix("Exif:").replace("PhotographicSensitivity", "ISOSpeedRatings")
        if isinstance(value, float | tuple):
            ratios = [round(number * 3000) for number in np.ravel(value)]
            value = tuple(IFDRational(ratio, 3000) for ratio in ratios)
            value = value if len(value) > 1 else value[0]
        exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base[name]] = value
    Image.fromarray(np.full((32, 24, 3), 120, np.uint8)).save(path, exif=exif)


@pytest.mark.parametrize("second", ["b.jpg", "b.png", "b.tif", "b.exr"])
@pytest.mark.parametrize("first", ["a.jpg", "a.png", "a.tif", "a.exr", "float.tif"])
def test_exposure_and_lens_go_from_any_file_to_any_other(tmp_path, first, second):
    photograph(tmp_path / "plate.jpg")
    pixels, source = relight.read(tmp_path / "plate.jpg"), tmp_path / "plate.jpg"
    for name in (first, second):
        depth = {"depth": "float"} if name == "float.tif" else {}
        relight.write(tmp_path / name, pixels, metadata=images.read_metadata(source), **depth)
        source = tmp_path / name
        np.testing.assert_allclose(relight.read(source), pixels, atol=0.01)
        found = images.read_metadata(source)
        for key, value in EXPOSED.items():
            np.testing.assert_allclose(found[key].value, value, rtol=1e-5, err_msg=f"{name}: {key}")
    with Image.open(source) if source.suffix != ".exr" else nullcontext() as file:
        if file is not None:  # as other programs see it
            details = file.getexif().get_ifd(ExifTags.IFD.Exif)
            assert details[ExifTags.Base.ISOSpeedRatings] == 400
            assert float(details[ExifTags.Base.ExposureBiasValue]) == pytest.approx(-1 / 3, rel=1e-5)


@pytest.mark.parametrize("name", ["a.tif", "a.jpg", "a.png"])
def test_sensitivities_beyond_exifs_are_its_highest(tmp_path, name):
    metadata = {"Exif:PhotographicSensitivity": 102_400}
    relight.write(tmp_path / name, np.full((8, 8, 3), 0.5, np.float32), metadata=metadata)
    assert images.read_metadata(tmp_path / name)["Exif:PhotographicSensitivity"].value == 65_535


@pytest.mark.parametrize(("order", "big"), [("<", False), (">", False), ("<", True), (">", True)])
def test_fields_are_added_to_every_kind_of_tiff(tmp_path, order, big):
    path, pixels = tmp_path / "a.tif", np.arange(60, dtype=np.uint8).reshape(5, 4, 3)
    with tifffile.TiffWriter(path, byteorder=order, bigtiff=big) as file:
        file.write(pixels, photometric="rgb", metadata=None)
        file.write(pixels[::-1], photometric="rgb", metadata=None)
    for sensitivity in (100, 200):
        data = struct.pack(f"{order}H", sensitivity)
        tiff_fields.add_fields(path, {}, {34855: Field(tiff_fields.SHORT, 1, data)})
        with tifffile.TiffFile(path) as file:
            assert file.pages[0].tags["ExifTag"].value == {"ISOSpeedRatings": sensitivity}
            np.testing.assert_array_equal(file.pages[0].asarray(), pixels)
            np.testing.assert_array_equal(file.pages[1].asarray(), pixels[::-1])
