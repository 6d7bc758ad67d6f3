"""Photographs made in batches are those of `sample`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from helpers.sphere import sphere

pytest.importorskip("kornia")

from shadow.data.batches import Stack
from shadow.data.photographs import sample
from shadow.data.records import Records

DATA = Path(__file__).parents[2] / "data"
SIZE = 256, 192
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def bodies():
    return [
        replace(
            record,
            bounce_float16=None,
            bounce_patterns=None,
            directions=record.directions[:44],  # which do not fill their last byte
            visibility_bits=np.packbits(record.visibility[:, :44], axis=1),
        )
        for record in Records([DATA])
    ]


def test_a_batch_is_its_photographs(bodies, clean):
    """Each has its light, skin, place, rotation, depth and directions. They are clean here."""
    stack = Stack(bodies, SIZE, CPU)
    numbers = [0, 1, 2, 1]
    draws = [stack.draw(number, np.random.default_rng(seed), 12) for seed, number in enumerate(numbers)]
    batch = stack.photographs([draw._replace(flaws=None) for draw in draws])
    for index, number in enumerate(numbers):
        expected = sample(bodies[number], np.random.default_rng(index), SIZE, 12)
        inside = expected["mask"] > 0.5
        assert inside.float().mean() > 0.1
        for name in ("matte", "mask", "directions", "depth_known"):
            torch.testing.assert_close(batch[name][index], expected[name], atol=1e-4, rtol=0)
        for name in ("rgb", "normals", "visibility", "depth", "regions"):
            found, true = (maps * inside for maps in (batch[name][index], expected[name]))
            torch.testing.assert_close(
                found, true, atol=2e-4, rtol=2e-3, msg=lambda text, name=name: f"{name}: {text}"
            )


def test_cameras_and_mattes_of_a_batch_are_those_of_its_photographs(bodies):
    """All but the noise, which is turned off here."""
    stack, seeds = Stack(bodies, SIZE, CPU), range(8)
    draws = [stack.draw(0, np.random.default_rng(seed), 4) for seed in seeds]
    assert all(
        any(getattr(draw.flaws, name) is not None for draw in draws) for name in draws[0].flaws._fields
    )
    zero = np.zeros((3, *SIZE), np.float32)
    still = [
        draw._replace(flaws=draw.flaws._replace(camera=draw.flaws.camera._replace(noise=zero)))
        for draw in draws
    ]
    batch = stack.photographs(still)
    clean = stack.photographs([draw._replace(flaws=None) for draw in draws])
    for index, draw in enumerate(still):
        rgb, matte = draw.flaws(clean["rgb"][index], clean["mask"][index])
        torch.testing.assert_close(batch["rgb"][index], rgb, atol=1e-5, rtol=1e-4)
        torch.testing.assert_close(batch["matte"][index], matte)


def test_a_stack_that_was_extended_makes_the_photographs_of_a_whole_one(bodies):
    whole, grown = Stack(bodies, SIZE, CPU), Stack(bodies[:1], SIZE, CPU)
    grown.extend(bodies[1:])
    draws = [whole.draw(number, np.random.default_rng(number), 4)._replace(flaws=None) for number in range(3)]
    for name, maps in whole.photographs(draws).items():
        torch.testing.assert_close(
            grown.photographs(draws)[name], maps, msg=lambda text, name=name: f"{name}: {text}"
        )
    assert len(grown) == len(whole)


def test_records_that_do_not_stack_are_refused():
    with pytest.raises(ValueError, match="no bounce light"):
        Stack(Records([DATA]), SIZE, CPU)
    with pytest.raises(ValueError, match="same number of directions"):
        Stack([sphere(), sphere(behind=False)], SIZE, CPU)
    with pytest.raises(ValueError, match="same number of directions"):
        Stack([sphere()], SIZE, CPU).extend([sphere(behind=False)])
