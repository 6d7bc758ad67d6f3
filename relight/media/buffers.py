"""Arrays to OpenImageIO's image buffers and back."""

from typing import Any

import numpy as np
import OpenImageIO as oiio


def to_buffer(pixels: np.ndarray) -> oiio.ImageBuf:
    """Return an array (H, W, C), cast to float32, as a buffer."""
    return oiio.ImageBuf(np.ascontiguousarray(pixels, np.float32))


def to_array(buffer: oiio.ImageBuf, dtype: str = "float") -> np.ndarray:
    """Return the pixels (H, W, C) of a buffer; raises RuntimeError with OpenImageIO's message for errors."""
    pixels = None if buffer.has_error else buffer.get_pixels(dtype)
    if pixels is None:
        raise RuntimeError(f"OpenImageIO: {problem(buffer)}")
    return pixels


def problem(source: Any) -> str:
    """OpenImageIO's account of an error, without what failed as a consequence."""
    try:
        return source.geterror().strip().partition("\n")[0]
    except UnicodeDecodeError:  # it quotes the file
        return "what it holds is garbled"
