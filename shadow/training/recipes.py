"""What a network learns, a Task, and how, a Recipe: the paper's (Section 3), and one that is faster."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from torch import nn

from shadow.data.records import Records


@dataclass(frozen=True)
class Task:
    """What the fit loop has to know of a network."""

    kind: str  # the name in the weight file
    network: type[nn.Module]
    loss: Callable  # (network, batch) -> scalar
    score: Callable  # (network, batch) -> {metric: mean over the batch}
    show: Callable  # (network, batch) -> rows of pictures
    lights: int  # directions a sample carries
    needs_normals: bool  # batch["estimated_normals"], a trained field's or from elsewhere
    config: dict = field(default_factory=dict)  # what the network is built with, beside its size
    recipe: dict = field(default_factory=dict)  # what it needs other than Recipe says
    needs_visibility: bool = False  # batch["visibility_network"], a trained field, and its "visibility_maps"


@dataclass(frozen=True)
class Recipe:
    """Everything that decides the result but the records and the machine."""

    steps: int
    size: int = 256  # canvas height in pixels
    batch: int = 8
    lights: int | None = None  # directions a photograph is asked for; the task's own number if None
    learning_rate: float = 1e-3
    warm_up: int = 200  # steps
    cosine: bool = True  # the rate falls to zero as half a cosine; else it stays
    optimiser: str = "muon"  # or "adam": see shadow.training.optimiser
    betas: tuple[float, float] = (0.9, 0.98)  # of AdamW, which without weight decay is Adam
    weight_decay: float = 0.02
    clip: float | None = 1.0  # norm of the gradient
    average: float = 0.999  # decay of the exponential moving average; 0 keeps the last weights
    bfloat16: bool = True  # activations, where the processor has it; parameters are float32 either way
    borders: float = 1.0  # how many times as often the losses look at pixels near borders of cast shadow,
    faces: float = 1.0  # and at pixels of faces and hands, as at others
    angles: float = (
        0.0  # share of the normals' loss that is their angle; the rest is their difference's length
    )
    seed: int = 0


# Section 3, "Training and Implementation Details".
PAPER_EPOCHS = 31
PAPER: dict[str, Any] = {
    "size": 512,
    "batch": 1,
    "lights": 1,
    "learning_rate": 5e-6,
    "warm_up": 0,
    "cosine": False,
    "optimiser": "adam",
    "betas": (0.9, 0.999),
    "weight_decay": 0.0,
    "clip": None,
    "average": 0.0,
    "bfloat16": False,
}


def preset(name: str, task: Task, records: Iterable[str | Path], **changes: Any) -> Recipe:
    """The Recipe of a preset for a task, with `changes` (those that are None change nothing).

    "paper" is Section 3's: Adam at a constant 5e-6, one map a step, float32, and 31 epochs over the maps of
    `records` (paths; as many maps each as the first has) unless `steps` says otherwise. "fast" is ours: Muon
    at a far higher rate that warms up and falls, bfloat16, and several lights of several photographs in a
    step; its `steps` must be given.
    """
    if name not in ("paper", "fast"):
        raise ValueError(f"preset: expected paper or fast, got {name!r}")
    chosen = PAPER if name == "paper" else task.recipe
    chosen = chosen | {key: value for key, value in changes.items() if value is not None}
    if "steps" not in chosen:
        if name == "fast":
            raise ValueError("steps: expected a number, since preset 'fast' has none of its own")
        source = Records(records)
        chosen["steps"] = PAPER_EPOCHS * len(source) * len(source[0].directions) // chosen["batch"]
    return Recipe(**chosen)


def learning_rate(recipe: Recipe, step: int) -> float:
    """Linear warm-up, then half a cosine to zero, or constant."""
    rise = min(1.0, (step + 1) / max(1, recipe.warm_up))
    if not recipe.cosine:
        return recipe.learning_rate * rise
    return recipe.learning_rate * rise * 0.5 * (1 + math.cos(math.pi * min(1.0, step / recipe.steps)))
