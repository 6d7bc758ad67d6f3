"""The analysed person: albedo, normals, depth, visibility and shading, ready for any number of lights."""

import copy
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import torch
import torch.nn.functional as F

from relight import quantities
from relight.analysis import joints, storage, temporal
from relight.analysis.camera import Camera
from relight.analysis.exposure import gain_to_keep
from relight.analysis.infer import check_inputs, infer
from relight.analysis.light_grid import LightGrid
from relight.analysis.maps import AnalysisMaps, bounded
from relight.analysis.old_light import OldLight
from relight.analysis.record import AnalysisRecord
from relight.analysis.upsampling import EXTENSION_SHARE, JointBilateral, encode_guide
from relight.arguments import checks_arguments
from relight.compositing.clean_plate import checked_plate, clean_plate
from relight.compositing.composite import Background
from relight.compositing.floor import Floor, GivenFloor
from relight.compositing.floor_shadow import FloorShadow
from relight.errors import EmptyMatteError
from relight.lights import presets
from relight.lights.environment import FIELD_OF_VIEW
from relight.lights.light import Light
from relight.lights.moving import MovingLight
from relight.lights.near import NearLight
from relight.lights.rig import Lights, as_lights, by_name, scaled
from shadow import inputs
from shadow.framing import Extension
from shadow.networks.checkpoints import checksum
from shadow.torch_settings import isolated_class

if TYPE_CHECKING:
    from relight.scene.asset import Asset

PHOTOGRAPH = "photograph"  # name of the layer of the photograph's own light
LIGHTS_PER_BATCH = 2  # whose maps are upsampled together: more are no faster and take more memory


@isolated_class
class Subject:
    """A person in an image, analysed once. Each light then costs a weighted sum and no network.

    The networks run when the subject is made, so bad input fails there, and relighting takes a predictable
    time. They see a canvas around the person. Their maps are upsampled to the plate, guided by its colours;
    texture comes from the plate itself.

    A Subject can be pickled, with the size and the precision of what `save` writes, and sent to another
    process. Spawn such processes: a process that is forked after
    torch has run on two threads or more hangs at its first network (Python's `multiprocessing` forks by
    default before Python 3.14 on Linux).

    Parameters
    ----------
    image
        (H, W, 3|4). Integers are sRGB-encoded with straight alpha; floats linear Rec.709, premultiplied.
    mask
        (H, W) in [0, 1], or uint8 or uint16 over the full range: the matte of the person, in place of the
        image's alpha. Without either the person is found, see `matte`. Pixels with partial coverage, and the
        rim of a hard mask, are assumed to show the background too, so their colour is extrapolated from
        inside. Small parts far from the person, and faint coverage there, stay in the alpha, but the networks
        do not see them (a warning gives the number of pixels).
    albedo
        (H, W, 3), replaces the inferred albedo; integers are sRGB, floats linear in [0, 1].
    normals
        (H, W, 3) camera-frame normals (x right, y up, z to the camera) that replace the inferred ones, or
        anything else that `shadow.normals.load` accepts, such as a PIFuHD checkpoint.
    depth
        (H, W) floats that replace the depth integrated from the normals: metres along the camera's axis,
        larger farther away. Its offset has no effect, and values outside the matte are ignored. Or a picture
        of relative depth, uint8 or uint16, near white or near black, whose scale is fitted to the depth of
        the normals. Or the path of an ONNX file, DAViD's depth or multi-task model, which is scaled in the
        same way.
    height
        Height in metres of the part of the person that the matte shows, in [0.01, 100]; 1.75 by default. If
        the frame cuts the person and metres are needed, a warning asks for it.
    field_of_view
        Vertical field of view of the photograph's camera in degrees, in [0.001, 170].
    camera
        relight.analysis.camera.Camera of another frame, such as the first of a shot. Positions are then in
        the same world space, and `height` and `field_of_view` have no effect.
    old_light
        relight.analysis.old_light.OldLight of another frame, such as the first of a shot: the colour of the
        photograph's light, which the inferred albedo lacks. It is fitted to this image by default.
    feather
        Standard deviation, in pixels, of the Gaussian that softens the matte's edge in pictures, up to 5 %
        of the image's longer side. The analysis, and the person's colour at the edge, have the matte as it
        is, so the edge shows no line of the old background. 0 by default.
    device
        Device of the networks, such as "cuda"; the CPU by default. Relighting itself runs on the CPU.
    matte
        How the person is found in an image that has neither alpha nor a mask: "auto", by networks that
        `relight fetch person` brings, or another model of `relight.matte`, which also chooses between several
        people. None refuses such an image.

    Raises
    ------
    TypeError
        A dtype that is not accepted; a matting model that is an array.
    ValueError
        Wrong shapes, NaN or infinite values, values out of range, an unknown device; neither mask
        nor alpha, with `matte=None`.
    relight.errors.EmptyMatteError
        The matte shows no person, or none was found.
    relight.errors.MissingNetworksError
        The networks that find a person have not been fetched.

    Examples
    --------
    >>> import numpy as np, relight
    >>> photo = np.zeros((64, 48, 4), np.float32)
    >>> photo[8:56, 12:36] = 0.3, 0.3, 0.3, 1
    >>> subject = relight.Subject(photo)
    >>> picture = subject.relit([relight.DirectionalLight(azimuth=-40, elevation=30)])
    >>> picture.shape, picture.dtype.name
    ((64, 48, 4), 'float32')
    """

    @checks_arguments
    def __init__(
        self,
        image: inputs.Array,
        mask: inputs.Array | None = None,
        albedo: inputs.Array | None = None,
        normals: np.ndarray | Callable | str | os.PathLike | None = None,
        *,
        depth: np.ndarray | str | os.PathLike | None = None,
        height: quantities.Height | None = None,
        field_of_view: quantities.FieldOfView = FIELD_OF_VIEW,
        camera: Camera | None = None,
        old_light: OldLight | None = None,
        feather: float = 0.0,
        device: str | torch.device | None = None,
        matte: quantities.Model | None = "auto",
    ) -> None:
        given = check_inputs(
            image,
            mask,
            albedo,
            normals,
            depth,
            height,
            field_of_view,
            camera,
            device,
            matte,
            old_light,
            feather,
        )
        self._set_record(infer(given))

    @classmethod
    def from_record(cls, record: AnalysisRecord) -> Self:
        """Make a subject of an analysis, see `relight.analysis.infer`."""
        subject = cls.__new__(cls)
        subject._set_record(record)
        return subject

    @classmethod
    def nobody(cls, size: tuple[int, int]) -> Self:
        """Make the subject of a picture of `size` (H, W) that shows no person, such as a frame of a shot.

        Its maps and pictures are zero, and it casts no shadow. `is_empty` tells it from others.

        >>> import relight
        >>> subject = relight.Subject.nobody((64, 48))
        >>> float(subject.relit(relight.DirectionalLight(azimuth=-40)).max())
        0.0
        """
        return cls.from_record(AnalysisRecord.of_nobody(size))

    @classmethod
    @checks_arguments
    def load(cls, path: quantities.File, *, may_be_empty: bool = False) -> Self:
        """Load a person that `save`, or `relight analyse`, wrote. No network runs or is read.

        Parameters
        ----------
        path
            The file.
        may_be_empty
            Whether a frame that shows no person is loaded too, see `nobody`; refused otherwise.

        Raises
        ------
        FileNotFoundError
            No such file.
        relight.errors.DamagedFileError
            The file is damaged, or no analysis.
        relight.errors.StaleAnalysisError
            The file is of another version of the format.
        relight.errors.EmptyMatteError
            The frame shows no person.

        Warns
        -----
        UserWarning
            Other weights than this version's made the analysis.
        """
        record, provenance = storage.read_record(path)
        if record.is_empty and not may_be_empty:
            raise EmptyMatteError(f"{path}: the frame shows no person")
        if provenance.get("weights") != list(weights()):
            warnings.warn(f"{path}: was analysed with other weights than this version's", stacklevel=2)
        return cls.from_record(record)

    @checks_arguments
    def save(self, path: quantities.File, *, provenance: quantities.Entries | None = None) -> None:
        """Save the analysis to a file, which `Subject.load` relights without a network.

        The person's pixels are stored as half floats, the networks' maps in 8 bits. A relit picture differs
        by about 0.001 RMS.

        Parameters
        ----------
        path
            The file, .safetensors.
        provenance
            Further information about the origin of the analysis, in types of JSON.

        Raises
        ------
        ValueError
            Another suffix.
        OSError
            No such folder, or the file cannot be written.
        """
        storage.write_record(path, self._record, {"weights": list(weights()), **(provenance or {})})

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle what `save` writes: a few megabytes, with the precision of that file."""
        packed = storage.pack_record(self._record, {"weights": list(weights())})
        return unpickled, (type(self), packed)

    def __copy__(self) -> Self:
        """Return a subject of the same arrays, which are never changed."""
        other = type(self).__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return copy.copy(self)

    def __repr__(self) -> str:
        """Say the size, the coverage and the networks."""
        height, width = self.size
        names = ", ".join(name[:8] for name in weights())
        return (
            f"<Subject of {width} x {height} pixels, {100 * float(self.matte.mean()):.3g} % covered, "
            f"weights {names}>"
        )

    def _set_record(self, record: AnalysisRecord) -> None:
        """Take an analysis, and prepare the upsampling from the canvas to the plate."""
        self._record = record
        maps, person = record.maps, record.foreground
        self._extend = Extension(maps.known, EXTENSION_SHARE)
        guide = encode_guide(record.colour * record.exposure)
        self._upsample = JointBilateral(record.framing, guide, maps.image, maps.known, person.pixels)
        self._set_maps(maps)

    def _set_maps(self, maps: AnalysisMaps) -> None:
        """Take the maps of an analysis, and the albedo that follows from them."""
        self._record = self._record._replace(maps=maps)
        if maps.light is None:
            assert self._record.provided_albedo is not None
            self._albedo = self._record.provided_albedo
        else:
            light = self._to_plate(maps.light).clamp_min(1e-30)  # zero beyond the reach of the extension
            self._albedo = bounded(self._record.colour / light, dim=1)

    def temporally_filtered(self, neighbours: Iterable["Subject"]) -> "Subject":
        """Return the same person without the flicker of the networks' errors, for sequences.

        The maps of neighbouring frames are moved along the optical flow. Where they agree, the maps become
        their mean. Where the light changes, as under a moving shadow, each frame keeps its own. See
        `relight.analysis.temporal`.

        Parameters
        ----------
        neighbours
            The subjects of a few frames before and after, not filtered themselves.

        Raises
        ------
        ImportError
            OpenCV is missing (extra `video`).
        ValueError
            The albedo was provided for some of the subjects and inferred for others.
        """
        if self.is_empty:  # neighbours bring nobody into the frame
            return self
        filtered = copy.copy(self)
        for name in ("albedo", "normals", "depth", "position", "_texture"):  # computed from other maps
            filtered.__dict__.pop(name, None)
        maps = [subject._record.maps for subject in neighbours]
        filtered._set_maps(temporal.temporally_filtered(self._record.maps, maps))
        return filtered

    @checks_arguments
    def relit(
        self, lights: Lights, gloss: quantities.Gloss = 0.0, amount: quantities.Amount = 1.0
    ) -> np.ndarray:
        """Relight the person.

        Parameters
        ----------
        lights
            A light, or any number of them; none gives black. Or the name of a preset, see `preset`.
        gloss
            Strength, in [0, 1], of a reflection at grazing angles. It gives hair, shoulders and arms a rim in
            light from behind, and leaves light from the front as it is. 0 is diffuse shading alone, as in the
            paper.
        amount
            Share of these lights, in [0, 1]: the rest is the light in which the person was photographed. 0 is
            the photograph, 1 is these lights alone.

        Returns
        -------
        np.ndarray
            (H, W, 4) float32, linear Rec.709, premultiplied, never clipped; alpha is the matte. Exactly
            linear: the colour of `relit(a + b)` is that of `relit(a)` plus that of `relit(b)`, and twice the
            intensity gives twice the colour, to float32 rounding.

        Raises
        ------
        TypeError
            Not lights, or lights that move.
        ValueError
            A near light that touches the person, a gloss or an amount outside [0, 1], or lights so bright
            that the picture exceeds float32.

        Examples
        --------
        >>> import numpy as np, relight
        >>> subject = relight.Subject(np.full((64, 48, 3), 0.3, np.float32), np.eye(64, 48, k=-8) < 0.5)
        >>> key = relight.DirectionalLight(azimuth=-40, intensity=1)
        >>> bright = relight.DirectionalLight(azimuth=-40, intensity=2)
        >>> once, twice = subject.relit(key)[..., :3], subject.relit(bright)[..., :3]
        >>> np.allclose(2 * once, twice)
        True
        """
        shining = scaled(self.placed(lights), amount)
        reflection = self.reflected_pixels(shining) if gloss else None
        picture = self._picture(self.lit_pixels(shining), reflection, gloss)
        if amount < 1:
            picture[:, :3] += self.photographed_pixels(1 - amount)[:, :3]
        return self.on_plate(picture)

    @checks_arguments
    def preset(self, name: str) -> list[Light]:
        """Return the lights of a preset, as bright as the photograph.

        They leave the mean luminance of the face, or of the person where no face is known, what it is in the
        photograph. Their brightness beside each other is that of `relight.presets`. The name alone, given as
        lights, stands for them.

        Raises ValueError for another name.

        >>> import numpy as np, relight
        >>> subject = relight.Subject(np.full((64, 48, 3), 0.3, np.float32), np.eye(64, 48, k=-8) < 0.5)
        >>> inside = subject.matte > 0.5
        >>> round(float(subject.relit("window")[inside, 1].mean()), 1)
        0.3
        """
        return scaled(presets.named(name, "name"), self.preset_gain(name))

    @checks_arguments
    def preset_gain(self, name: str) -> float:
        """Return the factor between the lights of `preset` and those of `relight.presets`."""
        record, lights = self._record, presets.named(name)
        if self.is_empty:
            return 1.0
        return gain_to_keep(record.maps, record.exposure, record.face, lights)

    def placed(self, lights: Lights) -> list[Light]:
        """Return lights as a list, as they are on this person: a preset exposed, followers in place.

        Methods that say no more than `list[Light]` take what this returns.
        """
        if isinstance(lights, str):
            return scaled(presets.named(lights, "lights"), self.preset_gain(lights))
        return [self._placed(light) for light in as_lights(lights)]

    def _placed(self, light: Light) -> Light:
        """Return a light that follows a part of the person as it stands by them; nobody stands in the middle.

        Raises ValueError if that part is not seen.
        """
        if not isinstance(light, NearLight) or light.at is None:
            return light
        return light.standing_at((0, 0, 0)) if self.is_empty else joints.placed(light, self.joints)

    @cached_property
    def joints(self) -> dict[str, tuple[float, ...]]:
        """{"head", "hips", "left-hand", "right-hand": (x, y, z)}: where these are that are seen, in metres.

        Left is the person's left. Without the networks of `relight fetch person` none is seen.
        """
        return {} if self.is_empty else joints.find(self._record.maps)

    def photographed(self) -> np.ndarray:
        """Return the person in the photograph's own light: (H, W, 4) float32, as `relit` returns pictures."""
        return self.on_plate(self.photographed_pixels())

    def photographed_pixels(self, share: float = 1.0) -> torch.Tensor:
        """Return a share of `photographed` as the person's pixels alone: (P, 4), for `on_plate`."""
        coverage = self._record.foreground.coverage[:, None]
        return torch.cat([share * self._record.colour * coverage, coverage], dim=1)

    @checks_arguments
    def layers(
        self, lights: Lights, gloss: quantities.Gloss = 0.0, amount: quantities.Amount = 1.0
    ) -> dict[str, np.ndarray]:
        """Relight the person by each light alone.

        Parameters
        ----------
        lights
            A light, or any number of them; those without a name are `light1`, `light2`...
        gloss, amount
            See `relit`. With an amount below 1 the layer "photograph" is the rest.

        Returns
        -------
        dict[str, np.ndarray]
            {name: (H, W, 4)} float32, linear Rec.709. Each is a complete premultiplied picture with the matte
            as its alpha. The colours of all layers sum to the colour of `relit(lights, gloss, amount)`; the
            alpha does not add up.

        Raises
        ------
        ValueError
            Two lights have one name, or that of the photograph's layer; a gloss or an amount outside [0, 1].
        """
        named = by_name(scaled(self.placed(lights), amount), [PHOTOGRAPH] if amount < 1 else [])
        layers = self.pixels_per_light(named, gloss, 1 - amount)
        return {name: self.on_plate(pixels) for name, pixels in layers}

    def pixels_per_light(
        self, named: Mapping[str, Light], gloss: float = 0.0, photograph: float = 0.0
    ) -> Iterator[tuple[str, torch.Tensor]]:
        """Yield the layers one after the other, as the person's pixels alone: (P, 4), for `on_plate`.

        `named`: {name: light}, see `placed`. `photograph`: the share of the photograph's own light.
        """
        if photograph > 0:
            yield PHOTOGRAPH, self.photographed_pixels(photograph)
        several = list(named.items())
        for start in range(0, len(several), LIGHTS_PER_BATCH):
            batch = several[start : start + LIGHTS_PER_BATCH]
            upsampled = self._to_plate(torch.cat([self._record.maps.lit([light]) for _, light in batch]))
            for (name, light), lighting in zip(batch, upsampled.split(3, dim=1), strict=True):
                reflection = self.reflected_pixels([light]) if gloss else None
                yield name, self._picture(lighting, reflection, gloss)

    def on_plate(self, pixels: torch.Tensor) -> np.ndarray:
        """Put the person's pixels (P, C) into a plate: (H, W, C) float32, zero outside the matte."""
        return self._record.foreground.scatter(pixels)

    def lighting(self, lights: Lights) -> np.ndarray:
        """Return the picture of a white person: (H, W, 3) float32, linear, zero outside the matte.

        The colour of `relit(lights)` is `albedo × lighting(lights) × alpha`. With the albedo, a compositor
        can grade light and colour separately. Raises as `relit` does.
        """
        return self.on_plate(self.lit_pixels(self.placed(lights)))

    def reflection(self, lights: Lights) -> np.ndarray:
        """Return what a gloss of 1 adds to the picture: (H, W, 3) float32, linear, zero outside the matte.

        The colour of `relit(lights, gloss)` is `(albedo × lighting(lights) + gloss × reflection(lights)) ×
        alpha`. The surface's own colour has no part in it. `relight.analysis.gloss` states its source.
        Raises as `relit` does.
        """
        return self.on_plate(self.reflected_pixels(self.placed(lights)))

    def lit_pixels(self, lights: list[Light]) -> torch.Tensor:
        """Return Σ intensity · shading as the person's pixels alone: (P, 3), for `on_plate`."""
        return _representable(self._to_plate(self._record.maps.lit(lights)))

    def reflected_pixels(self, lights: list[Light]) -> torch.Tensor:
        """Return Σ intensity · gloss as the person's pixels alone: (P, 3), for `on_plate`."""
        return _representable(self._to_plate(self._record.maps.reflected(lights)))

    def unshadowed(self, light: Light) -> np.ndarray:
        """Return the fraction of a light that the person does not block: (H, W) float32 in [0, 1].

        For a hard light this is its visibility. For a soft light or an environment it is the mean over its
        directions, weighted by luminance; for a near light, weighted by irradiance. It is zero outside the
        matte.
        """
        return self.on_plate(self._to_plate(self._record.maps.unshadowed(light)))[..., 0]

    def confidence(self, light: Light | None = None) -> np.ndarray:
        """Return how sure the analysis is of its shadows: (H, W) float32 in [0.5, 1], zero outside the matte.

        It is the probability that `unshadowed(light)`, as lit or blocked, is right; for a soft light the mean
        over its directions, and without a light over all directions. On rendered bodies that the networks
        have not seen, the stated and the measured probability agree to 1 % (`python
        benchmarks/confidence.py`); photographs may differ more.

        >>> import numpy as np, relight
        >>> subject = relight.Subject(np.full((64, 48, 3), 0.3, np.float32), np.eye(64, 48, k=-8) < 0.5)
        >>> sure = subject.confidence(relight.DirectionalLight(azimuth=-40))
        >>> bool(sure[subject.matte > 0.99].min() >= 0.5)
        True
        """
        return self.on_plate(self._to_plate(self._record.maps.confidence(light)).clamp(0, 1))[..., 0]

    @property
    def mean_confidence(self) -> float:
        """The mean of `confidence()` over the person, on the networks' canvas."""
        maps = self._record.maps
        return float(maps.confidence()[0][maps.known].mean())

    @checks_arguments
    def shadows(self, lights: Lights, floor: GivenFloor) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Compute the shadow that the person casts on a floor.

        Parameters
        ----------
        lights
            A light, or any number of them.
        floor
            relight.Floor.

        Returns
        -------
        tuple[dict[str, np.ndarray], np.ndarray]
            {name: (H, W, 3)}, the shadow of each light, and (H, W, 3), that of all lights: float32 in [0, 1],
            factors for the background. They are the fraction of the floor's light that the person does not
            block, and 1 above the horizon. The shadow of all lights is the mean of the others, weighted by
            irradiance.

        Raises
        ------
        ValueError
            The person cannot stand on this floor.
        """
        return self.shadows_per_light(by_name(self.placed(lights)), floor)

    def shadows_per_light(
        self, named: Mapping[str, Light], floor: Floor
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Compute what `shadows` returns, for {name: light}, see `placed`."""
        if self.is_empty:
            lit = np.ones((*self.size, 3), np.float32)
            return dict.fromkeys(named, lit), lit
        maps = self._record.maps
        geometry, cut = maps.geometry, bool(self.matte[-1].max() > 0.5)
        shadow = FloorShadow.of(floor, geometry.camera, geometry.positions, maps.known, cut)
        return shadow.shadows(named)

    def clean_plate(self, image: np.ndarray) -> np.ndarray:
        """Return the photograph without the person: what a relit picture is laid over to stand in it.

        Under the matte, grown by 0.6 % of the person's height, the surroundings go on, so that nothing of the
        old picture shows beside the new one. All other pixels are unchanged.

        Parameters
        ----------
        image
            (H, W, 3|4), the photograph: integers sRGB-encoded, floats linear Rec.709.

        Returns
        -------
        np.ndarray
            (H, W, 3) float32, linear Rec.709.

        Raises
        ------
        TypeError, ValueError
            Not an image, with transparency, or of another size than the subject.

        Examples
        --------
        >>> import numpy as np, relight
        >>> photo, mask = np.full((64, 48, 3), 0.2, np.float32), np.zeros((64, 48), np.float32)
        >>> photo[16:48, 16:32] = 0.5
        >>> mask[16:48, 16:32] = 1
        >>> subject = relight.Subject(photo, mask)
        >>> bool(np.allclose(subject.clean_plate(photo), 0.2))
        True
        """
        own = self.on_plate(self._record.colour)
        return clean_plate(checked_plate(image, self.size), self.matte, own)

    def upsampled(self, maps: torch.Tensor) -> np.ndarray:
        """Upsample maps of the networks' canvas, (C, h, w), to the plate: (H, W, C) float32, zero outside."""
        return self.on_plate(self._to_plate(maps))

    def fit_lighting(self, image: inputs.Array) -> tuple[np.ndarray, np.ndarray]:
        """Fit the lighting in which the person looks most like `image`, see `relight.fit_lights`.

        Returns directions (96, 3), `shadow.directions.olat(behind=True)`, and their intensities (96, 3) >= 0.
        """
        self._check_shown()
        return self._record.fit_lighting(image, self._albedo)

    def light_grid(self, gloss: float = 0.0) -> LightGrid:
        """Return the person at the points where `relight.paint_lights` solves for lights."""
        return LightGrid(self._record, self._albedo, gloss)

    @checks_arguments
    def view(
        self,
        path: quantities.File | None = None,
        lights: Lights | None = None,
        *,
        background: Background | None = None,
        title: str = "relight",
        command: quantities.Words | None = None,
        background_name: str | None = None,
        gloss: quantities.Gloss = 0.0,
        amount: quantities.Amount = 1.0,
        fill: quantities.Amount = 0.0,
        background_blur: quantities.Blur = 0.0,
        background_light: quantities.Amount = 0.0,
    ) -> Any:
        """Show the person on a page with lights that can be dragged: an HTML file, or a notebook widget.

        Parameters
        ----------
        path
            The file to write, .html; None for a widget (extra `notebook`), see `relight.viewer.widget`.
        lights
            The initial lights: up to eight `DirectionalLight` and `PointLight`, and one `EnvironmentLight`; a
            soft key light by default.
        background
            See `relight.over`; None for no background.
        title
            Title of the page.
        command
            The words of the command that relights the photograph, without lights, which the page adds.
        background_name
            The background's file, or `environment`, for this command; None omits it from the command.
        gloss, amount
            What the page begins with, see `relit`.
        fill
            Share of the background's light, in [0, 1], that fills the shadows of the others, as
            `relight.Lighting(fill="background", fill_amount=fill)` does; none by default.
        background_blur, background_light
            Those of `relight.Lighting`, with which the page begins.

        Returns
        -------
        Any
            The path written, or the widget. The page needs no server and no network.

        Raises
        ------
        TypeError, ValueError
            Lights or a background that the page cannot show, a fill without a background that is an image, or
            another suffix.
        OSError
            The file cannot be written.
        ModuleNotFoundError
            Anywidget is missing.
        """
        from relight.viewer import initial_state as scene

        self._check_shown()
        from relight.viewer import packing, page

        first = None if lights is None else self.placed(lights)
        about = scene.scene_of(
            self.size, first, background, title=title, command=command or scene.COMMAND,
            background_name=background_name, gloss=gloss, amount=amount, fill=fill,
            blur=background_blur, background_light=background_light,
            field_of_view=self.camera.field_of_view,
        )  # fmt: skip
        for light in first or []:
            self._record.maps.check_outside(light)
        person = (self._record, self.matte, self.albedo)
        if path is not None:
            return page.write_page(path, about, *person)
        from relight.viewer.widget import Viewer

        return Viewer(packing.pack(*person), about, self.relit)

    @checks_arguments
    def export(
        self,
        path: quantities.File,
        lights: Light | MovingLight | Iterable[Light | MovingLight] | None = None,
        *,
        triangles: int = 120_000,
        texture: str = "albedo",
        gloss: quantities.Gloss = 0.0,
        amount: quantities.Amount = 1.0,
    ) -> Path:
        """Write the person for other programs: a textured mesh with camera and lights, or a Nuke script.

        A `.nk` has a group with knobs for up to four lights. It moves shadows too, with the nodes that Nuke
        brings along, and reads `<name>_layers.exr` beside it, which is written as well.

        The mesh is in metres, y up, and its feet are on the ground plane, y = 0. Its front is what the camera
        saw; no picture shows the back, which is a guess. Rendered through the camera it overlays the plate.
        See `docs/scene.md`. Needs the extra `scene`.

        Parameters
        ----------
        path
            The file: .glb (glTF 2.0); .usda, .usdc or .usdz (USD); or .nk (Nuke). The texture of a .usda or
            .usdc is written beside it.
        lights
            Lights that are also written, as by `relight.write_lights`. The knobs of a .nk begin with them:
            up to four DirectionalLight, a key light by default.
        triangles
            Largest number of triangles, at least 1,000.
        texture
            "albedo" for a surface in new light, or "photograph" for an unlit surface.
        gloss
            Of the surface, see `relit`. In USD it is 0 or 1.
        amount
            With which the knob of a .nk begins, see `relit`; 1 for the other files.

        Returns
        -------
        Path
            The path written.

        Raises
        ------
        ValueError
            Another suffix or texture, too few triangles, a gloss or an amount outside [0, 1]; for a .nk other
            lights, or a mesh's options; for a mesh an amount below 1.
        TypeError
            Not lights.
        OSError
            The file cannot be written.
        ModuleNotFoundError
            The extra `scene` is missing.

        Warns
        -----
        UserWarning
            Lights that glTF cannot hold.
        """
        from relight.scene import asset
        from relight.scene import write as writing
        from relight.scene.nuke import person_group
        from relight.scene.nuke.light_groups import is_script

        path = asset.checked(path, texture, triangles)
        self._check_shown()
        person_group.check_amount(path, amount)
        if is_script(path):
            return writing.write_script(path, self, person_group.checked_lights(lights), gloss, amount)
        return writing.write(path, self.asset(lights, triangles=triangles, texture=texture, gloss=gloss))

    def asset(
        self,
        lights: Light | MovingLight | Iterable[Light | MovingLight] | None = None,
        *,
        triangles: int = 120_000,
        texture: str = "albedo",
        gloss: float = 0.0,
    ) -> "Asset":
        """Return the mesh, camera and lights that `export` writes; the arguments are the same."""
        self._check_shown()
        from relight.scene.asset import of_subject

        return of_subject(self, lights, triangles, texture, gloss)

    @property
    def record(self) -> AnalysisRecord:
        """The analysis that the subject is made of."""
        return self._record

    @property
    def is_empty(self) -> bool:
        """Whether the picture shows no person, see `nobody`."""
        return self._record.is_empty

    @property
    def old_light(self) -> OldLight:
        """The colour of the photograph's light, which the inferred albedo lacks."""
        return self._record.old_light

    @property
    def size(self) -> tuple[int, int]:
        """(H, W) of the plate, pixels."""
        return self._record.foreground.size

    @property
    def camera(self) -> Camera:
        """The plate's camera, which turns pixels and depth into positions."""
        return self._record.maps.geometry.camera

    @property
    def distance(self) -> float:
        """Metres from the camera to the subject's middle, along the camera's axis."""
        return self.camera.distance

    @cached_property
    def matte(self) -> np.ndarray:
        """(H, W) float32 in [0, 1], read-only: the person's coverage, the alpha of relit pictures."""
        return _read_only(self.on_plate(self._record.foreground.coverage[:, None])[..., 0])

    @cached_property
    def albedo(self) -> np.ndarray:
        """(H, W, 3) float32, linear Rec.709 in [0, 1], read-only: the plate without light; zero outside."""
        return _read_only(self.on_plate(self._albedo))

    @cached_property
    def normals(self) -> np.ndarray:
        """(H, W, 3) float32 unit vectors, camera frame, read-only, at the networks' detail; zero outside."""
        return _read_only(self.on_plate(F.normalize(self._to_plate(self._record.maps.normals), dim=1)))

    @cached_property
    def depth(self) -> np.ndarray:
        """(H, W) float32, read-only: metres along the camera's axis from the subject's middle, positive away
        from the camera; zero outside the matte."""
        return _read_only(self.on_plate(self._to_plate(self._record.maps.geometry.depth[None]))[..., 0])

    @cached_property
    def position(self) -> np.ndarray:
        """(H, W, 3) float32, read-only: metres in the camera's axes from the subject's middle, x to image
        right, y up, z to the camera; zero outside the matte."""
        height, width = self.size
        rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
        positions = self.camera.positions(columns + 0.5, rows + 0.5, torch.tensor(self.depth))
        return _read_only(positions.permute(1, 2, 0).numpy() * (self.matte > 0)[..., None])

    @checks_arguments
    def visibility(self, directions: inputs.Array) -> np.ndarray:
        """Compute self-shadow maps for light directions.

        Parameters
        ----------
        directions
            (D, 3), toward the lights, camera frame, any length but zero.

        Returns
        -------
        np.ndarray
            (D, H, W) float32 in [0, 1]: 1 is lit; zero outside the matte.

        Raises
        ------
        TypeError, ValueError
            Wrong shape or dtype, NaN or infinite values, a direction of zero length.
        """
        return self._maps_on_plate(self._record.maps.visibility, directions)

    @checks_arguments
    def shading(self, directions: inputs.Array) -> np.ndarray:
        """Compute the diffuse shading by one light of unit intensity at a time.

        Parameters
        ----------
        directions
            (D, 3), toward the lights, camera frame, any length but zero.

        Returns
        -------
        np.ndarray
            (D, H, W) float32, linear, in [0, 1]: 1 is a surface that faces an unblocked light; zero outside
            the matte.

        Raises
        ------
        TypeError, ValueError
            As for `visibility`.
        """
        return self._maps_on_plate(self._record.maps.shading, directions)

    def _check_shown(self) -> None:
        """Raise EmptyMatteError if the picture shows no person."""
        if self.is_empty:
            raise EmptyMatteError("the picture shows no person; choose another")

    def _maps_on_plate(
        self, maps: Callable[[torch.Tensor], torch.Tensor], directions: inputs.Array
    ) -> np.ndarray:
        """Return the maps (D, H, W) of light directions (D, 3)."""
        upsampled = self._to_plate(maps(inputs.directions("directions", directions)))
        return np.ascontiguousarray(self.on_plate(upsampled).transpose(2, 0, 1))

    @cached_property
    def _texture(self) -> torch.Tensor:
        """The albedo of the person's pixels, premultiplied (P, 3)."""
        return self._albedo * self._record.foreground.coverage[:, None]

    def _picture(
        self, lighting: torch.Tensor, reflection: torch.Tensor | None = None, gloss: float = 0.0
    ) -> torch.Tensor:
        """Return the picture (P, 4) of the person's pixels under a lighting and a reflection, (P, 3) each."""
        coverage = self._record.foreground.coverage
        picture = torch.empty(len(lighting), 4)
        torch.mul(lighting, self._texture, out=picture[:, :3])
        if reflection is not None:
            picture[:, :3].addcmul_(reflection, coverage[:, None], value=gloss)
        picture[:, 3] = coverage
        return _representable(picture)

    def _to_plate(self, maps: torch.Tensor) -> torch.Tensor:
        """Upsample canvas maps (C, h, w) to the person's pixels on the plate (P, C)."""
        return self._upsample(self._extend(maps))


def unpickled(kind: type[Subject], packed: bytes) -> Subject:
    """Return a subject that was pickled; raises as `Subject.load`."""
    return kind.from_record(storage.unpack_record(packed))


def weights() -> tuple[str, str]:
    """Return the checksums of the networks' weights."""
    return checksum("field", "shadow"), checksum("shading", "shading")


def _read_only(array: np.ndarray) -> np.ndarray:
    """Make an array read-only, since the subject keeps it."""
    array.flags.writeable = False
    return array


def _representable(colour: torch.Tensor) -> torch.Tensor:
    """Return the colour; raises ValueError if any of it exceeds float32."""
    if colour.numel() and not torch.isfinite(torch.stack(colour.aminmax())).all():  # which pass NaN on
        raise ValueError("lights: are too bright, the picture would be infinite; expected less intensity")
    return colour
