"""Initialise a network from weights of the same kind, or from the backbone of another network."""

from pathlib import Path

import torch
from torch import nn

from shadow.networks import checkpoints
from shadow.networks.backbone import ResidualBlock


def load_start(network: nn.Module, path: str | Path, kind: str) -> None:
    """Copy the weights of a network of the same kind, or the backbone of another, except its head.

    The other network may be shallower. Residual blocks that it lacks start as the identity. Input channels
    that another kind lacks, and outputs of the head that the same kind lacks, are the last ones and start at
    zero. So the features are unchanged at first. Raises ValueError for weights of another architecture.
    """
    state, metadata = checkpoints.read(path)
    state, own = {key: value.float() for key, value in state.items()}, network.state_dict()
    rest: dict[str, torch.Tensor] = {}
    if metadata.get("network") == kind:
        for key in (key for key in own if key.startswith("backbone.head.") and key in state):
            state[key] = torch.cat([state[key], torch.zeros_like(own[key][len(state[key]) :])])
    else:
        if not all(any(key.startswith("backbone.") for key in keys) for keys in (own, state)):
            other = metadata.get("network")
            raise ValueError(f"init: {path} is a {other!r} network, which has another architecture")
        kept = {key for key in state if key.startswith("backbone.") and not key.startswith("backbone.head.")}
        state, rest = {key: state[key] for key in kept}, own
        stem, wanted = state["backbone.stem.weight"], own["backbone.stem.weight"].shape[1]
        missing = stem.new_zeros(len(stem), max(0, wanted - stem.shape[1]), *stem.shape[2:])
        state["backbone.stem.weight"] = torch.cat([stem[:, :wanted], missing], dim=1)
    try:
        network.load_state_dict(rest | _deepen(network, state) | state)
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
