"""Small pictures of a person in the light of the presets, for browsers that cannot draw them."""

import numpy as np

from relight.app.pictures import resized
from relight.lights import presets
from relight.lights.rig import scaled
from relight.media.resampling import size_within
from relight.subject import Subject

SIDE = 320  # pixels, the longer side of the part of the photograph that is analysed again
TALLEST = 1.15  # of a picture, over its width: head and trunk of a whole person

_last: list[Subject] = []  # the person whose pictures were made last, and their small copy


def small_of(subject: Subject, photograph: np.ndarray) -> Subject:
    """Return a small copy of a person in a photograph (H, W, 3|4), analysed again; the last one is kept."""
    if not _last or _last[0] is not subject:
        rows, columns = (np.flatnonzero((subject.matte > 0.05).any(axis=1 - axis)) for axis in (0, 1))
        part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        plate, matte = photograph[part][..., :3], subject.matte[part][..., None]
        size = size_within(matte.shape, SIDE)
        small = Subject(
            resized(np.ascontiguousarray(plate), size), resized(matte.copy(), size)[..., 0].clip(0, 1)
        )
        _last[:] = [subject, small]
    return _last[1]


def picture(small: Subject, preset: str, gain: float) -> np.ndarray:
    """Return the upper part of a small copy in the light of a preset (h, w, 4), linear and premultiplied.

    `gain`: of the preset's lights, which leaves the face as bright as in the photograph.
    """
    height = min(small.size[0], round(TALLEST * small.size[1]))
    return small.relit(scaled(presets.named(preset), gain), presets.gloss(preset))[:height]
