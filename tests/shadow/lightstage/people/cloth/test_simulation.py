"""Garments by physics: one small one of its own, and a whole body."""

import copy
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("embreex")
pytest.importorskip("numba")
pytest.importorskip("trimesh")
pytestmark = pytest.mark.slow  # bodies are made, dressed and draped

from shadow.lightstage.people.cloth import simulation
from shadow.lightstage.people.cloth.garments import Wardrobe
from shadow.lightstage.people.cloth.nearest import MeshSurface
from shadow.lightstage.people.cloth.patterns import Fit
from shadow.lightstage.people.cloth.simulation import Simulator
from shadow.lightstage.people.generate import bodies, poses

VEST = dict(neck=0.03, ease=0.01, held=("neck",), bending=0.15, wrinkles=0.0, thickness=0.003)


@pytest.fixture(scope="module")
def short():
    """Few frames: enough to leave the rest pose and to run into the body."""
    with pytest.MonkeyPatch.context() as patch:
        for name, count in (("MOVING", 8), ("SETTLING", 4), ("CALM", 2)):
            patch.setattr(simulation, name, count)
        yield


@pytest.fixture(scope="module")
def person(short):
    rng = bodies.random_generator(1003, "training")
    shape = bodies.Shape.draw(rng)
    return shape.posed(poses.draw(shape.skeleton, rng))


@pytest.fixture(scope="module")
def undressed(person):
    """A wardrobe whose simulator has the body as its only layer: making it takes longer than a vest does."""
    return Wardrobe(person, np.random.default_rng(3), Simulator(person, "someone"))


def vest(undressed, cache=None, **choices):
    """What hangs after few frames (V, 3), the cut of it, and the simulator. Ends above the hips."""
    person = undressed.person
    simulator = replace(undressed.simulator, cache=cache, layers=[*undressed.simulator.layers])
    wardrobe = copy.deepcopy(undressed, {id(person): person, id(undressed.simulator): simulator})
    seen = []
    draping = simulator.drape
    simulator.drape = lambda cut, *rest: seen.append((cut, draping(cut, *rest))) or seen[-1][1]
    bottom = person.skeleton.head("spine04")[1] + 0.1
    wardrobe.wear(Fit(**{**VEST, "bottom": bottom, **choices}), None)
    return seen[0][1], seen[0][0], simulator


@pytest.fixture(scope="module")
def worn(undressed, tmp_path_factory):
    folder = tmp_path_factory.mktemp("cloth")
    return *vest(undressed, folder), folder


def test_another_cut_gives_other_folds(undressed, worn):
    other, _, simulator = vest(undressed, ease=0.012)
    assert other.shape == worn[0].shape
    assert np.abs(other - worn[0]).max() > 0.002
    assert simulator.digest != worn[2].digest


def test_cloth_is_neither_at_rest_nor_torn(person, worn):
    hung, cut, _, _ = worn
    carried = person.posed(cut.weights, cut.rest)
    moved = np.linalg.norm(hung - carried, axis=1)
    assert 0.002 < moved.mean() < 0.05
    a, b = cut.faces[:, 0], cut.faces[:, 1]
    was, became = (np.linalg.norm(points[a] - points[b], axis=1) for points in (cut.rest, hung))
    assert 0.9 < np.median(became / was) < 1.15


def test_nothing_is_left_inside_the_body(person, worn):
    tights = person.base.tights
    body = MeshSurface(person.posed(tights.weights, person.tights_rest), tights.faces)
    height, _, _ = body.heights(worn[0])
    assert (height < -0.001).mean() <= 0.001
    # The margin is of use: cloth that is only carried along by the bones is in it.
    carried = person.posed(worn[1].weights, worn[1].rest)
    assert (body.heights(carried)[0] < -0.001).mean() > 0.001


def test_what_was_simulated_is_read_back(undressed, worn, monkeypatch):
    hung, _, simulator, folder = worn
    (kept,) = folder.iterdir()
    assert kept.name == f"someone-{simulator.digest}.npz"
    monkeypatch.setattr(simulation.GarmentSimulation, "frames", None)  # whoever simulates fails
    assert np.array_equal(vest(undressed, folder)[0], hung)


# The slow one differs in the damage alone: the simulation and what is compared are the same.
@pytest.mark.parametrize("damage", [lambda data: data[: len(data) // 2], lambda data: b""])
def test_a_truncated_file_is_simulated_again_to_the_same_folds(undressed, worn, tmp_path, damage):
    hung, _, _, folder = worn
    (kept,) = folder.iterdir()
    broken = tmp_path / kept.name
    broken.write_bytes(damage(kept.read_bytes()))
    assert np.array_equal(vest(undressed, tmp_path)[0], hung)
    assert broken.read_bytes() == kept.read_bytes()


def test_digest_covers_every_column_of_a_cut(person, worn):
    _, cut, _, _ = worn
    digest = simulation.digest_of(cut, "", person)
    for name in ("rest", "held", "longer", "hinge", "anchored"):
        column = getattr(cut, name).copy()
        column[0] = 1 - column[0]
        assert simulation.digest_of(replace(cut, **{name: column}), "", person) != digest
    assert simulation.digest_of(replace(cut, friction=0.1), "", person) != digest


# The nearest points of a surface ---------------------------------------------------------------------------


def ball(size=40):
    """A sphere of radius 1 about the origin."""
    import trimesh

    mesh = trimesh.creation.uv_sphere(1.0, count=(size, size))
    return MeshSurface(mesh.vertices.view(np.ndarray), mesh.faces.view(np.ndarray))


def test_heights_above_a_sphere():
    rng = np.random.default_rng(0)
    way = rng.normal(size=(500, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    radius = rng.uniform(0.7, 1.4, 500)
    height, foot, normal = ball().heights(way * radius[:, None])
    assert height == pytest.approx(radius - 1, abs=0.006)
    assert (foot * way).sum(axis=1) == pytest.approx(1, abs=0.006)
    assert (normal * way).sum(axis=1).min() > 0.99


def test_beyond_a_border_nothing_is_inside():
    whole = ball()
    corners = whole.points[whole.faces]
    half = MeshSurface(whole.points, whole.faces[corners[:, :, 1].max(axis=1) < 1e-6])
    below, beyond = [[0.0, -0.95, 0.0]], [[0.999, 0.2, 0.0], [0.97, 0.2, 0.0]]
    assert half.heights(np.array(below))[0][0] == pytest.approx(-0.05, abs=0.005)
    assert (half.heights(np.array(beyond))[0] > 0).all()


# A whole body ----------------------------------------------------------------------------------------------


def test_a_body_dressed_by_physics(tmp_path):
    draped, simulated = (bodies.body(4, "training", simulate=on, cache=tmp_path) for on in (False, True))
    assert len(list(tmp_path.iterdir())) == 3  # a top, tucked into trousers, and a jacket
    assert np.isfinite(simulated.vertices).all()
    # The same person, no taller, in other folds.
    assert np.ptp(simulated.vertices, axis=0) == pytest.approx(np.ptp(draped.vertices, axis=0), abs=0.06)
    again = bodies.body(4, "training", simulate=True, cache=tmp_path)
    assert np.array_equal(again.vertices, simulated.vertices)
    assert np.array_equal(again.faces, simulated.faces)
