"""A relit frame and what is behind it, for outputs that show it and for those that hold its light."""

from dataclasses import dataclass

import numpy as np

from relight.media.images import composited
from relight.pipeline.options import Output
from relight.pipeline.outputs import is_exr
from relight.pipeline.shot import Shot
from relight.rendering import Layers, Rendering, lit_backdrop, over_backdrop, render_layers
from relight.subject import Subject


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


def render_frame(shot: Shot, number: int, person: Subject, output: Output, kept: bool) -> RenderedFrame:
    """Render the person of a frame in the light of the shot, and what is behind them.

    `kept`: whether that is the photograph itself, see `RenderedFrame`.
    """
    lighting, backgrounds = shot.lighting, shot.backgrounds
    behind = backgrounds.behind(number, person, kept)
    lights = [*shot.lights.placed(number), *backgrounds.lights(number, person.size)]
    rendering = render_layers(
        person, lights, passes=output.passes, exr_type=output.exr_type, floor=lighting.floor,
        gloss=lighting.effective_gloss, amount=lighting.amount, layered=any(map(is_exr, output.paths)),
    )  # fmt: skip
    back = None
    if behind is not None:
        blur, reached = lighting.background_blur, lighting.background_light
        back = lit_backdrop(person, rendering.cut_out, behind, rendering.shadow, blur, reached)
    return RenderedFrame(rendering, back, kept, backgrounds.keeps_codes(kept))


def cut_out(picture: np.ndarray, layers: Layers) -> RenderedFrame:
    """Return a picture (H, W, 4) and its layers as a frame with nothing behind it."""
    return RenderedFrame(Rendering(picture, layers, None), None, False, False)
