"""Measure how often the app draws while a light is dragged, in Chromium with WebGL in software.

python benchmarks/drag.py [PHOTOGRAPH]

Prints the milliseconds of the page's first frames, and the frames a second of a drag of four seconds: as the
page draws it there, and at full resolution. The photograph needs alpha; by default it is the bundled person.
"""

import sys
import time

from checkout import ROOT
from helpers import browsing
from helpers.serving import LIT, at_step, chosen, served, visited

VIEWER = "relightApp.parts.light.viewer"
DRAG = f"""async (coarse) => {{
    const viewer = {VIEWER};
    const {{ engine }} = coarse ? viewer.draft : viewer;
    const begin = performance.now();
    let frames = 0;
    for (; performance.now() - begin < 4000; frames++) {{
        viewer.change((state) => (state.lights[0].azimuth -= 1), "drag");
        await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
        if (!coarse) viewer.redraw();
        engine.finish();
    }}
    viewer.endGesture();
    return (1000 * frames) / (performance.now() - begin);
}}"""


def main(photograph):
    with served() as (address, _), browsing.browser() as browser:
        page = visited(browser, address, size=(1440, 757))
        chosen(page, photograph)
        at_step(page, "light")
        browsing.wait(page, LIT, 240)
        while len(page.evaluate(f"{VIEWER}.timed")) < 3:
            page.evaluate(f"{VIEWER}.change((state) => (state.lights[0].azimuth += 1))")
            time.sleep(3)
        print("first frames, ms:", *map(round, page.evaluate(f"{VIEWER}.timed")))
        time.sleep(20)  # until the presets' pictures are drawn
        if page.evaluate(f"Boolean({VIEWER}.draft)"):
            print(f"dragging, coarse: {page.evaluate(DRAG, True):.1f} frames a second")
        print(f"at full resolution: {page.evaluate(DRAG, False):.2f} frames a second")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else ROOT / "examples" / "person.png")
