"""Who is in a photograph, and photographs that are turned: what the worker answers of both."""

import numpy as np
import pytest
from helpers.finders import discs
from PIL import ExifTags, Image

import relight
from relight.app import people, tasks
from relight.matting.people.region import Circle, DetectedPerson
from relight.media import images

pytest.importorskip("openvino")


def silent(what, share=None):
    """Take a report of progress."""


@pytest.fixture
def two(here, fetched):
    """A photograph of two people, a large and a small disc, in the working folder; where both are."""
    picture, where = discs((300, 400), (110, 150, 45), (300, 170, 28))
    Image.fromarray(np.round(255 * picture).astype(np.uint8)).save("two.png")
    tasks.read("two.png", silent)
    return where


def test_everybody_is_outlined_and_each_can_be_chosen(two):
    first = tasks.find_person(1, silent)
    assert first["model"] == "person-1"
    assert [each["number"] for each in first["people"]] == [1, 2]
    for each, centre in zip(first["people"], ((110, 150), (300, 170)), strict=True):
        line = np.concatenate(each["lines"]) * (400, 300)
        np.testing.assert_allclose((line.min(axis=0) + line.max(axis=0)) / 2, centre, atol=6)
    assert tasks.find_person(2, silent)["model"] == "person-2"
    assert tasks.find_person(people.EVERYONE, silent)["model"] == "everyone"
    large, other, both = (
        np.load(f"{name}.npy").astype(float) > 0.5 for name in ("person-1", "person-2", "everyone")
    )
    assert large[two[0]].mean() > 0.8 > 0.1 > large[two[1]].mean()
    assert other[two[1]].mean() > 0.8 > 0.1 > other[two[0]].mean()
    assert both[two[0]].mean() > 0.8
    assert both[two[1]].mean() > 0.8
    drawn = {"model": "person-2", "strokes": []}
    assert (
        tasks.outline_of(drawn, silent)["png"]
        != tasks.outline_of({**drawn, "model": "person-1"}, silent)["png"]
    )
    with pytest.raises(ValueError, match="person: expected 1 to 2, got 3"):
        tasks.find_person(3, silent)


def test_what_is_odd_is_told():
    size = (100, 80)
    person = DetectedPerson(Circle(np.array([40.0, 50.0]), 30.0, np.array([0.0, -1.0])), np.ones((256, 256)))
    matte = person.on(size)
    of = lambda who, turns=0: people.Found(np.zeros((*size, 3), np.float32), [who], turns)  # noqa: E731
    assert of(person).oddity(1, matte) is None
    assert of(person).oddity(1, matte * (np.arange(100) < 30)[:, None]) == "small"
    doubtful = DetectedPerson(person.circle, person.mask, presence=0.5)
    assert of(doubtful).oddity(people.EVERYONE, matte) == "uncertain"
    assert of(person, turns=2).oddity(1, matte) == "turned"


def test_a_picture_that_is_not_upright_says_how_to_turn_it(finder, monkeypatch):
    picture, _ = discs((300, 200), (100, 150, 50))
    assert finder.turns_to_upright(picture, finder.people(picture)) == 0
    monkeypatch.setattr(finder, "_detector", lambda seen, share, score: [(np.zeros(2), np.ones(2))])

    def upright_if_wide_and_first(picture, around, scale):
        marked = float(picture[0, :100, :100].mean()) > 0.9  # the bright corner is at the top left
        circle = Circle(np.array([50.0, 50.0]), 40.0, np.array([0.0, -1.0]))
        return [DetectedPerson(circle, np.ones((256, 256)), 1.0 if marked else 0.2)]

    monkeypatch.setattr(finder, "look", upright_if_wide_and_first)
    for turns in (1, 2, 3):
        marked = np.zeros((300, 200, 3), np.float32)
        marked[:150, :150] = 1
        turned = np.ascontiguousarray(np.rot90(marked, turns))  # clockwise turns bring it back
        assert finder.turns_to_upright(turned, []) == turns


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_turned_photograph_has_the_same_light(here, turns):
    codes = np.random.default_rng(0).integers(0, 255, (24, 36, 3), np.uint8)
    Image.fromarray(codes).save("me.png")
    assert tasks.turn("me.png", turns, silent) == {"name": "me-turned.png"}
    np.testing.assert_array_equal(
        relight.read("me-turned.png")[..., :3], np.rot90(relight.read("me.png")[..., :3], -turns)
    )


def test_orientation_and_further_metadata_come_along_and_deep_colours_stay(here):
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation], exif[ExifTags.Base.Model] = 6, "Camera"
    Image.fromarray(np.full((24, 36, 3), 90, np.uint8)).save("me.jpg", exif=exif, quality=98)
    assert images.read("me.jpg").shape[:2] == (36, 24)
    assert tasks.turn("me.jpg", 1, silent) == {"name": "me-turned.png"}
    assert images.read("me-turned.png").shape[:2] == (24, 36)
    with Image.open("me-turned.png") as picture:
        assert picture.getexif()[ExifTags.Base.Model] == "Camera"
    bright = np.random.default_rng(1).uniform(0, 5, (20, 30, 3)).astype(np.float32)
    images.write("sun.exr", bright, depth="float")
    assert tasks.turn("sun.exr", 1, silent) == {"name": "sun-turned.exr"}
    np.testing.assert_array_equal(images.read("sun-turned.exr")[..., :3], np.rot90(bright, -1))


def test_what_was_found_is_forgotten_when_a_photograph_is_turned(two, here):
    tasks.find_person(1, silent)
    assert (here / "person-1.npy").exists()
    assert tasks.turn("two.png", 2, silent)["name"] == "two-turned.png"
    assert not (here / "person-1.npy").exists()
    tasks.read("two-turned.png", silent)
    assert tasks.find_person(1, silent)["people"][0]["number"] == 1
    assert tasks.turn("two.png", 0, silent)["name"] == "two.png"
