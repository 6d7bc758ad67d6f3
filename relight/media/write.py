"""Write what is in memory: an image, or frames as a movie."""

from collections.abc import Iterable
from fractions import Fraction
from typing import Any

from numpy.typing import ArrayLike

from relight import quantities
from relight.arguments import checks_arguments
from relight.media import images, movies
from relight.media.streams import is_stream, to_stream


@checks_arguments
def write(
    path: quantities.FileOrStream,
    image: ArrayLike | Iterable[ArrayLike],
    *,
    format: str | None = None,
    rate: float | Fraction | None = None,
    **options: Any,
) -> None:
    """Write an image, or a movie of several. The file appears when it is complete.

    Parameters
    ----------
    path
        Its suffix is the format: .exr, .hdr, .jpg, .png, .tif; .mp4 or .mov for a movie. Its folder must
        exist. Or a stream to which the bytes of the whole file are written; then `format` says which.
    image
        (H, W, 3|4), integers sRGB with straight alpha, floats linear Rec.709 premultiplied. For a movie an
        iterable of frames of one size, such as a generator, float and linear; an .mp4 holds no alpha.
    format
        Of a stream: "png", "exr", "jpg", "tif", "hdr", "mp4" or "mov".
    rate
        Frames a second of a movie, 24 by default.
    options
        view, exposure and white, and for images background, layers, depth, autocrop, metadata and
        colour_space: see `relight.media.images.write` and `relight.media.movies.write_movie`.

    Raises
    ------
    TypeError, ValueError
        As those functions do; an option that the format does not have.
    OSError
        The folder does not exist, or the file cannot be written.

    Examples
    --------
    >>> import numpy as np, relight
    >>> relight.write("relit.png", np.full((8, 8, 3), 0.18, np.float32))
    >>> frames = (np.full((16, 16, 3), light, np.float32) for light in (0.1, 0.2, 0.4))
    >>> relight.write("brighter.mp4", frames, rate=25)
    """
    if is_stream(path):
        if format is None:
            raise TypeError("format: expected that of a stream, such as 'png' or 'exr'")
        with to_stream(path, f".{format.lower().removeprefix('.')}") as file:
            write(file, image, rate=rate, **options)
        return
    if format is not None:
        raise TypeError("format: is for streams; a file's suffix is its format")
    if movies.is_movie(path):
        unknown = options.keys() - {"view", "exposure", "white"}
        if unknown:
            raise TypeError(f"{path}: a movie has no option {', '.join(sorted(unknown))}")
        if hasattr(image, "ndim") and image.ndim != 4:
            raise ValueError(f"{path}: expected an iterable of frames (H, W, 3|4), got one image")
        frames: Any = image
        movies.write_movie(path, frames, rate=movies.RATE if rate is None else rate, **options)
        return
    if rate is not None:
        raise TypeError(f"{path}: only a movie, .mp4 or .mov, has a rate")
    picture: Any = image
    images.write(path, picture, **options)
