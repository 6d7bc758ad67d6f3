"""`matte="auto"`, the default: whoever is in a photograph without a matte is found; here, what is red."""

import json
import warnings

import numpy as np
import pytest
from helpers.finders import discs, small_finder
from helpers.packages import NEEDS_PYMATTING
from typer.testing import CliRunner

import relight
from relight.analysis.infer import check_inputs
from relight.cli.commands import app
from relight.errors import EmptyMatteError, MissingNetworksError
from relight.matting.people import finder as person
from relight.media import colour
from relight.pipeline.options import Source
from relight.pipeline.shot import Shot

pytestmark = NEEDS_PYMATTING
KEY = relight.DirectionalLight(azimuth=-40, elevation=30)


def photograph(*people, size=(160, 160)):
    """A photograph of red discs, uint8, and where they are."""
    picture, where = discs(size, *people)
    return np.round(picture * 255).astype(np.uint8), where


def overlap(alpha, where):
    return ((alpha > 0.5) & where).sum() / ((alpha > 0.5) | where).sum()


def linear(codes):
    return colour.decode(codes / np.float32(255), colour.SRGB).astype(np.float32)


def test_the_person_in_a_photograph_is_relit(fetched):
    codes, (where,) = photograph((90, 70, 14))
    picture = relight.apply(codes, KEY)
    assert overlap(picture[..., 3], where) > 0.9
    np.testing.assert_array_equal(check_inputs(codes).alpha, picture[..., 3])
    with pytest.raises(ValueError, match="mask: the image has no alpha channel"):
        relight.apply(codes, KEY, matte=None)


def test_the_command_writes_the_person_of_a_photograph_without_a_matte(fetched, tmp_path):
    codes, (where,) = photograph((90, 70, 14))
    relight.write(tmp_path / "photo.png", codes)
    words = [str(tmp_path / "photo.png"), "--preset", "rembrandt", "--background", "none"]
    words += ["-o", str(tmp_path / "out.png")]
    done = CliRunner().invoke(app, ["apply", *words])
    assert done.exit_code == 0, done.output
    written = relight.read(tmp_path / "out.png")
    assert overlap(written[..., 3], where) > 0.9
    expected = relight.apply(codes, "rembrandt")
    assert np.abs(written - expected.clip(0, 1))[..., 3].max() < 0.01


def test_nothing_is_looked_for_where_there_is_a_matte(monkeypatch):
    def load():
        raise AssertionError("the networks were loaded")

    monkeypatch.setattr(person, "load", load)
    codes, (where,) = photograph((90, 70, 14))
    alpha = np.where(where, 255, 0).astype(np.uint8)
    for given in ((np.dstack([codes, alpha]),), (codes, where.astype(np.float32))):
        assert overlap(check_inputs(*given).alpha.numpy(), where) == 1


def test_nearly_opaque_alpha_is_no_matte(fetched):
    codes, (where,) = photograph((90, 70, 14))
    alpha = np.full((160, 160), 255, np.uint8)
    alpha[:2, :5] = 200
    with pytest.warns(UserWarning, match=r"alpha is opaque in 100 % of the pixels, which is no matte"):
        given = check_inputs(np.dstack([codes, alpha]))
    assert overlap(given.alpha.numpy(), where) > 0.9


def test_nobody_is_said(fetched):
    with pytest.raises(EmptyMatteError, match="found no person in the photograph: give a mask"):
        check_inputs(photograph()[0])


def test_missing_networks_are_said():
    person.load.cache_clear()
    with pytest.raises(MissingNetworksError, match="relight fetch person brings them"):
        check_inputs(photograph((90, 70, 14))[0])


def test_somebody_uncertain_is_said(tmp_path, monkeypatch):
    """As a hand in an upside-down photograph is."""
    for presence, said in ((0.7, True), (0.95, False)):
        (tmp_path / f"{presence}").mkdir()
        finder = small_finder(tmp_path / f"{presence}", presence)
        monkeypatch.setattr(person, "load", lambda finder=finder: finder)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            check_inputs(photograph((90, 70, 14))[0])
        assert (
            any("uncertain whether what was found is a person" in str(each.message) for each in caught)
            == said
        )


def test_one_of_several_is_taken_from_a_file(fetched, tmp_path, stub):
    codes, (large, small) = photograph((50, 60, 14), (120, 110, 10))
    relight.write(tmp_path / "p.png", linear(codes))
    for chosen, where in ((None, large), (2, small), ((118, 112), small), ("all", large | small)):
        assert overlap(Shot(Source(tmp_path / "p.png", person=chosen)).frame(0).matte, where) > 0.9
    matte = tmp_path / "matte.png"
    options = ["--person", "all", "--light", "azimuth=10", "-o", tmp_path / "o.exr", "--save-matte", matte]
    done = CliRunner().invoke(app, ["apply", *map(str, [tmp_path / "p.png", *options])])
    assert done.exit_code == 0, done.output
    assert overlap(relight.read_mask(matte), large | small) > 0.9


def test_a_shot_follows_the_person_of_its_first_frame_wherever_it_is_entered(fetched, tmp_path):
    """The other one becomes the larger one; a machine of a farm sees the last frame alone."""
    for number, (ours, other) in enumerate(((14, 10), (12, 12), (10, 14)), start=1):
        codes, (where, _) = photograph((40 + number, 60, ours), (115, 110, other))
        relight.write(tmp_path / f"p.{number}.exr", linear(codes))
    shot = Shot(Source(tmp_path / "p.%d.exr"))
    last = shot.frame(3).matte
    assert overlap(last, where) > 0.85
    for number in (1, 2):
        shot.frame(number)
    np.testing.assert_array_equal(shot.frame(3).matte, last)


def test_a_frame_without_anybody_is_empty(fetched, tmp_path):
    for number, people in enumerate(([], [(60, 60, 14)]), start=1):
        relight.write(tmp_path / f"p.{number}.exr", linear(photograph(*people)[0]))
    shot = Shot(Source(tmp_path / "p.%d.exr", temporal_filter=False))
    assert shot.frame(1).matte.max() <= 0.5
    assert shot.frame(2).matte.max() > 0.5


def test_a_job_states_who_is_followed_and_every_machine_takes_them(fetched, tmp_path):
    """A machine on which the first frame is missing, or that would choose another one, takes the same."""
    for number, (ours, other) in enumerate(((14, 10), (10, 14)), start=1):
        codes, (where, _) = photograph((40 + number, 60, ours), (115, 110, other))
        relight.write(tmp_path / f"p.{number}.exr", linear(codes))
    plates = tmp_path / "p.%d.exr"
    relight.write_job(tmp_path / "job.json", plates, KEY, tmp_path / "o.%d.exr")
    template = json.loads((tmp_path / "job.json").read_text())
    assert "--track" in template["steps"][0]["script"]["actions"]["onRun"]["args"]
    defaults = {each["name"]: each["default"] for each in template["parameterDefinitions"]}
    assert defaults["Track"] == "job.track.json"
    (tmp_path / "p.1.exr").unlink()
    kept = Source(plates, track=tmp_path / "job.track.json")
    assert overlap(Shot(kept).frame(2).matte, where) > 0.85


def test_the_command_follows_somebody_else_and_is_corrected(fetched, tmp_path):
    for number in (1, 2, 3):
        codes, (first, second) = photograph((40 + number, 60, 14), (115, 110, 10))
        relight.write(tmp_path / f"p.{number}.exr", linear(codes))
    plates, kept = str(tmp_path / "p.%d.exr"), tmp_path / "kept.json"
    words = ["track", plates, "-o", str(kept), "--person", "115/110", "--correct", "43/60@3"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    shot = Shot(Source(plates, track=kept))
    assert overlap(shot.frame(2).matte, second) > 0.6
    assert overlap(shot.frame(3).matte, first) > 0.85
    for further, message in (
        (["--correct", "43/60"], "--correct: expected X/Y@FRAME, such as 640/300@43, got '43/60'"),
        (["--correct", "43/60@9"], "corrections: the shot has no frame 9"),
        (["--person", "all"], "source: expected a sequence or a movie whose person is found"),
    ):
        result = CliRunner().invoke(app, ["track", plates, "-o", str(kept), *further])
        assert result.exit_code == 2
        assert message in " ".join(result.output.split())


def test_a_job_without_the_networks_says_so(tmp_path):
    person.load.cache_clear()
    for number in (1, 2):
        relight.write(tmp_path / f"p.{number}.exr", linear(photograph((90, 70, 14))[0]))
    with pytest.warns(UserWarning, match="relight fetch person brings them.*Each machine follows the person"):
        relight.write_job(tmp_path / "job.json", tmp_path / "p.%d.exr", KEY, tmp_path / "o.%d.exr")
