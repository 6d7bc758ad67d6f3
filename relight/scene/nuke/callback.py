"""The callback of an exported group in Nuke, which moves its lights: the group holds the text of this file.

A light is three directions, its samples. For each, the weights of the principal components become a row of
the matrices of the light's ColorMatrix nodes. Nuke runs this text, followed by `update(nuke)`, when a knob or
an input of the group changes. It therefore needs nothing but the standard library of Python 3.7, Nuke 13's.
"""

from __future__ import annotations

import math
from typing import Any

LIGHTS = 4
LAYERS = 9  # of three components each: six of the cast shadow, three of the residual
SAMPLES = 3
KAPPA = 50.0  # of the anchors' kernels, as in shadow.networks.field
PLACE = (3, 7, 11)  # of the translation in a matrix of four rows


def samples(axis: tuple[float, float, float], angle: float) -> list[list[float]]:
    """Return three unit directions on a ring about a unit axis; they stand for a disc `angle` degrees wide.

    Half of the area of the disc is inside the ring.
    """
    along = (1 + math.cos(math.radians(angle) / 2)) / 2
    across = math.sqrt(max(0.0, 1 - along * along))
    x, y, z = axis
    least = min(range(3), key=lambda index: abs(axis[index]))
    aside = [(0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)][least]
    length = math.sqrt(sum(value * value for value in aside))
    a, b, c = (value / length for value in aside)
    third = (y * c - z * b, z * a - x * c, x * b - y * a)
    turns = [2 * math.pi * number / SAMPLES for number in range(SAMPLES)]
    return [
        [
            along * axis[i] + across * (math.cos(turn) * (a, b, c)[i] + math.sin(turn) * third[i])
            for i in range(3)
        ]
        for turn in turns
    ]


def weights(tables: list[float], toward: list[float]) -> list[float]:
    """Return the weights of the components for a unit direction.

    `tables` are the numbers of the group's knob of that name: the anchor directions (K, 3), and behind them
    the basis (K, 27).
    """
    width = 3 * LAYERS
    count = len(tables) // (3 + width)
    near = []
    for k in range(count):
        cosine = sum(tables[3 * k + i] * toward[i] for i in range(3))
        near.append(math.exp(KAPPA * (cosine - 1)))
    total = sum(near)
    mixed = [0.0] * width
    for k in range(count):
        if near[k] > 1e-9 * total:
            row = 3 * count + width * k
            for r in range(width):
                mixed[r] += near[k] / total * tables[row + r]
    return mixed


def matrices(tables: list[float], directions: list[list[float]]) -> list[list[float]]:
    """Return the matrices, row by row, of a light's nodes: `facing`, `toward`, then one for each layer."""
    mixed = [weights(tables, toward) for toward in directions]
    facing = [value for toward in directions for value in toward]
    frontal = [value for toward in directions for value in (toward[2], 0.0, 0.0)]
    return [facing, frontal] + [
        [row[3 * layer + i] for row in mixed for i in range(3)] for layer in range(LAYERS)
    ]


def direction(azimuth: float, elevation: float) -> tuple[float, float, float]:
    """Return the unit vector to a light, x to image right, y up, z to the camera, from angles in degrees."""
    turn, rise = math.radians(azimuth), math.radians(elevation)
    return (math.cos(rise) * math.sin(turn), math.sin(rise), math.cos(rise) * math.cos(turn))


def where(group: Any, light: int, frame: float) -> tuple[float, ...]:
    """Return a light's direction and softness at a frame: from the Axis on its input, else from its knobs."""
    names = ("azimuth", "elevation", "softness")
    azimuth, elevation, softness = (group[f"light{light}_{name}"].getValueAt(frame) for name in names)
    axis = group.input(light)
    toward = direction(azimuth, elevation)
    if axis is not None:
        point = [axis["world_matrix"].getValueAt(frame, index) for index in PLACE]
        length = math.sqrt(sum(value * value for value in point))
        toward = (point[0] / length, point[1] / length, point[2] / length) if length else (0.0, 0.0, 1.0)
    return (*toward, softness)


def update(nuke: Any) -> None:
    """Set the matrices of the lights that have moved; of those that are animated, at each frame.

    A light's `state` is where it was when its matrices were set.
    """
    group, root = nuke.thisNode(), nuke.root()
    frames = list(range(int(root["first_frame"].value()), int(root["last_frame"].value()) + 1))
    for light in range(1, LIGHTS + 1):
        places = [where(group, light, frame) for frame in frames]
        moving = any(place != places[0] for place in places)
        times, places = (frames, places) if moving else ([0], places[:1])
        state = repr((times, places))
        known = group[f"light{light}_state"]
        if known.value() == state:
            continue
        known.setValue(state)
        tables = [float(word) for word in group["tables"].value().split()]
        nodes = [group.node(f"light{light}_{layer}")["matrix"] for layer in range(LAYERS + 2)]
        for knob in nodes:
            knob.clearAnimated()
            if moving:
                knob.setAnimated()
        for time, (x, y, z, softness) in zip(times, places):  # noqa: B905 (Python 3.7)
            for knob, values in zip(nodes, matrices(tables, samples((x, y, z), softness))):  # noqa: B905 (Python 3.7)
                for index, value in enumerate(values):
                    if moving:
                        knob.setValueAt(value, time, index)
                    else:
                        knob.setValue(value, index)
