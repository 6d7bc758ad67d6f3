"""Reflection at grazing angles: the rim that light from behind gives to hair, shoulders and arms.

    gloss(p, L) = π · D · V · F · max(N·L, 0) × visibility(p, L)

D and V are GGX microfacets (Walter et al. 2007) with height-correlated Smith masking (Heitz 2014), F is the
Fresnel term of Schlick (1994) whose part at normal incidence is left out: F = (1 - V·H)^5. Light from the
front then adds nothing, so black cloth stays black, and light from behind adds most. The factor π belongs to
a light of unit intensity, in which a white surface that faces the light has the value 1.

The view is orthographic: V is (0, 0, 1) at each pixel. F and the length of the half vector thus depend on the
light alone, and programs that know no camera compute the same.
"""

from typing import Any, NamedTuple, Self

import torch

from relight.analysis.light_field import LightMaps
from relight.lights.parameters import checked_number
from shadow.networks.mirror import Pixels

ROUGHNESS = 0.55  # of glTF and UsdPreviewSurface: the width of the lobe, alpha, is its square
MIN_COSINE = 1e-4  # of the half vector, and of both angles in the denominator of V


class Gloss(NamedTuple):
    """The gloss of a person as a function of the light's direction, zero outside the person."""

    visibility: LightMaps
    silhouette: Pixels  # of N pixels
    normals: torch.Tensor  # (3, N) unit vectors, camera frame

    @classmethod
    def of(cls, visibility: LightMaps, normals: torch.Tensor, known: torch.Tensor) -> Self:
        """Take normals (3, h, w), and the pixels (h, w) that show the person."""
        silhouette = Pixels(known)
        return cls(visibility, silhouette, silhouette.take(normals))

    def __call__(self, directions: torch.Tensor) -> torch.Tensor:
        """Return maps (D, h, w), at least 0 and unbounded, for unit directions (D, 3)."""
        seen = self.silhouette.take(self.visibility(directions))
        facing = directions @ self.normals
        return self.silhouette.scatter(seen.mul_(reflectance(facing, self.normals[2], directions[:, 2:])))

    def per_pixel(self, directions: torch.Tensor) -> torch.Tensor:
        """Return the map (h, w) in which each pixel has its own unit direction (3, h, w)."""
        seen = self.silhouette.take(self.visibility.per_pixel(directions)[None])
        toward = self.silhouette.take(directions)
        facing = (toward * self.normals).sum(dim=0)
        return self.silhouette.scatter(seen.mul_(reflectance(facing, self.normals[2], toward[2])))[0]


def reflectance(facing: torch.Tensor, viewed: torch.Tensor, frontal: torch.Tensor) -> torch.Tensor:
    """Return π · D · V · F · max(N·L, 0) of the cosines N·L (..., N), N·V and L·V.

    N·V and L·V are of a shape that broadcasts to that of N·L. The result is zero where the surface faces away
    from the light, and at most π · D · F / (2 alpha), which it reaches where the surface is seen edge-on.

    >>> import torch
    >>> edge = torch.full((3,), 0.3)  # N·L and N·V of a surface that both see from the side
    >>> values = reflectance(edge, edge, torch.tensor([1.0, 0.0, -0.7]))
    >>> [round(float(value), 3) for value in values]  # a light at the camera, at the side, behind
    [0.0, 0.0, 0.023]
    """
    alpha = ROUGHNESS**2
    facing, viewed = facing.clamp_min(0), viewed.clamp_min(0)
    half = ((1 + frontal) / 2).clamp_min(0).sqrt().clamp_min(MIN_COSINE)  # H·V and H·L: H is midway
    fresnel = (1 - half).clamp_min(0) ** 5
    aligned = (facing + viewed).div_(2 * half).clamp_max_(1)  # N·H
    lobe = aligned.square_().mul_(alpha**2 - 1).add_(1).reciprocal_().square_()  # π · D = alpha² · lobe
    masking = (facing * _slope(viewed, alpha)).addcmul_(
        _slope(facing, alpha), viewed
    )  # V = 1 / (2 · masking)
    return lobe.mul_(facing).mul_(alpha**2 / 2 * fresnel).div_(masking.clamp_min_(MIN_COSINE))


def checked_gloss(gloss: Any) -> float:
    """Return the strength of the gloss; raises TypeError or ValueError unless it is a number in [0, 1].

    >>> checked_gloss(0.5)
    0.5
    """
    return checked_number("gloss", gloss, 0, 1)


def _slope(cosine: torch.Tensor, alpha: float) -> torch.Tensor:
    return (cosine**2 * (1 - alpha**2) + alpha**2).sqrt()
