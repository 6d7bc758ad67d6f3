"""Train the network that cuts people out on composed pictures (`shadow.data.composites`).

The losses are those of mask-guided matting (Yu et al., CVPR 2021) and of MODNet (Ke et al., AAAI 2022): the
difference of the mattes, of their gradients, and of the composites with them, and the entropy of the coarse
matte, which is blurred. Nothing counts beyond the photograph's frame.
"""

import json
import math
import time
from pathlib import Path
from typing import NamedTuple

import torch
import torch.distributed as dist
import torch.nn.functional as F
from torch import nn
from torch.utils.data import DataLoader

from shadow.data.backdrops import Backdrops
from shadow.data.composites import Composite, Composites, PoseMask
from shadow.evaluation import pictures
from shadow.networks import checkpoints
from shadow.networks.matting import Mattes, MattingNetwork
from shadow.networks.precision import autocast
from shadow.training.loop import LOG_STEPS, State, agreed, place
from shadow.training.recipes import Recipe, Task

EDGE = 4.0  # weight of the pixels near the true edge, and of those where the rough mask is wrong
GRADIENT, COMPOSITE, COARSE = 1.0, 1.0, 0.25  # weights beside that of the difference of the mattes
SCORED = 48  # pictures, of other people if there are any
SHOWN = 8


def loss(network: nn.Module, batch: Composite) -> torch.Tensor:
    """Return the error of the mattes of a mini-batch."""
    found = Mattes(*(logits.float() for logits in network(batch.rgb, batch.mask)))
    alpha, valid = batch.alpha, batch.valid
    matte = found.fine.sigmoid()
    reach = 2 * (alpha.shape[-1] // 64) + 1
    edge = _largest_near(alpha, reach) + _largest_near(-alpha, reach)
    weight = valid * (1 + EDGE * torch.maximum(edge, (batch.mask - alpha).abs()))
    error = _mean((matte - alpha).abs(), weight)
    error = error + 0.5 * _mean(
        F.binary_cross_entropy_with_logits(found.fine, alpha, reduction="none"), weight
    )
    for axis in (2, 3):
        steps = (matte - alpha).diff(dim=axis).abs()
        length = alpha.shape[axis] - 1
        both = weight.narrow(axis, 0, length) * valid.narrow(axis, 1, length)
        error = error + GRADIENT * _mean(steps, both)
    # Composites over what is behind differ by the difference of the mattes times that of the colours.
    error = error + COMPOSITE * _mean((matte - alpha).abs() * batch.contrast, weight)
    size = (found.coarse.shape[2], found.coarse.shape[3])
    small, inside = F.adaptive_avg_pool2d(alpha, size), F.adaptive_avg_pool2d(valid, size)
    entropy = F.binary_cross_entropy_with_logits(found.coarse, small, reduction="none")
    return error + COARSE * _mean(entropy, inside)


def _largest_near(values: torch.Tensor, reach: int) -> torch.Tensor:
    along = F.max_pool2d(values, (1, reach), 1, (0, reach // 2))
    return F.max_pool2d(along, (reach, 1), 1, (reach // 2, 0))


def _mean(values: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    return (values * weight).sum() / weight.sum().clamp_min(1)


def show(network: nn.Module, batch: Composite) -> list[torch.Tensor]:
    """Return rows of pictures: photographs, rough masks, mattes, true mattes."""
    matte = network(batch.rgb, batch.mask).fine.float().sigmoid()
    return [batch.rgb, *(plane.expand(-1, 3, -1, -1) for plane in (batch.mask, matte, batch.alpha))]


def scores(matte: torch.Tensor, batch: Composite) -> dict[str, float]:
    """Return the mean difference (SAD / pixels) and the intersection over union of mattes (B, 1, S, S)."""
    inside = batch.valid > 0
    found, true = (matte > 0.5) & inside, (batch.alpha > 0.5) & inside
    union = (found | true).flatten(1).sum(dim=1).clamp_min(1)
    overlap = (found & true).flatten(1).sum(dim=1) / union
    return {
        "difference": float(_mean((matte - batch.alpha).abs(), batch.valid)),
        "iou": float(overlap.mean()),
    }


TASK = Task("matting", MattingNetwork, loss, scores, show, lights=0, needs_normals=False)


class Sources(NamedTuple):
    """What the pictures are composed of: folders of cutouts and of backdrops."""

    cutouts: list[Path]
    backdrops: Path


def fit(
    recipe: Recipe,
    sources: Sources,
    out: Path,
    *,
    validation: Sources | None = None,
    init: Path | None = None,
    pose_mask: PoseMask | None = None,
    workers: int = 1,
    checkpoint_minutes: float = 5.0,
) -> Path:
    """Train the network, or resume from `out`/checkpoint.pt if it exists; return the path of the weights.

    `recipe.size`: side of the pictures, a multiple of 128; a run may be resumed with another. `validation`:
    what the scored pictures are composed of. `init`: weights to start from. `pose_mask`: see `Composites`.
    `workers`: processes that compose pictures, for each training process. The files in `out` are those of
    `shadow.training.loop.fit`. Raises FileNotFoundError or ValueError as that does.
    """
    device, rank, world = place()
    out.mkdir(parents=True, exist_ok=True)
    state = State(TASK, recipe, out, device, init)
    model: nn.Module = nn.parallel.DistributedDataParallel(state.network) if world > 1 else state.network
    seed, rest = recipe.seed + 7919 * rank, (recipe.steps - state.step) * recipe.batch
    backdrops = Backdrops(sources.backdrops)
    start = state.step * recipe.batch
    source = Composites(sources.cutouts, backdrops, seed, recipe.size, start, rest, pose_mask)
    loader = DataLoader(source, recipe.batch, num_workers=workers, worker_init_fn=_one_thread)
    scored = None
    if validation is not None and rank == 0:
        behind = Backdrops(validation.backdrops)
        scored = Composites(validation.cutouts, behind, 1, recipe.size, 0, SCORED, pose_mask)
    saved_at = tick = time.monotonic()
    losses: list[torch.Tensor] = []
    for batch in loader:
        losses.append(_gradient(model, batch, recipe))
        state.update()
        now = time.monotonic()
        state.seconds, tick = agreed(state.seconds + now - tick, device, world), now
        due = state.finished or now - saved_at > 60 * checkpoint_minutes
        if state.step % LOG_STEPS and not due:
            continue
        row: dict[str, float] = {"step": state.step, "images": state.step * recipe.batch * world}
        row |= {"seconds": round(state.seconds, 1), "loss": round(torch.stack(losses).mean().item(), 5)}
        losses = []
        if not math.isfinite(row["loss"]):
            raise ValueError(f"training: the loss at step {state.step} is not finite")
        if due and rank == 0:
            checkpoints.check_finite(f"training: the network at step {state.step}", state.network)
            state.save({"images": row["images"], "cutouts": len(source.paths)})
            row |= {} if scored is None else _validate(state, scored)
        saved_at = now if due else saved_at
        if rank == 0:
            with open(out / "log.jsonl", "a") as file:
                file.write(json.dumps(row) + "\n")
        if state.finished:
            break
    if world > 1:
        dist.destroy_process_group()
    return out / "matting.safetensors"


def _gradient(model: nn.Module, batch: Composite, recipe: Recipe) -> torch.Tensor:
    """Add the gradient of a mini-batch's loss to the parameters, and return the loss."""
    device = batch.rgb.device
    with autocast(device, recipe.bfloat16):
        error = loss(model, batch)
    error.backward()
    return error.detach()


@torch.no_grad()
def _validate(state: State, scored: Composites) -> dict[str, float]:
    """Return mean scores of the rough masks and of the mattes, and draw the first pictures."""
    network, rows = state.averaged(), []
    for number, batch in enumerate(DataLoader(scored, SHOWN)):
        with autocast(state.device):
            matte = network(batch.rgb, batch.mask).fine.float().sigmoid()
            if number == 0:
                pictures.write_grid(state.out / f"samples-{state.step:06d}.png", show(network, batch))
        rough = {f"rough {name}": value for name, value in scores(batch.mask, batch).items()}
        rows.append(scores(matte, batch) | rough)
    return {key: round(sum(row[key] for row in rows) / len(rows), 5) for key in rows[0]}


def _one_thread(_worker: int) -> None:
    torch.set_num_threads(1)
