"""A light that sweeps the frontal hemisphere from right to left, at several elevations (Section 4.4).

python examples/moving_light.py [movie] [--seed 13] [--size 512] [--step 2]

Side by side: path-traced truth, inferred visibility, inferred shading, and the person relit. The person is a
body of the generalisation split, photographed on the virtual stage; needs the extra `stage`. Prints how much
neighbouring frames differ, which is what shows as flicker, beside how much the truth's do.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

import relight
from relight.media.movies import write_movie
from shadow import directions
from shadow.data import lightings, photographs
from shadow.installing import install_command

try:
    from shadow.lightstage import stage
    from shadow.lightstage.people.generate import bodies
except ModuleNotFoundError as error:
    sys.exit(f"needs {error.name}; install it with: {install_command('stage')}")

ELEVATIONS = (0, 25, 50)

parser = argparse.ArgumentParser()
parser.add_argument("movie", nargs="?", type=Path, default=Path("moving_light.mp4"))
parser.add_argument("--seed", type=int, default=13)
parser.add_argument("--size", type=int, default=512, help="pixels of a picture's side")
parser.add_argument("--step", type=float, default=2.0, help="degrees from frame to frame")
options = parser.parse_args()

frames = round(180 / options.step) + 1
azimuths = np.linspace(90, -90, frames)  # from image right to image left
lights = np.concatenate([directions.from_spherical(azimuths, elevation) for elevation in ELEVATIONS])
figure = bodies.body(options.seed, "generalisation")
view = stage.View(azimuth=8, distance=3.5, height=1.2, pitch=-5, fov=34)

# The photograph: a large softbox and a pale room.
olat = directions.olat(behind=True)
record = stage.render(figure, view, options.size, olat)
weights = np.full((len(olat), 3), 0.6 / len(olat), np.float32)
weights += 1.2 * lightings.softbox(olat)[:, None]
photograph = np.concatenate([record.image(photographs.light(record, weights)), record.mask[None]]).transpose(
    1, 2, 0
)
subject = relight.Subject(np.float32(photograph))

# The truth: direct light and what bounces of it, for the lights of the sweep.
truth = stage.render(figure, view, options.size, lights, bounced=True)
strength, patterns = truth.bounce
luminance = patterns @ lightings.LUMINANCE
shading = (truth.normals @ lights.T).clip(0) * truth.visibility + (strength @ luminance).clip(0)
shading = shading.clip(0, 1)


def picture(index):
    """One frame: truth, visibility, shading, relit."""
    panels = [truth.image(shading[:, index : index + 1]).numpy()[0]]
    panels += [
        subject.visibility(lights[index : index + 1])[0],
        subject.shading(lights[index : index + 1])[0],
    ]
    grey = np.concatenate(panels, axis=1)[..., None].repeat(3, axis=2)
    lit = relight.over(subject.relit(relight.DirectionalLight(lights[index])), (0.02, 0.02, 0.025))
    return np.concatenate([grey, lit], axis=1)


write_movie(options.movie, (picture(index) for index in range(len(lights))), rate=24, white=1.0)
print(f"wrote {options.movie}: {len(lights)} frames")


def changes(maps):
    """Mean absolute change inside the mask from frame to frame, a degree, within each sweep: (E, F - 1)."""
    return np.abs(np.diff(maps.reshape(len(ELEVATIONS), frames, -1), axis=1)).mean(axis=2) / options.step


inferred = np.concatenate(
    [subject.shading(part)[:, record.mask] for part in np.array_split(lights, range(64, len(lights), 64))]
)
ours, true = changes(inferred), changes(shading.T)
print(
    f"change a degree, largest of any two neighbouring frames: ours {ours.max():.4f}, truth {true.max():.4f}"
)
print(f"mean over the sweeps: ours {ours.mean():.4f}, truth {true.mean():.4f}")
