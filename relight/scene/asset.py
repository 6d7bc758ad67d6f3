"""The person as other programs take them: a mesh, its texture, the plate's camera and the lights."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from relight.analysis.camera import Camera
from relight.analysis.gloss import checked_gloss
from relight.lights.light import Light
from relight.lights.moving import MovingLight
from relight.lights.rig import as_rig
from relight.media.colour import encode
from relight.media.images.encode import compressed
from relight.media.resampling import fill_unknown
from relight.scene import mesh
from relight.scene.mesh import Mesh, PersonSurface
from relight.scene.nuke.light_groups import is_script
from relight.scene.person import Person
from shadow import files
from shadow.files import AnyPath

SUFFIXES = (".glb", ".usda", ".usdc", ".usdz", ".nk")
TEXTURES = ("albedo", "photograph")
# Of a glossy surface: glTF and UsdPreviewSurface have microfacets. With F0 = 0 and F90 = 1, those of this
# roughness are nearest to `relight.analysis.gloss`.
ROUGHNESS = 0.7


class Asset(NamedTuple):
    """What is written."""

    mesh: Mesh
    texture: bytes  # a PNG file, sRGB with straight alpha, over the mesh's box
    unlit: bool  # the texture is the photograph in its own light
    camera: Camera
    lights: list[Light | MovingLight]
    gloss: float = 0.0  # strength of what `relight.analysis.gloss` adds, in [0, 1]

    @property
    def eye(self) -> np.ndarray:
        """(3,) metres: where the camera is, from the subject's middle."""
        return np.array(self.camera.eye)

    @property
    def ground(self) -> float:
        """Metres from the subject's middle up to the ground, which is below: negative."""
        return self.mesh.lowest


def checked(path: AnyPath, texture: str, triangles: int) -> Path:
    """Return the file to write; raise ValueError or OSError if it cannot be written, or for bad arguments."""
    mesh.check_triangles(triangles)
    if texture not in TEXTURES:
        raise ValueError(f"texture: expected {' or '.join(TEXTURES)}, got {texture!r}")
    file = files.check_writable(path, SUFFIXES)
    if is_script(file) and (triangles, texture) != (mesh.TRIANGLES, TEXTURES[0]):
        raise ValueError(f"{file}: holds no mesh; leave out triangles and texture")
    return file


def companion(path: Path, content: str, frame: str | None = None) -> Path:
    """Return the file beside an asset or a script for its `content`, one of TEXTURES or "layers".

    `frame`: the number of a frame, or the pattern of all, such as `%04d`; None for a still.
    """
    number = "" if frame is None else f".{frame}"
    return path.with_name(f"{path.stem}_{content}{number}{'.exr' if is_script(path) else '.png'}")


def of_subject(
    subject: Person,
    lights: Iterable[Light | MovingLight] | Light | MovingLight | None,
    triangles: int,
    texture: str,
    gloss: float,
) -> Asset:
    """Make the asset of a `relight.Subject`; the arguments are those of its `export`."""
    surface = PersonSurface.of(subject.record, subject.matte)
    several = [] if lights is None else as_rig(lights)
    gloss = checked_gloss(gloss)
    unlit = texture == "photograph"
    colour = subject.on_plate(subject.record.colour) if unlit else subject.albedo
    built = mesh.build(surface, triangles)
    return Asset(built, painted(colour, surface.matte, built.box), unlit, surface.camera, several, gloss)


def painted(colour: np.ndarray, matte: np.ndarray, box: tuple[int, int, int, int]) -> bytes:
    """Encode the person's colour as a PNG: sRGB with straight alpha, continued beyond the matte.

    Renderers that blend neighbouring pixels then find no black at the person's outline.
    """
    top, left, bottom, right = box
    alpha = np.ascontiguousarray(matte[top:bottom, left:right], np.float32)
    inside = colour[top:bottom, left:right]
    linear = fill_unknown(inside, alpha > 0).clip(0, 1)
    pixels = np.concatenate([encode(linear, white=1), alpha[..., None]], axis=-1)
    return compressed(pixels, "PNG", compress_level=6)
