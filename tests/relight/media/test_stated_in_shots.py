"""What files say reaches the pipeline: layers of sequences, pixel aspects, depth without a background."""

import numpy as np
import OpenImageIO as oiio
import pytest
import tifffile
from helpers.foreign_files import RED_OF_BT2020, disc, ramp
from helpers.stored import store
from PIL import Image

import relight
from relight import DirectionalLight
from relight.media.sequences import FrameSequence, SequenceReader
from relight.pipeline.options import Lighting, Output, Source
from relight.pipeline.shot import Shot

LIGHT = np.linspace(0, 1, 64 * 64 * 3, dtype=np.float32).reshape(64, 64, 3)


def test_a_sequence_may_name_a_layer(tmp_path):
    for number in (1, 2):
        layers = {"albedo": LIGHT / 2 * number}
        relight.write(tmp_path / f"a.{number:04d}.exr", LIGHT, layers=layers, depth="float")
    sequence = FrameSequence.of(tmp_path / "a.%04d.exr:albedo")
    assert sequence.numbers() == [1, 2]
    assert str(sequence).endswith("a.%04d.exr:albedo")
    reader = SequenceReader(sequence, relight.read)
    np.testing.assert_allclose(reader.read(2), LIGHT, atol=1e-6)
    assert reader.file(2) == tmp_path / "a.0002.exr"
    plain = SequenceReader(FrameSequence.of(tmp_path / "a.%04d.exr"), relight.read)
    assert plain.content_hash(1) != reader.content_hash(1)
    matte = np.pad(np.ones((32, 32), np.float32), 16)
    inputs = Shot(Source(f"{tmp_path / 'a.%04d.exr'}:albedo", mask=matte))
    np.testing.assert_allclose(inputs.frame(1).plate, LIGHT / 2, atol=1e-6)
    single = Shot(Source(f"{tmp_path / 'a.0001.exr'}:albedo", mask=matte))
    np.testing.assert_allclose(single.frame(0).plate, LIGHT / 2, atol=1e-6)


def test_mattes_of_pixels_that_are_not_square_need_not_say_so(tmp_path):
    store(tmp_path / "a.exr", LIGHT, "half", PixelAspectRatio=2.0)
    Image.fromarray(disc()).save(tmp_path / "m.png")
    with pytest.warns(UserWarning, match="square pixels"):
        frame = Shot(Source(str(tmp_path / "a.exr"), mask=str(tmp_path / "m.png"))).frame(0)
    assert frame.plate.shape == (64, 128, 3)
    assert frame.matte.shape == (64, 128)
    assert frame.matte[:, 64].max() == 1


@pytest.mark.parametrize("name", ["a.exr", "a.%04d.exr"])
def test_what_callers_say_replaces_what_files_say(tmp_path, name):
    red = np.tile(np.float32([0.5, 0, 0, 0.5]), (8, 8, 1))
    store(tmp_path / name.replace("%04d", "0007"), red, "half")
    source = Source(str(tmp_path / name), colour_space="ACEScg", alpha="straight")
    lighting = Lighting(DirectionalLight(), background=str(tmp_path / name), background_colour_space="ACEScg")
    inputs = Shot(source, lighting)
    of_ap1 = np.array([1.705, -0.130, -0.024])  # red of ACEScg in Rec.709
    np.testing.assert_allclose(inputs.frame(7).plate[0, 0, :3], of_ap1 / 4, atol=2e-3)
    np.testing.assert_allclose(inputs.backgrounds.seen(7, (8, 8))[0, 0, :3], of_ap1 / 2, atol=2e-3)


@pytest.mark.parametrize("far", [3.0, 1e10, np.inf, np.nan])
def test_depth_beside_the_person_is_not_looked_at(tmp_path, far):
    codes = np.dstack([ramp(), disc()])
    Image.fromarray(codes).save(tmp_path / "a.png")
    near = 3 + 0.2 * np.linspace(-1, 1, 64, dtype=np.float32)[None] ** 2 * np.ones((64, 1), np.float32)
    depth = np.where(disc() > 0, near, np.float32(far))[..., None]
    store(tmp_path / "z.exr", depth, "float", channelnames=("Z",))
    source = Source(str(tmp_path / "a.png"), depth=str(tmp_path / "z.exr"), size=(96, 128))
    placed = Shot(source).frame(0).depth
    inside = Shot(source).frame(0).plate[..., 3] > 0.9
    assert np.isfinite(placed[inside]).all()
    assert 2.9 < placed[inside].min() <= placed[inside].max() < 3.3


@pytest.mark.parametrize(
    ("space", "red"), [("ACEScg", 0.713), ("ACES2065-1", 0.7347), ("Rec.2020", 0.708), ("lin_rec709", 0.64)]
)
def test_files_are_written_in_a_colour_space(tmp_path, space, red):
    layers = {"C_key": LIGHT, "N": LIGHT}
    relight.write(tmp_path / "a.exr", LIGHT, layers=layers, depth="float", colour_space=space)
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    assert spec.getattribute("chromaticities")[0] == pytest.approx(red, abs=1e-4)
    np.testing.assert_allclose(relight.read(tmp_path / "a.exr"), LIGHT, atol=1e-5)
    np.testing.assert_allclose(relight.read(f"{tmp_path / 'a.exr'}:C_key"), LIGHT, atol=1e-5)
    np.testing.assert_array_equal(relight.read_layers(tmp_path / "a.exr")["N"], LIGHT)
    raw = oiio.ImageInput.open(str(tmp_path / "a.exr")).read_image(0, 3, "float")
    assert np.allclose(raw, LIGHT, atol=1e-5) == (space == "lin_rec709")


@pytest.mark.parametrize("space", ["ACEScg", "ACES2065-1", "Rec.2020", "lin_rec709"])
def test_a_tiff_of_floats_states_its_primaries(tmp_path, space):
    """ACES2065-1 has a blue below zero."""
    metadata = {"Make": "A camera", "Exif:FNumber": 2.8}  # OpenImageIO calls a TIFF with Exif sRGB
    colours = np.random.default_rng(0).random((8, 8, 3), np.float32)
    relight.write(tmp_path / "a.tif", colours, depth="float", colour_space=space, metadata=metadata)
    np.testing.assert_allclose(relight.read(tmp_path / "a.tif"), colours, atol=1e-5)
    raw = oiio.ImageInput.open(str(tmp_path / "a.tif")).read_image("float")
    assert np.allclose(raw, colours, atol=1e-5) == (space == "lin_rec709")


@pytest.mark.parametrize(("order", "big"), [("<", False), (">", False), ("<", True)])
@pytest.mark.states("Stills", "primaries of a TIFF of floats", "honoured")
def test_primaries_of_a_tiff_of_floats_are_honoured(tmp_path, order, big):
    """As other programs write them: fractions of WhitePoint and PrimaryChromaticities."""
    numbers = [round(10000 * number) for number in (0.708, 0.292, 0.170, 0.797, 0.131, 0.046)]
    fields = [
        (318, 5, 2, (3127, 10000, 3290, 10000), True),
        (319, 5, 6, tuple(part for number in numbers for part in (number, 10000)), True),
    ]
    with tifffile.TiffWriter(tmp_path / "a.tif", byteorder=order, bigtiff=big) as file:
        red = np.tile(np.float32([1, 0, 0]), (8, 8, 1))
        file.write(red, photometric="rgb", extratags=fields, metadata=None)
    np.testing.assert_allclose(relight.read(tmp_path / "a.tif")[0, 0], RED_OF_BT2020, atol=1e-3)


def test_a_colour_space_that_cannot_be_written_is_refused(tmp_path):
    with pytest.raises(ValueError, match="colour_space: expected a linear one"):
        relight.write(tmp_path / "a.exr", LIGHT, colour_space="sRGB")
    with pytest.raises(ValueError, match=r"a\.png: colour_space needs an \.exr"):
        relight.write(tmp_path / "a.png", LIGHT, colour_space="ACEScg")
    assert Output(tmp_path / "a.exr", output_colour_space="ACEScg").output_colour_space == "ACEScg"
