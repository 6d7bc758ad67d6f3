"""Pages of the viewer in a real browser: Debian's chromium, without a screen, WebGL 2 in software.

Every page is under a Content-Security-Policy that allows nothing but what is in the file itself.
"""

import base64
import shutil
import time
from contextlib import contextmanager

import numpy as np

POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'"
HOSTILE = "<script>window.hostile = 1</script><img src=x onerror='window.hostile = 1'>"
FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
)
OWN = ("file:", "blob:")  # what a page may ask for: itself, and what it made
READ = """async (lights) => {
    const parts = [];
    for (const light of lights) {
        const { width, height, data } = await relight.render([light].flat());
        const bytes = new Uint8Array(data.buffer);
        let text = "";
        for (let at = 0; at < bytes.length; at += 30000) {
            text += String.fromCharCode(...bytes.subarray(at, at + 30000));
        }
        parts.push([height, width, btoa(text)]);
    }
    return parts;
}"""


def chromium():
    """The browser's path, or None."""
    return shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@contextmanager
def browser():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        yield driver.chromium.launch(executable_path=chromium(), args=list(FLAGS))


def policed(path):
    """The file of a page, under the policy."""
    text = path.read_text()
    policy = f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
    path.write_text(text.replace("<head>", f"<head>\n{policy}", 1))
    return path


def opened(browser, path, fragment="", size=(1100, 760), ready=True, before=None):
    """A page in a new window. Its `complaints` are what it logged, and what it asked the network for."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]})
    page = context.new_page()
    page.complaints = []
    page.on("console", lambda message: page.complaints.append(message.text))
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    page.on(
        "request",
        lambda request: request.url.startswith(OWN) or page.complaints.append(request.url),
    )
    if before:
        page.add_init_script(before)
    page.goto(f"{path.as_uri()}{'#' if fragment else ''}{fragment}")
    if ready:
        wait(page, "Boolean(window.relight)")
        settled(page)
    return page


def wait(page, condition, seconds=60):
    """Waits until an expression is true. (`Page.wait_for_function` needs a policy that allows `eval`.)"""
    end = time.monotonic() + seconds
    while not page.evaluate(condition):
        assert time.monotonic() < end, f"{condition}: not within {seconds} s; {page.complaints}"
        time.sleep(0.05)


def settled(page):
    """Waits until the page shows its state."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def rendered(page, lights):
    """What `relight.render` hands back for each light, or list of lights: (H, W, 4) float32."""
    parts = page.evaluate(READ, lights)
    return [
        np.frombuffer(base64.b64decode(data), np.float32).reshape(height, width, 4)
        for height, width, data in parts
    ]


def shown(page, look="light"):
    """A look of the page's state as encoded values (H, W, 4) in [0, 1], without a background."""
    height, width, data = page.evaluate(
        """(look) => {
            const { viewer } = relight;
            viewer.redraw();
            const { width, height, data } = viewer.engine.readShown(look, { exposure: 0, background: null });
            viewer.redraw();
            let text = "";
            for (let at = 0; at < data.length; at += 30000) {
                text += String.fromCharCode(...data.subarray(at, at + 30000));
            }
            return [height, width, btoa(text)];
        }""",
        look,
    )
    return np.frombuffer(base64.b64decode(data), np.uint8).reshape(height, width, 4) / 255


def drag(page, right, up):
    """Press in the middle of the stage and drag: `right` and `up` in radii of the inner ring."""
    x, y, radius = page.evaluate(
        """() => { const { stage } = relight.viewer, at = stage.element.getBoundingClientRect();
                   return [at.left + stage.middle[0], at.top + stage.middle[1], stage.radius]; }"""
    )
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + right * radius / 2, y - up * radius / 2)
    page.mouse.move(x + right * radius, y - up * radius)
    page.mouse.up()
    settled(page)


def state(page):
    return page.evaluate("relight.viewer.state")


def press(page, *keys):
    for key in keys:
        page.keyboard.press(key)
    settled(page)
