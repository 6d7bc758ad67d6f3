"""The application in a process of its own, and pages of it in a browser."""

import base64
import os
import signal
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from helpers import ROOT
from helpers.browsing import wait

OUTLINED = "Boolean(relightApp.parts.outline.matte) && !relightApp.parts.outline.solving"
LIT = "Boolean(relightApp.parts.light.viewer?.engine)"

for extra in ("playwright", "starlette", "uvicorn"):
    pytest.importorskip(extra)


@contextmanager
def served(*words, before=(), **environment):
    """Run `relight app` on a small canvas; yield its address, token included, and the process.

    It has none of the networks that this user may have fetched. Python looks into the folders `before` first.
    """
    path = os.pathsep.join([*before, str(ROOT / "tests"), str(ROOT)])
    cache = str(Path(tempfile.gettempdir()) / "relight-app-tests-without-cache")
    process = subprocess.Popen(
        [sys.executable, "-m", "helpers.small_app", "app", "--no-browser", *map(str, words)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": path, "XDG_CACHE_HOME": cache, **environment},
        preexec_fn=_heed_hangups if hasattr(signal, "SIGHUP") else None,
    )
    try:
        address = process.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:"), "relight app printed no address"
        yield address, process
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30)


def _heed_hangups():
    """Undo `nohup` of whoever runs the tests, which the application would honour."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def visited(browser, address, size=(1280, 800), before=None, **options):
    """The application in a new window; its `complaints` are what the console was told."""
    width, height = size
    options = {"reduced_motion": "reduce"} | options  # software that draws an animation has no time for more
    context = browser.new_context(viewport={"width": width, "height": height}, **options)
    page = context.new_page()
    page.set_default_timeout(240_000)  # software that draws WebGL on busy machines is slow
    page.complaints = []
    page.on("console", lambda message: page.complaints.append(message.text))
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    if before:
        page.add_init_script(before)
    page.goto(address)
    wait(page, "Boolean(window.relightApp)")
    return page


def chosen(page, *paths):
    """Choose photographs by the first step's file dialogue."""
    page.locator(".drop input[type=file]").set_input_files([str(path) for path in paths])


DROP = """([name, text]) => {
    const bytes = Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
    const dataTransfer = new DataTransfer();
    dataTransfer.items.add(new File([bytes], name));
    const drop = new DragEvent("drop", { dataTransfer, bubbles: true, cancelable: true });
    document.querySelector("main > section:not([hidden])").dispatchEvent(drop);
}"""


def dropped(page, path):
    """Drop a photograph on the page."""
    page.evaluate(DROP, [Path(path).name, base64.b64encode(Path(path).read_bytes()).decode()])


def saved_picture(page, path):
    """Click on "Save PNG", and return the file's codes, (H, W, 3|4)."""
    with page.expect_download(timeout=240_000) as download:
        page.get_by_role("button", name="Save PNG", exact=True).click()
    download.value.save_as(path)
    with Image.open(path) as picture:
        return np.asarray(picture, int)


def lasso(page, points):
    """Click a closed line around the person: places as shares of the photograph, (N, 2)."""
    for across, down in [*points, points[0]]:
        x, y = page.evaluate(
            """([across, down]) => { const step = relightApp.parts.outline;
                 const at = step.canvas.getBoundingClientRect();
                 const [x, y] = step.paper.spot([across, down]); return [at.left + x, at.top + y]; }""",
            [float(across), float(down)],
        )
        page.mouse.click(x, y)


def at_step(page, step, seconds=240):
    """Wait until the page is at a step and nothing is being done."""
    wait(page, f"relightApp.step === '{step}' && !relightApp.aborting", seconds)


def lit_example(browser, address):
    """The application in a new window, at the light step with a person who has a matte."""
    page = visited(browser, address)
    chosen(page, ROOT / "examples" / "person.png")
    at_step(page, "light")
    wait(page, LIT, 240)
    return page
