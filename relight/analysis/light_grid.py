"""The person at a few points, as a function of light: small enough to solve for lights while one paints.

Each cell of a grid of 64 rows that shows the person has one point, the pixel of the networks' canvas nearest
to the cell's middle. What a light does there is what it does in a picture: nothing is averaged.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F

from relight.analysis.light_field import LightField
from relight.analysis.maps import add_light
from relight.analysis.record import AnalysisRecord
from relight.lights.directional import disc_samples
from relight.lights.light import Light
from relight.media.resampling import reduced_size
from shadow import inputs
from shadow.framing import Framing
from shadow.networks.mirror import Pixels

ROWS = 64
CELL_PIXELS = 8  # a side, that are enough to draw strokes


class _Drawing(NamedTuple):
    """What masks of one size are multiplied with, and where the canvas is on them."""

    box: tuple[slice, slice]  # slices of the masks
    matte: torch.Tensor  # there
    framing: Framing  # of the canvas on the box
    inside: torch.Tensor  # (N,) share of the matte in the points' cells


class LightGrid:
    """N points of a person, and what lights make of them.

    `albedo`: (P, 3) of the person's pixels, see `relight.Subject`. `gloss`: strength of the gloss, in [0, 1].
    """

    def __init__(self, record: AnalysisRecord, albedo: torch.Tensor, gloss: float = 0.0) -> None:
        self._record, self._gloss, maps = record, gloss, record.maps
        self._drawings: dict[tuple[int, int], _Drawing] = {}
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
        return self._coloured(*self._layers(directions))

    def pictures_of_discs(self, axes: Sequence[np.ndarray], angles: Sequence[float]) -> torch.Tensor:
        """Return the picture (L, 3, N) in each DirectionalLight of power 1 along unit axes (3,).

        `angles`: their angular diameters in degrees.
        """
        samples = [disc_samples(axis, angle) for axis, angle in zip(axes, angles, strict=True)]
        directions = torch.from_numpy(np.concatenate([directions for directions, _ in samples]))
        shading, gloss = self._layers(directions)
        shares = torch.block_diag(*(torch.from_numpy(np.float32(share[:, 0])) for _, share in samples))
        return self._coloured(shares @ shading, None if gloss is None else shares @ gloss)

    def _layers(self, directions: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor | None]:
        """Return shading and gloss (D, N) at the points, None without gloss, for directions (D, 3)."""
        gloss = self._field.gloss.at_pixels(directions) if self._gloss else None
        return self._field.shading.at_pixels(directions), gloss

    def _coloured(self, shading: torch.Tensor, gloss: torch.Tensor | None) -> torch.Tensor:
        """Return pictures (D, 3, N) of shading and gloss (D, N)."""
        lit = shading[:, None] * self.albedo
        return lit if gloss is None else lit + self._gloss * gloss[:, None]

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

    @property
    def drawing_size(self) -> tuple[int, int]:
        """Size (H, W) at which a cell is CELL_PIXELS wide, or that of the plate if it is smaller."""
        shrink = min(1.0, CELL_PIXELS * self._record.framing.scale / self._step)
        return reduced_size(self._record.foreground.size, shrink)

    def coverage(self, masks: torch.Tensor) -> torch.Tensor:
        """Return the share (S, N) of each point's cell that masks cover, of its part on the person.

        The masks are (S, H, W), of the plate's size, or of `drawing_size`.
        """
        drawn = self._drawn_on((masks.shape[1], masks.shape[2]))
        return self._pooled(drawn.framing.crop(masks[(..., *drawn.box)] * drawn.matte)) / drawn.inside

    def _drawn_on(self, size: tuple[int, int]) -> "_Drawing":
        """Return what masks of a size are multiplied with."""
        if size not in self._drawings:
            person, framing = self._record.foreground, self._record.framing
            box, matte = person.box, person.matte
            if size != person.size:
                whole = torch.zeros(person.size)
                whole[box], box = matte, np.s_[0 : size[0], 0 : size[1]]
                matte = F.interpolate(whole[None, None], size, mode="area")[0, 0]
                x, y = framing.shifted(person.left, person.top, person.size).centre
                down, across = (new / old for new, old in zip(size, person.size, strict=True))
                framing = Framing((x * across, y * down), framing.scale / down, framing.canvas, size)
            inside = self._pooled(framing.crop(matte[None])).clamp_min(1e-6)
            self._drawings[size] = _Drawing(box, matte, framing, inside)
        return self._drawings[size]

    def _pooled(self, layers: torch.Tensor) -> torch.Tensor:
        """Return the means (S, N) of canvas maps (S, h, w) over the points' cells."""
        pooled = F.avg_pool2d(layers, self._step, ceil_mode=True)
        return pooled.flatten(1)[:, torch.from_numpy(self._cells)]

    def _at_points(self, canvas: torch.Tensor) -> torch.Tensor:
        return canvas.flatten(1)[:, self._canvas]
