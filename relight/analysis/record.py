"""Everything that a `relight.Subject` is made of."""

from typing import NamedTuple

import numpy as np
import torch

from relight.analysis.foreground import Foreground, linear_plate
from relight.analysis.maps import AnalysisMaps
from relight.analysis.old_light import OldLight
from shading.albedo import solve_lighting
from shadow import inputs
from shadow.directions import olat
from shadow.framing import Framed, Framing


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

    def fit_lighting(self, image: inputs.Array, albedo: torch.Tensor) -> tuple[np.ndarray, np.ndarray]:
        """Fit the lighting in which the person looks most like `image`, see `relight.fit_lights`.

        `albedo` (P, 3): that of relit pictures, without noise. Returns directions (96, 3) and their
        intensities (96, 3) >= 0. Raises ValueError for an image of another size.
        """
        plate, person, maps = linear_plate(image), self.foreground, self.maps
        if plate.shape[:2] != person.size:
            raise ValueError(f"image: expected the subject's size {person.size}, got {plate.shape[:2]}")
        colour = person.own_colour(plate, photographed=plate.shape[-1] == 3)
        framed = Framed.of(colour, person.matte, self.framing.canvas[0])
        covered = torch.cat([torch.ones(len(albedo), 1), albedo], dim=1)
        layers = torch.from_numpy(person.scatter(covered)[person.box]).permute(2, 0, 1)
        share, known_albedo = self.framing.crop(layers).split([1, 3])
        directions = torch.from_numpy(olat(behind=True))
        powers = solve_lighting(
            framed.rgb, known_albedo / share.clamp_min(1e-6), maps.shading(directions), maps.known.float()
        )
        return directions.numpy(), powers.numpy()
