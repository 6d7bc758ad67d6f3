"""Two people in touch, for the light stage."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

pytest.importorskip("embreex")
pytest.importorskip("numba")
pytest.importorskip("trimesh")
pytest.importorskip("kornia")
pytestmark = pytest.mark.slow  # bodies are made, dressed and draped

from shadow.lightstage import stage
from shadow.lightstage.figure import Figure
from shadow.lightstage.people.body.skeleton import rotation
from shadow.lightstage.people.generate import pairs


@pytest.fixture(scope="module")
def parts():
    """The two of a pair as `together` gets them, and what it makes of them."""
    kept = {}
    joined = pairs.together

    def spy(first, second, rotation, offset, name):
        kept.update(people=(first, second), figure=joined(first, second, rotation, offset, name))
        return kept["figure"]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pairs, "together", spy)
        pairs.pair(1, "training")
    return kept


def test_a_pair_keeps_the_contract_of_a_figure(parts):
    figure, people = parts["figure"], parts["people"]
    assert figure.vertices.dtype == np.float32
    assert figure.faces.dtype == np.int32
    assert figure.normals.dtype == np.float32
    assert figure.name == "pair-training-000001"
    assert len(figure.vertices) == sum(len(person.vertices) for person in people)
    assert figure.faces.max() == len(figure.vertices) - 1
    assert np.allclose(np.linalg.norm(figure.normals, axis=1), 1, atol=1e-4)
    assert abs(figure.vertices[:, 1].min()) < 1e-5
    assert np.abs(figure.vertices[:, [0, 2]].mean(axis=0)).max() < 0.2


def test_the_two_of_a_pair_touch_and_are_not_in_one_place(parts):
    count = len(parts["people"][0].vertices)
    first, second = parts["figure"].vertices[:count], parts["figure"].vertices[count:]
    distance = cKDTree(first).query(second)[0]
    assert distance.min() < 0.02
    assert np.median(distance) > 0.05


def test_a_pair_is_the_same_again_and_its_people_are_two(parts):
    again = pairs.pair(1, "training")
    np.testing.assert_array_equal(again.vertices, parts["figure"].vertices)
    np.testing.assert_array_equal(again.normals, parts["figure"].normals)
    first, second = parts["people"]
    assert first.vertices[:, 1].max() != second.vertices[:, 1].max()


def test_the_second_is_turned_and_moved_with_its_normals_and_colours():
    def wall(colour):
        corners = np.array([[-1, 0, 0], [1, 0, 0], [1, 2, 0], [-1, 2, 0]], np.float32) / 4
        paint = lambda face, barycentric: np.full((len(face), 3), colour, np.float32)  # noqa: E731
        faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
        return Figure(corners, faces, np.tile(np.float32([0, 0, 1]), (4, 1)), paint, "wall")

    offset = np.array([2.0, 0, 0])
    both = pairs.together(wall(0.2), wall(0.6), rotation((0, 1, 0), 90), offset, "walls")
    np.testing.assert_allclose(both.vertices[:4].mean(axis=0), [-1, 0.25, 0], atol=1e-6)
    np.testing.assert_allclose(both.vertices[4:].mean(axis=0), [1, 0.25, 0], atol=1e-6)
    np.testing.assert_allclose(both.normals[4:], np.tile([1, 0, 0], (4, 1)), atol=1e-6)
    view = stage.render(both, stage.View(azimuth=30, distance=4, height=0.25), 128, np.eye(3)[2:])
    left, right = view.normals[:, 0] < 0, view.normals[:, 0] > 0
    assert left.any()
    assert right.any()
    np.testing.assert_allclose(view.albedo[left], 0.2, atol=0.01)
    np.testing.assert_allclose(view.albedo[right], 0.6, atol=0.01)


@pytest.mark.parametrize(("seed", "split", "message"), [(0, "test", "split"), (-1, "training", "seed")])
def test_pair_names_the_bad_argument(seed, split, message):
    with pytest.raises(ValueError, match=message):
        pairs.pair(seed, split)
