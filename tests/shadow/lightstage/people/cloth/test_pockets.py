"""Hands in pockets: flat on the hip, under every garment there, and nowhere through it."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

pytest.importorskip("embreex")
pytest.importorskip("numba")
trimesh = pytest.importorskip("trimesh")
pytestmark = pytest.mark.slow  # bodies are made, dressed and draped

from shadow.lightstage.figure import normalize
from shadow.lightstage.people.cloth import pockets
from shadow.lightstage.people.cloth.fabric import Fabric
from shadow.lightstage.people.cloth.garments import Wardrobe
from shadow.lightstage.people.cloth.nearest import MeshSurface
from shadow.lightstage.people.cloth.patterns import Fit
from shadow.lightstage.people.generate import bodies, poses

GREY = Fabric.plain(np.full(3, 0.5))


@pytest.fixture(scope="module")
def pocketed():
    """Somebody with the left hand in a pocket."""
    rng = np.random.default_rng(3)
    shape = bodies.Shape.draw(rng)
    pose = poses.stand(shape.skeleton, rng)
    poses.hand_in_pocket(pose, "L")
    return shape.posed(pose)


def fingers(person, side):
    points = person.posed(person.base.body.weights, person.base.body.rows @ person.rest)
    return points[pockets.inside(person, side) > bodies.IN_POCKET]


def test_the_hand_lies_flat_beside_the_hip(pocketed):
    tights = pocketed.base.tights
    posed = pocketed.posed(tights.weights, pocketed.tights_rest)
    trunk = pocketed.tights_regions[:, 1:3].sum(axis=1) < 0.05
    body = MeshSurface(posed, tights.faces)
    near = np.linalg.norm(posed[trunk][None] - fingers(pocketed, "L")[:, None], axis=2).argmin(axis=1)
    height, _, _ = body.heights(fingers(pocketed, "L"), np.flatnonzero(trunk)[near])
    assert np.percentile(height, 5) > -0.02  # flesh gives way a little
    assert np.percentile(height, 95) < 0.06


def test_trousers_cover_the_hand_in_their_pocket(pocketed):
    rng = np.random.default_rng(0)
    wardrobe = Wardrobe(pocketed, rng)
    waist = pocketed.skeleton.head("spine04")[1] + 0.02
    fit = Fit(top=waist, leg=0.95, fill=0.0, leg_width=0.9, held=("waist",), ease=0.01)
    trousers = wardrobe.wear(fit, GREY)
    hand = fingers(pocketed, "L")
    hip = pocketed.transforms[pocketed.base.names.index("upperleg01.L")]
    outwards = normalize((hand - hip @ [*pocketed.skeleton.head("upperleg01.L"), 1]) * [1, 0, 1])
    cloth = trimesh.Trimesh(trousers.vertices, trousers.faces)
    assert cloth.ray.intersects_any(hand, outwards).mean() > 0.98


def test_nothing_is_made_of_the_fingers_that_nobody_sees(pocketed):
    skin = bodies.skin_part(pocketed, Wardrobe(pocketed, np.random.default_rng(0)), np.random.default_rng(0))
    points = cKDTree(skin.vertices)
    left, right = (points.query(fingers(pocketed, side))[0] for side in "LR")
    assert np.median(left) > 0.01
    assert right.max() == 0


def test_a_body_without_pockets_has_no_bulge():
    rng = np.random.default_rng(3)
    shape = bodies.Shape.draw(rng)
    assert not pockets.bulge(shape.posed(poses.stand(shape.skeleton, rng))).any()


def test_nobody_who_sits_has_a_hand_in_a_pocket():
    rng = np.random.default_rng(3)
    pose = poses.stand(bodies.Shape.draw(rng).skeleton, rng)
    poses.seated_legs(pose)
    poses.hand_in_pocket(pose, "L")
    assert not pose.pocketed
