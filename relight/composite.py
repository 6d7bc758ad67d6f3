"""A relit person over a background."""

import numpy as np
import OpenImageIO as oiio

from relight import layers
from relight.image import scene_linear
from relight.subject import Subject


def apply(image, lights, *, background=None, mask=None, albedo=None, normals=None):
    """Relight the person in an image.

    Parameters
    ----------
    image: (H, W, 3|4). Integers are sRGB-encoded with straight alpha; floats linear Rec.709, premultiplied.
    lights: a light, or any number of them.
    background: image of any size, fitted to cover the frame, or a linear (r, g, b); None keeps the alpha.
    mask: (H, W) in [0, 1], the matte of the person; needed unless the image has alpha.
    albedo: (H, W, 3) to use instead of inferring it.
    normals: (H, W, 3) camera-frame normals to use instead of inferring them.

    Returns
    -------
    (H, W, 4) float32, linear Rec.709, premultiplied; or (H, W, 3) over a background. Exactly linear in the
    lights' intensities, unbounded.

    Raises
    ------
    TypeError, ValueError: as `Subject`, `Subject.relit` and `over` do.
    """
    picture = Subject(image, mask, albedo=albedo, normals=normals).relit(lights)
    return picture if background is None else over(picture, background)


def render(image, lights, *, background=None, mask=None, albedo=None, normals=None, passes=()):
    """As `apply`, and the same picture in layers: see `render_subject`. Raises as `apply` does too."""
    subject = Subject(image, mask, albedo=albedo, normals=normals)
    return render_subject(subject, lights, background=background, passes=passes)


def render_subject(subject, lights, *, background=None, passes=()):
    """A picture of an analysed person, and its layers.

    Parameters
    ----------
    subject: relight.Subject.
    lights: one light or more.
    background: as of `apply`.
    passes: further layers, of relight.layers.PASSES.

    Returns
    -------
    The picture, as `apply` returns it, and its layers, ready for `write`: light groups "C_<light>" (H, W, 4)
    whose colours, as half floats, sum to the picture's; over a background one more, "C_background" (H, W, 3),
    what is seen of it; and the passes (see `relight.layers.passes`).

    Raises
    ------
    ValueError: no light, two lights of one name, an unknown pass.
    """
    picture, groups = layers.light_groups(subject, lights)
    further = layers.passes(subject, lights, passes)
    if background is None:
        return picture, groups | further
    if "C_background" in groups:
        raise ValueError("lights: 'background' names the background's layer; give the light another name")
    groups["C_background"] = layers.half(over(picture * (0, 0, 0, 1), background))
    return picture[..., :3] + groups["C_background"], groups | further


def over(foreground, background):
    """The foreground over a background: F + (1 - alpha) B (Porter and Duff 1984), in linear light.

    Parameters
    ----------
    foreground: (H, W, 4), integers sRGB with straight alpha, floats linear premultiplied.
    background: (h, w, 3|4) alike, of any size: scaled to cover the frame and cropped about its centre; or a
        linear (r, g, b). Its own alpha, if any, is over black.

    Returns
    -------
    (H, W, 3) float32, linear Rec.709, unbounded.

    Raises
    ------
    TypeError, ValueError: wrong shape or dtype, NaN or infinite values, a foreground without alpha.
    """
    front = scene_linear("foreground", foreground)
    if front.shape[-1] != 4:
        raise ValueError(f"foreground: expected shape (H, W, 4), got {front.shape}")
    if np.ndim(background) == 1:
        colour = np.asarray(background)
        if (
            colour.shape != (3,)
            or not np.issubdtype(colour.dtype, np.number)
            or not np.isfinite(colour).all()
        ):
            raise ValueError(f"background: expected an image or three finite numbers, got {background!r}")
        back = colour.astype(np.float32)
    else:
        back = cover(scene_linear("background", background)[..., :3], front.shape[:2])
    return front[..., :3] + (1 - front[..., 3:]) * back


def cover(image, size):
    """`image` (h, w, C) float32, scaled to cover `size` (H, W) and cropped about its centre: (H, W, C)."""
    (height, width), (rows, columns) = size, image.shape[:2]
    scale = max(height / rows, width / columns)
    shown = max(1, round(height / scale)), max(1, round(width / scale))
    top, left = (rows - shown[0]) // 2, (columns - shown[1]) // 2
    crop = np.ascontiguousarray(image[top : top + shown[0], left : left + shown[1]])
    if shown == (height, width):
        return crop
    # Blackman-Harris has no negative lobes: a lamp in the background gets no dark ring.
    region = oiio.ROI(0, width, 0, height, 0, 1, 0, image.shape[2])
    return oiio.ImageBufAlgo.resize(oiio.ImageBuf(crop), "blackman-harris", roi=region).get_pixels("float")
