"""What the networks of this package learn: losses, scores and pictures of the normals, the visibility field
and the paper's per-light network, for the fit loop."""

import torch
import torch.nn.functional as F
from torch import nn

from shadow import metrics, pictures
from shadow.backbone import take_blocks
from shadow.field import VisibilityField
from shadow.normals import NormalsNetwork
from shadow.training import Task
from shadow.unet import PerLight

BLOCKS = 1024  # of 2 x 2 pixels of a photograph, that the visibility loss looks at


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


def random_blocks(mask):
    """BLOCKS random 2 x 2 pixel blocks (B, BLOCKS) of masks (B, 1, H, W), for `take_blocks`."""
    inside = F.max_pool2d((mask > 0.5).float(), 2).flatten(1)
    return torch.multinomial(inside, BLOCKS, replacement=True)


def visibility_loss(network, batch):
    """Binary cross-entropy of the product's probability.

    On a random choice of 2 x 2 pixel blocks inside the mask: the background teaches nothing, neighbours teach
    little, and features times lights at every pixel would cost as much as the network.
    """
    field = network.module if isinstance(network, nn.parallel.DistributedDataParallel) else network
    blocks = random_blocks(batch["mask"])
    maps = network(batch["image"], batch["estimated_normals"], blocks)
    truth, mask = (take_blocks(batch[key], blocks) for key in ("visibility", "mask"))
    log_lit = field.log_visibility(maps, batch["directions"]).clamp_max(-1e-5)
    log_dark = torch.log(-torch.expm1(log_lit))
    entropy = -(truth * log_lit + (1 - truth) * log_dark)
    return _masked_mean(entropy, mask > 0.5)


def per_light_loss(network, batch):
    """L1 (Section 3) inside the mask, of maps whose shadow is -1 and light is 1."""
    maps = network(batch["image"], batch.get("estimated_normals"), batch["directions"])
    return _masked_mean((maps - (2 * batch["visibility"] - 1)).abs(), batch["mask"] > 0.5)


def _visibility(network, batch):
    # A network that looks at no normals is as well served by these.
    surfaces = batch.get("estimated_normals", batch["normals"])
    views = zip(batch["rgb"], batch["mask"][:, 0], surfaces, batch["directions"], strict=True)
    return torch.stack([network.analyse(rgb, mask, n)(lights) for rgb, mask, n, lights in views])


def _visibility_score(network, batch):
    """RMSE and Dice of binary maps, beside sign(N·L) from the same estimated normals."""
    inside, truth = batch["mask"] > 0.5, (batch["visibility"] > 0.5).float()
    estimates = {"": _visibility(network, batch) > 0.5}
    if "estimated_normals" in batch:
        cosine = torch.einsum("bdc,bchw->bdhw", batch["directions"], batch["estimated_normals"])
        estimates["_baseline"] = cosine > 0
    scores = {}
    for name, estimate in estimates.items():
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


def per_light(latent, with_normals=True):
    """The task of the paper's per-light network with this latent transformation (Section 4.2)."""
    config = {"latent": latent, "normals": with_normals}
    score, show = _visibility_score, _visibility_show
    recipe = {"batch": 2, "lights": 4, "learning_rate": 5e-4}
    return Task(latent, PerLight, per_light_loss, score, show, 20, with_normals, config, recipe)
