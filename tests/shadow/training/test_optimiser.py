"""The optimiser: which parameters get which step, and that the steps are those of torch's own classes."""

from dataclasses import replace

import pytest
import torch
from torch import nn

from shadow.networks.precision import using
from shadow.training.optimiser import Optimiser, orthogonalise
from shadow.training.recipes import Recipe

RECIPE = Recipe(steps=1, weight_decay=0.0)


def network():
    torch.manual_seed(0)
    layers = nn.Conv2d(32, 40, 3), nn.LayerNorm(40), nn.Linear(40, 48), nn.Linear(48, 3)
    return nn.ModuleList(layers).to(memory_format=torch.channels_last)


def descend(module, stepping, steps=2, seed=1):
    torch.manual_seed(seed)
    for _ in range(steps):
        for parameter in module.parameters():
            parameter.grad = torch.randn_like(parameter)
        stepping.step(1e-2)
        assert all(parameter.grad is None for parameter in module.parameters())


def test_a_convolution_steps_alike_along_all_its_singular_vectors():
    layers = network()
    before = layers[0].weight.detach().clone()
    descend(layers, Optimiser(layers, RECIPE), steps=1)
    step = (layers[0].weight.detach() - before).flatten(1)
    sizes = torch.linalg.svdvals(step)
    assert sizes.min() > 0.5 * sizes.max()
    rms = 0.2 * 1e-2  # of an entry of Adam's step, about
    assert step.square().mean().sqrt() == pytest.approx(rms, rel=0.3)


def test_without_native_bfloat16_the_step_is_the_same_in_float32():
    """Orthogonalised in 8 bits a step is off by a hundredth or so of its size."""
    ours, theirs = network(), network()
    recipe = replace(RECIPE, weight_decay=0.1)
    for layers, precision in ((ours, "float32"), (theirs, "bfloat16")):
        with using(precision):
            descend(layers, Optimiser(layers, recipe), steps=3)
    for index in (0, 2):
        before = network()[index].weight.detach()
        step, other = (layers[index].weight.detach() - before for layers in (ours, theirs))
        assert 0 < (step - other).norm() / other.norm() < 0.03


def test_a_run_without_native_bfloat16_is_float32_throughout():
    matrix = torch.randn(40, 96, generator=torch.Generator().manual_seed(0))
    sizes = torch.linalg.svdvals(orthogonalise(matrix))
    assert orthogonalise(matrix).dtype == torch.float32
    assert 0.5 < sizes.min() < sizes.max() < 1.3
    torch.testing.assert_close(orthogonalise(matrix.T), orthogonalise(matrix).T)


def test_matrices_step_as_torchs_muon_and_the_rest_as_its_adamw():
    ours, theirs = network(), network()
    with using("bfloat16"):
        descend(ours, Optimiser(ours, RECIPE))
    muon = torch.optim.Muon([theirs[2].weight], lr=1e-2, weight_decay=0, adjust_lr_fn="match_rms_adamw")
    rest = [theirs[0].bias, *theirs[1].parameters(), theirs[2].bias, *theirs[3].parameters()]
    adam = torch.optim.AdamW(rest, lr=1e-2, betas=RECIPE.betas, weight_decay=0)
    torch.manual_seed(1)
    for _ in range(2):
        for parameter in theirs.parameters():
            parameter.grad = torch.randn_like(parameter)
        muon.step()
        adam.step()
    for layer in (1, 2, 3):
        for name, value in ours[layer].named_parameters():
            torch.testing.assert_close(value, theirs[layer].get_parameter(name), msg=f"{layer} {name}")


def test_the_last_layer_steps_by_adam():
    layers = nn.ModuleDict({"body": nn.Linear(48, 48), "head": nn.Linear(48, 48)})
    before = layers.head.weight.detach().clone()
    descend(layers, Optimiser(layers, RECIPE), steps=1)
    step = layers.head.weight.detach() - before
    torch.testing.assert_close(step.abs(), torch.full_like(step, 1e-2), rtol=0.01, atol=0)  # Adam's first


def test_its_state_goes_on_where_it_was():
    whole, cut = network(), network()
    first = Optimiser(cut, RECIPE)
    descend(whole, (through := Optimiser(whole, RECIPE)))
    descend(cut, first)
    second = Optimiser(cut, RECIPE)
    second.load_state_dict(first.state_dict())
    descend(whole, through, seed=2)
    descend(cut, second, seed=2)
    for a, b in zip(whole.parameters(), cut.parameters(), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0)


def test_its_state_goes_on_on_another_processor():
    layers = network()
    with using("float32"):
        descend(layers, first := Optimiser(layers, RECIPE))
    with using("bfloat16"):
        second = Optimiser(layers, RECIPE)
        second.load_state_dict(first.state_dict())
        descend(layers, second, seed=2)
    assert all(torch.isfinite(parameter).all() for parameter in layers.parameters())


def test_weights_that_it_could_not_reach_are_refused():
    with pytest.raises(RuntimeError, match="view"):
        Optimiser(nn.Conv2d(32, 40, 3), RECIPE)


def test_an_unknown_optimiser_is_refused():
    with pytest.raises(ValueError, match="optimiser: expected adam or muon"):
        Optimiser(network(), Recipe(steps=1, optimiser="sgd"))
