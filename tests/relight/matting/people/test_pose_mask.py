import pytest
import torch
from helpers.finders import discs, small_finder

from relight.matting.people.pose_mask import mask_around


@pytest.fixture(scope="module")
def people(tmp_path_factory):
    return small_finder(tmp_path_factory.mktemp("networks"))


@pytest.fixture(scope="module")
def two():
    picture, where = discs((200, 300), (80, 100, 40), (220, 100, 40))
    return torch.from_numpy(picture.transpose(2, 0, 1).copy()), [torch.from_numpy(w).float() for w in where]


def test_the_mask_is_of_whom_the_matte_shows(people, two):
    picture, mattes = two
    for matte in mattes:
        seen = mask_around(picture, matte, people) > 0.5
        assert (seen & (matte > 0.5)).sum() > 0.9 * (seen | (matte > 0.5)).sum()


def test_nobody_is_seen_where_nobody_or_somebody_else_is(people, two):
    picture, (first, second) = two
    assert mask_around(torch.zeros_like(picture), first, people) is None
    assert mask_around(picture, torch.zeros_like(first), people) is None
    assert mask_around(picture, second, people) is not None
    hat = torch.zeros_like(first)
    hat[50:75, 70:90] = 1  # a part of the person is not the person
    assert mask_around(picture, hat, people) is None
