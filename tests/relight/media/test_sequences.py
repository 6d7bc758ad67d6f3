import pytest

import relight
from relight.media.sequences import FrameRange, FrameSequence, SequenceReader


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
def test_the_number_stands_in_place_of_the_pattern(tmp_path, name, first, printf):
    sequence = FrameSequence.of(tmp_path / name)
    assert sequence.path(7) == tmp_path / first
    assert str(sequence) == str(tmp_path / printf)
    assert sequence.path(1234567).name.count("1234567") == 1


def test_numbers_are_those_on_the_disk(tmp_path):
    for number in (3, 1, 10, 12345):
        (tmp_path / f"a.{number:04d}.exr").touch()
    for other in ("a.7.exr", "a.00007.exr", "b.0001.exr", "a.0001.png", ".a.0002.exr", "a.0x01.exr"):
        (tmp_path / other).touch()
    (tmp_path / "a.0009.exr").mkdir()
    assert FrameSequence.of(tmp_path / "a.%04d.exr").numbers() == [1, 3, 10, 12345]
    assert FrameSequence.of(tmp_path / "gone" / "a.%04d.exr").numbers() == []


def test_negative_numbers_are_named_as_in_c(tmp_path):
    sequence = FrameSequence.of(tmp_path / "a.%04d.exr")
    for number, name in ((-3, "a.-003.exr"), (-12345, "a.-12345.exr"), (0, "a.0000.exr")):
        assert sequence.path(number).name == name
        sequence.path(number).touch()
    (tmp_path / "a.-3.exr").touch()
    assert sequence.numbers() == [-12345, -3, 0]


def test_frames_of_other_digits_are_named(tmp_path):
    for name in ("a.-002.png", "a.-0001.png", "a.0001.png", "a.7.png"):
        (tmp_path / name).write_bytes(b"")
    with pytest.warns(UserWarning, match=r"leaves out a\.-0001\.png and 1 more, whose frame number has"):
        reader = SequenceReader(FrameSequence.of(tmp_path / "a.%04d.png"), relight.read)
    assert reader.numbers == [-2, 1]


def test_single_files_are_no_sequence(tmp_path):
    assert FrameSequence.of(tmp_path / "plate.exr") is None
    (tmp_path / "take #3.png").touch()
    assert FrameSequence.of(tmp_path / "take #3.png") is None
    assert FrameSequence.of(tmp_path / "take #4.png") is not None


def test_two_frame_numbers_are_refused():
    with pytest.raises(ValueError, match="expected one frame number"):
        FrameSequence.of("a.%04d.####.exr")


def test_a_file_beside_a_sequence_takes_its_name_or_frames():
    assert FrameSequence.of("out/relit.%04d.exr").beside(".json").name == "relit.json"
    assert FrameSequence.of("out/%04d.exr").beside(".json").name == "frames.json"


@pytest.mark.parametrize(
    ("text", "numbers", "written"),
    [
        ("7", [7], "7"),
        ("1-4", [1, 2, 3, 4], "1-4"),
        ("1-6x2", [1, 3, 5], "1-5:2"),
        ("1-6:2", [1, 3, 5], "1-5:2"),
        ("30-31, 1-3,2-4,20", [1, 2, 3, 4, 20, 30, 31], "1-4,20,30-31"),
        ((3, 5), [3, 4, 5], "3-5"),
        ("-3-2", [-3, -2, -1, 0, 1, 2], "-3-2"),
        ("-10--6x2,-1", [-10, -8, -6, -1], "-10,-8,-6,-1"),
        ((-2, -1), [-2, -1], "-2--1"),
    ],
)
def test_ranges_are_read_written_and_split_into_chunks(text, numbers, written):
    frames = FrameRange.of(text)
    assert list(frames) == numbers
    assert str(frames) == written
    assert FrameRange.of(str(frames)) == frames
    assert [n for chunk in frames.chunks(2) for n in chunk] == numbers
    assert all(len(chunk) <= 2 for chunk in frames.chunks(2))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected numbers such as 1-100"),
        ("1-", "expected numbers such as 1-100"),
        ("1-2,", "expected numbers such as 1-100"),
        ("5-3", "-?[0-9]+ <= first <= last"),
        ("1-2x0", "steps of at least 1"),
        ("0-99999999999999999999", "-?[0-9]+ <= first <= last"),
        ("9" * 5000, "expected numbers such as 1-100"),
        ("0-999999999", "up to 1000000 in all"),
    ],
)
def test_frame_ranges_that_are_none(text, message):
    with pytest.raises(ValueError, match=f"frames: .*{message}"):
        FrameRange.of(text)


@pytest.mark.parametrize(
    ("pattern", "written"),
    [
        ("a.%04d.png", ["a.-012.png", "a.-001.png", "a.0000.png"]),
        ("a.###.png", ["a.-12.png", "a.-01.png", "a.000.png"]),
        ("a.%d.png", ["a.-12.png", "a.-1.png", "a.0.png"]),
        ("a_%06d_b.png", ["a_-00012_b.png", "a_-00001_b.png", "a_000000_b.png"]),
    ],
)
def test_negative_frames_of_every_pattern(tmp_path, pattern, written):
    for name in written:
        (tmp_path / name).touch()
    sequence = FrameSequence.of(tmp_path / pattern)
    assert sequence.numbers() == [-12, -1, 0]
    assert [sequence.path(number).name for number in (-12, -1, 0)] == written
    frames = FrameRange.of("-12--1,0")
    assert frames == tuple(range(-12, 1))
    assert str(frames) == "-12-0"


@pytest.mark.parametrize("name", ["take#2.png", "50%done.png"])
def test_signs_within_a_word_are_no_frame_number(tmp_path, name):
    assert FrameSequence.of(tmp_path / name) is None


def test_signs_within_a_word_are_a_frame_number_of_files_that_there_are(tmp_path):
    (tmp_path / "take12b.png").touch()
    assert FrameSequence.of(tmp_path / "take#b.png").numbers() == [12]


@pytest.mark.parametrize("name", ["p.%0900000000d.exr", "p.%021d.exr", f"p.{'#' * 60}.exr"])
def test_frame_numbers_of_too_many_digits_are_refused(name):
    with pytest.raises(ValueError, match=r"expected a frame number of up to 20 digits"):
        FrameSequence.of(name)
    assert FrameSequence.of("p.%020d.exr").path(3).name == f"p.{3:020}.exr"
