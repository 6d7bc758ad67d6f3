"""Score composites with mattes of outlines and rough masks, in the 3 pixels on either side of the true edge.

Rendered people (examples/person.png and the records of tests/data, or of a folder) stand before a wall, a sky
and photographs of scikit-image, in 8 bits. Their mattes are found from a line of 24 corners, from soft masks
of 256 x 256 pixels, from hard ones of that size, which have steps, and from dilated and eroded masks. Prints
the RMS difference, sRGB-encoded, to the composite with the true matte and colour, a mean over black, white
and green; and that with the true colour.
The last rows are of a true matte that `Subject(feather=)` feathers, against the true colour, continued beyond
the edge, with the feathered matte.

OMP_NUM_THREADS=1 PYTHONPATH=.:tests python benchmarks/mattes.py [records]
"""

import sys
from pathlib import Path

import numpy as np
import torch
from helpers.drawn import polygon
from scipy import ndimage
from skimage import data

import relight
from relight.analysis.foreground import Foreground
from relight.matting.outline.drawing import Outline, outlined, refine, refine_matte
from relight.matting.refine import encoded_srgb
from relight.media.images import scene_linear
from relight.media.resampling import resize
from shadow.data import photographs
from shadow.data.records import Records

ROOT = Path(__file__).parent.parent
HEIGHT = 800  # pixels of the plate
LENS = 0.6  # standard deviation of the blur, pixels
MARGIN = 0.04  # of the frame's height, beside the person
BAND = 3  # pixels on either side of the edge
OFF = 0.008  # of the height: how far a mask is dilated or eroded
FEATHERS = (1, 2, 4)  # standard deviations, pixels
OVER = ((0, 0, 0), (1, 1, 1), (0.05, 0.5, 0.05))


def people(folder):
    """Yield (H, W, 4), linear, premultiplied."""
    yield framed(relight.read(ROOT / "examples" / "person.png"))
    for seed, record in enumerate(Records([folder])):
        weights = np.random.default_rng(seed).gamma(0.5, size=(len(record.directions), 1))
        colour = photographs.light(record, np.float32(weights * np.ones(3)))
        colour = (colour * (0.2 / colour.mean())).clip(0, 1)
        covered = np.ones((len(colour), 1), np.float32)
        yield framed(record.image(np.concatenate([colour, covered], 1)).permute(1, 2, 0).numpy())


def framed(person):
    margin = round(MARGIN * len(person))
    person = np.pad(person, ((margin, margin), (margin, margin), (0, 0)))
    size = (HEIGHT, round(HEIGHT * person.shape[1] / person.shape[0]))
    return ndimage.gaussian_filter(resize(person, size, "triangle"), (LENS, LENS, 0))


def backgrounds(size):
    """Yield (H, W, 3), linear."""
    y, x = np.mgrid[: size[0], : size[1]] / max(size)
    noise = np.random.default_rng(0).normal(1, 0.01, (*size, 1))
    yield (0.75 - 0.25 * x)[..., None] * np.ones(3) * noise
    yield np.where((y < 0.75)[..., None], (0.35, 0.55, 0.9), (0.2, 0.17, 0.12)) * noise
    empty = np.zeros((*size, 4), np.float32)
    for picture in (data.coffee(), data.chelsea(), data.brick()[..., None].repeat(3, -1)):
        yield relight.over(empty, scene_linear("background", picture))


def mattes(codes, true, seed):
    """Yield names and mattes (H, W)."""
    steps = round(OFF * np.ptp(np.nonzero(true > 0.5)[0]))
    small = ndimage.gaussian_filter(resize(true[..., None], (256, 256), "triangle"), (1.2, 1.2, 0))
    rough = {
        "soft mask of 256 x 256": resize(small, true.shape, "triangle")[..., 0].clip(0, 1),
        "hard mask of 256 x 256": np.float32(enlarged(small[..., 0] > 0.5, true.shape)),
        "dilated mask": np.float32(ndimage.binary_dilation(true > 0.5, iterations=steps)),
        "eroded mask": np.float32(ndimage.binary_erosion(true > 0.5, iterations=steps)),
    }
    yield "true matte", true
    yield "outline of 24 corners", refine(codes, outlined(codes, Outline(polygon(true, seed))))
    linear = scene_linear("image", codes)
    for name, mask in rough.items():
        yield f"{name}, `refine`", refine(codes, outlined(codes, Outline(matte=mask)))
        yield f"{name}, `refine_matte`", refine_matte(linear, mask, 24)


def enlarged(mask, size):
    """Enlarge a mask (h, w) by nearest neighbours."""
    rows, columns = (
        np.arange(length) * side // length for length, side in zip(size, mask.shape, strict=True)
    )
    return mask[rows[:, None], columns]


def feathered(plate, true, own):
    """Yield names and RMS differences of composites with feathered mattes, where these are soft."""
    nearest = ndimage.distance_transform_edt(true <= 0.5, return_distances=False, return_indices=True)
    own = np.where(true[..., None] > 0.5, own, own[tuple(nearest)])
    edge = torch.from_numpy(true)
    for sigma in FEATHERS:
        alpha = ndimage.gaussian_filter(true, sigma, mode="nearest")
        cut, colour = Foreground.of(torch.from_numpy(alpha), edge, True, edge), np.zeros_like(plate)
        colour[cut.box] = cut.own_colour(plate).permute(1, 2, 0).numpy()
        soft = (alpha > 0.02) & (alpha < 0.98)
        yield f"true matte, feathered by {sigma}", difference(colour, alpha, own, alpha, soft)


def difference(colour, alpha, own, true, band):
    """Return the RMS difference of composites."""
    alpha, true = alpha[..., None], true[..., None]
    found = [
        (encoded_srgb(colour * alpha + (1 - alpha) * behind) - encoded_srgb(own * true + (1 - true) * behind))
        for behind in np.float32(OVER)
    ]
    return np.mean([np.sqrt((error[band] ** 2).mean()) for error in found])


def main(folder=ROOT / "tests" / "data"):
    scores = {}
    for seed, person in enumerate(people(folder)):
        true = np.ascontiguousarray(person[..., 3]).clip(0, 1)
        own = person[..., :3] / np.maximum(true, 1e-4)[..., None]
        inside = true > 0.5
        depth = np.maximum(*(ndimage.distance_transform_edt(side) for side in (inside, ~inside)))
        for behind in backgrounds(true.shape):
            seen = np.float32(person[..., :3] + (1 - true[..., None]) * behind)
            codes = np.round(encoded_srgb(seen) * 255).astype(np.uint8)
            plate = scene_linear("image", codes)
            for name, matte in mattes(codes, true, seed):
                alpha = torch.from_numpy(matte)
                cut = Foreground.of(alpha, alpha, True)
                colour = np.zeros_like(plate)
                colour[cut.box] = cut.own_colour(plate).permute(1, 2, 0).numpy()
                scores.setdefault(name, []).append(
                    [difference(shown, matte, own, true, depth <= BAND) for shown in (colour, own)]
                )
            for name, error in feathered(plate, true, own):
                scores.setdefault(name, []).append([error, 0])
    print("| matte | RMS | with the true colour |\n|---|---|---|")
    for name, values in scores.items():
        print(f"| {name} | " + " | ".join(f"{value:.4f}" for value in np.mean(values, axis=0)) + " |")


if __name__ == "__main__":
    main(*sys.argv[1:])
