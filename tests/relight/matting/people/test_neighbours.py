"""One of two people who stand side by side, with stand-ins for both networks: a person is what is red."""

import numpy as np
import pytest

from relight.matting.people import border as person_border
from relight.matting.people.finder import PersonFinder
from relight.matting.people.neighbours import second_look_beside
from relight.matting.people.region import Circle, DetectedPerson, sampled

SIZE, RADIUS = (240, 240), 90.0
LEFT, RIGHT = np.s_[60:200, 84:118], np.s_[60:200, 122:156]
HIPS = {"left": np.array([101.0, 130.0]), "right": np.array([139.0, 130.0])}


class Detector:
    """Sees one person in the whole picture, and all faces when it looks beside that one."""

    def __init__(self, faces):
        self.faces = faces

    def __call__(self, picture, share, least):
        return [(HIPS["left"], HIPS["left"] - [0, RADIUS])]

    def look(self, picture, squares, least, same_face):
        scene = Circle(HIPS["left"], 2 * RADIUS, np.array([0.0, -1.0])).square(512)
        points = [np.stack([HIPS[face], HIPS[face] - [0, RADIUS]]) for face in self.faces]
        return [tuple((each - scene[:, 2]) @ np.linalg.inv(scene[:, :2]).T) for each in points]


def finder(faces, presence=1.0):
    """A `PersonFinder` whose landmark network shows everything red, whoever it is."""

    def look(picture, circle, scale=1):
        seen = sampled(picture, circle.square(256), 256, "border")[0]
        return [DetectedPerson(circle, np.float32(seen[..., 0] - seen[..., 1] > 0.4), presence)]

    made = object.__new__(PersonFinder)
    made._detector, made.look = Detector(faces), look
    made.with_more_views = lambda encoded, choice: choice
    return made


@pytest.fixture(scope="module")
def picture():
    drawn = np.full((*SIZE, 3), 0.3, np.float32)
    drawn[LEFT] = drawn[RIGHT] = (1.0, 0.0, 0.0)
    return drawn


def shown(mask):
    return [float((mask[body] > 0.5).mean()) for body in (LEFT, RIGHT)]


def test_somebody_beside_another_is_found_without_them(picture):
    left, right = shown(finder(["left", "right"]).mask(picture))
    assert left > 0.95
    assert right < 0.02


def test_a_point_on_the_other_one_selects_them(picture):
    left, right = shown(finder(["left", "right"]).mask(picture, (140, 100)))
    assert right > 0.9
    assert left < 0.02


def test_everybody_is_everybody(picture):
    assert min(shown(finder(["left", "right"]).mask(picture, "all"))) > 0.95


@pytest.mark.parametrize(("faces", "presence"), [(["left"], 1.0), (["left", "right"], 0.7)])
def test_nothing_is_taken_from_somebody_alone_or_by_who_is_doubtful(picture, faces, presence):
    assert min(shown(finder(faces, presence).mask(picture))) > 0.95


@pytest.mark.parametrize(("first_look_takes_both", "legs"), [(False, 1.0), (True, 0.0)])
def test_a_second_look_counts_far_from_others_only_where_the_first_one_took_them(first_look_takes_both, legs):
    person, other = np.zeros((2, 256, 256), np.float32)
    person[40:220, 90:130] = other[40:80, 132:170] = 1.0
    share = np.ones((256, 256), np.float32)
    share[:, 134:] = 0.0
    second_look = person.copy()
    second_look[160:] = 0.0  # it has lost the legs
    first_look = np.maximum(person, other) if first_look_takes_both else person
    mask = second_look_beside(other, first_look, second_look, share)
    assert mask[50:150, 90:125].min() > 0.9
    assert mask[170:215, 90:130].mean() == pytest.approx(legs, abs=0.01)
    bones = np.zeros((2, 256, 256), bool)
    bones[0, 50:150, 108:112] = bones[1, 50:70, 148:152] = True
    border = person_border.within(np.zeros((256, 256, 3)), mask, other, *bones)
    assert np.minimum(mask, border)[40:80, 134:170].max() < 0.1


def test_the_border_between_two_people_follows_the_edge_of_their_clothes():
    red, blue = np.zeros((2, 256, 256), bool)
    red[60:200, 80:120] = red[100:120, 80:150] = True  # an arm before the other one
    blue[60:200, 120:160] = True
    blue &= ~red
    seen = np.where(red[..., None], (0.8, 0.2, 0.2), np.where(blue[..., None], (0.2, 0.2, 0.8), 0.5))
    straight = np.arange(256) < 120
    both = np.float32(red | blue)
    bones = [np.zeros_like(red), np.zeros_like(red)]
    bones[0][70:190, 98:102] = bones[1][140:190, 138:142] = True
    person = person_border.within(seen, both, both * ~straight, *bones)
    assert person[104:116, 84:146].min() > 0.9
    assert person[64:96, 124:156].max() < 0.1
    assert person[124:196, 124:156].max() < 0.1


def test_bones_are_drawn_within_the_mask_only():
    circle, landmarks = Circle(np.array([50.0, 50.0]), 40, np.array([0.0, -1.0])), np.full((39, 2), 50.0)
    landmarks[[11, 12, 23, 24]] = [[60, 20], [40, 20], [55, 50], [45, 50]]
    mask = np.zeros((256, 256), np.float32)
    mask[:, 128:] = 1
    drawn = person_border.bones(DetectedPerson(circle, mask, 1.0, landmarks), (100, 100))
    assert drawn[25:45, 52:55].all()
    assert not drawn[:, :49].any()
    assert not drawn[60:].any()
