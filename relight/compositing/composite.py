"""Composite a picture over a background, in linear light."""

import numpy as np
from numpy.typing import ArrayLike

from relight.arguments import checks_arguments
from relight.compositing.defocus import defocused
from relight.compositing.placement import cover
from relight.lights.environment import EnvironmentLight
from relight.media.images import scene_linear
from relight.media.images.arrays import as_array
from shadow.torch_settings import isolated

MAX_BACKGROUND_FACTOR = 8.0  # of a background that is lit as the person is
Background = ArrayLike | EnvironmentLight  # an image, a linear (r, g, b), or a map as a camera sees it


@isolated
@checks_arguments
def over(foreground: ArrayLike, background: Background, shadow: np.ndarray | None = None) -> np.ndarray:
    """Composite a foreground over a background: F + (1 - alpha) B (Porter and Duff 1984), in linear light.

    Parameters
    ----------
    foreground
        (H, W, 4). Integers are sRGB-encoded with straight alpha; floats are linear Rec.709, premultiplied.
    background
        (h, w, 3|4) of the same kind, of any size: it is scaled to cover the frame, cropped around its centre,
        and composited over black if it has alpha. Or a linear (r, g, b). Or a relight.EnvironmentLight, which
        is rendered as a camera of 40 degrees sees it (`EnvironmentLight.view`).
    shadow
        (H, W, 3) factors for the background, such as `Subject.shadows` returns.

    Returns
    -------
    np.ndarray
        (H, W, 3) float32, linear Rec.709, unbounded.

    Raises
    ------
    TypeError, ValueError
        Wrong shape or dtype, NaN or infinite values, a foreground without alpha.

    Examples
    --------
    >>> import numpy as np, relight
    >>> half_red = np.full((2, 2, 4), (0.5, 0, 0, 0.5), np.float32)  # premultiplied
    >>> relight.over(half_red, (0.2, 0.2, 0.2))[0, 0].astype(float).round(2).tolist()
    [0.6, 0.1, 0.1]
    """
    front = scene_linear("foreground", foreground)
    if shadow is not None:
        shadow = scene_linear("shadow", shadow)
        if shadow.shape != (*front.shape[:2], 3):
            raise ValueError(f"shadow: expected shape {(*front.shape[:2], 3)}, got {shadow.shape}")
    if front.shape[-1] != 4:
        raise ValueError(f"foreground: expected shape (H, W, 4), got {front.shape}")
    with np.errstate(over="ignore"):
        picture = front[..., :3] + behind(front, background, shadow)
    if not np.isfinite(picture).all():
        raise ValueError("background: is so bright that the picture is beyond float32")
    return picture


def behind(front: np.ndarray, background: Background, shadow: np.ndarray | None = None) -> np.ndarray:
    """Return what a premultiplied picture (H, W, 4) leaves of a background, (H, W, 3); see `over`."""
    return (1 - front[..., 3:]) * backdrop(background, front.shape[:2], shadow)


def backdrop(
    background: Background, size: tuple[int, ...], shadow: np.ndarray | None = None, blur: float = 0.0
) -> np.ndarray:
    """Return a background as a frame of `size` (H, W) shows it, (H, W, 3) linear light; see `over`.

    `blur`: a share of the height, see `defocused`; a shadow that falls on the background stays sharp.
    """
    if isinstance(background, EnvironmentLight):
        back = background.view((size[0], size[1]))
    elif (colour := as_array("background", background)).ndim == 1:
        if colour.shape != (3,) or colour.dtype.kind not in "iuf":
            raise ValueError(f"background: expected an image or three finite numbers, got {background!r}")
        with np.errstate(over="ignore"):
            back = colour.astype(np.float32)
        if not np.isfinite(back).all():
            raise ValueError(f"background: expected an image or three finite numbers, got {background!r}")
        back = np.broadcast_to(back, (size[0], size[1], 3))
    else:
        back = cover(scene_linear("background", background)[..., :3], size)
    back = defocused(back, blur)
    return back if shadow is None else back * shadow
