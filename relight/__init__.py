"""Relight a photographed person: exactly linear in the lights, composited in scene-linear colour.

Images at the public edge are (H, W, 3|4). Integer dtypes are sRGB-encoded with straight alpha; floating
dtypes are scene-linear Rec.709 with premultiplied alpha.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # for editors and type checkers, which don't follow `__getattr__`
    from relight.analysing import analyse_shot
    from relight.cluster import render_distributed
    from relight.composite import over, place
    from relight.farm import write_job
    from relight.fitting import fit_lights
    from relight.keying import key
    from relight.lights.directional import DirectionalLight
    from relight.lights.environment import EnvironmentLight
    from relight.lights.files import read_lights, write_lights
    from relight.lights.moving import MovingLight
    from relight.lights.near import PointLight, RectLight
    from relight.matting import matte
    from relight.media.images import read, read_layers, read_mask, read_normals, write, write_mask
    from relight.olat import write_olat
    from relight.rendering import apply, render
    from relight.stills import render_still
    from relight.subject import Subject
    from relight.video import render_video

__version__ = "0.2.0"

_EXPORTS = {
    "DirectionalLight": "relight.lights.directional",
    "EnvironmentLight": "relight.lights.environment",
    "MovingLight": "relight.lights.moving",
    "PointLight": "relight.lights.near",
    "RectLight": "relight.lights.near",
    "Subject": "relight.subject",
    "analyse_shot": "relight.analysing",
    "apply": "relight.rendering",
    "fit_lights": "relight.fitting",
    "key": "relight.keying",
    "matte": "relight.matting",
    "over": "relight.composite",
    "place": "relight.composite",
    "read": "relight.media.images",
    "read_layers": "relight.media.images",
    "read_lights": "relight.lights.files",
    "read_mask": "relight.media.images",
    "read_normals": "relight.media.images",
    "render": "relight.rendering",
    "render_distributed": "relight.cluster",
    "render_still": "relight.stills",
    "render_video": "relight.video",
    "write": "relight.media.images",
    "write_job": "relight.farm",
    "write_lights": "relight.lights.files",
    "write_mask": "relight.media.images",
    "write_olat": "relight.olat",
}

__all__ = list(_EXPORTS)


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is asked for (PEP 562), so that `relight --help` answers at once."""
    if name not in _EXPORTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_EXPORTS[name]), name)


def __dir__() -> list[str]:
    return __all__
