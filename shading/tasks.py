"""Losses, scores and pictures of the shading networks, for the training loop."""

import functools
from collections.abc import Callable, Iterator

import torch
import torch.nn.functional as F
from torch import nn

from shading.diffuse import Diffuse, PerLightShading, ShadingField, ShadingNetwork, Visible, base
from shadow.evaluation import metrics, pictures
from shadow.networks.backbone import ENCODING, take_blocks
from shadow.training.minibatches import Batch
from shadow.training.recipes import Task, unwrapped
from shadow.training.tasks import random_blocks

# Shading error at which the loss changes from quadratic to linear. The minimum of a linear loss is the
# median, which is lit or dark; that of a quadratic loss is the mean, which makes shadows grey.
LOSS_KNEE = 0.05
SHADING_WEIGHT = 5.0  # of the error of the shading
ABSOLUTE_WEIGHT = 0.2  # of the error of the albedo's overall colour and brightness
PHOTOGRAPH_WEIGHT = 0.5  # of the error of the photograph that albedo and shading reproduce
SHADOW_WEIGHT = 3.0  # added to the weight of the albedo's error where no light falls, less toward the mean

Take = Callable[[torch.Tensor], torch.Tensor]  # selects pixels of maps (..., H, W)


def _encoded(linear: torch.Tensor) -> torch.Tensor:
    return linear.clamp_min(1e-4) ** (1 / ENCODING)


def _aligned(estimate: torch.Tensor, truth: torch.Tensor, inside: torch.Tensor) -> torch.Tensor:
    """Scale each channel of the estimate to the truth's mean inside the mask.

    Since image = albedo × light, the exposure and colour of the light are ambiguous. Without this scaling,
    their error would be much larger than that of shadows that remain in the albedo. The gradient includes the
    scale: with a constant scale, shadows that remain in the albedo would make all of it darker.
    """
    means = [(image * inside).sum(dim=(-2, -1), keepdim=True) for image in (truth, estimate)]
    return estimate * (means[0] / means[1].clamp_min(1e-3)).clamp(0.2, 5)


def true_shading(batch: Batch, take: Take = lambda image: image) -> torch.Tensor:
    """Return the path-traced shading (B, L, H, W), at most 1, of the batch's directions.

    `take` selects pixels of the maps.
    """
    normals, visibility, bounce = (take(batch[key]) for key in ("normals", "visibility", "bounce"))
    indirect = torch.einsum("blk,bkhw->blhw", batch["bounce_patterns"], bounce).clamp_min(0)
    return (base(normals, visibility, batch["directions"]) + indirect).clamp_max(1)


def _inferred(batch: Batch, directions: torch.Tensor, take: Take = lambda image: image) -> torch.Tensor:
    """Infer visibility (B, D, H, W) of unit directions (B, D, 3) by the batch's field.

    It is zero outside the matte, like the result of the field's `analyse`. `take` selects pixels of the maps.
    """
    maps, matte = batch["visibility_maps"].at(take), take(batch["matte"])
    return batch["visibility_network"].log_visibility(maps, directions).exp() * (matte > 0)


def _shading_error(estimate: torch.Tensor, truth: torch.Tensor, inside: torch.Tensor) -> torch.Tensor:
    """Return the smooth L1 error of the shading and of its differences between neighbours (shadow edges).

    Both are 2 x 2 blocks (B, L, 4, ...). Estimates below zero have no error where the truth is 0.
    """
    difference = torch.where((estimate < 0) & (truth < 1e-3), 0.0, estimate - truth)
    total = (_soft(difference) * inside).sum()
    whole = inside.amin(dim=2, keepdim=True)
    total = total + sum((_soft(edge) * whole).sum() for edge in _edges(difference))
    return total / (inside.sum() * truth.shape[1]).clamp_min(1)


def _soft(error: torch.Tensor) -> torch.Tensor:
    return (error.square() + LOSS_KNEE**2).sqrt() - LOSS_KNEE


def _edges(blocks: torch.Tensor) -> list[torch.Tensor]:
    """Return the differences (B, C, 2, ...) between the columns, and between the rows, of 2 x 2 blocks.

    The blocks are (B, C, 4, ...).
    """
    top, bottom, left, right = (0, 1), (2, 3), (0, 2), (1, 3)
    return [blocks[:, :, a] - blocks[:, :, b] for a, b in ((top, bottom), (left, right))]


def albedo_error(
    estimate: torch.Tensor, truth: torch.Tensor, inside: torch.Tensor, light: torch.Tensor
) -> torch.Tensor:
    """Return the L1 error of the aligned encoded albedo and of its differences between neighbours.

    The differences preserve texture and penalise shadow edges. The L1 error without alignment is added with a
    small weight. Pixels with less `light` than the mean have a larger weight: shadows cover less of a
    photograph than light does, and what the albedo keeps of them is seen in every new light. All arguments
    are 2 x 2 blocks (B, 3, 4, P), and `inside` (B, 1, 4, P).
    """
    difference = (_aligned(estimate, truth, inside) - truth) * inside
    whole = inside.amin(dim=2, keepdim=True)
    brightness = light.mean(dim=1, keepdim=True) * inside
    mean = brightness.sum(dim=(2, 3), keepdim=True) / inside.sum(dim=(2, 3), keepdim=True).clamp_min(1)
    weight = 1 + SHADOW_WEIGHT * (1 - brightness / mean.clamp_min(1e-6)).clamp_min(0)
    total = (weight * difference.abs()).sum() + ABSOLUTE_WEIGHT * ((estimate - truth) * inside).abs().sum()
    total = total + sum((edge * whole).abs().sum() for edge in _edges(difference))
    return total / (3 * inside.sum()).clamp_min(1)


def shading_loss(network: nn.Module, batch: Batch) -> torch.Tensor:
    """Return the weighted errors of shading, albedo, and the photograph that they reproduce in its lighting.

    The error of the photograph keeps shading and albedo consistent: what is shadow in one must not be paint
    in the other.
    """
    model = unwrapped(network)
    with torch.no_grad():
        anchors = model.anchors.expand(len(batch["rgb"]), -1, -1)
        guides = _inferred(batch, anchors, lambda image: image[..., ::2, ::2])
    blocks = random_blocks(batch["attention"])
    take = functools.partial(take_blocks, blocks=blocks)
    maps = network(batch["image"], batch["estimated_normals"], guides, blocks)
    inside = (take(batch["mask"]) > 0.5).float()
    visible = _inferred(batch, batch["directions"], take)
    estimate = model.shading(maps, take(batch["estimated_normals"]), visible, batch["directions"])
    shading, albedo = true_shading(batch, take), take(batch["albedo"])
    estimated_light, light = (
        torch.einsum("blhw,blc->bchw", each.clamp(0, 1), batch["weights"]) for each in (estimate, shading)
    )
    estimated = _encoded(maps.albedo.clamp(0, 1.5) ** ENCODING * estimated_light)
    photographed = _encoded(albedo * light)
    reproduction = ((_aligned(estimated, photographed, inside) - photographed) * inside).abs().sum()
    return (
        SHADING_WEIGHT * _shading_error(estimate, shading, inside)
        + albedo_error(maps.albedo, _encoded(albedo), inside, light)
        + PHOTOGRAPH_WEIGHT * reproduction / (3 * inside.sum()).clamp_min(1)
    )


def _diffuse(network: ShadingNetwork, batch: Batch) -> Iterator[tuple[Diffuse, Visible]]:
    """Yield, for each photograph of the batch, its Diffuse and the visibility as a function of directions."""
    for i in range(len(batch["rgb"])):
        rgb, matte, surface = batch["rgb"][i], batch["matte"][i, 0], batch["estimated_normals"][i]
        visibility = lambda lights, i=i: _inferred(batch, lights[None], lambda image: image[i : i + 1])[0]  # noqa: E731
        yield network.analyse(rgb, matte, surface, visibility), visibility


def _shading_score(network: ShadingNetwork, batch: Batch) -> dict[str, float]:
    """Return the scores of a batch.

    They are the RMSE of the shading and of the base image, and the L1 error of the encoded albedo and of the
    photograph, both aligned.
    """
    inside, truth = batch["mask"] > 0.5, true_shading(batch)
    analysed = list(_diffuse(network, batch))
    shading = torch.stack(
        [each.shading(lights) for (each, _), lights in zip(analysed, batch["directions"], strict=True)]
    )
    visible = torch.stack([v(lights) for (_, v), lights in zip(analysed, batch["directions"], strict=True)])
    direct = base(batch["estimated_normals"], visible, batch["directions"])
    scores = {
        "rmse": float(metrics.rmse(shading, truth, inside).mean()),
        "rmse_base": float(metrics.rmse(direct, truth, inside).mean()),
    }
    paint, within = _encoded(batch["albedo"]), inside.float()
    images = {"l1_photograph": batch["image"][:, :3]}
    if analysed[0][0].albedo is not None:
        images["l1"] = _encoded(torch.stack([each.albedo for each, _ in analysed if each.albedo is not None]))
    for name, image in images.items():
        error = (_aligned(image, paint, within) - paint).abs() * within
        scores[name] = float(error.sum() / (3 * within.sum()))
    return scores


def _shading_show(network: ShadingNetwork, batch: Batch) -> Iterator[list[torch.Tensor]]:
    truth = true_shading(batch)
    for i, (each, _) in enumerate(_diffuse(network, batch)):
        seen = batch["mask"][i] > 0.5
        columns = [pictures.show_linear(batch["rgb"][i] * seen)]
        if each.albedo is not None:
            columns += [pictures.show_linear(image * seen) for image in (each.albedo, batch["albedo"][i])]
        shading = each.shading(batch["directions"][i])
        for light in range(0, len(shading), max(1, len(shading) // 3)):
            for image in (shading, truth[i]):
                columns.append(pictures.show_linear((image[light] * seen).expand(3, -1, -1)))
        yield columns


SHADING = Task("shading", ShadingField, shading_loss, _shading_score, _shading_show, 40, True, {}, {}, True)


def per_light_loss(network: nn.Module, batch: Batch) -> torch.Tensor:
    """Return the L1 error of the linear shading (Sections 3 and 4.4)."""
    with torch.no_grad():
        visible = _inferred(batch, batch["directions"])
    estimate = network(batch["image"], batch["estimated_normals"], visible, batch["directions"])
    maps = estimate, true_shading(batch), (batch["mask"] > 0.5).float()
    return _shading_error(*(F.pixel_unshuffle(image, 2).unflatten(1, (-1, 4)) for image in maps))


def per_light_task(latent: str = "resb7", normals: bool = True, visibility: str | None = "inferred") -> Task:
    """Return the task of the paper's network.

    `normals` and `visibility`: its inputs, see `PerLightShading`; those that are not the defaults are the
    ablations of Table 6.
    """
    config = {"latent": latent, "normals": normals, "visibility": visibility}
    recipe = {"batch": 2, "lights": 4, "learning_rate": 5e-4}
    return Task(
        "shading-per-light", PerLightShading, per_light_loss, _shading_score, _shading_show, 20, True,
        config, recipe, True,
    )  # fmt: skip
