"""Measure how much real clips flicker: each frame by itself, and as a shot, which is filtered over time.

    python benchmarks/flicker_real.py CLIP... [--frames 12] [--start 0]

Extras `auto` and `video`, with the networks of `relight fetch`. The clips are the reader's own: movies, or
image sequences such as plate.%04d.png. Each map of a frame is compared with the mean of those of the frames
before and after it, moved along the optical flow of the plates, at pixels that all three frames show:

    visibility     mean absolute difference inside the person under seven directions, of 255
    normals        mean angle inside the person, in degrees
    picture        flicker of the person lit from the side over that of the plate, relative to brightness
    matte          mean absolute difference in the band of its edge, of 255
    detail         gradient of the picture as a shot over that of each frame by itself

Smaller is steadier. What truly moves changes its shadows too, so that no figure can become zero.
"""

import argparse
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from scipy import ndimage

import relight
from relight.media import colour
from relight.media.optical_flow import Motion, motion
from relight.pipeline.shot import Shot

AROUND = (-70, 30), (70, 30), (0, 70), (-30, 15), (30, 15), (-120, 15), (120, 15)  # azimuth, elevation
DIRECTIONS = np.float32([relight.DirectionalLight(azimuth=a, elevation=e).samples()[0][0] for a, e in AROUND])
SIDE = relight.DirectionalLight(azimuth=-70, elevation=20, intensity=2)
AGREED = 0.6  # certainty of a motion at which the way back misses by a pixel
INSET = 2  # pixels from the matte's edge inward


class Maps(NamedTuple):
    """What is compared of one frame: (C, H, W) each."""

    visibility: torch.Tensor
    normals: torch.Tensor
    picture: torch.Tensor
    matte: torch.Tensor


def maps_of(subject):
    layers = (
        subject.visibility(DIRECTIONS),
        subject.normals,
        subject.relit(SIDE)[..., :3],
        subject.matte[..., None],
    )
    first, *others = (torch.from_numpy(np.ascontiguousarray(layer, np.float32)) for layer in layers)
    return Maps(first, *(other.permute(2, 0, 1) for other in others))


def mean_around(name, ways, before, after):
    """A map of the frames before and after, moved onto the frame between them."""
    return sum(way.moved(getattr(maps, name)) for way, maps in zip(ways, (before, after), strict=True)) / 2


def flicker(ways, plates, before, maps, after):
    """The five figures of one frame but for the detail; None where its neighbours do not show the person."""
    agreed = torch.cat([way.certainty > AGREED for way in ways]).all(dim=0)
    inside = torch.from_numpy(ndimage.binary_erosion(maps.matte[0].numpy() > 0.99, iterations=INSET)) & agreed
    for way, other in zip(ways, (before, after), strict=True):
        inside &= way.moved(other.matte)[0] > 0.99
    soft = ndimage.binary_dilation((maps.matte[0].numpy() > 0.02) & (maps.matte[0].numpy() < 0.98))
    band = torch.from_numpy(soft) & agreed
    if inside.sum() < 50 or band.sum() < 50:
        return None
    visibility = (maps.visibility - mean_around("visibility", ways, before, after)).abs()[:, inside].mean()
    mean = torch.nn.functional.normalize(mean_around("normals", ways, before, after), dim=0)
    angle = (mean * maps.normals).sum(dim=0).clamp(-1, 1)[inside].arccos().rad2deg().mean()
    relit = (maps.picture - mean_around("picture", ways, before, after)).abs()[:, inside].mean()
    moved = sum(way.moved(plate) for way, plate in zip(ways, (plates[0], plates[2]), strict=True)) / 2
    input_change = (plates[1] - moved).abs()[:, inside].mean() / plates[1][:, inside].mean()
    picture = relit / maps.picture[:, inside].mean() / input_change
    matte = (maps.matte - mean_around("matte", ways, before, after)).abs()[:, band].mean()
    return [255 * float(visibility), float(angle), float(picture), 255 * float(matte)]


def gradient(maps):
    inside = maps.matte[0] > 0.99
    return sum(
        float(each.abs().mean(dim=0)[inside].mean()) for each in torch.gradient(maps.picture, dim=(1, 2))
    )


def scores(clip, frames, start):
    """Figures (2, 4) of each frame by itself and as a shot, and the detail of the shot."""
    shot = Shot(relight.Source(clip, matte="auto"))
    numbers = list(shot.numbers)[start : start + frames]
    alone, filtered, plates = [], [], []
    for number in numbers:
        plate = shot.frame(number).plate[..., :3]
        alone.append(maps_of(relight.Subject(plate, relight.matte(plate, "auto"))))
        filtered.append(maps_of(shot.person(number)))
        plates.append(torch.from_numpy(plate).permute(2, 0, 1))
    ways: dict[tuple[int, int], Motion] = {}
    codes = [
        torch.from_numpy(np.float32(colour.encode(plate.permute(1, 2, 0).numpy()))).permute(2, 0, 1)
        for plate in plates
    ]
    rows: list[list[list[float]]] = [[], []]
    for t in range(1, len(numbers) - 1):
        ways = [motion(codes[t], codes[other]) for other in (t - 1, t + 1)]
        for row, maps in zip(rows, (alone, filtered), strict=True):
            if (found := flicker(ways, plates[t - 1 : t + 2], *maps[t - 1 : t + 2])) is not None:
                row.append(found)
    detail = np.mean(
        [gradient(after) / gradient(before) for before, after in zip(alone, filtered, strict=True)]
    )
    return np.array([np.mean(row, axis=0) for row in rows]), float(detail)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("clips", nargs="+", metavar="CLIP")
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--start", type=int, default=0, help="place of the first frame in the clip")
    given = parser.parse_args()
    torch.set_num_threads(1)
    warnings.simplefilter("ignore")
    table = []
    print(f"{'':24s} {'visibility':>12s} {'normals':>12s} {'picture':>12s} {'matte':>12s}  detail")
    for clip in given.clips:
        figures, detail = scores(clip, given.frames, given.start)
        table.append(figures)
        pairs = " ".join(f"{before:5.2f} {after:6.2f}" for before, after in figures.T)
        print(f"{Path(clip).name:24s} {pairs}  {detail:.3f}", flush=True)
    pairs = " ".join(f"{before:5.2f} {after:6.2f}" for before, after in np.mean(table, axis=0).T)
    print(f"{'mean':24s} {pairs}")


if __name__ == "__main__":
    main()
