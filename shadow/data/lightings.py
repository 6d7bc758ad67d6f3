"""Random lightings of photographs: a weight for each of a record's light directions."""

import numpy as np

from shadow.directions import from_spherical

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # of linear Rec.709 (ITU-R BT.709)
KINDS = ("hard", "sky", "any")  # of everyday light


def random_lighting(rng: np.random.Generator, directions: np.ndarray, unfilled: float = 0.0) -> np.ndarray:
    """Draw the weights (D, 3) of a random lighting over `directions` (D, 3).

    One to four hard lights of different colours are added to an ambient environment that varies slowly with
    direction. The fraction of hard light is random, since real photographs range from soft to hard light. The
    fraction `unfilled`, in [0, 1], of the lightings has no ambient light, as on a dark stage.
    """
    hard = np.zeros((len(directions), 3), np.float32)
    for _ in range(rng.choice([1, 2, 3, 4], p=[0.5, 0.3, 0.12, 0.08])):
        # Key lights are usually above and in front of the subject.
        odds = np.exp(1.0 * directions[:, 2] + 0.7 * directions[:, 1])
        tint = np.exp(rng.normal(0, 0.15, 3))
        hard[rng.choice(len(directions), p=odds / odds.sum())] += rng.uniform(0.3, 1.0) * tint
    axis = rng.normal(size=(3, 3))  # a main direction and two lesser ones
    axis[0, 1] = abs(axis[0, 1]) + 0.5  # light comes from above more often
    cosines = directions @ axis.T / np.linalg.norm(axis, axis=1)
    lobes = rng.uniform(0.05, 0.3) + np.exp(rng.uniform(0, 3, 3) * (cosines - 1))
    lobes[np.arange(len(directions)) % 3 != rng.integers(3)] = 0  # every third sample is enough
    soft = lobes * rng.uniform(0, 1, 3) @ np.exp(rng.normal(0, 0.12, (3, 3)))
    soft = soft / soft.sum(axis=0).mean()
    share = rng.choice([rng.uniform(0.6, 0.95), rng.uniform(0, 0.6), 0.0], p=[0.5, 0.3, 0.2])
    if unfilled and rng.random() < unfilled:
        share = 1.0
    return (share * hard / hard.sum() * 3 + (1 - share) * 4 * soft).astype(np.float32)


def everyday_lighting(
    rng: np.random.Generator, directions: np.ndarray, kind: str | None = None
) -> np.ndarray:
    """Draw the weights (D, 3) of an everyday lighting over `directions` (D, 3), typical of users' pictures.

    A third are "hard": one or two lamps or the sun, with 0 to 10 % of ambient light. A third are "sky": a
    large key light. A third are "any": those of `random_lighting`. In the first two kinds the key light is as
    warm as lamps or a low sun, the sky is bluer than the key, and the ground reflects the key's light in a
    warmer colour. `kind`: one of KINDS, drawn if None.
    """
    kind = rng.choice(KINDS) if kind is None else kind
    if kind == "any":
        return random_lighting(rng, directions, unfilled=0.1)
    odds = np.exp(1.0 * directions[:, 2] + 0.7 * directions[:, 1])
    count = rng.choice([1, 2], p=[0.65, 0.35]) if kind == "hard" else 1
    keys = rng.choice(len(directions), size=count, replace=False, p=odds / odds.sum())
    warmth = rng.uniform(-0.1, 0.6, count)
    key = np.zeros((len(directions), 3))
    if kind == "hard":
        share = 1 - rng.choice([0, rng.uniform(0, 0.1)], p=[0.25, 0.75])
        key[keys] = _warm(warmth) * rng.uniform(0.3, 1.0, (count, 1))
    else:
        share = rng.uniform(0.2, 0.65)
        breadth = rng.uniform(6, 20)  # falls to half its strength 28 to 15 degrees from its centre
        key = np.exp(breadth * (directions @ directions[keys[0]] - 1))[:, None] * _warm(warmth)
        key[key.sum(axis=1) < 0.05] = 0  # the faintest lights are invisible and cost time
    up = directions[:, 1:2]
    ground = rng.uniform(0.05, 0.35) * _warm(warmth[:1] + rng.uniform(0, 0.25))
    sky = (0.55 + 0.45 * up) ** rng.uniform(0.5, 2) * _warm(warmth[:1] - rng.uniform(0.05, 0.7))
    ambient = sky + np.maximum(-up, 0) * ground
    ambient[np.arange(len(directions)) % 3 != rng.integers(3)] = 0  # every third sample is enough
    ambient *= 3 / ambient.sum()
    # A surface receives a quarter of uniform light, so four times the weight is as bright as a key light.
    return (share * key / key.sum() * 3 + (1 - share) * 4 * ambient).astype(np.float32)


def _warm(warmth: np.ndarray) -> np.ndarray:
    """Return colours (N, 3), linear Rec.709 of luminance 1, for lights of warmth (N,).

    The warmth is about 0.6 at 3000 K, 0 at 6500 K and -0.2 at 9000 K.
    """
    colour = np.exp(np.asarray(warmth)[:, None] * [0.9, 0.0, -1.7])
    return colour / (colour @ LUMINANCE)[:, None]


def softbox(directions: np.ndarray) -> np.ndarray:
    """Return the weights (D,), which sum to one, of a large softbox at the upper right.

    The lobe falls to half its strength 24 degrees from the centre. `directions`: (D, 3) unit vectors.
    """
    lobe = np.exp(8 * (directions @ from_spherical(40.0, 35.0) - 1))
    return lobe / lobe.sum()
