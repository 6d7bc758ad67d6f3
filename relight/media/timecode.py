"""Timecode of SMPTE ST 12-1: as movies write it, 01:00:10:05, and as OpenEXR and DPX pack it."""

import math
import re
from fractions import Fraction

TEXT = re.compile(r"(\d{1,2}):(\d\d):(\d\d)([:;.])(\d\d)")  # a semicolon or a point drops frame numbers
DROP = 1 << 6  # the bit of packed timecode that says so
DROPPING = (30000 / 1001, 60000 / 1001)  # rates at which numbers are dropped
MOST_PACKED = 39  # frames: their tens have two bits


def offset_timecode(text: str, frames: int, rate: float | Fraction) -> str | None:
    """Return the timecode of a frame that is `frames` later; None for a text that is no timecode.

    >>> offset_timecode("01:00:59:24", 1, 25)
    '01:01:00:00'
    >>> offset_timecode("00:00:59;29", 1, Fraction(30000, 1001))
    '00:01:00;02'
    """
    since_midnight = frames_of(text, rate)
    if since_midnight is None:
        return None
    mark, count, total = text[-3], round(rate), since_midnight + frames
    if dropped := _dropped(mark, count):
        tens, rest = divmod(total, 600 * count - 9 * dropped)
        total += 9 * dropped * tens + dropped * (max(rest - dropped, 0) // (60 * count - dropped))
    total %= 24 * 3600 * count
    seconds, number = divmod(total, count)
    minutes, seconds = divmod(seconds, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours:02d}:{minutes:02d}:{seconds:02d}{mark}{number:02d}"


def frames_of(text: str, rate: float | Fraction) -> int | None:
    """Return the number of frames from midnight to a timecode; None for a text that is no timecode.

    >>> frames_of("00:01:00;02", Fraction(30000, 1001))
    1800
    """
    match = TEXT.fullmatch(text)
    count = round(rate)
    if match is None or count < 1:
        return None
    hours, minutes, seconds, number = (int(match[group]) for group in (1, 2, 3, 5))
    minutes += 60 * hours
    return (60 * minutes + seconds) * count + number - _dropped(match[4], count) * (minutes - minutes // 10)


def _dropped(mark: str, count: int) -> int:
    """Return how many numbers are left out in each minute but the tenth, by the mark before the frames."""
    return count // 15 if mark != ":" else 0


def suits_rate(text: str, rate: float | Fraction) -> bool:
    """Return whether a movie of `rate` frames a second can have a timecode: its number, and dropped numbers.

    >>> suits_rate("01:00:00:29", 24), suits_rate("01:00:00;29", 30), suits_rate("01:00:00;29", 30000 / 1001)
    (False, False, True)
    """
    match = TEXT.fullmatch(text)
    if match is None or int(match[5]) >= round(rate):
        return False
    return match[4] == ":" or any(math.isclose(rate, ntsc, rel_tol=1e-5) for ntsc in DROPPING)


def packs(rate: float | Fraction) -> bool:
    """Return whether OpenEXR can hold all frame numbers at `rate` frames a second."""
    return round(rate) <= MOST_PACKED + 1


def pack_timecode(text: str) -> tuple[int, int] | None:
    """Return OpenEXR's time and user data of a timecode; None for a text or a number that it cannot hold."""
    match = TEXT.fullmatch(text)
    if match is None or int(match[5]) > MOST_PACKED:
        return None
    digits = [int(match[group]) for group in (5, 3, 2, 1)]
    packed = sum((value % 10 | value // 10 << 4) << 8 * place for place, value in enumerate(digits))
    return packed | (DROP if match[4] != ":" else 0), 0


def unpack_timecode(packed: int) -> str:
    """Return the timecode that OpenEXR's time and flags say.

    >>> unpack_timecode(pack_timecode("10:20:30:12")[0])
    '10:20:30:12'
    """
    masks = (0x3F, 0x7F, 0x7F, 0x3F)  # of frames, seconds, minutes and hours; the other bits are flags
    pairs = [packed >> 8 * place & mask for place, mask in enumerate(masks)]
    number, seconds, minutes, hours = (10 * (pair >> 4) + (pair & 15) for pair in pairs)
    return f"{hours:02d}:{minutes:02d}:{seconds:02d}{';' if packed & DROP else ':'}{number:02d}"
