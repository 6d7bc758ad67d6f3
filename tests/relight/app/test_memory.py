"""The application is about as large after many photographs as after some."""

import io
import subprocess
import sys
import urllib.request
from urllib.parse import urlsplit

import numpy as np
import pytest
from helpers.clothed import clothed
from helpers.serving import served
from PIL import Image

pytest.importorskip("starlette")


def resident(process):
    """The memory of a process and its children in MB, as Linux counts it."""
    children = subprocess.run(["ps", "-o", "pid=", "--ppid", str(process)], capture_output=True, text=True)
    numbers = [process, *map(int, children.stdout.split())]
    pages = 0
    for number in numbers:
        with open(f"/proc/{number}/statm") as file:
            pages += int(file.read().split()[1])
    return pages * 4096 / 1e6


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="has no /proc")
def test_a_hundred_photographs_take_the_memory_of_twenty_five():
    plate, matte = clothed(seed=1)
    picture = Image.fromarray(np.uint8(255 * np.clip(np.dstack([plate[..., :3], matte]), 0, 1)))
    body = io.BytesIO()
    picture.resize((picture.width * 3, picture.height * 3)).save(body, "PNG")
    sizes = {}
    with served() as (address, process):
        origin = "{}://{}".format(*urlsplit(address)[:2])
        for done in range(1, 101):
            post = urllib.request.Request(
                f"{address}photographs?name={done}.png", body.getvalue(), {"Origin": origin}, method="POST"
            )
            with urllib.request.urlopen(post, timeout=120) as answer:
                assert answer.status == 200
            sizes[done] = resident(process.pid)
    assert sizes[25] > 200
    assert sizes[100] < 1.1 * sizes[25]
