"""Persons are cut out of stills and shots that have no matte, and what is asked for wrongly is one line."""

import numpy as np
import pytest
import torch
from helpers.onnx_models import channel, recurrent
from scipy import ndimage
from typer.testing import CliRunner

import relight
from relight import Source
from relight.analysis.foreground import Foreground
from relight.cli.commands import app
from relight.media import optical_flow
from relight.media.sequences import Still
from relight.pipeline.frame import FrameReader
from relight.pipeline.readers import ReadLog
from relight.pipeline.shot import Shot
from shadow.matte_cleanup import clean_matte

OPTIONS = "mean=0/0/0,std=1/1/1"


def inputs_of(plate, matte, **options):
    return Shot(Source(plate, matte=matte, **options))


def frame(column=15, red=0.9, size=(64, 64)):
    """Somebody red before dark blue: (H, W, 3), linear."""
    image = np.full((*size, 3), (0, 0, 0.1), np.float32)
    image[12:56, column : column + 24] = (red, 0, 0)
    return image


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def model(tmp_path):
    return channel(tmp_path / "m.onnx", 0)


@pytest.fixture
def photo(tmp_path):
    relight.write(tmp_path / "photo.jpg", frame(4).repeat(2, 0).repeat(2, 1))
    return tmp_path / "photo.jpg"


@pytest.mark.parametrize("command", ["apply", "olat"])
def test_a_photograph_without_alpha_gets_a_matte(tmp_path, photo, model, command):
    light = ["--light", "azimuth=10"] if command == "apply" else []
    output = tmp_path / "out.exr"
    result = run(command, photo, "--matte", f"{model},{OPTIONS}", *light, "-o", output)
    assert result.exit_code == 0, result.output
    alpha = relight.read(output)[..., 3]
    assert (alpha[60, 30], alpha[60, 110]) == (pytest.approx(0.955, abs=0.02), 0)


def test_the_matte_of_somebody_who_moves_is_steady_too(tmp_path, model):
    """A texture that moves by six pixels a frame, and whose brightness, which is the matte here, flickers."""
    random = np.random.default_rng(0)
    person = ndimage.gaussian_filter(random.uniform(size=(44, 24)), 1.5)
    person = 0.55 + 0.45 * (person - person.min()) / np.ptp(person)
    for number in range(1, 6):
        image = np.full((64, 96, 3), (0, 0, 0.1), np.float32)
        image[12:56, 6 * number : 6 * number + 24, 0] = person * (0.9 + 0.1 * (number % 2))
        relight.write(tmp_path / f"p.{number}.exr", image)
    shot = inputs_of(tmp_path / "p.%d.exr", f"{model},{OPTIONS}")
    alone = [inputs_of(tmp_path / f"p.{number}.exr", f"{model},{OPTIONS}") for number in range(1, 6)]
    inside = [np.s_[18:50, 6 * number + 6 : 6 * number + 18] for number in range(1, 6)]
    filtered = np.array([shot.frame(n).matte[inside[n - 1]] for n in range(1, 6)])
    found = np.array([each.frame(0).matte[place] for each, place in zip(alone, inside, strict=True)])
    change = [np.abs(np.diff(mattes[1:4], axis=0)).mean() for mattes in (filtered, found)]
    assert change[0] < 0.6 * change[1]
    flicker = found[2].mean() / filtered[2].mean()  # of the brightness, which is no error of the texture
    assert np.abs(flicker * filtered[2] - found[2]).mean() < 0.02


def test_the_flow_of_a_pair_of_frames_is_computed_once_and_a_frame_entered_alone_is_the_same(
    tmp_path, model, monkeypatch
):
    for number in range(1, 6):
        relight.write(tmp_path / f"p.{number}.exr", frame(4 + 3 * number))
    alone = inputs_of(tmp_path / "p.%d.exr", f"{model},{OPTIONS}").frame(3).matte
    flow, flows = optical_flow.dense_flow, []
    monkeypatch.setattr(optical_flow, "dense_flow", lambda *pair: flows.append(pair) or flow(*pair))
    shot = inputs_of(tmp_path / "p.%d.exr", f"{model},{OPTIONS}")
    mattes = [shot.frame(number).matte for number in range(1, 6)]
    assert len(flows) == 2 * 4  # there and back
    np.testing.assert_array_equal(mattes[2], alone)


def test_no_old_background_is_left_at_soft_edges(model):
    image = frame(20)
    soft = 0.5 * image + 0.5 * np.roll(image, 1, axis=1)
    given = inputs_of(soft, f"{model},{OPTIONS}").frame(0)
    alpha = torch.from_numpy(given.matte)
    foreground = Foreground.of(alpha, clean_matte(alpha), photographed=True)
    colour = foreground.own_colour(given.plate).permute(1, 2, 0).numpy()
    coverage, seen = foreground.alpha.numpy(), soft[foreground.box][..., 2]
    edge = (coverage > 0.2) & (coverage < 0.9)
    assert edge.sum() > 40
    # The photograph's blue at the edge is that of the wall behind, and nothing of it is the person's.
    again = coverage * colour[..., 2] + (1 - coverage) * 0.1
    assert np.abs(again - seen)[edge].max() < 0.002


def test_the_matte_of_a_shot_is_steady_where_nothing_changes(tmp_path, model):
    for number in range(1, 6):  # the light flickers by a little
        relight.write(tmp_path / f"p.{number}.exr", frame(red=0.8 + 0.05 * (number % 2)))
    shot = inputs_of(tmp_path / "p.%d.exr", f"{model},{OPTIONS}")
    filtered = [shot.frame(number).matte[30, 25] for number in range(1, 6)]
    alone = [
        inputs_of(tmp_path / f"p.{number}.exr", f"{model},{OPTIONS}").frame(0).matte[30, 25]
        for number in range(1, 6)
    ]
    assert np.ptp(filtered[1:4]) < 0.6 * np.ptp(alone[1:4])


def test_somebody_who_moves_leaves_no_ghost(tmp_path, model):
    for number, column in enumerate((4, 20, 36), 1):
        relight.write(tmp_path / f"p.{number}.exr", frame(column))
    alpha = inputs_of(tmp_path / "p.%d.exr", f"{model},{OPTIONS}").frame(2).matte[30]
    assert alpha[8] < 0.01
    assert alpha[56] < 0.01
    assert alpha[32] > 0.9


@pytest.mark.parametrize("kind", ["still", "recurrent"])
def test_a_frame_that_cannot_be_read_leaves_its_neighbours(tmp_path, model, kind):
    for number in range(1, 8):
        relight.write(tmp_path / f"p.{number}.exr", frame(red=0.4))
    (tmp_path / "p.3.exr").write_bytes(b"no picture")
    network = f"{model},{OPTIONS}" if kind == "still" else recurrent(tmp_path / "rvm.onnx")
    shot = inputs_of(tmp_path / "p.%d.exr", network)
    for number in (2, 4, 5):
        assert shot.frame(number).matte[30, 25] > 0.05
    with pytest.raises((OSError, ValueError), match=r"p\.3\.exr"):
        shot.frame(3)


def test_a_recurrent_network_answers_alike_wherever_a_shot_is_entered(tmp_path):
    for number in range(1, 5):
        relight.write(tmp_path / f"p.{number}.exr", frame(red=0.4))
    network = recurrent(tmp_path / "rvm.onnx")
    through = inputs_of(tmp_path / "p.%d.exr", network)
    tops = [through.frame(number).matte[30, 25] for number in (1, 2, 3)]
    assert tops == sorted(tops)
    entered = inputs_of(tmp_path / "p.%d.exr", network)
    assert entered.frame(3).matte[30, 25] == pytest.approx(tops[2], abs=1e-3)


def test_a_rough_mask_is_refined(tmp_path, photo):
    rough = np.zeros((128, 128), np.float32)
    rough[26:110, 10:54] = 1  # the person is in 24:112, 8:56
    relight.write_mask(tmp_path / "rough.png", rough)
    options = ["--mask", tmp_path / "rough.png", "--refine-matte", 12, "--save-matte", tmp_path / "matte.png"]
    result = run("apply", photo, *options, "--light", "azimuth=10", "-o", tmp_path / "out.exr")
    assert result.exit_code == 0, result.output
    there = frame(4).repeat(2, 0).repeat(2, 1)[..., 0] > 0
    found = relight.read_mask(tmp_path / "matte.png")
    assert np.abs(found - there).mean() < 0.5 * np.abs(rough - there).mean()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "relight fetch person brings them"),
        (["--matte", "{m}"], "is of no known family"),
        (["--matte", "{m},mean=1,std=1/1/1"], "mean: expected three numbers, got (1.0,)"),
        (["--matte", "{m},sigmoid=maybe"], "got 'sigmoid=maybe'"),
        (["--matte", "gone.onnx"], "gone.onnx: no such file"),
        (["--matte", "{m},family=u2net"], "expected a matte in [0, 1], got"),
        (["--matte", "{m}," + OPTIONS, "--person", "2"], "person: expected 1 to 1"),
        (["--matte", "{m}," + OPTIONS, "--person", "x"], "person: expected a number, X/Y"),
        (["--matte", "{m}," + OPTIONS, "--key", "green"], "expected one of mask, key and matte"),
        (["--person", "2"], "relight fetch person brings them"),
        (["--key", "green", "--person", "2"], "person: expected a matting model as well"),
        (["--refine-matte", "9"], "relight fetch person brings them"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(tmp_path, here, photo, model, options, message):
    if "family=u2net" in str(options):
        model = channel(tmp_path / "m.onnx", 0, (1, 3, 320, 320))
    options = [option.replace("{m}", str(model)) for option in options]
    result = run("apply", photo, *options, "--light", "azimuth=10", "-o", "out.exr")
    assert (result.exit_code, result.output.count("\n")) == (2, 1), result.output
    assert message in result.output
    assert not (tmp_path / "out.exr").exists()


def test_what_the_matte_was_made_with_counts_when_a_shot_is_resumed(tmp_path, model):
    for number in range(1, 5):
        relight.write(tmp_path / f"p.{number}.png", frame(4 * number))
    other = channel(tmp_path / "other.onnx", 0)

    def made(number=2, model=f"{model},{OPTIONS}", **options):
        source = Source(tmp_path / "p.%d.png", matte=model, **options)
        return FrameReader(source, Still(None), ReadLog()).person_hash([number])

    assert made() == made()
    assert made() != made(person=2)
    assert made() != made(refine_matte=4)
    assert made() != made(model=f"{model},{OPTIONS},sigmoid=yes")
    before, elsewhere = (made(), made(4)), made(model=f"{other},{OPTIONS}")
    relight.write(tmp_path / "p.1.png", frame(40))  # steadies frame 2's matte, not frame 4's
    assert made() != before[0]
    assert made(4) == before[1]
    channel(other, 1)
    assert made(model=f"{other},{OPTIONS}") != elsewhere
