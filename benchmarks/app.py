"""Measure `relight app` as its page drives it: from the drop of a photograph to its light, and saving.

python benchmarks/app.py [REPEATS]

Photographs are the bundled person before a soft background, without a matte: JPEG of 12 and 24 megapixels,
and a PNG of 0.4. It drops the one of 12 (read, person found, analysed, and what the page fetches) at once
after the server has started, which is cold, and REPEATS times (2) warm; then it saves PNG and OpenEXR of 0.4
megapixels and a JPEG of 24, before the photograph itself. Prints seconds by the clock, and those of the
processors, which count where the machine is not idle. Aims on two idle cores: 15 s cold and 6 s warm; 3 s for
PNG and OpenEXR; 40 s for the JPEG. It needs the networks of `relight fetch person`.
"""

import io
import json
import os
import sys
import time
import urllib.request

import numpy as np
import psutil
from checkout import ROOT
from helpers.serving import served
from PIL import Image

from relight.matting.people import files as person_files  # before tests/relight is on the path

LOOK = {"lights": ["key:azimuth=-40,elevation=30,angle=20", "rim:azimuth=140,elevation=20"]}


def photograph(height, width, kind):
    """The file of a person before a soft background."""
    cut = Image.open(ROOT / "examples" / "person.png").convert("RGBA")
    tall = round(0.9 * height)
    cut = cut.resize((tall * cut.width // cut.height, tall), Image.Resampling.BILINEAR)
    codes = np.random.default_rng(0).uniform(50, 180, (5, 4, 3)).astype(np.uint8)
    picture = Image.fromarray(codes).resize((width, height), Image.Resampling.BICUBIC)
    picture.paste(cut, ((width - cut.width) // 2, height - tall), cut)
    file = io.BytesIO()
    picture.save(file, kind, quality=92)
    return file.getvalue()


class Page:
    """What the page asks of the server."""

    def __init__(self, address, process):
        self.address, self.process = address, process

    def ask(self, path, data=None):
        """The answer to a request; a task that is refused ends the benchmark."""
        said = urllib.request.urlopen(urllib.request.Request(f"{self.address}{path}", data)).read()
        assert b'"sentence"' not in said[-2000:], said[-2000:]
        return said

    def spent(self):
        """Seconds that the server and its processes have computed."""
        server = psutil.Process(self.process.pid)
        times = [each.cpu_times() for each in (server, *server.children(recursive=True))]
        return sum(each.user + each.system for each in times)

    def measured(self, what, work):
        """Do something, print how long it took, and return what it returns."""
        began, before = time.monotonic(), self.spent()
        found = work()
        print(
            f"{what}: {time.monotonic() - began:.1f} s, of processors {self.spent() - before:.1f} s",
            flush=True,
        )
        return found

    def drop(self, name, data):
        """A photograph that comes in, to its light; its id."""
        one = json.loads(self.ask(f"photographs?name={name}", data))["id"]
        at = f"photographs/{one}"
        self.ask(f"{at}/person", b"{}")
        drawn = {"lasso": None, "strokes": [], "holes": [], "model": True}
        self.ask(f"{at}/analyse", json.dumps({"drawn": drawn}).encode())
        for path in ("scene", "pack", "preview"):
            self.ask(f"{at}/{path}")
        return one

    def save(self, one, suffix):
        """A file of the relit photograph, before itself."""
        asked = {"suffix": suffix, "look": {**LOOK, "background": "original"}}
        said = self.ask(f"photographs/{one}/save", json.dumps(asked).encode())
        name = json.loads(said.splitlines()[-1])["done"]["file"]
        self.ask(f"photographs/{one}/files/{name}")


def main():
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 2
    large, small, huge = (
        photograph(*given) for given in ((4000, 3000, "JPEG"), (745, 537, "PNG"), (5656, 4243, "JPEG"))
    )
    cache = {"RELIGHT_CACHE": str(person_files.folder().parent)}
    print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with served(**cache) as (address, process):
        page = Page(address, process)
        page.measured("12 megapixels, cold", lambda: page.drop("cold.jpg", large))
        for _ in range(repeats):
            page.measured("12 megapixels, warm", lambda: page.drop("warm.jpg", large))
        one = page.drop("small.png", small)
        page.measured(
            "PNG and OpenEXR of 0.4 megapixels", lambda: [page.save(one, kind) for kind in (".png", ".exr")]
        )
        two = page.drop("huge.jpg", huge)
        page.measured("JPEG of 24 megapixels", lambda: page.save(two, ".jpg"))


if __name__ == "__main__":
    main()
