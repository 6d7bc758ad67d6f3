"""A record of a sphere, whose visibility and normals are known exactly."""

import numpy as np

from shadow import directions
from shadow.data.records import Record


def sphere(size=96, radius=0.8, behind=True):
    """A white-to-red unit sphere seen along -z without perspective: it casts no shadow on itself."""
    step = (np.arange(size) + 0.5) * 2 / size - 1
    x, y = np.meshgrid(step / radius, -step / radius)
    mask = x**2 + y**2 < 0.98
    normals = np.stack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))], axis=-1)[mask]
    albedo = np.stack(
        [np.full(len(normals), 0.8), normals[:, 2] * 0.5 + 0.3, np.full(len(normals), 0.4)], axis=1
    )
    lights = directions.olat(behind)
    depth = -normals[:, 2:] / 2  # a sphere is twice its radius high
    lit = normals @ lights.T > 0
    about = {"figure": "sphere"}
    return Record.of(mask, normals, albedo, lit, lights, about, depth=depth - depth.mean())
