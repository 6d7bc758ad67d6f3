"""Losses, scores and pictures of the visibility field and of the paper's per-light network."""

import functools
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import nn

from shadow.analysis import VisibilityNetwork
from shadow.evaluation import metrics, pictures
from shadow.networks.backbone import take_blocks
from shadow.networks.field import FieldMaps, VisibilityField
from shadow.networks.unet import PerLight
from shadow.training.minibatches import Batch
from shadow.training.recipes import Task, unwrapped

BLOCKS = 1024  # blocks of 2 x 2 pixels of each photograph that the losses use
DEPTH_WEIGHT, SLOPE_WEIGHT = 2.0, 0.1  # of the errors of depth, in heights, and of its slopes, in radians
DEPTH_RIDGE = 0.05  # heights: depths that deviate less than this from their mean are hardly rescaled


def _masked_mean(values: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    return (values * mask).sum() / (mask.sum() * values.shape[1]).clamp_min(1)


def random_blocks(attention: torch.Tensor) -> torch.Tensor:
    """Draw BLOCKS random 2 x 2 pixel blocks (B, BLOCKS) for `take_blocks`.

    A block's probability is proportional to the highest `attention` (B, 1, H, W) of its pixels, which is zero
    outside the subject. If the map is empty, any blocks are drawn: a random crop may show almost no subject.
    """
    inside = F.max_pool2d(attention, 2).flatten(1)
    return torch.multinomial(inside + 1e-9, BLOCKS, replacement=True)


def field_loss(network: nn.Module, batch: Batch) -> torch.Tensor:
    """Return the errors of normals and visibility, with equal weights, and of depth if the records have it.

    They are computed on random 2 x 2 pixel blocks inside the mask: the background teaches nothing, neighbours
    teach little, and the product of features and lights at every pixel would cost as much as the network. The
    attached shadow takes the normals of the field or of the batch's estimator. Its sharpness expresses how
    reliable they are.

    If the batch has a `teacher`, a trained field, the fraction `distil` of the loss compares with the mean of
    its maps of the photograph and of the mirror image instead of the truth (knowledge distillation, HVD15).
    """
    field = unwrapped(network)
    blocks = random_blocks(batch["attention"])
    take = functools.partial(take_blocks, blocks=blocks)
    maps = network(batch["image"], blocks)
    inside = take(batch["mask"]) > 0.5
    given = batch.get("estimated_normals")
    gated = maps._replace(normals=maps.normals.detach() if given is None else take(given))
    log_lit = field.log_visibility(gated, batch["directions"])
    depth_known = inside & (batch["depth_known"] > 0)[:, :, None, None]
    truth = Targets(take(batch["normals"]), take(batch["visibility"]), take(batch["depth"]), depth_known)
    height = batch["image"].shape[2]
    error = _field_error(maps, log_lit, truth, inside, height, batch["angles"])
    teacher = batch.get("teacher")
    if teacher is None:
        return error
    mean = teacher.mean_at(batch["image"], blocks)
    visibility = teacher.log_visibility(mean, batch["directions"]).exp()
    targets = Targets(mean.normals, visibility, mean.depth, inside)
    distilled = _field_error(maps, log_lit, targets, inside, height, batch["angles"])
    return error.lerp(distilled, batch["distil"])


class Targets(NamedTuple):
    """What a field learns, at 2 x 2 blocks (B, C, 4, P)."""

    normals: torch.Tensor  # (B, 3, 4, P)
    visibility: torch.Tensor  # (B, D, 4, P) in [0, 1]
    depth: torch.Tensor  # (B, 1, 4, P), or no channel if there is none to learn
    depth_known: torch.Tensor  # (B, 1, 4, P) bool


def _field_error(
    maps: FieldMaps, log_lit: torch.Tensor, targets: Targets, inside: torch.Tensor, height: int, angles: float
) -> torch.Tensor:
    """Return the sum of the errors of a field's maps and logarithmic visibility (B, D, 4, P)."""
    error = normals_error(maps.normals, targets.normals, inside, angles)
    error = error + _entropy(log_lit, targets.visibility, inside)
    if not maps.depth.shape[1] or not targets.depth.shape[1]:
        return error
    return error + depth_error(maps.depth, targets.depth, targets.depth_known, height)


def depth_error(
    estimate: torch.Tensor, truth: torch.Tensor, inside: torch.Tensor, height: int
) -> torch.Tensor:
    """Return the error of the depths (B, 1, 4, P) of blocks, plus the error of their slopes.

    The first is invariant to offset and scale (RLH*20, MiDaS). The scale is the least-squares one with a
    ridge toward 1, which leaves flat estimates unchanged and makes the error lowest at the true scale, so
    that depth keeps its unit. Slopes between pixels are angles, so that occlusions do not dominate. `height`:
    canvas pixels.
    """
    count = inside.sum(dim=(2, 3), keepdim=True).clamp_min(1)
    estimate, truth = (
        (depth - (depth * inside).sum(dim=(2, 3), keepdim=True) / count) * inside
        for depth in (estimate, truth)
    )
    ridge = count * DEPTH_RIDGE**2
    fixed = estimate.detach()
    scale = ((fixed * truth).sum(dim=(2, 3), keepdim=True) + ridge) / (
        fixed.square().sum(dim=(2, 3), keepdim=True) + ridge
    )
    scaled = estimate * scale.clamp_min(0.1)
    whole = inside.all(dim=2, keepdim=True)
    steps = [(1, 0), (3, 2), (2, 0), (3, 1)]  # pairs of pixels of a block: to the right, and down
    slopes = [
        torch.stack([torch.atan(height * (d[:, :, a] - d[:, :, b])) for a, b in steps], dim=2)
        for d in (scaled, truth)
    ]
    bent = _masked_mean((slopes[0] - slopes[1]).abs(), whole.expand_as(slopes[0]))
    return DEPTH_WEIGHT * _masked_mean((scaled - truth).abs(), inside) + SLOPE_WEIGHT * bent


def normals_error(
    estimate: torch.Tensor, truth: torch.Tensor, inside: torch.Tensor, angles: float = 0.0
) -> torch.Tensor:
    """Return the distance between unit vectors, blended with their angle by the fraction `angles`.

    The distance is close to the angle in radians, but gives large errors less weight.
    """
    length = ((estimate - truth).square().sum(dim=1, keepdim=True) + 1e-4).sqrt()
    if not angles:
        return _masked_mean(length, inside)
    angle = 2 * torch.asin((length / 2).clamp_max(0.999))
    return _masked_mean(length.lerp(angle, angles), inside)


def _entropy(log_lit: torch.Tensor, truth: torch.Tensor, inside: torch.Tensor) -> torch.Tensor:
    """Return the binary cross-entropy of the predicted probability of light."""
    log_lit = log_lit.clamp_max(-1e-5)
    log_dark = torch.log(-torch.expm1(log_lit))
    return _masked_mean(-(truth * log_lit + (1 - truth) * log_dark), inside)


def per_light_loss(network: nn.Module, batch: Batch) -> torch.Tensor:
    """Return the L1 error (Section 3) inside the mask of maps in which shadow is -1 and light is 1."""
    maps = network(batch["image"], batch.get("estimated_normals"), batch["directions"])
    return _masked_mean((maps - (2 * batch["visibility"] - 1)).abs(), batch["mask"] > 0.5)


def _analysed(
    network: VisibilityNetwork, batch: Batch
) -> tuple[torch.Tensor | None, torch.Tensor, torch.Tensor | None]:
    """Infer normals (B, 3, H, W), visibility (B, D, H, W) and depth (B, H, W) of the batch.

    Normals are None if the network neither infers nor takes any. Depth is None if the network infers none.
    """
    given = batch.get("estimated_normals", [None] * len(batch["rgb"]))
    views = zip(batch["rgb"], batch["matte"][:, 0], given, batch["directions"], strict=True)
    analyses = [(network.analyse(rgb, mask, surface), lights) for rgb, mask, surface, lights in views]
    surfaces = [surface for (surface, _), _ in analyses]
    maps = torch.stack([visibility(lights) for (_, visibility), lights in analyses])
    depths = [getattr(visibility, "depth", None) for (_, visibility), _ in analyses]
    return _stacked(surfaces), maps, _stacked(depths)


def _stacked(maps: Iterable[torch.Tensor | None]) -> torch.Tensor | None:
    known = [each for each in maps if each is not None]  # all of them or none
    return torch.stack(known) if known else None


def _score(network: VisibilityNetwork, batch: Batch) -> dict[str, float]:
    """Return the scores of a batch.

    They are RMSE and Dice of binary maps and of sign(N·L) from the same normals, and errors of normals and
    depth.
    """
    inside, truth = batch["mask"] > 0.5, (batch["visibility"] > 0.5).float()
    surface, maps, depth = _analysed(network, batch)
    estimates, scores = {"": maps > 0.5}, {}
    if surface is not None:
        estimates["_baseline"] = torch.einsum("bdc,bchw->bdhw", batch["directions"], surface) > 0
        scores["angle"] = float(metrics.angular_error(surface, batch["normals"], inside[:, 0]).mean())
    known = batch["depth_known"][:, 0] > 0
    if depth is not None and known.any():
        errors = metrics.depth_error(depth, batch["depth"][:, 0], inside[:, 0])
        scores["depth"] = float(errors[known].mean())
    for name, estimate in estimates.items():
        scores["rmse" + name] = float(metrics.rmse(estimate.float(), truth, inside).mean())
        scores["dice" + name] = float(metrics.dice(estimate.float(), truth, inside).mean())
    return scores


def _show(network: VisibilityNetwork, batch: Batch) -> Iterator[list[torch.Tensor]]:
    surface, maps, _ = _analysed(network, batch)
    for i in range(len(maps)):
        seen = batch["mask"][i] > 0.5
        columns = [pictures.show_linear(batch["rgb"][i] * seen)]
        if surface is not None:
            columns += [pictures.show_normals(image[i] * seen) for image in (surface, batch["normals"])]
        for light in range(0, maps.shape[1], max(1, maps.shape[1] // 4)):
            columns.append((maps[i, light] * seen).expand(3, -1, -1))
            columns.append((batch["visibility"][i, light] * seen).expand(3, -1, -1))
        yield columns


SHADOW = Task("field", VisibilityField, field_loss, _score, _show, 20, False, {"depth": True})


def per_light(latent: str, with_normals: bool = True) -> Task:
    """Return the task of the paper's per-light network with a latent transformation of Section 4.2."""
    config = {"latent": latent, "normals": with_normals}
    recipe = {"batch": 2, "lights": 4, "learning_rate": 5e-4}
    return Task(latent, PerLight, per_light_loss, _score, _show, 20, with_normals, config, recipe)
