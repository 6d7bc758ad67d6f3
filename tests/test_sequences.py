import pytest

from relight.media.sequences import Sequence


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
