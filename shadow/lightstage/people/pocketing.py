"""Hands in pockets: where a hand lies on the hip, and the bulge that it makes in the cloth over it.

What covers the hand is not sewn for it: the hand swells the body, so that every garment at the hip, from
trousers to a coat, is draped over it. The fingers that nobody sees are left out.
"""

import numpy as np

from shadow.lightstage.figure import unit, vertex_normals
from shadow.lightstage.people.anatomy import LEGS, REGIONS, Person
from shadow.lightstage.people.hollows import Creases
from shadow.lightstage.people.skeleton import SIDES, Posing, turn

OPENING = 0.012  # metres from the wrist towards the fingers at which a pocket begins
AROUND = 62.0  # degrees from the front at which a side pocket is
SPAN = 0.012  # metres about the normal of a vertex in which the hand lifts it
LINING = 0.003  # metres of cloth over the hand
SMOOTHING = 4  # rounds in which the bulge slopes down to the hip around it


def slip(pose: Posing, side: str, person: Person) -> None:
    """Bring a hand of the pose flat onto the hip and upper thigh. person: the same pose, before that."""
    hip = person.skeleton.head(f"upperleg01.{side}")
    tights = person.base.tights
    posed = person.posed(tights.weights, person.tights_rest)
    normals = vertex_normals(posed, tights.faces)
    leg = LEGS["LR".index(side)]
    flank = person.tights_member[:, leg] + person.tights_member[:, 0] > 0.9
    out = np.array([SIDES[side] * np.sin(np.radians(AROUND)), 0, np.cos(np.radians(AROUND))])

    def on_hip(height: float, lifted: float) -> tuple[np.ndarray, np.ndarray]:
        level = flank & (np.abs(person.tights_rest[:, 1] - hip[1] - height) < 0.015)
        at = np.argmax(np.where(level, (person.tights_rest - hip) @ out, -np.inf))
        return posed[at] + lifted * normals[at], normals[at]

    wrist, outwards = on_hip(0.055 + pose.spread(0.012), 0.026)
    tips, below = on_hip(-0.085, 0.03)
    bone = {name: k for k, name in enumerate(person.base.names)}
    chest = person.transforms[bone[person.base.names[person.base.parents[bone[f"clavicle.{side}"]]]]]
    target = chest[:, :3].T @ (wrist - chest[:, 3])
    pose.hand_to(side, target, (0.8, 0.0, -1.0))
    pose.fingers(side, 2, 1)
    _lay(pose, side, unit(tips - wrist), -outwards - below)


def _lay(pose: Posing, side: str, along: np.ndarray, palm: np.ndarray) -> None:
    """Turn forearm and wrist until the hand points `along`, its palm facing `palm`, both in the world."""
    skeleton, head = pose.skeleton, pose.skeleton.head
    normal, _ = pose.palm(side)
    fingers = unit(head(f"finger3-1.{side}") - head(f"wrist.{side}"))
    before, after = _axes(fingers, normal), _axes(along, palm)
    for bone in ("lowerarm02", "wrist"):
        pose.rotations[f"{bone}.{side}"] = np.eye(3)
    forearm = skeleton.transforms(pose.rotations)[skeleton.names.index(f"lowerarm01.{side}"), :, :3]
    turned = forearm.T @ after @ before.T
    joints = pose.joints("arm", side)
    axis = unit(joints[2] - joints[1])
    # The part of the turn that is about the forearm's axis is its own; the wrist bends.
    helper = unit(np.cross(axis, [0.3, 0.2, 0.9]))
    moved = turned @ helper
    flat = unit(moved - (moved @ axis) * axis)
    twist = np.degrees(np.arctan2(np.cross(helper, flat) @ axis, helper @ flat))
    pose.rotations[f"lowerarm02.{side}"] = turn(axis, 0.7 * twist)
    pose.rotations[f"wrist.{side}"] = pose.rotations[f"lowerarm02.{side}"].T @ turned


def _axes(along: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """A rotation (3, 3) whose first column is `along`, and the second as near to `normal` as may be."""
    second = unit(normal - (normal @ along) * along)
    return np.stack([along, second, np.cross(along, second)], axis=1)


def inside(person: Person, side: str) -> np.ndarray:
    """Metres (V,) by which each vertex of the skin is in the pocket of a side, negative where it is not."""
    head, rest = person.skeleton.head, person.base.body.rows @ person.rest
    wrist, knuckle = head(f"wrist.{side}"), head(f"finger3-1.{side}")
    depth = (rest - wrist) @ unit(knuckle - wrist) - OPENING
    member = person.membership(person.base.body.weights)[:, REGIONS.index(f"arm.{side}")]
    return np.where(member > 0.5, depth, -1.0)


def bulge(person: Person) -> np.ndarray:
    """Metres (P,) by which hands in pockets lift cloth off the tights, along their normals."""
    tights, lifted = person.base.tights, np.zeros(len(person.tights_rest))
    if not person.pocketed:
        return lifted
    posed = person.posed(tights.weights, person.tights_rest)
    creases = Creases(tights.faces, len(posed))
    normals = vertex_normals(posed, tights.faces)
    for _ in range(6):
        normals = unit(creases.mean @ normals)
    skin = person.posed(person.base.body.weights, person.base.body.rows @ person.rest)
    for side in person.pocketed:
        hand = skin[inside(person, side) > 0]
        leg = LEGS["LR".index(side)]
        near = np.linalg.norm(posed[:, None] - hand[None, ::8], axis=2).min(axis=1) < 0.09
        near &= person.tights_member[:, leg] + person.tights_member[:, 0] > 0.9
        for at in np.flatnonzero(near):
            offset = hand - posed[at]
            height = offset @ normals[at]
            over = np.linalg.norm(offset - height[:, None] * normals[at], axis=1) < SPAN
            over &= height < 0.1
            lifted[at] = max(lifted[at], (height[over] + LINING).max(initial=0))
    for _ in range(SMOOTHING):
        lifted = np.maximum(lifted, creases.mean @ lifted)
    return lifted
