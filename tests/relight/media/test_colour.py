import sys

import numpy as np
import pytest

from relight.media import colour, encodings


def test_srgb_decodes_integers_exactly_as_floats():
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, -1)
    linear = colour.decode(codes, "sRGB")
    assert linear.dtype == np.float32
    np.testing.assert_allclose(linear, colour.decode(codes / np.float32(255), "sRGB"), atol=1e-7)
    assert linear[0, 0, 0] == 0
    assert linear[-1, -1, 0] == 1
    assert linear[8, 0, 0] == pytest.approx(((128 / 255 + 0.055) / 1.055) ** 2.4, abs=1e-6)  # IEC 61966-2-1


def test_every_16_bit_code_survives():
    codes = np.arange(65536, dtype=np.uint16).reshape(256, 256, 1).repeat(3, -1)
    encoded = colour.encode(colour.decode(codes, "sRGB"))
    np.testing.assert_array_equal(np.round(encoded * 65535).astype(np.uint16), codes)


def grey(values):
    """Values as an image (1, N, 3)."""
    return np.asarray(values, np.float32)[None, :, None].repeat(3, -1)


def srgb(value):
    return 1.055 * value ** (1 / 2.4) - 0.055  # IEC 61966-2-1


def test_encode_stays_in_the_display():
    encoded = colour.encode(np.array([[[-1.0, 0.0, 8.0]]]))
    np.testing.assert_allclose(encoded, [[[0, 0, 1]]], atol=1e-7)


def test_a_picture_that_a_display_can_show_is_shown_as_it_is():
    ramp = np.linspace(0.01, 1, 50)
    np.testing.assert_allclose(colour.encode(grey(ramp))[0, :, 0], srgb(ramp), atol=1e-6)


def test_highlights_roll_off():
    light = np.concatenate([np.linspace(0.01, 1, 50), np.linspace(1.01, 8, 50)])
    encoded = colour.encode(grey(light))[0, :, 0]
    low = light <= colour.KNEE
    np.testing.assert_allclose(encoded[low], srgb(light[low]), atol=1e-6)
    assert (np.diff(encoded) > 1e-4).all()  # no two lights become one: nothing is clipped
    assert encoded[-1] == pytest.approx(1)
    assert encoded[49] > 0.9  # white stays light, however bright the lamp


def test_the_roll_off_sets_in_without_a_jump():
    ramp = np.linspace(0, 1, 50)
    still, moved = (colour.encode(grey([*ramp, top]))[0, :-1, 0] for top in (1, 1.001))
    np.testing.assert_allclose(still, moved, atol=1e-3)


def test_a_given_white_fixes_the_curve_over_a_sequence():
    bright, dark = (colour.encode(grey([0.5, 0.9, top]), white=4)[0, :2, 0] for top in (0.9, 9))
    np.testing.assert_array_equal(bright, dark)
    assert colour.encode(grey([4.0]), white=4)[0, 0, 0] == pytest.approx(1)


@pytest.fixture
def ocio(monkeypatch):
    """Names a configuration of OpenColorIO, or none, as a user's environment does."""

    def name(configuration):
        if configuration is None:
            monkeypatch.delenv("OCIO", raising=False)
        else:
            monkeypatch.setenv("OCIO", str(configuration))

    return name


def test_exposure_is_in_stops():
    light = grey([0.02, 0.1, 0.4])
    np.testing.assert_allclose(colour.encode(light, exposure=1), colour.encode(light * 2), atol=1e-6)
    np.testing.assert_allclose(
        colour.encode(light, exposure=-1, view="aces"), colour.encode(light / 2, view="aces"), atol=1e-5
    )


def test_views_of_the_built_in_configuration(ocio):
    ocio(None)
    light = grey([0.0, 0.18, 1.0, 16.0])
    plain = colour.encode(light, view="Un-tone-mapped")[0, :, 0]
    np.testing.assert_allclose(plain, [0, srgb(0.18), 1, 1], atol=1e-4)
    aces = colour.encode(light, view="aces")[0, :, 0]
    assert (np.diff(aces) > 0.01).all()
    assert aces[2] < 0.8  # of 1, ACES keeps a third for highlights
    for view, message in [("acid", "'acid'"), ("raw-ish", "ACES 2.0"), ("", "''")]:
        with pytest.raises(ValueError, match=f"view: expected one of .*{message}"):
            colour.encode(light, view=view)


CONFIGURATION = """ocio_profile_version: 2
roles: {aces_interchange: ACES, default: ACES, scene_linear: ACES}
file_rules: [!<Rule> {name: Default, colorspace: default}]
displays: {Screen: [!<View> {name: Negative, colorspace: shown}]}
colorspaces:
  - !<ColorSpace> {name: ACES, encoding: scene-linear}
  - !<ColorSpace>
    name: shown
    from_scene_reference: !<MatrixTransform> {matrix: [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1], offset: [1, 1, 1, 0]}
  - !<ColorSpace>
    name: Camera
    to_scene_reference: !<MatrixTransform> {matrix: [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]}
"""  # noqa: E501


def test_the_studios_own_configuration(tmp_path, ocio):
    (tmp_path / "config.ocio").write_text(CONFIGURATION)
    ocio(tmp_path / "config.ocio")
    np.testing.assert_allclose(colour.encode(grey([0.25]), view="neg"), 0.75, atol=1e-4)
    np.testing.assert_allclose(colour.decode(grey([0.25]), "Camera"), 0.5, atol=1e-4)
    np.testing.assert_allclose(colour.decode(grey([0.25]), "ACEScg"), 0.25, atol=1e-4)  # the built-in one's
    ocio(tmp_path / "gone.ocio")
    assert colour.decode(grey([1]), "sRGB")[0, 0, 0] == 1
    with pytest.raises(ValueError, match=r"OCIO: cannot read the configuration '.*gone\.ocio'"):
        colour.encode(grey([0.25]), view="aces")


VERSION_1 = """ocio_profile_version: 1
roles:
  scene_linear: linear
  default: linear
displays:
  default:
    - !<View> {name: Film, colorspace: film}
colorspaces:
  - !<ColorSpace>
    name: linear
    bitdepth: 32f
  - !<ColorSpace>
    name: film
    bitdepth: 32f
    to_reference: !<ExponentTransform> {value: [1.5, 1.5, 1.5, 1]}
"""


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("given", ["film", "Film"])
def test_a_configuration_without_the_role_of_exchange_is_named_with_what_it_lacks(
    tmp_path, ocio, version, given
):
    path = tmp_path / "config.ocio"
    path.write_text(VERSION_1.replace("version: 1", f"version: {version}"))
    ocio(path)
    with pytest.raises(ValueError, match=r"colour_space: 'film' is of the configuration") as error:
        colour.decode(grey([0.25]), given)
    assert f"{path}, which has no role aces_interchange" in str(error.value)
    path = tmp_path / "with.ocio"
    path.write_text(VERSION_1.replace("roles:", "roles:\n  aces_interchange: linear"))
    ocio(path)
    np.testing.assert_allclose(colour.decode(grey([0.25]), given), 0.25**1.5, atol=1e-4)


@pytest.mark.parametrize(
    ("space", "formula"),  # of the makers' papers, in scene-linear light
    [
        ("ARRI LogC3 (EI800)", lambda code: (10 ** ((code - 0.385537) / 0.247190) - 0.052272) / 5.555556),
        (
            "ARRI LogC4",
            lambda code: (2 ** (14 * (code * 1023 - 95) / 928 + 6) - 64) / 2231.826,
        ),
        ("S-Log3 S-Gamut3.Cine", lambda code: 10 ** ((code * 1023 - 420) / 261.5) * 0.19 - 0.01),
        ("V-Log V-Gamut", lambda code: 10 ** ((code - 0.598206) / 0.241514) - 0.00873),
        ("Log3G10 REDWideGamutRGB", lambda code: (10 ** (code / 0.224282) - 1) / 155.975327 - 0.01),
        ("D-Log D-Gamut", lambda code: (10 ** (3.89616 * code - 2.27752) - 0.0108) / 0.9892),
    ],
)
def test_camera_logs_need_no_configuration(ocio, space, formula):
    ocio(None)
    codes = np.array([0.3, 0.45, 0.7])
    np.testing.assert_allclose(colour.decode(grey(codes), space)[0, :, 1], formula(codes), rtol=1e-4)


def test_opencolorios_studio_configuration_by_its_name(ocio):
    ocio("ocio://studio-config-latest")
    light = grey([0.0, 0.18, 1.0])
    shown = colour.encode(light, view="aces")
    assert colour.find_view("aces")[0] == "ocio://studio-config-latest"
    ocio(None)
    np.testing.assert_allclose(shown, colour.encode(light, view="aces"), atol=2e-3)  # the same transform
    with pytest.raises(ValueError, match=r"unknown 'LogC4', expected a whole name: ARRI LogC4$"):
        colour.decode(light, "LogC4")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"exposure": np.nan}, "exposure: expected -64 to 64 stops, got nan"),
        ({"exposure": 65}, "exposure: expected -64 to 64 stops, got 65"),
        ({"white": 0.5}, "white: expected a finite number >= 1, got 0.5"),
        ({"white": np.inf}, "white: expected a finite number >= 1"),
    ],
)
def test_encode_names_what_is_wrong(arguments, message):
    with pytest.raises(ValueError, match=message):
        colour.encode(grey([0.5]), **arguments)


def test_linear_is_left_alone():
    light = np.array([[[-0.5, 0.0, 1e4]]], np.float32)
    np.testing.assert_array_equal(colour.decode(light, "lin_rec709"), light)


def test_white_stays_white_from_other_primaries():
    np.testing.assert_allclose(colour.decode(np.ones((2, 2, 3), np.float32), "ACEScg"), 1, atol=1e-3)
    green = colour.decode(np.array([[[0.0, 1.0, 0.0]]], np.float32), "ACEScg")
    assert green[0, 0, 0] < -0.3  # outside Rec.709, and not clipped


@pytest.mark.parametrize(
    ("space", "chromaticities"),
    [
        ("ACEScg", (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)),
        ("ACES2065-1", (0.7347, 0.2653, 0, 1, 0.0001, -0.077, 0.32168, 0.33767)),
        ("Rec.2020", (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)),
        ("lin_rec709", colour.REC709),
    ],
)
def test_chromaticities_say_what_the_name_says(space, chromaticities):
    pixels = np.random.default_rng(0).random((8, 8, 3), np.float32)
    by_name, by_numbers = colour.decode(pixels, space), colour.decode(pixels, chromaticities)
    np.testing.assert_allclose(by_numbers, by_name, atol=1e-5)


@pytest.mark.parametrize("chromaticities", [(0,) * 8, (0.3,) * 8, (np.nan,) * 8, (0.64, 0.33)])
def test_chromaticities_that_span_nothing(chromaticities):
    with pytest.raises(ValueError, match=r"chromaticities: .* span no colours"):
        colour.decode(np.zeros((1, 1, 3), np.float32), chromaticities)


def test_unknown_space_is_named():
    with pytest.raises(ValueError, match=r"colour_space: unknown 'bogus'"):
        colour.decode(np.zeros((1, 1, 3), np.float32), "bogus")


@pytest.mark.parametrize("kelvin", [1000, 2700, 6500, 40000])
def test_temperature_has_luminance_one(kelvin):
    assert colour.luminance(np.array(colour.temperature(kelvin))) == pytest.approx(1)


def test_temperature_runs_from_red_to_blue():
    red, _, blue = np.array([colour.temperature(k) for k in (2000, 4000, 6500, 10000)]).T
    assert (np.diff(red) < 0).all()
    assert (np.diff(blue) > 0).all()
    np.testing.assert_allclose(colour.temperature(6500), 1, atol=0.06)


@pytest.mark.parametrize("kelvin", [999, 40001, float("nan")])
def test_temperature_out_of_range(kelvin):
    with pytest.raises(ValueError, match="temperature: expected 1000 to 40000 kelvin"):
        colour.temperature(kelvin)


def test_primaries_and_adaptation_are_those_of_colour_science():
    colour = encodings.colour_science()
    tables = sys.modules["colour.models.rgb.itut_h_273"]
    for code, chromaticities in encodings.PRIMARIES.items():
        stated = [*np.ravel(tables.COLOUR_PRIMARIES_ITUTH273[code]), *tables.CCS_WHITEPOINTS_ITUTH273[code]]
        np.testing.assert_allclose(chromaticities, stated, atol=1e-6)
    d50, d65 = encodings.xy_to_xyz(encodings.D50), encodings.xy_to_xyz(encodings.D65)
    bradford = colour.adaptation.matrix_chromatic_adaptation_VonKries(d50, d65, transform="Bradford")
    np.testing.assert_allclose(encodings.adaptation(encodings.D50, encodings.D65), bradford, atol=1e-6)
