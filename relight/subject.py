"""The analysed person: albedo, normals, visibility and shading, ready for any number of lights."""

import copy
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, Self

import numpy as np
import torch
import torch.nn.functional as F

from relight import keeping, steadying
from relight.canvas import Canvas
from relight.depth import Camera
from relight.floor import Floor, Stance
from relight.foreground import plate_of
from relight.inference import infer
from relight.keeping import Kept
from relight.lights.environment import FIELD_OF_VIEW
from relight.lights.light import Light, as_lights, by_name
from relight.upsampling import JointBilateral, as_seen
from shading.albedo import solve_lighting
from shadow import inputs
from shadow.directions import olat
from shadow.files import AnyPath
from shadow.framing import Extension, Framed
from shadow.networks.checkpoints import checksum

REACH = 0.08  # of the canvas, how far maps are continued beyond the matte: for hair and soft edges
AT_ONCE = 2  # lights whose maps are brought to the plate together: more are no faster and take more memory


class Subject:
    """A person in an image, analysed once; then each light costs a weighted sum and no network.

    The networks run when the subject is made, so that bad input fails there and relighting takes a
    predictable time. They see a canvas around the person; what they find is brought back to the plate's own
    pixels, guided by its colours, while texture comes from the plate itself.

    Parameters
    ----------
    image: (H, W, 3|4). Integers are sRGB-encoded with straight alpha; floats linear Rec.709, premultiplied.
    mask: (H, W) in [0, 1], or uint8 or uint16 over the full range: the matte of the person. Needed unless the
        image has alpha, which it replaces. Pixels that a mask covers in part, and the rim of a hard mask, are
        taken to show the background too, so their colour is continued from inside. Small parts far from the
        person, and faint coverage there, are kept in the alpha, but the networks do not see them (a warning
        says how many pixels).
    albedo: (H, W, 3) to use instead of inferring it; integers sRGB, floats linear in [0, 1].
    normals: (H, W, 3) camera-frame normals (x right, y up, z to the camera) to use instead of inferring them;
        or anything else that `shadow.normals.load` takes, such as a PIFuHD checkpoint.
    depth: (H, W) floats, metres along the camera's axis, larger farther away, to use instead of what the
        normals say; differences alone count. Or the path of an ONNX file, DAViD's depth or multi-task model,
        whose depth is scaled to that of the normals.
    height: metres of the person that the matte shows, 1.75 unless given; a warning says so where the frame
        cuts the person and metres are needed.
    field_of_view: of the photograph's camera, vertical, in degrees.
    camera: relight.depth.Camera of another frame, such as the first of a shot: positions are then in the same
        room, and `height` and `field_of_view` are not looked at.
    device: where the networks run, such as "cuda"; the CPU unless given. Relighting itself runs on the CPU.

    A Subject can be pickled and sent to another process. Spawn such processes: a process that is forked after
    torch has run on two threads or more hangs at its first network (Python's `multiprocessing` forks unless
    it is told otherwise, before Python 3.14 on Linux).

    Raises
    ------
    TypeError: a dtype that is not welcome. ValueError: wrong shapes, NaN or infinite values, values out of
    range, neither mask nor alpha, an empty mask, an unknown device.
    """

    def __init__(
        self,
        image: np.ndarray,
        mask: np.ndarray | None = None,
        albedo: np.ndarray | None = None,
        normals: np.ndarray | Callable | str | os.PathLike | None = None,
        *,
        depth: np.ndarray | str | os.PathLike | None = None,
        height: float | None = None,
        field_of_view: float = FIELD_OF_VIEW,
        camera: Camera | None = None,
        device: str | torch.device | None = None,
    ) -> None:
        self._arrange(infer(image, mask, albedo, normals, depth, height, field_of_view, camera, device))

    def save(self, path: AnyPath, *, made_of: Mapping[str, Any] | None = None) -> None:
        """Keep what was found in a file, .safetensors: `Subject.load` relights it without a network.

        The person's pixels are kept as half floats, the networks' maps in 8 bits: what is relit differs by
        about 0.001 RMS, of a steadied person by up to 0.0025. `made_of` is what else the file says of its
        making, as JSON holds it.

        Raises
        ------
        ValueError: another suffix. OSError: no such folder, or the file cannot be written.
        """
        kept = Kept(self._person, self._colour, self._given, self._exposure, self._framing, self._canvas)
        keeping.write(path, kept, {"weights": list(weights()), **(made_of or {})})

    @classmethod
    def load(cls, path: AnyPath) -> Self:
        """The person that `save`, or `relight analyse`, kept in a file. No network runs or is read.

        Raises
        ------
        FileNotFoundError: no such file. ValueError: it is damaged, or holds something else.

        Warns where other weights than this version's found what is in it.
        """
        kept, made_of = keeping.read(path)
        if made_of.get("weights") != list(weights()):
            warnings.warn(f"{path}: was analysed with other weights than this version's", stacklevel=2)
        subject = cls.__new__(cls)
        subject._arrange(kept)
        return subject

    def _arrange(self, kept: Kept) -> None:
        """Take what the networks found, and make the way from their canvas to the plate."""
        self._person, self._colour, self._given, self._exposure, self._framing, canvas = kept
        self._extend = Extension(canvas.known, REACH)
        guide = as_seen(self._colour * self._exposure)
        self._enlarge = JointBilateral(self._framing, guide, canvas.image, canvas.known, self._person.pixels)
        self._use(canvas)

    def _use(self, canvas: Canvas) -> None:
        """Take what the networks found from `canvas`."""
        self._canvas = canvas
        if canvas.light is None:
            assert self._given is not None
            self._albedo = self._given
        else:
            light = self._to_plate(canvas.light).clamp_min(1e-30)  # farther out than maps reach, it is zero
            self._albedo = (self._colour / light).clamp(0, 1)

    def steadied(self, around: Iterable["Subject"]) -> "Subject":
        """The same person with the trembling of the networks taken out, for sequences.

        `around` are the subjects of a few frames before and after, as they were made. Where these agree, the
        maps become their mean; where something moves, as a shadow does, each frame keeps its own. See
        `relight.steadying`. ValueError where the albedo was given to some of the subjects and not to others.
        """
        steady = copy.copy(self)
        for name in ("albedo", "normals", "depth", "_texture"):
            steady.__dict__.pop(name, None)
        steady._use(steadying.steadied(self._canvas, [subject._canvas for subject in around]))
        return steady

    def relit(self, lights: Light | Iterable[Light]) -> np.ndarray:
        """The person in new light.

        Parameters
        ----------
        lights: a light, or any number of them; none gives black.

        Returns
        -------
        (H, W, 4) float32, linear Rec.709, premultiplied, never clipped. Exactly linear: the colour of
        `relit(a + b)` is that of `relit(a)` plus that of `relit(b)`, and twice the intensity gives twice the
        colour, to float32 rounding. Alpha is the matte. ValueError where the lights are so bright that the
        picture is beyond float32.
        """
        return self.on_plate(self._in_light(self._lighting(lights)))

    def layers(self, lights: Light | Iterable[Light]) -> dict[str, np.ndarray]:
        """The person in each light alone: {name: (H, W, 4)}, lights without a name as `light1`, `light2`...

        Each is a complete premultiplied picture and carries the matte as its alpha. The colours of all layers
        sum to the colour of `relit(lights)`; the alpha, which is the same person's coverage, does not add up.
        ValueError if two lights have one name.
        """
        return {name: self.on_plate(pixels) for name, pixels in self.pixels_in_each(lights)}

    def pixels_in_each(self, lights: Light | Iterable[Light]) -> Iterator[tuple[str, torch.Tensor]]:
        """As `layers`, one after the other, and of each the person's pixels alone: (P, 4), for `on_plate`."""
        named = list(by_name(lights).items())
        for several in (named[start : start + AT_ONCE] for start in range(0, len(named), AT_ONCE)):
            enlarged = self._to_plate(torch.cat([self._canvas.lit([light]) for _, light in several]))
            for (name, _), lighting in zip(several, enlarged.split(3, dim=1), strict=True):
                yield name, self._in_light(lighting)

    def on_plate(self, pixels: torch.Tensor) -> np.ndarray:
        """The person's pixels (P, C) in the plate's frame: (H, W, C) float32, zero outside the matte."""
        return self._person.scatter(pixels)

    def lighting(self, lights: Light | Iterable[Light]) -> np.ndarray:
        """What the lights would do to a white person: (H, W, 3) float32, linear, zero outside the matte.

        The colour of `relit(lights)` is `albedo × lighting(lights) × alpha`: with the albedo, what a
        compositor needs to grade light and colour apart. Raises as `relit` does.
        """
        return self._person.scatter(_representable(self._lighting(lights)))

    def view(
        self,
        path: str | os.PathLike | None = None,
        lights: Light | Iterable[Light] | None = None,
        *,
        background: Any = None,
        title: str = "relight",
        command: Sequence[str] | None = None,
    ) -> Any:
        """The person with the light in one's hand: a page in one HTML file, or a widget in a notebook.

        Parameters
        ----------
        path: the file to write, .html; None for a widget (extra `notebook`), see `relight.viewer.widget`.
        lights: what it begins with: up to eight `DirectionalLight` and `PointLight`, and one
            `EnvironmentLight`; a soft key light unless given.
        background: as of `relight.over`; None for none.
        title: of the page. command: the words that relight the photograph on the command line, without its
            lights, for the page to complete.

        Returns
        -------
        The path written, or the widget. The page needs no server and no network.

        Raises
        ------
        TypeError, ValueError: lights or a background that the page cannot show, a path of another suffix, a
        steadied subject. OSError: the file cannot be written. ModuleNotFoundError: no anywidget.
        """
        from relight.viewer.showing import show

        return show(self, path, lights, background, title, command)

    def fitted(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The lighting in which the person looks most like `image`, see `relight.fit_lights`.

        Returns directions (96, 3), `shadow.directions.olat(behind=True)`, and their intensities (96, 3) >= 0.
        """
        pixels = plate_of(image)
        if pixels.shape[:2] != (size := self._person.size):
            raise ValueError(f"image: expected the subject's size {size}, got {pixels.shape[:2]}")
        colour = self._person.own_colour(pixels, photographed=pixels.shape[-1] == 3)
        framed = Framed.of(colour, self._person.matte, self._framing.canvas[0])
        directions = torch.from_numpy(olat(behind=True))
        shading, canvas = self._canvas.shading(directions), self._canvas
        powers = solve_lighting(framed.rgb, canvas.albedo, shading, canvas.known.float())
        return directions.numpy(), powers.numpy()

    def unshadowed(self, light: Light) -> np.ndarray:
        """The share of a light that no part of the person blocks: (H, W) float32 in [0, 1], zero outside.

        Of a hard light its visibility; of a soft one or an environment the mean over its directions, weighted
        by their luminance; of a light in the room, by how much of it would come from each.
        """
        return self._person.scatter(self._to_plate(self._canvas.unshadowed(light)))[..., 0]

    def shadows(
        self, lights: Light | Iterable[Light], floor: Floor
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """The shadow of each light on the floor, {name: (H, W, 3)}, and that of all of them, (H, W, 3).

        float32 in [0, 1], by which the background is multiplied: the share of the floor's light that the
        person leaves to it, 1 where that is all, and above the horizon. The shadow of all lights is the mean
        of theirs, weighted by the irradiance of the floor. ValueError where the person cannot stand there.
        """
        cut = bool(self.matte[-1].max() > 0.5)
        space, known = self._canvas.space, self._canvas.known
        return Stance.of(floor, space.camera, space.positions, known, cut).shadows(by_name(lights))

    @property
    def size(self) -> tuple[int, int]:
        """(H, W) of the plate, in pixels."""
        return self._person.size

    @cached_property
    def matte(self) -> np.ndarray:
        """(H, W) float32 in [0, 1]: the person's coverage, the alpha of what is relit."""
        return self._person.scatter(self._person.coverage[:, None])[..., 0]

    @cached_property
    def albedo(self) -> np.ndarray:
        """(H, W, 3) float32 linear Rec.709 in [0, 1]: the plate's texture without its light; zero outside."""
        return self._person.scatter(self._albedo)

    @cached_property
    def normals(self) -> np.ndarray:
        """(H, W, 3) float32 unit vectors in the camera frame, at the networks' detail; zero outside."""
        return self._person.scatter(F.normalize(self._to_plate(self._canvas.normals), dim=1))

    @cached_property
    def depth(self) -> np.ndarray:
        """(H, W) float32 metres along the camera's axis, positive away from the camera, relative to the
        subject's middle; zero outside the matte."""
        return self._person.scatter(self._to_plate(self._canvas.space.depth[None]))[..., 0]

    @property
    def camera(self) -> Camera:
        """The plate's camera, which takes pixels and depth to positions in the room."""
        return self._canvas.space.camera

    @property
    def distance(self) -> float:
        """Metres from the camera to the subject's middle, along the camera's axis."""
        return self.camera.distance

    def visibility(self, directions: np.ndarray) -> np.ndarray:
        """Self-shadow maps (D, H, W) float32 in [0, 1]: 1 = lit, zero outside the matte.

        `directions` (D, 3) point toward the lights. Raises TypeError or ValueError for a wrong shape or
        dtype, NaN or infinite values, or a direction of zero length.
        """
        maps = self._canvas.visibility(inputs.directions("directions", directions))
        return np.ascontiguousarray(self._person.scatter(self._to_plate(maps)).transpose(2, 0, 1))

    def shading(self, directions: np.ndarray) -> np.ndarray:
        """Diffuse shading (D, H, W) float32 in [0, 1] by one unit light at a time, zero outside the matte.

        `directions` (D, 3) point toward the lights. Linear; 1 is a surface that faces an unoccluded light.
        Raises as `visibility` does.
        """
        maps = self._canvas.shading(inputs.directions("directions", directions))
        return np.ascontiguousarray(self._person.scatter(self._to_plate(maps)).transpose(2, 0, 1))

    @cached_property
    def _texture(self) -> torch.Tensor:
        """The albedo of the subject's pixels, premultiplied (P, 3)."""
        return self._albedo * self._person.coverage[:, None]

    def _in_light(self, lighting: torch.Tensor) -> torch.Tensor:
        """The picture (P, 4) of the subject's pixels, of the lighting (P, 3) that falls on them."""
        picture = torch.empty(len(lighting), 4)
        torch.mul(lighting, self._texture, out=picture[:, :3])
        picture[:, 3] = self._person.coverage
        return _representable(picture)

    def _lighting(self, lights: Light | Iterable[Light]) -> torch.Tensor:
        """Σ intensity · shading of the subject's pixels (P, 3)."""
        return self._to_plate(self._canvas.lit(as_lights(lights)))

    def _to_plate(self, maps: torch.Tensor) -> torch.Tensor:
        """Canvas maps (C, h, w) to the subject's pixels on the plate (P, C)."""
        return self._enlarge(self._extend(maps))


def weights() -> tuple[str, str]:
    """The checksums of the weights that persons are analysed with."""
    return checksum("field", "shadow"), checksum("shading", "shading")


def _representable(colour: torch.Tensor) -> torch.Tensor:
    """The colour as it is; ValueError if any of it is beyond float32."""
    if not torch.isfinite(torch.stack(colour.aminmax())).all():  # which pass NaN on
        raise ValueError("lights: are too bright, the picture would be infinite; expected less intensity")
    return colour
