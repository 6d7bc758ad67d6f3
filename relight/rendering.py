"""Lights in, picture out; and its layers: light groups that sum to the picture, and passes it is made of."""

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import torch

from relight.composite import behind, over
from relight.floor import Floor
from relight.lights.environment import FIELD_OF_VIEW, EnvironmentLight
from relight.lights.light import Light, by_name
from relight.media.images import Metadata, half
from relight.subject import Subject

PASSES = ("albedo", "N", "Z", "visibility", "shading")
EXR_TYPES = ("half", "float")

Background = np.ndarray | Sequence[float] | EnvironmentLight
Layers = dict[str, np.ndarray]


def apply(
    image: np.ndarray,
    lights: Light | Iterable[Light],
    *,
    background: Background | None = None,
    mask: np.ndarray | None = None,
    albedo: np.ndarray | None = None,
    normals: np.ndarray | Callable | str | os.PathLike | None = None,
    depth: np.ndarray | str | os.PathLike | None = None,
    height: float | None = None,
    field_of_view: float = FIELD_OF_VIEW,
    floor: Floor | None = None,
    device: str | torch.device | None = None,
) -> np.ndarray:
    """Relight the person in an image.

    Parameters
    ----------
    image: (H, W, 3|4). Integers are sRGB-encoded with straight alpha; floats linear Rec.709, premultiplied.
    lights: a light, or any number of them.
    background: image of any size, fitted to cover the frame; a linear (r, g, b); or a
        relight.EnvironmentLight, as a camera sees it (see `over`). None keeps the alpha.
    mask: (H, W) in [0, 1], the matte of the person; needed unless the image has alpha.
    albedo: (H, W, 3) to use instead of inferring it.
    normals: (H, W, 3) camera-frame normals to use instead of inferring them; or anything else that
        `shadow.normals.load` takes.
    depth, height, field_of_view: of the person and the photograph's camera, which lights in the room need; as
        of `relight.Subject`.
    floor: relight.Floor that the person stands on: their shadow falls on the background.
    device: where the networks run, such as "cuda"; the CPU unless given.

    Returns
    -------
    (H, W, 4) float32, linear Rec.709, premultiplied; or (H, W, 3) over a background. Exactly linear in the
    lights' intensities, unbounded.

    Raises
    ------
    TypeError, ValueError: as `Subject`, `Subject.relit` and `over` do.
    """
    if floor is not None:
        floor.check(image, mask)
    subject = Subject(
        image, mask, albedo, normals, depth=depth, height=height, field_of_view=field_of_view, device=device
    )
    picture = subject.relit(lights)
    if background is None:
        return picture
    return over(picture, background, None if floor is None else subject.shadows(lights, floor)[1])


def render(
    image: np.ndarray,
    lights: Light | Iterable[Light],
    *,
    background: Background | None = None,
    mask: np.ndarray | None = None,
    albedo: np.ndarray | None = None,
    normals: np.ndarray | Callable | str | os.PathLike | None = None,
    depth: np.ndarray | str | os.PathLike | None = None,
    height: float | None = None,
    field_of_view: float = FIELD_OF_VIEW,
    passes: Iterable[str] = (),
    exr_type: str = "half",
    floor: Floor | None = None,
    device: str | torch.device | None = None,
) -> tuple[np.ndarray, Layers]:
    """As `apply`, and the same picture in layers: what an OpenEXR file is written from.

    Parameters
    ----------
    As `apply`'s; and
    passes: what the picture is made of, any of "albedo", "N", "Z", "visibility", "shading" (see `passes_of`).
    exr_type: "half" or "float", what the file will hold: the picture is the sum of groups rounded to it.

    Returns
    -------
    The picture and its layers, as `render_subject` returns them.

    Raises
    ------
    TypeError, ValueError: as `apply` and `render_subject` do.
    """
    lights = list(by_name(lights).values())  # what is wrong with them is said before the networks run
    passes = check_names(passes)
    check_exr_type(exr_type)
    if floor is not None:
        floor.check(image, mask)
    subject = Subject(
        image, mask, albedo, normals, depth=depth, height=height, field_of_view=field_of_view, device=device
    )
    return render_subject(
        subject, lights, background=background, passes=passes, exr_type=exr_type, floor=floor
    )


def render_subject(
    subject: Subject,
    lights: Light | Iterable[Light],
    *,
    background: Background | None = None,
    passes: Iterable[str] = (),
    exr_type: str = "half",
    floor: Floor | None = None,
) -> tuple[np.ndarray, Layers]:
    """A picture of an analysed person, and its layers.

    Parameters
    ----------
    subject: relight.Subject.
    lights: one light or more.
    background: as of `apply`.
    passes: further layers, of PASSES.
    exr_type: as of `render`.
    floor: as of `apply`.

    Returns
    -------
    The picture, as `apply` returns it, and its layers, ready for `write`: light groups "C_<light>" (H, W, 4)
    whose colours, so rounded, sum to the picture's; over a background one more, "C_background" (H, W, 3),
    what is seen of it; and the passes (see `passes_of`). On a floor "shadow_floor_<light>" (H, W, 3) too, by
    which the background would be multiplied if there were no other light; "C_background" has the shadow of
    all lights in it.

    Raises
    ------
    ValueError: no light, two lights of one name, an unknown pass.
    """
    passes = check_names(passes)
    picture, groups = light_groups(subject, lights, exr_type)
    further, shadow = passes_of(subject, lights, passes), None
    if floor is not None:
        each, shadow = subject.shadows(lights, floor)
        further |= {f"shadow_floor_{name}": layer for name, layer in each.items()}
    if background is None:
        return picture, groups | further
    check_free(by_name(lights))
    groups["C_background"] = _rounded(behind(picture, background, shadow), "C_background", exr_type)
    return picture[..., :3] + groups["C_background"], groups | further


def light_groups(
    subject: Subject, lights: Light | Iterable[Light], exr_type: str = "half"
) -> tuple[np.ndarray, Layers]:
    """The person's picture and what each light gives to it.

    Parameters
    ----------
    subject: relight.Subject.
    lights: one light or more.
    exr_type: as of `render`.

    Returns
    -------
    The picture (H, W, 4), linear, premultiplied, and its groups {"C_<light>": (H, W, 4)}, ready for `write`.
    For half-float files the groups' values are rounded and the picture is their sum: so it still is when they
    come back from the file. Each carries the matte as its alpha.

    Raises
    ------
    ValueError: no light, or two of one name. TypeError: not lights.
    """
    groups, colour = {}, torch.zeros(())
    for name, layer in subject.pixels_in_each(lights):
        group = torch.from_numpy(_rounded(layer.numpy(), f"C_{name}", exr_type))
        colour = colour + group[:, :3]
        groups[f"C_{name}"] = subject.on_plate(group)
    if not groups:
        raise ValueError("lights: expected at least one")
    return subject.on_plate(torch.cat([colour, layer[:, 3:]], dim=1)), groups  # coverage does not add up


def _rounded(values: np.ndarray, name: str, exr_type: str) -> np.ndarray:
    """A layer (..., C) as a file of that kind holds it."""
    return half(values, name) if exr_type == "half" else values


def check_exr_type(exr_type: str) -> None:
    """ValueError for what a layered file does not hold."""
    if exr_type not in EXR_TYPES:
        raise ValueError(f"exr_type: expected {' or '.join(EXR_TYPES)}, got {exr_type!r}")


def passes_of(subject: Subject, lights: Light | Iterable[Light], names: Iterable[str]) -> Layers:
    """What the picture is made of, at the plate's size, zero outside the matte and not premultiplied.

    Parameters
    ----------
    subject: relight.Subject.
    lights: one light or more.
    names: any of
        "albedo": (H, W, 3), linear Rec.709.
        "N": (H, W, 3), normals in the camera frame: x right, y up, z to the camera.
        "Z": (H, W), metres from the camera along its axis; see `described` for where the origin lies.
        "visibility": for each light `visibility_<light>` (H, W), the share of it that no part of the person
            blocks.
        "shading": for each light `shading_<light>` (H, W, 3), what it would do to a white person: the light
            group is `albedo × shading_<light> × alpha`.

    Returns
    -------
    {layer name: array}, float32. Raises ValueError for other names.
    """
    names = check_names(names)
    layers = {"albedo": subject.albedo} if "albedo" in names else {}
    layers |= {"N": subject.normals} if "N" in names else {}
    if "Z" in names:
        layers["Z"] = np.where(subject.matte > 0, subject.distance + subject.depth, np.float32(0))
    named = by_name(lights)
    if "visibility" in names:
        layers |= {f"visibility_{name}": subject.unshadowed(light) for name, light in named.items()}
    if "shading" in names:
        layers |= {f"shading_{name}": subject.lighting(light) for name, light in named.items()}
    return layers


def described(subject: Subject, passes: Iterable[str]) -> Metadata:
    """What a file's header says of its passes: of Z, `relight:distance`, metres from the camera to the origin
    of the room, and `relight:focal_length` in pixels, which with Z and a pixel give a position."""
    if "Z" not in passes:
        return {}
    return {"relight:distance": subject.distance, "relight:focal_length": subject.camera.focal}


def check_names(names: Iterable[str], outputs: Iterable[Path] | None = None) -> tuple[str, ...]:
    """The names of passes, checked: ValueError unless all are passes'; or, of a picture that goes to files
    alone, where no .exr among these outputs holds them."""
    names = tuple(names)
    for name in names:
        if name not in PASSES:
            raise ValueError(f"passes: expected any of {', '.join(PASSES)}, got {name!r}")
    if names and outputs is not None and not any(path.suffix.lower() == ".exr" for path in outputs):
        raise ValueError("passes: are layers of an .exr; expected one among the outputs")
    return names


def check_free(names: Iterable[str]) -> None:
    """ValueError where a light over a background has the name of the background's layer."""
    if "background" in names:
        raise ValueError("lights: 'background' names the background's layer; give the light another name")
