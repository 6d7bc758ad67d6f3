"""What is sewn to a garment lies on it, is closed, and can be seen."""

from types import SimpleNamespace

import numpy as np
import pytest

trimesh = pytest.importorskip("trimesh")

from shadow.lightstage.figure import vertex_normals
from shadow.lightstage.mesh import boundary_chains
from shadow.lightstage.people.cloth import tailoring
from shadow.lightstage.people.cloth.fabric import Fabric
from shadow.lightstage.people.cloth.patterns import Fit

GREY = Fabric.plain(np.full(3, 0.5))
THROAT = 0.5  # metres


@pytest.fixture(scope="module")
def tube():
    """A cylinder of cloth about the y axis, half a metre high on either side of the origin."""
    angle, y = np.meshgrid(np.linspace(0, 2 * np.pi, 120, endpoint=False), np.linspace(-0.5, 0.5, 120))
    rest = np.stack([0.15 * np.sin(angle), y, 0.15 * np.cos(angle)], axis=-1).reshape(-1, 3)
    a = np.arange(119)[:, None] * 120 + np.arange(120)
    b = np.arange(119)[:, None] * 120 + (np.arange(120) + 1) % 120
    a, b = a.ravel(), b.ravel()
    faces = np.concatenate([np.stack([a, b, a + 120], 1), np.stack([b, b + 120, a + 120], 1)])
    assert (vertex_normals(rest, faces) * rest * [1, 0, 1]).sum(axis=1).min() > 0
    return rest + [0, 1.0, 0], faces, rest  # posed: a metre higher


@pytest.fixture(scope="module")
def person():
    heads = {"neck01": [0, THROAT, 0], "spine02": [0, 0.2, 0], "upperleg01.L": [0.1, -0.3, 0]}
    return SimpleNamespace(skeleton=SimpleNamespace(head=lambda name: np.array(heads[name])))


def pieces(name, tube, person):
    rng = np.random.default_rng(0)
    return {
        "placket": lambda: tailoring.placket(tube, -0.4, 0.4, GREY),
        "waistband": lambda: tailoring.waistband(tube, 0.4, GREY),
        "belt": lambda: tailoring.belt(tube, 0.1, 0.035, GREY, GREY, rng),
        "pockets": lambda: tailoring.pockets(person, tube, "hips", GREY),
        "lapels": lambda: tailoring.lapels(person, Fit(vee=0.2), tube, GREY, rng),
        "tie": lambda: tailoring.tie(person, tube, GREY, rng),
    }[name]()


COUNTS = {"placket": 1, "waistband": 2, "belt": 2, "pockets": 4, "lapels": 2, "tie": 1}


@pytest.mark.parametrize("name", COUNTS)
def test_what_is_sewn_on_is_closed_and_stands_out(name, tube, person):
    made = pieces(name, tube, person)
    assert len(made) == COUNTS[name]
    for part in made:
        assert boundary_chains(part.faces) == []
        assert trimesh.Trimesh(part.vertices, part.faces, process=False).volume > 0
        height = np.linalg.norm(part.vertices[:, [0, 2]], axis=1) - 0.15
        assert 0.001 < height.max() < 0.02  # outside of the cloth it is sewn to
        assert height.min() > -0.006
        assert part.rest.shape == part.vertices.shape
        np.testing.assert_allclose((part.vertices - part.rest)[:, 1], 1.0, atol=0.004)


def test_lapels_widen_to_the_notch_on_both_sides(tube, person):
    left, right = pieces("lapels", tube, person)
    assert left.rest[:, 0].max() < 0 < right.rest[:, 0].min()
    width = [np.ptp(right.rest[np.abs(right.rest[:, 1] - y) < 0.02, 0]) for y in (0.33, 0.43)]
    assert width[1] > 1.3 * width[0]


def test_nothing_is_sewn_where_there_is_no_cloth(tube):
    assert tailoring.sew_on(tube, np.full(len(tube[2]), -1.0), 0.002, GREY) == []


def test_pleats_and_open_fronts(tube, person):
    posed, _, rest = tube
    relief = tailoring.pleated(rest, 0.3, 24, 0.012)
    assert (relief[rest[:, 1] > 0.3] == 0).all()
    assert relief.max() == pytest.approx(0.006, rel=0.1)
    person.bone = {"spine04": np.eye(4)[:3]}.get
    fit = Fit(open_front=0.04, swing=0.05, bottom=-0.3)
    moved = np.linalg.norm(tailoring.open_front(fit, person, tube) - posed, axis=1)
    assert moved[rest[:, 2] < 0].max() == 0  # the back hangs as it did
    assert moved[(rest[:, 1] < -0.2) & (rest[:, 2] > 0.13)].min() > 0.02
