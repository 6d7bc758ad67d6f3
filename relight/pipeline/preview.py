"""A preview of a shot: half the size, every fourth frame, without what refines it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from relight.media.resampling import resize
from relight.media.sequences import Held
from relight.pipeline.options import Lighting, Source

EVERY = 4  # frames, of which one is shown
SUFFIX = ".mp4"


def source_of(source: Source) -> Source:
    """Return the options of a person who is shown at half the size, and by each frame alone."""
    return replace(
        source, refine_matte=None, feather=source.feather / 2, temporal_filter=False,
        temporal_radius=Source(source.plate).temporal_radius,
    )  # fmt: skip


def lighting_of(lighting: Lighting) -> Lighting:
    """Return the lighting of a picture of half the size."""
    floor = lighting.floor
    if floor is None or floor.feet is None:
        return lighting
    left, top, right, bottom = (each / 2 for each in floor.feet)
    return replace(lighting, floor=replace(floor, feet=(left, top, right, bottom)))


def halved(image: object, nearest: bool = False) -> Held:
    """Return an image (H, W, C) or (H, W) at half the size; what is no image is unchanged.

    `nearest`: whether values of two pixels are not to be mixed, as normals are not.
    """
    if not isinstance(image, np.ndarray) or image.ndim < 2:
        return image
    if nearest:
        return image[::2, ::2]
    height, width = (max(1, length // 2) for length in image.shape[:2])
    if np.issubdtype(image.dtype, np.integer):
        codes = resize(image.astype(np.float32), (height, width), "box")
        return np.rint(codes).astype(image.dtype)
    return resize(np.asarray(image, np.float32), (height, width), "box")


def check_outputs(paths: Sequence[Path]) -> None:
    """Raise ValueError for an output that is no .mp4."""
    for path in paths:
        if path.suffix.lower() != SUFFIX:
            raise ValueError(f"{path}: a preview is written as {SUFFIX}")
