"""The inputs of a frame: read, matted and placed, for stills and sequences alike."""

import numpy as np
import pytest
from helpers import standins
from PIL import Image

import relight
from relight import Lighting, Output, Source
from relight.errors import MissingNetworksError
from relight.media import images
from relight.pipeline.frame import Placement
from relight.pipeline.frame_numbers import frames_for
from relight.pipeline.shot import Shot


@pytest.fixture
def plate():
    """A person, premultiplied, 24 x 20 pixels."""
    image = np.zeros((24, 20, 4), np.float32)
    image[4:20, 4:16] = 0.5, 0.4, 0.3, 1
    return image


def backgrounds(folder):
    for number, size in ((5, (30, 50)), (6, (30, 50))):
        relight.write(folder / f"b.{number}.png", np.full((*size, 3), number / 10, np.float32))
    return folder / "b.%d.png"


def test_a_still_takes_the_size_of_a_background_that_moves(tmp_path, plate):
    prepared = Shot(Source(plate, size="background"), Lighting(background=backgrounds(tmp_path)))
    assert prepared.is_still
    assert prepared.numbers == (0,)
    assert list(frames_for(prepared, Output("r.%d.exr"), None)) == [5, 6]
    assert prepared.frame(0).plate.shape == (30, 50, 4)
    first, second = (prepared.backgrounds.seen(number, (30, 50)) for number in (5, 6))
    assert first.mean() < second.mean()


def test_normals_of_each_frame_make_a_still_a_shot(tmp_path, plate):
    for number in (3, 4):
        normals = np.zeros((24, 20, 3), np.float32)
        normals[..., 2 if number == 3 else 0] = 1
        relight.write(tmp_path / f"n.{number}.exr", normals)
    prepared = Shot(Source(plate, normals=tmp_path / "n.%d.exr"))
    assert list(prepared.numbers) == [3, 4]
    np.testing.assert_allclose(prepared.frame(3).normals[8, 8], (0, 0, 1), atol=1e-3)
    np.testing.assert_allclose(prepared.frame(4).normals[8, 8], (1, 0, 0), atol=1e-3)


def test_plate_matte_and_normals_are_placed_together(plate):
    normals = np.zeros((24, 20, 3), np.float32)
    normals[..., 2] = 1
    source = Source(
        plate[..., :3], mask=plate[..., 3], normals=normals, size=(48, 40), placement="centre", offset=(3, 2)
    )
    person = Shot(source).frame(0)
    assert person.plate.shape == person.normals.shape == (48, 40, 3)
    np.testing.assert_array_equal(person.matte[10:34, 13:33], plate[..., 3])
    np.testing.assert_array_equal(
        person.normals[..., 2] > 0, np.pad(np.ones((24, 20), bool), ((10, 14), (13, 7)))
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"size": (65536, 65536)}, "size: expected up to 268435456 pixels in all"),
        ({"size": (0, 9)}, "size: expected 1 to 65536 pixels"),
        ({"size": "plate"}, "size: expected"),
        ({"mode": "stretch"}, "mode: expected fit, fill or centre"),
        ({"scale": float("nan")}, "scale: expected a finite number above 0"),
    ],
)
def test_a_bad_placement_is_refused_at_once(arguments, message):
    with pytest.raises(ValueError, match=message):
        Placement(**arguments)


def test_what_lights_and_a_background_need_of_each_other(plate):
    sky = relight.EnvironmentLight(np.full((16, 32, 3), 0.5, np.float32))
    lamp = relight.DirectionalLight(azimuth=0, name="background")
    with pytest.raises(ValueError, match="expected an environment among the lights"):
        Shot(Source(plate), Lighting(lamp, background="environment")).check_lights(0)
    with pytest.raises(ValueError, match="'background' names the background's layer"):
        Shot(Source(plate), Lighting(lamp, background=(0, 0, 0))).check_lights(0)
    Shot(Source(plate), lamp).check_lights(0)
    Shot(Source(plate), Lighting(sky, background="environment")).check_lights(0)
    with pytest.raises(ValueError, match="field_of_view"):
        Shot(Source(plate, field_of_view=0)).frame(0)


def test_a_photograph_without_a_matte_is_named(plate):
    with pytest.raises(
        MissingNetworksError, match=r"\(mask=FILE\), name a matting model \(matte=MODEL\), or key"
    ):
        Shot(Source(plate[..., :3])).frame(0)
    person = Shot(Source(plate[..., :3], mask=plate[..., 3])).frame(0)
    np.testing.assert_array_equal(person.matte, plate[..., 3])


def test_a_matte_of_another_size_is_named_with_both_sizes(tmp_path, plate):
    height, width = plate.shape[:2]
    relight.write_mask(tmp_path / "small.png", plate[:-2, :-3, 3])
    expected = f"mask: .*small.png: expected {width} x {height} pixels, .* got {width - 3} x {height - 2}"
    with pytest.raises(ValueError, match=expected):
        Shot(Source(plate, mask=tmp_path / "small.png")).frame(0)


def test_each_plate_of_a_shot_with_alpha_is_read_once_beside_the_look_for_the_reference(
    tmp_path, plate, monkeypatch
):
    """The first plate tells whether there is alpha, and is looked at."""
    for number in (1, 2):
        relight.write(tmp_path / f"p.{number}.exr", plate)
    paths, read = [], images.read
    monkeypatch.setattr(images, "read", lambda path, **options: paths.append(path) or read(path, **options))
    key = relight.DirectionalLight(name="key")
    source, relit = tmp_path / "p.%d.exr", tmp_path / "r.%d.exr"
    assert standins.FlatShots().render(source, key, relit, temporal_filter=False) == {}
    assert paths == [tmp_path / "p.1.exr"] * 3 + [tmp_path / "p.2.exr"]


@pytest.mark.parametrize("name", ["p.exr", "p.%02d.exr"])
@pytest.mark.states("Stills", "alpha of 0 everywhere beside light, in floats: the colours count", "warned of")
def test_alpha_of_zero_everywhere_is_no_matte(tmp_path, plate, name):
    lit = np.dstack([np.full((24, 20, 3), 0.3), np.zeros((24, 20))]).astype(np.float32)
    for number in (1, 2):
        relight.write(tmp_path / name.replace("%02d", f"{number:02}"), lit)
    source = Source(tmp_path / name, mask=plate[..., 3])
    with pytest.warns(UserWarning, match=r"plate: its alpha is 0 everywhere, which is no matte"):
        frame = Shot(source).frame(1 if "%" in name else 0)
    np.testing.assert_allclose(frame.plate, lit[..., :3], atol=1e-3)
    np.testing.assert_array_equal(frame.matte, plate[..., 3])


def test_an_invisible_frame_stays_invisible(tmp_path, plate):
    relight.write(tmp_path / "p.exr", np.zeros((24, 20, 4), np.float32))
    assert Shot(Source(tmp_path / "p.exr", mask=plate[..., 3])).frame(0).plate.shape == (24, 20, 4)


@pytest.mark.parametrize("label", [1, 2, 100])
@pytest.mark.states(
    "Stills", "labels of 0 and 1 as the matte of a sequence: its frames are empty", "warned of"
)
def test_labels_in_a_sequence_of_mattes_are_warned_of(tmp_path, stub, plate, label):
    for number in (1, 2):
        relight.write(tmp_path / f"p.{number}.exr", plate[..., :3] + 0.1)
        Image.fromarray((plate[..., 3] * label).astype(np.uint8)).save(tmp_path / f"m.{number}.png")
    hint = f"the highest is {label} of 255; multiply labels"
    with pytest.warns(UserWarning, match=rf"mask: a frame is empty .*: {hint}"):
        stub.render(
            tmp_path / "p.%d.exr",
            relight.DirectionalLight(),
            tmp_path / "o.%d.exr",
            mask=tmp_path / "m.%d.png",
        )
