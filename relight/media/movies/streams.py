"""Which stream of a container is the movie, and what the container says of it."""

import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import av
from av.container import InputContainer
from av.format import Flags
from av.stream import Disposition
from av.video.stream import VideoStream

from relight.media.images.containers.pages import check_size
from relight.media.pixel_aspect import growth
from relight.media.regular_file import check_regular_file, naming
from shadow.files import AnyPath

# FFmpeg's own decoders of VP8 and VP9 leave alpha out; libvpx's do not.
ALPHA_DECODERS = {"vp8": "libvpx", "vp9": "libvpx-vp9", "libvpx": "libvpx", "libvpx-vp9": "libvpx-vp9"}
COVER = Disposition.attached_pic | Disposition.timed_thumbnails
DOLBY_VISION = re.compile(r"DOVI configuration record:.*profile: (\d+).*compatibility id: (\d+)")
STREAM = re.compile(r"^  Stream #\d+:(\d+)", re.MULTILINE)
CROPPING = re.compile(r"^      Frame Cropping: (\d+)/(\d+)/(\d+)/(\d+)$", re.MULTILINE)
DOLBY_VISION_CODECS = ("av1", "hevc", "h264", "libdav1d")
FIRST_WITH_FALLBACK = 8  # Dolby Vision's profiles from here on say whether other players can show them


def opened(path: AnyPath, **options: str) -> InputContainer:
    """Open a movie to read. Its tags may be in any encoding, as those of an old AVI are.

    Raises as `relight.media.regular_file.check_regular_file` does.
    """
    return av.open(str(check_regular_file(path)), options=options, metadata_errors="replace")


def video_stream(container: InputContainer, path: AnyPath) -> VideoStream:
    """Return the first stream of moving pictures. ValueError for a codec that cannot be decoded.

    Cover art and thumbnails are streams of pictures, too, in any place among the others.
    """
    streams = [stream for stream in container.streams.video if not stream.disposition & COVER]
    if not streams:
        content = "cover art alone" if container.streams.video else "no pictures"
        raise ValueError(f"{path}: cannot be read as a movie: it holds {content}")
    if streams[0].codec_context is None:
        raise ValueError(f"{path}: is in a codec that FFmpeg does not decode")
    with naming(path):
        width = round(streams[0].width * growth(float(pixel_aspect(streams[0]))))
        check_size(width, streams[0].height, Path(path).stat().st_size)
    return streams[0]


def pixel_aspect(stream: VideoStream) -> Fraction:
    """Return how many times as wide as high a movie's pixels are, by the container before the codec."""
    return Fraction(stream.sample_aspect_ratio or 1) or Fraction(1)


def decoder_name(path: Path, stream: VideoStream) -> str:
    """Return the name of the decoder that gives a stream's alpha, or else its usual one."""
    name = stream.codec_context.name
    tags = {key.lower(): value for key, value in stream.metadata.items()}
    if tags.get("alpha_mode") != "1" or name not in ALPHA_DECODERS:
        return name
    if ALPHA_DECODERS[name] not in av.codecs_available:
        raise ValueError(
            f"{path}: has alpha that this FFmpeg does not decode: expected its decoder {ALPHA_DECODERS[name]}"
        )
    return ALPHA_DECODERS[name]


def check_dolby_vision(container: InputContainer, stream: VideoStream, path: AnyPath) -> None:
    """Raise ValueError for Dolby Vision whose pictures are in a colour space of its own.

    That is profile 5, and others that say compatibility 0; the rest is PQ, HLG or BT.709 beside it.
    """
    if stream.codec_context.name not in DOLBY_VISION_CODECS:
        return
    described = _described(container)
    for match in DOLBY_VISION.finditer(described):
        profile, compatibility = map(int, match.groups())
        if profile == 5 or (profile >= FIRST_WITH_FALLBACK and compatibility == 0):
            raise ValueError(
                f"{path}: is in Dolby Vision profile {profile}, whose colours need its own decoder; convert "
                "it to HDR10, HLG or BT.709"
            )


def _described(container: Any) -> str:
    """Return FFmpeg's description of a container, in which PyAV tells a stream's side data alone."""
    level = av.logging.get_level()
    av.logging.set_level(av.logging.INFO)
    try:
        return container.dumps_format()
    finally:
        av.logging.set_level(level)


def clean_aperture(container: InputContainer, stream: VideoStream, path: AnyPath) -> tuple[slice, slice]:
    """Return the rows and columns that a container shows: QuickTime's `clap`, Matroska's PixelCrop.

    Raises ValueError where nothing is left.
    """
    of_stream = STREAM.split(_described(container))  # text, index of a stream, text, ...
    texts = dict(zip(of_stream[1::2], of_stream[2::2], strict=True))
    match = CROPPING.search(texts.get(str(stream.index), ""))
    left, right, top, bottom = map(int, match.groups()) if match else (0, 0, 0, 0)
    rows, columns = slice(top, stream.height - bottom), slice(left, stream.width - right)
    if rows.start >= rows.stop or columns.start >= columns.stop:
        raise ValueError(f"{path}: is damaged: its clean aperture shows none of its pixels")
    return rows, columns


def demuxed(container: InputContainer, stream: VideoStream) -> Iterator[tuple[av.Packet, bool]]:
    """Yield a stream's packets, and whether the times of the file start again with this one.

    In transport and program streams that were joined, times start again with each part. Here they go on: a
    later part begins where the one before it ends.
    """
    joinable = bool(container.format.flags & cast(int, Flags.ts_discont.value))
    shift, step = 0, 0
    last: int | None = None
    for packet in container.demux(stream):
        starts_again = False
        if joinable and last is not None and packet.dts is not None and packet.dts < last:
            starts_again, shift = True, shift + last + step - packet.dts
        if packet.dts is not None:
            step = packet.duration or (packet.dts - last if last is not None and packet.dts > last else step)
            last = packet.dts
            packet.dts += shift
        if packet.pts is not None:
            packet.pts += shift
        yield packet, starts_again
