import pytest

from relight.media.sequences import Frames, Sequence


@pytest.mark.parametrize(
    ("name", "first", "printf"),
    [
        ("plate.%04d.exr", "plate.0007.exr", "plate.%04d.exr"),
        ("plate.####.exr", "plate.0007.exr", "plate.%04d.exr"),
        ("plate_##.png", "plate_07.png", "plate_%02d.png"),
        ("%d.jpg", "7.jpg", "%01d.jpg"),
        ("shot.%03d", "shot.007", "shot.%03d"),
    ],
)
def test_frame_numbers(tmp_path, name, first, printf):
    sequence = Sequence.of(tmp_path / name)
    assert sequence.path(7) == tmp_path / first
    assert str(sequence) == str(tmp_path / printf)
    assert sequence.path(1234567).name.count("1234567") == 1


def test_numbers_are_those_on_the_disk(tmp_path):
    for number in (3, 1, 10, 12345):
        (tmp_path / f"a.{number:04d}.exr").touch()
    for other in ("a.7.exr", "a.00007.exr", "b.0001.exr", "a.0001.png", ".a.0002.exr", "a.0x01.exr"):
        (tmp_path / other).touch()
    (tmp_path / "a.0009.exr").mkdir()
    assert Sequence.of(tmp_path / "a.%04d.exr").numbers() == [1, 3, 10, 12345]
    assert Sequence.of(tmp_path / "gone" / "a.%04d.exr").numbers() == []


def test_single_files_are_no_sequence(tmp_path):
    assert Sequence.of(tmp_path / "plate.exr") is None
    (tmp_path / "take #3.png").touch()
    assert Sequence.of(tmp_path / "take #3.png") is None
    assert Sequence.of(tmp_path / "take #4.png") is not None


def test_two_frame_numbers_are_refused():
    with pytest.raises(ValueError, match="expected one frame number"):
        Sequence.of("a.%04d.####.exr")


def test_beside():
    assert Sequence.of("out/relit.%04d.exr").beside(".json").name == "relit.json"
    assert Sequence.of("out/%04d.exr").beside(".json").name == "frames.json"


@pytest.mark.parametrize(
    ("text", "numbers", "written"),
    [
        ("7", [7], "7"),
        ("1-4", [1, 2, 3, 4], "1-4"),
        ("1-6x2", [1, 3, 5], "1-5:2"),
        ("1-6:2", [1, 3, 5], "1-5:2"),
        ("30-31, 1-3,2-4,20", [1, 2, 3, 4, 20, 30, 31], "1-4,20,30-31"),
        ((3, 5), [3, 4, 5], "3-5"),
    ],
)
def test_frame_ranges(text, numbers, written):
    frames = Frames.of(text)
    assert list(frames) == numbers
    assert str(frames) == written
    assert Frames.of(str(frames)) == frames
    assert [n for chunk in frames.chunks(2) for n in chunk] == numbers
    assert all(len(chunk) <= 2 for chunk in frames.chunks(2))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected numbers such as 1-100"),
        ("1-", "expected numbers such as 1-100"),
        ("1-2,", "expected numbers such as 1-100"),
        ("5-3", "0 <= first <= last"),
        ("1-2x0", "steps of at least 1"),
        ("0-99999999999999999999", "0 <= first <= last"),
        ("9" * 5000, "expected numbers such as 1-100"),
        ("0-999999999", "up to 1000000 in all"),
    ],
)
def test_frame_ranges_that_are_none(text, message):
    with pytest.raises(ValueError, match=f"frames: .*{message}"):
        Frames.of(text)
