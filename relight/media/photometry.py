"""Read how a lamp shines into each direction: IES files (LM-63-1986 to 2019) and EULUMDAT (.ldt).

The axes of a profile are those of a lamp that faces the person: its own axis, and right and up across it.

- Type C (and EULUMDAT): the vertical angle is 0 along the axis and 180 behind; the horizontal one, C, turns
  about the axis from right (0) to up (90). A luminaire that hangs is measured facing straight down.
- Type B: the poles are right and left. The horizontal angle rises toward right, the vertical one turns about
  the poles from the axis (0) to up (90).
- Type A: the poles are up and down. The vertical angle rises toward up, the horizontal one turns about the
  poles from the axis (0) to right (90).

ANSI/IES LM-63-19; A. W. Stockmar, "EULUMDAT", Licht '90. Of the packages that read such files, photompy
(0.3.1) brings matplotlib and warns of what it should refuse, eulumdat-ies (1.1.0) knows type C alone, and
eulumdat-py (1.0.0) fills up short files with zeros. None samples directions.
"""

from __future__ import annotations

import functools
import hashlib
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from relight.media.regular_file import check_regular_file, naming
from shadow.files import AnyPath, file_version

if TYPE_CHECKING:
    import torch

SUFFIXES = (".ies", ".ldt")
KINDS = {1: "C", 2: "B", 3: "A"}  # numbers of the types in LM-63
MOST_BYTES = 16 * 2**20
MOST_ANGLES = 10_000
EDGE = 1e-3  # degrees beyond the last angle that still count
FACTOR_YEARS = ("86", "91")  # versions of LM-63 with a ballast-lamp photometric factor
HEADER_LINES = 26  # of EULUMDAT, before the lamps
LAMP_LINES, RATIO_LINES = 6, 10  # of EULUMDAT: for each set of lamps, and the direct ratios


class Tilt(NamedTuple):
    """How the light of a lamp depends on its tilt: factors at angles, degrees from its design position."""

    angles: np.ndarray
    factors: np.ndarray


class PhotometricProfile:
    """How a lamp shines: candela (H, V) at horizontal (H,) and vertical angles (V,), in degrees.

    `kind` is "A", "B" or "C", see above. `absolute`: whether the lamp itself was measured, not its share
    of the lumens of a bare lamp. `content_hash` tells files of another content apart.
    """

    def __init__(
        self,
        kind: str,
        vertical: np.ndarray,
        horizontal: np.ndarray,
        candela: np.ndarray,
        *,
        absolute: bool = False,
        tilt: Tilt | None = None,
        path: Path | None = None,
    ) -> None:
        _check_angles("vertical", vertical)
        _check_angles("horizontal", horizontal)
        if not np.isfinite(candela).all() or candela.min() < 0:
            raise ValueError("expected finite candela of at least 0")
        if candela.max() == 0:
            raise ValueError("expected light; all its candela are 0")
        if kind == "C" and horizontal[0] == 0 and 180 < horizontal[-1] < 360:  # the last plane is the first
            horizontal, candela = np.r_[horizontal, 360.0], np.concatenate([candela, candela[:1]])
        self.kind, self.absolute, self.tilt, self.path = kind, absolute, tilt, path
        self.vertical, self.horizontal, self.candela = vertical, horizontal, candela
        sha = hashlib.sha256(kind.encode())
        for array in (vertical, horizontal, candela, *(tilt or ())):
            sha.update(np.ascontiguousarray(array, np.float64).tobytes())
        self.content_hash = sha.hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PhotometricProfile) and self.content_hash == other.content_hash

    def __hash__(self) -> int:
        return hash(self.content_hash)

    def __repr__(self) -> str:
        return f"PhotometricProfile({str(self.path)!r})"

    @property
    def peak(self) -> float:
        """The most candela into any direction."""
        return float(self.candela.max())

    @functools.cached_property
    def flux(self) -> float:
        """Lumens: the candela integrated over all directions."""
        import torch

        polar, azimuth = np.radians(np.arange(0.25, 180, 0.5)), np.radians(np.arange(0.5, 360))
        sine, cosine = np.sin(polar)[:, None], np.cos(polar)[:, None]
        directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine + 0 * azimuth])
        values = self.at(torch.from_numpy(np.float32(directions))).numpy()
        return float((values * sine).sum() * math.radians(0.5) * math.radians(1))

    def at(self, directions: torch.Tensor, angle_scale: float = 0.0) -> torch.Tensor:
        """Return candela (...) into unit directions (3, ...): right, up and along the axis; 0 where none are
        stated. `angle_scale`: UsdLux's, which multiplies the angles from the axis by one more."""
        vertical, horizontal = self._angles(directions)
        if angle_scale:
            vertical = vertical / max(1 + angle_scale, 1e-6)
        value, inside = _interpolated(self.vertical, self.horizontal, self.candela, vertical, horizontal)
        return value * inside

    def _angles(self, directions: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        import torch

        right, up, aim = directions.clamp(-1, 1)
        if self.kind == "C":
            azimuth = torch.rad2deg(torch.atan2(up, right)) % 360
            return torch.rad2deg(torch.acos(aim)), self._folded(azimuth)
        pole, across = (right, up) if self.kind == "B" else (up, right)
        rising, turning = torch.rad2deg(torch.asin(pole)), torch.rad2deg(torch.atan2(across, aim))
        vertical, horizontal = (turning, rising) if self.kind == "B" else (rising, turning)
        vertical = vertical.abs() if self.vertical[0] >= 0 else vertical
        return vertical, horizontal.abs() if self.horizontal[0] >= 0 else horizontal

    def _folded(self, azimuth: torch.Tensor) -> torch.Tensor:
        """Return the stated horizontal angle that is like an azimuth in [0, 360), by the file's symmetry."""
        import torch

        first, last = self.horizontal[0], self.horizontal[-1]
        if len(self.horizontal) == 1:
            return torch.full_like(azimuth, float(first))
        if first == 90 and last == 270:  # like on both sides of the plane through 90 and 270
            mirrored = (180 - azimuth) % 360
            return torch.where((azimuth < 90) | (azimuth > 270), mirrored, azimuth)
        if last <= 180:
            azimuth = torch.minimum(azimuth, 360 - azimuth)
        return torch.minimum(azimuth, 180 - azimuth) if last <= 90 else azimuth

    def tilt_factor(self, degrees: float) -> float:
        """Return the factor of the light of a lamp that is tilted by an angle from its design position."""
        return 1.0 if self.tilt is None else float(np.interp(degrees, self.tilt.angles, self.tilt.factors))


def read_profile(path: AnyPath) -> PhotometricProfile:
    """Read an IES file or a EULUMDAT file.

    Raises FileNotFoundError, and ValueError, which names the file, for what is neither, wrong counts, angles
    that do not rise, and candela that are not finite, negative or all 0.
    """
    file = check_regular_file(path)
    return _read(file, file_version(file))


@functools.lru_cache(maxsize=32)
def _read(path: Path, state: tuple[int, ...]) -> PhotometricProfile:
    """Read a file; `state` identifies this version of it for the cache."""
    with naming(path):
        if path.suffix.lower() not in SUFFIXES:
            raise ValueError(f"expected a lamp's profile, whose name ends in {' or '.join(SUFFIXES)}")
        if path.stat().st_size > MOST_BYTES:
            raise ValueError(f"expected at most {MOST_BYTES // 2**20} MiB")
        text = path.read_bytes().decode("utf-8-sig", "replace")
        return _eulumdat(text, path) if path.suffix.lower() == ".ldt" else _ies(text, path)


class _Numbers:
    """The numbers of a text, taken one after the other."""

    def __init__(self, text: str) -> None:
        self._words, self._taken = re.split(r"[\s,]+", text.strip()), 0

    def take(self, count: int, what: str) -> np.ndarray:
        """Return the next numbers; raises ValueError if there are fewer, or words that are none."""
        words = self._words[self._taken : self._taken + count]
        self._taken += count
        if len(words) < count:
            raise ValueError(f"expected {count} {what}, the file has {len(words)}")
        return np.array([_number(word, what) for word in words])

    def check_end(self) -> None:
        if extra := len([word for word in self._words[self._taken :] if word]):
            raise ValueError(
                f"expected no more than the candela that its counts state, got {extra} numbers more"
            )


def _number(word: str, what: str) -> float:
    try:
        value = float(word)
    except ValueError:
        raise ValueError(f"expected a number among the {what}, got {word[:40]!r}") from None
    if not math.isfinite(value):
        raise ValueError(f"expected finite {what}, got {word}")
    return value


def _count(value: float, what: str) -> int:
    if not (value.is_integer() and 1 <= value <= MOST_ANGLES):
        raise ValueError(f"expected a number of {what} from 1 to {MOST_ANGLES}, got {value:g}")
    return int(value)


def _ies(text: str, path: Path) -> PhotometricProfile:
    """Parse LM-63."""
    header, found, rest = (
        re.split(r"(?im)^\s*(TILT\s*=.*)$", text, maxsplit=1) if "=" in text else (text, "", "")
    )
    if not found:
        raise ValueError("expected an IES file with a line TILT=")
    numbers, word = _Numbers(rest), found.partition("=")[2].strip()
    tilt = None
    if word.upper() == "INCLUDE":
        tilt = _tilt(numbers)
    elif word.upper() != "NONE":
        beside = check_regular_file(path.with_name(Path(word.replace("\\", "/")).name))
        tilt = _tilt(_Numbers(beside.read_text("utf-8", "replace")))
    _, lumens, multiplier, rows, columns, kind, *_ = numbers.take(10, "numbers of the lamp").tolist()
    ballast, factor, _ = numbers.take(3, "numbers of the ballast").tolist()
    if kind not in KINDS:
        raise ValueError(f"expected photometry of type 1, 2 or 3, got {kind:g}")
    vertical = numbers.take(_count(rows, "vertical angles"), "vertical angles")
    horizontal = numbers.take(_count(columns, "horizontal angles"), "horizontal angles")
    candela = numbers.take(len(vertical) * len(horizontal), "candela").reshape(len(horizontal), -1)
    numbers.check_end()
    version = re.match(r"\s*IES(?:NA)?:?(?:LM-63-)?(?:19|20)?(\d\d)", header)
    scale = multiplier * ballast * (factor if version is None or version[1] in FACTOR_YEARS else 1.0)
    return PhotometricProfile(
        KINDS[int(kind)], vertical, horizontal, candela * scale, absolute=lumens < 0, tilt=tilt, path=path
    )


def _tilt(numbers: _Numbers) -> Tilt:
    """Parse what follows TILT=INCLUDE; how the lamp lies in the luminaire is not used."""
    _, count = numbers.take(2, "numbers of the tilt").tolist()
    pairs = _count(count, "tilts")
    angles, factors = numbers.take(pairs, "angles of the tilt"), numbers.take(pairs, "factors of the tilt")
    _check_angles("tilt", angles)
    return Tilt(angles, factors)


def _eulumdat(text: str, path: Path) -> PhotometricProfile:
    """Parse EULUMDAT, whose values are candela for 1000 lm of the lamps."""
    lines = [line.strip().replace(",", ".") for line in text.splitlines()]
    if len(lines) < HEADER_LINES:
        raise ValueError(
            f"expected the {HEADER_LINES} lines with which EULUMDAT begins, the file has {len(lines)}"
        )
    symmetry = _number(lines[2], "kinds of symmetry")
    planes = _count(_number(lines[3], "numbers of planes"), "planes")
    rows = _count(_number(lines[5], "numbers of angles"), "angles")
    conversion = _number(lines[23] or "1", "factors") or 1.0
    sets = _count(_number(lines[25], "sets of lamps"), "sets of lamps")
    lamps = lines[HEADER_LINES : HEADER_LINES + LAMP_LINES]
    if len(lamps) < LAMP_LINES:
        raise ValueError(f"expected {LAMP_LINES} lines of a set of lamps, the file has {len(lamps)}")
    count, lumens = _number(lamps[0], "lamps"), _number(lamps[2], "lumens")
    stored = {0: planes, 1: 1, 2: planes // 2 + 1, 3: planes // 2 + 1, 4: planes // 4 + 1}.get(int(symmetry))
    if stored is None:
        raise ValueError(f"expected a symmetry from 0 to 4, got {symmetry:g}")
    start = HEADER_LINES + LAMP_LINES * sets + RATIO_LINES
    numbers = _Numbers(" ".join(lines[start:]))
    horizontal = numbers.take(planes, "angles of planes")
    vertical = numbers.take(rows, "angles")
    values = numbers.take(stored * rows, "values").reshape(stored, rows)
    numbers.check_end()
    horizontal = {1: horizontal[:1], 3: np.linspace(90, 270, stored)}.get(int(symmetry), horizontal[:stored])
    if symmetry == 2 and len(horizontal) < stored:
        horizontal = np.r_[horizontal, 180.0]
    values = values[::-1] if symmetry == 3 else values  # from 270 through 0 to 90, which is like 270 to 90
    candela = values * conversion * lumens / 1000
    return PhotometricProfile("C", vertical, horizontal, candela, absolute=count < 0, path=path)


def _check_angles(name: str, angles: np.ndarray) -> None:
    if len(angles) > 1 and (np.diff(angles) <= 0).any():
        raise ValueError(f"expected {name} angles that rise")


def _interpolated(
    rows: np.ndarray, columns: np.ndarray, table: np.ndarray, row: torch.Tensor, column: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return a table's (columns, rows) values between its entries, and where they are within it."""
    import torch

    values = torch.from_numpy(np.float32(table))
    (below, down, in_rows), (before, across, in_columns) = _place(rows, row), _place(columns, column)
    under, after = (below + 1).clamp_max(len(rows) - 1), (before + 1).clamp_max(len(columns) - 1)
    near = values[before, below] * (1 - down) + values[before, under] * down
    far = values[after, below] * (1 - down) + values[after, under] * down
    return near * (1 - across) + far * across, in_rows & in_columns


def _place(grid: np.ndarray, at: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return the index before a position in a grid, the share of the way to the next, and if it is in it."""
    import torch

    stops = torch.from_numpy(np.float32(grid))
    inside = (at >= stops[0] - EDGE) & (at <= stops[-1] + EDGE)
    if len(grid) == 1:
        return torch.zeros_like(at, dtype=torch.long), torch.zeros_like(at), torch.ones_like(inside)
    at = at.clamp(float(stops[0]), float(stops[-1]))
    index = (torch.searchsorted(stops, at.contiguous(), right=True) - 1).clamp(0, len(grid) - 2)
    return index, (at - stops[index]) / (stops[index + 1] - stops[index]), inside
