"""What a newcomer types, and what they are answered: it is done, or one line says what to type."""

import numpy as np
import pytest
from typer.testing import CliRunner

import relight
from relight.cli.commands import app
from relight.pipeline import render

REFUSED = {
    "photo.jpg": "to relight a picture: relight apply photo.jpg --preset golden-hour -o out.jpg",
    "gui": "the application opens by: relight app",
    "apply phot.jpg --preset rim -o a.png": "phot.jpg: no such file; did you mean photo.jpg?",
    "apply https://example.org/a.jpg --preset rim -o a.png": "is an address; download the picture",
    "apply photo.jpg --preset rembrant -o a.png": "did you mean rembrandt?",
    "apply photo.jpg --preset rim -o a.heic": "a.heic: expected a file name that ends in",
    "apply photo.jpg --preset rim -o gone/a.png": "gone/a.png: the folder gone does not exist",
    "apply photo.jpg --preset rim -o photo.jpg": "is read as well, and would be overwritten",
    "apply photo.jpg -o a.png": "lights: expected at least one (--preset",
    "apply photo.jpg --light left -o a.png": "did you mean azimuth=left?",
    "apply photo.jpg --light azimuth=top -o a.png": "did you mean elevation=top?",
    "apply photo.jpg --light color=orange -o a.png": "color: not known; did you mean colour?",
    "apply photo.jpg --light az=40 -o a.png": "az: not known; did you mean azimuth?",
    "apply photo.jpg --light colour=ornage -o a.png": "did you mean orange?",
    "apply photo.jpg --preset rim --background blak -o a.png": "did you mean black?",
    "apply photo.jpg photo.jpg --preset rim -o a.png": "a.png: expected {name} in the name",
}
DONE = {
    ("--light", "azimuth=left,temperature=3200K"): lambda light: round(light.azimuth) == -90,
    ("--light", "azimuth=-40deg,colour=orange"): lambda light: light.colour[0] == 1,
    ("--light", "elevation=above,colour=#ff8800"): lambda light: round(light.elevation) == 90,
    ("--preset", "Golden Hour"): lambda light: light.name == "sun",
}
BACKGROUNDS = {"black": (0, 0, 0), "none": "none", "blur": "plate", "#ffffff": (1, 1, 1)}


@pytest.fixture(autouse=True)
def folder(here):
    relight.write("photo.jpg", np.full((8, 8, 3), 0.5, np.float32))


def run(*words):
    result = CliRunner().invoke(app, [*words])
    return result.exit_code, result.output.strip()


@pytest.mark.parametrize("command", REFUSED)
def test_what_cannot_be_done_is_answered_by_one_line_that_helps(command):
    code, said = run(*command.split())
    assert (code, said.count("\n")) == (2, 0), said
    assert said.startswith("relight: ")
    assert REFUSED[command] in said


@pytest.fixture
def given(monkeypatch):
    """What the command hands to `render_shot`."""
    taken = {}

    def render_shot(source, lighting, output, **options):
        taken.update(source=source, lighting=lighting, output=output)
        return {}

    monkeypatch.setattr(render, "render_shot", render_shot)
    return taken


@pytest.mark.parametrize("words", DONE)
def test_what_is_plain_is_done(words, given):
    assert run("apply", "photo.jpg", *words, "-o", "a.png") == (0, "a.png")
    lighting = given["lighting"]
    assert DONE[words]([*lighting.preset_lights, *lighting.rig().lights][0])


@pytest.mark.parametrize("text", BACKGROUNDS)
def test_backgrounds_by_word_and_colour(text, given):
    assert run("apply", "photo.jpg", "--preset", "rim", "--background", text, "-o", "a.png") == (0, "a.png")
    assert given["lighting"].background == BACKGROUNDS[text]


def test_codes_of_8_bits_are_warned_of_with_what_to_type(given):
    with pytest.warns(UserWarning, match=r"brighter than white; intensity=2 is twice .*#ff8000"):
        assert run("apply", "photo.jpg", "--light", "colour=255/128/0", "-o", "a.png")[0] == 0


def test_presets_are_listed():
    code, said = run("presets")
    assert code == 0
    assert [line.split()[0] for line in said.splitlines()] == [*relight.presets()]
