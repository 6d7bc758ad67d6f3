"""The forms in which movies are written: codec, layout of pixels, and what their codes mean."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from av.video.reformatter import ColorPrimaries, Colorspace, ColorTrc

from relight.media import encodings

Codec = Literal["h264", "hevc", "prores", "dnxhr"]
Hdr = Literal["hlg", "pq"]

OF_SUFFIX: dict[str, tuple[Codec, ...]] = {".mp4": ("h264", "hevc"), ".mov": ("prores", "dnxhr")}
LEAST = {"dnxhr": (120, 256)}  # rows and columns that the encoder takes
NO_HDR = {  # why a codec is not written in HLG and PQ
    "h264": "H.264 has 8 bits here",
    "dnxhr": "FFmpeg's encoder of DNxHR states the matrix of BT.709 in each frame",
}
HDR_NAMES = {int(ColorTrc.SMPTE2084): "PQ", int(ColorTrc.ARIB_STD_B67): "HLG"}


@dataclass(frozen=True)
class Encoder:
    """An encoder of FFmpeg: its name, options and layout of pixels; the layout with alpha, if it has one."""

    name: str
    layout: str
    options: dict[str, str]
    with_alpha: tuple[str, dict[str, str]] | None = None
    tag: str | None = None  # of the codec in the file, where FFmpeg chooses one that players do not take


# The same frames give the same file, on any machine: one number of threads, and of x264 no macroblock tree,
# whose AVX-512 routines read memory that nobody has written. x265 is not so: some bits of a file differ
# from run to run. With B-frames the only packet of a movie of one frame is refused at times in an .mp4.
X265 = "pools=4:frame-threads=1:bframes=0:log-level=error"
ENCODERS: dict[Codec, Encoder] = {
    "h264": Encoder(
        "libx264", "yuv420p", {"crf": "16", "preset": "medium", "threads": "4", "mbtree": "0"}
    ),
    "hevc": Encoder(
        "libx265", "yuv420p10le",
        {"crf": "16", "preset": "medium", "x265-params": X265},
        tag="hvc1",
    ),
    "prores": Encoder(
        "prores_ks", "yuv422p10le", {"profile": "3", "vendor": "apl0"},
        with_alpha=("yuva444p10le", {"profile": "4", "vendor": "apl0"}),
    ),
    "dnxhr": Encoder("dnxhd", "yuv422p10le", {"profile": "dnxhr_hqx"}),
}  # fmt: skip


@dataclass(frozen=True)
class Colours:
    """What code values mean: primaries, transfer function and matrix of ITU-T H.273."""

    primaries: ColorPrimaries = ColorPrimaries.BT709
    transfer: ColorTrc = ColorTrc.BT709
    matrix: Colorspace = Colorspace.ITU709
    encode: Callable[[np.ndarray], np.ndarray] = field(default=encodings.encode_bt709)


SDR = Colours()
HDR: dict[Hdr, Colours] = {
    "hlg": Colours(
        ColorPrimaries.BT2020, ColorTrc.ARIB_STD_B67, Colorspace.BT2020, encodings.encode_hlg
    ),
    "pq": Colours(ColorPrimaries.BT2020, ColorTrc.SMPTE2084, Colorspace.BT2020, encodings.encode_pq),
}  # fmt: skip


@dataclass(frozen=True)
class Form:
    """The form of a movie: `codec`, that of the suffix unless given; `hdr`: BT.709 unless given."""

    codec: Codec | None = None
    hdr: Hdr | None = None

    def codec_of(self, path: Path) -> Codec:
        """Return the codec of a file. Raises ValueError for one that it does not hold, or not in HDR."""
        known = OF_SUFFIX[path.suffix.lower()]
        default: Codec = "hevc" if self.hdr is not None and "hevc" in known else known[0]
        chosen = self.codec or default
        if chosen not in known:
            raise ValueError(f"codec: expected {' or '.join(known)} for {path}, got {chosen}")
        if self.hdr is not None and chosen in NO_HDR:
            raise ValueError(f"codec: expected hevc (.mp4) or prores (.mov) with hdr: {NO_HDR[chosen]}")
        return chosen

    def holds_alpha(self, path: Path) -> bool:
        """Return whether a file of this form holds alpha."""
        return ENCODERS[self.codec_of(path)].with_alpha is not None

    def check_size(self, path: Path, size: Sequence[int]) -> None:
        """Raise ValueError for frames (H, W) that are too small for the codec."""
        codec = self.codec_of(path)
        rows, columns = LEAST.get(codec, (1, 1))
        if size[0] < rows or size[1] < columns:
            raise ValueError(f"{path}: expected at least {columns} x {rows} pixels for {codec}")

    @property
    def colours(self) -> Colours:
        """What code values mean."""
        return SDR if self.hdr is None else HDR[self.hdr]


BY_SUFFIX = Form()
