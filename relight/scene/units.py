"""Photometric units of other programs against ours; `docs/lights.md` derives each.

Ours: a light of power 1 gives a white surface that faces it the value 1. A white diffuse surface has the
radiance E / π under the irradiance E, so a distant light of power 1 has the irradiance π, and a near one has
it at one metre. UsdLux measures a surface's luminance L, glTF a distant light's illuminance and a point's
intensity.
"""

import math

# What one of ours is in units of the others, where UsdLux normalises a light by its size.
DISTANT = math.pi  # E = intensity
SPHERE = 4 * math.pi  # L = intensity / 4 π r², and E = π L r² at one metre
RECT = math.pi  # L = intensity / w h, and E = L w h at one metre
GLTF = math.pi  # lux of a directional light, candela of a point or spot


def distant(angle: float, normalize: bool) -> float:
    """Return our power of UsdLux's DistantLight of intensity 1.

    `angle` is its angular diameter in degrees. Its disc of luminance L within θ of the axis gives the
    irradiance π L sin² θ; beyond a hemisphere only the part above the horizon counts. At angle 0 the
    intensity is the illuminance itself.
    """
    if normalize or angle <= 0:
        return 1 / DISTANT
    return math.sin(min(math.radians(angle / 2), math.pi / 2)) ** 2


def sphere(radius: float, normalize: bool) -> float:
    """Return our power of UsdLux's SphereLight of intensity 1 and `radius` metres."""
    return 1 / SPHERE if normalize else radius**2


def flat(area: float, normalize: bool) -> float:
    """Return our power of UsdLux's RectLight or DiskLight of intensity 1 and `area` square metres."""
    return 1 / RECT if normalize else area / math.pi
