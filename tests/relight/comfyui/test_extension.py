"""The node Relight Viewer in a browser: ComfyUI's extension in a page that has ComfyUI's hooks."""

from pathlib import Path
from urllib.parse import parse_qs

import numpy as np
import pytest
from helpers import ROOT, browsing

import relight
from relight.comfyui import WEB_DIRECTORY
from relight.comfyui.lights import LightNode
from relight.comfyui.subjects import SubjectBatch
from relight.comfyui.viewer import Viewer

pytest.importorskip("playwright")
pytestmark = browsing.NEEDS_CHROMIUM

SITE = "http://comfyui.test"
# What the extension uses of ComfyUI: `app.registerExtension`, a node's widgets and events, `api.fetchApi`.
APP = """
export const app = { registerExtension: (extension) => (window.extension = extension) };
"""
API = """
export const api = { fetchApi: (route) => fetch(`/api${route}`) };
"""
PAGE = """<!doctype html>
<body style="margin: 0; background: #222">
<script type="module">
import "/extensions/relight/relight.js";
class Node {
  comfyClass = "RelightViewer";
  size = [200, 100];
  widgets = [{ name: "held", type: "text", value: "" }];
  addWidget(type, name, value, callback) {
    this.widgets.push({ type, name, value, callback });
    return this.widgets.at(-1);
  }
  addDOMWidget(name, type, element, options) {
    document.body.append(element);
    Object.assign(element.style, { width: `${this.size[0]}px`, height: `${this.size[1]}px` });
    this.widgets.push({ name, type, element, options });
    return this.widgets.at(-1);
  }
  setSize(size) {
    this.size = size;
    const { style } = this.widgets.at(-1).element;
    Object.assign(style, { width: `${size[0]}px`, height: `${size[1]}px` });
  }
}
window.node = new Node();
extension.nodeCreated(node);
window.held = () => node.widgets[0].value;
</script>
"""


@pytest.fixture(scope="module")
def batch():
    image = relight.read(ROOT / "examples" / "person.png")
    subject = relight.Subject(np.ascontiguousarray(image[::4, ::4]))
    return SubjectBatch(1, iter([(subject, subject)]))


def served(browser, temp):
    """A page with the node, whose files come from the package and from ComfyUI's temporary folder."""
    page = browser.new_context(viewport={"width": 900, "height": 660}).new_page()
    page.complaints = []
    page.on("pageerror", lambda error: page.complaints.append(str(error)))

    def fulfil(route):
        path, _, query = route.request.url.removeprefix(SITE).partition("?")
        scripts = {"/": PAGE, "/scripts/app.js": APP, "/scripts/api.js": API}
        if path in scripts:
            kind = "text/html" if path == "/" else "text/javascript"
            route.fulfill(body=scripts[path], content_type=kind)
        elif path == "/extensions/relight/relight.js":
            route.fulfill(path=Path(WEB_DIRECTORY) / "relight.js", content_type="text/javascript")
        elif path == "/api/view" and (file := temp / parse_qs(query)["filename"][0]).exists():
            route.fulfill(path=file, content_type="application/octet-stream")
        else:
            route.fulfill(status=404)

    page.route(f"{SITE}/**", fulfil)
    page.goto(SITE)
    browsing.wait(page, "Boolean(window.node)")
    return page


@pytest.mark.slow
def test_the_light_that_is_dragged_in_the_node_feeds_the_workflow(browser, batch, tmp_path, comfyui):
    lights = LightNode().add(-50.0, 20.0, intensity=2.0, softness=10.0, name="key")[0]
    node = Viewer()
    shown = node.show(batch, lights=lights)["ui"]
    page = served(browser, tmp_path)
    assert "Run the workflow once" in page.inner_text("p")
    assert page.evaluate("node.widgets[0].hidden")
    assert page.evaluate("node.widgets.slice(1).every((widget) => widget.serialize === false)")

    page.evaluate("(ui) => node.onExecuted(ui)", shown)
    ready = "Boolean(document.querySelector('iframe').contentWindow?.relight)"
    browsing.wait(page, ready)
    assert page.inner_text("p") == ""
    assert page.evaluate("held()") == ""
    inner = "document.querySelector('iframe').contentWindow"
    x, y, radius = page.evaluate(
        f"[...{inner}.relight.viewer.stage.middle, {inner}.relight.viewer.stage.radius]"
    )
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 0.3 * radius, y)
    page.mouse.move(x + 0.6 * radius, y - 0.2 * radius)
    page.mouse.up()
    browsing.wait(page, "held() !== ''")
    browsing.settled(page)

    again = node.show(batch, lights=lights, held=page.evaluate("held()"))
    assert again["ui"] == shown  # the page stays open
    ((held,),) = again["result"]
    assert 30 < held.azimuth < 70
    assert held.elevation > 5
    assert (held.name, held.intensity, held.angle) == ("key", 2, 10)
    right, left = batch[0].lighting(held)[:, 63:], batch[0].lighting(held)[:, :63]
    assert right.sum() > 1.2 * left.sum()

    page.evaluate("(ui) => node.onExecuted(ui)", again["ui"])  # as after the next run
    assert page.evaluate(f"{inner}.relight.link() === held()")
    page.evaluate("node.widgets[1].callback()")
    browsing.wait(page, f"{ready} && Math.abs({inner}.relight.viewer.state.lights[0].azimuth + 50) < 0.01")
    assert page.evaluate("held()") == ""
    assert page.complaints == []


@pytest.mark.slow
def test_a_workflow_that_was_saved_shows_what_was_held(browser, batch, tmp_path, comfyui):
    held = "light=key%3Aazimuth%3D70%2Celevation%3D5"
    shown = Viewer().show(batch, held=held)["ui"]
    page = served(browser, tmp_path)
    page.evaluate("(text) => (node.widgets[0].value = text)", held)
    page.evaluate("(ui) => node.onExecuted(ui)", shown)
    inner = "document.querySelector('iframe').contentWindow"
    browsing.wait(page, f"Boolean({inner}?.relight)")
    assert page.evaluate(f"{inner}.relight.viewer.state.lights[0].azimuth") == 70
    gone = {"relight_viewer": [{"filename": "gone.html", "subfolder": "", "type": "temp"}]}
    page.evaluate("(ui) => node.onExecuted(ui)", gone)
    browsing.wait(page, "document.querySelector('p').textContent.includes('no longer there')")
