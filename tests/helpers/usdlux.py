"""A white diffuse sphere in each light: UsdLux's definition, integrated numerically, beside our lights.

A case is (the text of a prim, a function of normals (N, 3)) whose values are those of the sphere, (N,).
"""

import math

import numpy as np
import torch

RADIUS = 0.3  # metres, of the white sphere around the origin
FINE = 400


def normals(count=500):
    vectors = np.random.default_rng(5).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def stage(folder, prim):
    path = folder / "light.usda"
    path.write_text(f'#usda 1.0\n(\n metersPerUnit = 1\n upAxis = "Y"\n)\n{prim}')
    return path


def ours(light, normals):
    """The sphere's value in one of our lights, where nothing is in between: (N, 3)."""
    power = light.power
    if light.is_near:
        positions = torch.from_numpy(np.float32(normals.T * RADIUS))
        total = sum(
            irradiance * (directions * torch.from_numpy(np.float32(normals.T))).sum(dim=0).clamp_min(0)
            for directions, irradiance in light.rays(positions)
        )
        return total.numpy()[:, None] * power
    directions, intensities = light.samples()
    return (normals @ directions.T).clip(0) @ intensities


def radiated(points, areas, axes, luminance, normals):
    """The value (N,) of a white sphere under surface elements: points (M, 3), areas (M,), normals (M, 3).

    E = Σ L dA cos θ cos θ' / d², value = E / π. No element behind the sphere's own horizon is seen.
    """
    way = points[None] - normals[:, None] * RADIUS
    squared = (way**2).sum(axis=-1)
    way = way / np.sqrt(squared)[..., None]
    leaving = -(way * axes[None]).sum(axis=-1)
    facing = (way * normals[:, None]).sum(axis=-1)
    return (luminance * areas * leaving.clip(0) * facing.clip(0) / squared).sum(axis=1) / math.pi


def turned(x, y):
    """The matrix of a rotation about x, then about y, in degrees."""
    a, b = np.radians(x), np.radians(y)
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    return about_y @ about_x


def distant(angle, normalize):
    text = f"""def DistantLight "sun" {{
        float inputs:intensity = 700
        float inputs:exposure = 1
        float inputs:angle = {angle}
        bool inputs:normalize = {str(normalize).lower()}
        float3 xformOp:rotateXYZ = (-30, 40, 0)
        uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
        }}"""
    half = math.radians(angle / 2)
    luminance = 1400 / (math.pi * math.sin(half) ** 2) if normalize else 1400
    along = 1 - (1 - math.cos(half)) * (np.arange(FINE) + 0.5) / FINE
    around = 2 * math.pi * (np.arange(FINE) + 0.5) / FINE
    a, b = np.meshgrid(along, around)
    across = np.sqrt(1 - a**2)
    disc = np.stack([across * np.cos(b), across * np.sin(b), a], axis=-1).reshape(-1, 3)
    solid_angle = 2 * math.pi * (1 - math.cos(half)) / len(disc)
    directions = disc @ turned(-30, 40).T

    def expected(normals):
        return luminance * solid_angle * (normals @ directions.T).clip(0).sum(axis=1) / math.pi

    return text, expected


def moved(x, y, z):
    """The transform of a prim that stands elsewhere."""
    order = 'uniform token[] xformOpOrder = ["xformOp:translate"]'
    return f"double3 xformOp:translate = ({x}, {y}, {z})\n{order}"


def sphere(normalize):
    text = f"""def SphereLight "bulb" {{
        float inputs:intensity = 30
        float inputs:radius = 0.2
        bool inputs:normalize = {str(normalize).lower()}
        {moved(0.7, 0.9, 1.2)}
        }}"""
    luminance = 30 / (4 * math.pi * 0.2**2) if normalize else 30
    along, around = np.meshgrid(1 - 2 * (np.arange(60) + 0.5) / 60, 2 * math.pi * np.arange(90) / 90)
    across = np.sqrt(1 - along**2)
    axes = np.stack([across * np.cos(around), along, across * np.sin(around)], axis=-1).reshape(-1, 3)
    points = np.array([0.7, 0.9, 1.2]) + 0.2 * axes
    areas = np.full(len(points), 4 * math.pi * 0.2**2 / len(points))
    return text, lambda normals: radiated(points, areas, axes, luminance, normals)


def flat(kind, normalize):
    """A RectLight or DiskLight below a scale of 2."""
    text = f"""def Xform "rig" {{
      float3 xformOp:scale = (2, 2, 2)
      uniform token[] xformOpOrder = ["xformOp:scale"]
      def {kind} "panel" {{
        float inputs:intensity = 12
        float inputs:width = 0.4
        float inputs:height = 0.2
        float inputs:radius = 0.15
        bool inputs:normalize = {str(normalize).lower()}
        {moved(0, 0.1, 0.9)}
      }}
    }}"""
    steps = (np.arange(60) + 0.5) / 60
    if kind == "RectLight":
        x, y = np.meshgrid((steps - 0.5) * 0.8, (steps - 0.5) * 0.4)
        area = 0.8 * 0.4
    else:
        radius, angle = np.meshgrid(0.3 * np.sqrt(steps), 2 * math.pi * np.arange(60) / 60)
        x, y, area = radius * np.cos(angle), radius * np.sin(angle), math.pi * 0.3**2
    points = np.stack([x.ravel(), y.ravel() + 0.2, np.full(x.size, 1.8)], axis=1)
    axes = np.tile([0, 0, -1.0], (len(points), 1))
    luminance = 12 / area if normalize else 12
    areas = np.full(len(points), area / len(points))
    return text, lambda normals: radiated(points, areas, axes, luminance, normals)
