"""The viewer's page as text: what it is made of, and what is refused. test_viewer.py opens it."""

import json
import re
import zlib

import numpy as np
import pytest
from typer.testing import CliRunner

import relight
from relight.cli.commands import app
from relight.media.colour import temperature
from relight.viewer.initial_state import scene_of
from relight.viewer.packing import pack
from relight.viewer.page import module, page


@pytest.fixture(scope="module")
def subject():
    rgb = np.random.default_rng(0).uniform(0.05, 0.6, (160, 120, 3)).astype(np.float32)
    mask = np.zeros((160, 120), np.float32)
    mask[20:140, 40:80] = 1
    return relight.Subject(rgb, mask)


def test_a_page_holds_all_that_it_needs(subject, tmp_path):
    written = subject.view(tmp_path / "page.html", title="a & b")
    text = written.read_text()
    assert "<title>a &amp; b</title>" in text
    assert not re.search(r"""(src|href)=|https?://(?!www\.w3\.org/2000/svg)|\bfetch\(""", text)
    assert not re.search(r"^(import|export) ", module(), re.MULTILINE)


def test_what_is_packed_comes_back(subject):
    packed = pack(subject.record, subject.matte, subject.albedo)
    length = int.from_bytes(packed[:4], "little")
    about = json.loads(packed[4 : 4 + length])
    stream = zlib.decompress(packed[4 + length : 4 + length + about["parts"][0]])
    arrays, start = {}, 0
    for spec in about["arrays"]:
        kind, shape = np.dtype(spec["type"]), spec["shape"]
        size = int(np.prod(shape)) * kind.itemsize
        planes = np.frombuffer(stream[start : start + size], np.uint8).reshape(kind.itemsize, *shape)
        whole = np.moveaxis(np.cumsum(planes, axis=-1, dtype=np.uint8), 0, -1)
        arrays[spec["name"]] = np.ascontiguousarray(whole).view(kind).reshape(shape)
        start += size
    left, top, width, height = about["box"]
    matte = subject.matte[top : top + height, left : left + width]
    np.testing.assert_allclose(arrays["matte"][0] / 255, matte, atol=1 / 500)
    cast = arrays["features"][: arrays["cast"].shape[1] - 1].reshape(arrays["cast"].shape[1] - 1, -1) / 255
    logits = arrays["cast"][:, :-1] @ cast + arrays["cast"][:, -1:]
    known = (arrays["guide"][3] > 0).ravel()
    seen = subject.record.maps.visibility
    truth = np.zeros((len(logits), known.size), np.float32)
    truth[:, seen.silhouette.pixels.numpy()] = seen.maps.cast.numpy() + 3  # LIT
    assert np.sqrt(((logits - truth)[:, known] ** 2).mean()) < 0.3  # of logits that go from -10 to 10


def test_larger_plates_are_reduced(subject, monkeypatch):
    monkeypatch.setattr("relight.viewer.packing.MAX_PLATE_SIDE", 80)
    packed = pack(subject.record, subject.matte, subject.albedo)
    about = json.loads(packed[4 : 4 + int.from_bytes(packed[:4], "little")])
    assert about["size"] == [60, 80]
    assert about["scale"] == pytest.approx(2 * subject.record.framing.scale, rel=0.05)


def test_colours_of_temperatures_lie_between_the_table_s():
    tints = scene_of((4, 4))["tints"]
    for locus, kelvin in (("planckian", 3210), ("planckian", 9000), ("daylight", 5600)):
        first, step = tints[locus]["mired"]
        place = (1e6 / kelvin - first) / step
        low, high = (np.array(tints[locus]["colours"][int(place) + above]) for above in (0, 1))
        found = low + (high - low) * (place % 1)
        np.testing.assert_allclose(found, temperature(kelvin, locus), atol=2e-3)


def test_what_ends_a_script_is_escaped(subject):
    text = page(scene_of((4, 4), relight.DirectionalLight(name="</script><script>alert(1)"), title="x"), b"")
    assert text.count("</script>") == 3


@pytest.mark.parametrize(
    ("lights", "words"),
    [
        ([relight.DirectionalLight(name=str(number)) for number in range(9)], "up to 8 directional"),
        ([relight.EnvironmentLight(np.ones((4, 8, 3)), name=name) for name in "ab"], "one environment"),
        ([relight.DirectionalLight(name="a")] * 2, "different names"),
    ],
)
def test_lights_that_the_page_cannot_show_are_refused(lights, words):
    with pytest.raises(ValueError, match=words):
        scene_of((4, 4), lights)


def test_rectangles_are_refused_and_lamps_where_none_can_stand(subject, tmp_path):
    softbox = relight.RectLight((0, 1, 1), (0, 0, 0), 1, 1)
    with pytest.raises(
        TypeError, match="shows DirectionalLight, PointLight and EnvironmentLight, got RectLight"
    ):
        scene_of((4, 4), softbox)
    with pytest.raises(ValueError, match="touches the person"):
        subject.view(tmp_path / "page.html", relight.PointLight((0, 0, 0), radius=0.3))
    assert not list(tmp_path.iterdir())


def test_a_temporally_filtered_subject_has_a_page(subject, tmp_path):
    page = subject.temporally_filtered([subject]).view(tmp_path / "page.html")
    assert page.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["none.png", "-o", "page.html"], "none.png: no such file"),
        (["none.png", "-o", "page.png"], "ends in .html"),
        (["none.png", "-o", "nowhere/page.html"], "nowhere does not exist"),
        (["plate.%04d.png", "-o", "page.html"], "plate.%04d.png: no such frames"),
        (["none.png", "--light", "azimuth=north", "-o", "page.html"], "azimuth: expected a number"),
    ],
)
def test_the_command_refuses_in_one_line(words, said, tmp_path, here):
    done = CliRunner().invoke(app, ["view", *words])
    assert done.exit_code == 2
    assert said in " ".join(done.output.split())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("background", "name"), [(None, "plate"), ("plate", "plate"), ("none", None)])
def test_a_page_keeps_the_photograph_behind_the_person(tmp_path, background, name):
    photograph, matte = np.full((64, 48, 3), 0.2, np.float32), np.zeros((64, 48), np.float32)
    photograph[8:60, 12:36], matte[8:60, 12:36] = 0.5, 1
    relight.write(tmp_path / "p.png", photograph)
    relight.write_mask(tmp_path / "m.png", matte)
    source = relight.Source(tmp_path / "p.png", mask=tmp_path / "m.png")
    relight.write_view(tmp_path / "p.html", source, relight.Lighting(background=background))
    scene = json.loads((tmp_path / "p.html").read_text().split('id="scene">')[-1].split("</script>")[0])
    assert (scene["backdrop"] or {}).get("name") == name
