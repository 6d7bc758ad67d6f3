"""Measure how much the lighting flickers from frame to frame, with and without `Subject.temporally_filtered`,
and how much detail the filter blurs.

python benchmarks/flicker.py            the bundled person, still lit: at rest in noise, drifting, walking
python benchmarks/flicker.py --turning  a body of the light stage (extra `stage`) that turns; true shadows

Flicker is the mean difference of the lighting between successive frames, in display code values (of 255),
after the frames are aligned to the person. In an aligned frame every change of the lighting is an error.

Less flicker at equal detail is better. Figures to compare with are in docs/video.md.
"""

import math
import sys
from functools import partial
from pathlib import Path

import numpy as np
import torch
from scipy import ndimage
from torch.nn import functional

import relight
from relight.analysis import temporal
from relight.analysis.camera import Camera
from relight.analysis.depth import WorldGeometry
from relight.analysis.light_field import LightField
from relight.analysis.maps import AnalysisMaps
from relight.pipeline.options import TEMPORAL_RADIUS
from shading.diffuse import RESIDUAL_BIAS
from shadow import directions, visibility
from shadow.framing import Framing, affine_sample
from shadow.networks.mirror import Pixels

HEIGHT, WIDTH, FRAMES = 720, 480, 9
LIGHT = relight.DirectionalLight(azimuth=-50, elevation=30, intensity=2)
MOTIONS = {  # x, y (pixels) and size of the person by frame, and the sensor's noise
    "at rest, noise": (lambda t: (0, 0, 1), 0.03),
    "drifting, little noise": (lambda t: (0.37 * t, 0.21 * t, 1 + 0.004 * t), 0.02),
    "walking, little noise": (lambda t: (5.3 * t, 0.8 * np.sin(t), 1), 0.02),
}


def moved(image, x, y, size, into):
    """`image` (H, W, C) with its centre at (x, y) from the middle of a picture of `into` (height, width)."""
    height, width = into
    matrix = torch.tensor(
        [
            [1 / size, 0, image.shape[1] / 2 - (width / 2 + x) / size],
            [0, 1 / size, image.shape[0] / 2 - (height / 2 + y) / size],
        ]
    )
    picture = torch.from_numpy(np.ascontiguousarray(image)).permute(2, 0, 1)
    return affine_sample(picture, matrix, into).permute(1, 2, 0).numpy()


def returned(image, x, y, size):
    """The inverse of `moved` for pictures of its own size."""
    return moved(image, -x / size, -y / size, 1 / size, image.shape[:2])


def temporally_filtered(subjects):
    reach = TEMPORAL_RADIUS
    for t, subject in enumerate(subjects):
        yield subject.temporally_filtered(subjects[max(t - reach, 0) : t] + subjects[t + 1 : t + 1 + reach])


def display(light):
    return 255 * np.clip(light, 0, 1) ** (1 / 2.2)


def under_a_still_light():
    person = relight.read(Path(__file__).parents[1] / "examples" / "person.png")
    fit = 0.9 * HEIGHT / person.shape[0]
    for name, (motion, noise) in MOTIONS.items():
        subjects, random = [], np.random.default_rng(0)
        for t in range(FRAMES):
            x, y, size = motion(t)
            frame = moved(person, x, y, size * fit, (HEIGHT, WIDTH)).clip(0)
            grain = random.normal(0, noise, (HEIGHT, WIDTH, 3)) * np.sqrt(frame[..., :3])
            frame[..., :3] = (frame[..., :3] + grain * frame[..., 3:]).clip(0)
            frame[..., 3] = frame[..., 3].clip(0, 1)
            subjects.append(relight.Subject(frame.astype(np.float32)))
        inside = returned(subjects[0].relit(LIGHT), *motion(0))[..., 3] > 0.999
        inside = ndimage.binary_erosion(inside, iterations=6)
        flicker = []
        for frames in (subjects, temporally_filtered(subjects)):
            lighting = [returned(s.lighting(LIGHT), *motion(t))[inside] for t, s in enumerate(frames)]
            flicker.append(np.abs(np.diff(display(np.array(lighting)), axis=0)).mean())
        print(f"{name:24s} flicker {flicker[0]:.2f}, temporally_filtered {flicker[1]:.2f}")


def shaded_by(shadows, known):
    """A field whose shading by the anchor directions is `shadows` (K, h, w): residuals of unlit surfaces."""
    silhouette = Pixels(known)
    residual = silhouette.take(shadows) + RESIDUAL_BIAS
    unlit, sharpness = torch.zeros(3, residual.shape[1]), torch.ones(1, residual.shape[1])
    return LightField(silhouette, unlit, sharpness, torch.zeros_like(residual), residual, sharpness)


def with_true_shadows():
    """A turning body's true shadows, with a little trembling added: what the filter leaves of each.

    Response is the share of the shadows' true changes that is still there.
    """
    from shadow.lightstage import stage
    from shadow.lightstage.people.generate import bodies

    lights = torch.from_numpy(directions.olat(behind=True))
    figure, random = bodies.body(5, "generalisation"), torch.Generator().manual_seed(0)
    canvases, truth = [], []
    for t in range(FRAMES):
        view = stage.View(azimuth=-10 + 1.5 * t, distance=3.5, height=1.2, pitch=-5, fov=34)
        record = stage.render(figure, view, 320, lights.numpy())
        mask = torch.from_numpy(np.asarray(record.mask, np.float32))
        framing = Framing.around(mask, visibility.load().size)
        known = framing.crop(mask[None])[0] > 0.5
        shadows = framing.crop(record.image(record.visibility).float()) * known
        grain = functional.avg_pool2d(torch.randn(shadows.shape, generator=random), 5, stride=1, padding=2)
        photograph = framing.crop(record.image(record.albedo).float()) ** (1 / 2.2)
        field = shaded_by((shadows + 0.2 * grain).clamp(0, 1), known)
        camera = Camera(framing.plate, 100.0, framing.centre, 2.0, framing.plate[0])
        space = WorldGeometry(camera, framing, partial(torch.zeros, framing.canvas))
        canvases.append(AnalysisMaps(framing, known, photograph, photograph, field, photograph, None, space))
        truth.append(framing.restore(shadows))
    for name, sigma in (
        ("as found", None),
        ("temporally_filtered", temporal.SHADING_SIGMA),
        ("plain mean of 5 frames", math.inf),
    ):
        maps = []
        for t, frame in enumerate(canvases):
            around = canvases[max(t - TEMPORAL_RADIUS, 0) : t] + canvases[t + 1 : t + 1 + TEMPORAL_RADIUS]
            found = (
                frame if sigma is None else temporal.temporally_filtered(frame, around, shading_sigma=sigma)
            )
            maps.append(frame.framing.restore(found.shading(lights[:64])))
        change = torch.stack(maps).diff(dim=0)
        true_change = torch.stack(truth)[:, :64].diff(dim=0)
        response = (change * true_change).sum() / (true_change**2).sum()
        print(f"turning, true shadows: {name:24s} response {response:.3f}")


def with_our_networks():
    """A turning body photographed under a softbox, relit by one light, against its true shading.

    Flicker is how much the error changes from frame to frame: what truly moves is not counted.
    """
    from shadow.data import lightings, photographs
    from shadow.lightstage import stage
    from shadow.lightstage.people.generate import bodies

    lights = directions.olat(behind=True)
    powers = 0.6 / len(lights) * (1 + lights[:, 1]) + 1.2 * lightings.softbox(lights)
    powers = np.append(powers, 0).astype(np.float32)[:, None].repeat(3, axis=1)  # the new light is off
    figure, to_light = bodies.body(5, "generalisation"), LIGHT.samples()[0]
    subjects, truth = [], []
    for t in range(FRAMES):
        view = stage.View(azimuth=-10 + 1.5 * t, distance=3.5, height=1.2, pitch=-5, fov=34)
        record = stage.render(figure, view, 512, np.concatenate([lights, to_light]))
        colour = record.image(photographs.light(record, powers))
        photograph = np.concatenate([colour, record.mask[None]]).transpose(1, 2, 0).astype(np.float32)
        subjects.append(relight.Subject(np.ascontiguousarray(photograph)))
        direct = (record.normals @ to_light[0]).clip(0) * record.visibility[:, -1]
        truth.append(record.image(direct[:, None])[0].numpy())
    for name, frames in (
        ("as found", subjects),
        ("temporally_filtered", list(temporally_filtered(subjects))),
    ):
        errors = np.array([s.lighting(LIGHT)[..., 0] / 2 for s in frames]) - np.array(truth)
        inside = np.array([s.albedo.any(axis=-1) for s in subjects])
        both = inside[1:] & inside[:-1]
        flicker, rmse = np.abs(np.diff(errors, axis=0))[both].mean(), np.sqrt((errors[inside] ** 2).mean())
        print(f"turning, our networks: {name:12s} flicker of the error {flicker:.4f}, RMSE {rmse:.4f}")


if __name__ == "__main__":
    torch.set_num_threads(1)
    if sys.argv[1:] == ["--turning"]:
        with_true_shadows()
        with_our_networks()
    else:
        under_a_still_light()
