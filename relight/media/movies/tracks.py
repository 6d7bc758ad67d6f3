"""What a movie carries beside its pictures: timecode, tags and sound, taken over from another movie."""

import io
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Self

import av
from av.audio.stream import AudioStream
from av.container import OutputContainer
from av.stream import Stream

from relight.media.movies.streams import opened
from relight.media.privacy import is_private
from shadow.files import AnyPath

# Tags of a container that describe the file itself, and those that a new one writes by itself.
OWN_TAGS = {"comment", "compatible_brands", "encoder", "major_brand", "minor_version", "timecode"}


@dataclass(frozen=True)
class Tracks:
    """What is to be carried."""

    timecode: str | None = None  # of the first frame, such as 01:00:00:00
    tags: dict[str, str] = field(default_factory=dict)  # of the container
    sound: Path | None = None  # the movie whose sound is copied, without encoding it again
    start: Fraction = Fraction(0)  # of the part of the sound, in seconds of that movie
    end: Fraction = Fraction(0)


def read_tags(path: AnyPath) -> tuple[str | None, dict[str, str], bool]:
    """Read the timecode of a movie's first frame, None without one, its container's tags, and whether it has
    sound.

    What is private is left out, see `relight.media.privacy`.
    """
    with opened(path) as container:
        streams = [stream.metadata for stream in (*container.streams.video, *container.streams)]
        stated = [  # Matroska writes names in capitals
            text
            for each in (*streams, container.metadata)
            for name, text in each.items()
            if text and name.lower() == "timecode"
        ]
        tags = {
            name: text
            for name, text in container.metadata.items()
            if name.lower() not in OWN_TAGS and not is_private(name, text)
        }
        return (stated[0] if stated else None), tags, bool(container.streams.audio)


class SoundCopier:
    """Copies packets of sound into a movie that is being written, as far as its pictures have come."""

    def __init__(self, file: OutputContainer, path: Path, tracks: Tracks) -> None:
        """Add a stream for each of the source's. Warns of sound that the container cannot hold."""
        self._file, self._tracks = file, tracks
        self._source = None if tracks.sound is None else opened(tracks.sound)
        self._streams: dict[int, AudioStream] = {}
        for stream in () if self._source is None else self._source.streams.audio:
            if _holds(file, stream):
                self._streams[stream.index] = file.add_stream_from_template(stream)
            else:
                name = stream.codec_context.name if stream.codec_context else "unknown"
                warnings.warn(
                    f"{path}: holds no sound of the codec {name}; the sound is left out", stacklevel=4
                )
        self._coming = self._packets()
        self._next = next(self._coming, None)

    def copy_until(self, seconds: Fraction) -> None:
        """Copy the sound of the pictures before `seconds` of the movie that is written."""
        while self._next is not None and self._next[0] < seconds:
            self._file.mux(self._next[1])
            self._next = next(self._coming, None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._source is not None:
            self._source.close()

    def _packets(self) -> Iterator[tuple[Fraction, av.Packet]]:
        """Yield times from the start, and packets that belong to the part.

        The packet in which the part begins is among them, and the one before it, from which decoders of
        compressed sound start. Their times are negative, and the container says where the sound begins.
        """
        if self._source is None or not self._streams:
            return
        wanted = [stream for stream in self._source.streams.audio if stream.index in self._streams]
        before: dict[int, list[av.Packet]] = {stream.index: [] for stream in wanted}
        for packet in self._source.demux(wanted):
            if packet.pts is None or packet.dts is None:
                continue
            time = packet.pts * packet.time_base
            if time >= self._tracks.end:
                return
            index = packet.stream.index
            if time < self._tracks.start:
                before[index] = [*before[index][-1:], packet]
                continue
            for each in (*_needed(before.pop(index, []), self._tracks.start), packet):
                shift = round(self._tracks.start / each.time_base)
                each.pts, each.dts = (each.pts or 0) - shift, (each.dts or 0) - shift
                each.stream = self._streams[index]
                yield each.pts * each.time_base, each


def _needed(before: list[av.Packet], start: Fraction) -> list[av.Packet]:
    """Return those of the two packets before a part that its first sound is decoded from."""
    if not before:
        return []
    last = before[-1]
    straddles = ((last.pts or 0) + (last.duration or 0)) * last.time_base > start
    is_compressed = not last.stream.codec_context.name.startswith("pcm")
    return before[-(straddles + is_compressed) :] if straddles or is_compressed else []


def _holds(file: OutputContainer, stream: Stream) -> bool:
    """Return whether a container takes a stream: a file of it alone is begun in memory."""
    if stream.codec_context is None or stream.codec_context.codec.canonical_name not in file.supported_codecs:
        return False
    try:
        with av.open(io.BytesIO(), "w", format=file.format.name) as trial:
            trial.add_stream_from_template(stream)
            trial.start_encoding()
    except (av.error.FFmpegError, ValueError):
        return False
    return True
