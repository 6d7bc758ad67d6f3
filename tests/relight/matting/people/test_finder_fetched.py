"""The published networks, brought by `relight fetch person`: needs a package registry, and fails without."""

import os

import numpy as np
import pytest
from helpers import ROOT, browsing
from PIL import Image
from skimage import data
from typer.testing import CliRunner

import relight
from relight.cli.commands import app
from relight.matting.people import finder as person

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def fetched(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RELIGHT_CACHE", str(tmp_path_factory.mktemp("cache")))
        person.load.cache_clear()
        done = CliRunner().invoke(app, ["fetch", "person"])
        assert done.exit_code == 0, done.output
        yield
        person.load.cache_clear()


def test_the_silhouette_is_fetched_and_keeps_more_of_the_person():
    """The helmet that the astronaut holds belongs to them, and the shuttle on the table does not."""
    from relight.matting import silhouette_files

    coarse = relight.matte(data.astronaut(), "auto")
    done = CliRunner().invoke(app, ["fetch", "silhouette"])
    assert done.exit_code == 0, done.output
    assert "commercially is not settled" in " ".join(done.output.split())
    try:
        fine = relight.matte(data.astronaut(), "auto")
    finally:
        silhouette_files.fetched().unlink()
    assert fine[40:120, 180:270].mean() > 0.98  # the face
    assert fine[:200, 400:].mean() < 0.01  # the shuttle behind
    assert fine[380:500, 320:470].mean() > 0.95 > 0.2 > coarse[380:500, 320:470].mean()  # the helmet, held


def test_the_bundled_person_is_found_in_front_of_a_photograph():
    cut = relight.read(ROOT / "examples" / "person.png")
    height, width = cut.shape[:2]
    behind = (data.rocket() / 255) ** 2.2
    rows, columns = np.arange(height) * 427 // height, np.arange(width) * 640 // width
    photograph = cut[..., :3] + (1 - cut[..., 3:]) * behind[rows][:, columns]
    found = relight.matte(photograph.astype(np.float32), "auto") > 0.5
    where = cut[..., 3] > 0.5
    assert (found & where).sum() / (found | where).sum() > 0.95


def test_the_astronaut_is_found_and_relit(tmp_path):
    """Without a matte, by the shortest command."""
    Image.fromarray(data.astronaut()).save(tmp_path / "photo.jpg", quality=92)
    options = ["--preset", "golden-hour", "--background", "none", "-o", str(tmp_path / "out.png")]
    done = CliRunner().invoke(app, ["apply", str(tmp_path / "photo.jpg"), *options])
    assert done.exit_code == 0, done.output
    alpha = relight.read(tmp_path / "out.png")[..., 3] > 0.5
    assert alpha[40:120, 180:270].mean() > 0.95  # the face
    assert alpha[350:500, 60:280].mean() > 0.95  # the suit
    assert alpha[:200, 400:].mean() < 0.02  # the shuttle behind
    assert alpha[:120, :120].mean() < 0.02


@browsing.NEEDS_CHROMIUM
def test_one_drop_in_the_app_and_one_click_save_a_photograph_relit(browser, tmp_path):
    """The background is the photograph's own, and the person is in other light."""
    serving = pytest.importorskip("helpers.serving")
    before = data.astronaut()
    Image.fromarray(before).save(tmp_path / "photo.png")
    with serving.served(RELIGHT_CACHE=os.environ["RELIGHT_CACHE"]) as (address, _):
        page = serving.visited(browser, address)
        serving.dropped(page, tmp_path / "photo.png")
        serving.at_step(page, "light")
        browsing.wait(page, serving.LIT, 240)
        saved = serving.saved_picture(page, tmp_path / "saved.png")
        page.context.close()
    assert saved.shape == before.shape
    changed = np.abs(saved - before).max(axis=-1)
    assert changed[:200, 400:].max() <= 2  # the shuttle behind
    assert changed[:120, :120].max() <= 2
    assert changed[40:120, 180:270].mean() > 10  # the face


def test_two_people_side_by_side_are_told_apart():
    one = data.astronaut()
    found = relight.matte(np.hstack([one, one[:, ::-1]]), "auto", person=(230, 250)) > 0.5
    assert found[:, :512].mean() > 0.25
    assert found[:, 512:].mean() < 0.05
