import numpy as np
import pytest
import torch
from helpers.cutouts import disc
from helpers.sphere import sphere

pytest.importorskip("kornia")

from shadow.data import cutouts, records


def test_a_cutout_is_read_as_it_was_written(tmp_path):
    person = disc(hands=[(3.0, 4.5, 2.0)])
    cutouts.write(tmp_path / "a.png", person)
    again = cutouts.read(tmp_path / "a.png")
    np.testing.assert_array_equal(again.colour, person.colour)
    np.testing.assert_array_equal(again.alpha, person.alpha)
    assert [tuple(hand) for hand in again.hands] == [(3.0, 4.5, 2.0)]


def test_linear_colour_is_premultiplied():
    layer = disc(colour=(255, 0, 0)).linear
    torch.testing.assert_close(layer[0], layer[3])
    assert not layer[1:3].any()


def test_a_record_becomes_a_cutout_of_half_its_size():
    record = sphere()
    person = cutouts.cutout(record, np.random.default_rng(0))
    assert person.alpha.shape == tuple(side // 2 for side in record.mask.shape)
    assert abs((person.alpha / 255).sum() * 4 - record.mask.sum()) < 0.01 * record.mask.sum()
    partly = (person.alpha > 0) & (person.alpha < 255)  # two by two pixels of the edge are partly covered
    assert partly.any()
    assert person.colour[partly].max(axis=1).mean() > 20  # and their colour is that of the person


def test_the_frame_cuts_who_touches_it():
    person = disc()
    assert person.frame == (False,) * 4
    cut = cutouts.Cutout(person.colour[:32], person.alpha[:32], [])
    assert cut.frame == (False, True, False, False)


def test_cutouts_of_records_are_written_once(tmp_path):
    (tmp_path / "records").mkdir()
    records.write(tmp_path / "records" / "ball.npz", sphere())
    out = tmp_path / "cutouts"
    assert cutouts.write_all([tmp_path / "records"], out, 2) == 2
    first, second = (cutouts.read(out / f"ball-{number}.png") for number in range(2))
    assert (first.colour != second.colour).any()  # in another light
    assert cutouts.write_all([tmp_path / "records"], out, 2) == 0
