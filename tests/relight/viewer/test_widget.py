"""The viewer as a notebook's widget: its lights are Python's, both ways."""

import json

import numpy as np
import pytest
from helpers import ROOT

import relight

pytest.importorskip("anywidget")
nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")

CELL = f"""
import numpy as np, relight
image = relight.read({str(ROOT / "examples" / "person.png")!r})
subject = relight.Subject(np.ascontiguousarray(image[::3, ::3]))
widget = subject.view(None, relight.DirectionalLight(azimuth=-40, name="key"))
widget.lights = [relight.DirectionalLight(azimuth=60, intensity=2, name="moved")]
told = widget.get_state()["lights"]
seen = []
widget.observe(lambda change: seen.append(change["new"][0].azimuth), "lights")
widget.set_state({{"lights": [told[0] | {{"azimuth": -90}}]}})  # as a drag in the browser does
same = np.array_equal(widget.snapshot(), subject.relit(relight.DirectionalLight(azimuth=-90, intensity=2)))
print(told[0]["name"], told[0]["azimuth"], np.round(seen), same)
widget
"""


@pytest.fixture(scope="module")
def subject(viewed):
    return viewed


@pytest.mark.slow
def test_a_notebook_shows_the_widget_and_its_lights_go_both_ways():
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(CELL)])
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
    printed, shown = notebook.cells[0].outputs[-2:]
    assert printed["text"] == "moved 60.0 [-90.] True\n"
    assert "application/vnd.jupyter.widget-view+json" in shown["data"]


def test_lights_that_the_widget_cannot_show_are_refused(subject):
    nine = [relight.DirectionalLight(name=str(number)) for number in range(9)]
    with pytest.raises(ValueError, match="up to 8 directional lights"):
        subject.view(None, nine)
    widget = subject.view()
    assert json.dumps(widget.get_state(["lights"])["lights"])
    assert np.isfinite(widget.snapshot()).all()


def test_gloss_goes_to_the_browser_and_back(subject):
    rim = relight.DirectionalLight(azimuth=150, elevation=30, name="rim")
    widget = subject.view(None, rim, gloss=0.4)
    assert widget.get_state(["gloss"])["gloss"] == 0.4
    widget.set_state({"gloss": 1.0})  # as the slider does
    assert np.array_equal(widget.snapshot(), subject.relit(rim, gloss=1))
    with pytest.raises(ValueError, match="gloss"):
        subject.view(None, rim, gloss=2)


def test_a_lamp_goes_to_the_browser_and_back(subject):
    lamp = relight.PointLight((-1, 0.5, 1), radius=0.1, name="lamp")
    widget = subject.view(None, lamp)
    told = json.loads(json.dumps(widget.get_state()["lights"]))
    widget.set_state({"lights": [told[0] | {"position": [1, 0.5, 1]}]})
    assert widget.lights == [relight.PointLight((1, 0.5, 1), radius=0.1, name="lamp")]
