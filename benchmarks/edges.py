"""Compare three methods that estimate a person's colour at soft edges, over five known backgrounds.

The person (examples/person.png) is slightly blurred, so that the colour and coverage of every pixel are
known, and is composited over each background. Each method estimates the person's colour from the photograph
and the true matte. Prints the errors where the matte is between 0.05 and 0.95.

OMP_NUM_THREADS=1 python benchmarks/edges.py [picture.png]

Figures to compare with are in docs/compositing.md; lower errors are better.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import gaussian_filter

import relight
from relight.analysis.foreground import Foreground
from relight.matting.refine import pymatting

PERSON = Path(__file__).parent.parent / "examples" / "person.png"
BLUR = 2.0  # standard deviation, pixels
BAND = (0.05, 0.95)


def backgrounds(size):
    """{name: (H, W, 3)}, linear."""
    y = np.mgrid[: size[0], : size[1]][0]
    noise = np.random.default_rng(0).random((*size, 3))
    textured = gaussian_filter(noise, (6, 6, 0))
    textured = (textured - textured.min()) / np.ptp(textured)
    flat = {"white": (0.9, 0.9, 0.9), "black": (0.01, 0.01, 0.01), "green": (0.1, 0.5, 0.1)}
    pictures = {name: np.broadcast_to(np.float32(value), (*size, 3)) for name, value in flat.items()}
    pictures["sky and ground"] = np.where((y < size[0] / 2)[..., None], (0.3, 0.5, 0.9), (0.2, 0.15, 0.1))
    pictures["texture"] = textured
    return {name: np.float32(picture) for name, picture in pictures.items()}


def estimates(plate, alpha):
    """{means: (H, W, 3)} of the person's own colour."""
    estimated = pymatting("foreground.estimate_foreground_ml")(plate, alpha).clip(0)
    estimated = np.where(alpha[..., None] >= 1, plate, estimated)
    person = Foreground.of(torch.from_numpy(alpha), torch.from_numpy(alpha), True)
    continued = np.zeros_like(plate)
    continued[person.box] = person.own_colour(plate).permute(1, 2, 0).numpy()
    scale = 1 / np.maximum(alpha, 1e-6)[..., None]
    return {"plain division": plate * scale, "continued": continued, "estimated": estimated}


def main(picture=None):
    straight = relight.read(PERSON)
    soft = gaussian_filter(straight, (BLUR, BLUR, 0))
    alpha = np.ascontiguousarray(soft[..., 3]).clip(0, 1)
    band = (alpha > BAND[0]) & (alpha < BAND[1])
    own = soft[..., :3] / np.maximum(alpha, 1e-6)[..., None]
    print(f"{PERSON.name}, {band.sum()} pixels with {BAND[0]} < alpha < {BAND[1]}; RMSE, linear\n")
    print("| before | plain division | continued from inside | foreground estimation |\n|---|---|---|---|")
    rows, pictures = [], []
    for name, behind in backgrounds(alpha.shape).items():
        plate = np.float32(soft[..., :3] + (1 - alpha[..., None]) * behind)
        found = estimates(plate, alpha)
        rows.append([np.sqrt(((value - own)[band] ** 2).mean()) for value in found.values()])
        print(f"| {name} | " + " | ".join(f"{value:.3f}" for value in rows[-1]) + " |")
        over = [np.concatenate([c * alpha[..., None], alpha[..., None]], -1) for c in found.values()]
        pictures.append(np.concatenate([plate, *(relight.over(np.float32(o), (0.18,) * 3) for o in over)], 1))
    print("| mean | " + " | ".join(f"{value:.3f}" for value in np.mean(rows, axis=0)) + " |")
    if picture:
        relight.write(picture, np.concatenate(pictures).clip(0, 1))


if __name__ == "__main__":
    main(*sys.argv[1:])
