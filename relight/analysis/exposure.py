"""How bright lights leave a person's face, compared with the photograph.

A preset says where lamps stand and how bright they are beside each other. How bright they are in all follows
from the photograph: the face, or the person where no face is known, keeps the mean luminance that it has
there. So a person before the background of their photograph is as bright as it is.
"""

from collections.abc import Iterable

import torch

from relight.analysis.light_field import LightField
from relight.analysis.maps import AnalysisMaps, add_light
from relight.analysis.upsampling import GUIDE_ENCODING
from relight.lights.light import Light
from relight.media.colour import LUMINANCE
from shadow.networks.mirror import Pixels

MOST_PIXELS = 2000  # of the canvas that are looked at
LIMITS = (1 / 16, 16.0)  # of the factor: what is nearly black tells nothing


def gain_to_keep(
    maps: AnalysisMaps, exposure: float, face: torch.Tensor | None, lights: Iterable[Light]
) -> float:
    """Return the factor of lights with which the face is as bright as in the photograph, on average.

    `exposure`: that of the guide, `maps.image`. `face`: (h, w) bool, where it is on the canvas; None: the
    whole person counts. Linear luminance of diffuse light is compared. Raises ValueError for a near light
    that touches the person.
    """
    shown = maps.known if face is None or not (face & maps.known).any() else maps.known & face
    field, rows, columns = _sparse(maps.field, shown)
    total = torch.zeros(field.silhouette.shape.numel(), 3)
    for light in lights:
        maps.check_outside(light)
        places = maps.geometry.positions[:, rows, columns] if light.is_near else torch.empty(3, 0)
        add_light(total, field.shading, light, places)
    weights = torch.from_numpy(LUMINANCE).float()
    taken = field.silhouette.pixels
    lit = (maps.albedo[:, rows, columns].flatten(1).T * total)[taken] @ weights
    seen = (maps.image[:, rows, columns].flatten(1).T[taken] ** GUIDE_ENCODING / exposure) @ weights
    low, high = LIMITS
    return float((seen.mean() / lit.mean().clamp_min(1e-9)).clamp(low, high))


def _sparse(field: LightField, shown: torch.Tensor) -> tuple[LightField, slice, slice]:
    """Return a field of every n-th row and column of the pixels `shown` (h, w), and these."""
    step = max(1, int((int(shown.sum()) / MOST_PIXELS) ** 0.5))
    own = field.silhouette.scatter(torch.ones_like(field.sharpness))[0] > 0
    inside = shown & own
    ys, xs = inside.nonzero(as_tuple=True)
    rows = slice(int(ys.min()), int(ys.max()) + 1, step)
    columns = slice(int(xs.min()), int(xs.max()) + 1, step)
    numbers = torch.full(field.silhouette.shape, -1)
    numbers.view(-1)[field.silhouette.pixels] = torch.arange(len(field.silhouette.pixels))
    chosen = torch.where(inside, numbers, -1)[rows, columns]
    silhouette = Pixels(chosen >= 0)
    columns_of = chosen.flatten()[silhouette.pixels]
    return LightField(silhouette, *(array[:, columns_of] for array in field[1:])), rows, columns
