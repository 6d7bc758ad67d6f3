import pytest
import torch

from shadow.framing import Extension, Framing, bounding_box, canvas_size


def person(height, width, box):
    mask = torch.zeros(height, width)
    top, left, bottom, right = box
    mask[top:bottom, left:right] = 1
    return mask


def test_bounding_box_and_empty_mask():
    assert bounding_box(person(50, 40, (5, 10, 45, 30))) == (5, 10, 45, 30)
    with pytest.raises(ValueError, match="mask: is empty"):
        bounding_box(torch.zeros(4, 4))


def test_a_canvas_has_four_by_three_sides_and_a_multiple_of_128_rows():
    assert canvas_size(256) == (256, 192)
    with pytest.raises(ValueError, match="multiple of 128"):
        canvas_size(200)


@pytest.mark.parametrize("box", [(10, 30, 190, 90), (80, 10, 130, 190), (1, 1, 199, 199)])
def test_subject_fills_the_canvas_but_for_the_margin(box):
    framing = Framing.around(person(200, 200, box), 256)
    top, left, bottom, right = bounding_box(framing.crop(person(200, 200, box)[None])[0])
    assert max((bottom - top) / 256, (right - left) / 192) == pytest.approx(0.92, abs=0.02)
    assert (top + bottom) / 2 == pytest.approx(128, abs=1.5)
    assert (left + right) / 2 == pytest.approx(96, abs=1.5)


@pytest.mark.parametrize("size", [90, 240, 1000])
def test_crop_and_restore_are_inverse(size):
    y, x = torch.meshgrid(torch.linspace(0, 1, size), torch.linspace(0, 1, size), indexing="ij")
    plate = torch.stack([x, y, 0.5 + 0.3 * torch.sin(6 * x) * torch.cos(5 * y)])
    box = tuple(int(v * size) for v in (0.1, 0.3, 0.9, 0.7))
    framing = Framing.around(person(size, size, box), 256)
    back = framing.restore(framing.crop(plate))
    top, left, bottom, right = box
    assert (back - plate)[:, top:bottom, left:right].abs().max() < 0.02


def test_onto_takes_one_canvas_to_another():
    first = Framing((90.0, 120.0), 0.8, (256, 192), (240, 200))
    second = Framing((100.0, 110.0), 1.1, (128, 96), (240, 200))
    plate = torch.tensor([70.0, 95.0])
    here, there = (
        (plate - torch.tensor(framing.centre)) * framing.scale + torch.tensor(framing.canvas[::-1]) / 2
        for framing in (first, second)
    )
    matrix = first.onto(second)
    torch.testing.assert_close(matrix[:, :2] @ here + matrix[:, 2], there)
    torch.testing.assert_close(first.onto(first), torch.tensor([[1.0, 0, 0], [0, 1, 0]]))
    assert first.shifted(5, 7, (300, 300)).centre == (95, 127)


def test_extend_keeps_the_inside_and_continues_outside():
    mask = person(40, 40, (10, 10, 30, 30))
    values = torch.full((2, 40, 40), 0.7) * mask
    extended = Extension(mask, reach=5 / 40)(values)
    torch.testing.assert_close(extended[:, 10:30, 10:30], values[:, 10:30, 10:30])
    torch.testing.assert_close(extended[:, 5:35, 15:25], torch.full((2, 30, 10), 0.7))
    assert extended[:, :4].abs().max() == 0


@pytest.mark.parametrize(
    "box", [(60, 50, 200, 150), (0, 50, 120, 150), (60, 0, 160, 60), (60, 140, 160, 200)]
)
def test_a_side_cut_by_the_frame_has_no_margin(box):
    """As in training: the canvas cuts a portrait where the plate does."""
    mask = person(200, 200, box)
    framed = Framing.around(mask, 256).crop(mask[None])[0] > 0.5
    top, left, bottom, right = bounding_box(framed)
    touches = [box[0] == 0, box[1] == 0, box[2] == 200, box[3] == 200]
    assert [top == 0, left == 0, bottom == 256, right == 192] == touches
