import base64
import subprocess
import sys
import warnings
import zlib

import numpy as np
import pytest

import relight
from relight.scene.lights import read_lights, read_rig, write_lights
from relight.scene.usd.lights import moments

pytest.importorskip("pxr")

CAMERA = """
def Camera "cam" {
    float focalLength = 50
    float horizontalAperture = 36
    float verticalAperture = 24
    float focusDistance = 250
    double3 xformOp:translate = (0, 150, 300)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Xform "mark" {
    double3 xformOp:translate = (50, 100, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
KEY = """
def DistantLight "key" {
    float inputs:angle = 0
    float3 xformOp:rotateXYZ = (-30, 90, 0)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
}
"""
BULB = """
def SphereLight "bulb" {
    float inputs:radius = 10
    float inputs:intensity = 4
    double3 xformOp:translate = (150, 150, 100)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


DAMAGED_CRATE = (  # zlib and base 85: a .usdc of three lights with a few bytes exchanged
    "c-oCsZ%i9y7=PZQM-K{Xq3!6VLW@ISfn+$p$l~t!Q#W*hLa&N5&K&IvJ-Oap?hb`TW0PgcV$70l#=taFKd3P=N}^#O{D6tN#AG"
    "J>piwf$n6fc9=3rsj6an9B?>a(U*xUZz_nznZJ@50p|0CU9^|5Gc3owu=zvRP%mDLT3MWYGwtnXriO$2TNr==?;@Dlh4`~;f`$"
    "_N4kL1d90B5<v9c!Z#wpu%zv5`@-"
    "uz^wCmlwh01U(0*Le`;7cbd|N}Y2U}ffz!ukY#CnpJhlJyv7gyz&Xiv}ICh<F^;|un9QtkCw)ekx;`QC<E{)&%Wa97D)r%~5^!"
    "oWP8!xjDHk0%0#EtPEsy>*@@w4(|uK%wh&4Y_IUyqlanq69c^Cp{>zt7prr;3D6>n7PPfnU=VZ=GSY^4z-"
    "k)9lF+v;4@~aqkm9ZN+ET#b-"
    "B&KfXcy@%zOmmA%yFlGIt>OP2Co+qgKqtG*WC1sG7921OlG*ua_|!CFif4R~JBqy(s%m}*IiQbNNrByg`VAQ=&&16{>&u~)<zb"
    "oVM+3XCBYw+kr@aV4cHGL{YK7v%)>;~|iQlnSaKV+mSC-"
    "4JABpV*f)AR+3iBn)NTL|Gj$^v1X%DVi<dK~>QQH0*)HGKnEb;=vLK3v!=S45OlKU|AQ9As9Rk=?=Bg&;(g80!Jy_Vmh=0$xPK"
    "06>Elwb%?4-"
    "tl^`um>*3Fswnq0McROTMB_=E67*rX<G`}eBjFY^0UoD_qhO2x8Ur`k(=km*hy$%qstd56Bq`%>pkOO}rz^dNjCCElaJ&}f0pe"
    "d16Grklgpzm+_+Cj7jFTt`@sD7B^UhxAQ4|SMf}x3nPb9!l`my}tOYo|oi9(MknS=Si(_L-"
    "p>g~0Um{knHyf=)1_U9oAA&UCP;baz^uH^;NJUo;Ag_dsEPC<%ni%}Oxb|l#%1zfiqnxGbFCUa^j*s+}}a6${XI2QvY2?iQ!!N"
    "Y)~1{w;vL60eJB}x~E7*q2;se|xYhE~ZyrHf0O>I)fS6=No;e@KEcT(t+jMabNB0S?l;!U6Er1c3AsLYxy+!XP_&cMuxRyW2S6"
    "NZsTC?x(Y7pJIS?5Nswfh*Se5wNJth7e~KLvUI~?k|jL?JKeB72&fE3p^iI3nIm<j_gZ6a&)o`{BY|i>g8aU4j5jB*mX9^Tzw}"
    "+&ahrB7(5}C{bN*{y$De^&uk(tRx$G^N@fQB!b^Y!wy5udM4o!uq3!%Kps)-"
    "7#Q@h=ki&APXpWojZ<0CWzGHBZ2oOMu$B0#ea8ab+ST)%m*$2vP>bSF;?%v9bowfxxhA}U;_ZWmTxyt#>5DB6;vXRi28;DP)-"
    "s|9ygHZ86ov|{Jrwu$G^n)45pIe(9tS}aVaAdGxK({#T1n85NK;=53qz16L$%Dgm=tmIr>vfnVi<JoX~^xh5h4wY@cu%bozuD1"
    "3)_Xy2a7d}gVx-Gn~b&daXmi=+G)*j|<$`Lx-9<X<P6Tf$jJ6y5sZ(DLS5^h;**Q~_jmi!;Q*S1F"
)


def stage(folder, body, head="metersPerUnit = 0.01", name="set.usda"):
    path = folder / name
    path.write_text(f"#usda 1.0\n(\n    {head}\n)\n{body}\n")
    return path


def test_a_stage_comes_into_the_cameras_frame(tmp_path):
    path = stage(tmp_path, CAMERA + KEY + BULB)
    key, bulb = read_lights(path)
    np.testing.assert_allclose((key.azimuth, key.elevation), (90, 30), atol=1e-4)
    assert key.name == "key"
    # On the camera's axis, 2.5 m before it: (0, 150, 50).
    np.testing.assert_allclose(bulb.position, (1.5, 0, 0.5), atol=1e-6)
    np.testing.assert_allclose(bulb.radius, 0.1, rtol=1e-6)
    np.testing.assert_allclose(bulb.intensity, 4 * 0.1**2, rtol=1e-6)
    _, bulb = read_lights(path, subject_at="/mark")
    np.testing.assert_allclose(bulb.position, (1.0, 0.5, 1.0), atol=1e-6)
    _, bulb = read_lights(path, subject_at=(150, 150, 0))
    np.testing.assert_allclose(bulb.position, (0, 0, 1.0), atol=1e-6)


SUN = """
def DistantLight "sun" {
    float inputs:angle = 5
    float inputs:intensity = 0.75
    bool inputs:normalize = 1
    bool inputs:enableColorTemperature = 1
}
"""
BLENDER = 'doc = "Blender v5.0.1"'


@pytest.mark.states("USD", "suns and temperatures of Blender", "honoured")
def test_blenders_sun_and_temperature(tmp_path):
    """Blender writes a sun of 3 W/m2 and 10 degrees so, and switches temperatures on that it does not use."""
    (sun,) = read_lights(stage(tmp_path, SUN, BLENDER))
    np.testing.assert_allclose(sun.power, 3 / np.pi, rtol=1e-6)
    assert (sun.angle, sun.temperature) == (10, None)
    (other,) = read_lights(stage(tmp_path, SUN, name="other.usda"))
    np.testing.assert_allclose(other.power.mean(), 0.75 / np.pi, rtol=0.05)
    assert (other.angle, other.temperature) == (5, 6500)
    warm = SUN.replace("bool inputs:enable", "float inputs:colorTemperature = 3200\n    bool inputs:enable")
    (sun,) = read_lights(stage(tmp_path, warm, BLENDER))
    assert sun.temperature == 3200


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize(
    "kind",
    ["SphereLight", "RectLight", "DiskLight", "DistantLight", "SphereLight over time", "SphereLight on"],
)
def test_lights_of_blender_are_white_unless_they_say_how_warm(tmp_path, kind, binary):
    switch = "bool inputs:enableColorTemperature"
    if kind.endswith("over time"):
        switch += ".timeSamples = { 1: 1, 3: 1 }"
    else:
        switch += " = 1"
    if kind.endswith("on"):
        switch += "\n    float inputs:colorTemperature = 6500"
    text = f'def {kind.split()[0]} "lamp" {{\n    float inputs:intensity = 2\n    {switch}\n}}'
    path = stage(tmp_path, text, BLENDER)
    if binary:
        from pxr import Sdf

        layer = Sdf.Layer.FindOrOpen(str(path))
        layer.Export(str(tmp_path / "set.usdc"))
        path = tmp_path / "set.usdc"
    (light,) = read_lights(path)
    power = light.at(2).power if isinstance(light, relight.MovingLight) else light.power
    assert (np.ptp(power) > 0.01 * power.mean()) == kind.endswith("on")


@pytest.mark.parametrize(
    ("body", "at", "power", "angle"),
    [
        (SUN.replace("intensity = 0.75", "intensity.timeSamples = { 1: 0.75, 3: 2.25 }"), 2, 6, 10),
        (SUN.replace("inputs:angle = 5", "inputs:angle.timeSamples = { 1: 2, 3: 4 }"), 2, 3, 6),
        (SUN.replace('"sun" {', '"sun" {\n    float inputs:exposure = 1'), 1, 6, 10),
        (f'def Xform "world" {{ double3 xformOp:scale = (9, 9, 9)\n uniform token[] xformOpOrder = '
         f'["xformOp:scale"]\n{SUN}}}', 1, 3, 10),
    ],
)  # fmt: skip
def test_suns_of_blender_that_move_or_hang_somewhere(tmp_path, body, at, power, angle):
    (sun,) = read_lights(stage(tmp_path, body, BLENDER))
    sun = sun.at(at) if isinstance(sun, relight.MovingLight) else sun
    np.testing.assert_allclose(sun.power, power / np.pi, rtol=1e-5)
    assert sun.angle == pytest.approx(angle)


def test_what_is_authored_over_blenders_stage_is_usdlux(tmp_path):
    """The layer that a value is from says what it means, not the stage."""
    stage(tmp_path, SUN, BLENDER, "blender.usda")
    over = 'over "sun" {\n    float inputs:intensity = 2\n}'
    (sun,) = read_lights(stage(tmp_path, over, "subLayers = [@./blender.usda@]"))
    np.testing.assert_allclose(sun.power, 2 / np.pi, rtol=1e-6)
    assert sun.angle == 10


@pytest.mark.states("USD", "the strength of a world of Blender, which it does not write", "warned of")
def test_blenders_worlds(tmp_path):
    """A colour is a picture of one pixel; the strength of an image is not in the file."""
    relight.write(tmp_path / "colour.exr", np.full((1, 1, 3), (1, 0.5, 0.25), np.float32))
    relight.write(tmp_path / "sky.exr", np.random.default_rng(0).random((32, 64, 3), np.float32))
    dome = """
    def DomeLight "env_light" {
        float inputs:intensity = 2.5
        asset inputs:texture:file = @./colour.exr@
    }"""
    (sky,) = read_lights(stage(tmp_path, dome, BLENDER))
    np.testing.assert_allclose(sky.intensity * sky.image.pixels[5, 7], (2.5, 1.25, 0.625), rtol=1e-3)
    dome = dome.replace("colour.exr", "sky.exr").replace("float inputs:intensity = 2.5", "")
    with pytest.warns(UserWarning, match="/env_light: Blender does not write the strength of a world"):
        read_lights(stage(tmp_path, dome, BLENDER))


def test_the_camera_says_its_field_of_view(tmp_path):
    rig = read_rig(stage(tmp_path, CAMERA + KEY), camera="/cam")
    np.testing.assert_allclose(np.tan(np.radians(rig.view.vertical_degrees(1.5) / 2)), 12 / 50, rtol=1e-6)
    assert rig.camera == "/cam"
    assert read_rig(stage(tmp_path, KEY)).view is None


def test_the_hierarchy_scales_and_turns(tmp_path):
    body = f"""
    def Xform "rig" {{
        float3 xformOp:rotateXYZ = (0, 90, 0)
        float3 xformOp:scale = (2, 2, 2)
        uniform token[] xformOpOrder = ["xformOp:rotateXYZ", "xformOp:scale"]
        {BULB}{KEY}
    }}"""
    bulb, key = read_lights(stage(tmp_path, body))
    np.testing.assert_allclose(bulb.position, (2, 3, -3), atol=1e-5)
    np.testing.assert_allclose(bulb.radius, 0.2, rtol=1e-6)
    np.testing.assert_allclose(abs(key.azimuth), 180, atol=1e-3)


def test_a_z_up_stage_is_turned_to_y_up(tmp_path):
    """Without a camera the stage's axes are its own, with up where ours is."""
    body = """
    def SphereLight "bulb" {
        double3 xformOp:translate = (1, -2, 3)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }"""
    (bulb,) = read_lights(stage(tmp_path, body, 'metersPerUnit = 1\n    upAxis = "Z"'))
    np.testing.assert_allclose(bulb.position, (1, 3, 2), atol=1e-6)


@pytest.mark.states("USD", "hidden prims", "honoured")
def test_what_is_hidden_or_dark_does_not_shine(tmp_path):
    hidden = KEY.replace('"key" {', '"hidden" {\n    token visibility = "invisible"')
    dark = KEY.replace('"key" {', '"dark" {\n    float inputs:intensity = 0')
    assert [light.name for light in read_lights(stage(tmp_path, KEY + hidden + dark))] == ["key"]


def test_colours_add_up(tmp_path):
    body = KEY.replace(
        '"key" {',
        '"key" {\n    color3f inputs:color = (1, 0.5, 0.25)\n    float inputs:exposure = 2\n'
        "    float inputs:intensity = 3.14159265\n    bool inputs:enableColorTemperature = 1\n"
        "    float inputs:colorTemperature = 3200\n    float inputs:diffuse = 0.5",
    )
    from pxr import UsdLux

    (key,) = read_lights(stage(tmp_path, body))
    tint = np.array(UsdLux.BlackbodyTemperatureAsRgb(3200))
    np.testing.assert_allclose(key.power, 2 * tint * (1, 0.5, 0.25), rtol=2e-3)


@pytest.mark.states("USD", "time samples", "honoured")
def test_time_samples_become_moving_lights(tmp_path):
    body = """
    def DistantLight "sun" {
        float inputs:angle = 0
        float inputs:intensity.timeSamples = { 1001: 1, 1011: 3 }
        float xformOp:rotateY.timeSamples = { 1001: -90, 1011: 90 }
        uniform token[] xformOpOrder = ["xformOp:rotateY"]
    }"""
    sun, key = read_lights(stage(tmp_path, body + KEY))
    assert isinstance(sun, relight.MovingLight)
    assert isinstance(key, relight.DirectionalLight)
    assert sun.span == (1001, 1011)
    for frame, azimuth, intensity in ((1000, -90, 1), (1006, 0, 2), (1011, 90, 3)):
        still = sun.at(frame)
        np.testing.assert_allclose(still.azimuth, azimuth, atol=1e-3)
        np.testing.assert_allclose(still.intensity * np.pi, intensity, rtol=1e-6)


def test_a_camera_that_moves_moves_the_lights(tmp_path):
    still, moved = (
        "translate = (0, 150, 300)",
        "translate.timeSamples = { 1: (0, 150, 300), 3: (200, 150, 300) }",
    )
    body = CAMERA.replace(still, moved)
    key, bulb = read_lights(stage(tmp_path, body + KEY + BULB), subject_at="/mark")
    np.testing.assert_allclose(key.azimuth, 90, atol=1e-3)
    np.testing.assert_allclose(bulb.position, (1.0, 0.5, 1.0), atol=1e-6)  # the camera does not turn
    _, bulb = read_lights(stage(tmp_path, body + KEY + BULB))
    np.testing.assert_allclose(bulb.at(2).position, (0.5, 0, 0.5), atol=1e-6)


@pytest.mark.parametrize(("first", "last"), [(20, -20), (0, -20)])
def test_a_sky_that_tilts_against_the_camera_stays_and_says_so(tmp_path, first, last):
    relight.write(tmp_path / "sky.exr", np.random.default_rng(0).random((32, 64, 3), np.float32))
    turning = (
        'def Camera "cam" {\n'
        f"    float xformOp:rotateX.timeSamples = {{ 1: {first}, 11: {last} }}\n"
        '    uniform token[] xformOpOrder = ["xformOp:rotateX"]\n}\n'
    )
    sky = 'def DomeLight "sky" {\n    asset inputs:texture:file = @sky.exr@\n}\n'
    path = stage(tmp_path, turning + sky)
    with pytest.warns(
        UserWarning, match="/sky: tilts against the camera, or .* in time; it stays as in its first frame"
    ):
        (light,) = read_lights(path, camera="/cam", subject_at=(0, 0, -1))
    (tmp_path / "still").mkdir()
    relight.write(tmp_path / "still" / "sky.exr", relight.read(tmp_path / "sky.exr"))
    held = stage(tmp_path / "still", turning.replace(f"11: {last}", f"11: {first}") + sky)
    (still,) = read_lights(held, camera="/cam", subject_at=(0, 0, -1))
    np.testing.assert_allclose(light.samples()[0], still.samples()[0], atol=1e-5)


MANY = """
def RectLight "panel" (prepend apiSchemas = ["ShapingAPI"]) {
    rel light:filters = </gobo>
    asset inputs:shaping:ies:file = @lamp.ies@
    float xformOp:rotateZ = 30
    uniform token[] xformOpOrder = ["xformOp:rotateZ"]
}
def LightFilter "gobo" {}
def CylinderLight "tube" {}
def PortalLight "window" {}
def Mesh "glowing" (prepend apiSchemas = ["MeshLightAPI"]) {}
"""


@pytest.mark.states(
    "USD",
    "light filters, IES profiles of other lights than spheres, portals, cylinders, mesh lights",
    "warned of",
)
def test_what_cannot_be_represented_is_named_with_its_prim(tmp_path):
    with pytest.warns(UserWarning, match="set.usda") as caught:
        read_lights(stage(tmp_path, MANY))
    said = "\n".join(str(warning.message) for warning in caught)
    for prim, words in (
        ("/panel", "light filters"),
        ("/panel", "IES profile"),
        ("/panel", "leans by 30 degrees"),
        ("/tube", "CylinderLight"),
        ("/window", "portal"),
        ("/glowing", "Mesh"),
    ):
        assert any(f"{prim}: " in line and words in line for line in said.splitlines()), (prim, words)


def rig(folder):
    sky = np.random.default_rng(0).random((32, 64, 3), np.float32)
    relight.write(folder / "maps" / "sky.exr", sky)
    return [
        relight.DirectionalLight(azimuth=-40, elevation=30, angle=3, name="key light", temperature=4000),
        relight.DirectionalLight(
            azimuth=20, elevation=90, temperature=20_000, exposure=-2, colour=(1, 0.5, 0)
        ),
        relight.DirectionalLight((0, 0, -1), name="behind", temperature=5000, locus="daylight"),
        relight.PointLight((0.6, 0.4, 0.8), radius=0.05, intensity=0.6, name="lamp"),
        relight.PointLight((0.6, 0.4, -0.8), name="bare"),
        relight.RectLight((-1, 0.5, 1), (0, 0, 0), 0.5, 0.7, intensity=2, name="box"),
        relight.RectLight((0, 2, 0), (0, 0, 0), 0.5, 0.7, name="overhead"),
        relight.PointLight((1, 2, 1), toward=(0, 0.5, 0), cone=30, softness=0.3, name="spot"),
        relight.RectLight((1, 2, 1), (0, 0, 0), 0.3, 0.2, cone=40, softness=1, name="egg crate"),
        relight.EnvironmentLight(folder / "maps" / "sky.exr", rotation=70, intensity=0.3, name="sky"),
        relight.EnvironmentLight(sky[::-1], rotation=-20, name="made"),
        relight.MovingLight(relight.PointLight, position={1: (1, 0, 1), 9: (-1, 1, 1)}, name="swung"),
        relight.MovingLight(relight.DirectionalLight, azimuth=10, orbit=12, name="round"),
    ]


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
def test_lights_come_back_as_they_were(tmp_path, suffix):
    (tmp_path / "maps").mkdir()
    before = rig(tmp_path)
    path = tmp_path / f"rig{suffix}"
    with pytest.warns(UserWarning, match="^round: orbit: written for frames 1 to 13; ") as said:
        write_lights(path, before)
    assert len(said) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        after = read_lights(path)
    assert [light.name for light in after] == [light.name or "light2" for light in before]
    for one, other in zip(before, after, strict=True):
        for frame in (1, 4, 7.5):
            a, b = (light.at(frame) if hasattr(light, "orbit") else light for light in (one, other))
            assert type(a) is type(b)
            np.testing.assert_allclose(a.power, b.power, rtol=1e-6)
            for field in set(a.__dataclass_fields__) & {"direction", "position", "width", "angle", "radius"}:
                # Between frames an orbit is drawn as its chords.
                np.testing.assert_allclose(getattr(a, field), getattr(b, field), atol=1e-6, err_msg=field)
            if hasattr(a, "cone"):
                np.testing.assert_allclose((a.cone, a.softness), (b.cone, b.softness), atol=1e-5)
            if getattr(a, "has_cone", False):
                np.testing.assert_allclose(a.axis, b.axis, atol=1e-6)
            if isinstance(a, relight.RectLight):
                np.testing.assert_allclose(a.points, b.points, atol=1e-6)
            if isinstance(a, relight.EnvironmentLight):
                np.testing.assert_allclose(np.float32(a.samples()[0]), b.samples()[0], atol=1e-5)


def test_moving_temperatures_and_radii_come_back(tmp_path):
    before = [
        relight.MovingLight(relight.DirectionalLight, temperature={1: 5000, 11: 20_000}, name="dusk"),
        relight.MovingLight(relight.PointLight, position=(1, 1, 1), radius={1: 0, 11: 0.5}, name="bulb"),
    ]
    write_lights(tmp_path / "rig.usda", before)
    dusk, bulb = read_lights(tmp_path / "rig.usda")
    for frame in (1, 5, 8, 11):
        np.testing.assert_allclose(dusk.at(frame).power, before[0].at(frame).power, rtol=1e-5)
        np.testing.assert_allclose(bulb.at(frame).radius, before[1].at(frame).radius, atol=1e-6)


def test_a_cube_or_a_colour_space_is_written_as_the_map_that_lights(tmp_path):
    from pxr import Usd, UsdLux

    generator = np.random.default_rng(3)
    relight.write(tmp_path / "strip.exr", generator.random((16, 96, 3), np.float32))
    relight.write(tmp_path / "sky.exr", generator.random((16, 32, 3), np.float32))
    before = [
        relight.EnvironmentLight(tmp_path / "strip.exr", name="cube"),
        relight.EnvironmentLight(tmp_path / "sky.exr", colour_space="ACEScg", name="aces"),
    ]
    write_lights(tmp_path / "rig.usda", before)
    stage = Usd.Stage.Open(str(tmp_path / "rig.usda"))
    for light, again in zip(before, read_lights(tmp_path / "rig.usda"), strict=True):
        dome = UsdLux.DomeLight(stage.GetPrimAtPath(f"/World/{light.name}"))
        written = relight.read(dome.GetTextureFileAttr().Get().resolvedPath)
        assert written.shape[1] == 2 * written.shape[0]  # latlong, as the stage says
        np.testing.assert_allclose(written, light.image.pixels, rtol=2e-3, atol=1e-4)
        np.testing.assert_allclose(again.image.pixels, light.image.pixels, rtol=2e-3, atol=1e-4)


def test_maps_are_found_wherever_the_folder_goes(tmp_path):
    (tmp_path / "one" / "maps").mkdir(parents=True)
    write_lights(tmp_path / "one" / "rig.usda", rig(tmp_path / "one"))
    (tmp_path / "one").rename(tmp_path / "two")
    assert len(read_lights(tmp_path / "two" / "rig.usda")) == 13


def check_refused(match, path, kind=ValueError, **keywords):
    with pytest.raises(kind, match=match) as caught:
        read_lights(path, **keywords)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value) or "subject_at" in str(caught.value)


DOME = 'def DomeLight "sky" {{\n    asset inputs:texture:file = @{}@\n}}'


def test_bad_input_is_named_in_one_line(tmp_path):
    check_refused("no such file", tmp_path / "none.usda", FileNotFoundError)
    check_refused("holds no light that shines; found Mesh", stage(tmp_path, 'def Mesh "body" {}'))
    check_refused(
        "has no camera /World/x; its cameras are /cam", stage(tmp_path, CAMERA + KEY), camera="/World/x"
    )
    check_refused("has no camera not a path", stage(tmp_path, CAMERA + KEY), camera="not a path")
    two = CAMERA + CAMERA.replace('"cam"', '"other"').replace('"mark"', '"there"')
    check_refused("several cameras; expected one of /cam, /other", stage(tmp_path, two + KEY))
    check_refused("has no prim /nowhere", stage(tmp_path, CAMERA + KEY), subject_at="/nowhere")
    check_refused("subject_at: expected", stage(tmp_path, CAMERA + KEY), subject_at=(1, 2))
    unfocused = CAMERA.replace("    float focusDistance = 250\n", "")
    check_refused("/cam has no focus distance", stage(tmp_path, unfocused + KEY))
    check_refused(
        "/sky: its texture ./none.exr is missing",
        stage(tmp_path, DOME.format("./none.exr")),
        FileNotFoundError,
    )
    check_refused("is not a USD stage", stage(tmp_path, "def {{{"))
    (tmp_path / "mesh.obj").write_text("v 0 0 0\n")
    check_refused("expected a lights file", tmp_path / "mesh.obj")
    many = "\n".join(KEY.replace("key", f"key{number}") for number in range(1001))
    check_refused("holds 1001 lights; expected at most 1000", stage(tmp_path, many))
    long = KEY.replace('"key" {', '"key" {\n    float inputs:exposure.timeSamples = { 1: 0, 200000: 1 }')
    check_refused("/key: has time samples from 1 to 200000", stage(tmp_path, long))
    check_refused(
        "/key: has a negative intensity",
        stage(tmp_path, KEY.replace('"key" {', '"key" {\n    float inputs:intensity = -1')),
    )


def test_a_stage_that_includes_itself_is_refused(tmp_path):
    path = stage(tmp_path, KEY, "subLayers = [@./set.usda@]")
    check_refused("includes itself", path)
    stage(tmp_path, KEY, "subLayers = [@./one.usda@]", "two.usda")
    check_refused(
        "includes itself, by way of", stage(tmp_path, KEY, "subLayers = [@./two.usda@]", "one.usda")
    )
    check_refused("missing", stage(tmp_path, KEY, "subLayers = [@./none.usda@]"), FileNotFoundError)


@pytest.mark.states("USD", "files from outside the folder of the stage", "refused")
def test_files_from_outside_need_leave(tmp_path):
    sky = tmp_path / "sky.exr"
    relight.write(sky, np.ones((32, 64, 3), np.float32))
    inner = tmp_path / "inner"
    inner.mkdir()
    stage(tmp_path, KEY, name="key.usda")
    for body, head in (
        (DOME.format("../sky.exr"), ""),
        (DOME.format(sky), ""),
        (KEY, "subLayers = [@../key.usda@]"),
        (KEY, f"subLayers = [@{tmp_path / 'key.usda'}@]"),
    ):
        path = stage(inner, body, head)
        check_refused("allow_external=True", path)
        assert read_lights(path, allow_external=True)


def test_a_package_with_absolute_paths_is_refused(tmp_path):
    import zipfile

    sky = tmp_path / "sky.exr"
    relight.write(sky, np.ones((32, 64, 3), np.float32))
    path = tmp_path / "set.usdz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as package:
        entry = zipfile.ZipInfo("set.usda")
        entry.extra = b"\x86\x19" + bytes([20, 0]) + bytes(20)  # to a multiple of 64 bytes
        entry.extra = entry.extra[:4] + bytes(20)
        package.writestr(entry, f"#usda 1.0\n{DOME.format(sky)}\n")
    check_refused("absolute path", path)


def test_an_orbit_is_sampled_over_the_frames_of_a_sequence():
    light = relight.MovingLight(relight.DirectionalLight, orbit=48, azimuth=-40)
    found = moments(light, (1001, 1010))
    assert [time for time, _ in found] == list(range(1001, 1011))
    assert found[-1][1] == light.at(1010)


OLD = """
def SphereLight "lamp" (prepend apiSchemas = ["ShapingAPI"]) {{
    float {0}exposure.timeSamples = {{ 1: 0, 2: 1 }}
    float {0}intensity = 30
    color3f {0}color = (1, 0.5, 0.25)
    float {0}radius = 0.2
    float {0}shaping:cone:angle = 40
    float {0}shaping:cone:softness = 0.5
}}
"""


@pytest.mark.states("USD", "lights of before 21.02, without `inputs:`", "honoured")
def test_attributes_of_before_21_02_are_read(tmp_path):
    """Houdini 18 and Maya 2022 wrote `intensity`, later programs `inputs:intensity`; today's names win."""
    (old,) = read_lights(stage(tmp_path, OLD.format(""), name="old.usda"))
    (new,) = read_lights(stage(tmp_path, OLD.format("inputs:"), name="new.usda"))
    assert (old.rests, old.moves) == (new.rests, new.moves)
    (plain,) = read_lights(stage(tmp_path, 'def SphereLight "lamp" {}', name="plain.usda"))
    assert old.rests["intensity"] != plain.intensity
    both = 'def SphereLight "lamp" {\n float intensity = 7\n float inputs:intensity = 2\n}'
    (light,) = read_lights(stage(tmp_path, both, name="both.usda"))
    assert light.intensity == pytest.approx(2 * plain.intensity)


OLD_KINDS = {
    "DistantLight": "float {0}angle = 3\n float {0}intensity = 5\n bool {0}normalize = 1\n"
    "bool {0}enableColorTemperature = 1\n float {0}colorTemperature = 3200",
    "RectLight": "float {0}width = 2\n float {0}height = 0.5\n float {0}exposure = 3\nfloat {0}diffuse = 0.5",
    "DiskLight": "float {0}radius = 0.7\n color3f {0}color = (0.2, 1, 0.4)\n float {0}intensity = 2",
    "DomeLight": 'asset {0}texture:file = @./sky.exr@\n token {0}texture:format = "latlong"\n'
    "float {0}intensity = 0.5",
}


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("kind", OLD_KINDS)
def test_old_attributes_of_every_kind_of_light(tmp_path, kind, binary):
    from pxr import Sdf

    relight.write(tmp_path / "sky.exr", np.random.default_rng(0).random((32, 64, 3), np.float32))
    found = []
    for prefix in ("", "inputs:"):
        body = f'def {kind} "light" {{\n{OLD_KINDS[kind].format(prefix)}\n}}'
        path = stage(tmp_path, body, name="set.usda")
        if binary:
            layer = Sdf.Layer.FindOrOpen(str(path))
            layer.Export(str(tmp_path / f"{prefix[:2]}set.usdc"))
            path = tmp_path / f"{prefix[:2]}set.usdc"
        found.append(read_lights(path)[0])
    old, new = found
    for field in old.__dataclass_fields__:
        if field != "image":
            assert getattr(old, field) == getattr(new, field), field
    if kind == "DomeLight":
        np.testing.assert_array_equal(old.image.pixels, new.image.pixels)
    assert not np.allclose(old.power, type(old)().power if kind == "DistantLight" else 1)


@pytest.mark.parametrize("parent", ["PointInstancer", "PointInstancer over Xform"])
def test_only_lights_of_the_instancer_are_left_out(tmp_path, parent):
    inner = 'def SphereLight "bulb" {}'
    if "Xform" in parent:
        inner = f'def Xform "deep" {{\n{inner}\n}}'
    bulbs = f'def PointInstancer "bulbs" {{\n{inner}\n}}'
    body = f'def SphereLight "kept" {{}}\n{bulbs}'
    with pytest.warns(UserWarning, match="bulb: copies of a point instancer are not read"):
        assert [light.name for light in read_lights(stage(tmp_path, body))] == ["kept"]
    alone = stage(tmp_path, bulbs, name="alone.usda")
    with pytest.warns(UserWarning, match="copies"), pytest.raises(ValueError, match="holds no light"):
        read_lights(alone)


@pytest.mark.states("USD", "lights of point instancers", "warned of")
def test_lights_of_a_point_instancer_are_named_and_left_out(tmp_path):
    """They would shine from their prototype's place."""
    body = """
def SphereLight "kept" {}
def PointInstancer "bulbs" {
    rel prototypes = [</bulbs/bulb>]
    def SphereLight "bulb" {}
}
"""
    with pytest.warns(UserWarning, match="/bulbs/bulb: copies of a point instancer are not read"):
        (light,) = read_lights(stage(tmp_path, body))
    assert light.name == "kept"


@pytest.mark.states("USD", "prims that a damaged .usdc lists and does not hold", "refused")
def test_a_damaged_crate_is_refused_before_usd_ends_the_process(tmp_path):
    """In a process of its own: USD aborts where it composes such a layer."""
    path = tmp_path / "damaged.usdc"
    path.write_bytes(zlib.decompress(base64.b85decode(DAMAGED_CRATE)))
    program = "import sys, relight; relight.read_lights(sys.argv[1])"
    refused = "damaged.usdc: is damaged: it lists what it does not hold"
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)], capture_output=True, text=True, timeout=120
    )
    assert refused in done.stderr
    assert done.returncode == 1  # of an exception that nobody caught, not of a signal


def test_values_and_transforms_of_no_meaning_name_the_prim(tmp_path):
    other = KEY.replace("float inputs:angle = 0", 'string inputs:exposure = "bright"')
    check_refused("/key: holds a value of another type", stage(tmp_path, other))
    far = KEY.replace("(-30, 90, 0)", "(-30, inf, 0)")
    check_refused("/key: has a transform that is not finite", stage(tmp_path, far))


def test_a_large_value_of_another_type_is_not_shown_whole(tmp_path):
    values = ", ".join(["(1, 2, 3)"] * 500)
    with pytest.raises(ValueError, match="/key: holds a value of another type") as refused:
        read_lights(
            stage(tmp_path, KEY.replace("float inputs:angle = 0", f"float3[] inputs:angle = [{values}]"))
        )
    assert len(str(refused.value)) < 500


@pytest.mark.parametrize(("turn", "move"), [((0, 90, 0), (0, 0, 0)), ((20, -130, 75), (300, -40, 1000))])
@pytest.mark.parametrize("up", ["Y", "Z"])
def test_a_turned_world_is_lit_as_before(tmp_path, turn, move, up):
    """The camera, the lights and the mark turn and move together: nothing changes before the camera."""
    whole = CAMERA + KEY + BULB
    before = read_lights(stage(tmp_path, whole), subject_at="/mark")
    head = f'metersPerUnit = 0.01\n    upAxis = "{up}"'
    world = f"""def Xform "world" {{
    double3 xformOp:translate = {move}
    float3 xformOp:rotateXYZ = {turn}
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
    {whole}
}}"""
    after = read_lights(stage(tmp_path, world, head, "turned.usda"), subject_at="/world/mark")
    np.testing.assert_allclose(after[0].direction, before[0].direction, atol=1e-5)
    np.testing.assert_allclose(after[1].position, before[1].position, atol=1e-4)
    np.testing.assert_allclose([light.power for light in after], [light.power for light in before], rtol=1e-5)
