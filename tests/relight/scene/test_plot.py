from xml.etree import ElementTree

import numpy as np
import pytest
from helpers import ROOT
from helpers.damage import small_canvas
from typer.testing import CliRunner

import relight
from relight.cli.commands import app

SVG = "{http://www.w3.org/2000/svg}"
KEY = relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2, name="key")


def words_of(path):
    return [each.text for each in ElementTree.parse(path).iter(f"{SVG}text")]


def test_the_table_has_places_colours_and_stops_against_the_key(tmp_path):
    lights = [
        KEY,
        relight.DirectionalLight(azimuth=140, elevation=-10, angle=20, intensity=1, name="rim"),
        relight.PointLight((0, 0, 2), temperature=3200, intensity=2, name="lamp"),  # 2 / 2² at two metres
        relight.RectLight((1.8, 0, 0), toward=(0, 0, 0), width=0.5, height=1, name="softbox"),
        relight.EnvironmentLight(np.full((16, 32, 3), 0.5, np.float32), name="sky"),
    ]
    words = words_of(relight.write_plot(tmp_path / "plot.svg", lights, distance=3, title="Scene 12"))
    for word in (
        "Scene 12", "From above", "From the side", "camera, 3.0 m", "40° left, 30° up", "key", "far", "hard",
        "140° right behind, 10° down", "20° across", "-1.0 stops", "at the camera, 0° up", "2.00 m", "3200 K",
        "-2.0 stops", "90° right, 0° up", "0.5 × 1 m", "all around, turned 0°",
    ):  # fmt: skip
        assert word in words, word
    assert words.count("-2.0 stops") == 2  # the lamp, and a sky of 0.5


def test_lamps_stand_where_they_are(tmp_path):
    lamp = relight.PointLight((-1, 0.5, 1), name="lamp")
    root = ElementTree.parse(relight.write_plot(tmp_path / "plot.svg", lamp, distance=3)).getroot()
    plan, side = (
        group for group in root.findall(f"{SVG}g") if group.find(f"{SVG}rect").get("fill") == "none"
    )
    scale = 240 / (1.12 * 3)
    ((x, y),) = [
        (float(c.get("cx")), float(c.get("cy"))) for c in plan.iter(f"{SVG}circle") if c.get("r") == "8"
    ]
    assert (x, y) == pytest.approx(
        (240 - scale, 240 + scale), abs=0.02
    )  # image left, toward the camera below
    ((x, y),) = [
        (float(c.get("cx")), float(c.get("cy"))) for c in side.iter(f"{SVG}circle") if c.get("r") == "8"
    ]
    assert (x, y) == pytest.approx((240 + scale, 240 - 0.5 * scale), abs=0.02)


def test_names_are_text_and_nothing_else(tmp_path):
    lights = relight.DirectionalLight(name="<script>&\"'")
    words = words_of(relight.write_plot(tmp_path / "plot.svg", lights, title="a <b> & c"))
    assert "<script>&\"'" in words
    assert "a <b> & c" in words
    with pytest.raises(ValueError, match="at=head is for pictures and shots"):
        relight.write_plot(tmp_path / "plot.svg", relight.PointLight((0, 0, 1), at="head"))
    with pytest.raises(ValueError, match=r"plot.png"):
        relight.write_plot(tmp_path / "plot.png", lights)
    assert words_of(relight.write_plot(tmp_path / "none.svg", []))[0] == "Lighting plot"


def test_the_command_draws_a_plot(here):
    person = np.ascontiguousarray(relight.read(ROOT / "examples" / "person.png")[::4, ::4])
    relight.write("person.png", person)
    with small_canvas(256):
        run = CliRunner().invoke(
            app, ["apply", "person.png", "--preset", "three-point", "--plot", "plot.svg", "-o", "out.exr"]
        )
    assert run.exit_code == 0, run.output
    words = words_of("plot.svg")
    assert "person.png" in words
    assert {"key", "fill", "rim"} & set(words)
    with pytest.raises(ValueError, match=r"plot.pdf"):
        relight.render_shot("person.png", "rim", relight.Output(["out.exr"], plot="plot.pdf"))
