"""A relit frame and what is behind it, for outputs that show it and for those that hold its light."""

from dataclasses import dataclass

import numpy as np

from relight.media.images import composited
from relight.rendering import Layers, Rendering, over_backdrop


@dataclass(frozen=True)
class RenderedFrame:
    """A relit person, and what is behind them.

    `backdrop`: (H, W, 3) linear, with the shadow on the floor; None if there is nothing behind. `kept`: it is
    the photograph itself, which an .exr does not hold unless that is asked for. `keeps_codes`: it is light of
    a display, whose code values outputs for a display pass on.
    """

    rendering: Rendering
    backdrop: np.ndarray | None
    kept: bool
    keeps_codes: bool

    def layered(self, exr_type: str) -> tuple[np.ndarray, Layers]:
        """Return the picture (H, W, 3|4) and the layers of an .exr."""
        cut_out, layers = self.rendering.cut_out, self.rendering.layers
        if self.backdrop is None or self.kept:
            return cut_out, layers
        picture, seen = over_backdrop(cut_out, self.backdrop, exr_type)
        return picture, layers | {"C_background": seen}

    def shown(self) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the picture (H, W, 3|4) for a display, and the background (H, W, 3) that keeps its codes."""
        if self.backdrop is None or self.keeps_codes:
            return self.rendering.cut_out, self.backdrop
        return composited(self.rendering.cut_out, self.backdrop), None


def cut_out(picture: np.ndarray, layers: Layers) -> RenderedFrame:
    """Return a picture (H, W, 4) and its layers as a frame with nothing behind it."""
    return RenderedFrame(Rendering(picture, layers, None), None, False, False)
