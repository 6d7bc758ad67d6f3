"""Measure what each kind of light costs. Prints ratios of times from one run, which are comparable between
machines. Times are processor time of one thread, so that a busy machine does not change them.

python benchmarks/lights.py [image] [mask]

Figures to compare with are in README.md.
"""

import sys
from functools import partial
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import torch
from timing import quickest

import relight
from shadow import inputs, visibility
from shadow.directions import olat
from shadow.framing import Framing

REPEATS = 7
PLATES = ((512, 512), (1080, 1920), (2160, 3840))


def on_plate(image, height, width):
    """The person (H, W, 4) in the middle of a transparent plate, as high as the plate."""
    columns = round(image.shape[1] * height / image.shape[0])
    fitted = oiio.ImageBufAlgo.resize(oiio.ImageBuf(image), roi=oiio.ROI(0, columns, 0, height))
    plate = np.zeros((height, width, 4), np.float32)
    left = (width - columns) // 2
    plate[:, left : left + columns] = fitted.get_pixels("float").clip(0)
    plate[..., 3] = plate[..., 3].clip(0, 1)
    return plate


def main(path, mask=None):
    image = relight.read(path)
    alpha = image[..., 3] if mask is None else relight.read_mask(mask)
    matte = inputs.mask("mask", alpha, image.shape[:2])

    field = visibility.load()
    framing = Framing.around(matte, field.size)
    rgb = framing.crop(torch.from_numpy(image[..., :3].copy()).permute(2, 0, 1))
    framed_mask = framing.crop(matte[None])[0]
    lights = torch.from_numpy(olat())

    one, all_lights = (
        quickest(lambda chosen=chosen: field.analyse(rgb, framed_mask)[1](chosen), REPEATS)
        for chosen in (lights[:1], lights)
    )
    print(
        f"1 visibility map: {one:.3f} s; {len(lights)} maps: {all_lights:.3f} s; ratio {all_lights / one:.2f}"
    )

    matted = np.concatenate([image[..., :3] * alpha[..., None], alpha[..., None]], axis=-1)
    matted = image if mask is None else matted
    light = relight.DirectionalLight(azimuth=-40, elevation=30)
    for height, width in PLATES:
        plate = on_plate(matted, height, width)
        subject = relight.Subject(plate)
        analysis = quickest(partial(relight.Subject, plate), REPEATS)
        relit = quickest(partial(subject.relit, light), REPEATS)
        share = f"1/{analysis / relit:.0f}"
        print(f"{width} x {height}: analysis {analysis:.3f} s; a new light {relit:.4f} s, {share} of it")


if __name__ == "__main__":
    torch.set_num_threads(1)
    main(*sys.argv[1:] or [Path(__file__).parents[1] / "examples" / "person.png"])
