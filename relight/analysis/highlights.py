"""Highlights on skin, which would stay in the albedo as grey patches.

The network's gain takes the brightness of a highlight off the photograph, but not its paleness, for it has no
colour: bright skin between a highlight and its surroundings would have the right lightness and no colour. A
highlight is the light's colour on top of the skin's. So pale, bright skin takes the colour of the less bright
skin around it, at the lightness that the gain gives it. Colour is log R/G and log B/G: from that of the skin
to none is the way of a highlight. Nothing changes beside that way, or where skin is not known to be
(`relight.analysis.skin`): white cloth, hair, teeth and the whites of eyes are pale as well.
"""

import torch
import torch.nn.functional as F

from relight.media.colour import LUMINANCE

SHARE = 0.85  # of the way to the skin's colour
REACH = 0.12  # of the canvas's height: side of the window from which that colour is taken
PALE = (0.95, 0.7)  # of that colour: from the first on down it is pale, from the second fully
WHITE = (0.1, 0.25)  # below the first it is not skin, from the second on it is
ASIDE = 0.25  # log-chromaticity beside the way to white, at which the weight falls to 1/e
BRIGHT = (1.0, 1.15)  # of the skin around, display-encoded: from the second on a highlight
STEP = 4  # canvas pixels of one that is computed
FLOOR = 1e-4
LEAST = 0.02  # share of a window at which its skin counts as much as all of the person's


def tint(albedo: torch.Tensor, image: torch.Tensor, places: torch.Tensor, sure: torch.Tensor) -> torch.Tensor:
    """Return the colour (3, h, w) of highlights on skin, by which an albedo is to be divided.

    `albedo`: (3, h, w) linear. `image`: (3, h, w), the photograph, display-encoded. `places`: (h, w) in
    [0, 1], where skin may be, `sure` (h, w) where it is, whose colour is taken. The luminance of the albedo
    stays what it is, in means of STEP x STEP pixels.
    """
    paint, seen, where = (
        F.avg_pool2d(values[None], STEP)[0]
        for values in (albedo, image.clamp(0, 1), torch.stack([places, sure]))
    )
    where, certain = where.split(1)
    logs = paint.clamp_min(FLOOR).log()
    colour, bright = logs[::2] - logs[1:2], seen.mean(dim=0, keepdim=True)
    window = 2 * int(REACH * len(places) / STEP / 2) + 1
    reddish = (colour[:1] > 0.05).float() * certain
    around = _mean(torch.cat([reddish, reddish * bright]), window)
    whole = around.mean(dim=(1, 2), keepdim=True)
    around = around + LEAST * whole / whole[:1].clamp_min(1e-9)
    level = around[1:] / around[:1].clamp_min(LEAST)
    less = reddish * (bright <= level)
    counted = torch.cat([less, less * colour])
    everywhere = counted.mean(dim=(1, 2), keepdim=True)
    sums = _mean(counted, window) + LEAST * everywhere / everywhere[:1].clamp_min(1e-9)
    skin = sums[1:] / sums[:1].clamp_min(LEAST)
    length = (skin**2).sum(dim=0, keepdim=True).clamp_min(1e-3)
    along = (colour * skin).sum(dim=0, keepdim=True) / length
    aside = ((colour - along * skin) ** 2).sum(dim=0, keepdim=True)
    weight = where * torch.exp(-aside / ASIDE**2)
    for value, ends in ((along, PALE), (along, WHITE), (bright / level.clamp_min(1e-3), BRIGHT)):
        weight = weight * ((value - ends[0]) / (ends[1] - ends[0])).clamp(0, 1)
    moved = SHARE * weight * (1 - along) * skin
    colour = torch.stack([-moved[0], torch.zeros_like(moved[0]), -moved[1]]).exp()
    luminance = torch.from_numpy(LUMINANCE).float()
    before, after = (torch.einsum("c,chw->hw", luminance, each) for each in (paint, paint / colour))
    colour = colour * (after / before.clamp_min(1e-9)).where(before > 0, torch.ones(()))
    return F.interpolate(colour[None], places.shape, mode="bilinear")[0]


def _mean(maps: torch.Tensor, side: int) -> torch.Tensor:
    """Return the means (C, h, w) of windows, beyond the canvas zero."""
    rows = F.avg_pool2d(maps, (1, side), stride=1, padding=(0, side // 2))  # much faster than both at once
    return F.avg_pool2d(rows, (side, 1), stride=1, padding=(side // 2, 0))
