"""What stands in for a person, a photograph, a network: known exactly, and quick."""

from contextlib import contextmanager
from unittest import mock

import numpy as np
import torch

import relight
from helpers import shots
from relight.analysis.infer import check_inputs, infer
from relight.analysis.old_light import OldLight
from relight.media.images import scene_linear
from shading import diffuse
from shadow.networks import checkpoints

HEIGHT, WIDTH = 12, 16  # of a frame with somebody


def ball(height, width, centre=(0.5, 0.5), radius=0.35, soft=1.0):
    """Coverage (H, W) and camera-frame normals (H, W, 3) of a ball; sizes as shares of the height, `soft` in
    pixels."""
    y, x = np.mgrid[:height, :width] + 0.5
    x, y = (x - centre[0] * width) / (radius * height), (centre[1] * height - y) / (radius * height)
    squared = x**2 + y**2
    normals = np.stack([x, y, np.sqrt(np.clip(1 - squared, 0, None))], axis=-1)
    coverage = np.clip((1 - np.sqrt(squared)) * radius * height / soft + 0.5, 0, 1)
    return coverage.astype(np.float32), (normals * (squared < 1)[..., None]).astype(np.float32)


def image_of(coverage, colour=(0.5, 0.4, 0.3)):
    coverage = coverage[..., None]
    return np.concatenate([coverage * colour, coverage], axis=-1).astype(np.float32)


class Delighter:
    """Stands in for the shading network: knows the albedo."""

    def __init__(self, answer):
        self.answer = answer

    def analyse(self, rgb, mask, normals, visibility):
        silhouette, nothing = visibility.silhouette, torch.zeros_like(visibility.maps.cast)
        direct = diffuse.Shading(
            nothing, silhouette.take(normals), visibility, silhouette, visibility.anchors
        )
        return diffuse.Diffuse(direct, self.answer(rgb, mask))


def analysed(image, mask=None, shader=None, field=None, **options):
    """The `relight.Subject` of an image, analysed by these networks; by the shipped ones in place of None."""
    return relight.Subject.from_record(infer(check_inputs(image, mask, **options), field, shader))


@contextmanager
def no_network():
    """Whoever loads a network, or reads its file, fails."""
    refusal = AssertionError("a network was loaded")
    with mock.patch.multiple(
        checkpoints, load=mock.Mock(side_effect=refusal), read=mock.Mock(side_effect=refusal)
    ):
        yield


def somebody(column=4, value=1.0):
    """Somebody four pixels wide, (H, W, 4)."""
    image = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    image[2:10, column : column + 4] = (value, value, value, 1)
    return image


class FlatSubject:
    """Stands in for Subject: as bright as the image times the lights' intensities."""

    is_empty = False
    mean_confidence = 0.8

    def __init__(self, image, mask=None, normals=None, device=None, **room):
        alpha = image[..., 3] if mask is None else mask
        self.image = np.concatenate([image[..., :3] * alpha[..., None], alpha[..., None]], axis=-1)
        self.albedo = self.normals = image[..., :3]
        self.size, self.matte = alpha.shape, alpha
        self.old_light = room.get("old_light") or OldLight(saturation=float(image.mean()))
        self.filtered_by = []  # numbers of neighbours

    def relit(self, light):
        return self.image * np.float32([light.intensity] * 3 + [1])

    def photographed(self):
        return self.image

    def pixels_per_light(self, named, gloss=0.0, photograph=0.0):
        for name, light in named.items():
            yield name, torch.from_numpy(self.relit(light)).flatten(0, 1)

    def on_plate(self, pixels):
        return pixels.numpy().reshape(*self.size, -1)

    def lit_pixels(self, lights):
        return torch.from_numpy(self.albedo).flatten(0, 1)

    def unshadowed(self, light):
        return self.image[..., 3]

    def clean_plate(self, image):
        return np.where(self.matte[..., None] > 0, 0, scene_linear("image", image)[..., :3])

    def temporally_filtered(self, around):
        self.filtered_by.append(len(around))
        return self


class FlatShots:
    """Shots analysed by no network: their persons are FlatSubject."""

    def __init__(self):
        self.made = []  # the persons analysed

    def analyse(self, *arguments, **options):
        self.made.append(FlatSubject(*arguments, **options))
        return self.made[-1]

    def render(self, source, lights, outputs, **settings):
        """See `shots.render`."""
        return shots.render(source, lights, outputs, analyse=self.analyse, **settings)

    @property
    def filtered_by(self):
        """For each filtered frame, the number of neighbours."""
        return [count for person in self.made for count in person.filtered_by]


def brightness(path):
    picture = relight.read(path)
    return float(picture[..., 0].max())
