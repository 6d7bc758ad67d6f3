"""Losses of the shading networks, for the shared fit loop."""

from shading.albedo import AlbedoNetwork
from shadow import pictures
from shadow.backbone import ENCODING
from shadow.training import Task

ABSOLUTE = 0.2  # weight of the error in overall colour and brightness


def _encoded(albedo):
    return albedo.clamp_min(1e-4) ** (1 / ENCODING)


def _aligned(estimate, truth, inside):
    """The estimate, each channel scaled to the truth's mean inside the mask.

    Exposure and the colour of the light cannot be told from those of the albedo (image = albedo × light), and
    without this their error drowns that of the shadows left behind.
    """
    means = [(image * inside).sum(dim=(-2, -1), keepdim=True) for image in (truth, estimate)]
    return estimate * (means[0] / means[1].clamp_min(1e-3)).detach().clamp(0.2, 5)


def albedo_loss(network, batch):
    """L1 of the aligned encoded albedo and of its gradients, which hold texture and refuse shadow edges; and
    a little L1 of the albedo as it is."""
    inside, truth = (batch["mask"] > 0.9).float(), _encoded(batch["albedo"])
    estimate = network(batch["image"], batch["estimated_normals"])
    difference = (_aligned(estimate, truth, inside) - truth) * inside
    across = (difference[..., 1:] - difference[..., :-1]) * inside[..., 1:] * inside[..., :-1]
    down = (difference[..., 1:, :] - difference[..., :-1, :]) * inside[..., 1:, :] * inside[..., :-1, :]
    absolute = ABSOLUTE * (estimate - truth) * inside
    total = sum(error.abs().sum() for error in (difference, across, down, absolute))
    return total / (3 * inside.sum()).clamp_min(1)


def _albedo_score(network, batch):
    """L1 of the aligned encoded albedo, beside that of the photograph itself."""
    inside, truth = (batch["mask"] > 0.9).float(), _encoded(batch["albedo"])
    estimate = network(batch["image"], batch["estimated_normals"])
    return {
        name: float(((_aligned(image, truth, inside) - truth).abs() * inside).sum() / (3 * inside.sum()))
        for name, image in (("l1", estimate), ("l1_photograph", batch["image"][:, :3]))
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
