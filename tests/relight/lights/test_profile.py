import numpy as np
import pytest
import torch
from helpers.lamps import ies, ldt

import relight
from relight.media.photometry import read_profile

VERTICAL = np.array([0, 30, 60, 90])
QUADRANT = np.array([[1000, 800, 300, 0], [1000, 700, 200, 0], [1000, 600, 100, 0]])  # at 0, 45 and 90


def toward(vertical, horizontal):
    """The direction (3, 1), right, up and along the axis, at angles of type C."""
    v, h = np.radians(vertical), np.radians(horizontal)
    return torch.tensor([[np.sin(v) * np.cos(h)], [np.sin(v) * np.sin(h)], [np.cos(v)]], dtype=torch.float32)


def written(folder, text, name="lamp.ies"):
    (folder / name).write_text(text)
    return read_profile(folder / name)


def test_candela_are_those_of_the_file_at_its_angles_and_between(tmp_path):
    profile = written(tmp_path, ies(QUADRANT, VERTICAL, [0, 45, 90], multiplier=2, ballast=0.5, factor=7))
    for plane, row in zip((0, 45, 90), QUADRANT, strict=True):
        for angle, value in zip(VERTICAL, row, strict=True):
            for mirrored in {plane, 180 - plane, 180 + plane, (360 - plane) % 360}:  # of each quadrant
                assert float(profile.at(toward(angle, mirrored))) == pytest.approx(value, rel=0.01, abs=1)
    assert float(profile.at(toward(15, 22.5))) == pytest.approx((1000 + 1000 + 800 + 700) / 4, rel=0.01)
    assert float(profile.at(toward(120, 0))) == 0  # beyond the stated angles
    assert profile.peak == 1000
    assert profile.absolute


@pytest.mark.parametrize(
    ("version", "factor"),
    [(None, 0.5), ("IESNA91", 0.5), ("IESNA:LM-63-1995", 1), ("IESNA:LM-63-2002", 1), ("IES:LM-63-2019", 1)],
)
def test_the_ballast_lamp_factor_counts_in_the_versions_that_have_it(tmp_path, version, factor):
    given = 1.00001 if version == "IES:LM-63-2019" else 0.5  # the generation of the file, since 2019
    text = ies([[100, 50]], [0, 90], [0], version=version, factor=given, lumens=1200)
    profile = written(tmp_path, text)
    assert profile.peak == pytest.approx(100 * factor)
    assert not profile.absolute


@pytest.mark.parametrize(
    ("horizontal", "alike"),
    [([0], {0, 70, 180, 300}), ([0, 90, 180], {40, 320}), ([90, 180, 270], {100, 80}), ([0, 120, 240], {10})],
)
def test_the_symmetries_of_type_c(tmp_path, horizontal, alike):
    random = np.random.default_rng(0)
    candela = random.uniform(10, 20, (len(horizontal), 2))
    profile = written(tmp_path, ies(candela, [0, 90], horizontal))
    values = [float(profile.at(toward(50, angle))) for angle in alike]
    assert max(values) - min(values) < 0.01 * max(values)
    if len(horizontal) > 1:
        asked = np.interp(horizontal[1], horizontal, candela[:, 0] * 4 / 9 + candela[:, 1] * 5 / 9)
        assert float(profile.at(toward(50, horizontal[1]))) == pytest.approx(asked, rel=0.01)


@pytest.mark.parametrize("kind", [2, 3])
def test_types_a_and_b_turn_about_other_axes(tmp_path, kind):
    horizontal, vertical = [0, 40, 80], [-60, 0, 60]
    candela = np.array([[50, 100, 70], [30, 60, 40], [10, 20, 15]])  # (H, V)
    profile = written(tmp_path, ies(candela, vertical, horizontal, kind=kind))
    for column, h in enumerate(horizontal):
        for row, v in enumerate(vertical):
            hr, vr = np.radians(h), np.radians(v)
            if kind == 3:  # A: the poles are up and down
                direction = [np.cos(vr) * np.sin(hr), np.sin(vr), np.cos(vr) * np.cos(hr)]
            else:
                direction = [np.sin(hr), np.cos(hr) * np.sin(vr), np.cos(hr) * np.cos(vr)]
            for side in (1, -1):
                turned = torch.tensor([side * direction[0], *direction[1:]], dtype=torch.float32)[:, None]
                assert float(profile.at(turned)) == pytest.approx(candela[column, row], rel=0.01)


@pytest.mark.parametrize(
    ("symmetry", "stored"),
    [(0, [0, 90, 180, 270]), (1, [0]), (2, [0, 90, 180]), (3, [270, 0, 90]), (4, [0, 90])],
)
def test_eulumdat_of_each_symmetry(tmp_path, symmetry, stored):
    values = np.random.default_rng(symmetry).uniform(50, 100, (len(stored), 3))
    profile = written(tmp_path, ldt(values, [0, 45, 90], [0, 90, 180, 270], symmetry), "lamp.ldt")
    for plane, row in zip(stored, values, strict=True):
        for angle, value in zip((0.01, 45, 89.99), row, strict=True):
            if angle > 1:
                assert float(profile.at(toward(angle, plane))) == pytest.approx(2 * value, rel=0.01)
    if symmetry == 1:
        assert float(profile.at(toward(45, 200))) == pytest.approx(2 * values[0, 1], rel=0.01)
    if symmetry in (2, 4):
        assert float(profile.at(toward(45, 270))) == pytest.approx(2 * values[1, 1], rel=0.01)
    if symmetry in (3, 4):
        opposite = {3: values[1], 4: values[0]}[symmetry]
        assert float(profile.at(toward(45, 180))) == pytest.approx(2 * opposite[1], rel=0.01)


def test_the_flux_of_a_lambertian_lamp_is_pi_times_its_peak(tmp_path):
    angles = np.arange(0, 91, 2.5)
    profile = written(tmp_path, ies([100 * np.cos(np.radians(angles))], angles, [0]))
    assert profile.flux == pytest.approx(100 * np.pi, rel=0.01)


def test_tilt_is_read_from_the_file_or_from_another(tmp_path):
    included = written(tmp_path, ies([[9, 5]], [0, 90], [0], tilt="TILT=INCLUDE\n1\n2\n0 90\n1 0.5"))
    assert included.tilt_factor(45) == pytest.approx(0.75)
    (tmp_path / "tilt.dat").write_text("1\n2\n0 90\n1 0.5\n")
    other = written(tmp_path, ies([[9, 5]], [0, 90], [0], tilt="TILT=tilt.dat"), "other.ies")
    assert other.tilt_factor(90) == pytest.approx(0.5)
    lamp = relight.PointLight((0, 2, 0), toward=(0, 0, 0), profile=tmp_path / "lamp.ies")
    level = relight.PointLight((2, 0, 0), toward=(0, 0, 0), profile=tmp_path / "lamp.ies")
    down, across = torch.tensor([[0.0], [-1.0], [0.0]]), torch.tensor([[-1.0], [0.0], [0.0]])
    assert float(lamp.transmission(down)) == pytest.approx(1, rel=0.01)
    assert float(level.transmission(across)) == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing", "expected an IES file with a line TILT="),
        (ies([[1, 2]], [0, 90], [0, 90]), "expected 4 candela, the file has 2"),
        (ies([[1, 2, 3]], [0, 90], [0]), "got 1 numbers more"),
        (ies([[np.nan, 2]], [0, 90], [0]), "expected finite candela, got nan"),
        (ies([[0, 0]], [0, 90], [0]), "all its candela are 0"),
        (ies([[-1, 2]], [0, 90], [0]), "finite candela of at least 0"),
        (ies([[1, 2]], [90, 0], [0]), "vertical angles that rise"),
        (ies([[1, 2]], [0, 90], [0], kind=7), "photometry of type 1, 2 or 3, got 7"),
        (
            ies([[1, 2]], [0, 90], [0]).replace("0.1", "wide"),
            "expected a number among the numbers of the lamp",
        ),
        (ies([[1, 2]], [0, 90], [0]).replace("1 2 1 2 0", "1"), "expected"),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path, text, message):
    if message == "expected":
        text = text[: len(text) // 2]
    with pytest.raises(ValueError, match=message) as refused:
        written(tmp_path, text)
    assert "lamp.ies" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_short_eulumdat_and_other_files_are_refused(tmp_path):
    text = ldt([[1, 2, 3]], [0, 45, 90], [0], 1)
    with pytest.raises(ValueError, match=r"lamp.ldt: expected 3 values, the file has 2"):
        written(tmp_path, text.rstrip().rpartition("\r\n")[0], "lamp.ldt")
    with pytest.raises(ValueError, match=r"lamp.ldt: expected a symmetry from 0 to 4, got 9"):
        written(tmp_path, ldt([[1, 2, 3]], [0, 45, 90], [0], 9), "lamp.ldt")
    with pytest.raises(
        ValueError, match=r"lamp.txt: expected a lamp's profile, whose name ends in .ies or .ldt"
    ):
        written(tmp_path, text, "lamp.txt")
    with pytest.raises(FileNotFoundError, match="no such file"):
        relight.PointLight((0, 0, 1), toward=(0, 0, 0), profile="missing.ies")
    written(tmp_path, ies([[1, 1]], [0, 90], [0]))
    with pytest.raises(ValueError, match="toward: is missing; expected a point that the profile faces"):
        relight.PointLight((0, 0, 1), profile=tmp_path / "lamp.ies")
    with pytest.raises(ValueError, match="angle_scale: expected a profile"):
        relight.PointLight((0, 0, 1), toward=(0, 0, 0), angle_scale=0.5)


def test_a_lamp_shines_as_its_profile_says(viewed, tmp_path):
    written(tmp_path, ies(QUADRANT, VERTICAL, [0, 45, 90]))
    place, target = np.array([0.0, 0.3, 2.0]), np.zeros(3)
    plain = relight.PointLight(tuple(place), toward=tuple(target), intensity=3)
    lamp = relight.PointLight(tuple(place), toward=tuple(target), intensity=3, profile=tmp_path / "lamp.ies")
    positions = torch.tensor([[0.4, 0.0], [0.3, 0.3], [0.0, 0.0]])  # two points; the second is on the axis
    ((directions, lit),) = lamp.rays(positions)
    ((_, unshaped),) = plain.rays(positions)
    leaving = -directions
    axes = np.stack(
        [[1, 0, 0], np.cross(place / np.linalg.norm(place), [1, 0, 0]), -place / np.linalg.norm(place)]
    )
    own = np.float32(axes) @ leaving.numpy()
    expected = lamp.profile.at(torch.from_numpy(own)) / 1000
    np.testing.assert_allclose(lit / unshaped, expected, rtol=0.01)
    wide = relight.PointLight(
        tuple(place), toward=tuple(target), profile=tmp_path / "lamp.ies", angle_scale=1.0
    )
    assert float(wide.transmission(leaving)[0]) > float(lamp.transmission(leaving)[0])
    once, twice = viewed.relit(lamp), viewed.relit([lamp, lamp])
    np.testing.assert_allclose(2 * once[..., :3], twice[..., :3], rtol=1e-4, atol=1e-6)
    assert once[..., :3].sum() < viewed.relit(plain)[..., :3].sum()


def test_texts_files_and_stages_keep_the_profile(here):
    written(here, ies(QUADRANT, VERTICAL, [0, 45, 90]))
    words = "key:position=1/1/2,toward=0/0/0,profile=lamp.ies,intensity=2,angle_scale=0.5"
    (light,) = relight.Lighting(light=(words,)).rig().lights
    assert isinstance(light, relight.PointLight)
    assert light.profile.peak == 1000
    (here / "rigs").mkdir()
    relight.write_lights("rigs/lights.yaml", [light])
    assert relight.read_lights("rigs/lights.yaml") == [light]
    pytest.importorskip("pxr")
    relight.write_lights("rigs/lights.usda", [light])
    (again,) = relight.read_lights("rigs/lights.usda")
    assert again.profile == light.profile
    assert again.angle_scale == pytest.approx(0.5)
    assert again.intensity == pytest.approx(2, rel=1e-3)
    points = torch.tensor([[0.4, 0.0], [0.3, -0.8], [0.1, 0.2]])
    for one, other in zip(light.rays(points), again.rays(points), strict=True):
        np.testing.assert_allclose(one.irradiance, other.irradiance, rtol=1e-3)


def test_a_stage_may_normalise_its_profile(tmp_path):
    pytest.importorskip("pxr")
    angles = np.arange(0, 91, 5)
    written(tmp_path, ies([40 * np.cos(np.radians(angles))], angles, [0]))
    stage = """#usda 1.0
        (
            metersPerUnit = 1
            upAxis = "Y"
        )
        def Camera "camera" {
            float focusDistance = 3
            double3 xformOp:translate = (0, 0, 3)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }
        def SphereLight "lamp" (prepend apiSchemas = ["ShapingAPI"]) {
            float inputs:radius = 0.1
            float inputs:intensity = 50
            asset inputs:shaping:ies:file = @./lamp.ies@
            bool inputs:shaping:ies:normalize = %s
            double3 xformOp:translate = (0, 0, 2)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }"""
    found = {}
    for state in (0, 1):
        (tmp_path / "set.usda").write_text(stage % state)
        (found[state],) = relight.read_lights(tmp_path / "set.usda")
    assert found[0].intensity == pytest.approx(50 * 0.01 * 40, rel=0.01)  # times candela
    assert found[1].intensity == pytest.approx(50 * 0.01 / np.pi, rel=0.01)  # over the flux, π times the peak
    assert found[0].axis == pytest.approx((0, 0, -1), abs=1e-6)
