"""Give a field without depth an output of depth, by ridge regression on its features.

python benchmarks/depth_head.py OUT.safetensors --records FOLDER:VIEWS ... [--init field.safetensors]

The output is linear in the 48 features before the field's head (`shadow/networks/backbone.py`), so its best
weights are found without training, and every other output stays as it was. Depth and features are relative
to their means over a view, and each view counts alike. OUT is in 8 bits. OUT.float.safetensors is beside it.

`benchmarks/depth.py` scores the result; figures are in docs/history.md.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from rich.progress import track

from shadow import visibility
from shadow.data.photographs import photograph, sample
from shadow.data.records import Records
from shadow.framing import canvas_size
from shadow.networks import checkpoints
from shadow.networks.backbone import encode_image, subject_window
from shadow.networks.field import VisibilityField
from shadow.networks.precision import autocast

RIDGE = 1e-5  # added to the diagonal of the normal equations, so that they have one solution
SEED = 7


def pixels(field, record, rng):
    """Features (C, P) and depth (P,) of the subject's pixels at half resolution, relative to their means."""
    drawn = sample(record, rng, canvas_size(field.size), lights=1)
    rgb, matte = photograph(drawn["rgb"], drawn["mask"], rng), drawn["mask"]
    read = []
    hook = field.backbone.norm.register_forward_hook(lambda module, given, output: read.append(output))
    with torch.no_grad(), autocast(rgb.device):
        field(encode_image(rgb[None], matte[None]))
    hook.remove()
    window = (..., *subject_window(matte))
    depth, covered = (F.avg_pool2d(maps[window], 2)[0] for maps in (drawn["depth"], matte))
    inside = covered > 0.99
    features, depth = F.silu(read[0][0].float())[:, inside].double(), depth[inside].double()
    return features - features.mean(dim=1, keepdim=True), depth - depth.mean()


def fitted(field, folders):
    """The weights (C,) of the features, and the number of views."""
    channels = field.backbone.head.in_channels
    square, product, views = RIDGE * torch.eye(channels).double(), torch.zeros(channels).double(), 0
    for folder, limit in folders:
        records = Records([folder])
        for index in track(records.spread(min(limit, len(records))), folder):
            record = records[index]
            features, depth = pixels(field, record, np.random.default_rng((SEED, index)))
            if record.depth is None or not len(depth):
                continue
            square += features @ features.T / len(depth)
            product += features @ depth / len(depth)
            views += 1
    return torch.linalg.solve(square, product).float(), views


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--records", nargs="+", required=True, metavar="FOLDER:VIEWS")
    parser.add_argument("--init", type=Path, default=Path("shadow/weights/field.safetensors"))
    given = parser.parse_args()
    folders = [(folder, int(limit)) for folder, _, limit in (text.rpartition(":") for text in given.records)]
    field, about = visibility.load(given.init), checkpoints.read(given.init)[1]
    weights, views = fitted(field, folders)
    config, recipe = json.loads(about["config"]) | {"depth": True}, json.loads(about["recipe"])
    recipe["depth"] = f"ridge regression on {views} views"
    deeper = VisibilityField(**config)
    state = deeper.state_dict()
    for key, value in field.state_dict().items():
        state[key][: len(value)] = value
    state["backbone.head.weight"][-4:] = weights[:, None, None]
    state["backbone.head.bias"][-4:] = 0
    deeper.load_state_dict(state)
    whole = given.out.with_suffix(".float.safetensors")
    checkpoints.save(whole, deeper, "field", config, recipe)
    checkpoints.shrink(whole, given.out)


if __name__ == "__main__":
    main()
