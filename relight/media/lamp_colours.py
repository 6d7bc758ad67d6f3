"""The colours of lamps by name, of gels before them, and of temperatures with a tint.

Spectra are multiplied and integrated with the CIE 1931 2 degree observer by colour-science. A gel of LEE has
a published spectrum from 405 to 700 nm, beyond which its first and last values are taken. One of Rosco has
published chromaticities and transmissions in illuminants A and D65: the nearer one gives a factor for each
channel. A diffusion without colour has its transmission alone. They come from the package lighting_filters
(extra `gels`), which took them from the makers' sites.
"""

import functools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from relight.arguments import meant, shown, unknown
from relight.media.colour import colour_science, luminance, temperature
from shadow.installing import install_command

if TYPE_CHECKING:
    from colour import SpectralDistribution
    from lighting_filters.typedef import LightingFilter

MOST_GELS = 8
WARM = 4500.0  # kelvin below which illuminant A is nearer to a lamp than D65
BRANDS = ("Lee", "Roscolux", "e-colour+", "Cinegel")  # LEE and Rosco


class Lamp(NamedTuple):
    """A lamp by its name: the spectrum in colour-science, or a temperature on a locus, and who says so."""

    title: str
    spectrum: str | None
    kelvin: float | None
    locus: str
    stated_by: str


LAMPS = {
    "candle": Lamp("Candle flame", None, 1850, "planckian", "Wikipedia, Color temperature: 1850 K"),
    "household": Lamp("Incandescent bulb", "A", None, "", "CIE 015:2018, illuminant A (2856 K)"),
    "tungsten": Lamp("Studio tungsten", "ISO 7589 Studio Tungsten", None, "", "ISO 7589:2002"),
    "photoflood": Lamp("Photoflood", "ISO 7589 Photoflood", None, "", "ISO 7589:2002"),
    "hmi": Lamp("HMI and MSR", None, 5600, "daylight", "nominal temperature, jtv.be/info/colortemps: 5600 K"),
    "flash": Lamp("Flash, photographic daylight", "D55", None, "", "CIE 015:2018, illuminant D55"),
    "led-warm": Lamp("Warm white LED panel", "LED-B1", None, "", "CIE 015:2018, illuminant LED-B1 (2733 K)"),
    "led": Lamp("Daylight LED panel", "LED-B4", None, "", "CIE 015:2018, illuminant LED-B4 (5109 K)"),
    "led-cool": Lamp("Cool white LED panel", "LED-B5", None, "", "CIE 015:2018, illuminant LED-B5 (6598 K)"),
    "fluorescent": Lamp("Cool white fluorescent", "FL2", None, "", "CIE 015:2018, illuminant FL2 (4230 K)"),
    "fluorescent-warm": Lamp("Warm white fluorescent", "FL4", None, "", "CIE 015:2018, FL4 (2940 K)"),
    "sodium": Lamp("High-pressure sodium", "HP1", None, "", "CIE 015:2018, illuminant HP1 (1959 K)"),
    "overcast": Lamp("Overcast sky", "D65", None, "", "CIE 015:2018, illuminant D65"),
    "shade": Lamp("Shade under a blue sky", "D75", None, "", "CIE 015:2018, illuminant D75"),
}


def known_lamp(name: str) -> str:
    """Return the name of a lamp as the table has it; ValueError for another."""
    word = name.strip().lower().replace(" ", "-").replace("_", "-")
    if word not in LAMPS:
        raise ValueError(unknown(name, LAMPS))
    return word


def known_gels(text: str) -> str:
    """Return gels as they are listed, `L201+L216`; ValueError for unknown ones."""
    numbers = [word.strip().upper() for word in text.split("+")]
    if len(numbers) > MOST_GELS:
        raise ValueError(f"expected at most {MOST_GELS} gels, got {len(numbers)}")
    for number in numbers:
        if number not in _filters():
            near = meant(number.lower(), _filters())
            hint = (
                f"did you mean {near}?" if near else "expected numbers of LEE or Rosco, such as L201 or R3202"
            )
            raise ValueError(f"{shown(number)} is no gel that is known; {hint}")
    return "+".join(numbers)


@functools.cache
def lamp_colour(
    source: str | None, kelvin: float | None, locus: str, tint: float, gels: str | None
) -> tuple[float, float, float]:
    """Return the linear Rec.709 colour of a lamp behind gels; without gels its luminance is 1.

    `source`: of LAMPS, or None. `kelvin` and `locus`: see `relight.media.colour.temperature`; None for white.
    `tint`: distance from the black body in CIE 1960 (Duv), positive toward green. `gels`: see `known_gels`;
    they take light away.
    """
    lamp = LAMPS[source] if source else None
    if lamp is not None and lamp.kelvin is not None:
        kelvin, locus = lamp.kelvin, lamp.locus
    spectrum = None if lamp is None or lamp.spectrum is None else lamp.spectrum
    bare = _light(_spectrum(spectrum, kelvin, locus)) if spectrum or gels else None
    rgb = np.array(temperature(kelvin, locus) if kelvin else (1.0, 1.0, 1.0) if bare is None else bare)
    tinted = _tinted(rgb, tint) if tint else rgb
    if not gels:
        return _triple(tinted)
    behind = _behind(gels.split("+"), spectrum, kelvin, locus)
    return _triple(behind * tinted / np.maximum(np.array(bare), 1e-6))


def _triple(rgb: np.ndarray) -> tuple[float, float, float]:
    red, green, blue = np.maximum(rgb, 0).tolist()
    return red, green, blue


def _tinted(rgb: np.ndarray, tint: float) -> np.ndarray:
    """Return a colour of luminance 1 that is moved across the black body's locus."""
    colour = colour_science()
    tristimulus = colour.RGB_to_XYZ(rgb, "ITU-R BT.709")
    kelvin, distance = colour.uv_to_CCT(colour.UCS_to_uv(colour.XYZ_to_UCS(tristimulus)), method="Ohno 2013")
    uv = colour.CCT_to_uv([kelvin, distance + tint], method="Ohno 2013")
    moved = np.maximum(colour.XYZ_to_RGB(colour.xy_to_XYZ(colour.UCS_uv_to_xy(uv)), "ITU-R BT.709"), 0)
    return moved / luminance(moved)


def _spectrum(name: str | None, kelvin: float | None, locus: str) -> "SpectralDistribution":
    """Return the spectrum of a lamp by name or temperature; of D65 without either."""
    colour = colour_science()
    if name is not None:
        return colour.SDS_ILLUMINANTS[name].copy()
    if kelvin is None:
        return colour.SDS_ILLUMINANTS["D65"].copy()
    if locus == "daylight":
        return colour.sd_CIE_illuminant_D_series(colour.temperature.CCT_to_xy_CIE_D(kelvin))
    return colour.sd_blackbody(kelvin)


def _light(spectrum: "SpectralDistribution", luminances: float | None = None) -> np.ndarray:
    """Return the linear Rec.709 colour of a spectrum, of luminance 1, or over `luminances`."""
    colour = colour_science()
    shape = colour.SpectralShape(360, 780, 1)
    tristimulus = colour.sd_to_XYZ(spectrum.align(shape))
    return np.maximum(colour.XYZ_to_RGB(tristimulus / (luminances or tristimulus[1]), "ITU-R BT.709"), 0)


def _behind(gels: list[str], name: str | None, kelvin: float | None, locus: str) -> np.ndarray:
    """Return the colour of a lamp of luminance 1 behind gels."""
    colour = colour_science()
    shape = colour.SpectralShape(360, 780, 1)
    spectrum = _spectrum(name, kelvin, locus).align(shape)
    whole = float(colour.sd_to_XYZ(spectrum)[1])
    factors = np.ones(3)
    for gel in gels:
        film = _filters()[gel]
        if film.sd:
            points = sorted((float(nm), float(share)) for nm, share in film.sd.items())
            wavelengths, shares = np.transpose(points)
            spectrum.values = spectrum.values * np.interp(spectrum.wavelengths, wavelengths, shares)
        else:
            factors = factors * _factors(film, _kelvin(name, kelvin))
    return _light(spectrum, whole) * factors


def _kelvin(name: str | None, kelvin: float | None) -> float:
    if kelvin is not None:
        return kelvin
    colour = colour_science()
    tristimulus = colour.sd_to_XYZ(_spectrum(name, None, "").align(colour.SpectralShape(360, 780, 1)))
    return float(colour.uv_to_CCT(colour.UCS_to_uv(colour.XYZ_to_UCS(tristimulus)), method="Ohno 2013")[0])


def _factors(film: "LightingFilter", kelvin: float) -> np.ndarray:
    """Return the factor of each channel by a gel without a spectrum."""
    colour = colour_science()
    if film.src_a is None and film.src_d65 is None:
        return np.full(3, float(film.trans))
    warm = film.src_a is not None and (kelvin < WARM or film.src_d65 is None)
    seen, light = (film.src_a, "A") if warm else (film.src_d65, "D65")
    x, y, percent = float(seen.x), float(seen.y), float(seen.Y)
    tristimulus = colour.xyY_to_XYZ([x, y, percent / 100])
    through = np.maximum(colour.XYZ_to_RGB(tristimulus, "ITU-R BT.709"), 0)
    return through / _light(_spectrum(light, None, ""))


@functools.cache
def _filters() -> dict[str, "LightingFilter"]:
    """Return the gels of LEE and Rosco of which the transmission is published."""
    try:
        from lighting_filters import LightingFilters
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"gels need lighting_filters; install it with: {install_command('gels')}", name="lighting_filters"
        ) from error
    return {
        number: film
        for number, film in LightingFilters().items()
        if film.brand in BRANDS and (film.sd or film.src_a or film.src_d65 or film.trans)
    }
