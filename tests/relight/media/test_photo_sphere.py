"""Photo spheres that are parts of the sphere, as phones and stitchers write them."""

import numpy as np
import pytest
from PIL import Image

import relight

PART = np.full((20, 40, 3), 128, np.uint8)
PART[:, :20] = 255


def xmp(form="attributes", **fields):
    """GPano statements as XMP writes them: attributes or elements."""
    stated = {
        "ProjectionType": "equirectangular", "FullPanoWidthPixels": 80, "FullPanoHeightPixels": 40,
        "CroppedAreaImageWidthPixels": 40, "CroppedAreaImageHeightPixels": 20, "CroppedAreaLeftPixels": 20,
        "CroppedAreaTopPixels": 5,
    } | fields  # fmt: skip
    space = 'xmlns:GPano="http://ns.google.com/photos/1.0/panorama/"'
    if form == "attributes":
        inner = f"<rdf:Description {space} " + " ".join(f'GPano:{k}="{v}"' for k, v in stated.items()) + "/>"
    else:
        elements = "".join(f"<GPano:{name}>{value}</GPano:{name}>" for name, value in stated.items())
        inner = f"<rdf:Description {space}>{elements}</rdf:Description>"
    rdf = f'<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">{inner}</rdf:RDF>'
    return f'<x:xmpmeta xmlns:x="adobe:ns:meta/">{rdf}</x:xmpmeta>'.encode()


def save(folder, suffix, pixels=PART, packet=b""):
    path = folder / f"sphere.{suffix}"
    picture = Image.fromarray(pixels)
    if suffix == "tif":
        picture.save(path, tiffinfo={700: packet})
    else:
        picture.save(path, xmp=packet, **({"quality": 100} if suffix != "png" else {}))
    return path


@pytest.mark.parametrize(
    ("suffix", "form"),
    [("jpg", "attributes"), ("jpg", "elements"), ("tif", "elements"), ("webp", "attributes")],
)
@pytest.mark.states("Environments", "a part of a photo sphere: placed, the rest is dark", "warned of")
def test_a_part_is_placed_in_its_sphere(tmp_path, suffix, form):
    path = save(tmp_path, suffix, packet=xmp(form))
    with pytest.warns(UserWarning, match=r"sphere\.\w+: is 25% of its sphere; the rest is dark"):
        sky = relight.EnvironmentLight(path)
    pixels = sky.image.pixels
    assert pixels.shape == (40, 80, 3)
    assert not pixels[:5].any()
    assert not pixels[25:].any()
    assert not pixels[:, :20].any()
    assert not pixels[:, 60:].any()
    np.testing.assert_allclose(pixels[6:24, 22:38].mean(), 1, atol=0.02)
    np.testing.assert_allclose(pixels[6:24, 42:58].mean(), 0.2159, atol=0.02)
    directions, intensities = sky.samples()
    assert (intensities[directions[:, 2] < -0.3] == 0).all()  # nothing is behind


def test_a_part_that_was_reduced_later_is_where_it_was(tmp_path):
    packet = xmp(**{name: 4 * value for name, value in {
        "FullPanoWidthPixels": 80, "FullPanoHeightPixels": 40, "CroppedAreaImageWidthPixels": 40,
        "CroppedAreaImageHeightPixels": 20, "CroppedAreaLeftPixels": 20, "CroppedAreaTopPixels": 5,
    }.items()})  # fmt: skip
    with pytest.warns(UserWarning, match="25% of its sphere"):
        pixels = relight.EnvironmentLight(save(tmp_path, "jpg", packet=packet)).image.pixels
    assert pixels.shape == (40, 80, 3)
    assert pixels[5, 20].any()
    assert not pixels[4].any()


@pytest.mark.states("Environments", "a whole photo sphere", "honoured")
def test_whole_spheres_are_as_before(tmp_path, recwarn):
    whole = xmp(
        CroppedAreaImageWidthPixels=80, CroppedAreaImageHeightPixels=40, CroppedAreaLeftPixels=0,
        CroppedAreaTopPixels=0,
    )  # fmt: skip
    assert relight.EnvironmentLight(save(tmp_path, "jpg", packet=whole)).image.pixels.shape == (20, 40, 3)
    assert not recwarn.list


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"ProjectionType": "cylindrical"}, "has the projection cylindrical; expected an equirectangular"),
        ({"CroppedAreaLeftPixels": 60}, "is said to be a part of 40 x 20 pixels at 60, 5"),
        ({"CroppedAreaTopPixels": -1}, "is said to be a part"),
        ({"FullPanoHeightPixels": 80}, "expected one inside, of a sphere twice as wide as high"),
        ({"FullPanoWidthPixels": 2 * 10**6, "FullPanoHeightPixels": 10**6}, "its sphere is too large"),
        ({"FullPanoWidthPixels": "wide"}, "what is no number of pixels"),
        ({"FullPanoWidthPixels": "1e999"}, "what is no number of pixels"),
        ({"CroppedAreaImageHeightPixels": 30}, "which is another shape than the 40 x 30"),
    ],
)
@pytest.mark.states("Environments", "another projection, or a part beyond its sphere", "refused")
def test_a_part_that_cannot_be_placed_is_refused(tmp_path, fields, message):
    with pytest.raises(ValueError, match=message) as caught:
        relight.EnvironmentLight(save(tmp_path, "jpg", packet=xmp(**fields)))
    assert "sphere.jpg" in str(caught.value)
