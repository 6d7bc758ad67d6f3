"""What Blender means by the lights that it writes, where its units are not those of the format."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pxr import Usd

LUMENS_PER_WATT = 683.0  # of its glTF exporter's lighting mode Standard, the default
FIRST_MODES = (3, 6)  # version of the exporter that has lighting modes; before, values were in watts
SUN_STRENGTH = 4.0  # strength of a sun, in W/m², for each unit of a DistantLight's intensity
SUN_ANGLE = 2.0  # angular diameter of a sun for each degree of a DistantLight's angle


def exported_gltf(generator: object) -> bool:
    """Return whether the `generator` of a glTF file is an exporter of Blender that has lighting modes."""
    match = re.match(r"Khronos glTF Blender I/O v(\d+)\.(\d+)", str(generator))
    return match is not None and tuple(map(int, match.groups())) >= FIRST_MODES


def authored(attribute: Usd.Attribute) -> bool:
    """Return whether the value of a USD attribute is from a layer that Blender wrote."""
    stack = attribute.GetPropertyStack()
    return bool(stack) and stack[0].layer.documentation.startswith("Blender ")
