"""Random poses: how people stand, walk, sit and gesture in photographs."""

from collections.abc import Callable

import numpy as np

from shadow.lightstage.people.body.skeleton import SIDES, Pose, Skeleton, rotation


def draw(skeleton: Skeleton, rng: np.random.Generator) -> Pose:
    """Draw a random pose, about a quarter of them lively."""
    pose = Pose(skeleton, rng)
    lively = rng.random() < 0.22
    calm = [_stand] * 3 + [_contrapposto] * 3 + [_walk] * 2 + [_wide, seated_legs]
    legs = [seated_legs, _kneel, _run, _lunge, _lift, _wide, _walk] if lively else calm
    legs[rng.choice(len(legs))](pose)
    _torso(pose, lively)
    for side in "LR":
        curls = [(18, 2), (30, 0), (75, 0), (6, 9), (3, 16)]  # relaxed, hooked, a fist, open, spread wide
        pose.fingers(side, *curls[rng.choice(5, p=[0.42, 0.23, 0.12, 0.11, 0.12])])
    both = rng.random() < 0.4
    arms, weights = list(_ARMS), np.array([chances[lively] for chances in _ARMS.values()])
    arm = arms[rng.choice(len(arms), p=weights / weights.sum())]
    if arm in _BOTH:
        arm(pose)
        return pose
    for side in rng.permutation(["L", "R"]):
        arm(pose, str(side))
        if not both:
            arm = arms[rng.choice(len(arms), p=weights / weights.sum())]
            while arm in _BOTH:
                arm = arms[rng.choice(len(arms), p=weights / weights.sum())]
    return pose


def stand(skeleton: Skeleton, rng: np.random.Generator) -> Pose:
    """Draw a calm stand with hanging arms, the start of a pose of a pair."""
    pose = Pose(skeleton, rng)
    (_stand if rng.random() < 0.5 else _contrapposto)(pose)
    _torso(pose, lively=False)
    for side in "LR":
        arms_down(pose, side)
        pose.fingers(side, 22, 1)
    return pose


def _torso(pose: Pose, lively: bool) -> None:
    scale = 2.2 if lively else 1.0
    pose.torso(
        pose.jitter(5 * scale) + 2 + 12 * lively * pose.rng.random(),
        pose.jitter(9 * scale),
        pose.jitter(4 * scale),
    )
    # Heads look about, nod and look up; now and then over a shoulder.
    far = pose.rng.random()
    nod, yaw = (14, 30) if far < 0.35 else (7, 14)
    pose.head(pose.jitter(nod) + 4, pose.jitter(yaw), pose.jitter(8 if far < 0.35 else 5))
    if "root" not in pose.rotations:
        pose.pelvis(pose.jitter(2), pose.jitter(10), pose.jitter(1.5))


# Legs ------------------------------------------------------------------------------------------------------


def _stand(pose: Pose) -> None:
    out = pose.rng.uniform(0, 6)
    for side in "LR":
        pose.leg(side, pose.jitter(3), abs(pose.jitter(4)), out + pose.jitter(1.5), 8 + pose.jitter(7))


def _contrapposto(pose: Pose) -> None:
    relaxed, loaded = pose.rng.permutation(["L", "R"])
    tilt = pose.rng.uniform(3, 8) * SIDES[loaded]
    pose.pelvis(0, pose.jitter(10), tilt)
    pose.leg(loaded, 0, 0, 2 - abs(tilt) * 0.6, 8)
    bend = pose.rng.uniform(12, 30)
    pose.leg(relaxed, bend, bend * 1.6, 7 + abs(tilt) * 0.6 + pose.jitter(3), 18 + pose.jitter(8))


def _walk(pose: Pose) -> None:
    stride = pose.rng.uniform(12, 28)
    front, back = pose.rng.permutation(["L", "R"])
    pose.pelvis(3, pose.jitter(8), pose.jitter(2))
    pose.leg(front, stride, pose.rng.uniform(3, 15), 2, 5)
    pose.leg(back, -stride * 0.7, pose.rng.uniform(5, 35), 2, 8)


def _run(pose: Pose) -> None:
    front, back = pose.rng.permutation(["L", "R"])
    pose.pelvis(10, pose.jitter(12), pose.jitter(3))
    pose.leg(front, pose.rng.uniform(45, 75), pose.rng.uniform(50, 100), 3, 3)
    pose.leg(back, -pose.rng.uniform(5, 25), pose.rng.uniform(15, 80), 3, 5)


def _lunge(pose: Pose) -> None:
    front, back = pose.rng.permutation(["L", "R"])
    pose.pelvis(8, pose.jitter(15), pose.jitter(3))
    bend = pose.rng.uniform(35, 65)
    pose.leg(front, bend, bend * 1.05, 8, 10)
    pose.leg(back, -pose.rng.uniform(15, 30), pose.rng.uniform(5, 25), 8, 15)


def _lift(pose: Pose) -> None:
    up, down = pose.rng.permutation(["L", "R"])
    pose.pelvis(0, pose.jitter(10), -3 * SIDES[up])
    pose.leg(down, 0, 3, 0, 8)
    pose.leg(up, pose.rng.uniform(40, 90), pose.rng.uniform(50, 110), 8 + pose.rng.uniform(0, 20), 15)


def _wide(pose: Pose) -> None:
    out = pose.rng.uniform(9, 19)
    bend = pose.rng.uniform(0, 22)
    for side in "LR":
        pose.leg(side, bend, bend * 1.8, out + pose.jitter(3), 15 + pose.jitter(6))


def seated_legs(pose: Pose) -> None:
    pose.seated = True
    pose.pelvis(-4 + pose.jitter(5), pose.jitter(12), pose.jitter(2))
    out = pose.rng.uniform(2, 20)
    for side in "LR":
        thigh = 78 + pose.jitter(8)
        pose.leg(side, thigh, thigh + pose.jitter(12), out + pose.jitter(4), out + pose.jitter(5))


def _kneel(pose: Pose) -> None:
    up, down = pose.rng.permutation(["L", "R"])
    pose.pelvis(pose.jitter(6), pose.jitter(15), pose.jitter(2))
    pose.leg(up, 85 + pose.jitter(6), 92 + pose.jitter(6), 6, 8)
    pose.leg(down, 2 + pose.jitter(5), 95, 4, 4)


# Arms: targets are points near the trunk in the rest pose -------------------------------------------------


Range = tuple[float, float]


def _near(pose: Pose, side: str, joint: str, x: Range, y: Range, z: Range) -> np.ndarray:
    """Draw a point (3,) near a joint, with offsets in these ranges, in metres; x is away from the body."""
    offset = [pose.rng.uniform(*each) for each in (x, y, z)]
    return pose.skeleton.head(joint) + np.array([SIDES[side], 1, 1]) * offset


def arms_down(pose: Pose, side: str) -> None:
    bend = abs(pose.jitter(12)) + 6
    swing = pose.jitter(12)
    upper = rotation((1, 0, 0), -swing) @ np.array([0.16 + 0.06 * pose.rng.random(), -1, 0.0])
    lower = rotation((1, 0, 0), -swing - bend) @ np.array([0.08, -1, 0.0])
    pose.arm(side, upper, lower, pose.jitter(25))


def _swung(pose: Pose, side: str) -> None:
    swing, bend = pose.jitter(28), pose.rng.uniform(15, 95)
    upper = rotation((1, 0, 0), -swing) @ np.array([0.2, -1, 0.0])
    lower = rotation((1, 0, 0), -swing - bend) @ np.array([0.02, -1, 0.0])
    pose.arm(side, upper, lower, 20)


def _akimbo(pose: Pose, side: str) -> None:
    hip = pose.skeleton.head(f"upperleg01.{side}")
    target = hip + [
        SIDES[side] * (0.085 + pose.jitter(0.01)),
        0.11 + pose.jitter(0.03),
        0.03 + pose.jitter(0.03),
    ]
    pose.hand_to(side, target, (1.0, 0.0, -0.45 + pose.jitter(0.2)), pose.jitter(25))
    pose.fingers(side, *[(70, 0), (30, 2)][pose.rng.integers(2)])


def hand_in_pocket(pose: Pose, side: str) -> None:
    """Mark a hand that `pockets.put_in` puts into a pocket, once the hip is posed."""
    if pose.seated:
        _held_in_front(pose, side)
        return
    arms_down(pose, side)
    pose.pocketed.append(side)


def _across(pose: Pose, side: str) -> None:
    other = "R" if side == "L" else "L"
    target = _near(pose, other, "spine02", (-0.02, 0.12), (-0.12, 0.18), (0.16, 0.24))
    pose.hand_to(side, target, (1.0, -0.9 + pose.jitter(0.3), -0.1), pose.jitter(30))


def _held_in_front(pose: Pose, side: str) -> None:
    target = _near(pose, side, "spine04", (0.0, 0.1), (-0.08, 0.2), (0.2, 0.32))
    pose.hand_to(side, target, (0.8, -0.8, -0.5 + pose.jitter(0.3)), pose.jitter(30))
    pose.fingers(side, 40, 0)


def _to_face(pose: Pose, side: str) -> None:
    target = _near(pose, side, "head", (0.04, 0.14), (-0.08, 0.1), (0.12, 0.2))
    pose.hand_to(side, target, (0.6 + pose.jitter(0.4), -1.0, 0.3), pose.jitter(25))


def _behind_head(pose: Pose, side: str) -> None:
    face = pose.skeleton.head("head")
    target = face + [SIDES[side] * pose.rng.uniform(0.1, 0.16), pose.rng.uniform(0.02, 0.14), -0.06]
    pose.hand_to(side, target, (1.0, 0.5, 0.3 + pose.jitter(0.3)), 20)


def _raised(pose: Pose, side: str) -> None:
    upper = [pose.rng.uniform(0.1, 1), pose.rng.uniform(0.1, 1.2), pose.jitter(0.3) + 0.15]
    lower = [
        upper[0] * pose.rng.uniform(-0.3, 1),
        pose.rng.uniform(0.3, 1.2),
        upper[2] + 0.2 * pose.rng.random(),
    ]
    pose.arm(side, upper, lower, pose.jitter(30))


def _pointing(pose: Pose, side: str) -> None:
    direction = np.array([pose.rng.uniform(-0.3, 1), pose.jitter(0.3), pose.rng.uniform(0.2, 1)])
    pose.arm(side, direction, direction + [-0.1, 0.1 * pose.rng.random(), 0.12], pose.jitter(25))
    if pose.rng.random() < 0.6:
        pose.fingers(side, 70, 0)
        for joint in (1, 2, 3):
            pose.rotations[f"finger2-{joint}.{side}"] = np.eye(3)


def _offered(pose: Pose, side: str) -> None:
    upper = [pose.rng.uniform(0.2, 0.6), -1, pose.rng.uniform(-0.2, 0.4)]
    lower = [pose.rng.uniform(-0.4, 0.5), pose.rng.uniform(-0.2, 0.5), 1]
    pose.arm(side, upper, lower, -40 + pose.jitter(30))


def _behind_back(pose: Pose, side: str) -> None:
    hip = pose.skeleton.head("spine05")
    target = hip + [SIDES[side] * pose.rng.uniform(0.0, 0.1), pose.rng.uniform(-0.02, 0.15), -0.22]
    pose.hand_to(side, target, (1.0, 0.2, -0.6), 20)


def _sideways(pose: Pose, side: str) -> None:
    upper = [1, pose.jitter(0.3), pose.jitter(0.4)]
    lower = [1, pose.jitter(0.5), pose.jitter(0.5) + 0.2]
    pose.arm(side, upper, lower, pose.jitter(30))


def _crossed(pose: Pose) -> None:
    chest = pose.skeleton.head("spine02")
    over = pose.rng.permutation(["L", "R"])
    height = pose.rng.uniform(-0.06, 0.04)
    for side, forward in zip(over, (0.235, 0.175), strict=True):
        target = chest + [-SIDES[side] * pose.rng.uniform(0.06, 0.12), height + pose.jitter(0.015), forward]
        pose.hand_to(str(side), target, (1.0, -0.9, -0.25), pose.jitter(20))
        pose.fingers(str(side), 25, 0)


def hugging(pose: Pose, side: str) -> None:
    """Hold something flat in front of the chest, with the forearm across it."""
    target = _near(pose, side, "spine02", (-0.04, 0.08), (-0.2, -0.04), (0.22, 0.3))
    pose.hand_to(side, target, (1.0, -1.0, -0.2), pose.jitter(15))
    pose.fingers(side, 32, 3)
    pose.held[side] = str(pose.rng.choice(["binder", "folder", "book", "tablet"]))


def reading(pose: Pose, side: str) -> None:
    """Hold something to look at in front of the belly."""
    target = _near(pose, side, "spine04", (0.0, 0.12), (0.08, 0.28), (0.28, 0.4))
    pose.hand_to(side, target, (0.8, -1.0, -0.3), -35 + pose.jitter(25))
    pose.fingers(side, 30, 2)
    pose.held[side] = str(pose.rng.choice(["phone", "phone", "book", "tablet", "folder", "box"]))


def _at_ear(pose: Pose, side: str) -> None:
    ear = pose.skeleton.head("head")
    target = ear + [SIDES[side] * 0.105, pose.rng.uniform(-0.02, 0.03), 0.04]
    pose.hand_to(side, target, (0.8, -1.0, 0.2), 30 + pose.jitter(10))
    pose.fingers(side, 42, 0)
    pose.held[side] = "phone"


def _carrying(pose: Pose, side: str) -> None:
    """Let the arm hang, with something in the hand."""
    arms_down(pose, side)
    pose.held[side] = str(
        pose.rng.choice(["bag", "case", "binder", "folder", "stick"], p=[0.35, 0.2, 0.15, 0.15, 0.15])
    )
    pose.fingers(side, 68 if pose.held[side] in ("bag", "case", "stick") else 30, 0)


def lifting(pose: Pose) -> None:
    """Hold a crate with both hands at its sides."""
    belly = pose.skeleton.head("spine04")
    half, height, ahead = (
        pose.rng.uniform(0.2, 0.26),
        pose.rng.uniform(0.0, 0.16),
        pose.rng.uniform(0.28, 0.36),
    )
    for side in "LR":
        target = belly + [SIDES[side] * half, height, ahead]
        pose.hand_to(side, target, (1.0, -0.9, -0.3), 0)
        pose.fingers(side, 14, 3)
    pose.held["both"] = "crate"


_BOTH = (_crossed, lifting)  # of both arms
# How often each is drawn: (calm, lively). Those of one arm take its side as well.
_ARMS: dict[Callable[..., None], tuple[float, float]] = {
    arms_down: (5, 1),
    _swung: (2, 2),
    _akimbo: (2, 1),
    hand_in_pocket: (2.5, 0),
    _across: (1.5, 1),
    _held_in_front: (2, 1),
    _to_face: (1.2, 1),
    _behind_head: (0.3, 1),
    _raised: (0.35, 2),
    _pointing: (0.8, 1.5),
    _offered: (1, 1),
    _behind_back: (0.4, 0.2),
    _sideways: (0.2, 1.5),
    _crossed: (1.2, 0.3),
    lifting: (0.5, 0.3),
    hugging: (0.9, 0.3),
    reading: (1.0, 0.5),
    _at_ear: (0.4, 0.3),
    _carrying: (0.9, 0.5),
}
