import json
import shutil
import struct
import subprocess

import numpy as np
import pytest
from helpers import ROOT, damage, exported, shipped

import relight
from relight.scene.asset import ROUGHNESS
from relight.scene.lights import read_lights

pytest.importorskip("pxr")
trimesh = pytest.importorskip("trimesh")
KEY = relight.DirectionalLight(azimuth=-40, elevation=30, name="key")
LAMP = relight.PointLight((0.8, 0.4, 0.9), intensity=0.5, name="lamp")


@pytest.fixture(scope="module")
def subject():
    with damage.small_canvas(256):
        return relight.Subject(relight.read(ROOT / "examples" / "person.png"))


@pytest.fixture(scope="module")
def files(subject, tmp_path_factory):
    """{suffix: the exported file}."""
    folder = tmp_path_factory.mktemp("exported")
    return {
        suffix: subject.export(folder / f"person.{suffix}", [KEY, LAMP], triangles=8_000)
        for suffix in ("glb", "usda", "usdc", "usdz")
    }


def tree(path):
    content = path.read_bytes()
    return json.loads(content[20 : 20 + struct.unpack_from("<I", content, 12)[0]])


@pytest.mark.parametrize("suffix", ["usda", "usdc", "usdz"])
def test_openusd_has_no_complaints(files, suffix):
    assert exported.usd_complaints(files[suffix]) == []


def test_the_feet_are_on_the_ground(files):
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(files["usdc"]))
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    bounds = UsdGeom.BBoxCache(0, ["default"]).ComputeWorldBound(stage.GetPrimAtPath("/World/Person"))
    box = bounds.ComputeAlignedRange()
    np.testing.assert_allclose(box.GetMin()[1], 0, atol=1e-4)
    np.testing.assert_allclose(box.GetMax()[1], 1.75, atol=0.07)  # 1.75 m, but for the head's depth
    scene = trimesh.load(files["glb"])
    np.testing.assert_allclose(scene.bounds[:, 1], [box.GetMin()[1], box.GetMax()[1]], atol=1e-4)


def test_trimesh_reads_the_mesh(files, subject):
    scene = trimesh.load(files["glb"])
    (mesh,) = scene.geometry.values()
    assert 4_000 < len(mesh.faces) <= 8_000
    material = mesh.visual.material
    assert (material.alphaMode, material.doubleSided) == ("MASK", True)
    texture = np.asarray(material.baseColorTexture)
    assert texture.shape[2] == 4
    rows, columns = np.nonzero(subject.matte > 0.02)
    assert texture.shape[:2] == (np.ptp(rows) + 1, np.ptp(columns) + 1)  # the plate's own pixels
    front = mesh.vertex_normals[:, 2] > 0
    assert 0.4 < front.mean() < 0.6


def test_the_camera_overlays_the_plate(files, subject):
    """Points of the mesh, seen by the exported camera, are where their texture is: within a pixel."""
    from pxr import Gf, Usd, UsdGeom

    stage = Usd.Stage.Open(str(files["usda"]))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Person/Mesh"))
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera")).GetCamera(Usd.TimeCode.Default())
    place = UsdGeom.XformCache().GetLocalToWorldTransform(mesh.GetPrim())
    frustum = camera.frustum
    seen = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
    height, width = subject.size
    rows, columns = np.nonzero(subject.matte > 0.02)
    top, left, bottom, right = rows.min(), columns.min(), rows.max() + 1, columns.max() + 1
    uv = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get()
    for point, (u, v) in list(zip(mesh.GetPointsAttr().Get(), uv, strict=True))[::501]:
        x, y, _ = seen.Transform(place.Transform(Gf.Vec3d(point)))
        assert abs((x + 1) / 2 * width - (left + u * (right - left))) < 0.5
        assert abs((1 - y) / 2 * height - (bottom - v * (bottom - top))) < 0.5
    perspective = tree(files["glb"])["cameras"][0]["perspective"]
    np.testing.assert_allclose(
        perspective["yfov"], np.radians(camera.GetFieldOfView(camera.FOVVertical)), rtol=1e-5
    )


@pytest.mark.parametrize("suffix", ["glb", "usda", "usdz"])
def test_lights_come_back_where_they_were(files, subject, suffix):
    """Read back through the exported camera they give the same picture."""
    names = ("Camera", "Person") if suffix == "glb" else ("/World/Camera", "/World/Person")
    found = read_lights(files[suffix], camera=names[0], subject_at=names[1])
    difference = subject.relit(found) - subject.relit([KEY, LAMP])
    assert abs(difference).max() < 1e-4


def test_the_photograph_as_an_unlit_surface(subject, tmp_path):
    path = subject.export(tmp_path / "person.glb", texture="photograph", triangles=5000)
    (material,) = tree(path)["materials"]
    assert "KHR_materials_unlit" in material["extensions"]
    scene = trimesh.load(path)
    (mesh,) = scene.geometry.values()
    texture = np.asarray(mesh.visual.material.baseColorTexture) / 255
    plate = relight.read(ROOT / "examples" / "person.png")
    rows, columns = np.nonzero(subject.matte > 0.02)
    part = plate[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    inside = part[..., 3] == 1
    np.testing.assert_allclose(np.mean(texture[inside][:, :3] ** 2.2), part[inside][:, :3].mean(), rtol=0.05)
    stage = subject.export(tmp_path / "person.usda", texture="photograph", triangles=5000)
    assert "emissiveColor.connect" in stage.read_text()
    assert (tmp_path / "person_photograph.png").exists()


def test_light_in_blender_is_what_its_mode_unitless_makes_of_the_file(files):
    """Lux are W/m2 of a sun, candela times 4 pi W of a lamp; in Cycles a white surface has E / pi."""
    key, lamp = tree(files["glb"])["extensions"]["KHR_lights_punctual"]["lights"]
    np.testing.assert_allclose(key["intensity"] / np.pi, np.max(KEY.power), rtol=1e-6)
    watts = lamp["intensity"] * 4 * np.pi
    np.testing.assert_allclose(watts / (4 * np.pi**2), np.max(LAMP.power), rtol=1e-6)


@pytest.mark.parametrize("gloss", [0, 0.7])
def test_the_surface_reflects_what_pictures_do(subject, tmp_path, gloss):
    (material,) = tree(subject.export(tmp_path / "p.glb", triangles=5000, gloss=gloss))["materials"]
    specular = material["extensions"]["KHR_materials_specular"]
    assert specular == {"specularFactor": gloss, "specularColorFactor": [0, 0, 0]}
    roughness = ROUGHNESS if gloss else 1
    assert material["pbrMetallicRoughness"]["roughnessFactor"] == roughness
    stage = subject.export(tmp_path / "p.usda", triangles=5000, gloss=gloss).read_text()
    assert f"inputs:roughness = {roughness}\n" in stage
    with pytest.raises(ValueError, match="gloss: expected a number from 0 to 1, got 2"):
        subject.export(tmp_path / "q.glb", triangles=5000, gloss=2)


def test_what_glb_cannot_hold_is_named(subject, tmp_path):
    lights = [
        relight.EnvironmentLight(np.ones((32, 64, 3), np.float32), name="sky"),
        relight.RectLight((0, 1, 2), (0, 0, 0), 1, 1, name="panel"),
    ]
    with pytest.warns(UserWarning, match="sky: glTF has no environments") as caught:
        subject.export(tmp_path / "person.glb", lights, triangles=1000)
    assert any("panel: glTF has no rectangles" in str(warning.message) for warning in caught)


def test_bad_arguments_leave_nothing(subject, tmp_path):
    for match, arguments in (
        (r"expected a file name that ends in \.glb", {"path": "person.obj"}),
        ("triangles: expected", {"path": "person.glb", "triangles": 10}),
        (
            "texture: expected albedo or photograph, got 'normals'",
            {"path": "person.usda", "texture": "normals"},
        ),
    ):
        with pytest.raises(ValueError, match=match):
            subject.export(tmp_path / arguments.pop("path"), **arguments)
    with pytest.raises(TypeError, match="lights: expected lights"):
        subject.export(tmp_path / "person.usda", ["key"])
    with pytest.raises(FileNotFoundError, match="does not exist"):
        subject.export(tmp_path / "none" / "person.usda")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_khronos_validator_finds_no_fault(files, tmp_path):
    npm = shutil.which("npm")
    assert npm, "install node and npm"
    subprocess.run(
        [npm, "install", "--silent", "--prefix", tmp_path, "gltf-validator@2.0.0-dev.3.10"], check=True
    )
    script = tmp_path / "validate.cjs"
    script.write_text(
        "const fs = require('fs'), { validateBytes } = require('gltf-validator');\n"
        "validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])))"
        ".then(({ issues }) => console.log(JSON.stringify(issues)));\n"
    )
    said = subprocess.run(["node", script, files["glb"]], capture_output=True, text=True, check=True)
    issues = json.loads(said.stdout)
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]


@pytest.mark.slow
@pytest.mark.parametrize(("azimuth", "elevation"), [(-60, 20), (60, 20), (0, 70)])
def test_mitsuba_sees_the_person_that_we_relight(subject, tmp_path, azimuth, elevation):
    check_overlay(subject, tmp_path, relight.DirectionalLight(azimuth=azimuth, elevation=elevation))


@pytest.mark.slow
@pytest.mark.parametrize("scene", shipped.scenes(), ids=lambda scene: scene.name)
@pytest.mark.filterwarnings("ignore:height. the frame cuts the person")
def test_mitsuba_sees_bodies_of_the_light_stage(scene, tmp_path):
    photograph, mask = scene.photograph.numpy(), scene.mask.numpy().astype(np.float32)
    check_overlay(relight.Subject(photograph, mask), tmp_path, KEY)


def check_overlay(subject, tmp_path, light):
    """Path-traced through the exported camera, a person covers the matte and looks as `relit` does."""
    path = subject.export(tmp_path / "person.usda")
    seen = exported.path_traced(path, light.direction, subject.size[0], samples=4)
    covered, matte = seen[..., 3] > 0.5, subject.matte > 0.5
    assert (covered & matte).sum() / (covered | matte).sum() > 0.98
    inside = covered & (subject.matte > 0.99)
    ours = subject.relit(light)
    correlation = np.corrcoef(seen[..., :3][inside].mean(axis=1), ours[..., :3][inside].mean(axis=1))[0, 1]
    assert correlation > 0.9


@pytest.mark.slow
def test_three_js_lights_the_side_that_the_light_is_on(subject, tmp_path):
    left, right = (relight.DirectionalLight(azimuth=side, elevation=10, name=name)
                   for side, name in ((-70, "left"), (70, "right")))  # fmt: skip
    path = subject.export(tmp_path / "asset.glb", [left, right], triangles=40_000)
    with exported.three_js(tmp_path, path, subject.size[0]) as draw:
        seen = {light.name: draw(light.name) for light in (left, right)}
    matte = subject.matte
    for light in (left, right):
        picture = seen[light.name]
        covered = picture[..., 3] > 0.5
        assert (covered & (matte > 0.5)).sum() / (covered | (matte > 0.5)).sum() > 0.98
        inside = covered & (matte > 0.99)
        ours = subject.relit(light)[..., :3].mean(axis=-1)[inside] ** (1 / 2.2)
        assert np.corrcoef(picture[..., :3].mean(axis=-1)[inside], ours)[0, 1] > 0.85
    middle = int(np.nonzero(matte > 0.5)[1].mean())
    brightness = {name: picture[..., :3].mean(axis=-1) for name, picture in seen.items()}
    assert brightness["left"][:, :middle].sum() > 1.2 * brightness["right"][:, :middle].sum()
    assert brightness["right"][:, middle:].sum() > 1.2 * brightness["left"][:, middle:].sum()
