"""The optimiser of the training loop: Adam, as in Section 3, or Muon, which needs fewer photographs."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import torch
from torch import nn

from shadow.networks.precision import in_use

if TYPE_CHECKING:
    from shadow.training.recipes import Recipe

MOMENTUM = 0.95  # of Muon, torch.optim.Muon's default
MIN_MATRIX_SIDE = 32  # a matrix with fewer rows or columns gains little from orthogonalisation


class Optimiser:
    """AdamW, or, if the recipe says "muon", Muon for matrices and AdamW for the other parameters.

    Muon (Jordan et al. 2024, kellerjordan.github.io/posts/muon) makes all singular values of a matrix's step
    equal. A convolution is a matrix with one row for each output channel. The steps are scaled to the size of
    Adam's (LSY*25, "Muon is Scalable for LLM Training"), so that one learning rate serves both. Muon needs
    `network` in channels-last memory, where a convolution's weights have the layout of such a matrix.
    """

    def __init__(self, network: nn.Module, recipe: "Recipe") -> None:
        if recipe.optimiser not in ("adam", "muon"):
            raise ValueError(f"optimiser: expected adam or muon, got {recipe.optimiser!r}")
        muon = recipe.optimiser == "muon"
        self.weights: list[nn.Parameter] = []
        matrices: list[nn.Parameter] = []
        vectors: list[nn.Parameter] = []
        for name, parameter in network.named_parameters():
            # Muon's authors train the last layer with Adam. With Muon, a zero-initialised one grows slowly.
            last = "head" in name.split(".")
            if muon and not last and min(len(parameter), parameter[0].numel()) >= MIN_MATRIX_SIDE:
                self.weights.append(parameter)
            else:
                (matrices if parameter.ndim > 1 else vectors).append(parameter)
        # torch's Muon takes two-dimensional parameters. These views share the memory of the weights.
        self.views = [nn.Parameter(_rows(weight.detach()).view(len(weight), -1)) for weight in self.weights]
        decay = recipe.weight_decay
        groups = [
            {"params": matrices, "weight_decay": decay},
            {"params": vectors, "weight_decay": 0},  # biases and norms
        ]
        self.parts: list[torch.optim.Optimizer] = [
            torch.optim.AdamW([group for group in groups if group["params"]], betas=recipe.betas)
        ]
        if self.views:
            # torch's Muon always orthogonalises in bfloat16.
            if in_use(self.views[0].device) == "bfloat16":
                self.parts.append(
                    torch.optim.Muon(self.views, weight_decay=decay, adjust_lr_fn="match_rms_adamw")
                )
            else:
                self.parts.append(FloatMuon(self.views, decay))

    def step(self, learning_rate: float) -> None:
        """Take one step and clear the gradients."""
        for weight, view in zip(self.weights, self.views, strict=True):
            view.grad = None if weight.grad is None else _rows(weight.grad).reshape(view.shape)
        for part in self.parts:
            for group in part.param_groups:
                group["lr"] = learning_rate
            part.step()
            part.zero_grad(set_to_none=True)
        for weight in self.weights:
            weight.grad = None

    def state_dict(self) -> dict[str, list[dict[str, object]]]:
        return {"parts": [part.state_dict() for part in self.parts]}

    def load_state_dict(self, state: dict[str, list[dict[str, object]]]) -> None:
        for part, saved in zip(self.parts, state["parts"], strict=True):
            # The options of a group belong to the optimiser of this processor, see `FloatMuon`.
            own = part.state_dict()["param_groups"]
            part.load_state_dict({"state": saved["state"], "param_groups": own})


class FloatMuon(torch.optim.Optimizer):
    """Muon in float32, which is several times as fast as torch.optim.Muon on processors without bfloat16."""

    def __init__(self, params: Iterable[nn.Parameter], weight_decay: float) -> None:
        super().__init__(params, {"lr": 1e-3, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self, closure: None = None) -> None:  # type: ignore[override]  # there is no closure to call
        """Take one step with Nesterov's momentum."""
        for group in self.param_groups:
            for parameter in (each for each in group["params"] if each.grad is not None):
                state = self.state[parameter]
                momentum = state.setdefault("momentum_buffer", torch.zeros_like(parameter))
                momentum.lerp_(parameter.grad, 1 - MOMENTUM)
                update = orthogonalise(parameter.grad.lerp(momentum, MOMENTUM))
                parameter.mul_(1 - group["lr"] * group["weight_decay"])
                # Scaled to the size of Adam's step (LSY*25, Section 2.2).
                parameter.add_(update, alpha=-group["lr"] * 0.2 * max(parameter.shape) ** 0.5)


def orthogonalise(matrix: torch.Tensor) -> torch.Tensor:
    """Return a matrix (N, M) with the same singular vectors and all singular values near one.

    Uses five steps of the Newton-Schulz iteration with Jordan's coefficients.
    """
    a, b, c = 3.4445, -4.7750, 2.0315
    wide = matrix if len(matrix) <= matrix.shape[1] else matrix.T
    x = wide / wide.norm().clamp_min(1e-7)
    for _ in range(5):
        gram = x @ x.T
        x = torch.addmm(x, torch.addmm(gram, gram, gram, beta=b, alpha=c), x, beta=a)
    return x if wide is matrix else x.T


def _rows(weight: torch.Tensor) -> torch.Tensor:
    """View a convolution's weights (out, in, h, w) as (out, h, w, in), the channels-last order."""
    return weight if weight.ndim == 2 else weight.permute(0, 2, 3, 1)
