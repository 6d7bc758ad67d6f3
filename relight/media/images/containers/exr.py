"""Writing OpenEXR files, by OpenEXR's own library.

The wheels of OpenImageIO hold an OpenEXR that was compiled for size and takes interleaved pixels: it needs
twice as long. OpenImageIO still makes the header, since it knows the names of attributes.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import OpenEXR
import OpenImageIO as oiio

from relight.media.buffers import lazy_zeros, problem
from shadow import files

if TYPE_CHECKING:
    import torch


def save_exr(path: Path, stacks: Sequence[np.ndarray], corner: tuple[int, int], spec: oiio.ImageSpec) -> None:
    """Write a file that is whole or not there. Raises OSError if it cannot be written.

    `stacks`: pixels (h, w, C) of a box, outside which all is zero, with the channels of `spec` in order.
    `corner`: (row, column) of the box in the data window. `spec`: the file's windows, channels with their
    types, and attributes.
    """
    import torch

    height, width = stacks[0].shape[:2]
    box = np.s_[corner[0] : corner[0] + height, corner[1] : corner[1] + width]
    kinds = [str(kind) for kind in spec.channelformats or [spec.format] * spec.nchannels]
    whole, first = {}, 0
    for stack in stacks:
        names = spec.channelnames[first : first + stack.shape[-1]]
        dtype = np.float16 if kinds[first] == "half" else np.float32
        tensor = torch.from_numpy(np.require(stack, requirements=("C", "W")))  # torch warns of read-only ones
        for name, values in _arrays(names, tensor, ("RGB", "RGBA", *spec.channelnames)):
            whole[name] = lazy_zeros((spec.height, spec.width, *values.shape[2:]), dtype)
            torch.from_numpy(whole[name])[box] = values
        first += stack.shape[-1]
    with files.replacing(path) as beside:
        OpenEXR.File(_header(beside, spec), whole).write(str(beside))


def _arrays(
    names: Sequence[str], values: "torch.Tensor", reserved: Sequence[str]
) -> Iterator[tuple[str, "torch.Tensor"]]:
    """Yield channels (h, w, C) as OpenEXR takes them: colour under its layer's name, "RGBA" for the picture
    itself; others (h, w) by themselves, and so colour of a layer whose name is `reserved`."""
    layer = names[0].removesuffix("R").removesuffix(".")
    if [name.rpartition(".")[2] for name in names] in (list("RGB"), list("RGBA")) and layer not in reserved:
        yield layer or "RGBA", values
    else:
        yield from zip(names, values.unbind(dim=-1), strict=True)


def _header(path: Path, spec: oiio.ImageSpec) -> dict[str, object]:
    """Return the header, in OpenEXR's types, that OpenImageIO writes for `spec` in a file of one pixel."""
    small = oiio.ImageSpec(spec)
    small.x = small.y = small.full_x = small.full_y = 0
    small.width = small.height = small.full_width = small.full_height = 1
    file = oiio.ImageOutput.create("openexr")
    assert file is not None
    written = file.open(str(path), small) and file.write_image(np.zeros((1, 1, spec.nchannels), np.float32))
    if not (file.close() and written):
        raise OSError(f"{path}: cannot be written: {problem(file)}")
    header = OpenEXR.File(str(path), header_only=True).header()
    del header["channels"]  # they are those of the planes
    header["dataWindow"] = _window(spec.x, spec.y, spec.width, spec.height)
    header["displayWindow"] = _window(spec.full_x, spec.full_y, spec.full_width, spec.full_height)
    return header


def _window(x: int, y: int, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Return OpenEXR's box of the first and last pixel."""
    return np.array([x, y], np.int32), np.array([x + width - 1, y + height - 1], np.int32)
