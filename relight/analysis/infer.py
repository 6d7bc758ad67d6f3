"""From a plate to an `AnalysisRecord`: check the arguments, run the networks once."""

import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from scipy.ndimage import gaussian_filter

from relight.analysis import lightness, skin
from relight.analysis.camera import Camera
from relight.analysis.denoising import denoised
from relight.analysis.depth import WorldGeometry, checked_depth
from relight.analysis.foreground import (
    Foreground,
    linear_plate,
    plate_coverage,
    provided_albedo,
    without_alpha,
)
from relight.analysis.maps import AnalysisMaps
from relight.analysis.old_light import OldLight
from relight.analysis.record import AnalysisRecord
from relight.analysis.upsampling import encode_guide
from relight.arguments import checked_number, shown
from relight.lights.environment import FIELD_OF_VIEW
from relight.matting import networks
from relight.matting.networks import AUTO
from relight.matting.refine import is_opaque
from shading import Analysis, diffuse
from shading.diffuse import ShadingNetwork
from shadow import analysis, inputs
from shadow.analysis import VisibilityNetwork
from shadow.files import AnyPath, is_path
from shadow.framing import Framed
from shadow.matte_cleanup import clean_matte
from shadow.networks.foreign import OnnxDepth
from shadow.normals import on_canvas, resolve

MAX_FEATHER = 0.05  # of the picture's longer side
GUIDE_MEAN = 0.2  # mean of the person's linear colour after the exposure of a guide


@dataclass(frozen=True)
class AnalysisInputs:
    """The checked arguments of `relight.Subject`. No network has run."""

    plate: np.ndarray  # (H, W, 3|4) linear Rec.709, premultiplied
    alpha: torch.Tensor  # (H, W) the person's coverage
    matte: torch.Tensor  # (H, W) the same without noise and specks
    has_mask: bool  # the coverage comes from a separate mask
    feather: float  # pixels, standard deviation of the Gaussian that softens the edge of the pictures
    albedo: torch.Tensor | None  # (3, H, W) in [0, 1]
    normals: np.ndarray | Callable | str | os.PathLike | None
    depth: torch.Tensor | OnnxDepth | None  # (1, H, W) metres; integers, or a network: relative
    camera: Camera
    device: torch.device
    old_light: OldLight | None  # that of another frame


def check_inputs(
    image: inputs.Array,
    mask: inputs.Array | None = None,
    albedo: inputs.Array | None = None,
    normals: np.ndarray | Callable | str | os.PathLike | None = None,
    depth: np.ndarray | AnyPath | None = None,
    height: float | None = None,
    field_of_view: float = FIELD_OF_VIEW,
    camera: Camera | None = None,
    device: str | torch.device | None = None,
    matte: AnyPath | None = AUTO,
    old_light: OldLight | None = None,
    feather: float = 0.0,
) -> AnalysisInputs:
    """Check the arguments of `relight.Subject`, which documents them and the errors raised."""
    for name, value, kind in (("camera", camera, Camera), ("old_light", old_light, OldLight)):
        if value is not None and not isinstance(value, kind):
            raise TypeError(f"{name}: expected a {kind.__name__} of another frame, got {shown(value)}")
    place = inputs.device("device", device) or torch.device("cpu")
    plate = linear_plate(image)
    automatic = isinstance(matte, str) and matte == AUTO
    if mask is None and matte is not None and (not automatic or is_opaque(plate)):
        mask = networks.matte(plate, matte)
        plate = plate[..., :3]
    elif matte is not None and not automatic:
        raise ValueError("matte: expected no mask beside a matting model, which makes one")
    alpha = plate_coverage(plate, mask)
    size = tuple(alpha.shape)
    checked_albedo = None if albedo is None else provided_albedo(albedo, size)
    cleaned = clean_matte(alpha)
    provided: torch.Tensor | OnnxDepth | None = None
    if depth is not None:
        provided = OnnxDepth(depth) if is_path(depth) else checked_depth(depth, cleaned)
    if camera is not None and tuple(camera.size) != size:
        raise ValueError(f"camera: expected that of a plate of {size} pixels, got {camera.size}")
    camera = camera or Camera.of(cleaned, height, field_of_view)
    return AnalysisInputs(
        plate,
        alpha,
        cleaned,
        mask is not None,
        checked_number("feather", feather, 0, MAX_FEATHER * max(size)),
        checked_albedo,
        normals,
        provided,
        camera,
        place,
        old_light,
    )


def infer(
    given: AnalysisInputs, field: VisibilityNetwork | None = None, shader: ShadingNetwork | None = None
) -> AnalysisRecord:
    """Analyse a person: run each network once.

    `field` and `shader`: the networks of visibility and of shading, on the device of the inputs; those of
    `shadow.analysis.load` and `shading.diffuse.load` by default. Raises ValueError for normals or depth of
    another picture.
    """
    field = analysis.load(device=given.device) if field is None else field
    shader = diffuse.load(device=given.device) if shader is None else shader
    seen = None if given.normals is None else without_alpha(given.plate).to(given.device)
    normals = resolve(given.normals, seen, given.alpha.to(given.device), field, shader)

    alpha, edge = given.alpha, None
    if given.feather:
        # The networks, and the colour at the edge, have the matte as it is: a feathered one would say that
        # opaque pixels of the person show the background.
        edge = given.alpha
        alpha = torch.from_numpy(gaussian_filter(edge.numpy(), given.feather, mode="nearest"))
    person = Foreground.of(alpha, given.matte, given.has_mask, edge)
    colour = person.own_colour(given.plate)
    framed = Framed.of(colour, person.matte, field.size)
    normals = on_canvas(None if normals is None else person.crop(normals), framed.framing)
    inferred = Analysis(framed.to(given.device), field, shader, normals)

    exposure = GUIDE_MEAN / float(framed.rgb[:, framed.mask > 0.5].mean().clamp_min(1e-6))
    pixel_albedo = canvas_albedo = None
    if given.albedo is not None:
        cropped = person.crop(given.albedo)
        pixel_albedo = person.take(cropped)
        canvas_albedo = Framed.of(cropped, person.matte, field.size).rgb
    on_plate = framed.framing.shifted(person.left, person.top, person.size)
    depth, relative = given.depth, False
    if isinstance(depth, OnnxDepth):
        depth, relative = depth.depth(without_alpha(given.plate)), True
    elif depth is not None:
        relative = not depth.is_floating_point()  # a picture of depth
    geometry = WorldGeometry.of(
        inferred, given.camera, on_plate, given.matte, depth, relative, own_normals=normals is None
    )
    maps = AnalysisMaps.of(inferred, encode_guide(framed.rgb * exposure), canvas_albedo, geometry)
    old_light = given.old_light or OldLight()
    if maps.light is not None and given.old_light is None:
        old_light = OldLight.fit(maps.image, maps.light, maps.albedo, maps.normals, maps.known)
    maps, found = maps.without_tint(old_light), skin.find(maps.image, maps.known)
    face = None
    if found is not None:
        face, maps = found.face, maps.without_highlights(found)
    if maps.light is not None and given.old_light is None:
        old_light = old_light._replace(
            lightness=lightness.factor(
                maps.light, maps.albedo, maps.known, *lightness.exposure_of(given.plate), face
            )
        )
    own = person.take(colour)
    if maps.light is not None:
        own = denoised(own, exposure, person.pixels, framed.framing, maps.image, maps.known, maps.light)
    maps = maps.lightened(old_light.lightness)
    return AnalysisRecord(person, own, pixel_albedo, exposure, framed.framing, maps, old_light, face)
