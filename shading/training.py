"""Losses of the shading networks, for the shared fit loop."""

from shading.albedo import AlbedoNetwork
from shadow import pictures
from shadow.training import Task


def _encoded(albedo):
    return albedo.clamp_min(1e-4) ** (1 / 2.2)


def albedo_loss(network, batch):
    """L1 of the encoded albedo and of its gradients, which hold texture and refuse shadow edges."""
    estimate = network(batch["image"], batch["estimated_normals"])
    inside = (batch["mask"] > 0.9).float()
    difference = (estimate - _encoded(batch["albedo"])) * inside
    across = (difference[..., 1:] - difference[..., :-1]) * inside[..., 1:] * inside[..., :-1]
    down = (difference[..., 1:, :] - difference[..., :-1, :]) * inside[..., 1:, :] * inside[..., :-1, :]
    return (difference.abs().sum() + across.abs().sum() + down.abs().sum()) / (3 * inside.sum()).clamp_min(1)


def _albedo_score(network, batch):
    """L1 of the encoded albedo, beside that of the photograph itself."""
    inside, truth = batch["mask"] > 0.9, _encoded(batch["albedo"])
    estimate = network(batch["image"], batch["estimated_normals"])
    area = 3 * inside.sum()
    return {
        "l1": float(((estimate - truth).abs() * inside).sum() / area),
        "l1_photograph": float(((batch["image"][:, :3] - truth).abs() * inside).sum() / area),
    }


def _albedo_show(network, batch):
    estimate = network(batch["image"], batch["estimated_normals"]).clamp(0, 1)
    for i in range(len(estimate)):
        seen = batch["mask"][i] > 0.5
        yield [
            pictures.show_linear(batch["rgb"][i] * seen),
            estimate[i] * seen,
            pictures.show_linear(batch["albedo"][i] * seen),
        ]


ALBEDO = Task("albedo", AlbedoNetwork, albedo_loss, _albedo_score, _albedo_show, 1, True)
