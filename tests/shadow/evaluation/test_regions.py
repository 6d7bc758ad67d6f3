"""Faces and hands: where the stage says they are, and what is scored there."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("embreex")
pytest.importorskip("numba")
pytest.importorskip("trimesh")
pytest.importorskip("kornia")

from shadow import directions
from shadow.data import records
from shadow.data.photographs import sample
from shadow.data.records import REGIONS, Record
from shadow.evaluation import regions
from shadow.lightstage import stage
from shadow.lightstage.people.generate import bodies

FACE, HANDS = REGIONS.index("face"), REGIONS.index("hands")


@pytest.fixture(scope="module")
def figure():
    return bodies.body(5, "generalisation")  # a hand on either side, both seen from the front


@pytest.mark.slow
def test_the_face_is_the_front_of_the_head_and_hands_are_two(figure):
    middle = figure.vertices[figure.faces].mean(axis=1)
    face, hands = (middle[figure.regions == k] for k in (FACE, HANDS))
    top = figure.vertices[:, 1].max()
    assert top - 0.32 < face[:, 1].min()
    assert np.ptp(face[:, 1]) > 0.12
    head = middle[middle[:, 1] > face[:, 1].mean()]
    assert face[:, 2].mean() > head[:, 2].mean() + 0.03
    left, right = hands[hands[:, 0] > 0], hands[hands[:, 0] < 0]
    for hand in (left, right):
        assert 0.08 < np.linalg.norm(np.ptp(hand, axis=0)) < 0.3


@pytest.mark.slow
def test_a_record_stores_regions_and_old_ones_read(figure, tmp_path):
    record = stage.render(figure, stage.View(), 256, directions.olat())
    rows = np.nonzero(record.mask)[0]
    assert rows[record.regions == FACE].max() < rows.min() + 0.25 * np.ptp(rows)
    records.write(tmp_path / "a.npz", record)
    records.write(tmp_path / "b.npz", dataclasses.replace(record, regions=None))
    new, old = records.Records([tmp_path])
    np.testing.assert_array_equal(new.regions, record.regions)
    assert len(new.cropped(64).regions) == len(new.cropped(64).normals_int8)
    assert old.regions is None
    drawn = sample(new, np.random.default_rng(0), (256, 192), lights=1, augment=False)
    shares = drawn["regions"].sum(dim=(1, 2)) / (drawn["mask"] > 0.5).sum()
    assert shares[0] == pytest.approx((record.regions == FACE).mean(), rel=0.2)
    assert not sample(old, np.random.default_rng(0), (256, 192), lights=1)["regions"].any()


def test_shadow_counts_on_a_region_alone(ball, tmp_path):
    """A sphere casts none; bits cleared on the upper half are cast shadow, which the face holds."""
    above = ball.normals[:, 1] > 0.2
    bits = ball.visibility * ~above[:, None]
    cut = Record.of(
        ball.mask, ball.normals, ball.albedo, bits, ball.directions, regions=np.where(above, FACE, 0)
    )
    drawn = sample(cut, np.random.default_rng(0), (256, 192), augment=False)
    face = drawn["regions"][0] > 0.5
    truth = lambda lights: drawn["visibility"][drawn["directions"][:, 2] > 1e-6]  # noqa: E731
    found, shadow, false, lit = regions.count_cast(drawn, truth, face & (drawn["mask"][0] > 0.5))
    assert found == shadow > 0
    assert lit < 0.05 * shadow
    none = lambda lights: 1 + 0 * truth(lights)  # noqa: E731
    assert regions.count_cast(drawn, none, face)[0] == false == 0


@pytest.mark.slow
def test_scores_of_the_shipped_field(figure, ball, tmp_path):
    view = stage.View(azimuth=10, distance=3, height=1.4, pitch=-4, fov=30)
    records.write(tmp_path / "a.npz", stage.render(figure, view, 512, directions.olat()))
    scores = regions.evaluate([tmp_path])
    assert list(scores) == [regions.WHOLE, "face", "hands"]
    assert all(3 < score.angle < 60 and 0 < score.recall <= 1 for score in scores.values())
    assert "| face |" in regions.report(scores)
    records.write(tmp_path / "a.npz", ball)
    with pytest.raises(ValueError, match="regions"):
        regions.evaluate([tmp_path])
