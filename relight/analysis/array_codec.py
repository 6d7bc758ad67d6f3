"""Lossless compression of arrays for the analysis cache: differences, byte planes and Zstandard (Blosc)."""

import math

import numpy as np
from numpy.typing import DTypeLike

LEVEL = 5  # of Zstandard: level 9 saves 7 % and takes 20 times as long


def compress(array: np.ndarray) -> np.ndarray:
    """Compress an array to bytes (B,) uint8.

    Integers are stored as differences to the value before, two-byte ones zigzag-folded: 0, -1, 1, -2...
    become 0, 1, 2, 3... Blosc then orders the bytes by significance and applies Zstandard.
    """
    from numcodecs import blosc

    values = np.ascontiguousarray(array)
    if values.dtype == np.uint8:
        values = np.diff(values, axis=-1, prepend=np.uint8(0))  # modulo 256
    elif values.dtype == np.uint16:
        steps: np.ndarray = np.diff(values.view(np.int16), axis=-1, prepend=np.int16(0))  # modulo 65536
        values = (steps << 1) ^ (steps >> 15)
    codec = blosc.Blosc("zstd", LEVEL, blosc.Blosc.SHUFFLE)
    before, blosc.use_threads = blosc.use_threads, False  # several threads store their blocks in any order
    try:
        return np.frombuffer(codec.encode(np.ascontiguousarray(values)), np.uint8)
    finally:
        blosc.use_threads = before


def decompress(data: np.ndarray, dtype: DTypeLike, shape: tuple[int, ...]) -> np.ndarray:
    """Return the array of this dtype and shape that `compress` made into `data`.

    Raises ValueError if the data hold an array of another size, or are cut; they are not decompressed.
    """
    from numcodecs import Blosc

    dtype = np.dtype(dtype)
    expected = math.prod(shape) * dtype.itemsize
    # Blosc's header: it trusts both, and would read beyond data that are shorter than they say.
    claimed, compressed = (int.from_bytes(data[at : at + 4].tobytes(), "little") for at in (4, 12))
    if claimed != expected or len(data) < 16:
        raise ValueError(f"holds {claimed} bytes of an array of {expected}")
    if compressed != len(data):
        raise ValueError(f"holds {len(data)} compressed bytes of {compressed}")
    values = np.empty(expected, np.uint8)
    Blosc().decode(data, values)
    values = values.view(dtype).reshape(shape)
    if dtype == np.uint8:
        return np.cumsum(values, axis=-1, dtype=np.uint8)
    if dtype == np.uint16:
        steps = (values >> 1).view(np.int16) ^ -(values & 1).view(np.int16)
        return np.cumsum(steps, axis=-1, dtype=np.int16).view(np.uint16)
    return values
