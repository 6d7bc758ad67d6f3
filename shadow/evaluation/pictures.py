"""Contact sheets, to judge records and networks by eye."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import torch

from shadow.data import photographs, records
from shadow.files import replacing

DISPLAY = 1 / 2.2
ROW_SIZE = (256, 192)  # height and width, in pixels, of a picture on a contact sheet


def show_normals(normals: torch.Tensor) -> torch.Tensor:
    """Show unit vectors (3, H, W) as colours in [0, 1], and zero vectors as black."""
    return (normals * 0.5 + 0.5) * (normals.norm(dim=0, keepdim=True) > 0.5)


def show_linear(image: torch.Tensor) -> torch.Tensor:
    """Encode a linear image (1|3, H, W) for display, clipped, as (3, H, W)."""
    return (image.clamp(0, 1) ** DISPLAY).expand(3, -1, -1)


def write_grid(path: str | Path, rows: Iterable[Iterable[torch.Tensor]]) -> None:
    """Write rows of equally large (3, H, W) pictures in [0, 1] as one 8-bit PNG."""
    grid = torch.cat([torch.cat(list(row), dim=2) for row in rows], dim=1)
    pixels = np.ascontiguousarray((grid.clamp(0, 1) * 255).round().byte().permute(1, 2, 0).cpu().numpy())
    output = oiio.ImageOutput.create("png")
    assert output is not None  # OpenImageIO is built with PNG
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, "uint8")
    with replacing(path) as beside:
        if not (output.open(str(beside), spec) and output.write_image(pixels) and output.close()):
            raise OSError(f"path: cannot write {path}: {output.geterror()}")


def record_row(record: records.Record, seed: int) -> list[torch.Tensor]:
    """Make one row of a contact sheet: photograph, normals, albedo, and visibility of three lights."""
    sample = photographs.sample(record, np.random.default_rng(seed), ROW_SIZE, augment=False)
    mask = sample["mask"] > 0.5
    wanted = torch.tensor([[-0.75, 0.3, 0.6], [0.75, 0.3, 0.6], [0.0, 0.8, 0.6]])
    lights = (wanted @ sample["directions"].T).argmax(dim=1)
    direction, visibility = sample["directions"][lights[0]], sample["visibility"][lights]
    shading = torch.einsum("c,chw->hw", direction, sample["normals"]).clamp_min(0)[None] * visibility[:1]
    return [
        show_linear(sample["rgb"] * mask),
        show_linear(sample["albedo"] * shading * mask),
        show_normals(sample["normals"] * mask),
        show_linear(sample["albedo"] * mask),
        *(show_linear(v[None] * mask) for v in visibility),
    ]


def contact_sheet(paths: Iterable[str | Path], out: str | Path, count: int = 10) -> None:
    """Draw `count` evenly spread records of `paths`, one in each row, as a PNG at `out`."""
    dataset = records.Records(paths)
    write_grid(out, [record_row(dataset[index], index) for index in dataset.spread(count)])
