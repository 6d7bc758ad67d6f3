"""The key light's share of the light on each pixel of a photograph whose two lights have known colours.

How bright a pixel is lit tells this share roughly: the network's shadows are soft, and light that the body
reflects brightens them. Colours tell more. Near pixels of similar albedo most often show one material, so
their difference in colour is that of the light. The share follows these differences, and stays near the one
by brightness where there are none. Reweighting leaves out pairs of different materials, as in
`relight.analysis.old_light`.
"""

import numpy as np
import torch
import torch.nn.functional as F

GRID = 3  # canvas pixels between those that are solved
PAIRS = 8  # with each of these pixels
REACH = 0.05  # largest distance of a pair, relative to the person's height
SIMILAR_ALBEDO = 0.35  # largest difference of a pair in log luminance of the albedo
RESIDUAL = 0.1  # log-chromaticity, at which a pair's weight falls to a half
PRIOR = 0.015  # weight of the share by brightness, of a pair's, if the lights' colours differ by 1
STEPS = 2  # of Gauss-Newton
SOLVER_STEPS = 12  # of conjugate gradients in each
GOLDEN_ANGLE = np.pi * (3 - 5**0.5)


def by_colour(
    share: torch.Tensor,
    ambient: tuple[float, float],
    colours: torch.Tensor,
    trust: torch.Tensor,
    luminance: torch.Tensor,
    known: torch.Tensor,
) -> torch.Tensor:
    """Return the key's share (h, w), in [0, 1], that explains the colours of a person.

    `share` (h, w) is that by brightness. `ambient` is the log-chromaticity (log R/G, log B/G) of the other
    light relative to the key, not (0, 0). `colours` (2, h, w) are those of the photograph's materials, lights
    included, `trust` (h, w) says how far they show the lights, `luminance` (h, w) is the albedo's, and
    `known` (h, w) is where the person is.
    """
    grid = np.s_[..., ::GRID, ::GRID]
    inside = known[grid].numpy()
    before, colour, sure, log_albedo = (
        values[grid].double().numpy()[..., inside] for values in (share, colours, trust, luminance.log())
    )
    pairs = _pairs(inside)
    pairs = pairs[:, np.abs(np.subtract(*log_albedo[pairs])) < SIMILAR_ALBEDO]
    first, second = pairs
    after = _solved(
        before, np.array(ambient), pairs, colour[:, first] - colour[:, second], sure[pairs].min(axis=0)
    )
    change = torch.zeros(2, *inside.shape)
    change[:, torch.from_numpy(inside)] = torch.from_numpy(
        np.stack([after - before, np.ones_like(after)])
    ).float()
    # Pixels outside the person do not count in the interpolation.
    change, covered = F.interpolate(change[None], share.shape, mode="bilinear")[0]
    return (share + change / covered.clamp_min(1e-3)).clamp(0, 1)


def _pairs(inside: np.ndarray) -> np.ndarray:
    """Return pairs of near pixels: (2, N) indices into those that are `inside` (h, w).

    The distances are the same everywhere and in every frame, so that a shot does not flicker.
    """
    height, width = inside.shape
    rows, columns = np.nonzero(inside)
    index = np.full(inside.shape, -1)
    index[rows, columns] = np.arange(len(rows))
    reach = REACH * (np.ptp(rows) + 1) if len(rows) else 0
    pairs = []
    for number in range(PAIRS):
        turn, distance = number * GOLDEN_ANGLE, reach * ((number + 1) / PAIRS) ** 0.5
        down, right = round(distance * np.sin(turn)), round(distance * np.cos(turn))
        y, x = rows + down, columns + right
        within = (y >= 0) & (y < height) & (x >= 0) & (x < width)
        other = np.where(within, index[y.clip(0, height - 1), x.clip(0, width - 1)], -1)
        found = (other >= 0) & (other != np.arange(len(rows)))
        pairs.append(np.stack([np.flatnonzero(found), other[found]]))
    return np.concatenate(pairs, axis=1)


def _solved(
    start: np.ndarray, ambient: np.ndarray, pairs: np.ndarray, differences: np.ndarray, trust: np.ndarray
) -> np.ndarray:
    """Return the shares (P,) that give pairs (2, N) of pixels the differences (2, N) of their colours.

    `start` (P,) are the shares by brightness, `ambient` (2,) and `trust` (N,) those of `by_colour`.
    """
    from scipy.sparse import coo_array  # the import takes time, and a light of one colour needs none
    from scipy.sparse.linalg import cg

    count, other = len(start), np.exp(ambient)[:, None]
    prior = PRIOR * PAIRS / max(float(ambient @ ambient), 1e-6)
    places = np.r_[np.arange(count), pairs[0], pairs[1]], np.r_[np.arange(count), pairs[1], pairs[0]]
    share = start.copy()

    def gathered(own: np.ndarray, others: np.ndarray) -> np.ndarray:
        return np.bincount(pairs[0], own, count) + np.bincount(pairs[1], others, count)

    for _ in range(STEPS):
        light = share + (1 - share) * other
        logs, slopes = np.log(light), (1 - other) / light
        near, far = slopes[:, pairs[0]], slopes[:, pairs[1]]
        residual = differences - (logs[:, pairs[0]] - logs[:, pairs[1]])
        weight = trust / (1 + (residual**2).sum(axis=0) / RESIDUAL**2)
        diagonal = prior + gathered(*(weight * (each**2).sum(axis=0) for each in (near, far)))
        crossed = -weight * (near * far).sum(axis=0)
        hessian = coo_array((np.r_[diagonal, crossed, crossed], places), (count, count)).tocsr()
        pull = gathered(weight * (near * residual).sum(axis=0), -weight * (far * residual).sum(axis=0))
        update, _ = cg(hessian, pull + prior * (start - share), rtol=1e-3, maxiter=SOLVER_STEPS)
        share = (share + update).clip(0, 1)
    return share
