"""USD stages: a person with camera and lights, or lights alone."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from relight.lights.light import Light
from relight.lights.moving import MovingLight
from relight.scene.asset import ROUGHNESS, Asset, companion
from relight.scene.mesh import CUTOFF
from relight.scene.usd.lights import Place, add_lights
from relight.scene.usd.stage import SUFFIXES, first_line, usd
from shadow.files import AnyPath, check_writable, replacing

if TYPE_CHECKING:
    from pxr import Usd, UsdShade

APERTURE = 0.36  # of the camera that is written, horizontal: 36 mm in tenths of the stage's metre


def write(path: Path, asset: Asset) -> None:
    """Write a person: /World/Person, /World/Camera and /World/Lights, the feet on the ground at y = 0."""
    with _stage(path) as writing:
        stage, root = writing.stage, writing.root
        _lift(root, -asset.ground)
        texture = writing.beside(companion(path, _word(asset)).name, asset.texture)
        _person(stage, asset, texture, "/World/Person")
        _camera(stage, asset)
        _lights(writing, asset)
        _span(stage)


@contextmanager
def sequence(path: Path, rate: float) -> Iterator[Callable[[int, Asset], None]]:
    """Write a person who moves: a mesh with a texture of its own for each frame, shown at that frame alone.

    Yields what adds a frame, from its number and its asset. The frames have one camera, and the ground is
    that of the first.
    """
    with _stage(path) as writing:
        stage = writing.stage
        prims: dict[int, Usd.Prim] = {}
        first: list[Asset] = []

        def add(number: int, asset: Asset) -> None:
            if not first:
                first.append(asset)
                _lift(writing.root, -asset.ground)
                _camera(stage, asset)
            word = f"frame_{number:04d}" if number >= 0 else f"frame_minus_{-number:04d}"
            name = companion(path, _word(asset), f"{number:04d}").name
            texture = writing.beside(name, asset.texture)
            prims[number] = _person(stage, asset, texture, f"/World/Person/{word}")

        yield add
        _show_in_turn(prims)
        if first:
            _lights(writing, first[0], (min(prims), max(prims)))
        _span(stage)
        stage.SetTimeCodesPerSecond(rate)
        stage.SetFramesPerSecond(rate)


def _show_in_turn(prims: dict[int, Usd.Prim]) -> None:
    """Make each prim visible at its own frame alone."""
    numbers = sorted(prims)
    for number, prim in prims.items():
        visibility = prim.CreateVisibilityAttr()
        for time in (numbers[0], number + 1):
            if time != number and time <= numbers[-1]:
                visibility.Set("invisible", time)
        visibility.Set("inherited", number)


def _lights(writing: _Writing, asset: Asset, frames: tuple[int, int] | None = None) -> None:
    """Add the lights of an asset, if it has any; `frames` are the first and the last of a sequence."""
    if asset.lights:
        from pxr import UsdGeom

        UsdGeom.Scope.Define(writing.stage, "/World/Lights")
        add_lights(writing.stage, "/World/Lights", asset.lights, writing.place, frames)


def write_lights(path: AnyPath, lights: Iterable[Light | MovingLight]) -> None:
    """Write lights alone: the stage's axes are the camera's, its origin is the subject's middle."""
    path = check_writable(path, SUFFIXES)
    with _stage(path) as writing:
        add_lights(writing.stage, "/World", lights, writing.place)
        _span(writing.stage)


class _Writing(NamedTuple):
    """A stage that is being written."""

    stage: Usd.Stage
    root: Usd.Prim  # the prim /World
    place: Place

    def beside(self, name: str, content: bytes) -> str:
        """Put a file beside the stage; what the stage calls it."""
        (self.place.folder / name).write_bytes(content)
        return f"./{name}"


@contextmanager
def _stage(target: Path) -> Iterator[_Writing]:
    """Make a stage in a folder of its own, and deliver it when it is whole, after the files beside it."""
    usd()
    from pxr import Kind, Sdf, Usd, UsdGeom, UsdUtils

    packed = target.suffix.lower() == ".usdz"
    with (
        tempfile.TemporaryDirectory(prefix="relight-", ignore_cleanup_errors=True) as temporary,
        _named_errors(target, temporary),
    ):
        folder = Path(temporary)
        path = folder / f"{target.stem}{'.usdc' if packed else target.suffix}"
        stage: Usd.Stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        root = UsdGeom.Xform.Define(stage, "/World")
        Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
        stage.SetDefaultPrim(root.GetPrim())
        yield _Writing(stage, root, Place(target, folder))
        stage.GetRootLayer().Save()
        whole = path
        if packed:
            whole = folder / "package.usdz"
            if not UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(path)), str(whole)):
                raise OSError(f"{target}: cannot be packed")
        else:
            for file in folder.iterdir():
                if file != path:
                    _replace(target.with_name(file.name), file)
        _replace(target, whole)


@contextmanager
def _named_errors(target: Path, folder: str) -> Iterator[None]:
    """Raise USD's own errors, as a full disk's, as an OSError of the file that is written."""
    from pxr import Tf

    try:
        yield
    except Tf.ErrorException as error:
        raise OSError(
            f"{target}: cannot be written: {first_line(error)}; there may be too little room in "
            f"{Path(folder).parent}: the environment variable TMPDIR names another folder"
        ) from error


def _replace(target: Path, file: Path) -> None:
    with replacing(target) as written, file.open("rb") as source, written.open("wb") as copy:
        shutil.copyfileobj(source, copy)


def _word(asset: Asset) -> str:
    return "photograph" if asset.unlit else "albedo"


def _lift(root: Usd.Prim, metres: float) -> None:
    from pxr import Gf

    root.AddTranslateOp().Set(Gf.Vec3d(0, metres, 0))


def _span(stage: Usd.Stage) -> None:
    """Set the first and the last frame of the stage, if anything in it moves."""
    times = {
        time
        for prim in stage.Traverse()
        for attribute in prim.GetAttributes()
        for time in attribute.GetTimeSamples()
    }
    if times:
        stage.SetStartTimeCode(min(times))
        stage.SetEndTimeCode(max(times))


def _person(stage: Usd.Stage, asset: Asset, texture: str, path: str) -> Usd.Prim:
    """Add a person below a path; the prim there."""
    from pxr import Gf, Sdf, UsdGeom, UsdShade, Vt

    UsdGeom.Xform.Define(stage, "/World/Person")
    person = UsdGeom.Xform.Define(stage, path)
    mesh = UsdGeom.Mesh.Define(stage, f"{path}/Mesh")
    points, faces = asset.mesh.points, asset.mesh.faces
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(faces.ravel())))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(asset.mesh.normals))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    low, high = points.min(axis=0), points.max(axis=0)
    mesh.CreateExtentAttr([Gf.Vec3f(*map(float, low)), Gf.Vec3f(*map(float, high))])
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex
    )
    st.Set(Vt.Vec2fArray.FromNumpy(asset.mesh.uv))
    material = _material(stage, f"{path}/Material", texture, asset.unlit, asset.gloss)
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    return person


def _material(stage: Usd.Stage, path: str, texture: str, unlit: bool, gloss: float) -> UsdShade.Material:
    """Return a matte or an emissive surface in the colour of the texture, cut out by the texture's alpha.

    UsdPreviewSurface has no strength of what it reflects at grazing angles: gloss is there whole, or spread
    over all directions.
    """
    from pxr import Sdf, UsdShade

    material = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, f"{path}/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    types = Sdf.ValueTypeNames
    surface.CreateInput("roughness", types.Float).Set(ROUGHNESS if gloss else 1.0)
    surface.CreateInput("metallic", types.Float).Set(0.0)
    surface.CreateInput("specularColor", types.Color3f).Set((0, 0, 0))
    surface.CreateInput("useSpecularWorkflow", types.Int).Set(1)
    surface.CreateInput("opacityThreshold", types.Float).Set(CUTOFF)
    reader = UsdShade.Shader.Define(stage, f"{path}/Coordinates")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", types.String).Set("st")
    image = UsdShade.Shader.Define(stage, f"{path}/Texture")
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", types.Asset).Set(Sdf.AssetPath(texture))
    image.CreateInput("sourceColorSpace", types.Token).Set("sRGB")
    image.CreateInput("wrapS", types.Token).Set("clamp")
    image.CreateInput("wrapT", types.Token).Set("clamp")
    image.CreateInput("st", types.Float2).ConnectToSource(reader.CreateOutput("result", types.Float2))
    rgb, alpha = image.CreateOutput("rgb", types.Float3), image.CreateOutput("a", types.Float)
    surface.CreateInput("emissiveColor" if unlit else "diffuseColor", types.Color3f).ConnectToSource(rgb)
    if unlit:
        surface.CreateInput("diffuseColor", types.Color3f).Set((0, 0, 0))
    surface.CreateInput("opacity", types.Float).ConnectToSource(alpha)
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", types.Token))
    return material


def _camera(stage: Usd.Stage, asset: Asset) -> None:
    """Add the plate's camera, level and looking along -z."""
    from pxr import Gf, UsdGeom

    height, width = asset.camera.size
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateHorizontalApertureAttr(APERTURE)
    camera.CreateVerticalApertureAttr(APERTURE * height / width)
    camera.CreateFocalLengthAttr(APERTURE * asset.camera.focal / width)
    camera.CreateFocusDistanceAttr(asset.camera.distance)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01, 10000))
    camera.AddTranslateOp().Set(Gf.Vec3d(*asset.eye.tolist()))
