"""Mattes as people have them: with specks, noise, and compressed as JPEG."""

import io
import warnings

import numpy as np
import pytest
import torch
from helpers import ROOT
from PIL import Image

import relight
from shadow.matte_cleanup import clean_matte

EXAMPLE = ROOT / "examples" / "person.png"
LIGHTS = [
    relight.DirectionalLight(azimuth=-50, elevation=30),
    relight.DirectionalLight(azimuth=100, elevation=10, colour=(0.5, 0.7, 1)),
]


@pytest.fixture
def figure():
    """A person 160 of 240 pixels high whose hand stands apart by 4 pixels."""
    matte = torch.zeros(240, 320)
    matte[40:200, 140:180] = 1
    matte[80:100, 184:190] = 1
    return matte


def test_a_clean_matte_is_kept_as_it_is(figure):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert torch.equal(clean_matte(figure), figure)
        assert torch.equal(clean_matte(torch.zeros(4, 4)), torch.zeros(4, 4))
        soft = torch.linspace(0, 1, 21).expand(30, 21)
        torch.testing.assert_close(clean_matte(soft), soft, atol=0.101, rtol=0)


@pytest.mark.parametrize("specks", [[(2, 2)], [(2, 2), (237, 317)], [(120, 300)]])
def test_stray_pixels_far_from_the_person_are_left_out_and_counted(figure, specks):
    spoiled = figure.clone()
    for row, column in specks:
        spoiled[row, column] = 1
    with pytest.warns(UserWarning, match=f"mask: {len(specks)} pixels in {len(specks)} small parts"):
        assert torch.equal(clean_matte(spoiled), figure)


def test_faint_noise_is_left_out(figure):
    noise = torch.from_numpy(np.random.default_rng(0).integers(0, 4, figure.shape) / 255).float()
    assert torch.equal(clean_matte(torch.maximum(figure, noise)), figure)


def test_two_people_stay_two(figure):
    pair = figure.clone()
    pair[150:200, 20:35] = 1  # a child, far to the left
    assert torch.equal(clean_matte(pair), pair)


def test_an_inverted_matte_is_warned_of(figure):
    with pytest.warns(UserWarning, match="is it inverted"):
        clean_matte(1 - figure)


@pytest.mark.parametrize("size", [(1, 400), (3, 1350)])
def test_a_sliver_is_refused(size):
    with pytest.raises(ValueError, match="mask: is too thin for its length"):
        relight.Subject(np.full((*size, 3), 0.3, np.float32), np.ones(size, np.float32))


@pytest.mark.usefixtures("full_canvas")
def test_a_line_and_two_far_pixels_give_a_picture():
    line, pair = np.zeros((2, 200, 200), np.float32)
    line[20:180, 100], pair[0, 0], pair[-1, -1] = 1, 1, 1
    for mask in (line, pair):
        assert np.isfinite(relight.apply(np.full((200, 200, 3), 0.3, np.float32), LIGHTS, mask=mask)).all()


@pytest.fixture(scope="module")
def plate():
    """A photograph of 1080 x 1920 with a person 982 pixels high, their matte, and what is made of it."""
    person, rng = relight.read(EXAMPLE), np.random.default_rng(0)
    # The bundled person is 881 pixels high.
    placed = relight.place(person, (1080, 1920), mode="centre", scale=982 / 881)
    matte = placed[..., 3]
    behind = np.linspace(0.1, 0.5, 1920)[:, None] + 0.02 * rng.random((1080, 1920, 3))
    photo = (placed[..., :3] + (1 - matte[..., None]) * behind).astype(np.float32)
    return photo, matte, relight.Subject(photo, matte).relit(LIGHTS)


def _compressed(matte):
    file = io.BytesIO()
    Image.fromarray((matte * 255).round().astype(np.uint8)).save(file, "JPEG", quality=75)
    return np.asarray(Image.open(file)) / np.float32(255)


def _specked(matte, *places):
    matte = matte.copy()
    for place in places:
        matte[place] = 1
    return matte


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:mask:UserWarning")
@pytest.mark.parametrize(
    "spoil",
    [
        lambda matte: _specked(matte, (2, 2)),
        lambda matte: _specked(matte, (2, 2), (-3, -3)),
        lambda matte: np.maximum(matte, np.random.default_rng(1).integers(0, 4, matte.shape) / 255),
        _compressed,
    ],
    ids=["a speck", "two specks", "noise", "JPEG"],
)
def test_an_imperfect_matte_hardly_changes_the_picture(plate, spoil):
    photo, matte, picture = plate
    spoiled = spoil(matte).astype(np.float32)
    found, inside = relight.Subject(photo, spoiled).relit(LIGHTS), matte > 0.99
    np.testing.assert_array_equal(found[..., 3], spoiled)  # the alpha is the caller's
    change = np.abs(found - picture)[inside][:, :3].mean() / picture[inside][:, :3].mean()
    assert change < 0.005
