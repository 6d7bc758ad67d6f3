"""Convert arrays to OpenImageIO's image buffers and back; make arrays that stay zero for the most part."""

import math
import mmap
import sys
from typing import Protocol

import numpy as np
import OpenImageIO as oiio
from numpy.typing import DTypeLike

HUGE_PAGES = 1 << 22  # bytes from which NumPy asks Linux for huge pages


def to_buffer(pixels: np.ndarray) -> oiio.ImageBuf:
    """Return an array (H, W, C), cast to float32, as a buffer."""
    return oiio.ImageBuf(np.ascontiguousarray(pixels, np.float32))


def to_array(buffer: oiio.ImageBuf, dtype: str = "float") -> np.ndarray:
    """Return the pixels (H, W, C) of a buffer; raises RuntimeError with OpenImageIO's message for errors."""
    pixels = None if buffer.has_error else buffer.get_pixels(dtype)
    if pixels is None:
        raise RuntimeError(f"OpenImageIO: {problem(buffer)}")
    return pixels


class Failing(Protocol):
    """What of OpenImageIO remembers an error."""

    def geterror(self) -> str: ...


def problem(source: Failing) -> str:
    """OpenImageIO's account of an error, without what failed as a consequence."""
    try:
        return source.geterror().strip().partition("\n")[0]
    except UnicodeDecodeError:  # it quotes the file
        return "what it holds is garbled"


def lazy_zeros(shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> np.ndarray:
    """Return zeros; on Linux, memory pages that are not written are not allocated.

    NumPy asks for huge pages there, of which a person touches all: with its zeros the peak at 4K is 1.2 GiB
    instead of 0.9 GiB.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if sys.platform != "linux" or size < HUGE_PAGES:
        return np.zeros(shape, dtype)
    return np.frombuffer(mmap.mmap(-1, size, access=mmap.ACCESS_COPY), dtype).reshape(shape)
