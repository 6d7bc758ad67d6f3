"""Scores of the visibility and normals networks on records, as Section 4.1 measures them."""

from dataclasses import dataclass
from statistics import mean, stdev

import numpy as np
import torch
from rich.progress import track

from shadow import metrics, normals, visibility
from shadow.framing import canvas_size
from shadow.records import Records, photograph, sample

FRONTAL = 1e-6  # the paper's 64 lights are those before the subject: z > 0


@dataclass(frozen=True)
class Score:
    """Mean and standard deviation over the maps, as the paper prints them."""

    rmse: tuple[float, float]
    psnr: float
    dice: tuple[float, float]


def _score(errors, dices):
    rmse = mean(errors)
    psnr = float(metrics.psnr(torch.tensor(rmse)))
    return Score((rmse, stdev(errors)), psnr, (mean(dices), stdev(dices)))


@torch.no_grad()
def evaluate(paths, *, model="field", normals_model="normals", seed=0, limit=None):
    """Score visibility on records against sign(N·L) from estimated and from true normals (Table 2).

    Every record is photographed once under a random lighting fixed by `seed`, framed on the network's
    canvas, and asked for all its frontal lights; maps are binary, metrics masked. A map is one light of one
    record, and the means and deviations are over maps.

    Parameters
    ----------
    paths: record folders or shards.
    model, normals_model: names of shipped weights or .safetensors paths.
    limit: use this many records, spread evenly.

    Returns
    -------
    {"field": Score, "sign(N·L), estimated normals": Score, "sign(N·L), true normals": Score}, and the mean
    angular error of the normals in degrees.
    """
    network, surface = visibility.load(model), normals.load(normals_model)
    found = Records(paths)
    errors, dices, angles = {}, {}, []
    for index in track(found.spread(limit or len(found)), "evaluating"):
        rng = np.random.default_rng((seed, index))
        view = sample(found[index], rng, canvas_size(network.size), augment=False)
        rgb, mask = photograph(view["rgb"], view["mask"], rng), view["mask"][0]
        inside = mask > 0.5
        frontal = view["directions"][:, 2] > FRONTAL
        lights, truth = view["directions"][frontal], (view["visibility"][frontal] > 0.5).float()
        estimated = surface.analyse(rgb, mask)
        angles.append(float(metrics.angular_error(estimated, view["normals"], inside)))
        maps = {
            "field": network.analyse(rgb, mask, estimated)(lights) > 0.5,
            "sign(N·L), estimated normals": torch.einsum("dc,chw->dhw", lights, estimated) > 0,
            "sign(N·L), true normals": torch.einsum("dc,chw->dhw", lights, view["normals"]) > 0,
        }
        for name, binary in maps.items():
            errors.setdefault(name, []).extend(metrics.rmse(binary.float(), truth, inside).tolist())
            dices.setdefault(name, []).extend(metrics.dice(binary.float(), truth, inside).tolist())
    return {name: _score(errors[name], dices[name]) for name in errors}, mean(angles)


def report(scores, angle):
    """The scores as a Markdown table."""
    rows = ["| visibility | RMSE ↓ | PSNR ↑ | Dice ↑ |", "|---|---|---|---|"]
    for name, score in scores.items():
        (rmse, rmse_sd), (dice, dice_sd) = score.rmse, score.dice
        rows.append(
            f"| {name} | {rmse:.3f} ({rmse_sd:.3f}) | {score.psnr:.2f} | {dice:.3f} ({dice_sd:.3f}) |"
        )
    return "\n".join([*rows, "", f"Estimated normals: mean angular error {angle:.1f} degrees."])
