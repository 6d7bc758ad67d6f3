"""Hands in pockets: the pose of the hand at the hip, and the bulge in the cloth over it.

No pocket is modelled. The hand enlarges the body, so that every garment at the hip, from trousers to a coat,
is draped over it. The hidden fingers are removed.
"""

import numpy as np
from scipy.spatial import cKDTree

from shadow.lightstage.figure import normalize, vertex_normals
from shadow.lightstage.people.body.anatomy import LEGS, REGIONS, Person
from shadow.lightstage.people.body.skeleton import SIDES, Pose, rotation
from shadow.lightstage.people.cloth.concavities import CreaseFilling

OPENING = 0.012  # metres from the wrist to the opening of the pocket
POCKET_AZIMUTH = 62.0  # degrees from the front
LIFT_RADIUS = 0.012  # metres around the normal of a vertex in which the hand lifts the vertex
LINING = 0.003  # metres of cloth over the hand
SMOOTHING_STEPS = 4  # in which the bulge falls off to the hip


def put_in(pose: Pose, side: str, person: Person) -> None:
    """Pose a hand flat on the hip and upper thigh. `person` has the pose before that."""
    hip = person.skeleton.head(f"upperleg01.{side}")
    tights = person.base.tights
    posed = person.posed(tights.weights, person.tights_rest)
    normals = vertex_normals(posed, tights.faces)
    leg = LEGS["LR".index(side)]
    flank = person.tights_regions[:, leg] + person.tights_regions[:, 0] > 0.9
    azimuth = np.radians(POCKET_AZIMUTH)
    out = np.array([SIDES[side] * np.sin(azimuth), 0, np.cos(azimuth)])

    def on_hip(height: float, lifted: float) -> tuple[np.ndarray, np.ndarray]:
        level = flank & (np.abs(person.tights_rest[:, 1] - hip[1] - height) < 0.015)
        at = np.argmax(np.where(level, (person.tights_rest - hip) @ out, -np.inf))
        return posed[at] + lifted * normals[at], normals[at]

    wrist, outwards = on_hip(0.055 + pose.jitter(0.012), 0.026)
    tips, below = on_hip(-0.085, 0.03)
    bone = {name: k for k, name in enumerate(person.base.names)}
    chest = person.transforms[bone[person.base.names[person.base.parents[bone[f"clavicle.{side}"]]]]]
    target = chest[:, :3].T @ (wrist - chest[:, 3])
    pose.hand_to(side, target, (0.8, 0.0, -1.0))
    pose.fingers(side, 2, 1)
    _orient_hand(pose, side, normalize(tips - wrist), -outwards - below)


def _orient_hand(pose: Pose, side: str, along: np.ndarray, palm: np.ndarray) -> None:
    """Rotate forearm and wrist: the hand points in the direction `along`, the palm faces `palm` (world)."""
    skeleton, head = pose.skeleton, pose.skeleton.head
    normal, _ = pose.palm(side)
    fingers = normalize(head(f"finger3-1.{side}") - head(f"wrist.{side}"))
    before, after = _axes(fingers, normal), _axes(along, palm)
    for bone in ("lowerarm02", "wrist"):
        pose.rotations[f"{bone}.{side}"] = np.eye(3)
    forearm = skeleton.transforms(pose.rotations)[skeleton.names.index(f"lowerarm01.{side}"), :, :3]
    turned = forearm.T @ after @ before.T
    joints = skeleton.limb("arm", side)
    axis = normalize(joints[2] - joints[1])
    # The forearm takes the rotation about its own axis, the wrist takes the rest.
    helper = normalize(np.cross(axis, [0.3, 0.2, 0.9]))
    moved = turned @ helper
    flat = normalize(moved - (moved @ axis) * axis)
    twist = np.degrees(np.arctan2(np.cross(helper, flat) @ axis, helper @ flat))
    pose.rotations[f"lowerarm02.{side}"] = rotation(axis, 0.7 * twist)
    pose.rotations[f"wrist.{side}"] = pose.rotations[f"lowerarm02.{side}"].T @ turned


def _axes(along: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) whose first column is `along` and whose second is closest to `normal`."""
    second = normalize(normal - (normal @ along) * along)
    return np.stack([along, second, np.cross(along, second)], axis=1)


def inside(person: Person, side: str) -> np.ndarray:
    """Return the depth (V,) in metres of each vertex of the skin in a pocket, negative outside it."""
    head, rest = person.skeleton.head, person.base.body.rows @ person.rest
    wrist, knuckle = head(f"wrist.{side}"), head(f"finger3-1.{side}")
    depth = (rest - wrist) @ normalize(knuckle - wrist) - OPENING
    member = person.region_weights(person.base.body.weights)[:, REGIONS.index(f"arm.{side}")]
    return np.where(member > 0.5, depth, -1.0)


def bulge(person: Person) -> np.ndarray:
    """Return the metres (P,) by which hands in pockets lift cloth off the tights, along the normals."""
    tights, lifted = person.base.tights, np.zeros(len(person.tights_rest))
    if not person.pocketed:
        return lifted
    posed = person.posed(tights.weights, person.tights_rest)
    creases = CreaseFilling(tights.faces, len(posed))
    normals = vertex_normals(posed, tights.faces)
    for _ in range(6):
        normals = normalize(creases.mean @ normals)
    skin = person.posed(person.base.body.weights, person.base.body.rows @ person.rest)
    for side in person.pocketed:
        hand = skin[inside(person, side) > 0]
        leg = LEGS["LR".index(side)]
        near = cKDTree(hand[::8]).query(posed)[0] < 0.09
        near &= person.tights_regions[:, leg] + person.tights_regions[:, 0] > 0.9
        for at in np.flatnonzero(near):
            offset = hand - posed[at]
            height = offset @ normals[at]
            over = np.linalg.norm(offset - height[:, None] * normals[at], axis=1) < LIFT_RADIUS
            over &= height < 0.1
            lifted[at] = max(lifted[at], (height[over] + LINING).max(initial=0))
    for _ in range(SMOOTHING_STEPS):
        lifted = np.maximum(lifted, creases.mean @ lifted)
    return lifted
