"""Everything that a `relight.Subject` is made of."""

from typing import NamedTuple, Self

import numpy as np
import torch

from relight.analysis.camera import Camera, focal_length
from relight.analysis.depth import ProvidedDepth, WorldGeometry
from relight.analysis.foreground import Foreground, linear_plate
from relight.analysis.light_field import ANCHORS, LightField
from relight.analysis.maps import AnalysisMaps
from relight.analysis.old_light import OldLight
from relight.analysis.upsampling import TAPS
from relight.lights.environment import FIELD_OF_VIEW
from shading.albedo import solve_lighting
from shadow import inputs
from shadow.directions import olat
from shadow.framing import Framed, Framing
from shadow.networks.mirror import Pixels


class AnalysisRecord(NamedTuple):
    """An analysed person: pixels of the plate, and the networks' maps on the canvas. Holds no network."""

    foreground: Foreground
    colour: torch.Tensor  # (P, 3) the person's own colour, linear Rec.709, without the background
    provided_albedo: torch.Tensor | None  # (P, 3) linear, if the caller gave the albedo
    exposure: float  # factor by which `colour` is multiplied before it is encoded as a guide
    framing: Framing  # of the canvas in the foreground's box
    maps: AnalysisMaps
    old_light: OldLight = OldLight()  # whose colour the albedo lacks
    face: torch.Tensor | None = None  # (h, w) bool, where it is on the canvas, if that is known

    @classmethod
    def of_nobody(cls, size: tuple[int, int]) -> Self:
        """Return the record of a picture of `size` (H, W) that shows no person: no pixel of it is theirs."""
        known = torch.zeros(TAPS, TAPS, dtype=torch.bool)  # the smallest canvas that can be upsampled
        black = torch.zeros(3, *known.shape)
        framing = Framing((0.0, 0.0), 1.0, (TAPS, TAPS), size)
        lengths = (3, 1, len(ANCHORS), len(ANCHORS), 1)
        field = LightField(Pixels(known), *(torch.zeros(length, 0) for length in lengths))
        camera = Camera(size, focal_length(size[0], FIELD_OF_VIEW), (0.0, 0.0), 0.0, 0)
        geometry = WorldGeometry(camera, framing, ProvidedDepth(black[0], known))
        maps = AnalysisMaps(framing, known, black, black, field, black, None, geometry)
        nothing = torch.zeros(1, 1)
        person, colour = Foreground(size, (0, 0), nothing, nothing, False), torch.zeros(0, 3)
        return cls(person, colour, colour, 1.0, framing, maps)

    @property
    def is_empty(self) -> bool:
        """Whether the picture shows no person."""
        return not len(self.foreground.pixels)

    def fit_lighting(self, image: inputs.Array, albedo: torch.Tensor) -> tuple[np.ndarray, np.ndarray]:
        """Fit the lighting in which the person looks most like `image`, see `relight.fit_lights`.

        `albedo` (P, 3): that of relit pictures, without noise. Returns directions (96, 3) and their
        intensities (96, 3) >= 0. Raises ValueError for an image of another size.
        """
        directions, maps = torch.from_numpy(olat(behind=True)), self.maps
        powers = solve_lighting(
            self.framed(image), self.canvas_albedo(albedo), maps.shading(directions), maps.known.float()
        )
        return directions.numpy(), powers.numpy()

    def framed(self, image: inputs.Array) -> torch.Tensor:
        """Return the person's own colour (3, h, w) in a picture of them, linear, on the networks' canvas.

        Raises ValueError for an image of another size than the person's.
        """
        plate, person = linear_plate(image), self.foreground
        if plate.shape[:2] != person.size:
            raise ValueError(f"image: expected the subject's size {person.size}, got {plate.shape[:2]}")
        colour = person.own_colour(plate, photographed=plate.shape[-1] == 3)
        return Framed.of(colour, person.matte, self.framing.canvas[0]).rgb

    def canvas_albedo(self, albedo: torch.Tensor) -> torch.Tensor:
        """Return the albedo (P, 3) of the person's pixels on the networks' canvas (3, h, w)."""
        person = self.foreground
        covered = torch.cat([torch.ones(len(albedo), 1), albedo], dim=1)
        layers = torch.from_numpy(person.scatter(covered)[person.box]).permute(2, 0, 1)
        share, known_albedo = self.framing.crop(layers).split([1, 3])
        return known_albedo / share.clamp_min(1e-6)
