"""Mitsuba's path tracer, one light at a time: the reference for bounce.py."""

from types import ModuleType
from typing import Any

import numpy as np

from shadow.lightstage.figure import Figure
from shadow.lightstage.stage import View


def path_trace(
    figure: Figure, view: View, size: int, light: np.ndarray, *, samples: int = 32, bounces: int = 4
) -> np.ndarray:
    """Path-trace the diffuse shading of one view in one light (Section 3).

    The albedo is sampled at the corners of the triangles and interpolated, so bounce light does not see
    texture that is finer than the mesh. Mitsuba's scalar variant is slow, but it does not need LLVM, of which
    an incompatible version ends the process.

    `figure`: the figure, in metres. `view`: the camera. `size`: side of the square image in pixels. `light`:
    (3,) unit direction to a distant light of intensity 1, in the camera frame. `samples`: paths for each
    pixel. `bounces`: bounces after the first hit; 0 is direct light only.

    Returns (H, W, 3) float32, linear Rec.709, divided by the albedo of the first hit: 1 is a surface that
    faces the unoccluded light and receives no other light. NaN where the camera sees nothing.
    """
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    origin, axes = view.position(), view.rotation()
    sensor = mi.ScalarTransform4f().look_at(
        origin=origin.tolist(), target=(origin - axes[2]).tolist(), up=axes[1].tolist()
    )
    aovs = {"type": "aov", "aovs": "albedo:albedo"}
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": aovs | {"path": {"type": "path", "max_depth": bounces + 2, "rr_depth": 99}},
            "sensor": {
                "type": "perspective",
                "fov": view.fov,
                "to_world": sensor,
                "film": {
                    "type": "hdrfilm",
                    "width": size,
                    "height": size,
                    "pixel_format": "rgba",
                    "rfilter": {"type": "box"},
                },
                "sampler": {"type": "independent", "sample_count": samples},
            },
            "light": {"type": "directional", "direction": (-(axes.T @ light)).tolist(), "irradiance": 1.0},
            "figure": _mesh(mi, figure),
        }
    )
    image = np.array(mi.render(scene))
    radiance, alpha, albedo = image[..., :3], image[..., 3:4], image[..., 4:7]
    # A diffuse reflectance ρ turns the irradiance E into the radiance E ρ / π.
    return np.where(alpha > 0.5, np.pi * radiance / albedo.clip(1e-4), np.nan)


def _mesh(mi: ModuleType, figure: Figure) -> Any:
    """Convert the figure to a two-sided Mitsuba mesh with separate vertices for each triangle's albedo."""
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(
        {
            "type": "twosided",
            "diffuse": {
                "type": "diffuse",
                "reflectance": {"type": "mesh_attribute", "name": "vertex_color"},
            },
        }
    )
    count = len(figure.faces)
    mesh = mi.Mesh(figure.name, 3 * count, count, properties, has_vertex_normals=True)
    mesh.add_attribute("vertex_color", 3, [0.0] * (9 * count))
    face, corner = np.repeat(np.arange(count), 3), np.tile(np.eye(3), (count, 1))
    flat = figure.faces.flatten()
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = figure.vertices[flat].astype(np.float32).ravel()
    parameters["vertex_normals"] = figure.normals[flat].astype(np.float32).ravel()
    parameters["vertex_color"] = figure.albedo(face, corner).astype(np.float32).ravel()
    parameters["faces"] = np.arange(3 * count, dtype=np.uint32)
    parameters.update()
    return mesh
