"""Lights files of every kind: YAML and JSON, USD stages, glTF."""

from collections.abc import Iterable
from pathlib import Path

from relight import quantities
from relight.arguments import checks_arguments
from relight.lights import files
from relight.lights.light import Light
from relight.lights.moving import MovingLight
from relight.lights.rig import as_rig
from relight.scene.gltf import lights as gltf_writing
from relight.scene.gltf import read as gltf_lights
from relight.scene.usd import read, stage
from relight.scene.usd.read import Rig
from shadow.files import AnyPath

SUFFIXES = (*files.SUFFIXES, *stage.SUFFIXES, *gltf_lights.SUFFIXES)


@checks_arguments
def read_lights(
    path: quantities.File,
    *,
    camera: str | None = None,
    subject_at: str | Iterable[float] | None = None,
    allow_external: bool = False,
) -> list[Light | MovingLight]:
    """Read the lights of a lights file, a USD stage or a glTF scene.

    Parameters
    ----------
    path
        .yaml, .yml or .json, a lights file; .usda, .usdc, .usdz or .usd, a stage with UsdLux lights; .gltf or
        .glb, a scene with `KHR_lights_punctual`.
    camera
        The camera of the plate: the path of its prim, or the name of its node; by default the only camera. If
        there is none, the scene's axes are those of the camera, and its origin is the subject's middle.
    subject_at
        Position of the subject's middle in the scene: the path of a prim, the name of a node, or (x, y, z) in
        the scene's units. By default on the camera's axis at its focus distance, which only USD has.
    allow_external
        Whether a stage may include files from outside its own folder.

    Returns
    -------
    list[Light | MovingLight]
        The lights in the file's order, in the camera's frame. Time samples become moving lights.

    Raises
    ------
    FileNotFoundError
        No such file, or a texture or layer that it names is missing.
    ValueError
        Another kind of file, no lights, unknown cameras or prims, values that a light refuses. The message
        names the file and the light.
    TypeError
        `camera` or `subject_at` with a file that has no cameras.

    Warns
    -----
    UserWarning
        Features that our lights cannot represent, with the paths of their prims.

    Examples
    --------
    >>> import relight
    >>> relight.write_lights("rig.json", [relight.DirectionalLight(azimuth=-40, name="key")])
    >>> [light.name for light in relight.read_lights("rig.json")]
    ['key']
    """
    return read_rig(path, camera=camera, subject_at=subject_at, allow_external=allow_external).lights


def read_rig(
    path: AnyPath,
    *,
    camera: str | None = None,
    subject_at: str | Iterable[float] | None = None,
    allow_external: bool = False,
) -> Rig:
    """Read the lights as `read_lights` does, and what the scene says of its camera."""
    suffix = Path(path).suffix.lower()
    if suffix in stage.SUFFIXES:
        return read.read_rig(path, camera, subject_at, allow_external=allow_external)
    if suffix in gltf_lights.SUFFIXES:
        return gltf_lights.read_rig(path, camera, subject_at)
    if suffix in files.SUFFIXES and (camera is not None or subject_at is not None):
        raise TypeError(f"{path}: a lights file has no cameras; camera and subject_at are for USD and glTF")
    if suffix not in files.SUFFIXES:
        raise ValueError(f"{path}: expected a lights file, whose name ends in {', '.join(SUFFIXES)}")
    return Rig(files.read_lights(path))


@checks_arguments
def write_lights(path: quantities.File, lights: Iterable[Light | MovingLight]) -> None:
    """Write lights to a file, from which `read_lights` reads the same lights. It is complete or absent.

    Parameters
    ----------
    path
        .yaml, .yml or .json; .usda, .usdc or .usdz; .gltf or .glb. Its folder must exist.
    lights
        Any number of lights. A lights file stores directions as azimuth and elevation, rounded to 1e-4
        degrees, and the path of an environment's image. A stage has the axes of the camera, and its origin is
        the subject's middle; an environment without a file is written beside it. glTF has only directional
        and point lights, and a warning names what it cannot hold.

    Raises
    ------
    ValueError
        Another suffix, an environment that is an array in a lights file, lights that glTF cannot hold.
    TypeError
        Not lights.
    OSError
        The file cannot be written.

    Examples
    --------
    >>> relight.write_lights("mine.yaml", [relight.DirectionalLight(azimuth=-40, name="key")])
    """
    write_rig(Path(path), as_rig(lights))


def write_rig(path: Path, lights: list[Light | MovingLight]) -> None:
    """Write lights, all of them checked, as `write_lights` does."""
    suffix = path.suffix.lower()
    if suffix in stage.SUFFIXES:
        from relight.scene.usd import write as usd

        usd.write_lights(path, lights)
    elif suffix in gltf_lights.SUFFIXES:
        gltf_writing.write_lights(path, lights)
    elif suffix in files.SUFFIXES:
        files.write_lights(path, lights)
    else:
        raise ValueError(f"{path}: expected a lights file, whose name ends in {', '.join(SUFFIXES)}")
