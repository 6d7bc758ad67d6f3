"""Pictures stored with OpenImageIO, and the pixels that they hold."""

import numpy as np
import OpenImageIO as oiio

RNG = np.random.default_rng(3)
STRAIGHT = RNG.random((24, 32, 4), np.float32)
STRAIGHT[:4, :, 3] = 0
STRAIGHT[4:8, :, 3] = 1


PREMULTIPLIED = STRAIGHT * np.concatenate([STRAIGHT[..., 3:].repeat(3, -1), np.ones((24, 32, 1))], -1)
PREMULTIPLIED = PREMULTIPLIED.astype(np.float32)
AP1 = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)


def store(path, pixels, depth, **attributes):
    """A file made by OpenImageIO alone, as another program would make it."""
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], depth)
    for name, value in attributes.items():
        if hasattr(spec, name):
            setattr(spec, name, value)
        elif isinstance(value, tuple):
            spec.attribute(name, oiio.TypeDesc(f"float[{len(value)}]"), value)
        else:
            spec.attribute(name.replace("__", ":"), value)
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec), file.geterror()
    assert file.write_image(np.ascontiguousarray(pixels)), file.geterror()
    file.close()
    return path
