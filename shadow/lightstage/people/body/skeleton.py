"""The skeleton at rest, and poses: rotations of its bones.

A rotation is about axes of the rest pose (x to the person's left, y up, z forward), relative to the parent of
the bone. Arms and legs are posed by the directions of their two bones, or by a target for the hand, in the
frame of the chest (arms) or the pelvis (legs). Elbows and knees therefore stay hinges.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from shadow.lightstage.figure import normalize

SIDES = {"L": 1.0, "R": -1.0}
LIMBS = {"arm": ("upperarm01", "lowerarm01", "wrist"), "leg": ("upperleg01", "lowerleg01", "foot")}
BEHIND_ANKLE = 0.03  # metres from the ankle back to the middle of the heel


@dataclass(frozen=True)
class Skeleton:
    """The bones at rest, parents first: heads (J, 3) in metres, parent indices (-1: root) and names."""

    heads: np.ndarray
    parents: list[int]
    names: list[str]

    def head(self, name: str) -> np.ndarray:
        """Return the position (3,) of the head (the first joint) of a bone at rest."""
        return self.heads[self.names.index(name)]

    def limb(self, kind: str, side: str) -> np.ndarray:
        """Return the three joints (3, 3) of an "arm" or a "leg" at rest."""
        return np.stack([self.head(f"{name}.{side}") for name in LIMBS[kind]])

    def transforms(self, rotations: dict[str, np.ndarray]) -> np.ndarray:
        """Return the transforms (J, 3, 4) of the bones from rest to the pose, given {bone: rotation}."""
        result = np.zeros((len(self.names), 3, 4))
        for j, (name, parent) in enumerate(zip(self.names, self.parents, strict=True)):
            above = result[parent] if parent >= 0 else np.eye(3, 4)
            turn = rotations.get(name, np.eye(3))
            result[j, :, :3] = above[:, :3] @ turn
            pivot = above[:, :3] @ self.heads[j] + above[:, 3]
            result[j, :, 3] = pivot - result[j, :, :3] @ self.heads[j]
        return result


def rotation(axis: np.ndarray | tuple[float, float, float], degrees: float) -> np.ndarray:
    """Return the right-handed rotation (3, 3) about an axis."""
    x, y, z = normalize(np.asarray(axis, float))
    angle = np.radians(degrees)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def euler(pitch: float, yaw: float, roll: float) -> np.ndarray:
    """Return the rotation (3, 3) of angles in degrees.

    Pitch bows forward, yaw turns to the person's left, roll leans to the person's right.
    """
    return rotation((0, 1, 0), yaw) @ rotation((1, 0, 0), pitch) @ rotation((0, 0, 1), roll)


def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the smallest rotation (3, 3) that turns direction a to direction b."""
    axis = np.cross(a, b)
    if np.linalg.norm(axis) < 1e-8:
        return np.eye(3)
    return rotation(axis, np.degrees(np.arctan2(np.linalg.norm(axis), a @ b)))


def reach(
    start: np.ndarray, target: np.ndarray, upper: float, lower: float, hint: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solve two-bone inverse kinematics: return the directions of the upper and the lower bone.

    The end of the limb comes to `target`, as far as the bones (lengths in metres) reach. The middle joint
    bends toward `hint`.
    """
    gap = target - start
    distance = np.clip(np.linalg.norm(gap), abs(upper - lower) * 1.05 + 0.02, (upper + lower) * 0.995)
    forward = normalize(gap)
    side = normalize(hint - (hint @ forward) * forward)
    cosine = np.clip((upper**2 + distance**2 - lower**2) / (2 * upper * distance), -1, 1)
    joint = upper * (cosine * forward + np.sqrt(1 - cosine**2) * side)
    return normalize(joint), normalize(distance * forward - joint)


def _limb(rest: np.ndarray, upper: np.ndarray, lower: np.ndarray, hinge: np.ndarray) -> tuple:
    """Return the rotations of a limb's upper bone, its twist bone and its lower bone for two directions.

    rest: (3, 3) joints. hinge: the axis about which the middle joint bends at rest, and also in the pose.
    """
    rest_upper, rest_lower = normalize(rest[1] - rest[0]), normalize(rest[2] - rest[1])
    swing = between(rest_upper, upper)
    carried = swing @ hinge
    posed_hinge = np.cross(upper, lower)
    bend = np.linalg.norm(posed_hinge)
    flat = carried - (carried @ upper) * upper
    twist_angle = 0.0
    if bend > 1e-6:
        wanted = posed_hinge / bend
        twist_angle = np.degrees(np.arctan2(np.cross(flat, wanted) @ upper, flat @ wanted))
        # The plane of a nearly straight limb is undefined.
        twist_angle = np.clip(twist_angle * min(1.0, bend / 0.25), -110, 110)
    first = rotation(upper, 0.5 * twist_angle) @ swing
    second = swing.T @ rotation(upper, 0.5 * twist_angle) @ swing
    above = first @ second
    third = above.T @ between(above @ rest_lower, lower) @ above
    return first, second, third


class Pose:
    """A pose under construction: each method adds to its `rotations`, {bone: (3, 3)}."""

    def __init__(self, skeleton: Skeleton, rng: np.random.Generator) -> None:
        self.skeleton, self.rng = skeleton, rng
        self.rotations: dict[str, np.ndarray] = {}
        self.arms: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.held: dict[str, str] = {}  # {"L", "R" or "both": key of `held.SIZES`}
        self.seated = False
        self.pocketed: list[str] = []  # sides whose hand is in a pocket at the hip
        self.heel = 0.0  # metres from the height of the ball of the foot to that of the heel

    def jitter(self, scale: float) -> float:
        """Draw a normal variate with standard deviation `scale`, clipped at 2.2 deviations."""
        return float(np.clip(self.rng.normal(), -2.2, 2.2) * scale)

    def torso(self, pitch: float = 0, yaw: float = 0, roll: float = 0) -> None:
        """Bend the spine by angles in degrees, distributed over its bones."""
        for bone, share in (("spine04", 0.25), ("spine03", 0.3), ("spine02", 0.3), ("spine01", 0.15)):
            self.rotations[bone] = euler(pitch * share, yaw * share, roll * share)

    def pelvis(self, pitch: float = 0, yaw: float = 0, roll: float = 0) -> None:
        """Rotate the whole body by angles in degrees."""
        self.rotations["root"] = euler(pitch, yaw, roll)

    def head(self, pitch: float = 0, yaw: float = 0, roll: float = 0) -> None:
        """Rotate the head by angles in degrees, distributed over neck and head."""
        for bone, share in (("neck01", 0.2), ("neck02", 0.2), ("neck03", 0.2), ("head", 0.4)):
            self.rotations[bone] = euler(pitch * share, yaw * share, roll * share)

    def arm(self, side: str, upper: ArrayLike, lower: ArrayLike, pronation: float = 0) -> None:
        """Pose an arm by the directions of its bones, in the chest frame with x away from the body.

        pronation: degrees.
        """
        mirror = np.array([SIDES[side], 1, 1])
        self.aim_arm(
            side, normalize(np.asarray(upper, float) * mirror), normalize(np.asarray(lower, float) * mirror)
        )
        self.pronate(side, pronation)

    def aim_arm(self, side: str, upper: np.ndarray, lower: np.ndarray) -> None:
        """Pose an arm by the unit directions of its upper and lower bone, in the chest frame."""
        self.arms[side] = upper, lower
        raised = np.clip(np.degrees(np.arcsin(upper[1])) + 20, 0, 60) * 0.4
        shoulder = rotation((0, 0, 1), SIDES[side] * raised)
        self.rotations[f"clavicle.{side}"] = shoulder
        joints = self.skeleton.limb("arm", side)
        hinge = normalize(np.cross(joints[1] - joints[0], joints[2] - joints[1]))
        first, second, third = _limb(joints, shoulder.T @ upper, shoulder.T @ lower, hinge)
        self.rotations[f"upperarm01.{side}"] = first
        self.rotations[f"upperarm02.{side}"] = second
        self.rotations[f"lowerarm01.{side}"] = third

    def hand_to(self, side: str, target: np.ndarray, hint: tuple, pronation: float = 0) -> None:
        """Bring the wrist to a point of the rest chest frame.

        hint: the direction of the elbow, with x away from the body. pronation: degrees.
        """
        joints = self.skeleton.limb("arm", side)
        upper, lower = (float(np.linalg.norm(joints[k + 1] - joints[k])) for k in (0, 1))
        directions = reach(joints[0], target, upper, lower, np.asarray(hint, float) * [SIDES[side], 1, 1])
        self.aim_arm(side, *directions)
        self.pronate(side, pronation)

    def pronate(self, side: str, degrees: float) -> None:
        """Rotate forearm and wrist about the axis of the forearm."""
        joints = self.skeleton.limb("arm", side)
        axis = normalize(joints[2] - joints[1])
        angle = SIDES[side] * (degrees + self.jitter(12))
        self.rotations[f"lowerarm02.{side}"] = rotation(axis, 0.6 * angle)
        bend = rotation(self.palm(side)[1], self.jitter(14)) @ rotation(axis, 0.4 * angle)
        self.rotations[f"wrist.{side}"] = bend

    def palm(self, side: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the normal of the palm at rest, and the axis about which the fingers curl toward it."""
        head = self.skeleton.head
        knuckles = head(f"finger2-1.{side}") - head(f"finger5-1.{side}")
        along = head(f"finger3-1.{side}") - head(f"wrist.{side}")
        normal = SIDES[side] * normalize(np.cross(along, knuckles))
        return normal, normalize(np.cross(along, normal))

    def fingers(self, side: str, curl: float, spread: float) -> None:
        """Pose the fingers: `curl` in degrees for each joint (20 is relaxed, 80 a fist), `spread` in degrees
        between neighbouring fingers."""
        normal, axis = self.palm(side)
        for finger in range(2, 6):
            own = curl * self.rng.uniform(0.75, 1.25) + (finger - 2) * curl * 0.08
            for joint in (1, 2, 3):
                self.rotations[f"finger{finger}-{joint}.{side}"] = rotation(
                    axis, own * (0.85, 1.1, 0.7)[joint - 1]
                )
            splay = rotation(normal, SIDES[side] * spread * (3.5 - finger))
            self.rotations[f"finger{finger}-1.{side}"] = splay @ self.rotations[f"finger{finger}-1.{side}"]
        for joint in (2, 3):
            self.rotations[f"finger1-{joint}.{side}"] = rotation(axis, min(curl, 50) * 0.5)

    def leg(self, side: str, pitch: float, knee: float, out: float = 4, yaw: float = 6) -> None:
        """Pose a leg by angles in degrees.

        `pitch` lifts the thigh forward, `knee` bends the knee, `out` swings the leg sideways, `yaw` turns it
        outward.
        """
        joints = self.skeleton.limb("leg", side)
        sign = SIDES[side]
        facing = rotation((0, 1, 0), sign * yaw)
        rest_out = np.degrees(np.arctan2(abs(joints[2, 0] - joints[0, 0]), joints[0, 1] - joints[2, 1]))
        across = rotation((0, 0, 1), sign * (out - rest_out))
        thigh = facing @ rotation((1, 0, 0), -pitch) @ across
        self.rotations[f"upperleg01.{side}"] = thigh
        self.rotations[f"lowerleg01.{side}"] = rotation((1, 0, 0), knee)
        # The sole stays level near the ground, and the toes point down if the leg is lifted.
        level = (thigh @ self.rotations[f"lowerleg01.{side}"]).T @ facing
        self.rotations[f"foot.{side}"] = level if abs(pitch - knee) < 65 else rotation((1, 0, 0), 25)

    def raise_heels(self, metres: float) -> None:
        """Raise the heels by `metres` above the balls of the feet; the toes stay level."""
        self.heel = metres
        for side in "LR":
            ankle, ball = self.skeleton.head(f"foot.{side}"), self.skeleton.head(f"toe2-1.{side}")
            forward = (ball - ankle) * [1, 0, 1]
            length = np.linalg.norm(forward) + BEHIND_ANKLE
            axis = np.cross([0, 1.0, 0], forward)
            angle = np.degrees(np.arcsin(min(float(metres / length), 0.6)))
            level = self.rotations.get(f"foot.{side}", np.eye(3))
            self.rotations[f"foot.{side}"] = level @ rotation(axis, angle)
            for toe in range(1, 6):
                self.rotations[f"toe{toe}-1.{side}"] = rotation(axis, -angle)

    def keep_arms_off(self, points: np.ndarray, normals: np.ndarray, ease: float) -> None:
        """Swing the arms outward until elbow and forearm are `ease` metres off the torso.

        points, normals (P, 3): the surface of the torso in the rest chest frame.
        """
        for side, (upper, lower) in list(self.arms.items()):
            joints = self.skeleton.limb("arm", side)
            lengths = [np.linalg.norm(joints[k + 1] - joints[k]) for k in (0, 1)]
            for _ in range(6):
                elbow = joints[0] + lengths[0] * upper
                worst = 0.0
                for share, radius in ((0.0, 0.05), (0.5, 0.045), (1.0, 0.035), (1.35, 0.04), (1.6, 0.03)):
                    point = elbow + lower * lengths[1] * share
                    nearest = np.argmin(((points - point) ** 2).sum(axis=1))
                    depth = radius + ease - (point - points[nearest]) @ normals[nearest]
                    if not 0.002 < depth < 0.25:
                        continue
                    push = normals[nearest] * depth
                    worst = max(worst, depth)
                    # A push at the hand rotates the forearm, and the upper arm half as much.
                    lower = normalize(lower * lengths[1] + push * min(1, share + 0.2))
                    upper = normalize(upper * lengths[0] + push * (1.1 - min(share, 0.8)))
                    elbow = joints[0] + lengths[0] * upper
                if worst == 0:
                    break
            self.aim_arm(side, upper, lower)
