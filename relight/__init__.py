"""Relight a photographed person: exactly linear in the lights, composited in scene-linear colour.

Images at the public edge are (H, W, 3|4). Integer dtypes are sRGB-encoded with straight alpha; floating
dtypes are scene-linear Rec.709 with premultiplied alpha.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from relight.version import __version__

if TYPE_CHECKING:  # for editors and type checkers, which don't follow `__getattr__`
    from relight.compositing.composite import over
    from relight.compositing.floor import Floor
    from relight.compositing.placement import place
    from relight.distributed.dask_cluster import render_distributed
    from relight.distributed.openjd import write_job
    from relight.light_estimation import fit_lights, match
    from relight.light_painting import paint_lights
    from relight.lights.directional import DirectionalLight
    from relight.lights.environment import EnvironmentLight
    from relight.lights.light import Light
    from relight.lights.moving import MovingLight
    from relight.lights.near import PointLight, RectLight
    from relight.lights.presets import presets
    from relight.matting.chroma_key import key
    from relight.matting.networks import matte
    from relight.media.images import read, read_layers, read_mask, read_normals, write_mask
    from relight.media.write import write
    from relight.pipeline.analyse import analyse_shot
    from relight.pipeline.export import export_person
    from relight.pipeline.olat import write_olat
    from relight.pipeline.options import Compute, Lighting, Output, Source
    from relight.pipeline.render import render_shot
    from relight.pipeline.track import write_track
    from relight.rendering import apply, render
    from relight.scene.lights import read_lights, write_lights
    from relight.scene.plot import write_plot
    from relight.subject import Subject
    from relight.viewer.write_view import write_view

_EXPORTS = {
    "Compute": "relight.pipeline.options",
    "DirectionalLight": "relight.lights.directional",
    "EnvironmentLight": "relight.lights.environment",
    "Floor": "relight.compositing.floor",
    "Light": "relight.lights.light",
    "Lighting": "relight.pipeline.options",
    "MovingLight": "relight.lights.moving",
    "Output": "relight.pipeline.options",
    "PointLight": "relight.lights.near",
    "RectLight": "relight.lights.near",
    "Source": "relight.pipeline.options",
    "Subject": "relight.subject",
    "analyse_shot": "relight.pipeline.analyse",
    "apply": "relight.rendering",
    "export_person": "relight.pipeline.export",
    "fit_lights": "relight.light_estimation",
    "key": "relight.matting.chroma_key",
    "match": "relight.light_estimation",
    "matte": "relight.matting.networks",
    "over": "relight.compositing.composite",
    "paint_lights": "relight.light_painting",
    "place": "relight.compositing.placement",
    "presets": "relight.lights.presets",
    "read": "relight.media.images",
    "read_layers": "relight.media.images",
    "read_lights": "relight.scene.lights",
    "read_mask": "relight.media.images",
    "read_normals": "relight.media.images",
    "render": "relight.rendering",
    "render_distributed": "relight.distributed.dask_cluster",
    "render_shot": "relight.pipeline.render",
    "write": "relight.media.write",
    "write_job": "relight.distributed.openjd",
    "write_lights": "relight.scene.lights",
    "write_mask": "relight.media.images",
    "write_olat": "relight.pipeline.olat",
    "write_plot": "relight.scene.plot",
    "write_track": "relight.pipeline.track",
    "write_view": "relight.viewer.write_view",
}

__all__ = [  # literal, for type checkers
    "Compute",
    "DirectionalLight",
    "EnvironmentLight",
    "Floor",
    "Light",
    "Lighting",
    "MovingLight",
    "Output",
    "PointLight",
    "RectLight",
    "Source",
    "Subject",
    "analyse_shot",
    "apply",
    "export_person",
    "fit_lights",
    "key",
    "match",
    "matte",
    "over",
    "paint_lights",
    "place",
    "presets",
    "read",
    "read_layers",
    "read_lights",
    "read_mask",
    "read_normals",
    "render",
    "render_distributed",
    "render_shot",
    "write",
    "write_job",
    "write_lights",
    "write_mask",
    "write_olat",
    "write_plot",
    "write_track",
    "write_view",
]


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is asked for (PEP 562), so that `relight --help` answers at once."""
    if name == "errors":
        return import_module("relight.errors")
    if name not in _EXPORTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_EXPORTS[name]), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__", "errors"]
