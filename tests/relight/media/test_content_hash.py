import os
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pytest

import relight
from relight.media.content_hash import FileRecord, content_hash, file_state


@dataclass(frozen=True)
class Pair:
    first: float
    second: float


class Choice(StrEnum):
    GREEN = "green"


def test_the_same_parts_have_the_same_identity():
    parts = (1, "a", np.arange(6).reshape(2, 3), {"x": None, "y": [1, 2]}, Pair(1, 2), np.sin)
    assert content_hash(*parts) == content_hash(*parts)
    assert len(content_hash(*parts)) == 32
    assert content_hash({"x": 1, "y": 2}) == content_hash({"y": 2, "x": 1})
    assert content_hash(Choice.GREEN) == content_hash("green")  # as the command line says it
    noncontiguous = np.arange(12).reshape(3, 4)[:, ::2]
    assert content_hash(noncontiguous) == content_hash(noncontiguous.copy())


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
    assert content_hash(*one) != content_hash(*other)


def test_a_file_counts_by_what_is_in_it(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).write_bytes(b"plate")
    before = content_hash(tmp_path / "a")
    assert content_hash(tmp_path / "b") == before
    assert content_hash(tmp_path / "gone") != before
    (tmp_path / "a").write_bytes(b"other")
    os.utime(tmp_path / "a", ns=(0, 0))
    assert content_hash(tmp_path / "a") != before


def test_a_file_that_cannot_be_read_counts_by_its_error(tmp_path):
    (tmp_path / "empty").write_bytes(b"")
    states = [file_state(tmp_path / "gone"), file_state(tmp_path), file_state(tmp_path / "empty")]
    assert all(states)
    assert len(set(states)) == len(states)
    with pytest.raises(OSError, match="no regular file"):
        FileRecord.of(tmp_path)
