"""Two people who stand together, as one figure: `pair(seed, split)`.

They stand side by side with an arm around the other, embrace, or one stands behind the other. Their bodies
shadow each other, and hands lie on another body than their own.
"""

import numpy as np

from shadow.lightstage.figure import Figure, joined
from shadow.lightstage.people.body.skeleton import SIDES, Pose, rotation
from shadow.lightstage.people.generate import poses
from shadow.lightstage.people.generate.bodies import Shape, random_generator


def pair(seed: int, split: str) -> Figure:
    """Generate two clothed people who touch. The same seed and split give the same arrays in any process.

    They stand near x = z = 0, the first facing +z. `seed`, `split` and the errors are those of `bodies.body`.
    Neither person is the body of that seed.
    """
    rng = random_generator(seed, split, 2)
    shapes = [Shape.draw(rng) for _ in range(2)]
    stances = [poses.stand(shape.skeleton, rng) for shape in shapes]
    arrange = [_beside, _beside, _embracing, _behind][rng.integers(4)]
    yaw, offset = arrange(_Couple(shapes, stances), rng)
    name = f"pair-{split}-{seed:06d}"
    first, second = (shape.dress(pose, rng, split, name) for shape, pose in zip(shapes, stances, strict=True))
    return together(first, second, rotation((0, 1, 0), yaw), offset, name)


class _Couple:
    """The two people before they are dressed. Points are in the rest pose, with y from the floor up."""

    def __init__(self, shapes: list[Shape], stances: list[Pose]) -> None:
        self.shapes, self.stances = shapes, stances
        self.floors = [shape.rest[:, 1].min() for shape in shapes]

    def joint(self, who: int, name: str) -> np.ndarray:
        return self.shapes[who].skeleton.head(name) - [0, self.floors[who], 0]

    def shoulder(self, who: int) -> np.ndarray:
        return self.joint(who, "upperarm01.L")

    def taller(self) -> int:
        """Return the index of the person with the higher shoulders."""
        return int(self.shoulder(1)[1] > self.shoulder(0)[1])

    def hold(self, who: int, side: str, at: np.ndarray, yaw: float, offset: np.ndarray, hint: tuple) -> None:
        """Bring a hand of person `who` to a point of the other.

        The second person stands at `offset` from the first, turned by `yaw` degrees.
        """
        there = rotation((0, 1, 0), yaw)
        point = there @ at + offset if who == 0 else there.T @ (at - offset)
        pose = self.stances[who]
        pose.hand_to(side, point + [0, self.floors[who], 0], hint, pose.jitter(20))
        pose.fingers(side, 28, 2)


def _beside(two: _Couple, rng: np.random.Generator) -> tuple[float, np.ndarray]:
    """Pose them side by side, one with an arm around the other's shoulders or waist, often both."""
    side = str(rng.choice(["L", "R"]))  # of the first, where the second stands
    sign, inner = SIDES[side], {"L": "R", "R": "L"}[side]
    yaw = -sign * rng.uniform(-5, 30)
    apart = two.shoulder(0)[0] + two.shoulder(1)[0] + rng.uniform(0.05, 0.12)
    offset = np.array([sign * apart, 0, rng.uniform(-0.06, 0.08)])
    far = two.joint(1, f"upperarm01.{side}")
    waist = two.joint(1, "spine04") + [sign * 0.15, 0.0, -0.06]
    if two.taller() == 0:
        two.hold(0, side, far + [sign * 0.02, 0.06, -0.05], yaw, offset, (0.5, 0.2, -1.0))
    else:
        two.hold(0, side, waist, yaw, offset, (0.5, -0.4, -1.0))
    if rng.random() < 0.6:
        back = two.joint(0, "spine04") + [-sign * 0.12, 0.0, -0.08]
        two.hold(1, inner, back, yaw, offset, (0.4, -0.5, -1.0))
    return yaw, offset


def _embracing(two: _Couple, rng: np.random.Generator) -> tuple[float, np.ndarray]:
    """Pose them face to face, with arms around each other's back."""
    yaw = 180 + rng.uniform(-15, 15)
    offset = np.array([rng.choice([-1, 1]) * rng.uniform(0.05, 0.1), 0, rng.uniform(0.24, 0.3)])
    for who in (0, 1):
        over = who == two.taller()  # the arms of the taller person go over those of the other
        back = two.joint(1 - who, "spine02" if over else "spine04")
        for side in "LR":
            across = back + [-SIDES[side] * rng.uniform(0.02, 0.09), rng.uniform(-0.03, 0.05), -0.15]
            two.hold(who, side, across, yaw, offset, (1.0, -0.2 if over else -0.5, 0.0))
    return yaw, offset


def _behind(two: _Couple, rng: np.random.Generator) -> tuple[float, np.ndarray]:
    """Pose one behind the other and to one side, with hands on the shoulders of the person in front."""
    yaw = rng.uniform(-20, 20)
    offset = np.array([rng.choice([-1, 1]) * rng.uniform(0.1, 0.28), 0, -rng.uniform(0.26, 0.36)])
    for side in "LR":
        if rng.random() < 0.8:
            at = two.joint(0, f"upperarm01.{side}") + [-SIDES[side] * 0.03, 0.06, 0.02]
            two.hold(1, side, at, yaw, offset, (1.0, -0.7, 0.0))
    return yaw, offset


def together(first: Figure, second: Figure, turned: np.ndarray, offset: np.ndarray, name: str) -> Figure:
    """Join both into one figure, with the second rotated and moved."""
    vertices = np.concatenate([first.vertices, second.vertices @ turned.T + offset]) - offset / 2
    return Figure(
        vertices.astype(np.float32),
        np.concatenate([first.faces, second.faces + len(first.vertices)]).astype(np.int32),
        np.concatenate([first.normals, second.normals @ turned.T]).astype(np.float32),
        joined([first.albedo, second.albedo], [len(first.faces), len(second.faces)]),
        name,
        regions=np.concatenate([first.regions, second.regions]) if first.regions is not None else None,
    )
