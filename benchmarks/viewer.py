"""Measure the viewer. Prints the size of a page, and the frames per second in Chromium's software renderer.

python benchmarks/viewer.py [image]

The person is placed on a plate of 1024 x 1024 pixels. A frame is the work of one drag event: every light is
drawn on the canvas, and the sum is enlarged and shown. Lights are distant and hard, or points in the room.
"""

import sys
import tempfile
from pathlib import Path

from checkout import ROOT
from helpers import browsing

import relight

FRAMES = 10
TIME = """async ([count, frames, near]) => {
    const { viewer } = relight, { gl } = viewer.engine, pixel = new Uint8Array(4);
    const lights = (turn) => Array.from({ length: count }, (_, index) => ({
        name: "", intensity: 1, colour: [1, 1, 1],
        ...(near ? { position: [Math.sin(turn + index), 0.5, Math.cos(turn + index)], radius: 0 }
            : { azimuth: turn + index * 45, elevation: 20, angle: 0 }),
        exposure: 0, temperature: null, locus: "planckian", muted: false, solo: false,
    }));
    const frame = (turn) => {
        viewer.state = { ...viewer.state, lights: lights(turn) };
        viewer.redraw();
        gl.bindFramebuffer(gl.FRAMEBUFFER, null);
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);  // waits until it is drawn
    };
    frame(0);
    const start = performance.now();
    for (let number = 1; number <= frames; number++) frame(number);
    return (performance.now() - start) / frames;
}"""


def main(path):
    plate = relight.place(relight.read(path), (1024, 1024))
    with tempfile.TemporaryDirectory() as folder:
        file = relight.Subject(plate).view(Path(folder) / "person.html", [])
        print(f"page of a 1024 x 1024 subject: {file.stat().st_size / 1e6:.2f} MB")
        with browsing.browser() as browser:
            page = browsing.opened(browser, file)
            for near in (False, True):
                one, eight = (page.evaluate(TIME, [count, FRAMES, near]) for count in (1, 8))
                print(
                    f"1 {'near' if near else 'distant'} light: {1000 / one:.1f} frames a second; "
                    f"8: {1000 / eight:.1f}; ratio {eight / one:.2f}"
                )


if __name__ == "__main__":
    main(*sys.argv[1:] or [ROOT / "examples" / "person.png"])
