"""Relight a photographed person: exactly linear in the lights, composited in scene-linear colour.

Images at the public edge are (H, W, 3|4). Integer dtypes are sRGB-encoded with straight alpha; floating
dtypes are scene-linear Rec.709 with premultiplied alpha.
"""

from importlib import import_module

__version__ = "0.1.0"

_EXPORTS = {
    "DirectionalLight": "relight.lights",
    "EnvironmentLight": "relight.environment",
    "MovingLight": "relight.animation",
    "Subject": "relight.subject",
    "apply": "relight.composite",
    "fit_lights": "relight.fitting",
    "key": "relight.matte",
    "over": "relight.composite",
    "place": "relight.composite",
    "read": "relight.image",
    "render_video": "relight.video",
    "read_layers": "relight.image",
    "read_lights": "relight.lightfile",
    "read_mask": "relight.image",
    "read_normals": "relight.image",
    "write": "relight.image",
    "write_mask": "relight.image",
    "write_lights": "relight.lightfile",
    "write_olat": "relight.olat",
}

__all__ = list(_EXPORTS)


def __getattr__(name):
    """Import what is asked for when it is asked for (PEP 562), so that `relight --help` answers at once."""
    if name not in _EXPORTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_EXPORTS[name]), name)


def __dir__():
    return __all__
