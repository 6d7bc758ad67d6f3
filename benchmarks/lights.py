"""What lights cost: ratios measured within one run, so that they hold on any machine.

python benchmarks/lights.py [image] [mask]
"""

import sys
import time
from pathlib import Path

import torch

import relight
from shadow import inputs, normals, visibility
from shadow.directions import olat
from shadow.framing import Framing

REPEATS = 7


def seconds(function):
    """The quickest of several calls: the one that the machine disturbed least."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def main(path, mask=None):
    image = relight.read(path)
    alpha = image[..., 3] if mask is None else relight.read_mask(mask)
    matte = inputs.mask("mask", alpha, image.shape[:2])

    field, surface = visibility.load(), normals.load()
    framing = Framing.around(matte, field.size)
    rgb = framing.crop(torch.from_numpy(image[..., :3].copy()).permute(2, 0, 1))
    framed_mask = framing.crop(matte[None])[0]
    framed_normals = surface.analyse(rgb, framed_mask)
    lights = torch.from_numpy(olat())

    one = seconds(lambda: field.analyse(rgb, framed_mask, framed_normals)(lights[:1]))
    all_lights = seconds(lambda: field.analyse(rgb, framed_mask, framed_normals)(lights))
    print(
        f"1 visibility map: {one:.3f} s; {len(lights)} maps: {all_lights:.3f} s; ratio {all_lights / one:.2f}"
    )

    subject = relight.Subject(image, alpha)
    analysis = seconds(lambda: relight.Subject(image, alpha))
    light = seconds(lambda: subject.relit(relight.DirectionalLight(azimuth=-40, elevation=30)))
    size = f"{image.shape[1]} x {image.shape[0]}"
    print(f"{size}: analysis {analysis:.3f} s; a new light {light:.3f} s; ratio {light / analysis:.3f}")


if __name__ == "__main__":
    main(*sys.argv[1:] or [Path(__file__).parents[1] / "examples" / "person.png"])
