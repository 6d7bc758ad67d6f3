"""A photograph without its person, behind the relit one: nothing of the old picture shows at the edge."""

from collections.abc import Iterator

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import ArrayLike
from scipy.ndimage import uniform_filter

from relight.matting.refine import OPAQUE, OPAQUE_SHARE
from relight.media.images import scene_linear, without_empty_alpha
from relight.media.resampling import fill_unknown

GROWN = 0.006  # of the person's longer side, by which the matte is grown: its edge is off by as much
COVERED = (
    0.05  # coverage up to which a pixel beyond the grown matte keeps its code: noise, a compressed matte
)
MARGIN = 0.05  # of that side, of the surroundings from which the picture is continued
CELLS = 3  # that the growth is divided into, for the mean along the edge
ALONG = 15  # cells of that mean
COHERENT = (
    0.3,
    0.7,
)  # share of what there is that the mean along the edge explains: none, and all, of a line
MOSTLY = (0.3, 0.8)  # from the first coverage on the background hardly shows, from the second on not at all
LACKING = (0.3, 0.8)  # share of the person in what a matte leaves free: a right one, and one too low
SOLID = 0.9995  # coverage that is whole
BACKGROUND_VARIANCE = 3.0  # of the continued surroundings, relative to that of the person's own colour


def checked_plate(image: ArrayLike, size: tuple[int, int]) -> np.ndarray:
    """Return a photograph (H, W, 3) as linear Rec.709; raises as `Subject.clean_plate` does."""
    plate = without_empty_alpha("image", scene_linear("image", image))
    if plate.shape[:2] != size:
        raise ValueError(f"image: expected the subject's size {size}, got {plate.shape[:2]}")
    if plate.shape[-1] == 4 and (plate[..., 3] >= OPAQUE).mean() < OPAQUE_SHARE:
        raise ValueError("image: expected a photograph without transparency: nothing is behind this person")
    return plate[..., :3]


def clean_plate(plate: np.ndarray, coverage: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """Take the person out of a photograph: (H, W, 3) float32, linear Rec.709.

    `plate`: (H, W, 3), linear. `coverage`: (H, W) in [0, 1], the person's. `colour`: (H, W, 3), their own
    colour, linear, where there is coverage. Beyond the matte, grown by 0.6 % of the person's longer side, all
    pixels are unchanged.

    Under the grown matte the surroundings are continued, W. What the photograph has there besides,
    D = plate - (alpha · colour + (1 - alpha) · W), is texture of the surroundings, or hair that the matte
    lacks, and stays, unless it goes on along the edge: a line of the old picture, where the matte is too
    tight. It is shared with the person's colour as in Bayesian matting (Chuang et al. 2001). So a picture lit
    as the photograph is nearly the photograph, and nothing is blurred.
    """
    covered = coverage > COVERED
    if not covered.any():
        return plate
    rows, columns = (np.flatnonzero(covered.any(axis=axis)) for axis in (1, 0))
    side = max(rows[-1] - rows[0], columns[-1] - columns[0]) + 1
    radius = max(1, round(GROWN * side))
    margin = radius + max(8, round(MARGIN * side))
    box = tuple(slice(max(0, span[0] - margin), span[-1] + margin + 1) for span in (rows, columns))
    hidden = _grown(torch.from_numpy(covered[box]).float(), radius).numpy() > 0
    if hidden.all():
        return plate
    cleaned = plate.copy()
    cleaned[box] = _without(plate[box], coverage[box], colour[box], hidden, radius)
    return cleaned


def _without(
    plate: np.ndarray, coverage: np.ndarray, colour: np.ndarray, hidden: np.ndarray, radius: int
) -> np.ndarray:
    """See `clean_plate`; `hidden`: (h, w), where the plate is not known."""
    alpha = coverage[..., None]
    around = fill_unknown(plate, ~hidden)
    rest = (plate - alpha * colour - (1 - alpha) * around) * hidden[..., None]
    rest *= 1 - _lines_along_edge(rest, coverage, hidden, radius)[..., None]
    share = BACKGROUND_VARIANCE * (1 - alpha)
    behind = (around + share / (alpha**2 + share * (1 - alpha)) * rest).clip(0)
    # Where the photograph shows more of the person than the matte says, the matte is too low there, and the
    # surroundings would show through a person who is lit from elsewhere. The darker of both does not show.
    tight = _smoothstep(alpha, *MOSTLY) * _smoothstep(_lacking(plate, alpha, colour, around), *LACKING)
    behind += tight * (np.minimum(plate, behind) - behind)
    behind = np.where(alpha < SOLID, behind, around)
    return np.where(hidden[..., None], behind, plate)


def _lacking(plate: np.ndarray, alpha: np.ndarray, colour: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Return which share of what the matte leaves free is the person's (h, w, 1): 0 where it is right.

    It follows from where the photograph's colour lies between those of the surroundings and of the person.
    """
    toward = colour - around
    explained = ((plate - around) * toward).sum(axis=-1, keepdims=True)
    coverage = explained / np.maximum((toward**2).sum(axis=-1, keepdims=True), 1e-6)
    return ((coverage - alpha) / np.maximum(1 - alpha, 1e-3)).clip(0, 1)


def _lines_along_edge(rest: np.ndarray, coverage: np.ndarray, hidden: np.ndarray, radius: int) -> np.ndarray:
    """Return where what there is, (h, w, 3), goes on along the matte's edge: (h, w), 0 to 1.

    At each distance from the edge its mean along it is compared with all there is: it is most of a line, and
    little of texture and single hairs.
    """
    cell = max(1, radius // CELLS)
    weighted = np.dstack([rest, (rest**2).sum(axis=-1), hidden]).astype(np.float32)
    planes = torch.from_numpy(weighted).permute(2, 0, 1)
    planes = F.avg_pool2d(planes[None], cell, ceil_mode=True, count_include_pad=False)[0]
    solid = F.avg_pool2d(torch.tensor(coverage)[None, None], cell, ceil_mode=True)[0, 0] > 0.5
    lines = torch.zeros(solid.shape)
    for band in _bands(solid, CELLS + 1):
        sums = np.stack([uniform_filter(plane, ALONG) for plane in (planes * band).numpy()])
        mean, energy = sums[:3], np.maximum(sums[3] * sums[4], 1e-12)
        coherence = torch.from_numpy(_smoothstep((mean**2).sum(axis=0) / energy, *COHERENT))
        lines = torch.maximum(lines, coherence * (band > 0) * (planes[4] > 0))
    enlarged = F.interpolate(_grown(lines, 1)[None, None], scale_factor=cell, mode="bilinear")
    return enlarged[0, 0].numpy()[: rest.shape[0], : rest.shape[1]]


def _smoothstep(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return 0 below `low`, 1 above `high`, and a smooth step between."""
    share = ((values - low) / (high - low)).clip(0, 1)
    return share * share * (3 - 2 * share)


def _bands(solid: torch.Tensor, count: int) -> Iterator[torch.Tensor]:
    """Yield the cells (h, w) at each distance from a region: its own edge, 1 away, 2..., and all the rest."""
    taken = solid.float()
    yield taken - (1 - _grown(1 - taken, 1))
    for step in range(count):
        grown = _grown(taken, 1) if step < count - 1 else torch.ones_like(taken)
        yield grown - taken
        taken = grown


def _grown(pixels: torch.Tensor, radius: int) -> torch.Tensor:
    """Return the largest value (h, w) in squares of `radius` pixels around each."""
    side = 2 * radius + 1
    rows = F.max_pool2d(pixels[None, None], (side, 1), stride=1, padding=(radius, 0))
    return F.max_pool2d(rows, (1, side), stride=1, padding=(0, radius))[0, 0]
