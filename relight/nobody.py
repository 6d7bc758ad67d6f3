"""Frames in which nobody is, among those of a shot."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import torch

from relight import keeping
from relight.depth import Camera
from relight.lights.light import Lights, by_name
from relight.subject import Subject, weights
from shadow.files import AnyPath


class Nobody:
    """The like of a Subject for a frame in which nobody is."""

    def __init__(self, size: tuple[int, ...]) -> None:
        self.size = (size[0], size[1])
        self.matte = self.depth = np.zeros(size, np.float32)
        self.distance, self.camera = 0.0, Camera(self.size, 0.0, (0.0, 0.0), 0.0, 0)
        self.albedo = self.normals = self.lighting(None)

    def save(self, path: AnyPath, *, made_of: Mapping[str, Any]) -> None:
        """As `Subject.save`."""
        keeping.write_nobody(path, self.size, {"weights": list(weights()), **made_of})

    def pixels_in_each(self, lights: Lights) -> Iterator[tuple[str, torch.Tensor]]:
        return ((name, torch.zeros(self.size[0] * self.size[1], 4)) for name in by_name(lights))

    def on_plate(self, pixels: torch.Tensor) -> np.ndarray:
        return pixels.unflatten(0, self.size).numpy()

    def lighting(self, lights: object) -> np.ndarray:
        return np.zeros((*self.size, 3), np.float32)

    def unshadowed(self, light: object) -> np.ndarray:
        return self.matte

    def shadows(self, lights: Lights, floor: object) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """As `Subject.shadows`: the floor is lit everywhere."""
        none = np.ones((*self.size, 3), np.float32)
        return dict.fromkeys(by_name(lights), none), none


def load(path: AnyPath) -> Subject | Nobody:
    """As `Subject.load`, of a frame in which perhaps nobody is."""
    nobody = keeping.read_about(path).get("nobody")
    return Subject.load(path) if nobody is None else Nobody(tuple(nobody))
