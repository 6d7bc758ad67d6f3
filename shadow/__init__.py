"""Visibility (self-shadow) maps of a clothed person, for any light, from one image."""

from shadow.normals import infer_normals
from shadow.visibility import baseline, infer

__all__ = ["baseline", "infer", "infer_normals"]
