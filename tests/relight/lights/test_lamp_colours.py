import numpy as np
import pytest

import relight
from relight.media.colour import colour_science, luminance, temperature
from relight.media.lamp_colours import LAMPS, lamp_colour

filters = pytest.importorskip("lighting_filters")


@pytest.fixture(scope="module")
def published():
    """LEE's own figures of gels: x, y and per cent behind a tungsten lamp of 3200 K."""
    return filters.LightingFilters("Lee")


def chromaticity(rgb):
    colour = colour_science()
    return colour.XYZ_to_xy(colour.RGB_to_XYZ(np.array(rgb), "ITU-R BT.709"))


@pytest.mark.parametrize("number", ["L201", "L202", "L203", "L204", "L205", "L206", "L209", "L249"])
def test_conversions_have_the_colour_and_transmission_that_lee_publishes(published, number):
    behind = lamp_colour(None, 3200.0, "planckian", 0.0, number)
    stated = published[number].src_a
    assert chromaticity(behind) == pytest.approx([float(stated.x), float(stated.y)], abs=0.008)
    assert 100 * luminance(np.array(behind)) == pytest.approx(float(stated.Y), rel=0.07)


def test_gels_convert_the_light_that_they_are_made_for():
    daylight = relight.DirectionalLight(temperature=3200, gel="L201").power  # full blue before tungsten
    assert daylight / luminance(daylight) == pytest.approx(temperature(5700, "daylight"), abs=0.12)
    warm = relight.DirectionalLight(temperature=6500, locus="daylight", gel="L204").power
    assert warm / luminance(warm) == pytest.approx(temperature(3200), abs=0.2)


def test_rosco_is_computed_from_published_chromaticities():
    red, green, blue = relight.DirectionalLight(source="overcast", gel="R80").power  # primary blue
    assert blue > 4 * green > red
    grey = relight.DirectionalLight(gel="L209+L209").power  # 0.3 ND twice
    assert luminance(grey) == pytest.approx(0.25, abs=0.02)


@pytest.mark.parametrize("name", LAMPS)
def test_lamps_have_luminance_one(name):
    light = relight.DirectionalLight(source=name)
    assert luminance(light.power) == pytest.approx(1, abs=0.02)


def test_a_tint_moves_the_colour_across_the_black_bodys():
    base, green, magenta = (lamp_colour(None, 5600.0, "daylight", tint, None) for tint in (0.0, 0.01, -0.01))
    assert green[1] > base[1] > magenta[1]
    colour = colour_science()
    found = colour.uv_to_CCT(colour.xy_to_UCS_uv(chromaticity(green)), method="Ohno 2013")
    begun = colour.uv_to_CCT(colour.xy_to_UCS_uv(chromaticity(base)), method="Ohno 2013")
    assert found == pytest.approx([begun[0], begun[1] + 0.01], rel=0.01, abs=1e-3)


def test_texts_and_files_keep_lamps_and_gels(tmp_path):
    light = relight.DirectionalLight.parse("key:azimuth=-40,source=Tungsten,gel=l201+L209,tint=0.005")
    assert (light.source, light.gel, light.tint) == ("tungsten", "L201+L209", 0.005)
    relight.write_lights(tmp_path / "lights.yaml", [light])
    (again,) = relight.read_lights(tmp_path / "lights.yaml")
    assert again.power == pytest.approx(light.power)
    assert again.settings() == light.settings()


def test_programs_that_know_no_gels_get_the_colour(tmp_path, viewed):
    light = relight.DirectionalLight(azimuth=-40, source="tungsten", gel="L201", intensity=2, name="key")
    assert light.plain.gel is None
    assert light.plain.power == pytest.approx(light.power)
    page = viewed.view(tmp_path / "page.html", [light]).read_text(encoding="utf-8")
    assert '"key"' in page
    assert '"L201"' not in page  # with the quotes: the maps' base64 may spell it by chance
    pytest.importorskip("pxr")
    relight.write_lights(tmp_path / "lights.usda", [light])
    (again,) = relight.read_lights(tmp_path / "lights.usda")
    assert again.power == pytest.approx(light.power, rel=1e-4)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"gel": "L2011"}, r"gel: 'L2011' is no gel that is known; did you mean L201"),
        ({"gel": "purple"}, r"gel: 'PURPLE' is no gel that is known; expected numbers of LEE or Rosco"),
        ({"source": "tungsen"}, r"source: tungsen: not known; did you mean tungsten\?"),
        ({"source": "hmi", "temperature": 5600}, "source: has a temperature of its own"),
        ({"tint": 0.01}, "tint: expected a temperature or a source"),
        ({"tint": 0.2, "temperature": 5600}, "tint: expected a number from -0.05 to 0.05"),
    ],
)
def test_unknown_lamps_and_gels_are_refused(settings, message):
    if "L201" in message:
        message = message[:-5]  # the nearest one may be another
    with pytest.raises(ValueError, match=message) as refused:
        relight.DirectionalLight(**settings)
    assert "\n" not in str(refused.value)
