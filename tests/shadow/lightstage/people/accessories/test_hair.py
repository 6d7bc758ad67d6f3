"""Hair grows where hair grows, ends in the air, and lies flat under hats; straps are taut."""

import numpy as np
import pytest

pytest.importorskip("embreex")
pytest.importorskip("numba")
pytest.importorskip("trimesh")
pytestmark = pytest.mark.slow  # bodies are made, dressed and draped

from shadow.lightstage.people.accessories import hair, props
from shadow.lightstage.people.cloth import tailoring
from shadow.lightstage.people.cloth.fabric import Fabric
from shadow.lightstage.people.cloth.garments import Wardrobe
from shadow.lightstage.people.cloth.patterns import Fit
from shadow.lightstage.people.generate import bodies, poses

GREY = Fabric.plain(np.full(3, 0.5))


@pytest.fixture(scope="module")
def person():
    rng = np.random.default_rng(1)
    shape = bodies.Shape.draw(rng)
    return shape.posed(poses.stand(shape.skeleton, rng))


def grown(person, style, **how):
    wardrobe = Wardrobe(person, np.random.default_rng(0))
    skull = hair.Skull(person)
    hair.grow(skull, wardrobe, np.random.default_rng(0), style, GREY, **how)
    return skull, wardrobe.parts[0]


@pytest.mark.parametrize("style", ["bob", "long"])
def test_no_hair_grows_on_the_throat(person, style):
    skull, part = grown(person, style)
    local = part.rest - skull.centre
    assert not ((local[:, 1] < -0.09) & (local[:, 2] > -0.03) & (np.abs(local[:, 0]) < 0.04)).any()


def test_hair_at_the_sides_ends_above_the_shoulders(person):
    skull = hair.Skull(person)
    wardrobe = Wardrobe(person, np.random.default_rng(0))
    top = skull.posed(skull.eyes[None])[0] - [0, 0.1, 0]  # shoulders drawn up
    plane = np.stack(np.meshgrid(np.linspace(-0.2, 0.2, 41), [0.0], np.linspace(-0.2, 0.2, 41)), -1)
    plane = plane.reshape(-1, 3) + top
    up = np.tile([0.0, 1.0, 0.0], (len(plane), 1))
    wardrobe.obstacles.append((plane, up, np.zeros((len(plane), 5)), np.zeros(len(plane), bool)))
    hair.grow(skull, wardrobe, np.random.default_rng(0), "long", GREY)
    part = wardrobe.parts[0]
    beside = np.abs(skull.around(part.rest) - 85) < 10
    assert skull.posed(part.rest[beside])[:, 1].min() > top[1]


@pytest.mark.parametrize("style", ["bob", "long"])
def test_hair_above_nothing_falls(person, style):
    """A head bent forward has no shoulder under its hair."""
    wardrobe = Wardrobe(person, np.random.default_rng(0))
    points, normals, *more = wardrobe.obstacles[0]
    wardrobe.obstacles[:] = [(points + [5, 0, 0], normals, *more)]
    hair.grow(hair.Skull(person), wardrobe, np.random.default_rng(0), style, GREY)
    assert np.isfinite(wardrobe.parts[0].vertices).all()


def test_hair_under_a_hat_is_flat(person):
    skull, loose = grown(person, "long")
    _, pressed = grown(person, "long", pressed=True)
    top = [part.rest[part.rest[:, 1] > skull.centre[1] + 0.05] - skull.centre for part in (loose, pressed)]
    high, low = (np.linalg.norm(points, axis=1).mean() for points in top)
    assert low < high - 0.004


def test_a_closed_jacket_hides_the_tie_under_it(person):
    rng = np.random.default_rng(0)
    wardrobe = Wardrobe(person, rng)
    bottom = person.skeleton.head("spine04")[1] - 0.06
    fit = dict(bottom=bottom, sleeve=0.98, fill=0.3, held=("neck",))
    wardrobe.wear(Fit(neck=0.012, **fit), GREY)
    wardrobe.parts += tailoring.tie(person, wardrobe.outer, GREY, rng)
    tie = wardrobe.parts[-1]
    whole = len(tie.faces)
    wardrobe.wear(Fit(neck=0.02, vee=0.1, ease=0.02, **fit), GREY)
    seen = tie.rest[np.unique(tie.faces), 1]
    assert 0 < len(tie.faces) < 0.6 * whole
    assert seen.min() > person.skeleton.head("neck01")[1] - 0.2


def test_straps_of_a_pack_go_from_the_pack_to_the_pack(person):
    wardrobe = Wardrobe(person, np.random.default_rng(0))
    props.backpack(wardrobe, np.random.default_rng(0), GREY)
    pack, *straps = wardrobe.parts
    assert wardrobe.packed
    assert len(straps) == 2
    for strap in straps:
        path = strap.vertices.reshape(-1, 7, 3).mean(axis=1)
        turns = np.diff(path, axis=0)
        turns /= np.linalg.norm(turns, axis=1, keepdims=True)
        assert (turns[1:] * turns[:-1]).sum(axis=1).min() > 0.6  # no spike
        for end in (path[0], path[-1]):
            assert np.linalg.norm(pack.vertices - end, axis=1).min() < 0.1
