"""One-light-at-a-time diffuse shading and diffuse albedo of a clothed person, from one image."""

from shading.albedo import infer_albedo, infer_lighting
from shading.analysis import Analysis, analyse, infer

__all__ = ["Analysis", "analyse", "infer", "infer_albedo", "infer_lighting"]
