"""What the outputs of a shot keep of its source: the shape of pixels, timecode, camera metadata and sound."""

import warnings
from fractions import Fraction

import numpy as np

from relight.media import images, movies
from relight.media.movies import RATE
from relight.media.movies.tracks import Tracks
from relight.media.pixel_aspect import squeeze_pixels
from relight.media.sequences import FrameRange
from relight.media.timecode import suits_rate
from relight.pipeline.preview import EVERY
from relight.pipeline.shot import Shot
from relight.rendering import Layers

FOCAL_LENGTH = "relight:focal_length"


class Delivery:
    """What is kept of a shot's plates in .exr, .mov and .mp4.

    pixel_aspect: how many times as wide as high the pixels of the plates are, and of what is written; 1 where
    the picture has a size of its own. form: of movies.
    """

    def __init__(
        self,
        shot: Shot,
        rate: float | Fraction | None = None,
        form: movies.Form = movies.BY_SUFFIX,
    ) -> None:
        """`rate`: of the outputs, in frames a second; the source's unless given."""
        self.form = form
        self.pixel_aspect, self._plate_metadata = shot.frames.pixel_aspect, shot.frames.plate_metadata
        self._stated, self._is_preview = shot.rate, shot.is_preview
        self.rate: float | Fraction = rate or self._stated or RATE
        if shot.is_preview:
            self.rate = movies.frame_rate(self.rate) / EVERY
        self._warned = False
        self._timecode: str | None = None  # of the plate whose metadata was asked for last

    def metadata(self, number: int) -> images.Metadata:
        """Return what the header of an .exr states of a plate's scene and camera."""
        metadata = self._plate_metadata(number)
        self._timecode = metadata.timecode
        return metadata.header

    def warn_of_timecode(self, path: object, metadata: images.Metadata) -> None:
        """Warn, once, if the plate of the last `metadata` has a timecode that the header of an .exr lacks."""
        if self._timecode is None or images.TIMECODE in metadata or self._warned:
            return
        self._warned = True
        rate = float(self._stated or RATE)
        warnings.warn(f"{path}: OpenEXR files hold no timecode at {rate:g} frames a second", stacklevel=2)

    def tracks(self, numbers: FrameRange, path: object) -> Tracks:
        """Return what a movie of these frames carries. `path`: of the movie, for warnings."""
        first, last = self._plate_metadata(numbers[0]), self._plate_metadata(numbers[-1])
        if self._is_preview:
            return Tracks(tags=first.tags)
        timecode = first.timecode
        if timecode is not None and not suits_rate(timecode, self.rate):
            warnings.warn(
                f"{path}: has no timecode, as {timecode} is none at {float(self.rate):g} frames a second",
                stacklevel=2,
            )
            timecode = None
        silent = Tracks(timecode, first.tags)
        if first.sound is None or last.sound is None:
            return silent
        rates = {movies.frame_rate(each) for each in (self.rate, self._stated or RATE)}
        if len(numbers) != numbers[-1] - numbers[0] + 1 or len(rates) > 1:
            why = f"as its frames are not all those of a part of {first.sound}, at its rate"
        elif not first.sound.is_file():  # it may have been moved since it was analysed
            why = f"as {first.sound} is not there"
        else:
            return Tracks(timecode, first.tags, first.sound, first.begin, last.end)
        warnings.warn(f"{path}: has no sound, {why}", stacklevel=2)
        return silent

    def squeeze_layers(
        self, picture: np.ndarray, layers: Layers, metadata: images.Metadata, exr_type: str
    ) -> tuple[np.ndarray, Layers, images.Metadata]:
        """Return a picture and its layers with pixels of the plates' shape, and what the header says.

        Light groups are averaged, and the picture is their sum again; of passes, single values are taken,
        since positions and normals of two surfaces are not to be mixed.
        """
        if self.pixel_aspect == 1:
            return picture, layers, metadata
        squeezed: Layers = {}
        for name, layer in layers.items():
            is_light = name.startswith(("C_", "shadow_floor"))
            pixels = squeeze_pixels(layer, self.pixel_aspect, nearest=not is_light)
            if is_light and exr_type == "half":
                pixels = images.half(np.asarray(pixels, np.float32), name)
            squeezed[name] = pixels
        picture = squeeze_pixels(picture, self.pixel_aspect)
        groups = [layer[..., :3] for name, layer in squeezed.items() if name.startswith("C_")]
        if groups:
            picture = np.concatenate([np.sum(groups, axis=0), picture[..., 3:]], axis=-1, dtype=np.float32)
        shape: dict[str, float] = {"PixelAspectRatio": self.pixel_aspect}
        focal = metadata.get(FOCAL_LENGTH)
        if isinstance(focal, float):  # in heights of a pixel
            shape[FOCAL_LENGTH] = focal * min(self.pixel_aspect, 1)
        return picture, squeezed, {**metadata, **shape}
