"""From a plate to what a `relight.Subject` is made of: checks, the networks, the canvas."""

import os
from collections.abc import Callable

import numpy as np
import torch

from relight.canvas import Canvas
from relight.depth import Camera, Space, given_depth
from relight.foreground import Foreground, given_albedo, matte_of, photograph, plate_of
from relight.keeping import Kept
from relight.upsampling import as_seen
from shading import Analysis, diffuse
from shadow import analysis, inputs
from shadow.foreign import OnnxDepth
from shadow.framing import Framed
from shadow.mattes import person_in
from shadow.normals import on_canvas, resolve

GREY = 0.2  # what guides are exposed to: the mean of the person's colour


def infer(
    image: np.ndarray,
    mask: np.ndarray | None,
    albedo: np.ndarray | None,
    normals: np.ndarray | Callable | str | os.PathLike | None,
    depth: np.ndarray | str | os.PathLike | None,
    height: float | None,
    field_of_view: float,
    camera: Camera | None,
    device: str | torch.device | None,
) -> Kept:
    """What the networks find of a person, each run once; arguments and errors are those of `relight.Subject`.

    All that can be wrong with the arguments is found before the networks run.
    """
    place = inputs.device("device", device) or torch.device("cpu")
    pixels = plate_of(image)
    alpha = matte_of(pixels, mask)
    paint = None if albedo is None else given_albedo(albedo, tuple(alpha.shape))
    relative = isinstance(depth, str | os.PathLike)
    model = OnnxDepth(depth) if isinstance(depth, str | os.PathLike) else None
    away = None if depth is None or relative else given_depth(depth, tuple(alpha.shape))
    person_matte = person_in(alpha)
    camera = camera or Camera.of(person_matte, height, field_of_view)
    field, shader = analysis.load(device=place), diffuse.load(device=place)
    seen = None if normals is None else photograph(pixels).to(place)
    surface = resolve(normals, seen, alpha.to(place), field, shader)

    person = Foreground.of(alpha, person_matte, mask is not None)
    colour = person.own_colour(pixels)
    framed = Framed.of(colour, person.matte, field.size)
    surface = on_canvas(None if surface is None else person.crop(surface), framed.framing)
    found = Analysis(framed.to(place), field, shader, surface)

    exposure = GREY / float(framed.rgb[:, framed.mask > 0.5].mean().clamp_min(1e-6))
    given = None
    if paint is not None:
        paint = person.crop(paint)
        given = person.take(paint)
        paint = Framed.of(paint, person.matte, field.size).rgb
    on_plate = framed.framing.shifted(person.left, person.top, person.size)
    away = away if model is None else model.depth(photograph(pixels))
    space = Space.of(found, camera, on_plate, person_matte, away, relative, surface is None)
    canvas = Canvas.of(found, as_seen(framed.rgb * exposure), paint, space)
    return Kept(person, person.take(colour), given, exposure, framed.framing, canvas)
