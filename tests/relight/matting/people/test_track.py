"""One person is followed through a shot; neither a passer-by nor furniture takes their place."""

import json

import numpy as np
import pytest

from relight.matting.people.region import Circle, DetectedPerson
from relight.matting.people.track import KeptTrack, Seen, Track

UP = np.array([0.0, -1.0])
RED, BLUE = (0.8, 0.2, 0.2), (0.2, 0.2, 0.8)
ROOM = np.full((14, 24, 3), 0.5, np.float32)


def somebody(x, colour=RED, radius=50.0, certainty=1.0):
    """A person at x, as they are seen; the smaller ones stand farther away."""
    person = DetectedPerson(
        Circle(np.array([x, 100.0]), radius, UP), np.ones((16, 16), np.float32), presence=certainty
    )
    return person, np.full((3, 3), colour)


def frames(*people, scenes=None):
    """What is seen in frames 1, 2...; None for a frame that cannot be read."""
    return {
        number: None
        if each is None
        else Seen(
            [p for p, _ in each],
            [c for _, c in each],
            ROOM if scenes is None else scenes[number - 1],
            (200, 400),
        )
        for number, each in enumerate(people, start=1)
    }


def track(seen, **arguments):
    def look(number, near):
        if seen[number] is None:
            raise OSError("cannot be read")
        return seen[number]

    return Track(look, sorted(seen), **arguments)


def places(followed, count):
    """The x of the person in each frame; None where they are not."""
    found = [followed.at(number) for number in range(1, count + 1)]
    return [None if circle is None else circle.centre[0] for circle in found]


def test_the_person_is_followed_past_a_larger_one():
    seen = frames(
        [somebody(100)],
        [somebody(115), somebody(300, BLUE, 80)],
        [somebody(130), somebody(200, BLUE, 80)],
        [somebody(145)],
    )
    assert places(track(seen), 4) == [100, 115, 130, 145]
    assert places(track({n: seen[n] for n in (1, 2)}), 2) == [100, 115]


def test_frames_are_the_same_in_any_order():
    seen = frames(*([somebody(100 + 15 * n), somebody(330 - 20 * n, BLUE, 60)] for n in range(6)))
    forward, backward = track(seen), track(seen)
    last = [backward.at(n) for n in (6, 3, 1, 5, 2, 4)]
    found = {n: circle.centre[0] for n, circle in zip((6, 3, 1, 5, 2, 4), last, strict=True)}
    assert [found[n] for n in range(1, 7)] == places(forward, 6)


def test_nobody_takes_the_place_of_somebody_who_has_left():
    seen = frames(
        [somebody(100)],
        [somebody(110)],
        [somebody(120, BLUE)],
        [somebody(300, BLUE)],
        [],
        [somebody(330, BLUE)],
    )
    assert places(track(seen), 6) == [100, 110, None, None, None, None]


def test_somebody_who_was_hidden_is_found_again():
    seen = frames([somebody(100)], [], None, [somebody(150)], [somebody(160), somebody(90, BLUE, 70)])
    assert places(track(seen), 5) == [100, None, None, 150, 160]


def test_whoever_comes_back_far_away_is_known_by_their_clothes():
    again = [somebody(320, BLUE), somebody(350, RED, certainty=0.95)]
    seen = frames([somebody(100)], [], again)
    assert places(track(seen), 3) == [100, None, 350]
    doubtful = frames([somebody(100)], [], [somebody(350, RED, certainty=0.5)])
    assert places(track(doubtful), 3) == [100, None, None]


def test_furniture_is_passed_over_until_somebody_comes():
    """Frames before the first certain one show what is near them there, or nobody."""
    seen = frames(
        [somebody(300, BLUE, 20, 0.6)],
        [somebody(300, BLUE, 20, 0.7)],
        [somebody(60, certainty=0.6)],
        [somebody(75)],
        [somebody(90)],
    )
    assert places(track(seen), 5) == [None, None, 60, 75, 90]


def test_an_uncertain_person_is_better_than_none():
    seen = frames([], [somebody(100, certainty=0.6)], [somebody(110, certainty=0.6)])
    assert places(track(seen), 3) == [None, 100, 110]
    assert places(track(frames([], [])), 2) == [None, None]


def test_who_is_asked_for_is_followed():
    seen = frames(*([somebody(100 + 10 * n, RED, 80), somebody(330, BLUE)] for n in range(3)))
    assert places(track(seen, person=(330, 100)), 3) == [330, 330, 330]
    assert places(track(seen, person=2), 3) == [330, 330, 330]
    with pytest.raises(ValueError, match="person: "):
        track(seen, person=3).at(1)


def test_the_size_of_somebody_who_bends_may_jump():
    seen = frames(
        [somebody(100, radius=80)], [somebody(100, radius=42, certainty=0.7)], [somebody(100, radius=80)]
    )
    assert places(track(seen), 3) == [100, 100, 100]


def test_corrections_hold_from_their_frame_on():
    seen = frames(*([somebody(100 + 10 * n, RED, 80), somebody(330, BLUE)] for n in range(4)))
    assert places(track(seen, corrections={3: (330, 100)}), 4) == [100, 110, 330, 330]


def test_a_cut_begins_again():
    other = np.zeros_like(ROOM)
    seen = frames(
        [somebody(100)],
        [somebody(110)],
        [somebody(300, BLUE, 70)],
        [somebody(290, BLUE, 70)],
        scenes=[ROOM, ROOM, other, other],
    )
    assert places(track(seen), 4) == [100, 110, 300, 290]


def test_a_track_is_kept(tmp_path):
    seen = frames([somebody(100)], [], [somebody(120.25)])
    reported = []
    track(seen).write(tmp_path / "t.json", lambda *done: reported.append(done))
    assert reported == [(1, 3), (2, 3), (3, 3)]
    kept = KeptTrack(tmp_path / "t.json")
    assert kept.at(2) is None
    np.testing.assert_allclose(kept.at(3).centre, (120.25, 100))
    assert kept.at(3).radius == 50
    with pytest.raises(ValueError, match=r"t\.json: has no frame 4"):
        kept.at(4)


def test_a_file_that_cannot_be_written_is_refused_before_anybody_is_followed(tmp_path):
    looked = []
    followed = Track(lambda number, near: looked.append(number), [1, 2])
    with pytest.raises(ValueError, match=r"ends in \.json"):
        followed.write(tmp_path / "t.txt")
    with pytest.raises(OSError, match="nowhere"):
        followed.write(tmp_path / "nowhere" / "t.json")
    assert not looked


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"track": 1}', '{"track": 1, "frames": {"1": [1, 2]}}', "[" * 100_000,
     '{"track": 1, "frames": {"1": [1, 2, 0, 1]}}', '{"track": 1, "frames": {"a": null}}',
     '{"track": 1, "frames": {"1": [NaN, 2, 3, 1]}}'],
)  # fmt: skip
def test_other_files_are_no_track(tmp_path, text):
    (tmp_path / "t.json").write_text(text)
    with pytest.raises(ValueError, match=r"t\.json: expected a track, as `relight track` writes it"):
        KeptTrack(tmp_path / "t.json")


def test_a_later_version_is_refused(tmp_path):
    (tmp_path / "t.json").write_text(json.dumps({"track": 2, "frames": {}}))
    with pytest.raises(ValueError, match="expected a track of version 1, got 2"):
        KeptTrack(tmp_path / "t.json")


def test_clothes_and_scene_are_taken_from_the_picture():
    picture = np.zeros((200, 400, 3), np.float32)
    picture[..., 2] = np.linspace(0, 1, 400)
    picture[40:100, 80:120], picture[100:160, 80:120] = (1, 0, 0), (0, 1, 0)
    mask = np.zeros((64, 64), np.float32)
    mask[16:48, 27:37] = 1
    person = DetectedPerson(Circle(np.array([100.0, 100.0]), 80.0, UP), mask)
    seen = Seen.of(picture, [person])
    np.testing.assert_allclose(seen.colours[0][0], (1, 0, 0), atol=0.05)
    np.testing.assert_allclose(seen.colours[0][2], (0, 1, 0), atol=0.05)
    assert max(seen.scene.shape) <= 24
    assert seen.scene[0, -1, 2] > 0.9
