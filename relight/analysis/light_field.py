"""Visibility and shading of a person as functions of the light's direction: arrays, and no network."""

import copy
from typing import NamedTuple, Protocol, Self, cast

import torch
import torch.nn.functional as F

from relight.analysis.backlight import open_rims
from relight.analysis.gloss import Gloss
from shading import Analysis
from shading.diffuse import Shading
from shadow.directions import olat
from shadow.framing import Framing
from shadow.networks.field import FieldMaps, Visibility
from shadow.networks.mirror import Pixels

ANCHORS = torch.from_numpy(olat(behind=True))  # (K, 3) unit vectors


class LightMaps(Protocol):
    """A map of the person as a function of the light's direction: visibility, shading or gloss."""

    def __call__(self, directions: torch.Tensor) -> torch.Tensor:
        """Return maps (D, h, w), in [0, 1] except for gloss, for unit directions (D, 3)."""

    def per_pixel(self, directions: torch.Tensor) -> torch.Tensor:
        """Return the map (h, w) in which each pixel has its own unit direction (3, h, w)."""


class LightField(NamedTuple):
    """The arrays behind visibility and shading, at the N pixels of a silhouette, in CPU memory."""

    silhouette: Pixels
    normals: torch.Tensor  # (3, N) unit vectors
    sharpness: torch.Tensor  # (1, N)
    cast: torch.Tensor  # (K, N) cast shadow for each anchor direction
    residual: torch.Tensor  # (K, N) shading residual for each anchor direction
    rim: torch.Tensor  # (1, N) share of the gloss that reaches the pixel, see `relight.analysis.backlight`

    @classmethod
    def of(cls, analysis: Analysis, framing: Framing) -> Self:
        """Take the arrays of an analysis on any device, whose canvas has a framing on the whole plate."""
        visibility = cast(Visibility, analysis.canvas_visibility)  # of a field, and the shading too
        shading = cast(Shading, analysis.canvas_shading)
        silhouette, maps = copy.copy(visibility.silhouette), visibility.maps
        silhouette.pixels = silhouette.pixels.cpu()
        normals = maps.normals.cpu()
        rim = open_rims(silhouette, normals, framing)
        return cls(silhouette, normals, maps.sharpness.cpu(), maps.cast.cpu(), shading.residual.cpu(), rim)

    def in_row_order(self) -> Self:
        """Return the field with its pixels in row-major order on the canvas."""
        inside = self.silhouette.scatter(torch.ones_like(self.sharpness))[0]
        order = torch.argsort(self.silhouette.pixels)
        return type(self)(Pixels(inside), *(array[:, order] for array in self[1:]))

    @property
    def visibility(self) -> Visibility:
        """Visibility as a function of the light's direction, in [0, 1]."""
        maps = FieldMaps(self.normals, self.cast, self.sharpness, self.sharpness[:0])
        return Visibility(maps, self.silhouette, ANCHORS)

    @property
    def shading(self) -> Shading:
        """Diffuse shading as a function of the light's direction, linear in [0, 1]."""
        return Shading(self.residual, self.normals, self.visibility, self.silhouette, ANCHORS)

    @property
    def gloss(self) -> Gloss:
        """Gloss as a function of the light's direction."""
        return Gloss(self.visibility, self.rim)

    @property
    def rows(self) -> torch.Tensor:
        """The arrays of each pixel side by side (N, 5 + 2 K)."""
        return torch.cat(self[1:]).T.contiguous()

    def with_rows(self, rows: torch.Tensor) -> Self:
        """Return the field whose `rows` these are, its normals of length one."""
        sizes = [len(array) for array in self[1:]]
        normals, *others = (array.contiguous() for array in rows.T.split(sizes))
        return type(self)(self.silhouette, F.normalize(normals, dim=0), *others)

    def sampled(self, positions: torch.Tensor) -> torch.Tensor:
        """Return rows (M, 5 + 2 K) at canvas positions (2, M), x and y in pixels: bilinear, zero outside."""
        height, width = self.silhouette.shape
        numbers = torch.full((height * width,), -1)
        numbers[self.silhouette.pixels] = torch.arange(len(self.silhouette.pixels))
        taps, shares = [], []
        for corner in ((0, 0), (1, 0), (0, 1), (1, 1)):
            near = (positions - 0.5).floor() + torch.tensor(corner)[:, None]
            share = (1 - (positions - 0.5 - near).abs()).prod(dim=0)
            column, row = near.long()
            on_canvas = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            number = numbers[torch.where(on_canvas, row * width + column, 0)]
            taps.append(number.clamp_min(0))
            shares.append(share * (on_canvas & (number >= 0)))
        return F.embedding_bag(
            torch.stack(taps, dim=1), self.rows, mode="sum", per_sample_weights=torch.stack(shares, dim=1)
        )
