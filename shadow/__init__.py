"""Visibility (self-shadow) maps of a clothed person, for any light, from one image."""

from shadow.torch_settings import own_settings

with own_settings():  # the networks' modules have constants, which are tensors
    from shadow.analysis import Analysis, analyse
    from shadow.normals import infer_normals
    from shadow.visibility import baseline, infer

__all__ = ["Analysis", "analyse", "baseline", "infer", "infer_normals"]
