"""The layers that a compositor works with: light groups that sum to the picture, and what it is made of."""

import numpy as np

from relight.subject import by_name

PASSES = ("albedo", "N", "visibility", "shading")


def light_groups(subject, lights):
    """The person's picture and what each light gives to it.

    Parameters
    ----------
    subject: relight.Subject.
    lights: one light or more.

    Returns
    -------
    The picture (H, W, 4), linear, premultiplied, and its groups {"C_<light>": (H, W, 4)}, ready for `write`.
    The groups' values are rounded to half floats and the picture is their sum: so it still is when they come
    back from a half-float file. Each carries the matte as its alpha.

    Raises
    ------
    ValueError: no light, or two of one name. TypeError: not lights.
    """
    groups = {}
    for name, light in by_name(lights).items():
        layer = subject.relit(light)
        groups[f"C_{name}"] = half(layer)
    if not groups:
        raise ValueError("lights: expected at least one")
    picture = sum(groups.values())
    picture[..., 3] = layer[..., 3]  # coverage does not add up
    return picture, groups


def passes(subject, lights, names):
    """What the picture is made of, at the plate's size, zero outside the matte and not premultiplied.

    Parameters
    ----------
    subject: relight.Subject.
    lights: one light or more.
    names: any of
        "albedo": (H, W, 3), linear Rec.709.
        "N": (H, W, 3), normals in the camera frame: x right, y up, z to the camera.
        "visibility": for each light `visibility_<light>` (H, W), the share of it that no part of the person
            blocks.
        "shading": for each light `shading_<light>` (H, W, 3), what it would do to a white person: the light
            group is `albedo × shading_<light> × alpha`.

    Returns
    -------
    {layer name: array}, float32. Raises ValueError for other names.
    """
    check(names)
    layers = {"albedo": subject.albedo} if "albedo" in names else {}
    layers |= {"N": subject.normals} if "N" in names else {}
    lights = by_name(lights)
    if "visibility" in names:
        layers |= {f"visibility_{name}": subject.unshadowed(light) for name, light in lights.items()}
    if "shading" in names:
        layers |= {f"shading_{name}": subject.lighting(light) for name, light in lights.items()}
    return layers


def check(names):
    """ValueError unless all names are passes'."""
    for name in names:
        if name not in PASSES:
            raise ValueError(f"layers: expected any of {', '.join(PASSES)}, got {name!r}")


def half(values):
    """float32 values rounded to what a half float holds, unless one of them is too bright for it."""
    with np.errstate(over="ignore"):
        rounded = values.astype(np.float16)
    return rounded.astype(np.float32) if np.isfinite(rounded).all() else values
