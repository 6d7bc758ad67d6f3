"""People with heads of a face model, which the tests make."""

import numpy as np
import pytest
from helpers import facekits

pytest.importorskip("embreex")
pytest.importorskip("numba")
pytestmark = pytest.mark.slow  # bodies are made, dressed and draped

from shadow.data import records
from shadow.lightstage.people.body import facekit
from shadow.lightstage.people.generate import heads
from shadow.lightstage.stage import FigureSource, Settings, render_all

FACE = records.REGIONS.index("face")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return facekits.write(tmp_path_factory.mktemp("facekit"))


def drawn(folder, alone, start=0):
    """The first figure that is a bust, or not, and its seed."""
    for seed in range(start, start + 30):
        figure = heads.head(seed, "training", folder)
        if (figure.vertices[:, 1].min() > 1) == alone:
            return seed, figure
    raise AssertionError(alone)


def test_the_same_seed_gives_the_same_head(folder):
    first, second = (heads.head(3, "training", folder) for _ in range(2))
    np.testing.assert_array_equal(first.vertices, second.vertices)
    face = np.arange(0, len(first.faces), 50)
    middle = np.full((len(face), 3), 1 / 3)
    np.testing.assert_array_equal(first.albedo(face, middle), second.albedo(face, middle))


def test_splits_share_no_identity(folder):
    model = facekit.load(folder)
    shapes = [
        model.head(np.random.default_rng(0), heads.bodies.random_generator(1, split, heads.IDENTITY)).rest
        for split in heads.bodies.SPLITS
    ]
    assert all(np.abs(shapes[0] - other).max() > 0.05 for other in shapes[1:])


def test_a_bust_is_a_head_at_the_height_of_heads(folder):
    _, bust = drawn(folder, alone=True)
    assert 0.15 < np.ptp(bust.vertices[:, 1]) < 0.5
    assert bust.vertices[:, 1].min() == pytest.approx(heads.BUST_HEIGHT, abs=1e-4)
    face = bust.vertices[bust.faces[bust.regions == FACE]].mean(axis=(0, 1))
    assert face[2] > bust.vertices[:, 2].mean()  # it looks to the front
    assert np.linalg.norm(bust.normals, axis=1) == pytest.approx(1, abs=1e-3)


def test_normals_point_outwards(folder):
    _, bust = drawn(folder, alone=True)
    skin = bust.regions == FACE
    corners = bust.vertices[bust.faces[skin]]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    shading = bust.normals[bust.faces[skin]].mean(axis=1)
    assert ((facing * shading).sum(axis=1) > 0).mean() > 0.98


def test_a_body_has_one_head(folder):
    """The head of the model takes the place of the body's own, at its height."""
    _, figure = drawn(folder, alone=False)
    assert figure.vertices[:, 1].min() == pytest.approx(0, abs=1e-5)
    assert np.ptp(figure.vertices[:, 1]) > 0.6
    who = np.random.default_rng(0)
    shape = heads.bodies.Shape.draw(who)
    person = shape.posed(heads.Pose(shape.skeleton, who))
    fitted = heads.FittedHead(person, facekit.load(folder).head(who, who))
    bare = heads.bodies.skin_part(person, heads.Wardrobe(person, who), who)
    headless = fitted.headless(bare)
    used = headless.rest[np.unique(headless.faces)]
    eyes = fitted.skull.eyes
    assert len(headless.faces) < len(bare.faces)
    assert not (np.linalg.norm(used - eyes, axis=1) < 0.08).any()
    placed = fitted.placed(fitted.head.rest)
    assert placed[:, 1].max() == pytest.approx(
        (person.base.body.rows @ person.rest)[:, 1].max(), abs=0.02
    )  # metres: both have one crown


def test_necks_meet(folder):
    """At the cut, the head's neck is as wide as the body's."""
    rng = np.random.default_rng(0)
    shape = heads.bodies.Shape.draw(rng)
    person = shape.posed(heads.Pose(shape.skeleton, rng))
    fitted = heads.FittedHead(person, facekit.load(folder).head(rng, rng))
    points = fitted.head.mesh(("head_neck",)).rest
    at_cut = fitted.head.above_neck(points) < 0.3
    own, weights = fitted._body
    own = fitted.centimetres(own[fitted.skull.neck_and_head(weights) > 0.3])
    body = own[np.abs(fitted.head.above_neck(own)) < 0.7]
    wide = np.ptp(fitted._neck(points)[at_cut][:, 0])
    assert wide == pytest.approx(np.ptp(body[:, 0]), rel=0.12)


def test_half_of_the_heads_have_colours_that_do_not_follow_the_face():
    fabrics = [heads.Paint.draw(np.random.default_rng(seed)) for seed in range(60)]
    u = np.zeros(200)
    along = np.stack([np.zeros(200), np.linspace(-0.06, 0.08, 200), np.full(200, 0.1)], axis=1)
    plain = [np.ptp(paint.skin(u, u, along), axis=0).max() < 1e-6 for paint in fabrics]
    assert 5 < sum(plain) < 30
    assert all(np.isfinite(paint.skin(u, u, along)).all() for paint in fabrics)


def test_heads_become_records(folder, tmp_path):
    source = FigureSource.head(0, "training", folder)
    written, _, errors = render_all([source], tmp_path, Settings(views=1, size=64, head=True), processes=1)
    assert written == 1
    assert not errors
    record = records.Records([tmp_path])[0]
    assert record.shares[:, 0].mean() > 0.1  # of the face


def test_a_folder_without_the_model_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"heads: expected ict\.npz"):
        facekit.load(tmp_path)
