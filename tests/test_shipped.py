"""Whether the shipped weights are what they were, and whether weights or code that are not would be found.

What is measured, and the bounds, are in shipped.py.
"""

import sys
from importlib import resources

import pytest
import torch
from helpers import shipped
from safetensors.torch import save_file

from shadow.networks import checkpoints
from shadow.networks.mirror import Silhouette

pytestmark = pytest.mark.usefixtures("full_canvas")

ANCHORS = 96
SHARPNESS = 3 + ANCHORS  # the field's channels: normals, cast maps, logarithm of the sharpness, depth
DEPTH = SHARPNESS + 1
GAIN = ANCHORS  # the shading network's: residuals, logarithm of the albedo's gain


@pytest.fixture(scope="module")
def scenes():
    return shipped.scenes()


def test_the_shipped_weights_are_as_good_as_they_were(scenes):
    assert len(scenes) == 3
    found = shipped.checks(scenes)
    assert all(value <= bound for value, bound in found.values()), found


def channels(first, count=1):
    """The head's outputs that make these channels of the maps: four each, one for a pixel of 2 x 2."""
    return slice(4 * first, 4 * (first + count))


def zeroed(first, count=1):
    def change(head):
        head[channels(first, count)] = 0

    return change


def cast_maps_in_another_order(head):
    cast = channels(3, ANCHORS)
    head[cast] = head[cast].roll(4, dims=0)


def sign_of_x_changed(head):
    head[channels(0)] *= -1


def sharpness_halved(head):
    head[channels(SHARPNESS)][:, -1] += torch.tensor(0.5).log()


def replace(monkeypatch, name, value):
    """Give all our modules that know `name` another value for it."""
    ours = [module for path, module in sys.modules.items() if path.split(".")[0] in ("shadow", "shading")]
    for module in ours:
        if hasattr(module, name):
            monkeypatch.setattr(module, name, value)


def pixels_not_turned_back(monkeypatch):
    """The mirror image's maps are read as if they lay as the photograph's do."""

    class Unturned(Silhouette):
        def __init__(self, mask):
            super().__init__(mask)
            self.blocks = self.blocks[:1].expand(2, -1)
            self._taken = [self._taken[0]] * 2

    replace(monkeypatch, "Silhouette", Unturned)


def vectors_not_turned_back(monkeypatch):
    """The mirror image's normals and lights are taken for the photograph's."""
    replace(monkeypatch, "MIRROR", torch.ones(3))


ALL = set(shipped.TILES)
MUTATIONS = {  # what they are made to, how, and the maps that change
    "cast maps zeroed": ("shadow", zeroed(3, ANCHORS), {"visibility"}),
    "cast maps in another order": ("shadow", cast_maps_in_another_order, {"visibility"}),
    "sign of the normals' x changed": ("shadow", sign_of_x_changed, {"normals", "visibility"}),
    "sharpness halved": ("shadow", sharpness_halved, {"visibility"}),
    "depth zeroed": ("shadow", zeroed(DEPTH), {"depth"}),
    "residual zeroed": ("shading", zeroed(0, ANCHORS), {"shading"}),
    "albedo's gain zeroed": ("shading", zeroed(GAIN), {"albedo"}),
    "mirror image's pixels not turned back": ("code", pixels_not_turned_back, ALL),
    "mirror image's vectors not turned back": ("code", vectors_not_turned_back, ALL - {"depth"}),
}

FAST = {"cast maps zeroed", "residual zeroed", "mirror image's vectors not turned back"}


def mutated(package, change, path):
    """A copy at `path` of the shipped weights with another head; `change` edits its rows, bias last."""
    name = {"shadow": "field", "shading": "shading"}[package]
    state, metadata = checkpoints.read(resources.files(package) / "weights" / f"{name}.safetensors")
    weight, bias = state["backbone.head.weight"], state["backbone.head.bias"]
    head = torch.cat([weight.flatten(1), bias[:, None]], dim=1).float()
    change(head)
    state["backbone.head.weight"] = head[:, :-1].reshape(weight.shape).to(weight.dtype).contiguous()
    state["backbone.head.bias"] = head[:, -1].to(bias.dtype).contiguous()
    save_file(state, path, metadata)
    return path


@pytest.mark.parametrize(
    "mutation", [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in MUTATIONS]
)
def test_the_guard_sees(mutation, scenes, tmp_path, monkeypatch):
    kind, change, changed = MUTATIONS[mutation]
    scene, maps = scenes[0], {}
    models = {"shadow": "field", "shading": "shading"}
    if kind == "code":
        change(monkeypatch)
    else:
        models = {kind: mutated(kind, change, tmp_path / "mutated.safetensors")}
    if "shadow" in models:
        maps |= shipped.infer_field(scene, shipped.KEPT_LIGHTS, models["shadow"])
    if "shading" in models:
        maps |= shipped.infer_shading(scene, shipped.KEPT_LIGHTS, models["shading"])
    differences = shipped.against_kept(scene, maps)
    assert changed == {name for name, value in differences.items() if value > shipped.KEPT}, differences
    assert all(differences[name] >= 2 * shipped.KEPT for name in changed), differences
