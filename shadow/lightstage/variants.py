"""Scans in another build and other colours, where there are few: a network that has seen a view of one often
enough knows it by heart. They are no substitute for other people (see the model card).
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from shadow.lightstage import folds, scans
from shadow.lightstage.figure import Albedo, Figure, interpolate, standing, unit
from shadow.lightstage.people import fabric

STOUTNESS = 0.08  # deviation of the logarithms of width and depth
WAVES = 6
WAVELENGTHS = 0.5, 2.0  # metres: longer than a head, so that a face stays a face
SLOPE = 0.15  # of a wave; six of them stay under 1, where space would begin to fold over
WAIST, NECK = (0.45, 0.62), (0.82, 0.86)  # where colours change, of the height
CONTRAST = 0.25  # deviation of the logarithm of the exponent of a colour
TINTS = 0.3, 0.25, 0.1  # deviation of the logarithm of a channel: below the waist, above, the head


def name(path: str | Path, number: int, folded: bool = False) -> str:
    """What a variant of a mesh file is called."""
    return f"{Path(path).stem}-variant-{number:03d}" + ("-folded" if folded else "")


def variant(path: str | Path, number: int, folded: bool = False) -> Figure:
    """A mesh file as `scans.load` takes it, as the `number`th of its variants, which is called so; `folded`:
    with folds in the mesh of its cloth (folds.py). Raises as that does."""
    figure = scans.load(path)
    rng = np.random.default_rng((number, *figure.name.encode()))
    varied = vary(figure, rng)
    return replace(folds.folded(varied, rng) if folded else varied, name=name(path, number, folded))


def vary(figure: Figure, rng: np.random.Generator) -> Figure:
    """The figure made wider or slimmer, bent by a few long waves of space, and dyed.

    Space does not fold over: what touches still touches, and nothing else meets. Colours keep the texture's
    detail, with more or less contrast.
    """
    stretch = np.exp(rng.normal(0, STOUTNESS, 3)) * [1, 0, 1] + [0, 1, 0]
    bent, jacobian = _waves(figure.vertices * stretch, rng)
    # A plane's normal goes with the inverse transpose of what moves its points.
    normals = np.linalg.solve(jacobian.transpose(0, 2, 1), (figure.normals / stretch)[..., None])[..., 0]
    tangents = figure.tangents
    if tangents is not None:  # they lie in the surface, and move as its points do
        along = np.einsum("fkij,fkj->fki", jacobian[figure.faces], tangents[..., :3] * stretch)
        tangents = np.concatenate([along, tangents[..., 3:]], axis=2).astype(np.float32)
    return replace(
        figure,
        tangents=tangents,
        vertices=standing(bent).astype(np.float32),
        normals=unit(normals).astype(np.float32),
        albedo=_dyed(figure, rng),
    )


def _waves(points: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points (V, 3) moved by WAVES random sine waves, and the Jacobian (V, 3, 3) of the motion there."""
    moved, jacobian = points.copy(), np.tile(np.eye(3), (len(points), 1, 1))
    for _ in range(WAVES):
        wavelength = np.exp(rng.uniform(*np.log(WAVELENGTHS)))
        wave = unit(rng.normal(size=3)) * 2 * np.pi / wavelength
        push = unit(rng.normal(size=3)) * SLOPE / np.linalg.norm(wave)
        phase = points @ wave + rng.uniform(0, 2 * np.pi)
        moved += np.sin(phase)[:, None] * push
        jacobian += np.cos(phase)[:, None, None] * np.outer(push, wave)
    return moved, jacobian


def _dyed(figure: Figure, rng: np.random.Generator) -> Albedo:
    """The figure's colours with another contrast and three tints: below the waist, above it, the head."""
    edges = figure.vertices[:, 1].max() * np.array([rng.uniform(*WAIST), rng.uniform(*NECK)])
    tints = np.exp(rng.normal(0, np.array(TINTS)[:, None], (3, 3)))
    contrast = np.exp(rng.normal(0, CONTRAST))

    def albedo(face: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        height = interpolate(figure.vertices[:, 1:2], figure.faces[face], barycentric)[:, 0]
        colour = figure.albedo(face, barycentric) ** contrast * tints[np.searchsorted(edges, height)]
        return np.clip(colour, fabric.DARKEST, fabric.BRIGHTEST).astype(np.float32)

    return albedo
