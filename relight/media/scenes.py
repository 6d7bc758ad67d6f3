"""Where one scene of a film ends and another begins."""

import numpy as np

from relight.media.resampling import reduced_size, resize

SIDE = 24  # pixels, the longer side of the copies on which frames are compared
OTHER_SCENE = 0.2  # mean difference of encoded colours between frames of two scenes


def reduced(encoded: np.ndarray) -> np.ndarray:
    """Return a copy (h, w, 3) of a frame (H, W, 3), encoded in [0, 1], on which scenes are compared."""
    shrink = SIDE / max(encoded.shape[:2])
    return resize(encoded, reduced_size(encoded.shape, shrink), "triangle")


def is_cut(before: np.ndarray, after: np.ndarray) -> bool:
    """Return whether two frames that follow each other are of two scenes; both are `reduced`."""
    return before.shape != after.shape or float(np.abs(before - after).mean()) > OTHER_SCENE
