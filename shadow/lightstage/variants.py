"""Variants of scans, with another build and other colours.

A network that sees the same few scans often overfits to them. Variants reduce that, but do not replace other
people (see the model card).
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from shadow.lightstage import folds, scans
from shadow.lightstage.figure import Albedo, Figure, interpolate, normalize, stand_on_floor
from shadow.lightstage.people.cloth import fabric

STOUTNESS = 0.08  # standard deviation of the logarithms of width and depth
WAVES = 6
WAVELENGTHS = 0.5, 2.0  # metres, shortest and longest: longer than a head, so that faces stay plausible
SLOPE = 0.15  # of a wave; the sum over six waves stays below 1, so that space does not fold over
WAIST, NECK = (0.45, 0.62), (0.82, 0.86)  # ranges of the heights at which colours change, as shares of height
CONTRAST = 0.25  # standard deviation of the logarithm of a colour's exponent
TINTS = 0.3, 0.25, 0.1  # standard deviations of a channel's logarithm: below the waist, above it, at the head


def name(path: str | Path, number: int, folded: bool = False) -> str:
    """Return the name of a variant of a mesh file."""
    return f"{Path(path).stem}-variant-{number:03d}" + ("-folded" if folded else "")


def variant(path: str | Path, number: int, folded: bool = False, normal_map: bool = True) -> Figure:
    """Load a mesh file as the variant `number`, with folds in the mesh of its cloth if `folded` (folds.py).

    `path` and `normal_map` are those of `scans.load`, which raises ValueError for bad files.
    """
    figure = scans.load(path, normal_map)
    rng = np.random.default_rng((number, *figure.name.encode()))
    varied = vary(figure, rng)
    return replace(folds.add_folds(varied, rng) if folded else varied, name=name(path, number, folded))


def vary(figure: Figure, rng: np.random.Generator) -> Figure:
    """Return the figure made stouter or slimmer, warped by a few long waves, and recoloured.

    The warp is injective, so the surface does not intersect itself. Colours keep the detail of the texture,
    with another contrast.
    """
    stretch = np.exp(rng.normal(0, STOUTNESS, 3)) * [1, 0, 1] + [0, 1, 0]
    bent, jacobian = wave_heights(figure.vertices * stretch, rng)
    # Normals transform by the inverse transpose of the Jacobian.
    normals = np.linalg.solve(jacobian.transpose(0, 2, 1), (figure.normals / stretch)[..., None])[..., 0]
    tangents = figure.tangents
    if tangents is not None:  # tangents transform by the Jacobian
        along = np.einsum("fkij,fkj->fki", jacobian[figure.faces], tangents[..., :3] * stretch)
        tangents = np.concatenate([along, tangents[..., 3:]], axis=2).astype(np.float32)
    return replace(
        figure,
        tangents=tangents,
        vertices=stand_on_floor(bent).astype(np.float32),
        normals=normalize(normals).astype(np.float32),
        albedo=_dyed(figure, rng),
    )


def wave_heights(points: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Displace points (V, 3) by WAVES random sine waves; also returns the Jacobian (V, 3, 3) of the warp."""
    moved, jacobian = points.copy(), np.tile(np.eye(3), (len(points), 1, 1))
    for _ in range(WAVES):
        wavelength = np.exp(rng.uniform(*np.log(WAVELENGTHS)))
        wave = normalize(rng.normal(size=3)) * 2 * np.pi / wavelength
        push = normalize(rng.normal(size=3)) * SLOPE / np.linalg.norm(wave)
        phase = points @ wave + rng.uniform(0, 2 * np.pi)
        moved += np.sin(phase)[:, None] * push
        jacobian += np.cos(phase)[:, None, None] * np.outer(push, wave)
    return moved, jacobian


def _dyed(figure: Figure, rng: np.random.Generator) -> Albedo:
    """Return the figure's albedo with another contrast, and tints below the waist, above it, at the head."""
    edges = figure.vertices[:, 1].max() * np.array([rng.uniform(*WAIST), rng.uniform(*NECK)])
    tints = np.exp(rng.normal(0, np.array(TINTS)[:, None], (3, 3)))
    contrast = np.exp(rng.normal(0, CONTRAST))

    def albedo(face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        height = interpolate(figure.vertices[:, 1:2], figure.faces[face], barycentric)[:, 0]
        colour = figure.albedo(face, barycentric) ** contrast * tints[np.searchsorted(edges, height)]
        return np.clip(colour, fabric.DARKEST, fabric.BRIGHTEST).astype(np.float32)

    return albedo
