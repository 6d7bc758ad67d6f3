"""The screenshots of these pages: the app and the viewer with the bundled person, in chromium.

python docs/screenshots.py [folder]

Needs the extra `test` and chromium. Writes app.png (docs/app.md) and viewer.png (docs/viewer.md).
"""

import sys
import tempfile
from pathlib import Path

import relight
from relight import Subject

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]  # tests/relight would hide the package if it came first

from helpers import browsing  # noqa: E402
from helpers.serving import LIT, at_step, served, visited  # noqa: E402

PERSON = ROOT / "examples" / "person.png"
KEY = relight.DirectionalLight(azimuth=-40, elevation=30, temperature=4500, angle=12, name="key")
RIM = relight.DirectionalLight(azimuth=140, elevation=20, colour=(0.5, 0.7, 1), name="rim")
COLOURED = """(state) => {
    const [key, fill, rim] = state.lights;
    Object.assign(key, { azimuth: -48, elevation: 34, exposure: 0.35, temperature: 4300 });
    Object.assign(fill, { temperature: 8000 });
    Object.assign(rim, { azimuth: 130, elevation: 20, exposure: 1, colour: [0.35, 0.6, 1] });
    state.background = [0.04, 0.041, 0.05];
}"""
DRAWN = """[...document.querySelectorAll(".preset canvas")].every(
    (one) => one.getContext("2d").getImageData(64, 100, 1, 1).data[3] === 255)"""


def app(browser, path):
    """The light step, with the preset of three lights made warm and blue."""
    with tempfile.TemporaryDirectory() as folder, served("--root", folder) as (address, _):
        page = visited(browser, address, size=(1360, 850), color_scheme="dark")
        page.get_by_role("button", name="Try the example").click()
        at_step(page, "light")
        browsing.wait(page, LIT, 120)
        page.locator("[data-preset=three-point]").click()
        page.evaluate(f"relightApp.parts.light.viewer.change({COLOURED})")
        browsing.wait(page, DRAWN, 120)
        page.screenshot(path=path)


def viewer(browser, path):
    """The viewer's page while the key light is dragged."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "person.html"
        subject = Subject(relight.read(PERSON))
        subject.view(file, [KEY, RIM], background=(0.02, 0.022, 0.027), title=PERSON.name)
        page = browsing.opened(browser, file, size=(1280, 800), color_scheme="dark", reduced_motion="reduce")
        browsing.drag(page, -0.61, 0.53, release=False)
        page.screenshot(path=path)


def main(folder):
    with browsing.browser() as browser:
        app(browser, folder / "app.png")
        viewer(browser, folder / "viewer.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).parent)
