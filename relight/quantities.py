"""The quantities that lights, options, functions and nodes share: the type, range, unit and help of each."""

import math
import os
import re
import unicodedata
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, BinaryIO, Literal, TypeAlias

from annotated_types import Interval

from relight.arguments import About, Converted, Converts, meant, shown

MAX_METRES = 1e6  # of a position or a size
MIN_METRES = 1e-4  # of a side, and of the distance to a light
MAX_NAME_BYTES = 240  # with "visibility_" before and ".R" behind, within the 255 of OpenEXR
MAX_PATH = 4096  # characters, Linux's limit
MIN_LENGTH = 1e-6  # of a direction
AZIMUTHS = (
    ("front", 0.0), ("front-left", -45.0), ("left", -90.0), ("back-left", -135.0), ("back", 180.0),
    ("behind", 180.0), ("back-right", 135.0), ("right", 90.0), ("front-right", 45.0),
)  # fmt: skip
ELEVATIONS = (
    ("level", 0.0), ("top", 90.0), ("above", 90.0), ("overhead", 90.0), ("bottom", -90.0), ("below", -90.0),
)  # fmt: skip
# Words that are backgrounds: what the camera sees of the environments among the lights; the photograph
# itself, with the person taken out; the same, blurred; and nothing, even if the photograph has no alpha.
ENVIRONMENT, PLATE, BLUR, NONE = BACKGROUNDS = "environment", "plate", "blur", "none"
STRONG_BLUR = 0.02  # share of the picture's height, where only a blur is asked for
Triple = tuple[float, float, float]
WHITE: Triple = (1.0, 1.0, 1.0)


def background_of(text: str) -> tuple[float, ...] | str:
    """Return the colour that a text is, see `Colour`; a word among BACKGROUNDS or a file's name unchanged.

    Raises ValueError for what is none of these.
    """
    from PIL import ImageColor

    word = text.strip().lower()
    if word in BACKGROUNDS or os.path.exists(text):
        return text if os.path.exists(text) else word
    if word.startswith("#") or word in ImageColor.colormap or set(word) <= set("0123456789.+-e/"):
        return _parsed_colour(text, "background")
    if text.count(",") == 2 or re.fullmatch(r"[\w -]+", text):
        near = meant(word, [*BACKGROUNDS, *ImageColor.colormap])
        raise ValueError(
            f"expected a linear colour as 0.2/0.2/0.2, #808080, a colour's name, a file, or one of "
            f"{', '.join(BACKGROUNDS)}, got {text!r}" + (f"; did you mean {near}?" if near else "")
        )
    return text


def _parsed_colour(text: str, argument: str = "colour") -> Triple:
    """Read a colour: `1/0.9/0.8`, linear; or as pictures have it, `#ff8800`, or by its name in CSS."""
    import numpy as np
    from PIL import ImageColor

    from shadow.srgb import decode_srgb

    word = text.strip().lower()
    try:
        red, green, blue = map(float, word.split("/"))
    except ValueError:
        name = word.replace(" ", "").replace("_", "")
        try:
            codes = ImageColor.getrgb(name)
            if len(codes) != 3:
                raise ValueError("a colour with alpha")
        except ValueError:
            near = meant(name, ImageColor.colormap)
            raise ValueError(
                f"expected linear red/green/blue such as 1/0.9/0.8, #rrggbb, or a colour's name, got {text!r}"
                + (f"; did you mean {near}?" if near else "")
            ) from None
        red, green, blue = decode_srgb(np.array(codes) / 255).round(6).tolist()
    else:
        if max(red, green, blue) > 1 and max(red, green, blue) <= 255:
            brighter = "" if argument == "background" else "; intensity=2 is twice the light"
            code = "".join(f"{round(min(max(each, 0), 255)):02x}" for each in (red, green, blue))
            warnings.warn(
                f"{argument}: {text} is linear and brighter than white{brighter}; "
                f"the colour of 8 bits is #{code}",
                stacklevel=2,
            )
    return red, green, blue


def _unit_vector(vector: Triple) -> Triple:
    largest = max(map(abs, vector))
    if largest < MIN_LENGTH:
        raise ValueError("has zero length")
    x, y, z = (component / largest for component in vector)  # its square may be beyond any float
    length = math.hypot(x, y, z)
    return x / length, y / length, z / length


def file_name(value: object) -> "File":
    """Return what names a file unchanged; TypeError or ValueError otherwise."""
    if not isinstance(value, str | os.PathLike):
        raise TypeError(f"expected the name of a file, got {shown(value)}")
    if not os.fspath(value) or "\0" in str(value) or len(str(value)) > MAX_PATH:
        raise ValueError(f"expected the name of a file, got {shown(str(value))}")
    return value


def _model(value: object) -> "File":
    if hasattr(value, "shape"):
        raise TypeError(f"expected the name of a model, got {shown(value)}; give the matte itself as mask")
    return file_name(value)


def _file_or_stream(value: object) -> object:
    return value if hasattr(value, "read") or hasattr(value, "write") else file_name(value)


def _entries(value: object) -> object:
    if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
        raise TypeError(f"expected {{name: value}}, got {shown(value)}")
    return value


def _layer_name(name: str) -> str:
    if not name:
        raise ValueError("expected a non-empty text, got ''")
    if any(unicodedata.category(character) in ("Cc", "Cs") for character in name):
        raise ValueError(f"expected no control characters, got {name!r}")
    if (size := len(name.encode())) > MAX_NAME_BYTES:
        raise ValueError(f"expected at most {MAX_NAME_BYTES} bytes of UTF-8, got {size}")
    return name


if TYPE_CHECKING:
    Given: TypeAlias = Any  # it is Iterable[float], which mypy would take for what an inherited field has
    Colour = Converted[Given, Triple]
    Direction = Converted[Given, Triple]
    Position = Converted[Given, Triple]
    OptionalPosition = Converted[Given, Triple | None]
    GivenColour = Iterable[float] | str
    GivenDirection = Iterable[float]
    File: TypeAlias = str | os.PathLike[str]
    Model: TypeAlias = File
    FileOrStream: TypeAlias = str | os.PathLike[str] | BinaryIO
    Entries: TypeAlias = Mapping[str, Any]
    Words: TypeAlias = Sequence[str]
else:
    _Metres = Annotated[float, Interval(ge=-MAX_METRES, le=MAX_METRES)]
    Colour = Annotated[
        tuple[(Annotated[float, Interval(ge=0)],) * 3],
        Converts(),
        About(
            "Linear red/green/blue such as 1/0.9/0.8; or as pictures have it, #rrggbb or a name in CSS.",
            parse=_parsed_colour,
        ),
    ]
    Direction = Annotated[
        Triple,
        Converts(),
        About("x/y/z from the subject to the light, in the camera's axes.", check=_unit_vector),
    ]
    Position = Annotated[
        tuple[_Metres, _Metres, _Metres],
        Converts(),
        About("x/y/z from the subject's middle, in the camera's axes.", unit="metres"),
    ]
    OptionalPosition = Annotated[Position | None, About()]
    GivenColour, GivenDirection = Colour, Direction
    Entries = Annotated[object, About(expected="{name: value}", check=_entries)]
    Words = Annotated[tuple[str, ...], Converts(), About(expected="texts")]
    File = Annotated[object, About(expected="the name of a file", check=file_name)]
    Model = Annotated[object, About(expected="the name of a model or of a file", check=_model)]
    FileOrStream = Annotated[object, About(expected="the name of a file, or a stream", check=_file_or_stream)]

Intensity = Annotated[
    float,
    Interval(ge=0),
    About("At 1, a white surface that faces the light (a lamp: from one metre) is white."),
]
Exposure = Annotated[float, Interval(ge=-64, le=64), About("Each stop doubles the light.", unit="stops")]
Azimuth = Annotated[
    float,
    About(
        "Degrees from the camera (0) toward image right (90); 180: behind.",
        unit="degrees",
        words=AZIMUTHS,
    ),
]
Elevation = Annotated[
    float,
    Interval(ge=-90, le=90),
    About("Degrees up from the horizon (0) to overhead (90).", unit="degrees", words=ELEVATIONS),
]
Rotation = Annotated[
    float, About("Degrees about the vertical, from the camera toward image right.", unit="degrees")
]
Diameter = Annotated[
    float,
    Interval(ge=0, le=180),
    About("Angular diameter in degrees: 0 a hard light, tens a softbox.", unit="degrees"),
]
Temperature = Annotated[
    float | None, About("Colour temperature in kelvin: 3200 is tungsten, 5600 a flash.", unit="kelvin")
]
Tint = Annotated[
    float,
    Interval(ge=-0.05, le=0.05),
    About("Distance of the colour from a black body's (Duv): 0.01 is greener, -0.01 more magenta."),
]
LampName = Annotated[
    str | None,
    About("A lamp by name: candle, household, tungsten, hmi, flash, led, fluorescent, sodium..."),
]
Gels = Annotated[
    str | None,
    About("Gels before the lamp, by LEE's or Rosco's numbers: L201, R3202, or several, L201+L216."),
]
Locus = Annotated[
    Literal["planckian", "daylight"],
    About("The colours of temperatures: a black body's, or those of daylight."),
]
Name = Annotated[
    Annotated[str, About(check=_layer_name)] | None,
    About("The name of the light's layer and of its handle in the viewer."),
]
Radius = Annotated[
    float,
    Interval(ge=0, le=MAX_METRES),
    About("Metres, of a sphere that shines: larger is softer, and no brighter.", unit="metres"),
]
Side = Annotated[float, Interval(ge=MIN_METRES, le=MAX_METRES), About("Metres.", unit="metres")]
Softness = Annotated[
    float, Interval(ge=0, le=1), About("Share of the cone over which the light fades to its edge.")
]
Gloss = Annotated[
    float,
    Interval(ge=0, le=1),
    About("Reflection at grazing angles: a rim on hair, shoulders and arms in light from behind."),
]
Amount = Annotated[
    float,
    Interval(ge=0, le=1),
    About("Share of the new light: the rest is the photograph's own. 0 is the photograph."),
]
Blur = Annotated[
    float,
    Interval(ge=0, le=0.2),
    About("Blur of the background, as of a lens: the radius as a share of the picture's height."),
]
Height = Annotated[
    float,
    Interval(ge=0.01, le=100),
    About("Height in metres of the part of the person that the matte shows.", unit="metres"),
]
FieldOfView = Annotated[
    float,
    Interval(ge=1e-3, le=170),
    About("Vertical field of view of the camera, in degrees.", unit="degrees"),
]
ColourSpace = Annotated[
    str | None, About("Colour space of a file, in place of what it states: sRGB, ACEScg, 'ARRI LogC4'...")
]
