"""Render a picture of a relit person, its light groups, which sum to the picture, and its passes."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch

from relight import quantities
from relight.analysis.infer import AnalysisInputs, check_inputs, infer
from relight.arguments import checks_arguments, shown
from relight.compositing.composite import MAX_BACKGROUND_FACTOR, Background, backdrop, over
from relight.compositing.defocus import defocused
from relight.compositing.floor import Floor, GivenFloor
from relight.lights.environment import FIELD_OF_VIEW, EnvironmentLight, environments
from relight.lights.light import Light
from relight.lights.rig import Lights, as_lights, by_name, scaled
from relight.media.images import Metadata, half, read, scene_linear
from relight.media.images.arrays import as_array
from relight.quantities import BACKGROUNDS, BLUR, ENVIRONMENT, NONE, PLATE, STRONG_BLUR, background_of
from relight.subject import PHOTOGRAPH, Subject
from shadow import inputs
from shadow.files import AnyPath, is_path
from shadow.torch_settings import isolated

BACKGROUND_LAYER = "background"
PASSES = ("albedo", "N", "Z", "P", "visibility", "shading", "gloss", "confidence")
EXR_TYPES = ("half", "float")

Layers = dict[str, np.ndarray]


@isolated
@checks_arguments
def apply(
    image: inputs.Array,
    lights: Lights,
    *,
    background: Background | AnyPath | None = None,
    mask: inputs.Array | None = None,
    matte: quantities.Model | None = "auto",
    albedo: inputs.Array | None = None,
    normals: np.ndarray | Callable | str | os.PathLike | None = None,
    depth: np.ndarray | str | os.PathLike | None = None,
    height: quantities.Height | None = None,
    field_of_view: quantities.FieldOfView = FIELD_OF_VIEW,
    floor: GivenFloor | None = None,
    gloss: quantities.Gloss = 0.0,
    amount: quantities.Amount = 1.0,
    device: str | torch.device | None = None,
) -> np.ndarray:
    """Relight the person in an image.

    Parameters
    ----------
    image
        (H, W, 3|4). Integers are sRGB-encoded with straight alpha; floats linear Rec.709, premultiplied.
    lights
        A light, any number of them, or the name of a preset, whose lights leave the face as bright as it is
        in the photograph (see `Subject.preset`).
    background
        An image of any size, scaled to cover the frame; a linear (r, g, b); or a relight.EnvironmentLight,
        which is rendered as the camera sees it (see `relight.over`). Or text, as the command takes it: a
        file, a colour such as "0.03/0.03/0.04", "environment", the environments among the lights, or "plate",
        the photograph itself: it is filled under its person, see `Subject.clean_plate`, as it is where it is
        given as an image; or "blur", that out of focus. None, or "none", keeps the alpha.
    mask
        (H, W) in [0, 1], the matte of the person, in place of the image's alpha.
    matte
        How the person is found without either, see `relight.Subject`.
    albedo
        (H, W, 3), replaces the inferred albedo.
    normals
        (H, W, 3) camera-frame normals that replace the inferred ones, or anything else that
        `shadow.normals.load` accepts.
    depth, height, field_of_view
        Properties of the person and the photograph's camera, see `relight.Subject`. Near lights need them.
    floor
        relight.Floor on which the person stands. The person's shadow on it is cast on the background.
    gloss
        Strength, in [0, 1], of a reflection at grazing angles, see `Subject.relit`; none by default.
    amount
        Share of these lights, in [0, 1]: the rest is the photograph, see `Subject.relit`.
    device
        Device of the networks, such as "cuda"; the CPU by default.

    Returns
    -------
    np.ndarray
        (H, W, 4) float32, linear Rec.709, premultiplied; or (H, W, 3) over a background. Exactly linear in
        the lights' intensities, unbounded.

    Raises
    ------
    TypeError, ValueError
        What `relight.Subject`, `Subject.relit` and `relight.over` refuse.

    Examples
    --------
    >>> import numpy as np, relight
    >>> photo = np.zeros((64, 48, 4), np.float32)
    >>> photo[8:56, 12:36] = 0.3, 0.3, 0.3, 1
    >>> key = relight.DirectionalLight(azimuth=-40, elevation=30, intensity=2)
    >>> relight.apply(photo, key, background=(0.1, 0.1, 0.1)).shape
    (64, 48, 3)
    """
    named = lights if isinstance(lights, str) else None
    lights = as_lights(lights)
    background = _background(background, lights)
    given = check_inputs(
        image, mask, albedo, normals, depth, height=height, field_of_view=field_of_view, device=device,
        matte=matte,
    )  # fmt: skip
    subject = _analysed(given, floor)
    behind = _behind(subject, background, lights, given.plate)
    return relit_over(subject, named or lights, behind, floor, gloss, amount)


def relit_over(
    subject: Subject,
    lights: Lights,
    background: Background | None = None,
    floor: Floor | None = None,
    gloss: float = 0.0,
    amount: float = 1.0,
    blur: float = 0.0,
    background_light: float = 0.0,
) -> np.ndarray:
    """Relight an analysed person over a background; see `apply`, and `relight.Lighting` for the last two."""
    picture = subject.relit(lights, gloss, amount)
    if background is None:
        return picture
    shadow = None if floor is None else partial_shadow(subject.shadows(lights, floor)[1], amount)
    if blur or background_light:
        background = lit_backdrop(subject, picture, background, None, blur, background_light)
    return over(picture, background, shadow)


def lit_backdrop(
    person: Subject,
    relit: np.ndarray,
    background: Background,
    shadow: np.ndarray | None = None,
    blur: float = 0.0,
    background_light: float = 0.0,
) -> np.ndarray:
    """Return what is behind a relit person, (H, W, 3) linear, as their light and the lens leave it.

    `relit`: the picture (H, W, 4). `shadow`, `blur`: see `backdrop`; `background_light`: `relight.Lighting`.
    """
    factor = background_factor(person, relit, background_light) if background_light else None
    back = backdrop(background, person.size, shadow, blur)
    return back if factor is None else back * factor


def background_factor(person: Subject, relit: np.ndarray, share: float) -> np.ndarray:
    """Return the factor (3,) of a background that a share of the person's light reaches, on average.

    `relit`: (H, W, 4), the picture. The light is that of the picture over the photograph.
    """
    after, before = (each[..., :3].sum(axis=(0, 1)) for each in (relit, person.photographed()))
    whole = np.divide(after, before, out=np.ones(3, np.float32), where=before > 0)
    return 1 + np.float32(share) * (whole.clip(0, MAX_BACKGROUND_FACTOR) - 1)


def partial_shadow(shadow: np.ndarray, amount: float) -> np.ndarray:
    """Return the shadow on a floor, factors of the background, of a share of the lights that cast it."""
    return 1 - np.float32(amount) * (1 - shadow)


def _background(background: Background | AnyPath | None, lights: Iterable[Light]) -> Background | None:
    """Return what a text means, a word among BACKGROUNDS as it is; anything else unchanged."""
    if not is_path(background):
        return background
    try:
        meant = background_of(os.fspath(background))
    except ValueError as error:
        raise ValueError(f"background: {error}") from None
    if meant == NONE:
        return None
    if meant == ENVIRONMENT and not environments(lights):
        raise ValueError("background: 'environment' expected an environment among the lights")
    return read(meant) if isinstance(meant, str) and meant not in BACKGROUNDS else meant


@isolated
@checks_arguments
def render(
    image: inputs.Array,
    lights: Lights,
    *,
    background: Background | AnyPath | None = None,
    mask: inputs.Array | None = None,
    matte: quantities.Model | None = "auto",
    albedo: inputs.Array | None = None,
    normals: np.ndarray | Callable | str | os.PathLike | None = None,
    depth: np.ndarray | str | os.PathLike | None = None,
    height: quantities.Height | None = None,
    field_of_view: quantities.FieldOfView = FIELD_OF_VIEW,
    passes: Iterable[str] = (),
    exr_type: str = "half",
    floor: GivenFloor | None = None,
    gloss: quantities.Gloss = 0.0,
    amount: quantities.Amount = 1.0,
    device: str | torch.device | None = None,
) -> tuple[np.ndarray, Layers]:
    """Relight the person in an image, and return the layers of the picture too, for an OpenEXR file.

    Parameters
    ----------
    image, lights, background, mask, matte, albedo, normals, depth, height, field_of_view
        See `relight.apply`.
    floor, gloss, amount, device
        See `relight.apply`.
    passes
        Any of "albedo", "N", "Z", "P", "visibility", "shading", "gloss", "confidence", see `passes_of`.
    exr_type
        "half" or "float", the file's type: the picture is the sum of groups rounded to it.

    Returns
    -------
    tuple[np.ndarray, Layers]
        The picture and its layers, see `render_subject`.

    Raises
    ------
    TypeError, ValueError
        What `relight.apply` and `render_subject` refuse.

    Examples
    --------
    >>> import numpy as np, relight
    >>> photo = np.zeros((64, 48, 4), np.float32)
    >>> photo[8:56, 12:36] = 0.3, 0.3, 0.3, 1
    >>> key = relight.DirectionalLight(azimuth=-40, name="key")
    >>> picture, layers = relight.render(photo, key, passes=["N", "P"])
    >>> sorted(layers)
    ['C_key', 'N', 'P']
    """
    preset = lights if isinstance(lights, str) else None
    lights = as_lights(lights)
    by_name(lights)  # refuse what is wrong with them before the networks run
    passes = check_names(passes)
    if exr_type not in EXR_TYPES:
        raise ValueError(f"exr_type: expected {' or '.join(EXR_TYPES)}, got {exr_type!r}")
    background = _background(background, lights)
    given = check_inputs(
        image, mask, albedo, normals, depth, height=height, field_of_view=field_of_view, device=device,
        matte=matte,
    )  # fmt: skip
    subject = _analysed(given, floor)
    behind = _behind(subject, background, lights, given.plate)
    return render_subject(
        subject, preset or lights, background=behind, passes=passes, exr_type=exr_type, floor=floor,
        gloss=gloss, amount=amount,
    )  # fmt: skip


def _analysed(given: AnalysisInputs, floor: Floor | None) -> Subject:
    """Return the subject of an image; refuse a floor on which it cannot stand before the networks run."""
    if floor is not None:
        floor.check(given.matte)
    return Subject.from_record(infer(given))


@dataclass(frozen=True)
class Rendering:
    """A relit person without a background.

    `cut_out`: (H, W, 4) linear, premultiplied. `layers`: light groups, floor shadows and passes, see
    `render_subject`; none if they were not asked for. `shadow`: (H, W, 3), the factor by which the shadow of
    all lights on the floor dims a background; None without a floor. `metadata`: see `metadata_of`.
    """

    cut_out: np.ndarray
    layers: Layers
    shadow: np.ndarray | None
    metadata: Metadata = field(default_factory=dict)


def render_layers(
    subject: Subject,
    lights: list[Light],
    *,
    passes: Iterable[str] = (),
    exr_type: str = "half",
    floor: Floor | None = None,
    gloss: float = 0.0,
    amount: float = 1.0,
    layered: bool = True,
    reserved: Sequence[str] = (),
) -> Rendering:
    """Render an analysed person without a background, from arguments that are checked; see `render_subject`.

    `lights`: as `Subject.placed` returns them. `layered`: whether to make layers. `reserved`: names of layers
    that others add. Raises ValueError for no light, or names that are taken.
    """
    if not lights:
        raise ValueError("lights: expected at least one")
    named = by_name(lights, [*reserved, PHOTOGRAPH] if amount < 1 else reserved)
    shining = dict(zip(named, scaled(lights, amount), strict=True))
    picture, layers = light_groups(subject, shining, exr_type, gloss, 1 - amount, layered)
    further, shadow = passes_of(subject, shining, passes), None
    if floor is not None:
        per_light, shadow = subject.shadows_per_light(named, floor)
        shadow = partial_shadow(shadow, amount)
        further |= {f"shadow_floor_{name}": layer for name, layer in per_light.items()}
    layers = layers | further if layered else {}
    return Rendering(picture, layers, shadow, metadata_of(subject, passes))


def over_backdrop(cut_out: np.ndarray, back: np.ndarray, exr_type: str) -> tuple[np.ndarray, np.ndarray]:
    """Composite a picture (H, W, 4) over a background (H, W, 3): the picture, and "C_background"."""
    seen = _rounded((1 - cut_out[..., 3:]) * back, "C_background", exr_type)
    return cut_out[..., :3] + seen, seen


@checks_arguments
def render_subject(
    subject: Subject,
    lights: Lights,
    *,
    background: Background | AnyPath | None = None,
    passes: Iterable[str] = (),
    exr_type: str = "half",
    floor: GivenFloor | None = None,
    gloss: quantities.Gloss = 0.0,
    amount: quantities.Amount = 1.0,
) -> tuple[np.ndarray, Layers]:
    """Render the picture of an analysed person that `relight.apply` returns, and layers for `relight.write`.

    `background`, `floor`, `gloss`, `amount`: see `relight.apply`. `passes`: further layers, of PASSES.
    `exr_type`: see `relight.render`. The layers are

    - "C_<light>" (H, W, 4), light groups whose colours, rounded to `exr_type`, sum to the picture's;
    - with an amount below 1 "C_photograph" (H, W, 4), the share of the photograph's own light, one of them;
    - over a background "C_background" (H, W, 3), its visible part with the shadow of all lights in it;
    - on a floor "shadow_floor_<light>" (H, W, 3), the factor of the background if there were no other light;
    - the passes, see `passes_of`.

    Raises ValueError for no light, two lights of one name, an unknown pass, or a gloss or an amount outside
    [0, 1].
    """
    lights, passes = subject.placed(lights), check_names(passes)
    background = _background(background, lights)
    rendering = render_layers(
        subject, lights, passes=passes, exr_type=exr_type, floor=floor, gloss=gloss, amount=amount,
        reserved=[] if background is None else [BACKGROUND_LAYER],
    )  # fmt: skip
    if background is None:
        return rendering.cut_out, rendering.layers
    back = backdrop(_seen_by(subject, background, lights), subject.size, rendering.shadow)
    picture, seen = over_backdrop(rendering.cut_out, back, exr_type)
    return picture, rendering.layers | {"C_background": seen}


def _behind(
    subject: Subject, background: Background | None, lights: Iterable[Light], plate: np.ndarray
) -> Background | None:
    """Return what is behind the person of a linear plate (H, W, 3|4): the plate filled where it is that."""
    if background is None:
        return None
    if isinstance(background, str) and background in (PLATE, BLUR):
        clean = subject.clean_plate(plate)
        return defocused(clean, STRONG_BLUR) if background == BLUR else clean
    if (
        not isinstance(background, EnvironmentLight | str)
        and as_array("background", background).shape[:2] == plate.shape[:2]
    ):
        given = scene_linear("background", background)
        return subject.clean_plate(given) if np.array_equal(given[..., :3], plate[..., :3]) else given
    return _seen_by(subject, background, lights)


def _seen_by(subject: Subject, background: Background, lights: Iterable[Light]) -> Background:
    """Return background maps as the subject's camera sees them, (H, W, 3); another background as it is."""
    if isinstance(background, EnvironmentLight):
        skies = [background]
    elif isinstance(background, str):  # ENVIRONMENT
        skies = environments(lights)
    else:
        return background
    return np.sum([sky.view(subject.camera.size, subject.camera.field_of_view) for sky in skies], axis=0)


def light_groups(
    subject: Subject,
    named: Mapping[str, Light],
    exr_type: str = "half",
    gloss: float = 0.0,
    photograph: float = 0.0,
    layered: bool = True,
) -> tuple[np.ndarray, Layers]:
    """Render the person's picture, and the part of each light in it; see `render_subject`.

    `photograph`: the share of the photograph's own light, which is a group as well. The picture is
    (H, W, 4), linear, premultiplied, and its groups are {"C_<light>": (H, W, 4)}, as `relight.write` takes
    them. For half-float files the groups are rounded and the picture is their sum, so that it still is after
    a round trip through the file. Each carries the matte as its alpha.
    """
    groups: Layers = {}
    colour = coverage = torch.zeros(())
    for name, layer in subject.pixels_per_light(named, gloss, photograph):
        group = torch.from_numpy(_rounded(layer.numpy(), f"C_{name}", exr_type))
        colour, coverage = colour + group[:, :3], layer[:, 3:]  # coverage does not add up
        if layered:
            groups[f"C_{name}"] = subject.on_plate(group)
    return subject.on_plate(torch.cat([colour, coverage], dim=1)), groups


def _rounded(values: np.ndarray, name: str, exr_type: str) -> np.ndarray:
    """Return a layer (..., C) as a file of this type holds it."""
    return half(values, name) if exr_type == "half" and values.size else values


def passes_of(subject: Subject, named: Mapping[str, Light], names: Iterable[str]) -> Layers:
    """Return passes {layer name: float32 array} of the plate's size, zero off the matte, not premultiplied.

    - "albedo": (H, W, 3), linear Rec.709.
    - "N": (H, W, 3), normals in the camera frame: x right, y up, z to the camera.
    - "Z": (H, W), metres from the camera along its axis.
    - "P": (H, W, 3), metres from the subject's middle in the camera's axes, see `Subject.position`.
    - "visibility": `visibility_<light>` (H, W) for each light, the share of it that the person does not
      block.
    - "shading": `shading_<light>` (H, W, 3) for each light, the picture of a white person.
    - "gloss": `gloss_<light>` (H, W, 3) for each light, what a gloss of 1 adds, whatever the picture's own:
      the light group is `(albedo × shading_<light> + gloss × gloss_<light>) × alpha`.
    - "confidence": `confidence_<light>` (H, W) for each light, the probability that its visibility is right,
      and `confidence`, that of all directions, see `Subject.confidence`.

    `named`: {name: light}. `names`: of the passes, see `check_names`.
    """
    layers = {"albedo": subject.albedo} if "albedo" in names else {}
    layers |= {"N": subject.normals} if "N" in names else {}
    layers |= {"P": subject.position} if "P" in names else {}
    if "Z" in names:
        layers["Z"] = np.where(subject.matte > 0, subject.distance + subject.depth, np.float32(0))
    if "visibility" in names:
        layers |= {f"visibility_{name}": subject.unshadowed(light) for name, light in named.items()}
    if "shading" in names:
        lit = {name: subject.lit_pixels([light]) for name, light in named.items()}
        layers |= {f"shading_{name}": subject.on_plate(pixels) for name, pixels in lit.items()}
    if "gloss" in names:
        reflected = {name: subject.reflected_pixels([light]) for name, light in named.items()}
        layers |= {f"gloss_{name}": subject.on_plate(pixels) for name, pixels in reflected.items()}
    if "confidence" in names:
        layers["confidence"] = subject.confidence()
        layers |= {f"confidence_{name}": subject.confidence(light) for name, light in named.items()}
    return layers


def metadata_of(subject: Subject, passes: Iterable[str]) -> Metadata:
    """Return the header entries that the passes Z and P need.

    `relight:distance` is in metres from the camera to the origin of positions, the subject's middle;
    `relight:focal_length` in pixels. With Z and a pixel they give a position. `relight:camera` is where the
    camera is, (x, y, z) in metres, in the axes and from the origin of positions.
    """
    if not {"Z", "P"} & set(passes) or subject.is_empty:
        return {}
    return {
        "relight:distance": subject.distance,
        "relight:focal_length": subject.camera.focal,
        "relight:camera": subject.camera.eye,
    }


def check_names(names: Iterable[str], outputs: Iterable[Path] | None = None) -> tuple[str, ...]:
    """Check the names of passes, and return them.

    Raises ValueError: a name is not of PASSES; or no .exr among `outputs`, if these are given, could hold the
    passes.
    """
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise TypeError(f"passes: expected names among {', '.join(PASSES)}, got {shown(names)}")
    names = tuple(names)
    for name in names:
        if name not in PASSES:
            raise ValueError(f"passes: expected any of {', '.join(PASSES)}, got {name!r}")
    if names and outputs is not None and not any(path.suffix.lower() == ".exr" for path in outputs):
        raise ValueError("passes: are layers of an .exr; expected one among the outputs")
    return names
