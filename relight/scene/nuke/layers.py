"""What an exported group reads in Nuke: a picture whose layers are a person for any light.

The maps of cast shadow and residual, one for each anchor direction, are of low rank. Their principal
components are the layers, three to a layer, upsampled to the plate.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import torch

from relight.analysis.components import covariance, projected, strongest
from relight.analysis.gloss import outline
from relight.analysis.light_field import ANCHORS
from relight.scene.person import Person

CAST_LAYERS, RESIDUAL_LAYERS = 6, 3  # of three components each
LAYERS = (
    *(f"cast{number}" for number in range(1, CAST_LAYERS + 1)),
    *(f"residual{number}" for number in range(1, RESIDUAL_LAYERS + 1)),
)
# `facing`: normals; `gate`: the slope of the gate in N·L, N·V, and `relight.analysis.gloss.outline` times the
# share of the gloss that reaches the pixel;
# `toward.red`: 1, for a light's L·V; `photograph`: the person in the light of the photograph, premultiplied.
PHOTOGRAPH = "photograph"
NAMES = ("facing", "gate", "toward", *LAYERS, PHOTOGRAPH)


class Basis(NamedTuple):
    """The components that all frames of a shot share, and the anchor directions that they are mixed for."""

    anchors: torch.Tensor  # (K, 3) unit vectors
    cast: torch.Tensor  # (K, 18) orthonormal columns
    residual: torch.Tensor  # (K, 9) orthonormal columns

    @classmethod
    def of(cls, subjects: Iterable[Person]) -> "Basis":
        """Find the strongest components of one person or of several frames, `relight.Subject`s."""
        cast = residual = torch.zeros(())
        for subject in subjects:
            arrays = subject.record.maps.field
            cast, residual = cast + covariance(arrays.cast), residual + covariance(arrays.residual)
        return cls(ANCHORS, strongest(cast, 3 * CAST_LAYERS), strongest(residual, 3 * RESIDUAL_LAYERS))

    @property
    def tables(self) -> list[float]:
        """Return the numbers that `relight.scene.nuke.callback.weights` takes."""
        mix = torch.cat([self.cast, self.residual], dim=1)
        return [*self.anchors.flatten().tolist(), *mix.flatten().tolist()]


def layers_of(subject: Person, basis: Basis) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return a person's picture and its layers, in the basis of the person or of their shot.

    The picture (H, W, 4) is the albedo, linear Rec.709, premultiplied by the matte, and the matte. The layers
    are {name of NAMES: (H, W, 3)}, zero outside the matte.
    """
    arrays = subject.record.maps.field
    none = torch.zeros_like(arrays.sharpness)
    gate = torch.cat([arrays.sharpness, arrays.normals[2:], outline(arrays.normals[2:]) * arrays.rim])
    toward = torch.cat([none + 1, none, none])
    maps = torch.cat(
        [
            arrays.normals,
            gate,
            toward,
            projected(basis.cast, arrays.cast),
            projected(basis.residual, arrays.residual),
        ]
    )
    plate = subject.upsampled(arrays.silhouette.scatter(maps))
    layers = {name: plate[..., 3 * n : 3 * n + 3] for n, name in enumerate(NAMES[:-1])}
    layers[PHOTOGRAPH] = subject.photographed()[..., :3]
    matte = subject.matte[..., None]
    return np.concatenate([subject.albedo * matte, matte], axis=-1), layers
