"""Tasks and recipes: a Task defines what a network learns, a Recipe defines how.

There are two recipes: the paper's (Section 3), and a faster one.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from torch import nn

from shadow.data.records import Records


@dataclass(frozen=True)
class Task:
    """The description of a network for the training loop."""

    kind: str  # the name in the weights file
    network: type[nn.Module]
    loss: Callable  # (network, batch) -> scalar
    score: Callable  # (network, batch) -> {metric: mean over the batch}
    show: Callable  # (network, batch) -> rows of pictures
    lights: int  # directions of a sample
    needs_normals: bool  # needs batch["estimated_normals"], from a trained field or another estimator
    config: dict = field(default_factory=dict)  # arguments of the network, besides its size
    recipe: dict = field(default_factory=dict)  # values that replace the defaults of Recipe
    needs_visibility: bool = False  # needs batch["visibility_network"], a trained field, and its maps


def unwrapped(network: nn.Module) -> Any:
    """Return the network itself of one that runs on several processes, of the class that the task names."""
    return getattr(network, "module", network)


@dataclass(frozen=True)
class Recipe:
    """All settings that determine the result, apart from the records and the machine."""

    steps: int  # at most, if there is a duration
    size: int = 256  # canvas height in pixels
    batch: int = 8
    lights: int | None = None  # directions that are evaluated for each photograph; None: those of the task
    learning_rate: float = 1e-3
    warm_up: int = 200  # steps
    cosine: bool = True  # whether the rate falls to zero along half a cosine, or stays constant
    optimiser: str = "muon"  # or "adam": see shadow.training.optimiser
    betas: tuple[float, float] = (0.9, 0.98)  # of AdamW, which is Adam if there is no weight decay
    weight_decay: float = 0.02
    clip: float | None = 1.0  # largest norm of the gradient
    average: float = 0.999  # decay of the exponential moving average; 0 keeps the last weights
    bfloat16: bool = True  # bfloat16 activations where the processor has it; parameters are always float32
    borders: float = 1.0  # sampling weight of pixels near borders of cast shadows in the losses
    faces: float = 1.0  # sampling weight of pixels of faces and hands
    angles: float = 0.0  # fraction of the angle in the loss of normals; the rest is the vectors' distance
    distil: float = 0.0  # fraction of the loss against the mean of two passes of a trained field
    duration: float | None = None  # minutes after which the run ends; its rate then follows the clock
    seed: int = 0


# Section 3, "Training and Implementation Details".
PAPER_EPOCHS = 31
UNLIMITED = 10**9  # steps of a run that ends after a duration
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
    """Return the Recipe of a preset for a task, with `changes`; changes that are None are ignored.

    "paper" is that of Section 3: Adam at a constant 5e-6, one map in each step, and float32. Unless `steps`
    is given, it runs 31 epochs over the maps of `records` (paths), where each record is assumed to have as
    many maps as the first. "fast" is ours: Muon at a much higher rate that warms up and decays, bfloat16, and
    several lights of several photographs in each step. It needs `steps` or a `duration`.
    """
    if name not in ("paper", "fast"):
        raise ValueError(f"preset: expected paper or fast, got {name!r}")
    chosen = PAPER if name == "paper" else task.recipe
    chosen = chosen | {key: value for key, value in changes.items() if value is not None}
    if "steps" not in chosen:
        if chosen.get("duration") is not None:
            return Recipe(steps=UNLIMITED, **chosen)
        if name == "fast":
            raise ValueError("steps: expected a number or a duration, since the preset 'fast' sets neither")
        source = Records(records)
        chosen["steps"] = PAPER_EPOCHS * len(source) * len(source[0].directions) // chosen["batch"]
    return Recipe(**chosen)


def learning_rate(recipe: Recipe, step: int, seconds: float = 0.0) -> float:
    """Return the rate at a step: a linear warm-up, then half a cosine to zero, or constant.

    A recipe with a duration has its cosine over the `seconds` of the run so far, so that the rate comes to
    zero at its end however fast the machine is.
    """
    rise = min(1.0, (step + 1) / max(1, recipe.warm_up))
    done = step / recipe.steps if recipe.duration is None else seconds / (60 * recipe.duration)
    if not recipe.cosine:
        return recipe.learning_rate * rise
    return recipe.learning_rate * rise * 0.5 * (1 + math.cos(math.pi * min(1.0, done)))
