"""The fit loop, shared by every network of the project, and the losses of the normals and the field.

On one machine: `relight train ...`. On several GPUs: `torchrun --nproc-per-node 4 -m relight.cli train ...`;
the mini-batch is then per GPU.
"""

import json
import math
import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
import torch.distributed as dist
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from torch import nn
from torch.utils.data import DataLoader, Dataset

from shadow import metrics, normals, pictures, weights
from shadow.backbone import encode_image
from shadow.field import VisibilityField
from shadow.framing import canvas_size
from shadow.normals import NormalsNetwork
from shadow.records import Records, sample

VALIDATION_SAMPLES = 32
LOG_EVERY = 50  # steps; a checkpoint that is due waits for the next


@dataclass(frozen=True)
class Task:
    """What the fit loop has to know of a network."""

    kind: str  # the name in the weight file
    network: type[nn.Module]
    loss: Callable  # (network, batch) -> scalar
    score: Callable  # (network, batch) -> {metric: mean over the batch}
    show: Callable  # (network, batch) -> rows of pictures
    lights: int  # directions a sample carries; 0 where the network knows no lights
    needs_normals: bool  # batch["estimated_normals"] from a trained normals network


@dataclass(frozen=True)
class Recipe:
    """Everything that decides the result but the records and the machine."""

    steps: int
    size: int = 256  # canvas height in pixels
    batch: int = 8
    learning_rate: float = 1e-3
    warm_up: int = 200  # steps
    weight_decay: float = 0.02
    clip: float = 1.0  # norm of the gradient
    average: float = 0.999  # decay of the exponential moving average
    seed: int = 0


class _Photographs(Dataset):
    """Photograph number i, made from the records: the same for any number of workers, so that a resumed
    run sees exactly what an uninterrupted one would."""

    def __init__(self, records, seed, size, lights, start, count, augment=True):
        self.records, self.seed, self.size, self.lights = records, seed, size, lights
        self.start, self.count, self.augment = start, count, augment

    def __len__(self):
        return self.count

    def __getitem__(self, index):
        index += self.start
        epoch, position = divmod(index, len(self.records))
        order = np.random.default_rng((self.seed, epoch)).permutation(len(self.records))
        rng = np.random.default_rng((self.seed, epoch, position))
        return sample(self.records[int(order[position])], rng, self.size, self.lights, self.augment)


def learning_rate(recipe, step):
    """Linear warm-up, then half a cosine to zero."""
    rise = min(1.0, (step + 1) / recipe.warm_up)
    return recipe.learning_rate * rise * 0.5 * (1 + math.cos(math.pi * min(1.0, step / recipe.steps)))


def warm_start(network, path):
    """Take the backbone of another network's weights, except its head.

    Input channels that the other network lacks start at zero, so the features start as they were.
    """
    state, _ = weights.read(path)
    own = network.state_dict()
    for key, value in state.items():
        if not key.startswith("backbone.") or key.startswith("backbone.head."):
            continue
        if key == "backbone.stem.weight":
            padded = torch.zeros_like(own[key])
            channels = min(value.shape[1], padded.shape[1])
            padded[:, :channels] = value[:, :channels].float()
            value = padded
        if own[key].shape != value.shape:
            raise ValueError(f"init: {path} has another architecture ({key}: {tuple(value.shape)})")
        own[key].copy_(value)


def _load_start(network, path, kind):
    """Weights to start from: all of the same kind of network, or the backbone of another."""
    state, metadata = weights.read(path)
    if metadata.get("network") == kind:
        network.load_state_dict({key: value.float() for key, value in state.items()})
    else:
        warm_start(network, path)


class _Average:
    """Exponential moving average of the parameters; young averages forget faster."""

    def __init__(self, network, decay):
        self.decay = decay
        self.state = {key: value.detach().clone() for key, value in network.state_dict().items()}

    @torch.no_grad()
    def update(self, network, step):
        decay = min(self.decay, (1 + step) / (10 + step))
        for key, value in network.state_dict().items():
            self.state[key].lerp_(value, 1 - decay)


def _prepare(batch, device, estimator):
    batch = {key: value.to(device, non_blocking=True) for key, value in batch.items()}
    batch["image"] = encode_image(batch["rgb"], batch["mask"]).contiguous(memory_format=torch.channels_last)
    if estimator is not None:
        with torch.no_grad():
            batch["estimated_normals"] = estimator(batch["image"]) * (batch["mask"] > 0)
    return batch


def fit(task, recipe, records, out, *, validation=None, init=None, estimator="normals", workers=None,
        checkpoint_minutes=5.0):  # fmt: skip
    """Train a network; resumes from `out`/checkpoint.pt if there is one.

    Parameters
    ----------
    task: Task. recipe: Recipe.
    records: paths of record folders or shards.
    out: folder for checkpoint.pt, log.jsonl, samples-*.png and <kind>.safetensors (the averaged weights).
    validation: paths of records to score on at every checkpoint; never trained on.
    init: .safetensors to start from: of the same kind, or of another network with the same backbone.
    estimator: the normals network (name or path) where the task takes estimated normals as input. The
        weights record which, since training and testing on different normals costs accuracy (Table 3).
    workers: processes that make photographs; default 1 on a CPU, 12 on a GPU.

    Returns
    -------
    The path of the weights.

    Raises
    ------
    FileNotFoundError, ValueError: no records, damaged weights, another architecture; a loss that is not
        finite stops the run with its step, the last checkpoint intact.
    """
    distributed = int(os.environ.get("WORLD_SIZE", 1)) > 1
    device = (
        torch.device("cuda", int(os.environ.get("LOCAL_RANK", 0))) if torch.cuda.is_available() else "cpu"
    )
    device = torch.device(device)
    if distributed:
        dist.init_process_group("nccl" if device.type == "cuda" else "gloo")
    rank, world = (dist.get_rank(), dist.get_world_size()) if distributed else (0, 1)
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(recipe.seed)
    config = {"size": recipe.size}
    network = task.network(**config)
    if init:
        _load_start(network, init, task.kind)
    network = network.to(device, memory_format=torch.channels_last)
    estimate = normals.load(estimator).to(device) if task.needs_normals else None
    decayed = [p for p in network.parameters() if p.ndim > 1]
    plain = [p for p in network.parameters() if p.ndim <= 1]
    groups = [{"params": decayed, "weight_decay": recipe.weight_decay}, {"params": plain, "weight_decay": 0}]
    optimiser = torch.optim.AdamW(groups, lr=recipe.learning_rate, betas=(0.9, 0.98))
    average = _Average(network, recipe.average)
    start, seconds, checkpoint = 0, 0.0, out / "checkpoint.pt"
    if checkpoint.exists():
        saved = torch.load(checkpoint, map_location=device, weights_only=True)
        network.load_state_dict(saved["network"])
        optimiser.load_state_dict(saved["optimiser"])
        average.state = saved["average"]
        start, seconds = saved["step"], saved["seconds"]
    model = nn.parallel.DistributedDataParallel(network) if distributed else network
    source = Records(records)
    size = canvas_size(recipe.size)
    photographs = _Photographs(
        source, recipe.seed + 7919 * rank, size, task.lights, start * recipe.batch,
        (recipe.steps - start) * recipe.batch,
    )  # fmt: skip
    workers = (12 if device.type == "cuda" else 1) if workers is None else workers
    loader = DataLoader(photographs, recipe.batch, num_workers=workers, pin_memory=device.type == "cuda",
                        worker_init_fn=_one_thread, persistent_workers=workers > 0)  # fmt: skip
    autocast = torch.autocast(device.type, torch.bfloat16)

    def save(step):
        beside = checkpoint.with_name("checkpoint.pt.part")
        state = {
            "network": network.state_dict(),
            "optimiser": optimiser.state_dict(),
            "average": average.state,
        }
        torch.save({**state, "step": step, "seconds": seconds}, beside)
        os.replace(beside, checkpoint)
        averaged = task.network(**config).to(device, memory_format=torch.channels_last)
        averaged.load_state_dict(average.state)
        facts = {**asdict(recipe), "steps_done": step, "images": step * recipe.batch * world,
                 "hours": round(seconds / 3600, 3), "records": len(source)}  # fmt: skip
        if task.needs_normals:
            facts["normals"] = Path(estimator).stem
        if init:
            facts["init"] = Path(init).stem
        weights.save(out / f"{task.kind}.safetensors", averaged, task.kind, config, facts)
        scores = {}
        if validation:
            scores = _validate(task, averaged, Records(validation), size, device, estimate, autocast,
                               out / f"samples-{step:06d}.png")  # fmt: skip
        return scores

    def log(step, loss, **facts):
        row = {"step": step, "images": step * recipe.batch * world, "seconds": round(seconds, 1),
               "loss": round(loss, 5), **{key: round(value, 5) for key, value in facts.items()}}  # fmt: skip
        with open(out / "log.jsonl", "a") as file:
            file.write(json.dumps(row) + "\n")

    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    saved_at, losses = time.monotonic(), []
    with Progress(*columns, disable=rank > 0) as progress:
        bar = progress.add_task(task.kind, total=recipe.steps, completed=start)
        tick = time.monotonic()
        for step, batch in enumerate(loader, start):
            batch = _prepare(batch, device, estimate)
            for group in optimiser.param_groups:
                group["lr"] = learning_rate(recipe, step)
            with autocast:
                loss = task.loss(model, batch)
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            nn.utils.clip_grad_norm_(network.parameters(), recipe.clip)
            optimiser.step()
            average.update(network, step)
            losses.append(loss.detach())
            now = time.monotonic()
            seconds, tick = seconds + now - tick, now
            last = step + 1 == recipe.steps
            if (step + 1) % LOG_EVERY == 0 or last:
                mean = torch.stack(losses).mean().item()
                losses = []
                if not math.isfinite(mean):
                    raise ValueError(f"training: the loss at step {step + 1} is not finite")
                progress.update(bar, completed=step + 1, description=f"{task.kind} {mean:.4f}")
                due = last or now - saved_at > 60 * checkpoint_minutes
                if rank == 0:
                    log(step + 1, mean, **(save(step + 1) if due else {}))
                if due:
                    saved_at = time.monotonic()
                tick = time.monotonic()
    if distributed:
        dist.destroy_process_group()
    return out / f"{task.kind}.safetensors"


def _one_thread(_worker):
    torch.set_num_threads(1)


@torch.no_grad()
def _validate(task, network, records, size, device, estimate, autocast, picture):
    """Mean scores on a fixed choice of photographs, and a picture of the first four."""
    network.eval()
    count = min(VALIDATION_SAMPLES, len(records))
    photographs = _Photographs(records, 1, size, task.lights, 0, count, augment=False)
    scores = []
    for batch in DataLoader(photographs, 4):
        batch = _prepare(batch, device, estimate)
        with autocast:
            scores.append(task.score(network, batch))
            if len(scores) == 1:
                pictures.write_grid(picture, task.show(network, batch))
    return {key: float(np.mean([score[key] for score in scores])) for key in scores[0]}


def _masked_mean(values, mask):
    return (values * mask).sum() / (mask.sum() * values.shape[1]).clamp_min(1)


def normals_loss(network, batch):
    """Length of the difference of unit vectors: near the angle itself, so that outliers do not rule."""
    difference = (network(batch["image"]) - batch["normals"]).square().sum(dim=1, keepdim=True)
    return _masked_mean((difference + 1e-4).sqrt(), batch["mask"] > 0.5)


def _normals_score(network, batch):
    error = metrics.angular_error(network(batch["image"]), batch["normals"], batch["mask"][:, 0] > 0.5)
    return {"angle": float(error.mean())}


def _normals_show(network, batch):
    estimate = network(batch["image"]) * (batch["mask"] > 0.5)
    for i in range(len(estimate)):
        seen = batch["mask"][i] > 0.5
        yield [
            pictures.show_linear(batch["rgb"][i] * seen),
            pictures.show_normals(estimate[i]),
            pictures.show_normals(batch["normals"][i] * seen),
        ]


def visibility_loss(network, batch):
    """Binary cross-entropy of the product's probability, and the gate's normals kept near the true ones."""
    field = network.module if isinstance(network, nn.parallel.DistributedDataParallel) else network
    maps = network(batch["image"], batch["estimated_normals"])
    log_lit = field.log_visibility(maps, batch["directions"]).clamp_max(-1e-5)
    log_dark = torch.log(-torch.expm1(log_lit))
    truth, inside = batch["visibility"], batch["mask"] > 0.5
    entropy = -(truth * log_lit + (1 - truth) * log_dark)
    drift = (maps.normals - batch["normals"]).square().sum(dim=1, keepdim=True)
    return _masked_mean(entropy, inside) + 0.3 * _masked_mean((drift + 1e-4).sqrt(), inside)


def _visibility(network, batch):
    return network.log_visibility(
        network(batch["image"], batch["estimated_normals"]), batch["directions"]
    ).exp()


def _visibility_score(network, batch):
    """RMSE and Dice of binary maps, beside sign(N·L) from the same estimated normals."""
    inside, truth = batch["mask"] > 0.5, (batch["visibility"] > 0.5).float()
    sign = torch.einsum("bdc,bchw->bdhw", batch["directions"], batch["estimated_normals"]) > 0
    scores = {}
    for name, estimate in (("", _visibility(network, batch) > 0.5), ("_baseline", sign)):
        scores["rmse" + name] = float(metrics.rmse(estimate.float(), truth, inside).mean())
        scores["dice" + name] = float(metrics.dice(estimate.float(), truth, inside).mean())
    return scores


def _visibility_show(network, batch):
    estimate = _visibility(network, batch)
    for i in range(len(estimate)):
        seen = batch["mask"][i] > 0.5
        columns = [pictures.show_linear(batch["rgb"][i] * seen)]
        for light in range(0, estimate.shape[1], max(1, estimate.shape[1] // 4)):
            columns.append((estimate[i, light] * seen).expand(3, -1, -1))
            columns.append((batch["visibility"][i, light] * seen).expand(3, -1, -1))
        yield columns


NORMALS = Task("normals", NormalsNetwork, normals_loss, _normals_score, _normals_show, 1, False)
SHADOW = Task("field", VisibilityField, visibility_loss, _visibility_score, _visibility_show, 20, True)
