"""The person at a few points, as a function of light: small enough to solve for lights while one paints.

Each cell of a grid of 64 rows that shows the person has one point, the pixel of the networks' canvas nearest
to the cell's middle. What a light does there is what it does in a picture: nothing is averaged.
"""

import numpy as np
import torch
import torch.nn.functional as F

from relight.analysis.light_field import LightField
from relight.analysis.maps import add_light
from relight.analysis.record import AnalysisRecord
from relight.lights.light import Light
from shadow import inputs
from shadow.networks.mirror import Pixels

ROWS = 64


class LightGrid:
    """N points of a person, and what lights make of them.

    `albedo`: (P, 3) of the person's pixels, see `relight.Subject`. `gloss`: strength of the gloss, in [0, 1].
    """

    def __init__(self, record: AnalysisRecord, albedo: torch.Tensor, gloss: float = 0.0) -> None:
        self._record, self._gloss, maps = record, gloss, record.maps
        height, width = maps.known.shape
        self._step = step = max(1, height // ROWS)
        silhouette = maps.field.silhouette
        known = maps.known.flatten()[silhouette.pixels].numpy()
        rows, columns = np.divmod(silhouette.pixels.numpy(), width)
        columns_of_cells = -(-width // step)
        cells = rows // step * columns_of_cells + columns // step
        off_middle = np.hypot(rows % step - (step - 1) / 2, columns % step - (step - 1) / 2)
        order = np.lexsort((off_middle, cells, ~known))
        self._cells, first = np.unique(
            cells[order], return_index=True
        )  # the first of each cell is its nearest
        chosen = torch.from_numpy(order[first])
        shape = (-(-height // step), columns_of_cells)
        inside = torch.zeros(shape)
        inside.view(-1)[torch.from_numpy(self._cells)] = 1
        self._canvas = silhouette.pixels[chosen]
        self._field = LightField(Pixels(inside), *(array[:, chosen] for array in maps.field[1:]))
        self.albedo = self._at_points(record.canvas_albedo(albedo))

    def __len__(self) -> int:
        return len(self._cells)

    def pictures(self, directions: torch.Tensor) -> torch.Tensor:
        """Return the picture (D, 3, N), linear, in a light of power 1 from each of the directions (D, 3)."""
        silhouette = self._field.silhouette
        lit = silhouette.take(self._field.shading(directions))[:, None] * self.albedo
        if self._gloss:
            lit = lit + self._gloss * silhouette.take(self._field.gloss(directions))[:, None]
        return lit

    def picture(self, light: Light) -> torch.Tensor:
        """Return the picture (3, N), linear, in a light of any kind."""
        lit = self._sum(self._field.shading, light) * self.albedo
        return lit + self._gloss * self._sum(self._field.gloss, light) if self._gloss else lit

    def _sum(self, maps: object, light: Light) -> torch.Tensor:
        shape = self._field.silhouette.shape
        total = torch.zeros(shape.numel(), 3)
        add_light(total, maps, light, self._positions(light))  # type: ignore[arg-type]
        return self._field.silhouette.take(total.T.unflatten(1, shape))

    def _positions(self, light: Light) -> torch.Tensor:
        """Return the points' positions (3, h, w) for a near light; of no point for others."""
        if not light.is_near:
            return torch.empty(3, 0)
        self._record.maps.check_outside(light)
        positions = self._record.maps.geometry.positions.flatten(1)[:, self._canvas]
        return self._field.silhouette.scatter(positions)

    def photographed(self, image: inputs.Array) -> torch.Tensor:
        """Return what a picture of the person shows at the points: (3, N) linear.

        Raises TypeError or ValueError for what is no image of the subject's size.
        """
        return self._at_points(self._record.framed(image))

    def coverage(self, mask: torch.Tensor) -> torch.Tensor:
        """Return the share (N,) of each point's cell that a mask (H, W) covers, of its part on the person."""
        person = self._record.foreground
        both = torch.stack([mask[person.box] * person.matte, person.matte])
        covered, inside = (self._pooled(layer) for layer in self._record.framing.crop(both))
        return covered / inside.clamp_min(1e-6)

    def _pooled(self, layer: torch.Tensor) -> torch.Tensor:
        pooled = F.avg_pool2d(layer[None], self._step, ceil_mode=True)
        return pooled.flatten()[torch.from_numpy(self._cells)]

    def _at_points(self, canvas: torch.Tensor) -> torch.Tensor:
        return canvas.flatten(1)[:, self._canvas]
