"""The counterpart of a Subject for frames of a shot that show no person."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar, Self

import numpy as np
import torch

from relight.analysis import storage
from relight.analysis.camera import Camera, focal_length
from relight.compositing.clean_plate import checked_plate
from relight.lights.environment import FIELD_OF_VIEW
from relight.lights.light import Light
from relight.lights.rig import Lights, as_lights, by_name
from relight.subject import PHOTOGRAPH, Person, Subject, weights
from shadow.files import AnyPath


class EmptySubject:
    """A frame of `size` (H, W) without a person: what a Subject offers for rendering, all zero.

    >>> from relight.empty_subject import EmptySubject
    >>> float(EmptySubject((64, 48)).matte.max())
    0.0
    """

    is_empty: ClassVar[bool] = True

    def __init__(self, size: tuple[int, ...]) -> None:
        self.size = (size[0], size[1])
        self.matte = self.depth = np.zeros(self.size, np.float32)
        focal = focal_length(size[0], FIELD_OF_VIEW)
        self.distance, self.camera = 0.0, Camera(self.size, focal, (0.0, 0.0), 0.0, 0)
        self.albedo = self.normals = self.position = self.lighting(None)

    def save(self, path: AnyPath, *, provenance: Mapping[str, Any] | None = None) -> None:
        """See `Subject.save`."""
        storage.write_empty(path, self.size, {"weights": list(weights()), **(provenance or {})})

    def temporally_filtered(self, neighbours: Iterable[Person]) -> Self:
        """See `Subject.temporally_filtered`; neighbours bring nobody into the frame."""
        return self

    def preset_gain(self, name: str) -> float:
        """See `Subject.preset_gain`: 1."""
        return 1.0

    def preset(self, name: str) -> list[Light]:
        """See `Subject.preset`."""
        return as_lights(name)

    def relit(self, lights: Lights, gloss: float = 0.0, amount: float = 1.0) -> np.ndarray:
        """See `Subject.relit`: zero."""
        return np.zeros((*self.size, 4), np.float32)

    def pixels_per_light(
        self, lights: Lights, gloss: float = 0.0, amount: float = 1.0
    ) -> Iterator[tuple[str, torch.Tensor]]:
        """See `Subject.pixels_per_light`; all pixels of the plate are the person's, and zero."""
        names = [*([PHOTOGRAPH] if amount < 1 else []), *by_name(lights)]
        return ((name, torch.zeros(self.size[0] * self.size[1], 4)) for name in names)

    def on_plate(self, pixels: torch.Tensor) -> np.ndarray:
        """See `Subject.on_plate`."""
        return pixels.unflatten(0, self.size).numpy()

    def lighting(self, lights: object) -> np.ndarray:
        """See `Subject.lighting`: zero."""
        return np.zeros((*self.size, 3), np.float32)

    def reflection(self, lights: Lights) -> np.ndarray:
        """See `Subject.reflection`: zero."""
        return self.lighting(lights)

    def unshadowed(self, light: object) -> np.ndarray:
        """See `Subject.unshadowed`: zero."""
        return self.matte

    def shadows(self, lights: Lights, floor: object) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """See `Subject.shadows`: the floor is lit everywhere."""
        lit = np.ones((*self.size, 3), np.float32)
        return dict.fromkeys(by_name(lights), lit), lit

    def clean_plate(self, image: np.ndarray) -> np.ndarray:
        """See `Subject.clean_plate`: the photograph as it is."""
        return checked_plate(image, self.size)


def load_subject(path: AnyPath) -> Person:
    """Load a frame of an analysis cache; raises as `Subject.load`."""
    size = storage.read_header(path).get("empty")
    if size is None:
        return Subject.load(path)
    return EmptySubject(tuple(size))
