"""The colour of the light in which a person was photographed, so that it leaves the albedo.

The network's gain is grey: it takes shading and shadow off the photograph, but not the difference in colour
between the lights. Where the sun is warm and the sky blue, old shadows would stay in the albedo as blue
patches. The model of the light's log-chromaticity (log R/G, log B/G) at a pixel has three parts:

- two lights: a key, and an ambient light that reaches all pixels alike. The key's share of a pixel's light
  follows from how much brighter the pixel is lit than the darkest ones, and, once the colours of both are
  fitted, from the pixel's colour (`relight.analysis.key_share`);
- a change with the normal, for lamps of different colours on different sides;
- a slope of saturation with the light's level, for the tone curve of a camera.

The tone curve saturates what is dark in the photograph, be it in shadow or dark itself. Colours in the
brightest light stay as the photograph shows them, the others become less saturated, never more: a gain of
the albedo would otherwise make ultramarine of navy cloth.

It is fitted to pairs of near pixels of similar albedo, which most often show one material: their difference
in colour is that of the light. Reweighting leaves out the other pairs (iteratively reweighted least squares
with Cauchy's weights, inside Gauss-Newton). Where lamps explain little, the slope is fitted alone. Saturated
colours, which cameras cut to their gamut, show the slope but not the lamps' colour, and keep that. Lightness
stays as the network gives it.
"""

from typing import NamedTuple

import numpy as np
import torch

from relight.analysis.key_share import REACH, RESIDUAL, SIMILAR_ALBEDO, by_colour
from relight.media.colour import LUMINANCE

PAIRS = 12_000
AMBIENT_QUANTILE = 0.15  # of the light's level: at or below it, the ambient light is alone
FIRST_RESIDUAL = 0.4  # at the first step, so that a strong colour is not taken for another material
STEPS = 12
MAX_STEP = 0.5
AMBIENT_RIDGE, NORMAL_RIDGE, SATURATION_RIDGE = 1e-3, 2e-3, 5e-3  # a pair; draw what is not seen to zero
MAX_COLOUR, MAX_SATURATION = 1.5, 0.8
MIN_EXPLAINED = 0.15  # share of the differences in colour that the light explains; neutral lights reach 0.14
MIN_EXPLAINED_BY_CURVE = 0.02  # the same by the tone curve alone; pictures without one reach 0.00
BRIGHT_QUANTILE = 0.65  # of the light's level: there colours keep their saturation
DARK_CLOTH = 0.75  # exponent of the albedo's luminance, by which dark cloth loses saturation as shadows do
MIDDLE_ALBEDO = 0.25  # its luminance, from which up cloth is not dark
LEAST_SATURATION = 0.35  # factor
MIN_PAIRS = 500
DARKEST = 0.02  # display-encoded: darker pixels have no reliable colour
SATURATED = (1.5, 3.0)  # log of the largest channel over the smallest: trust falls from 1 to 0
NEARLY_CLIPPED = 0.98  # relative to the brightest pixel, display-encoded
FLOOR = 1e-4  # linear


class OldLight(NamedTuple):
    """The light's colour over a photographed person. The default is a light of one colour."""

    ambient: tuple[float, float] = (0.0, 0.0)  # log-chromaticity of the ambient light relative to the key
    slopes: tuple[float, ...] = (0.0,) * 6  # of log R/G along the normal's x, y, z, then of log B/G
    saturation: float = 0.0  # share by which saturation falls a factor e of light
    ambient_level: float = 1.0  # grey light at which the ambient light is alone, relative to the photograph's
    bright_level: float = 1.0  # from here up, colours keep their saturation
    middle: tuple[float, float] = (0.0, 0.0)  # median log-chromaticity of the light, which the albedo keeps
    lightness: float = 1.0  # factor of the albedo, see `relight.analysis.lightness`

    def tint(
        self, light: torch.Tensor, albedo: torch.Tensor, normals: torch.Tensor, known: torch.Tensor
    ) -> torch.Tensor:
        """Return the colour of the light (3, h, w), by which the albedo is to be divided.

        `light`: (3, h, w) the photograph over its albedo, linear. `albedo`: (3, h, w) linear, photograph
        times grey gain; divided by the tint it keeps its luminance. `normals`: (3, h, w) unit vectors, camera
        frame. `known`: (h, w) where they show the person.
        """
        if self._replace(lightness=1.0) == OldLight():
            return torch.ones_like(albedo)
        share = self._share(light)
        if any(self.ambient):
            colours = _chromaticity(albedo) - self._turned(normals)
            share = by_colour(share, self.ambient, colours, _trust(albedo), _luminance(albedo)[0], known)
        return self._tint(share, light, albedo, normals)

    def _share(self, light: torch.Tensor) -> torch.Tensor:
        """Return the key's share (h, w) of the light by its brightness."""
        return (1 - self.ambient_level / light.mean(dim=0).clamp_min(1e-12)).clamp_min(0)

    def _turned(self, normals: torch.Tensor) -> torch.Tensor:
        """Return how the light's log-chromaticity (2, h, w) changes with the normal."""
        return torch.einsum("cn,nhw->chw", torch.tensor(self.slopes).view(2, 3), normals)

    def _tint(
        self, share: torch.Tensor, light: torch.Tensor, albedo: torch.Tensor, normals: torch.Tensor
    ) -> torch.Tensor:
        """Return the colour of the light as `tint` does, for a key's share (h, w)."""
        level = light.mean(dim=0).clamp_min(1e-12)
        ambient = torch.tensor(self.ambient).view(2, 1, 1)
        colour = (share + (1 - share) * ambient.exp()).log() + self._turned(normals)
        colour = (colour - torch.tensor(self.middle).view(2, 1, 1)) * _trust(albedo)
        cloth = (_luminance(albedo)[0] / MIDDLE_ALBEDO).clamp_max(1) ** DARK_CLOTH
        kept = ((level / self.bright_level * cloth) ** self.saturation).clamp(LEAST_SATURATION, 1)
        colour = colour + (_chromaticity(albedo) - colour) * (1 - kept)
        tint = torch.stack([colour[0], torch.zeros_like(level), colour[1]]).exp()
        return tint * (_luminance(albedo / tint) / _luminance(albedo))

    @classmethod
    def fit(
        cls,
        photograph: torch.Tensor,
        light: torch.Tensor,
        albedo: torch.Tensor,
        normals: torch.Tensor,
        known: torch.Tensor,
    ) -> "OldLight":
        """Fit the light of a photograph (3, h, w), exposed and display-encoded, of a person.

        `known` (h, w) is where it shows them; the other arguments are those of `tint`. If the colour of the
        light is not seen to vary, the result is `OldLight()`, which changes nothing.
        """
        level = light.mean(dim=0).clamp_min(1e-12)
        brightest = photograph.amax(dim=0)
        clipped = brightest > NEARLY_CLIPPED * brightest[known].max()
        reliable = known & ~clipped & (photograph.amin(dim=0) > DARKEST)
        pairs = torch.from_numpy(_pairs(_luminance(albedo)[0].log().numpy(), reliable.numpy()))
        if pairs.shape[1] < MIN_PAIRS:
            return cls()
        levels, normal, paint = (values.flatten(-2)[..., pairs] for values in (level, normals, albedo))
        quantiles = np.quantile(level[known].numpy(), (AMBIENT_QUANTILE, BRIGHT_QUANTILE))
        ambient_level, bright_level = (float(value) for value in quantiles)
        share = (1 - ambient_level / levels).clamp_min(0)
        seen = share, normal, _chromaticity(paint), -levels.log(), _trust(paint).amin(dim=0)
        shares, turns, colours, gains, trust = (values.double().numpy() for values in seen)
        solution, explained = _solve(shares, turns, colours, gains, trust)
        if explained < MIN_EXPLAINED:
            solution, explained = _solve(shares, turns, colours, gains, np.zeros_like(trust))
        if explained < MIN_EXPLAINED_BY_CURVE:
            return cls()
        values = [float(value) for value in solution]
        found = cls((values[0], values[1]), tuple(values[2:8]), values[8], ambient_level, bright_level)
        tint = found._replace(saturation=0.0)._tint(found._share(light), light, albedo, normals)
        red, blue = (float(channel[known].median()) for channel in _chromaticity(tint))
        return found._replace(middle=(red, blue))


def _pairs(log_albedo: np.ndarray, reliable: np.ndarray) -> np.ndarray:
    """Draw pairs of near pixels of similar albedo: (2, N) indices into the canvas, the same each time."""
    rows, columns = np.nonzero(reliable)
    if not len(rows):
        return np.zeros((2, 0), int)
    rng = np.random.default_rng(0)
    reach = REACH * (np.ptp(rows) + 1)
    first = rng.integers(len(rows), size=PAIRS)
    down, right = np.rint(rng.uniform(-reach, reach, (2, PAIRS))).astype(int)
    y, x = rows[first] + down, columns[first] + right
    height, width = reliable.shape
    inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
    pairs = np.stack([rows[first] * width + columns[first], y * width + x])[:, inside]
    pairs = pairs[:, reliable.ravel()[pairs[1]]]
    return pairs[:, np.abs(np.subtract(*log_albedo.ravel()[pairs])) < SIMILAR_ALBEDO]


def _solve(
    shares: np.ndarray, normals: np.ndarray, colours: np.ndarray, gains: np.ndarray, trust: np.ndarray
) -> tuple[np.ndarray, float]:
    """Fit the model to pairs: shares of the key (2, N), normals (3, 2, N), log-chromaticity (2, 2, N), gains,
    and how far (N,) the pairs show the light's colour.

    Returns the nine unknowns in the order of `OldLight`, and the share of the colours' differences, squared,
    that they explain.
    """
    differences = colours[:, 0] - colours[:, 1]
    turned, ascent = normals[:, 0] - normals[:, 1], (gains[0] - gains[1]) * colours.mean(axis=1)
    ridge = shares.shape[1] * np.repeat([AMBIENT_RIDGE, NORMAL_RIDGE, SATURATION_RIDGE], [2, 6, 1])
    low = np.r_[np.full(8, -MAX_COLOUR), 0]
    high = np.r_[np.full(8, MAX_COLOUR), MAX_SATURATION]
    # Five of the unknowns matter to a channel: its ambient light, its change with the normal, the slope.
    places = [np.r_[channel, 2 + 3 * channel : 5 + 3 * channel, 8] for channel in range(2)]
    jacobians = [np.vstack([trust, trust * turned, ascent[channel]]) for channel in range(2)]
    solution = np.zeros(9)
    left = seen = 0.0
    for step in range(STEPS + 1):
        hessian, gradient, left, seen = np.diag(ridge), -ridge * solution, 0.0, 0.0
        scale = max(RESIDUAL, FIRST_RESIDUAL * 0.7**step)
        for channel, (place, jacobian) in enumerate(zip(places, jacobians, strict=True)):
            ambient = np.exp(solution[channel])
            light = shares + (1 - shares) * ambient
            jacobian[0] = trust * np.subtract(*(1 - shares / light))
            residual = differences[channel] - trust * np.log(light[0] / light[1])
            residual -= solution[place[1:]] @ jacobian[1:]
            weights = 1 / (1 + (residual / scale) ** 2)
            weighted = weights * jacobian
            hessian[np.ix_(place, place)] += weighted @ jacobian.T
            gradient[place] += weighted @ residual
            left += float(weights @ residual**2)
            seen += float(weights @ differences[channel] ** 2)
        if step < STEPS:
            update = np.linalg.solve(hessian, gradient).clip(-MAX_STEP, MAX_STEP)
            solution = (solution + update).clip(low, high)
    return solution, 1 - left / seen if seen > 1e-12 * shares.size else 0.0


def _chromaticity(colours: torch.Tensor) -> torch.Tensor:
    """Return log R/G and log B/G (2, h, w) of linear colours (3, h, w)."""
    logs = colours.clamp_min(FLOOR).log()
    return logs[::2] - logs[1:2]


def _trust(albedo: torch.Tensor) -> torch.Tensor:
    """Return how far colours (3, h, w) show that of the light: (h, w) in [0, 1].

    Cameras cut saturated colours to their gamut, so that the small channels show neither cloth nor light.
    """
    spread = (albedo.amax(dim=0).clamp_min(FLOOR) / albedo.amin(dim=0).clamp_min(FLOOR)).log()
    low, high = SATURATED
    return ((high - spread) / (high - low)).clamp(0, 1)


def _luminance(colours: torch.Tensor) -> torch.Tensor:
    """Return the luminance (1, h, w) of linear colours (3, h, w), above zero."""
    weights = torch.from_numpy(LUMINANCE).to(colours)
    return torch.einsum("c,chw->hw", weights, colours.clamp_min(FLOOR))[None]
