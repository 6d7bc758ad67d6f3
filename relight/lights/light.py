"""The base classes of lights: strength and colour, rays, parsing from text.

Torch is imported where rays are computed: texts of lights are checked without it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self, TypeAlias

import numpy as np
from annotated_types import Interval

from relight import quantities
from relight.arguments import Checked, Parameter, checked, default, parameters, read_settings
from relight.media import colour as colours
from relight.media.lamp_colours import known_gels, known_lamp, lamp_colour

if TYPE_CHECKING:
    import torch


Settings: TypeAlias = dict[str, Any]  # {parameter: value} of a light's constructor


class Rays(NamedTuple):
    """Rays from surface points (3, ...) to a part of a light of power 1."""

    directions: torch.Tensor  # unit vectors to it: (3, ...), or (K, 3) that are the same for all points
    irradiance: torch.Tensor  # from there, of a surface that faces it: (...), or (K, 3) linear Rec.709


class Parts(NamedTuple):
    """K points that each stand for a part of a light, where shadows are cast from one point at a time."""

    places: np.ndarray  # (K, 4) homogeneous: metres from the subject's middle and 1, or a direction and 0
    powers: np.ndarray  # (K, 3) linear Rec.709
    radii: np.ndarray  # (K,) of the parts: metres, or radians


@dataclass(frozen=True, kw_only=True)
class Light(Checked):
    """What all lights have in common; see `relight.DirectionalLight` for the parameters.

    >>> import relight
    >>> isinstance(relight.PointLight(position=(0, 1, 1)), relight.Light)
    True
    """

    intensity: quantities.Intensity = 1.0
    colour: quantities.Colour = default(quantities.WHITE)
    exposure: quantities.Exposure = 0.0
    temperature: quantities.Temperature = None
    locus: quantities.Locus = "planckian"
    tint: quantities.Tint = 0.0
    source: quantities.LampName = None
    gel: quantities.Gels = None
    name: quantities.Name = None

    is_near: ClassVar[bool] = False  # whether its rays differ from point to point

    def __post_init__(self) -> None:
        """Check each parameter, and what depends on several."""
        super().__post_init__()
        if self.temperature is not None:
            low, high = colours.LOCI[self.locus]
            allowed = Annotated[quantities.Temperature, Interval(ge=low, le=high)]
            checked("temperature", self.temperature, allowed)
        for name, known in (("source", known_lamp), ("gel", known_gels)):
            if (given := getattr(self, name)) is not None:
                try:
                    object.__setattr__(
                        self, name, known(given)
                    )  # as frozen dataclasses initialise themselves
                except ValueError as error:
                    raise ValueError(f"{name}: {error}") from error
        if self.source is not None and self.temperature is not None:
            raise ValueError("source: has a temperature of its own; expected one of source and temperature")
        if self.tint and self.source is None and self.temperature is None:
            raise ValueError("tint: expected a temperature or a source, whose colour it moves")

    @classmethod
    def parameters(cls) -> dict[str, Parameter]:
        """Return the parameters of the constructor by name, those that all lights have last."""
        all_, common = parameters(cls), parameters(Light)
        own = {name: each for name, each in all_.items() if name not in common}
        return own | {name: all_[name] for name in common}

    @property
    def power(self) -> np.ndarray:
        """Linear RGB (3,): colour × the lamp's colour behind its gels × intensity × 2**exposure."""
        lamp = (1.0,) * 3
        if self.tint or self.source is not None or self.gel is not None:
            lamp = lamp_colour(self.source, self.temperature, self.locus, self.tint, self.gel)
        elif self.temperature is not None:
            lamp = colours.temperature(self.temperature, self.locus)
        return np.array(self.colour) * lamp * self.intensity * 2.0**self.exposure

    @property
    def plain(self) -> Self:
        """The same light for programs that know neither lamps nor gels: its colour contains them."""
        if not self.tint and self.source is None and self.gel is None:
            return self
        lit = dataclasses.replace(self, intensity=1.0, exposure=0.0).power
        return dataclasses.replace(
            self, colour=tuple(lit.tolist()), temperature=None, tint=0.0, source=None, gel=None
        )

    def scaled(self, factor: float) -> Self:
        """Return the light of `factor` times its intensity."""
        return dataclasses.replace(self, intensity=self.intensity * factor)

    def rays(self, positions: torch.Tensor) -> Iterator[Rays]:
        """Yield the rays from surface points (3, ...), metres, to one part of the light after the other."""
        raise NotImplementedError

    def parts(self) -> Parts:
        """Return the light as points."""
        raise NotImplementedError

    @property
    def points(self) -> np.ndarray:
        """(K, 3) metres: points that shine near the person, or the centre of a sphere."""
        return np.empty((0, 3))

    @property
    def extent(self) -> float:
        """Metres around each of `points` that the light fills."""
        return 0.0

    @property
    def flat_axis(self) -> np.ndarray | None:
        """The unit vector (3,) along which a flat light shines most; None for other lights."""
        return None

    @property
    def cone_axis(self) -> np.ndarray | None:
        """The unit vector (3,) along which a light with a cone or a profile shines; None for others."""
        return None

    def transmission(self, directions: torch.Tensor) -> torch.Tensor:
        """Return the share (...) of the light, in [0, 1], that leaves into unit directions (3, ...)."""
        return directions.new_ones(directions.shape[1:])

    def settings(self) -> Settings:
        """Return {parameter: value} of the constructor, without those that have their defaults."""
        values = {key: (getattr(self, key), each.default) for key, each in self.parameters().items()}
        return {key: value for key, (value, default) in values.items() if value != default}

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a light from text: `key:azimuth=-40,elevation=30,intensity=2,colour=1/0.9/0.8`.

        `name:` is optional. Each `parameter=value` is one of the constructor's; the numbers of a vector are
        separated by slashes.

        Raises
        ------
        ValueError
            The text does not have this form, or the light refuses a value.

        Examples
        --------
        >>> import relight
        >>> relight.DirectionalLight.parse("key:azimuth=-40,intensity=2").intensity
        2.0
        """
        name, colon, settings = text.rpartition(":")
        try:
            arguments = read_settings(filter(None, settings.split(",")), cls.parameters())
            if any(word.partition("=")[0] in cls.parameters() for word in name.split(",") if "=" in word):
                raise ValueError(f"{name!r} is no name; settings are separated by commas")
            if colon and "name" in arguments:
                raise ValueError(f"name={arguments['name']!r} is twice")
            for key, parameter in cls.parameters().items():
                if parameter.is_required and key not in arguments:
                    raise ValueError(f"{key} is missing")
            return cls(**arguments | ({"name": name} if colon else {}))
        except (TypeError, ValueError) as error:
            raise ValueError(f"light {text!r}: {error}") from error


class DistantLight(Light):
    """A light whose rays are the same for all surface points."""

    def unit_samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Return unit directions (K, 3), float32, and linear RGB intensities (K, 3) for a power of 1."""
        raise NotImplementedError

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the light as unit directions (K, 3) and linear RGB intensities (K, 3), float32."""
        directions, intensities = self.unit_samples()
        with np.errstate(over="ignore"):  # infinite values are refused where the light is used
            return directions, (intensities * self.power).astype(np.float32)

    def scaled(self, factor: float) -> Self:
        """Return the light of `factor` times its intensity."""
        return dataclasses.replace(self, intensity=self.intensity * factor)

    def rays(self, positions: torch.Tensor) -> Iterator[Rays]:
        """Yield all rays at once, the same for all `positions`."""
        import torch

        directions, intensities = self.unit_samples()
        yield Rays(torch.from_numpy(directions), torch.from_numpy(intensities))

    def sample_radii(self, count: int) -> np.ndarray:
        """Return the angular radius (K,), radians, of what each of `count` samples stands for."""
        raise NotImplementedError

    def parts(self) -> Parts:
        directions, powers = self.samples()
        places = np.concatenate([directions, np.zeros((len(directions), 1), np.float32)], axis=1)
        return Parts(places, powers, self.sample_radii(len(directions)))
