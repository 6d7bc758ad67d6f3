"""Light that fine fibres scatter: the rim that light from behind gives to hair, shoulders and arms.

    gloss(p, L) = π · S · (1 - μV)^5 · μL × cast(p, L) × rim(p)
    μL = max(N·L - BEND · V·L, 0),  μV = max(N·V - BEND, MIN_COSINE)

S is single scattering in a thin layer (Chandrasekhar 1960; Hanrahan and Krueger 1993), averaged over depths
of exponential distribution about DEPTH: S = p / 4π · DEPTH / (μL μV + DEPTH (μL + μV)). Its phase function p,
of mean 1, is that of Henyey and Greenstein (1941): fibres scatter forward, toward a camera that faces the
light. The Fresnel term of Schlick (1994), without a part at normal incidence, keeps it to the outline. So
light from the front adds hardly anything, and black cloth stays black. The factor π belongs to a light of
unit intensity, in which a white surface that faces the light has the value 1.

At the outline the true normal is perpendicular to the view, but the inferred ones stay some BEND short of
that: a pixel shows a part of a limb's turn. So both cosines are of N - BEND · V. A light straight behind then
reaches the outline, as it does with hair and cloth, whose fibres stand out beyond the surface. `cast` is the
visibility without the surface's own turn from the light, which μL has. `rim` is 0 at edges before the body
(`relight.analysis.backlight`) and 1 elsewhere.

The view is orthographic: V is (0, 0, 1) at each pixel. p then depends on the light alone, and programs that
know no camera compute the same.
"""

from typing import NamedTuple

import torch

from relight.arguments import checked_number
from shadow.networks.field import Visibility

FORWARD = 0.5  # mean cosine of the angle by which a fibre turns light: g of Henyey and Greenstein
DEPTH = 0.1  # mean optical depth of the layer, seen from above
BEND = 0.35  # cosine to the view that inferred normals have about the outline
MIN_COSINE = 0.06  # of the view: what a pixel shows of the outline is never quite grazing


class Gloss(NamedTuple):
    """The gloss of a person as a function of the light's direction, zero outside the person."""

    visibility: Visibility
    rim: torch.Tensor  # (1, N) share of it that reaches each of the person's pixels

    def __call__(self, directions: torch.Tensor) -> torch.Tensor:
        """Return maps (D, h, w), at least 0 and at most 0.7, for unit directions (D, 3)."""
        return self.visibility.silhouette.scatter(self.at_pixels(directions))

    def at_pixels(self, directions: torch.Tensor) -> torch.Tensor:
        """Return the gloss (D, N) of the person's pixels, for unit directions (D, 3)."""
        normals = self.visibility.maps.normals
        values = reflectance(directions @ normals, normals[2], directions[:, 2:])
        return values.mul_(self.visibility.cast(directions)).mul_(self.rim)

    def per_pixel(self, directions: torch.Tensor) -> torch.Tensor:
        """Return the map (h, w) in which each pixel has its own unit direction (3, h, w)."""
        normals = self.visibility.maps.normals
        toward = self.visibility.silhouette.take(directions)
        values = reflectance((toward * normals).sum(dim=0), normals[2], toward[2])
        values = values.mul_(self.visibility.cast_of_each(toward)).mul_(self.rim[0])
        return self.visibility.silhouette.scatter(values[None])[0]


def reflectance(facing: torch.Tensor, viewed: torch.Tensor, frontal: torch.Tensor) -> torch.Tensor:
    """Return π · S · (1 - μV)^5 · μL of the cosines N·L (..., N), N·V and L·V.

    N·V and L·V are of a shape that broadcasts to that of N·L. The result is in [0, 0.7].

    >>> import torch
    >>> frontal = torch.tensor([1.0, 0.0, -0.9])  # a light at the camera, at the side, behind
    >>> outline = reflectance(torch.tensor([0.3, 0.9, 0.3]), torch.full((3,), 0.3), frontal)
    >>> middle = reflectance(torch.tensor([0.9, 0.4, -0.5]), torch.full((3,), 0.9), frontal)
    >>> [[round(float(value), 3) for value in values] for values in (outline, middle)]
    [[0.0, 0.059, 0.391], [0.0, 0.0, 0.0]]
    """
    lit = (facing - BEND * frontal).clamp_min_(0)
    seen = (viewed - BEND).clamp_min(MIN_COSINE)
    half = DEPTH * seen / (seen + DEPTH)  # μL that gives half of the most
    phase = (1 - FORWARD**2) / (1 + FORWARD**2 + 2 * FORWARD * frontal) ** 1.5
    return lit.div_(lit + half).mul_(outline(viewed)).mul_(phase / 4)


def outline(viewed: torch.Tensor) -> torch.Tensor:
    """Return the part of `reflectance` that the light does not change, of the cosine N·V: in (0, 0.46).

    >>> import torch
    >>> [round(float(value), 3) for value in outline(torch.tensor([0.3, 0.6, 1.0]))]
    [0.459, 0.068, 0.001]
    """
    seen = (viewed - BEND).clamp_min(MIN_COSINE)
    return DEPTH / (seen + DEPTH) * (1 - seen) ** 5


def checked_gloss(gloss: object) -> float:
    """Return the strength of the gloss; raises TypeError or ValueError unless it is a number in [0, 1].

    >>> checked_gloss(0.5)
    0.5
    """
    return checked_number("gloss", gloss, 0, 1)
