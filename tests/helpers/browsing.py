"""Pages of the viewer in a real browser: Debian's chromium, without a screen, WebGL 2 in software.

Every page is under a Content-Security-Policy that allows nothing but what is in the file itself.
"""

import base64
import shutil
import time
from contextlib import contextmanager

import numpy as np
import pytest

POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'"
HOSTILE = "<script>window.hostile = 1</script><img src=x onerror='window.hostile = 1'>"
FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
)
OWN = ("file:", "blob:")  # what a page may ask for: itself, and what it made
READ = """async ([lights, gloss]) => {
    const parts = [];
    for (const light of lights) {
        const { width, height, data } = await relight.render([light].flat(), gloss);
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


NEEDS_CHROMIUM = pytest.mark.skipif(chromium() is None, reason="no chromium: apt-get install chromium")


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


DROP = """async ([where, name, width, colour]) => {
    const canvas = Object.assign(document.createElement("canvas"), { width, height: 16 });
    const context = canvas.getContext("2d");
    context.fillRect(0, 0, width, 16); // black: a map of one lamp is drawn at once
    context.fillStyle = colour;
    context.fillRect(0, 0, 1, 1);
    const png = await new Promise((done) => canvas.toBlob(done));
    const dataTransfer = new DataTransfer();
    dataTransfer.items.add(new File([png], name));
    document.querySelector(where).dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true }));
}"""
MOVING = """() => {
    const parts = [...document.querySelectorAll("*")].flatMap((one) =>
        ["", "::before", "::after"].map((part) => ({ one, part, style: getComputedStyle(one, part) })));
    return parts.filter(({ style }) => style.transitionDuration !== "0s" || style.animationName !== "none")
        .map(({ one, part }) => `${one.tagName} ${one.className}${part}`);
}"""


def opened(browser, path, fragment="", size=(1100, 760), ready=True, before=None, **options):
    """A page in a new window. Its `complaints` are what it logged, and what it asked the network for.

    `options` are those of playwright's `Browser.new_context`.
    """
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **options)
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


def begun(page):
    """Return the page's state as it is now, which `reset` brings back."""
    return page.evaluate("relight.viewer.state")


def reset(page, state):
    """Bring a page back to a state that it began with: without files, history, messages or dialogues."""
    page.evaluate(
        """(state) => {
            const { viewer } = relight;
            viewer.stop();
            viewer.maps.length = viewer.pictures.length = 1;
            viewer.bare = viewer.held = false;
            viewer.past = [];
            viewer.future = [];
            viewer.state = state;
            viewer.stage.message.replaceChildren();
            viewer.controls.openMenu(false);
            for (const sheet of document.querySelectorAll("dialog[open]")) sheet.close();
            document.activeElement?.blur();
            viewer.refresh();
        }""",
        state,
    )
    settled(page)


def wait(page, condition, seconds=60):
    """Waits until an expression is true. (`Page.wait_for_function` needs a policy that allows `eval`.)"""
    end = time.monotonic() + seconds
    while not page.evaluate(condition):
        assert time.monotonic() < end, f"{condition}: not within {seconds} s; {page.complaints}"
        time.sleep(0.05)


def settled(page):
    """Waits until the page shows its state."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def rendered(page, lights, gloss=0):
    """What `relight.render` hands back for each light, or list of lights: (H, W, 4) float32."""
    parts = page.evaluate(READ, [lights, gloss])
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


def drag(page, right, up, release=True):
    """Press in the middle of the stage and drag: `right` and `up` in radii of the inner ring."""
    x, y, radius = page.evaluate(
        """() => { const { stage } = relight.viewer, at = stage.element.getBoundingClientRect();
                   return [at.left + stage.middle[0], at.top + stage.middle[1], stage.radius]; }"""
    )
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + right * radius / 2, y - up * radius / 2)
    page.mouse.move(x + right * radius, y - up * radius)
    if release:
        page.mouse.up()
    settled(page)


def dropped(page, where, name, width=32, colour="#888"):
    """Drop a picture of one light pixel on a part of the page, and wait until the page has it."""
    count = page.evaluate("relight.viewer.maps.length + relight.viewer.pictures.length")
    page.evaluate(DROP, [where, name, width, colour])
    wait(page, f"relight.viewer.maps.length + relight.viewer.pictures.length > {count}")
    settled(page)


LOW_CONTRAST = """() => {
    const channels = (text) => text.match(/[\\d.]+/g).map(Number);
    const linear = (code) => ((code /= 255) <= 0.04045 ? code / 12.92 : ((code + 0.055) / 1.055) ** 2.4);
    const luminance = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
    const over = (top, below) => {
        const alpha = top[3] ?? 1;
        return below.map((value, at) => top[at] * alpha + value * (1 - alpha));
    };
    const behind = (element) => {
        if (!element) return [255, 255, 255];
        const own = channels(getComputedStyle(element).backgroundColor);
        return (own[3] ?? 1) === 1 ? own.slice(0, 3) : over(own, behind(element.parentElement));
    };
    const found = [];
    for (const element of document.querySelectorAll("body *")) {
        const texts = [...element.childNodes].filter((node) => node.nodeType === 3 && node.data.trim());
        const typed = element.matches("input[type=text], select");
        if (!(texts.length || typed) || element.closest(":disabled, script, style, noscript")) continue;
        if (!element.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
        const below = behind(element);
        const colour = over(channels(getComputedStyle(element).color), below);
        const [low, high] = [luminance(below), luminance(colour)].sort((a, b) => a - b);
        const contrast = (high + 0.05) / (low + 0.05);
        const name = `${element.tagName} ${element.className} ${element.textContent.trim().slice(0, 30)}`;
        if (contrast < 4.5) found.push(`${name}: ${contrast.toFixed(2)}`);
    }
    return found;
}"""


def low_contrast(page):
    """Return the visible texts of a page whose contrast is below 4.5:1 (WCAG 2.2, 1.4.3)."""
    return page.evaluate(LOW_CONTRAST)


def moving(page):
    """Return what has a transition or an animation, pseudo-elements included."""
    return page.evaluate(MOVING)


def state(page):
    return page.evaluate("relight.viewer.state")


def press(page, *keys):
    for key in keys:
        page.keyboard.press(key)
    settled(page)
