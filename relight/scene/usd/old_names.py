"""Lights written before USD 21.02, whose attributes had no namespace: `intensity`, not `inputs:intensity`."""

from __future__ import annotations

from typing import TYPE_CHECKING

# The inputs of UsdLux's lights, their shaping and their shadows, as they were called.
ATTRIBUTES = (
    "angle", "color", "colorTemperature", "diffuse", "enableColorTemperature", "exposure", "height",
    "intensity", "length", "normalize", "radius", "shadow:color", "shadow:distance", "shadow:enable",
    "shadow:falloff", "shadow:falloffGamma", "shaping:cone:angle", "shaping:cone:softness", "shaping:focus",
    "shaping:focusTint", "shaping:ies:angleScale", "shaping:ies:file", "shaping:ies:normalize", "specular",
    "texture:file", "texture:format", "width",
)  # fmt: skip

if TYPE_CHECKING:
    from pxr import Usd


def honour(prim: Usd.Prim) -> None:
    """Give a light the values of its old attributes, where it has none of today's.

    They go to the stage's session layer, so that no file changes.
    """
    from pxr import Usd

    stage = prim.GetStage()
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for name in ATTRIBUTES:
            old, new = prim.GetAttribute(name), prim.GetAttribute(f"inputs:{name}")
            if not (old and old.HasAuthoredValue()) or (new and new.HasAuthoredValue()):
                continue
            new = new or prim.CreateAttribute(f"inputs:{name}", old.GetTypeName(), False)
            if (value := old.Get()) is not None:
                new.Set(value)
            for time in old.GetTimeSamples():
                new.Set(old.Get(time), time)
