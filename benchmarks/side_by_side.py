"""Draw the results of several sets of weights on the same pictures, side by side, as a PNG. Prints no
figures.

python benchmarks/side_by_side.py OUT.png --weights FIELD SHADING [--weights ...] [--picture FILE [MASK] ...]
    [--records FOLDER ...] [--views 3]

Weights are names ("field", "shading") or paths. Each picture, and each of `--views` records of a folder, has
a row for each set of weights: photograph, normals, albedo, and the person lit from the left, from above, and
from behind on the right. A record has one more row: the truth, without bounce light.
"""

import argparse
from pathlib import Path

import torch
import torch.nn.functional as F

import relight
from shading import diffuse
from shadow import visibility
from shadow.data.records import Records
from shadow.directions import from_spherical
from shadow.evaluation import pictures
from shadow.evaluation.scores import ScoredView
from shadow.framing import Framed, canvas_size
from shadow.networks.backbone import EXPOSURE

KEYS = torch.from_numpy(from_spherical([-60, 0, 140], [20, 65, 25]))
POWER = 2.5  # of the keys, over the light in which albedo is seen as it is
CANVAS = 512  # rows of the pictures; weights for another canvas see the photograph resized


def row(rgb, mask, normals, albedo, shading):
    """Linear rgb (3, h, w), mask (h, w), normals and albedo (3, h, w), and the keys' shading (3, h, w)."""
    inside = mask > 0.5
    exposed = rgb * (EXPOSURE / (rgb * inside).sum() * 3 * inside.sum())
    lit = [POWER * albedo * light for light in shading]
    images = [pictures.show_linear(image * inside) for image in (exposed, albedo, *lit)]
    return [images[0], pictures.show_normals(normals * inside), *images[1:]]


def inferred(weights, rgb, mask):
    """The row of a set of weights (field, shading)."""
    field, network = weights
    image, matte = resized(rgb, field.size), resized(mask[None], field.size)[0]
    normals, visible = field.analyse(image, matte)
    found = network.analyse(image, matte, normals, visible)
    return row(rgb, mask, *(resized(maps, CANVAS) for maps in (normals, found.albedo, found.shading(KEYS))))


def resized(images, height):
    """Images (C, h, w) on a canvas of `height` pixels."""
    return F.interpolate(images[None], canvas_size(height), mode="bilinear", antialias=True)[0]


def true(record, view):
    """The row of a record, whose lights are those of its directions that are nearest to the keys."""
    nearest = (KEYS @ torch.from_numpy(record.directions).T).argmax(dim=1)
    lights = torch.from_numpy(record.directions)[nearest]
    framed = Framed.of(
        record.image(record.visibility[:, nearest]), torch.from_numpy(record.mask).float(), CANVAS
    )
    facing = torch.einsum("dc,chw->dhw", lights, view.normals).clamp_min(0)
    return row(view.rgb, view.mask, view.normals, view.albedo, facing * framed.rgb)


def photographed(path, mask=None):
    """A picture's file on the canvas: linear rgb and mask."""
    image = relight.read(path)
    if mask is None:
        alpha, colour = image[..., 3], image[..., :3] / image[..., 3:].clip(1e-4)
    else:
        alpha, colour = relight.read(mask)[..., 0], image[..., :3]
    framed = Framed.of(
        torch.from_numpy(colour.copy()).permute(2, 0, 1), torch.from_numpy(alpha.copy()), CANVAS
    )
    return framed.rgb, framed.mask


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--weights", nargs=2, action="append", required=True, metavar=("FIELD", "SHADING"))
    parser.add_argument("--picture", nargs="+", action="append", default=[], metavar="FILE")
    parser.add_argument("--records", type=Path, action="append", default=[])
    parser.add_argument("--views", type=int, default=3)
    given = parser.parse_args()
    sets = [(visibility.load(field), diffuse.load(shading)) for field, shading in given.weights]
    rows = []
    for files in given.picture:
        rgb, mask = photographed(*files)
        rows += [inferred(weights, rgb, mask) for weights in sets]
    for folder in given.records:
        records = Records([folder])
        for index in records.spread(given.views):
            view = ScoredView.of(records[index], (0, index), CANVAS)
            rows += [inferred(weights, view.rgb, view.mask) for weights in sets]
            rows.append(true(records[index], view))
    pictures.write_grid(given.out, rows)


if __name__ == "__main__":
    main()
