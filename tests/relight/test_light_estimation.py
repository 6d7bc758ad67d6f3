import contextlib
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT
from typer.testing import CliRunner

import relight
from relight import light_estimation
from relight.cli.commands import app
from relight.light_estimation import WINDOW_RADIUS, PlateLight
from relight.media.colour import encode
from relight.media.sequences import FrameSequence, SequenceReader, Still
from shadow.data.records import Records

PERSON = ROOT / "examples" / "person.png"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A cut-out person, the same before grey, their matte, and a place that is bright at image right."""
    folder = tmp_path_factory.mktemp("matching")
    person = np.ascontiguousarray(relight.read(PERSON)[::4, ::4])
    relight.write(folder / "person.png", person)
    relight.write(folder / "photo.png", relight.over(person, (0.3, 0.3, 0.3)))
    relight.write_mask(folder / "matte.png", person[..., 3])
    relight.write(folder / "street.png", street())
    return folder


def street(size=(60, 100), side=1):
    columns = np.linspace(0.1, 0.8, size[1])[::side]
    rows = np.where(np.arange(size[0]) < size[0] / 2, 1, 0.3)
    return np.float32(rows[:, None, None] * columns[:, None] * np.ones(3))


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def halves(picture):
    """Mean brightness of the person's left and right in the picture."""
    inside, middle = picture[..., 3] > 0.9, picture.shape[1] // 2
    grey = picture[..., :3].mean(axis=-1)
    return grey[:, :middle][inside[:, :middle]].mean(), grey[:, middle:][inside[:, middle:]].mean()


@pytest.mark.slow
def test_the_light_of_a_reference_lights_another():
    person = np.ascontiguousarray(relight.read(PERSON)[::3, ::3])
    subject = relight.Subject(person)
    sun = relight.DirectionalLight(azimuth=60, elevation=20, intensity=1.5)
    reference = subject.relit([sun, relight.DirectionalLight(azimuth=-60, intensity=0.2)])
    other = np.ascontiguousarray(person[:, ::-1])  # somebody who stands otherwise
    lights = relight.match(relight.Subject(other), reference)
    assert [light.name for light in lights] == [f"match{number}" for number in range(1, len(lights) + 1)]
    powers = np.array([light.power.mean() for light in lights])
    assert (np.diff(powers) <= 1e-6).all()
    sides = np.array([(0.9, 0, 0.44), (-0.9, 0, 0.44)])  # of a surface that the camera sees
    towards = np.maximum(sides @ np.transpose([light.direction for light in lights]), 0)
    right, left = towards @ powers
    assert right > 2.5 * left
    again = subject.relit(lights)
    inside = reference[..., 3] > 0.9
    np.testing.assert_allclose(again[inside].mean(), reference[inside].mean(), rtol=0.1)
    brighter = relight.match(subject, reference * np.float32((2, 2, 2, 1)))
    np.testing.assert_allclose(sum(light.power.mean() for light in brighter), 2 * powers.sum(), rtol=0.02)


def test_a_picture_in_known_lights_stays_itself_where_the_albedo_lacks_noise():
    """Dark clothes, some channels of which a camera cut to black: those of the albedo are raised."""
    record = Records([ROOT / "tests" / "data"])[0]
    light = record.visibility[:, record.directions[:, 0] > 0.8].mean(axis=1, keepdims=True) + 0.1
    photograph = record.image(np.float32(record.albedo * light)).permute(1, 2, 0).numpy()
    rows = np.nonzero(record.mask.any(axis=1))[0]
    photograph[rows[len(rows) // 3] :] *= (0.004, 0.06, 0.05)
    subject = relight.Subject(np.uint8(np.round(255 * encode(photograph.clip(0, 1)))), record.mask)
    key, fill = relight.DirectionalLight(azimuth=-40, elevation=30), relight.DirectionalLight(intensity=0.3)
    picture = subject.relit([key, fill])
    again = subject.relit(relight.fit_lights(picture, subject))
    wrong = np.diff([encode(image[..., :3].clip(0, 1)) for image in (picture, again)], axis=0)[0][record.mask]
    assert np.sqrt((wrong**2).mean()) < 0.01
    assert np.sqrt(((wrong - wrong.mean(axis=-1, keepdims=True)) ** 2).mean()) < 0.004


class Fitted:
    """Stands in for a subject: its photograph is lit from the front by lights of these colours."""

    def __init__(self, colours):
        self.colours = np.float32(colours)

    def fit_lighting(self, image):
        return np.tile(np.float32([0, 0, 1]), (len(self.colours), 1)), self.colours


def test_the_strongest_is_first_by_what_is_given():
    """The faint light that is left out is blue, so that blue lights grow more than others."""
    colours = [(10, 10, 10), (1.05, 1, 0.95), (0.9, 0.9, 1.199), (0, 0, 0.3)]
    lights = light_estimation.lights_on(Fitted(colours), np.zeros((8, 6, 4)))
    assert [light.name for light in lights] == ["match1", "match2", "match3"]
    powers = np.array([light.power for light in lights])
    assert (np.diff(powers.mean(axis=1)) <= 0).all()
    np.testing.assert_allclose(powers.sum(axis=0), np.sum(colours, axis=0), rtol=1e-5)


def test_no_subject_and_no_matte_are_said(folder):
    with pytest.raises(TypeError, match=r"subject: expected a relight\.Subject, got ndarray"):
        relight.match(np.ones((8, 8, 4)), np.ones((8, 8, 4)))


@pytest.mark.usefixtures("full_canvas")
@pytest.mark.slow
def test_match_plate_lights_from_the_bright_side(folder):
    light, place = folder / "light.yaml", folder / "street.png"
    result = run(
        "apply", folder / "person.png", "--background", place, "--match-plate", "--save-lights", light,
        "-o", folder / "out.exr",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert set(relight.read_layers(folder / "out.exr")) == {"C_plate", "C_background"}
    (plate,) = relight.read_lights(light)
    assert plate.image.path == folder / "light.plate.exr"
    subject = relight.Subject(relight.read(folder / "person.png"))
    relit = subject.relit(plate)
    left, right = halves(relit)
    flat_left, flat_right = halves(subject.relit(relight.EnvironmentLight(np.ones((8, 16, 3)))))
    assert right / flat_right > 1.2 * left / flat_left
    expected = relight.over(relit, relight.read(place))
    np.testing.assert_allclose(relight.read(folder / "out.exr"), expected, atol=5e-3)


@pytest.mark.slow
def test_match_takes_a_reference_with_its_mask(folder):
    lights = folder / "matched.json"
    result = run(
        "apply", folder / "person.png", "--match", folder / "photo.png", "--match-mask", folder / "matte.png",
        "--light", "rim:azimuth=150", "--save-lights", lights, "-o", folder / "matched.png",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    found = relight.read_lights(lights)
    assert [light.name for light in found][:3] == ["rim", "match1", "match2"]
    subject = relight.Subject(relight.read(folder / "person.png"))
    expected = relight.match(
        subject, relight.read(folder / "photo.png"), mask=relight.read_mask(folder / "matte.png")
    )
    np.testing.assert_allclose([light.power for light in found[1:]], [light.power for light in expected])


@pytest.fixture
def desk(folder):
    """The folder as the working folder."""
    with contextlib.chdir(folder):
        yield folder


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--match-plate"], "match_plate: expected a background that is an image"),
        (
            ["--match-plate", "--background", "0.2/0.2/0.2"],
            "match_plate: expected a background that is an image",
        ),
        (["--match-plate", "--background", "person.png"], "background: expected an opaque picture"),
        (
            ["--match-plate", "--background", "street.png", "--light", "plate:azimuth=3"],
            "'plate' is the name of a matched light",
        ),
        (
            ["--match-plate", "--background", "street.png", "--field-of-view", "180"],
            "field_of_view: expected",
        ),
        (["--match", "photo.png"], "the networks that find the person are missing"),
        (["--match", "photo.png", "--match-mask", "empty.png"], "match: mask: "),
        (["--match-mask", "matte.png"], "match_mask: expected a reference"),
        (["--match", "gone.png"], "gone.png"),
        (["--match", "walk.mov"], "match: expected one picture's file"),
        (["--match", "person.png", "--light", "match7:azimuth=3"], "'match7' is the name of a matched light"),
    ],
)
@pytest.mark.parametrize("command", ["apply", "video"])
def test_what_cannot_be_matched_is_refused(command, desk, no_networks, tmp_path, arguments, message):
    relight.write_mask("empty.png", np.zeros(relight.read("photo.png").shape[:2]))
    Path("walk.mov").touch()
    if "--match-plate" not in arguments and "--match" not in arguments:
        arguments = [*arguments, "--light", "azimuth=30"]
    frames = ["--frames", "1-2"] if command == "video" else []
    out = tmp_path / ("out.png" if command == "apply" else "out.%04d.png")
    result = run(command, "person.png", *arguments, *frames, "-o", out)
    assert message in result.output.replace("\n", " "), result.output
    assert result.exit_code == 2
    assert not list(tmp_path.iterdir())


def test_a_moving_background_lights_steadily(tmp_path):
    """A light that flashes for one frame comes and goes over a second; one that stays, stays."""
    for number in range(1, 41):
        place = street(side=1 if number < 30 else -1)
        relight.write(tmp_path / f"place.{number:04d}.exr", place * (4 if number == 15 else 1))
    light = PlateLight(SequenceReader(FrameSequence.of(tmp_path / "place.%04d.exr"), relight.read), 40)
    powers = np.array([light.at(number, (60, 100)).samples()[1].sum() for number in range(1, 30)])
    assert np.abs(np.diff(powers)).max() / powers.mean() < 0.15
    assert powers[14] > 1.05 * powers[0]
    still = PlateLight(Still(street()), 40)
    assert light.frames_for(1) == list(range(1, 2 + WINDOW_RADIUS))
    first = light.at(1, (60, 100)).view((30, 50), 40)
    np.testing.assert_allclose(first, still.at(1, (60, 100)).view((30, 50), 40), atol=0.03)


def test_a_background_that_cannot_be_read_leaves_its_neighbours(tmp_path):
    for number in range(1, 6):
        relight.write(tmp_path / f"place.{number:04d}.exr", street())
    (tmp_path / "place.0003.exr").write_bytes(b"no picture")
    light = PlateLight(SequenceReader(FrameSequence.of(tmp_path / "place.%04d.exr"), relight.read), 40)
    with pytest.warns(
        UserWarning, match=r"background: frame 3: .*place\.0003\.exr.*before and after it"
    ) as said:
        found = [light.at(number, (60, 100)).samples()[1].sum() for number in (1, 2, 4, 5)]
    assert len(said) == 1
    np.testing.assert_allclose(found, found[0], rtol=1e-4)
    with pytest.raises((OSError, ValueError), match=r"place\.0003\.exr"):
        light.at(3, (60, 100))


def test_the_person_of_the_plate_is_not_looked_for_in_the_reference(monkeypatch):
    asked = []

    class Found:
        def __init__(self, options, read, numbers):
            asked.append(options.person)

        def matte(self, number):
            return street(), np.ones(street().shape[:2], np.float32)

    monkeypatch.setattr(light_estimation, "SequenceMatting", Found)
    options = light_estimation.MattingOptions.parse("m.onnx", "2")
    assert options.person is not None
    light_estimation.read_reference(street(), None, options)
    assert asked == [None]


def test_what_is_cut_off_the_background_lights_too():
    whole = street((60, 100))
    light = PlateLight(Still(whole), 30)
    wide = light.at(0, (60, 100)).image.pixels
    np.testing.assert_array_equal(light.at(0, (60, 100)).image.pixels, wide)
    tall = PlateLight(Still(whole), 30).at(0, (60, 40))  # beside the picture there is more of the place
    np.testing.assert_allclose(
        tall.view((60, 100), 30), PlateLight(Still(whole), 30).at(0, (60, 100)).view((60, 100), 30)
    )
    low = PlateLight(Still(whole), 30).at(0, (20, 100))  # a third of it is shown
    fov = np.degrees(2 * np.arctan(3 * np.tan(np.radians(15))))
    assert np.abs(low.view((60, 100), fov) - whole).mean() < 0.01


@pytest.mark.usefixtures("full_canvas")
@pytest.mark.slow
def test_found_light_is_nearer_the_truth_than_grey_light(benchmark_module):
    """Two bodies of benchmarks/matching.py."""
    measure = benchmark_module("matching").measure
    of_plate, of_reference = (np.array(list(table.values())) for table in measure([8, 9]).values())
    assert of_plate[:, 3].mean() < 0.93 * of_plate[:, 4].mean()
    assert of_reference[:, 3].mean() < 0.93 * of_reference[:, 4].mean()
    assert of_reference[:, 0].mean() < of_reference[:, 1].mean()
