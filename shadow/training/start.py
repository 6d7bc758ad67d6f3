"""Initialise a network from weights of the same kind, or from the backbone of another network."""

from pathlib import Path

import torch
from torch import nn

from shadow.networks import checkpoints
from shadow.networks.backbone import ResidualBlock


def warm_start(network: nn.Module, path: str | Path) -> None:
    """Copy the backbone, except its head, from the weights file of another network.

    Input channels that the other network lacks start at zero, and residual blocks that it lacks start as the
    identity, so the features are unchanged at first. Raises ValueError for another architecture.
    """
    state, metadata = checkpoints.read(path)
    own = network.state_dict()
    if not all(any(key.startswith("backbone.") for key in keys) for keys in (own, state)):
        kind = metadata.get("network")
        raise ValueError(f"init: {path} is a {kind!r} network, which has another architecture")
    for key, value in state.items():
        if not key.startswith("backbone.") or key.startswith("backbone.head."):
            continue
        if key == "backbone.stem.weight":
            padded = torch.zeros_like(own[key])
            channels = min(value.shape[1], padded.shape[1])
            padded[:, :channels] = value[:, :channels].float()
            value = padded
        if key not in own or own[key].shape != value.shape:
            raise ValueError(f"init: {path} has another architecture ({key}: {tuple(value.shape)})")
        own[key].copy_(value)
    _deepen(network, state)


def load_start(network: nn.Module, path: str | Path, kind: str) -> None:
    """Copy the weights of a network of the same kind, or the backbone of another network.

    The other network may be shallower. Outputs of the head that it lacks are the last ones and start at zero.
    Raises ValueError for weights of another architecture.
    """
    state, metadata = checkpoints.read(path)
    if metadata.get("network") != kind:
        warm_start(network, path)
        return
    state = _deepen(network, state) | {key: value.float() for key, value in state.items()}
    for key, own in network.state_dict().items():
        if key.startswith("backbone.head.") and key in state and len(state[key]) < len(own):
            state[key] = torch.cat([state[key], torch.zeros_like(own[len(state[key]) :])])
    try:
        network.load_state_dict(state)
    except RuntimeError as error:
        raise ValueError(f"init: {path} has another architecture: {error}") from error


def _deepen(network: nn.Module, state: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Set the residual blocks that `state` lacks to the identity, and return their parameters.

    A deeper network then starts with the output of the shallower one (Net2Net, CGS16).
    """
    blocks: dict[str, torch.Tensor] = {}
    for name, module in network.named_modules():
        if isinstance(module, ResidualBlock) and f"{name}.conv2.weight" not in state:
            nn.init.zeros_(module.conv2.weight)
            assert module.conv2.bias is not None
            nn.init.zeros_(module.conv2.bias)
            blocks |= {f"{name}.{key}": value for key, value in module.state_dict().items()}
    return blocks
