"""The frames of a stream: decoded, and taken apart where two fields are woven into one."""

import itertools
from collections.abc import Iterator
from fractions import Fraction

import av
from av.container import InputContainer
from av.video.stream import VideoStream

from relight.media.movies.streams import demuxed

TOP_FIRST, BOTTOM_FIRST = (2, 5), (3, 4)  # of FFmpeg's AVFieldOrder, by the field that is shown first
# Codecs whose frames say themselves whether they are interlaced, each for itself.
CODECS_STATING_FIELDS = ("dnxhd", "dvvideo", "h264", "hevc", "mpeg2video", "mpeg4", "prores", "vc1")
ADAM7 = ("apng", "png")  # what FFmpeg calls interlaced in their frames is the order of pixels in the file


def decode(
    container: InputContainer, stream: VideoStream, codec: str, *, stop: bool
) -> Iterator[av.VideoFrame]:
    """Yield a stream's frames. Frames that cannot be decoded are left out, or are the end if `stop`."""
    context = stream.codec_context
    if codec != context.name:
        created = av.CodecContext.create(codec, "r")
        assert isinstance(created, av.VideoCodecContext)
        context = created
        context.extradata = stream.codec_context.extradata
        for name in ("color_primaries", "color_trc", "colorspace", "color_range"):
            setattr(context, name, getattr(stream.codec_context, name))
    for packet, _ in demuxed(container, stream):
        try:
            yield from context.decode(packet if packet.size else None)
        except av.error.FFmpegError:
            if stop:
                return


def deinterlaced(frames: Iterator[av.VideoFrame], stream: VideoStream) -> Iterator[av.VideoFrame]:
    """Yield a frame for each; in frames of two fields, rows of one field are filled in (BWDIF)."""
    context = stream.codec_context
    order = 0 if context.name in CODECS_STATING_FIELDS else int(context.field_order)
    graph: av.filter.Graph | None = None
    for frame in frames:
        stated = frame.interlaced_frame and context.name not in ADAM7
        if graph is None and not stated and order not in (*TOP_FIRST, *BOTTOM_FIRST):
            yield frame
            continue
        if frame.time_base is None:  # PyAV sets it for the first frame of several alone
            frame.time_base = stream.time_base
        if graph is None:
            graph = _field_graph(frame, 0 if stated else order)
        graph.push(frame)
        yield from _pulled(graph, stream.time_base)
    if graph is not None:
        graph.push(None)
        yield from _pulled(graph, stream.time_base)


def _field_graph(frame: av.VideoFrame, order: int) -> av.filter.Graph:
    """Return a filter graph that deinterlaces frames like this one.

    `order`: the stream's, which the frames do not say; 0 where they do.
    """
    graph = av.filter.Graph()
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format, time_base=frame.time_base
    )
    chain = [source]
    if order:
        chain.append(graph.add("setfield", "tff" if order in TOP_FIRST else "bff"))
    chain += [graph.add("bwdif", "mode=send_frame:parity=auto:deint=interlaced"), graph.add("buffersink")]
    for one, other in itertools.pairwise(chain):
        one.link_to(other)
    graph.configure()
    return graph


def _pulled(graph: av.filter.Graph, time_base: Fraction | None) -> Iterator[av.VideoFrame]:
    """Yield what a graph has ready, its times in units of `time_base`: the filter counts in fields."""
    while True:
        try:
            frame = graph.pull()
            assert isinstance(frame, av.VideoFrame)
        except (av.error.BlockingIOError, av.error.EOFError):
            return
        if frame.pts is not None and frame.time_base and time_base:
            frame.pts, frame.time_base = round(frame.pts * frame.time_base / time_base), time_base
        yield frame
