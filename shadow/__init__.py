"""Visibility (self-shadow) maps of a clothed person, for any light, from one image."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # for editors and type checkers, which don't follow `__getattr__`
    from shadow.analysis import Analysis, analyse
    from shadow.normals import infer_normals
    from shadow.visibility import baseline, infer

_EXPORTS = {
    "Analysis": "shadow.analysis",
    "analyse": "shadow.analysis",
    "baseline": "shadow.visibility",
    "infer": "shadow.visibility",
    "infer_normals": "shadow.normals",
}

__all__ = ["Analysis", "analyse", "baseline", "infer", "infer_normals"]


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is asked for (PEP 562): modules without torch do not load it."""
    if name not in _EXPORTS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_EXPORTS[name]), name)


def __dir__() -> list[str]:
    return __all__
