"""Trimmings that are added to a draped garment: collars and buttons."""

import numpy as np

from shadow.lightstage.figure import normalize, vertex_normals
from shadow.lightstage.mesh import add_lining, boundary_chains, loft, longest_run
from shadow.lightstage.people.body.anatomy import Person
from shadow.lightstage.people.cloth.draping import fold_noise
from shadow.lightstage.people.cloth.fabric import Fabric, MeshPart
from shadow.lightstage.people.cloth.tailoring import Garment


def collar(
    person: Person, garment: Garment, tall: float, kind: str, fabric: Fabric, rng: np.random.Generator
) -> list[MeshPart]:
    """Return a collar of height `tall` at the neckline, if there is one.

    kind: "stand"; "fold", down over the shoulders; or "hood", a folded collar that is deep at the back.
    """
    posed, faces, rest = garment
    throat = person.skeleton.head("neck01")
    chain = max(boundary_chains(faces), key=lambda c: rest[c, 1].max())
    chain = longest_run(chain, rest[chain, 1] > throat[1] - 0.16)
    closed = chain[0] == chain[-1]
    ring = chain[:-1] if closed else chain
    if len(ring) < 8:
        return []
    chest = person.bone("spine01")[:, :3]
    up = normalize(chest @ np.array([0.0, 1.0, 0.12]))
    here = posed[ring]
    centre = here.mean(axis=0)
    out = here - centre
    out = normalize(out - (out @ up)[:, None] * up)
    back = np.clip(0.5 - 0.5 * out @ (chest @ np.array([0.0, 0.0, 1.0])), 0, 1)[:, None]
    wave = 1 + 0.1 * fold_noise(rest[ring], rng, 0.15)[:, None]
    # Metres outward, and height as a share of `tall`, of each ring of the band.
    profile = {
        "stand": [(0.001, 0.35), (0.002, 0.7), (0.004, 1.0), (0.001, 1.04), (-0.003, 1.0), (-0.004, 0.3)],
        "fold": [
            (-0.002, 0.5),
            (0.0, 0.95),
            (0.005, 1.06),
            (0.011, 0.95),
            (0.016, 0.5),
            (0.022, -0.05),
            (0.026, -0.3),
            (0.02, -0.28),
        ],
        "hood": [
            (0.01, 0.5),
            (0.03, 0.95),
            (0.055, 0.9),
            (0.075, 0.5),
            (0.075, 0.0),
            (0.06, -0.4),
            (0.03, -0.5),
        ],
    }[kind]
    share = 0.25 + 0.75 * back**1.5 if kind == "hood" else 1.0
    rings = np.stack(
        [here]
        + [
            here + out * metres * (share if kind == "hood" else 1) * wave + up * tall * height * share
            for metres, height in profile
        ]
    )
    band = loft(rings, closed)
    if kind != "stand":
        band = band[:, ::-1]  # folded outward, so that the inner side is visible
    vertices, band, source = add_lining(rings.reshape(-1, 3), band, 0.0025, 1.0)
    source = np.tile(ring, len(rings))[source]
    return [MeshPart(vertices, band, rest[source], fabric)]


def buttons(
    garment: Garment, low: float, high: float, gap: float, rng: np.random.Generator
) -> list[MeshPart]:
    """Return buttons down the front between two heights. gap: half the width of an open front, or 0."""
    posed, faces, rest = garment
    normals = vertex_normals(posed, faces)
    front = np.flatnonzero(rest[:, 2] > 0)
    angle = np.linspace(0, 2 * np.pi, 14, endpoint=False)
    radius = rng.uniform(0.005, 0.009)
    # From the rim at the cloth over the edge to a slightly sunken centre.
    profile = [(1.0, -0.002), (1.0, 0.002), (0.8, 0.003), (0.4, 0.0022), (0.02, 0.0022)]
    disc = (
        np.stack([[(r * np.cos(a), r * np.sin(a), h / radius) for a in angle] for r, h in profile]) * radius
    )
    disc_faces = loft(disc, closed=True)[:, ::-1]
    sewn = []
    fabric = Fabric.plain(rng.choice([0.03, 0.3, 0.7]) * np.ones(3))
    for height in np.arange(high, low, -rng.uniform(0.07, 0.11)):
        aim = np.array([gap + 0.016 if gap else 0.0, height])
        off = np.linalg.norm(rest[front][:, :2] - aim, axis=1)
        at = front[np.argmin(off)]
        if off.min() > 0.012:
            continue
        normal = normals[at]
        side = normalize(np.cross([0.0, 1.0, 0.0], normal))
        axes = np.stack([side, np.cross(normal, side), normal])
        points = posed[at] + disc.reshape(-1, 3) @ axes
        unposed = np.tile(rest[at], (len(points), 1))
        sewn.append(MeshPart(points, disc_faces, unposed, fabric, sewn=True))
    return sewn
