"""Lights that follow a part of the person."""

import numpy as np
import pytest
from helpers.standins import FlatShots, FlatSubject, somebody

import relight
from relight.analysis import joints, skin
from relight.lights.moving import parse
from relight.pipeline.shot import Shot

LAMP = relight.PointLight((0, 0.1, 0.25), at="left-hand", name="lamp")


@pytest.fixture
def available(monkeypatch):
    monkeypatch.setattr(skin, "is_available", lambda: True)


class Waving(FlatSubject):
    """Somebody whose hand is as far to the right as they are bright, and is not seen at 0.3."""

    @property
    def joints(self):
        brightness = float(self.image[..., 0].max())
        return {} if round(brightness, 1) == 0.3 else {"left-hand": (brightness, 0.0, 0.0)}


class Waves(FlatShots):
    def analyse(self, *arguments, **options):
        self.made.append(Waving(*arguments, **options))
        return self.made[-1]


def positions_of(source, numbers, light=LAMP, **settings):
    """Where a light is in frames of a shot."""
    with Shot.open(relight.Source(source, **settings), light, analyse=Waves().analyse) as shot:
        found = []
        for number in numbers:
            shot.person(number)
            (there,) = shot.lights.placed(number)
            assert there.at is None
            found.append(there.position)
    return np.array(found)


def test_it_stands_beside_the_part_smoothed_over_time(plates, available):
    found = positions_of(plates, range(101, 106))
    # Brightness 0.1 to 0.5 in frames 101 to 105, of which 103 is unseen: weights 3, 2, 1 by distance.
    middle = (1 * 0.1 + 2 * 0.2 + 2 * 0.4 + 1 * 0.5) / 6
    first = (3 * 0.1 + 2 * 0.2) / 5
    np.testing.assert_allclose(found[[0, 2], 0], [first, middle], atol=1e-3)
    np.testing.assert_allclose(found[:, 1:], [(0.1, 0.25)] * 5)


def test_frames_are_the_same_wherever_a_run_begins(plates, available):
    np.testing.assert_array_equal(positions_of(plates, [104]), positions_of(plates, range(101, 105))[-1:])


def test_a_part_that_is_not_seen_is_said(plates, available):
    with pytest.raises(ValueError, match=r"lamp: frame 103: at=left-hand is not seen; choose another part"):
        positions_of(plates, [103], temporal_radius=0)


def test_keyframes_and_orbits_go_round_the_part(plates, available):
    moving = relight.MovingLight(
        relight.PointLight, at="left-hand", position={101: (0, 0, 1), 105: (0, 1, 1)}
    )
    found = positions_of(plates, [101, 105], moving)
    np.testing.assert_allclose(found[:, 1:], [(0, 1), (1, 1)])
    assert found[1, 0] > found[0, 0] > 0.1
    circling = parse("lamp:at=head,orbit=4,position=0/0/1")
    np.testing.assert_allclose(circling.at(2).position, (1, 0, 0), atol=1e-9)


def test_without_the_networks_a_line_says_what_to_do(stub, tmp_path, monkeypatch):
    monkeypatch.setattr(skin, "is_available", lambda: False)
    with pytest.raises(ValueError, match=r"lamp: at=left-hand needs the networks .*relight fetch person"):
        stub.render(somebody(), LAMP, tmp_path / "r.png")
    assert stub.made == []


def test_texts_and_files_hold_it(tmp_path):
    text = parse("lamp:at=left-hand,position=0/0.1/0.25")
    assert text == LAMP
    assert parse("lamp:at=hips,position=0/1/0,toward=0/0/0,width=1,height=1").at == "hips"
    relight.write_lights(tmp_path / "l.yaml", [LAMP])
    assert relight.read_lights(tmp_path / "l.yaml") == [LAMP]
    with pytest.raises(ValueError, match="at: expected one of head, hips, left-hand, right-hand, got 'foot'"):
        parse("at=foot,position=0/0/1")


def test_a_rectangle_turns_with_it():
    softbox = relight.RectLight((0, 1, 1), toward=(0, 0, 0), width=1, height=1, at="hips")
    there = softbox.standing_at((1, 2, 3))
    assert (there.position, there.toward, there.at) == ((1, 3, 4), (1, 2, 3), None)


@pytest.mark.parametrize("name", ["l.usda", "l.gltf"])
def test_scenes_and_the_viewer_refuse_it(tmp_path, name):
    pytest.importorskip("pxr")
    with pytest.raises(ValueError, match="lamp: at=left-hand is for pictures and shots"):
        relight.write_lights(tmp_path / name, [LAMP])
    with pytest.raises(ValueError, match="lamp: at=left-hand is for pictures and shots"):
        list(LAMP.points)


def test_the_parts_of_a_body_are_at_its_surface(monkeypatch):
    """A flat person at the depth of the middle: pixels become metres by the camera alone."""
    image = np.zeros((96, 64, 4), np.float32)
    image[8:88, 16:48] = (0.5, 0.5, 0.5, 1)
    subject = relight.Subject(image, depth=np.zeros((96, 64), np.float32))
    maps = subject.record.maps
    pixels = np.full((33, 2), np.nan)
    row, column = maps.geometry.pixel_at(np.array([0.1, 0.5, 0.0]))
    pixels[[7, 8]] = column + 0.5, row + 0.5
    monkeypatch.setattr(skin, "joints", lambda image, known: pixels)
    found = joints.find(maps)
    assert list(found) == ["head"]
    np.testing.assert_allclose(found["head"], (0.1, 0.5, 0), atol=0.02)
