"""Lights that move: parameters with keyframes, and orbits."""

import bisect
import itertools
import math
import re
import reprlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeGuard

import numpy as np

from relight.arguments import shown
from relight.lights.directional import DirectionalLight
from relight.lights.light import Light, Settings
from relight.lights.near import PointLight, RectLight

Keyframes = dict[float, float | tuple[float, ...]]  # {frame: value}, in the order of frames
FILES = frozenset({"image", "profile"})  # parameters that name a file
ORBIT_ANGLES = ("azimuth", "rotation")  # parameters to which an orbit adds its angle
ORBIT_POSITIONS = ("position", "toward")  # parameters that an orbit turns about the subject's vertical


@dataclass(frozen=True, init=False)
class MovingLight:
    """A light whose parameters change from frame to frame.

    Parameters
    ----------
    kind
        relight.DirectionalLight, PointLight, RectLight or EnvironmentLight.
    orbit
        Frames of one turn around the subject, negative for the other way. At frame 1 the light is at its
        azimuth (an environment at its rotation, a near light at its position), which grows from there.
    settings
        The parameters of `kind`. A number or a vector may be keyframes, {frame: value}. Between two of them
        it changes linearly, a `direction` along the great circle; before the first and after the last it is
        constant.

    Raises
    ------
    TypeError, ValueError
        What `kind` refuses at one of the keyframes; a frame that is no number; keyframes of text; opposite
        directions in succession, which many great circles join; an orbit of no frames, or of a light that is
        given by its direction.

    Examples
    --------
    >>> import relight
    >>> sunrise = relight.MovingLight(azimuth={1: -90, 101: 10}, elevation=20)
    >>> round(sunrise.at(51).azimuth)
    -40
    """

    kind: type[Light]
    orbit: float | None
    moves: dict[str, Keyframes]  # {parameter: {frame: value}}, in the order of frames
    rests: Settings  # {parameter: value}

    def __init__(
        self, kind: type[Light] = DirectionalLight, *, orbit: float | None = None, **settings: Any
    ) -> None:
        if not (isinstance(kind, type) and issubclass(kind, Light)):
            raise TypeError(f"kind: expected a class such as relight.DirectionalLight, got {shown(kind)}")
        if orbit is not None and not (_is_number(orbit) and orbit != 0):
            raise ValueError(f"orbit: expected the frames of a turn, not 0, got {reprlib.repr(orbit)}")
        if orbit is not None and "direction" in settings:
            raise ValueError("orbit: needs a light given by azimuth and elevation, not by its direction")
        moves = {key: _keyframes(key, value) for key, value in settings.items() if isinstance(value, dict)}
        object.__setattr__(self, "kind", kind)  # as frozen dataclasses initialise themselves
        object.__setattr__(self, "orbit", None if orbit is None else float(orbit))
        object.__setattr__(self, "moves", moves)
        object.__setattr__(self, "rests", {key: value for key, value in settings.items() if key not in moves})
        frames = sorted({1.0}.union(*moves.values()))
        between = [(first + last) / 2 for first, last in itertools.pairwise(frames)]
        lights = [self.at(frame) for frame in frames + between]  # what cannot be is refused now
        for key in FILES.intersection(self.rests):
            self.rests[key] = vars(lights[0])[key]  # read once, not at every frame

    @property
    def name(self) -> str | None:
        return self.rests.get("name")

    @property
    def span(self) -> tuple[float, float] | None:
        """The frames of the first and the last keyframe; None without keyframes."""
        frames = sorted({frame for keyframes in self.moves.values() for frame in keyframes})
        return (frames[0], frames[-1]) if frames else None

    def at(self, frame: float) -> Light:
        """Return the light at a frame, which may lie between whole ones."""
        settings = self.rests | {key: _between(key, frames, frame) for key, frames in self.moves.items()}
        turn = 0.0 if self.orbit is None else 360 * (frame - 1) / self.orbit
        for key in ORBIT_ANGLES if self.orbit is not None else ():
            if key in self.kind.parameters():
                settings[key] = settings.get(key, 0.0) + turn
        for key in ORBIT_POSITIONS if self.orbit is not None else ():
            if key in settings:
                settings[key] = _turned(settings[key], turn)
        return self.kind(**settings)

    def scaled(self, factor: float) -> "MovingLight":
        """Return the light of `factor` times its intensity."""
        before: Any = self.moves.get("intensity", self.rests.get("intensity", 1.0))
        if isinstance(before, dict):
            intensity = {frame: value * factor for frame, value in before.items()}
        else:
            intensity = before * factor
        return MovingLight(
            self.kind, orbit=self.orbit, **(self.rests | self.moves | {"intensity": intensity})
        )

    def settings(self) -> Settings:
        """Return {parameter: value or keyframes} of the constructor, without defaults."""
        rests = self.at(1).settings()
        direction = ("azimuth", "elevation") if "direction" in self.moves else ()
        settings = {key: value for key, value in rests.items() if key not in (*self.moves, *direction)}
        return settings | self.moves | ({} if self.orbit is None else {"orbit": self.orbit})


def lights_at(lights: Iterable[Light | MovingLight], frame: float) -> list[Light]:
    """Return the lights at a frame, moving ones as they are then."""
    return [light.at(frame) if isinstance(light, MovingLight) else light for light in lights]


def kind_of(settings: Iterable[str]) -> type[Light]:
    """Return the class of a light with these parameters, other than environments."""
    keys = set(settings)
    spot = keys & {"cone", "softness", "radius", "profile"}
    if keys & {"width", "height"} or ("toward" in keys and not spot):
        return RectLight
    return PointLight if spot or keys & {"position", "at"} else DirectionalLight


def parse(text: str, kind: type[Light] | None = None) -> Light | MovingLight:
    """Parse a light from text, see `Light.parse`; with `orbit=200` in it, a moving one."""
    kind = kind or kind_of(re.findall(r"(?:^|[,:])\s*(\w+)\s*=", text))
    orbit = re.search(r"(?:^|(?<=[,:]))\s*orbit\s*=([^,]*)(?:,|$)", text)
    if orbit is None:
        return kind.parse(text)
    light = kind.parse((text[: orbit.start()] + text[orbit.end() :]).rstrip(","))
    try:
        return MovingLight(kind, orbit=float(orbit[1]), **light.settings())
    except (TypeError, ValueError) as error:
        raise ValueError(f"light {text!r}: {error}") from error


def _turned(vector: Iterable[float], degrees: float) -> tuple[float, ...]:
    """Turn a vector about the vertical as azimuth does, from the camera toward image right."""
    x, y, z = vector
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return x * cosine + z * sine, y, z * cosine - x * sine


def _is_number(value: object) -> TypeGuard[float]:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # of an integer beyond floats
        return False


def _keyframes(key: str, keyframes: Mapping[float | str, object]) -> Keyframes:
    """Check {frame: value} and return it in order of frames, which JSON has as text."""
    if not keyframes:
        raise ValueError(f"{key}: expected keyframes, got none")
    checked: Keyframes = {}
    for frame, value in keyframes.items():
        try:
            number = float(frame)
        except (OverflowError, TypeError, ValueError):
            number = math.nan
        if not math.isfinite(number) or isinstance(frame, bool):
            raise ValueError(f"{key}: expected the number of a frame, got {reprlib.repr(frame)}")
        if isinstance(value, list | tuple) and len(value) == 3 and all(map(_is_number, value)):
            checked[number] = tuple(map(float, value))
        elif _is_number(value):
            checked[number] = float(value)
        else:
            raise TypeError(f"{key}: expected numbers at frame {number:g}, got {reprlib.repr(value)}")
    if len({type(value) for value in checked.values()}) > 1:
        raise ValueError(f"{key}: expected numbers or vectors at all frames, got both")
    return dict(sorted(checked.items()))


def _between(key: str, keyframes: Keyframes, frame: float) -> float | tuple[float, ...]:
    """Interpolate the value at a frame: a float or a tuple of three."""
    frames = list(keyframes)
    after = bisect.bisect(frames, frame)
    if after in (0, len(frames)):
        return keyframes[frames[max(after - 1, 0)]]
    first, last = frames[after - 1], frames[after]
    start, end = (np.array(keyframes[number]) for number in (first, last))
    share = (frame - first) / (last - first)
    if key == "direction":
        return _great_circle(start, end, share)
    return (start + share * (end - start)).tolist()


def _great_circle(start: np.ndarray, end: np.ndarray, share: float) -> tuple[float, ...]:
    """Interpolate between two directions at constant speed (Shoemake 1985)."""
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    angle = math.acos(np.clip(start @ end, -1, 1))
    if angle > math.pi - 1e-6:
        raise ValueError("direction: opposite in successive keyframes; put one between, to say which way")
    if angle < 1e-6:
        return tuple(end.tolist())
    weights = np.sin([(1 - share) * angle, share * angle]) / math.sin(angle)
    return tuple((weights @ [start, end]).tolist())
