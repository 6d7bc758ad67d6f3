"""People found by two networks: small ones, made here, whose answer is known."""

import subprocess
import sys

import numpy as np
import pytest
from helpers.finders import discs, small_finder

from relight.errors import EmptyMatteError
from relight.matting.people import choice as person_choice
from relight.matting.people import detector as person_detector
from relight.matting.people import finder as person
from relight.matting.people import region as person_region
from relight.matting.people.choice import Choice
from relight.matting.people.region import Circle, DetectedPerson, View, joined


def overlap(mask, where):
    found = mask > 0.5
    return (found & where).sum() / (found | where).sum()


@pytest.mark.parametrize("size", [(300, 300), (200, 420), (900, 500)])
def test_the_mask_lies_where_the_person_is(finder, size):
    picture, (where,) = discs(size, (0.6 * size[1], 0.4 * size[0], 0.06 * max(size)))
    mask = finder.mask(picture)
    assert (mask.shape, mask.dtype) == (size, np.float32)
    assert overlap(mask, where) > 0.95


def test_somebody_whom_the_frame_cuts_is_found(finder):
    picture, (where,) = discs((300, 300), (6, 150, 20))
    assert overlap(finder.mask(picture), where) > 0.95


def test_a_person_too_small_for_the_detector_is_found_in_a_part_of_the_picture(finder):
    picture, (where,) = discs((1200, 1600), (1210, 333, 12))
    assert overlap(finder.mask(picture), where) > 0.9


@pytest.fixture(scope="module")
def three(finder):
    """Three people, found: the largest first; and where each is, in (300, 300)."""
    picture, (small, large, middle) = discs((300, 300), (50, 60, 15), (220, 220, 26), (60, 230, 20))
    return finder.people(picture, thorough=True), (large, middle, small)


def test_one_of_several_people_is_chosen(three):
    found, people = three
    assert len(found) == 3
    large, middle, small = people
    size = (300, 300)
    assert overlap(person_choice.Choice.of(found, None, size).mask(), large) > 0.9
    for number, where in enumerate(people, start=1):
        assert overlap(person_choice.Choice.of(found, number, size).mask(), where) > 0.9
    assert overlap(person_choice.Choice.of(found, (70, 90), size).mask(), small) > 0.9
    assert overlap(person_choice.Choice.of(found, found[1].circle, size).mask(), middle) > 0.9
    assert overlap(person_choice.Choice.of(found, "all", size).mask(), large | middle | small) > 0.9


@pytest.mark.parametrize("chosen", [0, 4, True, 1.5, "both", (500, 10), (1, 2, 3)])
def test_a_person_who_is_not_there_is_refused(three, chosen):
    with pytest.raises(ValueError, match="person: expected"):
        person_choice.Choice.of(three[0], chosen, (300, 300))


def test_nobody_is_refused(finder, tmp_path):
    empty, _ = discs((300, 300))
    with pytest.raises(EmptyMatteError, match="found no person in the photograph"):
        finder.mask(empty)
    doubtful, _ = discs((300, 300), (150, 150, 30))
    with pytest.raises(EmptyMatteError, match="found no person"):
        small_finder(tmp_path, presence=0.2).mask(doubtful)


def test_who_is_upright_is_taken_before_what_lies_and_is_larger():
    def seen(centre, radius, up, presence):
        circle = Circle(np.array(centre), radius, np.array(up))
        return DetectedPerson(circle, np.ones((256, 256), np.float32), presence)

    standing, lying = seen((100.0, 150.0), 60, (0.0, -1.0), 0.9), seen((400.0, 150.0), 90, (1.0, 0.0), 1.0)
    assert standing.certainty > person.CERTAIN > lying.certainty
    again = seen((100.0, 155.0), 60, (0.0, -1.0), 0.95)
    kept = person_choice.distinct([lying, standing, again], (300, 600))
    assert [each is other for each, other in zip(kept, [again, lying], strict=True)] == [True, True]


def test_a_doubtful_person_takes_nothing_from_a_certain_one():
    circle = Circle(np.array([100.0, 150.0]), 60, np.array([0.0, -1.0]))
    mask, other = np.full((256, 256), 0.8, np.float32), np.ones((256, 256), np.float32)
    for presence, least in ((0.5, 0.7), (0.9, 0.1)):
        found = [DetectedPerson(circle, mask), DetectedPerson(circle, other, presence)]
        assert (person_choice.Choice.of(found, 1, (300, 200)).mask()[150, 100] > 0.5) == (least > 0.5)


def test_a_turned_square_and_its_mask_agree():
    """The way to the network's canvas and back is the same for a person who leans."""
    circle = Circle.of(np.array([60.0, 70.0]), np.array([90.0, 40.0]))
    square = circle.square(256)
    rim = (np.array([90.0, 40.0]) - square[:, 2]) @ np.linalg.inv(square[:, :2]).T
    np.testing.assert_allclose(rim, [128, 128 - 128 / person_region.ROOM], atol=1e-9)
    upper = np.zeros((256, 256), np.float32)
    upper[:128] = 1
    mask = DetectedPerson(circle, upper).on((140, 150))
    assert mask[55, 75] == pytest.approx(1, abs=1e-5)
    assert mask[85, 45] == pytest.approx(0, abs=1e-5)


def looked(masks, circle=None, size=(400, 400)):
    circle = circle or Circle(np.array([200.0, 200.0]), 100, np.array([0.0, -1.0]))
    return View(circle, masks, (1.0, 1.0), np.zeros((39, 2)), circle, size)


def test_a_look_is_doubted_where_it_is_grey_and_where_its_mirror_image_differs():
    sure, other, grey = (np.zeros((256, 256), np.float32) for _ in range(3))
    sure[64:192, 64:192], other[64:192, 128:192], grey[64:192, 64:192] = 1, 1, 0.5
    assert looked((sure, sure)).uncertainty == 0
    assert looked((grey, grey)).uncertainty == pytest.approx(2)
    assert looked((sure, other)).uncertainty == pytest.approx(4 / 3)
    below = sure.copy()
    below[192:] = 0.5  # beyond the picture's lower end, which is no matter
    high = Circle(np.array([200.0, 340.0]), 100, np.array([0.0, -1.0]))
    assert looked((below, below), high).uncertainty == 0


def test_one_person_alone_is_seen_in_more_views(finder):
    """Beside others, all views may agree on a part of a neighbour."""
    alone, (where,) = discs((300, 300), (220, 220, 26))
    choice = finder.choose(alone)
    assert finder.with_more_views(alone, choice) != choice
    assert overlap(finder.mask(alone), where) > 0.95
    beside, (where, _) = discs((300, 300), (220, 220, 26), (60, 230, 20))
    choice = finder.choose(beside)
    assert finder.with_more_views(beside, choice) is choice
    assert overlap(finder.mask(beside), where) > 0.95


def test_where_no_view_is_sure_the_first_mask_stands(finder):
    """What is half as red as a disc may be a person or not."""
    circle = Circle(np.array([200.0, 200.0]), 100, np.array([0.0, -1.0]))
    first = Choice((DetectedPerson(circle, np.ones((256, 256), np.float32)),), 0, (400, 400))
    pink = np.full((400, 400, 3), (0.9, 0.5, 0.5), np.float32)
    assert finder.with_more_views(pink, first) is first


def test_looks_are_joined_in_place_and_by_weight():
    circle = Circle(np.array([200.0, 200.0]), 100, np.array([0.0, -1.0]))
    whole, half = np.ones((256, 256), np.float32), np.zeros((256, 256), np.float32)
    half[:, :128] = 1
    looks = [looked((whole, whole), circle.of_size(0.5)), looked((half, half), circle)]
    mask = joined(looks, circle, 512, (3.0, 1.0))
    assert mask[256, 320] == pytest.approx(0.75)  # both see it
    assert mask[256, [20, 192, 480]] == pytest.approx([1, 1, 0], abs=1e-5)


def test_anchors_are_those_of_the_detector():
    anchors = person_detector.anchor_centres()
    assert anchors.shape == (2254, 2)
    np.testing.assert_allclose(anchors[[0, 1, 2, -1]], np.array([[4, 4], [4, 4], [12, 4], [208, 208]]) / 224)


def test_the_parts_cover_the_picture_to_its_rim():
    assert [*person_detector.picture_parts(100, 60, 1.0)] == [(0.0, -20.0, 100.0)]
    assert [*person_detector.picture_parts(100, 60, 1.4)] == [(-20.0, 0.0, 140.0)]
    parts = [*person_detector.picture_parts(100, 60, 0.5)]
    assert {(left, top) for left, top, _ in parts} == {(left, top) for left in (0, 25, 50) for top in (0, 10)}


def test_openvino_reports_nothing(tmp_path):
    """Its telemetry would leave an identity in the home folder, and open a connection."""
    script = (
        "import socket, sys\n"
        "def refused(*_, **__): raise SystemExit('a connection')\n"
        "socket.socket.connect = socket.getaddrinfo = refused\n"
        "from relight.matting import openvino_runtime\n"
        "openvino_runtime.openvino().Core()\n"
        "assert 'openvino_telemetry' not in sys.modules\n"
        "import openvino.tools.ovc.telemetry_utils as used\n"
        "assert used.tm.__name__ == 'openvino.tools.ovc.telemetry_stub', used.tm\n"
    )
    environment = {"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"}
    subprocess.run([sys.executable, "-c", script], check=True, env=environment)
    assert not [*tmp_path.rglob("*")]
