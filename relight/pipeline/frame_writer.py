"""Writes the relit frames of a shot to its outputs; a frame that exists is recognised by its hash."""

import warnings

import numpy as np

from relight.compositing.composite import backdrop
from relight.media import images
from relight.media.content_hash import HASH_ATTRIBUTE, content_hash
from relight.media.pixel_aspect import squeeze_pixels
from relight.media.sequences import FrameRange
from relight.pipeline.delivery import Delivery
from relight.pipeline.option_fields import Phase, Report
from relight.pipeline.options import Output
from relight.pipeline.outputs import is_exr
from relight.pipeline.rendered_frame import RenderedFrame
from relight.pipeline.shot import Shot
from relight.pipeline.sinks import FileSink, MovieSink, Sinks, file_of
from relight.rendering import metadata_of, render_layers
from relight.subject import Subject

MAX_BACKGROUND_FACTOR = 8.0  # of a background that is lit as the person is


class FrameWriter:
    """Writes the frames of a shot to its outputs.

    `sinks`: what `open_sinks` made of the output. `delivery`: what the outputs keep of the source. `phase`:
    "finalize" only checks that the frames exist. `resume`: whether to keep existing frames that were made
    from the same inputs.
    """

    def __init__(
        self,
        shot: Shot,
        output: Output,
        sinks: Sinks,
        delivery: Delivery,
        phase: Phase,
        resume: bool,
    ) -> None:
        self._shot, self._output, self._sinks, self._delivery = shot, output, sinks, delivery
        self._phase, self._resume = phase, resume
        self._mattes = None if output.save_matte is None else file_of(output.save_matte)
        self.hashes: dict[int, str] = {}  # {frame number: content hash of what it is made from}

    def begin(self, numbers: FrameRange, report: Report) -> None:
        """Find out which frames exist already, and prepare the sinks."""
        if self._resume or self._phase == "finalize":
            for done, number in enumerate(numbers, 1):
                self.hashes[number] = self._content_hash(number)
                report(done, len(numbers), "Checking")
        self._sinks.begin(self.hashes)
        if self._resume:
            self._warn_of_replaced()

    def write(self, number: int) -> None:
        """Write the frame to all outputs that lack it, and its matte. Raises OSError or ValueError."""
        made = self.hashes.get(number) or self._content_hash(number)
        if self._phase == "finalize":
            self._check_exists(number, made)
        else:
            made = self._write(number, made)
        self.hashes[number] = made

    def _warn_of_replaced(self) -> None:
        sinks, hashes = self._sinks.frames, self.hashes
        others = sum(any(s.exists(n) and not s.has(n, made) for s in sinks) for n, made in hashes.items())
        if others:
            warnings.warn(
                f"resume: {others} of {len(hashes)} frames were made with other lights, sources, options, "
                "weights or by another version, and are made again",
                stacklevel=5,
            )

    def _content_hash(self, number: int, as_read: bool = False) -> str:
        """Return a hash of all from which a frame is made. `as_read`: see `Shot.content_hash`."""
        shot, lighting = self._shot, self._shot.lighting
        return content_hash(
            shot.content_hash(number, as_read), self._output.passes, lighting.floor, lighting.effective_gloss,
            lighting.background_light,
            self._delivery.keeps_plate,
        )  # fmt: skip

    def _check_exists(self, number: int, made: str) -> None:
        """Raise ValueError if an output lacks the frame."""
        for sink in self._sinks.frames:
            if not sink.has(number, made):
                state = "made with other lights, sources or options" if sink.exists(number) else "not there"
                raise ValueError(f"{sink.path}: the frame is {state}")

    def _write(self, number: int, made: str) -> str:
        """See `write`; return the hash of what the frame is made from."""
        missing = [sink for sink in self._sinks.frames if not sink.has(number, made)]
        matte = self._mattes is not None and not (
            self._resume and images.read_content_hash(self._mattes.path(number)) == made
        )
        if not missing and not matte:
            return made
        person = self._shot.person(number)
        made = self._content_hash(number, as_read=True)
        if missing:
            self._write_picture(number, person, missing, made)
        if matte:
            self._write_matte(number, person, made)
        return made

    def _write_picture(
        self, number: int, person: Subject, sinks: list[FileSink | MovieSink], made: str
    ) -> None:
        """Render the frame, and write it to some of the sinks."""
        shot, output, size = self._shot, self._output, person.size
        rendering = render_layers(
            person, [*shot.exposed_lights(number), *shot.background_lights(number, size)],
            passes=output.passes, exr_type=output.exr_type, floor=shot.lighting.floor,
            gloss=shot.lighting.effective_gloss, amount=shot.lighting.amount,
            layered=any(map(is_exr, output.paths)),
        )  # fmt: skip
        kept = self._delivery.keeps_plate
        behind = shot.behind(number, person, kept)
        back = None if behind is None else backdrop(behind, size, rendering.shadow)
        keeps_codes = shot.keeps_codes(kept)
        if back is not None and shot.lighting.background_light:
            back, keeps_codes = back * self._background_factor(person, rendering.cut_out), False
        frame = RenderedFrame(rendering, back, kept, keeps_codes)
        metadata = {**self._delivery.metadata(number), **metadata_of(person, output.passes)}
        for sink in sinks:
            sink.write(number, frame, made, metadata)

    def _background_factor(self, person: Subject, relit: np.ndarray) -> np.ndarray:
        """Return the factor (3,) of a background that a share of the person's light reaches, on average.

        `relit`: (H, W, 4), the picture. The light is that of the picture over the photograph.
        """
        share = np.float32(self._shot.lighting.background_light)
        after, before = (each[..., :3].sum(axis=(0, 1)) for each in (relit, person.relit([], amount=0)))
        whole = np.divide(after, before, out=np.ones(3, np.float32), where=before > 0)
        return 1 + share * (whole.clip(0, MAX_BACKGROUND_FACTOR) - 1)

    def _write_matte(self, number: int, person: Subject, made: str) -> None:
        """Write the person's matte; an .exr has pixels of the plate's shape."""
        assert self._mattes is not None
        path, matte = self._mattes.path(number), person.matte
        metadata: images.Metadata = {HASH_ATTRIBUTE: made}
        if is_exr(path) and self._delivery.pixel_aspect != 1:
            matte = squeeze_pixels(matte, self._delivery.pixel_aspect).clip(0, 1)
            metadata = {**metadata, "PixelAspectRatio": self._delivery.pixel_aspect}
        images.write_mask(path, matte, metadata=metadata)
