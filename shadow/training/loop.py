"""The training loop of all networks; a Task defines what a network learns.

On one machine run `relight train ...`, on several GPUs `torchrun --nproc-per-node 4 -m relight.cli train
...`; the mini-batch is then that of each GPU.
"""

import json
import math
import os
import textwrap
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import nullcontext
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
import torch.distributed as dist
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from torch import nn
from torch.utils.data import DataLoader

from shadow import normals
from shadow.data.records import Records
from shadow.evaluation import pictures
from shadow.files import replacing
from shadow.framing import canvas_size
from shadow.networks import checkpoints
from shadow.networks.backbone import encode_image
from shadow.networks.field import VisibilityField
from shadow.networks.precision import autocast
from shadow.training.attention import attention
from shadow.training.minibatches import Batch, Photographs, StackedPhotographs
from shadow.training.optimiser import Optimiser
from shadow.training.recipes import Recipe, Task, learning_rate
from shadow.training.start import load_start

VALIDATION_SAMPLES = 32
TRUE_NORMALS = "true"  # use the records' normals instead of estimated ones (the row "Mixed" of Table 3)
CPU_BATCH = 4  # photographs that a CPU processes together
LOG_STEPS = 50  # between two lines of the log


class State:
    """The state of a run: the network, its exponential moving average, the optimiser and the clock."""

    def __init__(
        self, task: Task, recipe: Recipe, out: Path, device: torch.device, init: str | Path | None
    ) -> None:
        torch.manual_seed(recipe.seed)
        self.task, self.recipe, self.out, self.device = task, recipe, out, device
        self.config = {"size": recipe.size, **task.config}
        network = task.network(**self.config)
        if init:
            load_start(network, init, task.kind)
        self.network = _laid_out(network, device)
        self.optimiser = Optimiser(self.network, recipe)
        self.average = {key: value.detach().clone() for key, value in network.state_dict().items()}
        self.step, self.seconds = 0, 0.0
        self.checkpoint = out / "checkpoint.pt"
        if self.checkpoint.exists():
            self._resume(torch.device(device))

    def _resume(self, device: torch.device) -> None:
        """Continue from the checkpoint. Raises ValueError if it is damaged, or of another run."""
        try:
            saved = torch.load(self.checkpoint, map_location=device, weights_only=True)
            self.network.load_state_dict(saved["network"])
            self.optimiser.load_state_dict(saved["optimiser"])
            self.average, self.step, self.seconds = saved["average"], saved["step"], saved["seconds"]
        except torch.OutOfMemoryError:
            raise
        except Exception as error:  # a damaged file raises many kinds of errors
            reason = textwrap.shorten(str(error), 300)
            raise ValueError(f"{self.checkpoint}: does not continue this run: {reason}") from error
        if self.step > self.recipe.steps:
            raise ValueError(f"steps: {self.checkpoint} has made {self.step}, expected at least as many")

    def update(self) -> None:
        """Take one optimiser step and update the moving average."""
        if self.recipe.clip is not None:
            nn.utils.clip_grad_norm_(self.network.parameters(), self.recipe.clip)
        self.optimiser.step(learning_rate(self.recipe, self.step, self.seconds))
        # The decay is smaller at the beginning, so that the average forgets the initial weights.
        decay = min(self.recipe.average, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            for key, value in self.network.state_dict().items():
                self.average[key].lerp_(value, 1 - decay)
        self.step += 1

    @property
    def finished(self) -> bool:
        """Whether the run has made all its steps, or has used all its time."""
        duration = self.recipe.duration
        return self.step >= self.recipe.steps or (duration is not None and self.seconds >= 60 * duration)

    def averaged(self) -> nn.Module:
        """Return the network with the averaged parameters, which are scored and saved."""
        network = _laid_out(self.task.network(**self.config), self.device)
        network.load_state_dict(self.average)
        return network.eval()

    def save(self, facts: Mapping[str, object]) -> None:
        """Write the checkpoint, and the averaged weights with the recipe and `facts`."""
        # The weights come first: where writing stops between the two, the same command makes both again.
        recipe = {**asdict(self.recipe), "hours": round(self.seconds / 3600, 3), **facts}
        path = self.out / f"{self.task.kind}.safetensors"
        checkpoints.save(path, self.averaged(), self.task.kind, self.config, recipe)
        saved = {"network": self.network.state_dict(), "optimiser": self.optimiser.state_dict()}
        clock = {"step": self.step, "seconds": self.seconds}
        with replacing(self.checkpoint) as beside:
            torch.save({**saved, **clock, "average": self.average}, beside)


def _laid_out(network: nn.Module, device: torch.device) -> nn.Module:
    """Return a network on a device, its convolutions in channels-last memory."""
    layout: Any = {"memory_format": torch.channels_last}  # which torch's annotations of `to` do not know
    return network.to(device, **layout)


class Auxiliary(NamedTuple):
    """Trained networks whose output is an input of a task, or None."""

    normals: Callable | None  # maps a batch to its normals; None uses those of the field
    field: VisibilityField | None
    teacher: VisibilityField | None = None  # whose mean of two passes a field learns to give in one


def auxiliary_networks(
    task: Task, recipe: Recipe, estimator: str | Path | None, visibility: str | Path, device: torch.device
) -> Auxiliary:
    """Load the networks that the task needs. `estimator` is that of `fit`, or None if the task needs none."""
    surface = field = teacher = None
    if task.needs_visibility or recipe.distil:
        field = checkpoints.load(visibility, {"field": VisibilityField}, package="shadow", device=device)
    if not task.needs_visibility:
        field, teacher = None, field
    if estimator == TRUE_NORMALS:
        surface = lambda batch: batch["normals"]  # noqa: E731
    elif estimator is not None and (source := normals.load(estimator, device=device)) is not field:
        surface = partial(_estimated, source)
    return Auxiliary(surface, field, teacher)


def _estimated(source: normals.NormalsSource, batch: Batch) -> torch.Tensor:
    """Infer normals (B, 3, H, W) of the batch: together with a visibility field, otherwise one by one."""
    if isinstance(source, VisibilityField):
        return source(batch["image"]).normals
    views = zip(batch["rgb"], batch["matte"][:, 0], strict=True)
    with torch.autocast(batch["rgb"].device.type, enabled=False):
        return torch.stack([source.normals(rgb, mask) for rgb, mask in views])


def prepare(batch: Batch, device: torch.device, auxiliary: Auxiliary, recipe: Recipe | None = None) -> Batch:
    """Move the batch to the device and add the networks' inputs. `recipe` is None for scores."""
    batch = {key: value.to(device, non_blocking=True).float() for key, value in batch.items()}
    batch["image"] = encode_image(batch["rgb"], batch["matte"]).contiguous(memory_format=torch.channels_last)
    if recipe is not None:
        batch["attention"] = attention(batch, recipe)
        batch["angles"] = recipe.angles
        if auxiliary.teacher is not None:
            batch["teacher"], batch["distil"] = auxiliary.teacher, recipe.distil
    with torch.no_grad():
        surface = None if auxiliary.normals is None else auxiliary.normals(batch)
        if auxiliary.field is not None:
            maps = auxiliary.field(batch["image"])
            surface = maps.normals if surface is None else surface
            batch["visibility_network"] = auxiliary.field
            batch["visibility_maps"] = maps._replace(normals=surface)
        if surface is not None:
            batch["estimated_normals"] = surface * (batch["matte"] > 0)
    return batch


def gradient(
    task: Task, model: nn.Module, batch: Batch, recipe: Recipe, device: torch.device, auxiliary: Auxiliary
) -> torch.Tensor:
    """Add the gradient of the mini-batch's mean loss to the parameters, and return the loss.

    A CPU processes CPU_BATCH photographs of similar width at a time. A larger group would need a window as
    wide as its widest photograph (see `shadow.networks.backbone.subject_window`). For single photographs, all
    weights would be cast and laid out each time, which takes a fifth of the time on processors with a matrix
    unit (AMX).
    """
    count = share = len(batch["rgb"])
    if device.type == "cpu":
        share = CPU_BATCH
        narrow_first = (batch["matte"] > 0).any(dim=2).sum(dim=(1, 2)).argsort(stable=True)
        batch = {key: value[narrow_first] for key, value in batch.items()}
    parts = list(zip(*(value.split(share) for value in batch.values()), strict=True))
    alone = model.no_sync if isinstance(model, nn.parallel.DistributedDataParallel) else nullcontext
    total = torch.zeros((), device=device)
    for number, part in enumerate(parts, 1):
        # Processes exchange their gradients only with the last group.
        with alone() if number < len(parts) else nullcontext():
            with autocast(device, recipe.bfloat16):
                prepared = prepare(dict(zip(batch, part, strict=True)), device, auxiliary, recipe)
                loss = task.loss(model, prepared) * (len(part[0]) / count)
            loss.backward()
        total += loss.detach()
    return total


def fit(
    task: Task,
    recipe: Recipe,
    records: Iterable[str | Path],
    out: str | Path,
    *,
    validation: Iterable[str | Path] | None = None,
    init: str | Path | None = None,
    estimator: str | Path | None = None,
    visibility: str | Path = "field",
    workers: int | None = None,
    checkpoint_minutes: float = 5.0,
    stacked: bool = False,
    compiled: bool | str = False,
) -> Path:
    """Train a network, or resume from `out`/checkpoint.pt if it exists; return the path of the weights.

    - `records`: paths of record folders or shards. `out`: folder for checkpoint.pt, log.jsonl, samples-*.png
      and <kind>.safetensors (the averaged weights).
    - `validation`: paths of records to score on at every checkpoint; never trained on.
    - `init`: .safetensors file of initial weights: a network of the same kind, or another one with the same
      backbone. It may be shallower, but not deeper.
    - `estimator`: source of the normals that the network takes: a name or path for `shadow.normals.load`
      (also PIFuHD), or "true" for those of the records. With None, a visibility field uses its own, and other
      networks those of `visibility`. The weights file stores the source, since training and inference with
      different normals reduces accuracy (Table 3).
    - `visibility`: name or path of the visibility field whose maps are an input of the task, or of the one
      that is distilled. The weights file stores it.
    - `workers`: processes that make photographs: by default 1 for a CPU, and for a GPU one for each core, or
      4 if `stacked`. With 0, the training process makes them.
    - `checkpoint_minutes`: minutes between checkpoints. Each checkpoint also writes a line of log.jsonl.
    - `stacked`: whether the device holds the records and makes the photographs of a mini-batch together; see
      `shadow.data.batches`. Records that are added to the folders are taken in. For fields only.
    - `compiled`: whether torch.compile makes the network's forward faster, or the name of a backend of it.

    Raises FileNotFoundError or ValueError if there are no records; the weights are damaged or have another
    architecture; the checkpoint is damaged, of another run, or has made more steps; the loss or the network
    is not finite. In the last case the error names the step, and the last checkpoint stays.
    """
    if task.needs_normals and estimator is None:
        estimator = visibility
    device, rank, world = place()
    out, size, paths = Path(out), canvas_size(recipe.size), list(records)
    source = Records(paths)
    scored = Records(validation) if validation else None
    out.mkdir(parents=True, exist_ok=True)
    state = State(task, recipe, out, device, init)
    model = nn.parallel.DistributedDataParallel(state.network) if world > 1 else state.network
    auxiliary = auxiliary_networks(task, recipe, estimator, visibility, device)
    facts = _facts(task, recipe, init, estimator, visibility, device)
    # Each process draws its own photographs. The stride keeps the seeds of different runs apart.
    seed, done = recipe.seed + 7919 * rank, state.step
    lights, batch = recipe.lights or task.lights, recipe.batch
    if stacked:
        loader = StackedPhotographs(paths, seed, size, lights, done, batch, device).loader(workers)
    else:
        rest = done * batch, (recipe.steps - done) * batch
        loader = Photographs(source, seed, size, lights, *rest).loader(batch, device, workers)
    if compiled:
        state.network.compile(backend=compiled if isinstance(compiled, str) else "inductor")
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, disable=rank > 0) as progress:
        bar = progress.add_task(task.kind, total=recipe.steps if recipe.duration is None else None)
        saved_at = tick = time.monotonic()
        losses = []
        for batch in loader:
            # The step seeds the loss's random choices, so that a resumed run equals an uninterrupted one.
            torch.manual_seed(seed + 104729 * state.step)
            losses.append(gradient(task, model, batch, recipe, device, auxiliary))
            state.update()
            now = time.monotonic()
            state.seconds, tick = agreed(state.seconds + now - tick, device, world), now
            # A step may take seconds, so a checkpoint does not wait for the next line of the log.
            due = state.finished or now - saved_at > 60 * checkpoint_minutes
            if state.step % LOG_STEPS and not due:
                continue
            row: dict[str, float] = {"step": state.step, "images": state.step * recipe.batch * world}
            row |= {"seconds": round(state.seconds, 1), "loss": round(torch.stack(losses).mean().item(), 5)}
            losses = []
            if not math.isfinite(row["loss"]):
                raise ValueError(f"training: the loss at step {state.step} is not finite")
            progress.update(bar, completed=state.step, description=f"{task.kind} {row['loss']:.4f}")
            if due:
                if rank == 0:
                    # The loss of another process may have been the one that was not finite.
                    checkpoints.check_finite(f"training: the network at step {state.step}", state.network)
                    state.save({**facts, "images": row["images"], "records": len(source)})
                    row |= {} if scored is None else _validate(state, scored, size, auxiliary)
                saved_at = time.monotonic()
            if rank == 0:
                with open(out / "log.jsonl", "a") as file:
                    file.write(json.dumps(row) + "\n")
            if state.finished:
                break
            tick = time.monotonic()
    if world > 1:
        dist.destroy_process_group()
    return out / f"{task.kind}.safetensors"


def _facts(
    task: Task,
    recipe: Recipe,
    init: str | Path | None,
    estimator: str | Path | None,
    visibility: str | Path,
    device: torch.device,
) -> Mapping[str, object]:
    """Return the entries of the recipe that name the networks from which and with which it was trained."""
    facts = {"init": Path(init).stem} if init else {}
    if estimator is not None:
        facts["normals"] = Path(estimator).stem
        if estimator != TRUE_NORMALS:
            facts["normals_sha256"] = normals.load(estimator, device=device).origin.sha256
    if task.needs_visibility or recipe.distil:
        facts["visibility"] = Path(visibility).stem
    return facts


def place() -> tuple[torch.device, int, int]:
    """Return (device, rank, number of processes), with one process unless torchrun started several."""
    gpu = f"cuda:{os.environ.get('LOCAL_RANK', 0)}"
    device = torch.device(gpu if torch.cuda.is_available() else "cpu")
    if int(os.environ.get("WORLD_SIZE", 1)) == 1:
        return device, 0, 1
    dist.init_process_group("nccl" if device.type == "cuda" else "gloo")
    return device, dist.get_rank(), dist.get_world_size()


def agreed(seconds: float, device: torch.device, world: int) -> float:
    """Return the first process's clock, so that all processes have the same rate and stop together."""
    if world == 1:
        return seconds
    clock = torch.tensor(seconds, dtype=torch.float64, device=device)
    dist.broadcast(clock, 0)
    return clock.item()


@torch.no_grad()
def _validate(
    state: State, records: Records, size: tuple[int, int], auxiliary: Auxiliary
) -> dict[str, float]:
    """Return mean scores on fixed photographs, and draw the first four into the run's folder."""
    task, network, device = state.task, state.averaged(), state.device
    count = min(VALIDATION_SAMPLES, len(records))
    photographs = Photographs(records, 1, size, task.lights, 0, count, augment=False)
    first = next(iter(DataLoader(photographs, 4)))  # not under autocast, which would round the photographs
    with autocast(device):
        first = prepare(first, device, auxiliary)
        pictures.write_grid(state.out / f"samples-{state.step:06d}.png", task.show(network, first))
    scores = []
    for each in DataLoader(photographs, 1):
        with autocast(device):
            scores.append(task.score(network, prepare(each, device, auxiliary)))
    # A record without depth has no score of depth.
    keys = dict.fromkeys(key for score in scores for key in score)
    return {key: round(float(np.mean([score[key] for score in scores if key in score])), 5) for key in keys}
