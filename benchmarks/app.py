"""Measure `relight app` from the drop of a 12-megapixel photograph to its light: what the server computes.

python benchmarks/app.py [REPEATS]

It posts a JPEG of 3000 x 4000 pixels, outlines the person by 24 corners, and has them analysed, as the page
does. Prints, for each repeat, the seconds of each step by the clock, and those of the processors in all. The
photograph is the bundled person before a soft background. The server stands idle for 12 s before the first
photograph, as while a user looks for a file. The aim is 6 s for the three steps on two cores.
"""

import io
import json
import sys
import time
import urllib.request
from pathlib import Path

import numpy as np
import psutil
from PIL import Image
from scipy.ndimage import zoom

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))
from helpers.drawn import polygon  # noqa: E402
from helpers.serving import served  # noqa: E402

HEIGHT, WIDTH = 4000, 3000


def photograph():
    """A JPEG of a person before a soft background, and a line around them as shares of width and height."""
    person = np.asarray(Image.open(ROOT / "examples" / "person.png").convert("RGBA"), np.float32) / 255
    scale = 0.9 * HEIGHT / person.shape[0]
    person = zoom(person, (scale, scale, 1), order=1)
    plate = zoom(np.random.default_rng(0).uniform(0.2, 0.7, (5, 4, 3)), (HEIGHT / 5, WIDTH / 4, 1), order=1)
    top, left = HEIGHT - person.shape[0], (WIDTH - person.shape[1]) // 2
    matte = np.zeros((HEIGHT, WIDTH), np.float32)
    matte[top:, left : left + person.shape[1]] = person[..., 3]
    there = plate[top:, left : left + person.shape[1]]
    there += (person[..., :3] - there) * person[..., 3:]
    file = io.BytesIO()
    Image.fromarray(np.round(plate * 255).astype(np.uint8)).save(file, "JPEG", quality=92)
    return file.getvalue(), (polygon(matte[::4, ::4], 0) * 4 / (WIDTH, HEIGHT)).tolist()


def post(address, data):
    """The answer to a request; raises urllib.error.HTTPError where it is refused."""
    return urllib.request.urlopen(urllib.request.Request(address, data)).read()


def processor(process):
    """Seconds that a process and its children have computed."""
    family = [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]
    return sum(each.cpu_times().user + each.cpu_times().system for each in family)


def main():
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    jpeg, lasso = photograph()
    with served() as (address, process):
        time.sleep(12)
        for _ in range(repeats):
            drawn = {"lasso": lasso, "strokes": [], "model": False}
            row = []

            def step(path, data, row=row):
                began, spent = time.monotonic(), processor(process)
                answer = post(f"{address}{path}", data)
                row += [time.monotonic() - began, processor(process) - spent]
                return answer

            one = json.loads(step("photographs?name=a.jpg", jpeg))["id"]
            step(f"photographs/{one}/outline", json.dumps(drawn).encode())
            said = step(f"photographs/{one}/analyse", json.dumps({"drawn": drawn}).encode())
            assert b'"photograph"' in said, said
            clock, spent = row[::2], row[1::2]
            print(
                "read {:.1f} s, outline {:.1f} s, analyse {:.1f} s".format(*clock)
                + f"; {sum(clock):.1f} s in all, of processors {sum(spent):.1f} s"
            )


if __name__ == "__main__":
    main()
