"""Highlights on skin, which would stay in the albedo as grey patches.

The network's gain takes the brightness of a highlight off the photograph, but not its paleness, for it has no
colour: bright skin between a highlight and its surroundings would have the right lightness and no colour. A
highlight is the light's colour on top of the skin's. So pale, bright skin takes the colour of the less bright
skin around it, at the lightness that the gain gives it. Colour is log R/G and log B/G: from that of the skin
to none is the way of a highlight. Nothing changes beside that way, or where skin is not known to be
(`relight.analysis.skin`): white cloth, hair, teeth and the whites of eyes are pale as well. Limbs may be in
sleeves, and hair hangs into a face, so skin is what has about the colour of the face.
"""

import torch
import torch.nn.functional as F

from relight.analysis.skin import Skin
from relight.media.colour import LUMINANCE

SHARE = 0.85  # of the way to the skin's colour
REACH = 0.12  # of the canvas's height: side of the window from which that colour is taken
PALE = (0.95, 0.7)  # of that colour: from the first on down it is pale, from the second fully
WHITE = (0.1, 0.25)  # below the first it is not skin, from the second on it is
REDDISH = 0.15  # least log R/G of skin, even in cold light
BARE = (0.3, 0.6)  # share of a window's dim pixels with the colour of skin: below the first it is in a sleeve
LIKE_FACE = 0.35  # log-chromaticity from the face's, at which the trust in other skin falls to 1/e
ASIDE = 0.25  # log-chromaticity beside the way to white, at which the weight falls to 1/e
BRIGHT = (1.0, 1.15)  # of the skin around, display-encoded: from the second on a highlight
STEP = 4  # canvas pixels of one that is computed
FLOOR = 1e-4
LEAST = 0.02  # share of a window at which it counts as much as all of the person


def tint(albedo: torch.Tensor, image: torch.Tensor, seen: Skin) -> torch.Tensor:
    """Return the colour (3, h, w) of highlights on skin, by which an albedo is to be divided.

    `albedo`: (3, h, w) linear. `image`: (3, h, w), the photograph, display-encoded. The luminance of the
    albedo stays what it is, in means of STEP x STEP pixels. Without a face there is no highlight.
    """
    paint = F.avg_pool2d(torch.cat([albedo, image.clamp(0, 1)])[None], STEP)[0]
    paint, picture = paint.split(3)
    where, certain, face = (each[None, ::STEP, ::STEP] for each in (seen.places, seen.sure, seen.face))
    if not face.any():
        return torch.ones_like(albedo)
    logs = paint.clamp_min(FLOOR).log()
    colour, bright = logs[::2] - logs[1:2], picture.mean(dim=0, keepdim=True)
    dim_face = (face & (bright <= bright[face].median()))[0]
    own = colour[:, dim_face].median(dim=1).values[:, None, None]
    if own[0] < REDDISH or own[1] > 0:  # hair, or a mask
        return torch.ones_like(albedo)
    window = 2 * int(REACH * len(seen.places) / STEP / 2) + 1
    likely = certain * _like(colour - own, LIKE_FACE)
    level = _weighted_mean(bright, likely, window)
    dim = (bright <= level).float()
    skin = _weighted_mean(colour, likely * dim, window)
    bare = _weighted_mean(_like(colour - own, LIKE_FACE), certain * dim, window)
    length = (skin**2).sum(dim=0, keepdim=True).clamp_min(1e-3)
    along = (colour * skin).sum(dim=0, keepdim=True) / length
    weight = where * _like(colour - along * skin, ASIDE)
    bounds = (along, PALE), (along, WHITE), (bright / level.clamp_min(1e-3), BRIGHT), (bare, BARE)
    for value, (none, full) in bounds:
        weight = weight * ((value - none) / (full - none)).clamp(0, 1)
    moved = SHARE * weight * (1 - along) * skin
    colour = torch.stack([-moved[0], torch.zeros_like(moved[0]), -moved[1]]).exp()
    luminance = torch.from_numpy(LUMINANCE).float()
    before, after = (torch.einsum("c,chw->hw", luminance, each) for each in (paint, paint / colour))
    colour = colour * (after / before.clamp_min(1e-9)).where(before > 0, torch.ones(()))
    return F.interpolate(colour[None], seen.places.shape, mode="bilinear")[0]


def _like(difference: torch.Tensor, scale: float) -> torch.Tensor:
    """Return the weight (1, h, w) of a difference (2, h, w) in log-chromaticity: 1/e at `scale`."""
    return torch.exp(-(difference**2).sum(dim=0, keepdim=True) / scale**2)


def _weighted_mean(maps: torch.Tensor, weight: torch.Tensor, side: int) -> torch.Tensor:
    """Return weighted means (C, h, w) in windows; where they have little weight, that of everything."""
    sums = torch.cat([maps * weight, weight])
    rows = F.avg_pool2d(sums, (1, side), stride=1, padding=(0, side // 2))  # much faster than both at once
    means = F.avg_pool2d(rows, (side, 1), stride=1, padding=(side // 2, 0))
    whole = sums.mean(dim=(1, 2), keepdim=True)
    means = means + LEAST * whole / whole[-1:].clamp_min(1e-9)
    return means[:-1] / means[-1:].clamp_min(1e-9)
