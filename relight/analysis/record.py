"""Everything that a `relight.Subject` is made of."""

from typing import NamedTuple

import torch

from relight.analysis.foreground import Foreground
from relight.analysis.maps import AnalysisMaps
from relight.analysis.old_light import OldLight
from shadow.framing import Framing


class AnalysisRecord(NamedTuple):
    """An analysed person: pixels of the plate, and the networks' maps on the canvas. Holds no network."""

    foreground: Foreground
    colour: torch.Tensor  # (P, 3) the person's own colour, linear Rec.709, without the background
    provided_albedo: torch.Tensor | None  # (P, 3) linear, if the caller gave the albedo
    exposure: float  # factor by which `colour` is multiplied before it is encoded as a guide
    framing: Framing  # of the canvas in the foreground's box
    maps: AnalysisMaps
    old_light: OldLight = OldLight()  # whose colour the albedo lacks
