"""A relit person over a background."""

import operator

import numpy as np
import OpenImageIO as oiio

from relight import layers
from relight.environment import EnvironmentLight
from relight.image import coverage, scene_linear
from relight.subject import Subject

FARTHEST = 65536  # pixels: beyond any plate, within what an image can be


def apply(image, lights, *, background=None, mask=None, albedo=None, normals=None):
    """Relight the person in an image.

    Parameters
    ----------
    image: (H, W, 3|4). Integers are sRGB-encoded with straight alpha; floats linear Rec.709, premultiplied.
    lights: a light, or any number of them.
    background: image of any size, fitted to cover the frame; a linear (r, g, b); or a
        relight.EnvironmentLight, as a camera sees it (see `over`). None keeps the alpha.
    mask: (H, W) in [0, 1], the matte of the person; needed unless the image has alpha.
    albedo: (H, W, 3) to use instead of inferring it.
    normals: (H, W, 3) camera-frame normals to use instead of inferring them; or anything else that
        `shadow.normals.load` takes.

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
    groups["C_background"] = layers.half(_behind(picture, background))
    return picture[..., :3] + groups["C_background"], groups | further


def over(foreground, background):
    """The foreground over a background: F + (1 - alpha) B (Porter and Duff 1984), in linear light.

    Parameters
    ----------
    foreground: (H, W, 4), integers sRGB with straight alpha, floats linear premultiplied.
    background: (h, w, 3|4) alike, of any size: scaled to cover the frame and cropped about its centre; its
        own alpha, if any, is over black. Or a linear (r, g, b). Or a relight.EnvironmentLight: what of it a
        camera sees behind the person (`EnvironmentLight.view`).

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
    return front[..., :3] + _behind(front, background)


def _behind(front, background):
    """What is seen of a background (H, W, 3) behind a premultiplied picture (H, W, 4); see `over`."""
    if isinstance(background, EnvironmentLight):
        back = background.view(front.shape[:2])
    elif np.ndim(background) == 1:
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
    return (1 - front[..., 3:]) * back


def place(image, size, *, mode="fit", scale=1.0, offset=(0, 0)):
    """An image in a frame of another size, such as a background's: before analysis, or after relighting.

    Parameters
    ----------
    image: (h, w, 3|4), integers sRGB with straight alpha, floats linear premultiplied; or a mask (h, w).
    size: (H, W) of the frame in pixels.
    mode: "fit", as large as the frame shows all of it; "fill", as large as leaves none of the frame empty;
        "centre", at its own size. Always about the centre of the frame.
    scale: > 0, on top of that.
    offset: (right, up) in whole pixels of the frame.

    Returns
    -------
    (H, W, 3|4) or (H, W) float32: zero where the image is not, cropped where it does not fit. At its own size
    its pixels are kept as they are.

    Raises
    ------
    TypeError, ValueError: as of `over`, an empty frame, an unknown mode, a scale or offset out of range.
    """
    flat = np.ndim(image) == 2
    pixels = coverage("image", image)[..., None] if flat else scene_linear("image", image)
    (rows, columns), (height, width) = pixels.shape[:2], _whole("size", size, 1)
    right, up = _whole("offset", offset, -FARTHEST)
    ratios = (height / rows, width / columns)
    if mode not in ("fit", "fill", "centre"):
        raise ValueError(f"mode: expected fit, fill or centre, got {mode!r}")
    if not 0 < scale < np.inf:
        raise ValueError(f"scale: expected a finite number > 0, got {scale!r}")
    scale *= {"fit": min(ratios), "fill": max(ratios), "centre": 1.0}[mode]
    shown = max(1, round(rows * scale)), max(1, round(columns * scale))
    if max(shown) > FARTHEST:
        raise ValueError(f"scale: makes the image {shown[1]} x {shown[0]} pixels; expected up to {FARTHEST}")
    pixels = _resized(pixels, shown)
    if flat or pixels.shape[-1] == 4:
        np.clip(pixels[..., -1], 0, 1, out=pixels[..., -1])  # the filter's rounding
    frame = np.zeros((height, width, pixels.shape[-1]), np.float32)
    top, left = (height - shown[0]) // 2 - up, (width - shown[1]) // 2 + right
    inside = frame[max(top, 0) : max(top + shown[0], 0), max(left, 0) : max(left + shown[1], 0)]
    inside[:] = pixels[max(-top, 0) :, max(-left, 0) :][: inside.shape[0], : inside.shape[1]]
    return frame[..., 0] if flat else frame


def _whole(name, values, low):
    """Two whole numbers from `low` to FARTHEST."""
    try:
        first, second = (operator.index(value) for value in values)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name}: expected two whole numbers, got {values!r}") from error
    if min(first, second) < low or max(first, second) > FARTHEST:
        raise ValueError(f"{name}: expected {low} to {FARTHEST} pixels, got {values!r}")
    return first, second


def cover(image, size):
    """`image` (h, w, C) float32, scaled to cover `size` (H, W) and cropped about its centre: (H, W, C)."""
    (height, width), (rows, columns) = size, image.shape[:2]
    scale = max(height / rows, width / columns)
    shown = max(1, round(height / scale)), max(1, round(width / scale))
    top, left = (rows - shown[0]) // 2, (columns - shown[1]) // 2
    crop = np.ascontiguousarray(image[top : top + shown[0], left : left + shown[1]])
    return _resized(crop, size)


def _resized(image, size):
    """`image` (h, w, C) float32 at `size` (H, W): itself if that is its size."""
    if image.shape[:2] == tuple(size):
        return image
    # Blackman-Harris has no negative lobes: a lamp in the background gets no dark ring.
    region = oiio.ROI(0, size[1], 0, size[0], 0, 1, 0, image.shape[2])
    source = oiio.ImageBuf(np.ascontiguousarray(image, np.float32))
    resized = oiio.ImageBufAlgo.resize(source, "blackman-harris", roi=region).get_pixels("float")
    return resized.reshape(*size, image.shape[2])
