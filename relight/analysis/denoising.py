"""Take the photograph's noise off old shadows and dark cloth, before the gain of the albedo amplifies it.

Codes near black have no reliable colour: a step of the code is a large part of them, and JPEG draws their
colour in blocks. The photograph hides this. The albedo is the photograph over a small light there, which
makes brown speckles of black cloth. Noise is about even in encoded values. Two steps work on these, the
more the larger the gain is:

- a guided filter (He et al. 2013) whose guide is the lightness: colour is linear in lightness within small
  windows. Its lines come from the networks' canvas (as in the fast guided filter, He and Sun 2015);
- the smallest channel of the albedo is not darker than dyes are, if it is near black. Tone curves cut the
  small channels of dark cloth to black, which would make jeans and suits in shadow as blue as a lamp. What
  the channel lacks is added to all channels, as a surface reflects white light beside what its dye reflects
  (the dichromatic model, Shafer 1985): the colour becomes paler, and keeps its hue. Colours with clear codes
  keep what the photograph shows.

The lightness is filtered near black only, where codes are too coarse to show texture. Elsewhere it is left
alone, for the canvas does not see how much of it is fine texture.
Nothing changes where the person is lit as on average or more.
"""

import torch
import torch.nn.functional as F

from relight.analysis.upsampling import GUIDE_ENCODING, encode_guide
from shadow.framing import Framing, bounding_box

RADIUS = 3  # of the filter's windows, canvas pixels
NOISE = 0.03  # standard deviation of the noise in colour, display-encoded
DARKEST_DYE = 0.05  # albedo of the smallest channel: below it, cloth's surface reflects more than its dye
DARK_CODE = 0.15  # display-encoded: from here down to black, DARKEST_DYE comes in
KNEE = 3  # exponent of the smooth maximum of that channel and DARKEST_DYE: larger is sharper
DARK_LIGHTNESS = 0.2  # display-encoded: from here down to black, lightness comes to be filtered as well
BRIGHTEST = 1.0  # display-encoded: brighter pixels show no noise
MIN_STRENGTH = 0.02  # pixels with less are left as they are


def denoised(
    colour: torch.Tensor,
    exposure: float,
    pixels: torch.Tensor,
    framing: Framing,
    image: torch.Tensor,
    known: torch.Tensor,
    light: torch.Tensor,
) -> torch.Tensor:
    """Return the person's colour (P, 3), linear, without the noise that their albedo would amplify.

    `exposure`: factor of the colour before it is encoded. `pixels`: (P,) their indices on the plate, in
    row-major order. On the canvas, which `framing` places: `image` (3, h, w), the colour, exposed and
    encoded; `known` (h, w), where it shows the person; `light` (3, h, w), the photograph over its albedo,
    linear, about 1 on average.
    """
    level = light.mean(dim=0, keepdim=True).clamp_min(1e-12)
    # Noise in the encoded albedo is larger by level ** (-1 / GUIDE_ENCODING) than in the photograph.
    strength = (1 - level.clamp(0, 1) ** (2 / GUIDE_ENCODING)) * known
    maps = torch.cat([strength, light, *_line(image, known)])
    share = _at(strength, framing, pixels)[0]
    chosen = torch.nonzero(share > MIN_STRENGTH)[:, 0]
    seen = encode_guide(colour[chosen] * exposure)
    dark = seen.amax(dim=1) < BRIGHTEST
    chosen, seen = chosen[dark], seen[dark]
    strength, light, slope, offset = _at(maps, framing, pixels[chosen]).T.split([1, 3, 3, 3], dim=1)
    smooth = slope * seen.mean(dim=1, keepdim=True) + offset
    smooth = torch.lerp(seen, smooth, strength).clamp_min(0)
    linear = smooth**GUIDE_ENCODING / exposure
    albedo = linear / light.clamp_min(1e-12)
    code, lowest = (values.amin(dim=1, keepdim=True) for values in (smooth, albedo))
    least = strength * DARKEST_DYE * (1 - code / DARK_CODE).clamp_min(0)
    raised = (albedo + (lowest**KNEE + least**KNEE) ** (1 / KNEE) - lowest) * light
    linear = raised * linear.mean(dim=1, keepdim=True) / raised.mean(dim=1, keepdim=True).clamp_min(1e-12)
    return colour.index_copy(0, chosen, linear)


def _line(image: torch.Tensor, known: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Fit colour = slope · lightness + offset, each (3, h, w), in windows of the person's pixels.

    Near black, lightness itself is taken from such a line, whose guide it is: what varies less than the noise
    becomes its mean.
    """
    top, left, bottom, right = bounding_box(known.float())
    height, width = known.shape
    reach = 2 * RADIUS  # of two windows
    top, left = max(top - reach, 0), max(left - reach, 0)
    bottom, right = min(bottom + reach, height), min(right + reach, width)
    image, inside = image[:, top:bottom, left:right], known[None, top:bottom, left:right].float()
    lightness = image.mean(dim=0, keepdim=True)
    chroma = image - lightness
    moments = torch.cat([torch.ones_like(inside), lightness, lightness**2, chroma, lightness * chroma])
    means = _window_mean(moments * inside)
    covered = means[:1].clamp_min(1e-6)
    centre, squared, middle, product = (means[1:] / covered).split([1, 1, 3, 3])
    variance = (squared - centre**2).clamp_min(0)
    slope = (product - centre * middle) / (variance + NOISE**2)
    lost = NOISE**2 / (variance + NOISE**2) * (1 - centre / DARK_LIGHTNESS).clamp_min(0)
    line = torch.cat([slope, middle - slope * centre, 1 - lost, lost * centre])
    slope, offset, kept, base = (_window_mean(line * inside) / covered).split([3, 3, 1, 1])
    composed = torch.cat([(1 + slope) * kept, (1 + slope) * base + offset])
    slope, offset = F.pad(composed, (left, width - right, top, height - bottom)).split(3)
    return slope, offset


def _window_mean(maps: torch.Tensor) -> torch.Tensor:
    """Return means (C, h, w) of windows. One call with many maps takes far less time than one for each."""
    side = 2 * RADIUS + 1
    window = torch.full((len(maps), 1, side, side), 1 / side**2)
    return F.conv2d(maps[None], window, padding=RADIUS, groups=len(maps))[0]  # a third of avg_pool2d's time


def _at(maps: torch.Tensor, framing: Framing, pixels: torch.Tensor) -> torch.Tensor:
    """Sample canvas maps (C, h, w) at pixels (N,) of the plate, bilinearly: (C, N)."""
    width = framing.plate[1]
    place = torch.stack([pixels % width, pixels // width], dim=1) + 0.5
    size = torch.tensor(framing.canvas[::-1])
    grid = (place - torch.tensor(framing.centre)) * (2 * framing.scale / size)
    return F.grid_sample(maps[None], grid[None, None], padding_mode="border", align_corners=False)[0, :, 0]
