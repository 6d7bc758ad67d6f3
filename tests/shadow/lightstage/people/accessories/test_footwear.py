"""Shoes and boots: soles on the ground, heels under raised feet, shafts outside what is in them."""

import numpy as np
import pytest

pytest.importorskip("embreex")
pytest.importorskip("numba")
trimesh = pytest.importorskip("trimesh")
pytestmark = pytest.mark.slow  # bodies are made, dressed and draped

from shadow.lightstage.people.accessories import footwear
from shadow.lightstage.people.accessories.footwear import Shoe
from shadow.lightstage.people.cloth.fabric import Fabric
from shadow.lightstage.people.cloth.garments import Wardrobe
from shadow.lightstage.people.cloth.patterns import Fit
from shadow.lightstage.people.generate import bodies, outfits, poses

GREY = Fabric.plain(np.full(3, 0.5))


def stand_on_floor(heel=0.0):
    rng = np.random.default_rng(2)
    shape = bodies.Shape.draw(rng)
    pose = poses.stand(shape.skeleton, rng)
    for side in "LR":
        pose.leg(side, 0, 0, 3, 0)
    pose.pelvis()
    pose.raise_heels(heel)
    return Wardrobe(shape.posed(pose), rng), rng


@pytest.mark.parametrize("heel", [0.02, 0.05, 0.08])
def test_a_heel_stands_on_the_ground_of_the_toes(heel):
    wardrobe, rng = stand_on_floor(heel)
    footwear.put_on(wardrobe, Shoe(leg=0.93, low=True, sole=0.006, tip=0.3), GREY, rng)
    upper, *blocks = wardrobe.parts
    assert len(blocks) == 2
    ground = upper.vertices[:, 1].min()
    for block in blocks:
        assert trimesh.Trimesh(block.vertices, block.faces).volume > 0
        assert abs(block.vertices[:, 1].min() - ground) < 0.008
        assert heel - 0.015 < np.ptp(block.vertices[:, 1]) < heel + 0.03


def test_heels_raise_the_body_and_not_the_toes():
    rises = []
    for heel in (0.0, 0.07):
        person = stand_on_floor(heel)[0].person
        ankle, toe = (person.skeleton.head(f"{name}.L") for name in ("foot", "toe2-2"))
        names = person.base.names
        place = [
            person.transforms[names.index(f"{name}.L")] @ [*head, 1]
            for name, head in (("foot", ankle), ("toe2-2", toe))
        ]
        rises.append(place[0][1] - place[1][1])
    assert 0.03 < rises[1] - rises[0] < 0.08


def test_flat_shoes_have_no_block():
    wardrobe, rng = stand_on_floor()
    footwear.put_on(wardrobe, Shoe(leg=0.98), GREY, rng)
    assert len(wardrobe.parts) == 1


def test_boots_cover_the_trousers_in_them():
    wardrobe, rng = stand_on_floor(0.02)
    waist = wardrobe.person.skeleton.head("spine04")[1]
    fit = Fit(top=waist, leg=0.72, fill=0.0, ease=0.005, leg_width=0.7, held=("waist", "ankles"))
    trousers = wardrobe.wear(fit, GREY)
    footwear.put_on(wardrobe, Shoe(leg=0.65, shaft=0.01), GREY, rng)
    boots = trimesh.Trimesh(wardrobe.parts[-3].vertices, wardrobe.parts[-3].faces)
    along, axis, _ = wardrobe.person.limb_coordinates(3, trousers.rest)
    within = np.flatnonzero((trousers.region == 3) & (along > 0.67))
    used = within[np.isin(within, trousers.faces)]
    bone = wardrobe.person.transforms[wardrobe.person.base.names.index("lowerleg01.L")]
    middle = axis[used] @ bone[:, :3].T + bone[:, 3]
    out = (trousers.vertices[used] - middle) * [1, 0, 1]
    assert len(used) > 20
    assert boots.ray.intersects_any(trousers.vertices[used], out).mean() > 0.95


def test_men_wear_no_high_heels():
    rng = np.random.default_rng(0)
    drawn = {woman: [outfits.heel(rng, woman) for _ in range(200)] for woman in (False, True)}
    assert max(drawn[False]) <= outfits.HIGH_HEEL < max(drawn[True])
    assert min(drawn[True]) == 0
