"""Score the colour at the edge of hair: composites over black, white and green, where the truth is known.

Rendered people (examples/person.png and the records of tests/data, or of a folder) get single hairs around
their heads, 0.6 to 1.8 pixels thick. They stand before a wall, a sky and photographs of scikit-image, in 8
bits. The colour is estimated from the photograph and the true matte, or one that is blurred as a network's.
Prints the RMS difference, sRGB-encoded, to the composite with the true matte and colour, where there are
hairs: a mean over black, white and green, and each of them with its mean difference, which is above zero
where the old background shines through and below zero for a dark contour. The last column is the time of a
core for a plate of 800 rows.

OMP_NUM_THREADS=1 PYTHONPATH=.:tests python benchmarks/hair.py [records] [--picture FILE]

Where PyMatting is installed its `estimate_foreground_ml` is shown too. docs/compositing.md has figures to
compare with.
"""

import argparse
import time

import numpy as np
import torch
from mattes import LENS, OVER, ROOT, backgrounds, people
from PIL import Image, ImageDraw
from scipy import ndimage

import relight
from relight.analysis.foreground import Foreground
from relight.matting.refine import encoded_srgb
from relight.media.images import scene_linear

HEAD = 0.16  # of the person's height, from the top
HAIRS = 260
FINE = 4  # samples of a pixel, each way
BLUR = 1.2  # standard deviation of the blurred matte, pixels


def with_hair(person, seed):
    """Return a person (H, W, 4), linear, premultiplied, with hairs around the head, and where these are."""
    random, inside = np.random.default_rng(seed), person[..., 3] > 0.5
    rows = np.nonzero(inside.any(axis=1))[0]
    height = np.ptp(rows)
    edge = inside & ~ndimage.binary_erosion(inside)
    edge[rows[0] + round(HEAD * height) :] = False
    roots = np.argwhere(edge)
    middle = roots.mean(axis=0)
    head = inside.copy()
    head[rows[0] + round(0.4 * HEAD * height) :] = False
    colour = (person[head, :3] / person[head, 3:]).mean(axis=0)
    size = (person.shape[1] * FINE, person.shape[0] * FINE)
    planes = [Image.new("F", size) for _ in range(4)]
    for _ in range(HAIRS):
        root = roots[random.integers(len(roots))]
        angle = np.arctan2(*(root - middle)) + random.normal(0, 0.5)
        curl, length = random.normal(0, 1.2), height * random.uniform(0.02, 0.09)
        along = np.linspace(0, 1, 24)
        turned = angle + curl * along
        path = root[:, None] + np.cumsum([np.sin(turned), np.cos(turned)], axis=1) * length / 24
        points = [(x * FINE, y * FINE) for y, x in path.T]
        width = round(FINE * random.uniform(0.6, 1.8))
        tone = colour * random.uniform(0.4, 2.0)
        for plane, value in zip(planes, (*tone, 1.0), strict=True):
            ImageDraw.Draw(plane).line(points, fill=float(value), width=width, joint="curve")
    fine = np.stack([np.asarray(plane) for plane in planes], axis=-1)
    shape = (person.shape[0], FINE, person.shape[1], FINE, 4)
    hair = ndimage.gaussian_filter(fine.reshape(shape).mean(axis=(1, 3)), (LENS, LENS, 0))
    covered = person + (1 - person[..., 3:]) * hair  # behind the head
    return np.float32(covered), ndimage.binary_dilation(hair[..., 3] > 0.02, iterations=2)


def ours(plate, alpha):
    person, colour = Foreground.of(torch.from_numpy(alpha), torch.from_numpy(alpha), True), plate.copy()
    colour[person.box] = person.own_colour(plate).permute(1, 2, 0).numpy()
    return colour


def pymatting(plate, alpha):
    from pymatting import estimate_foreground_ml

    encoded = encoded_srgb(plate).astype(np.float64)
    return relight.media.colour.decode(
        np.float32(estimate_foreground_ml(encoded, alpha.astype(np.float64))), "sRGB"
    )


def differences(colour, alpha, person, where):
    """Return [(RMS, mean)] of the difference of composites over each colour, sRGB-encoded."""
    found = []
    for behind in np.float32(OVER):
        made = colour * alpha[..., None] + (1 - alpha[..., None]) * behind
        true = person[..., :3] + (1 - person[..., 3:]) * behind
        error = (encoded_srgb(made) - encoded_srgb(true))[where]
        found.append((np.sqrt((error**2).mean()), error.mean()))
    return found


def main(folder, picture):
    methods = {"continued and solved": ours}
    try:
        import pymatting as _  # noqa: F401

        methods["PyMatting"] = pymatting
    except ModuleNotFoundError:
        pass
    scores, seconds, rows = {}, {}, []
    for seed, bald in enumerate(people(folder)):
        person, where = with_hair(bald, seed)
        true = person[..., 3].clip(0, 1)
        blurred = ndimage.gaussian_filter(true, BLUR)
        for behind in backgrounds(true.shape):
            codes = np.round(encoded_srgb(person[..., :3] + (1 - true[..., None]) * behind) * 255)
            plate = scene_linear("image", codes.astype(np.uint8))
            where_soft = where & (true < 0.98)
            for matte, alpha in (("true", true), ("blurred", blurred)):
                for name, method in methods.items():
                    begun = time.process_time()
                    colour = method(plate, alpha)
                    seconds.setdefault(name, []).append(time.process_time() - begun)
                    scores.setdefault((matte, name), []).append(
                        differences(colour, alpha, person, where_soft)
                    )
                    if picture and matte == "true":
                        rows.append(
                            [relight.over(np.dstack([colour * alpha[..., None], alpha]), c) for c in OVER]
                        )
    print("| matte | colour | all | black | white | green | seconds |\n|---|---|---|---|---|---|---|")
    for (matte, name), values in scores.items():
        rms, mean = np.moveaxis(np.mean(values, axis=0), 1, 0)
        each = " | ".join(f"{r:.4f} ({m:+.4f})" for r, m in zip(rms, mean, strict=True))
        print(f"| {matte} | {name} | {rms.mean():.4f} | {each} | {np.median(seconds[name]):.2f} |")
    if picture:
        relight.write(picture, np.concatenate([np.concatenate(row, axis=1) for row in rows[:10]]))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("records", nargs="?", default=ROOT / "tests" / "data")
    parser.add_argument("--picture")
    given = parser.parse_args()
    main(given.records, given.picture)
