"""How sure the analysis is: the probability that a pixel is said to be lit, or in shadow, rightly.

The network learned visibility as a probability, by cross-entropy. So the smaller of v and 1 - v is the
probability that the other is true, and needs no measure of its own. On four bodies that the networks have not
seen it was 8 % too large, which CALIBRATION corrects; `python benchmarks/confidence.py` checks it on others.
The difference between the maps of the photograph and of its mirror image says less about the true error.
"""

from typing import NamedTuple

import torch

from relight.analysis.light_field import ANCHORS, LightField, LightMaps

CALIBRATION = 0.926  # measured share of wrong pixels over the stated one
DIRECTIONS_PER_BATCH = 16


class Doubt(NamedTuple):
    """The probability (D, h, w) that visibility is wrong, as a function of the light's direction."""

    visibility: LightMaps

    def __call__(self, directions: torch.Tensor) -> torch.Tensor:
        """Return maps (D, h, w) in [0, 0.5] for unit directions (D, 3)."""
        return _wrong(self.visibility(directions))

    def per_pixel(self, directions: torch.Tensor) -> torch.Tensor:
        """Return the map (h, w) in which each pixel has its own unit direction (3, h, w)."""
        return _wrong(self.visibility.per_pixel(directions))


def _wrong(visibility: torch.Tensor) -> torch.Tensor:
    return CALIBRATION * torch.minimum(visibility, 1 - visibility)


def overall(field: LightField) -> torch.Tensor:
    """Return the confidence (h, w) in the visibility of all directions, their mean; zero off the person."""
    doubt, silhouette = Doubt(field.visibility), field.silhouette
    total = torch.zeros(silhouette.shape)
    for directions in ANCHORS.split(DIRECTIONS_PER_BATCH):
        total += doubt(directions).sum(dim=0)
    return silhouette.scatter(silhouette.take(1 - total[None] / len(ANCHORS)))[0]
