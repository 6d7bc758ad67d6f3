import os
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pytest

import relight
from relight.media.identity import identity


@dataclass(frozen=True)
class Pair:
    first: float
    second: float


class Choice(StrEnum):
    GREEN = "green"


def test_the_same_parts_have_the_same_identity():
    parts = (1, "a", np.arange(6).reshape(2, 3), {"x": None, "y": [1, 2]}, Pair(1, 2), np.sin)
    assert identity(*parts) == identity(*parts)
    assert len(identity(*parts)) == 32
    assert identity({"x": 1, "y": 2}) == identity({"y": 2, "x": 1})
    assert identity(Choice.GREEN) == identity("green")  # as the command line says it
    noncontiguous = np.arange(12).reshape(3, 4)[:, ::2]
    assert identity(noncontiguous) == identity(noncontiguous.copy())


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ((1,), (1.0,)),
        (("a", "b"), ("ab",)),
        (([1], [2]), ([1, 2],)),
        (([1, [2]],), ([[1], 2],)),
        ((np.zeros((2, 3)),), (np.zeros((3, 2)),)),
        ((np.zeros(3, np.float32),), (np.zeros(3, np.int32),)),
        ((None,), ("None",)),
        ((Pair(1, 2),), (Pair(2, 1),)),
        ((np.sin,), (np.cos,)),
        ((relight.DirectionalLight(angle=1),), (relight.DirectionalLight(angle=2),)),
    ],
)
def test_other_parts_have_another(one, other):
    assert identity(*one) != identity(*other)


def test_a_file_counts_by_what_is_in_it(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).write_bytes(b"plate")
    before = identity(tmp_path / "a")
    assert identity(tmp_path / "b") == before
    assert identity(tmp_path / "gone") != before
    (tmp_path / "a").write_bytes(b"other")
    os.utime(tmp_path / "a", ns=(0, 0))
    assert identity(tmp_path / "a") != before
