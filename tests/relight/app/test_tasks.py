"""What the worker computes of a photograph, without a server: reduced for the page, whole for files."""

import base64
import io

import numpy as np
import pytest
from helpers.clothed import clothed
from helpers.drawn import overlap, polygon
from helpers.onnx_models import channel
from helpers.packages import NEEDS_PYMATTING
from PIL import Image

import relight
from relight.app import tasks
from relight.matting import outline

pytestmark = NEEDS_PYMATTING

LOOK = {"lights": ["key:azimuth=-40,elevation=30"], "background": [0.1, 0.1, 0.1]}


def silent(what, share=None):
    """Take a report of progress."""


def codes(png):
    """Return the grey codes of a PNG in memory."""
    return np.asarray(Image.open(io.BytesIO(png)), int)


@pytest.fixture
def folder(here, tmp_path, monkeypatch):
    """A photograph of 200 x 160 pixels in the working folder, whose reduced copy is half as large."""
    plate, matte = clothed()
    behind = np.random.default_rng(1).uniform(0.1, 0.3, (200, 160, 1)) * (0.4, 0.6, 1)
    pixels = plate * matte[..., None] + behind * (1 - matte[..., None])
    Image.fromarray(np.round(255 * pixels ** (1 / 2.2)).astype(np.uint8)).save(tmp_path / "me.png")
    monkeypatch.setattr(tasks, "PREVIEW_SIDE", 100)
    tasks.read("me.png", silent)
    lasso = polygon(matte, 0) / (160, 200)  # shares of width and height
    return tmp_path, matte, {"lasso": lasso.tolist(), "strokes": [], "model": False}


def test_an_outline_is_solved_once_until_it_changes(folder, monkeypatch):
    path, _, drawn = folder
    solve, solved = outline.outlined, []
    monkeypatch.setattr(outline, "outlined", lambda *given: solved.append(1) or solve(*given))
    first = tasks.outline_of(drawn, silent)["png"]
    assert tasks.outline_of(dict(drawn), silent)["png"] == first
    assert len(solved) == 1
    half = {**drawn, "strokes": [{"person": False, "points": [[0.2, 0.8], [0.8, 0.8]], "radius": 0.3}]}
    assert tasks.outline_of(half, silent)["png"] != first
    model = channel(path / "red.onnx", 0)
    by_model = {"lasso": None, "strokes": [], "model": True}
    for scale in (1, 0.8):  # the second matte replaces the first one
        found = tasks.matte_by_model(f"{model},mean=0/0/0,std={scale}/1/1", silent)["png"]
        again = tasks.outline_of(by_model, silent)["png"]
        np.testing.assert_allclose(codes(again), codes(found), atol=1)


def test_a_photograph_named_as_the_preview_stays_as_it_is(folder):
    path, _, _ = folder
    for name in ("preview.jpg", "preview.png"):
        Image.open(path / "me.png").convert("RGB").save(path / name)
        before = (path / name).read_bytes()
        about = tasks.read(name, silent)
        assert (path / name).read_bytes() == before
        assert max(Image.open(path / about["preview"]).size) == 100


@pytest.mark.parametrize("size", [(40, 20), (20, 40)])
def test_a_background_keeps_its_shape_for_photographs_of_any_other(folder, monkeypatch, size):
    path, _, _ = folder
    monkeypatch.setattr(tasks, "BACKGROUND_SIDE", 20)
    Image.fromarray(np.linspace(0, 255, 800).reshape(*size[::-1]).astype(np.uint8)).convert("RGB").save(
        path / "street.png"
    )
    shown = Image.open(io.BytesIO(base64.b64decode(tasks.background("street.png", silent)["data"])))
    assert shown.size == (size[0] // 2, size[1] // 2)


def test_an_outline_that_cannot_be_analysed_leaves_the_one_before(folder, monkeypatch):
    path, _, drawn = folder
    np.save(tasks.MATTE, np.ones((100, 80), np.float16))
    (path / "me-matte.png").write_bytes(b"written before")

    def cancelled(*arguments, **options):
        raise ValueError("cancelled")

    monkeypatch.setattr(tasks, "Subject", cancelled)
    with pytest.raises(ValueError, match="cancelled"):
        tasks.analyse("me.png", "me-matte.png", drawn, silent)
    assert np.load(tasks.MATTE).min() == 1
    assert (path / "me-matte.png").read_bytes() == b"written before"


def test_what_the_worker_loads_while_it_waits_is_there(folder):
    for prepare in tasks.PREPARATIONS:
        prepare()


class Analysed:
    """In place of a subject, whose analysis is not wanted here."""

    size = (100, 80)
    record = matte = albedo = None

    def __init__(self, image, mask, *, feather):
        Analysed.mask, Analysed.feather = mask, feather

    def clean_plate(self, image):
        return image

    def preset_gain(self, name):
        return 1.0


@pytest.fixture
def unanalysed(monkeypatch):
    monkeypatch.setattr(tasks, "Subject", Analysed)
    monkeypatch.setattr(tasks, "pack", lambda *given, **options: b"")


def test_a_matte_from_a_file_is_the_accepted_one_as_it_is(folder, unanalysed):
    path, matte, _ = folder
    given = np.round(matte * 255).astype(np.uint8)
    Image.fromarray(given).save(path / "hand.png")
    tasks.load_matte("hand.png", silent)
    tasks.analyse("me.png", "me-matte.png", {"model": "file"}, silent)
    tasks.full_matte("me.png", "me-matte.png", silent)
    np.testing.assert_allclose(relight.read_mask(path / "me-matte.png"), given / 255, atol=1e-3)
    Image.fromarray(given[:150]).save(path / "other.png")
    with pytest.raises(ValueError, match="the photograph's proportions, got 160 x 150"):
        tasks.load_matte("other.png", silent)


def test_alpha_and_mattes_from_files_need_no_pymatting(folder, unanalysed, missing):
    path, matte, drawn = folder
    missing("pymatting.laplacian.cf_laplacian")
    tasks.analyse("me.png", None, None, silent)
    Image.fromarray(np.round(matte * 255).astype(np.uint8)).save(path / "hand.png")
    tasks.load_matte("hand.png", silent)
    tasks.outline_of({"model": "file"}, silent)
    tasks.analyse("me.png", "me-matte.png", {"model": "file"}, silent)
    tasks.full_matte("me.png", "me-matte.png", silent)
    with pytest.raises(ImportError, match="needs PyMatting"):
        tasks.outline_of(drawn, silent)


def test_a_shifted_edge_is_that_of_the_page_and_of_the_file(folder, unanalysed):
    path, matte, _ = folder
    Image.fromarray(np.round(matte * 255).astype(np.uint8)).save(path / "hand.png")
    tasks.load_matte("hand.png", silent)
    areas = []
    for shift in (0, 0.01, -0.01):  # of 200 pixels: two outward, and two inward
        drawn = {"model": "file", "shift": shift, "feather": 0.02}
        shown = codes(tasks.outline_of({**drawn, "feather": 0}, silent)["png"]) / 255
        scene = tasks.analyse("me.png", "me-matte.png", drawn, silent)["scene"]
        np.testing.assert_allclose(Analysed.mask, shown, atol=0.01)
        assert Analysed.feather == 2  # of the copy's 100 pixels
        assert scene["command"][-2:] == ["--feather", "4"]  # of the photograph's 200
        tasks.full_matte("me.png", "me-matte.png", silent)
        whole = relight.read_mask(path / "me-matte.png")
        assert overlap(np.repeat(np.repeat(shown, 2, 0), 2, 1), whole) > 0.95
        areas.append(whole.sum())
    assert areas[2] < 0.97 * areas[0] < 1.03 * areas[0] < areas[1]
    with pytest.raises(ValueError, match=r"edge: expected shares of up to 0\.05"):
        tasks.outline_of({"model": "file", "shift": 1}, silent)


@pytest.mark.slow
def test_a_photograph_larger_than_its_copy_is_lit_reduced_and_saved_whole(folder):
    path, matte, drawn = folder
    reports = []
    scene = tasks.analyse("me.png", "me-matte.png", drawn, reports.append)["scene"]
    assert reports == ["Refining the edge", "Analysing the person", "Preparing the light"]
    assert scene["command"] == ["relight", "apply", "me.png", "--mask", "me-matte.png"]
    assert not (path / "me-matte.png").exists()  # nobody waits for it before the light
    tasks.save("me.png", "me-matte.png", LOOK, "me-relit.png", [], silent)
    found = relight.read(path / "me-relit.png")
    assert found.shape[:2] == (200, 160)
    mask = np.asarray(Image.open(path / "me-matte.png"))
    assert overlap(mask / np.iinfo(mask.dtype).max, matte) > 0.95


@pytest.mark.slow
@pytest.mark.parametrize(
    ("suffix", "last"), [(".jpg", "Relighting"), (".html", "Writing the page"), (".glb", "Making the mesh")]
)
def test_a_save_says_what_is_being_done_and_never_goes_back(folder, suffix, last):
    path, matte, _ = folder
    relight.media.images.write_mask(path / "me-matte.png", matte)
    told = []
    tasks.save("me.png", "me-matte.png", LOOK, f"me-relit{suffix}", [], lambda *said: told.append(said))
    names, shares = zip(*told, strict=True)
    assert names[0] == "Analysing the person"
    assert last in names
    assert list(shares) == sorted(shares)
    assert (path / f"me-relit{suffix}").exists()


@pytest.mark.slow
def test_the_light_of_the_background_fills_shadows_in_stills_and_files(folder):
    path, _, drawn = folder
    scene = tasks.analyse("me.png", "me-matte.png", drawn, silent)["scene"]
    assert np.shape(scene["original"]["lamps"])[1] == 6
    shown = []
    for fill in (0, 0.5):
        look = LOOK | {"background": "original", "fill": fill}
        still = Image.open(io.BytesIO(tasks.still("me.png", "me-matte.png", look, silent)["png"]))
        tasks.save("me.png", "me-matte.png", look, f"filled-{fill}.png", [], silent)
        saved = Image.open(path / f"filled-{fill}.png").resize(still.size, Image.Resampling.BOX)
        shown.append([np.asarray(each.convert("L"), float).mean() for each in (still, saved)])
    (dark, dark_file), (filled, filled_file) = shown
    assert filled > dark + 2
    assert filled_file - dark_file == pytest.approx(filled - dark, rel=0.25)
    with pytest.raises(ValueError, match="fill: expected a background that is an image"):
        tasks.still("me.png", "me-matte.png", LOOK | {"fill": 0.5}, silent)


@pytest.mark.slow
def test_an_exr_has_the_blurred_background_if_it_is_asked_for(folder):
    path, matte, _ = folder
    relight.media.images.write_mask(path / "me-matte.png", matte)
    shown = {}
    for name, look in (
        ("cut", {"blur": 0.05}),
        ("sharp", {"plate": True}),
        ("blurred", {"plate": True, "blur": 0.05}),
    ):
        tasks.save(
            "me.png", "me-matte.png", LOOK | {"background": "original"} | look, f"{name}.exr", [], silent
        )
        shown[name] = relight.read(path / f"{name}.exr")
    assert shown["cut"][..., 3].min() == 0
    assert shown["sharp"].shape[-1] == 3 or shown["sharp"][..., 3].min() == 1
    sharp, blurred = (shown[name][:20, :20, 1].std() for name in ("sharp", "blurred"))
    assert blurred < 0.3 * sharp


@pytest.mark.slow
def test_files_of_one_photograph_are_analysed_once_and_again_when_the_matte_changes(folder, monkeypatch):
    path, matte, _ = folder
    analysed, subject = [], tasks.Subject
    monkeypatch.setattr(
        tasks, "Subject", lambda *given, **options: analysed.append(1) or subject(*given, **options)
    )
    relight.media.images.write_mask(path / "me-matte.png", matte)
    for output in ("me-relit.png", "me-relit.exr"):
        tasks.save("me.png", "me-matte.png", LOOK, output, [], silent)
    assert len(analysed) == 1
    shown = relight.read(path / "me-relit.exr")
    expected = relight.apply(
        relight.read(path / "me.png"), relight.DirectionalLight(azimuth=-40, elevation=30),
        mask=relight.media.images.read_mask(path / "me-matte.png"), background=(0.1, 0.1, 0.1),
    )  # fmt: skip
    np.testing.assert_allclose(shown, expected, rtol=2e-3, atol=1e-3)
    relight.media.images.write_mask(path / "me-matte.png", np.where(np.arange(200)[:, None] < 100, matte, 0))
    tasks.save("me.png", "me-matte.png", LOOK, "me-relit.png", [], silent)
    assert len(analysed) == 2
    monkeypatch.setattr(tasks, "KEPT_PIXELS", 1)
    tasks.kept_subjects.clear()
    for _ in range(2):
        tasks.save("me.png", "me-matte.png", LOOK, "me-relit.png", [], silent)
    assert len(analysed) == 4


def test_an_outline_that_is_accepted_again_replaces_the_matte(folder):
    path, _, drawn = folder
    tasks.analyse("me.png", "me-matte.png", drawn, silent)
    tasks.full_matte("me.png", "me-matte.png", silent)
    first = np.asarray(Image.open(path / "me-matte.png"))
    half = {**drawn, "strokes": [{"person": False, "points": [[0.2, 0.8], [0.8, 0.8]], "radius": 0.3}]}
    tasks.analyse("me.png", "me-matte.png", half, silent)
    tasks.full_matte("me.png", "me-matte.png", silent)
    second = np.asarray(Image.open(path / "me-matte.png"))
    assert second[170, 80] == 0 < first[170, 80]
