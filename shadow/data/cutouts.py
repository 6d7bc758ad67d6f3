"""People cut out of records, in some light: what pictures with a known matte are composed of.

A cutout is a PNG file with alpha. Its colours are straight and sRGB-encoded, its alpha is the coverage of the
record's pixels, two of which become one of the cutout a side: strands of hair become partly transparent.
Where the record's frame cuts the person, the alpha touches the frame of the cutout. The places of the hands
are in the file as text, so that things can be put into them.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image, PngImagePlugin
from scipy import ndimage

from shadow.data.lightings import everyday_lighting
from shadow.data.photographs import light
from shadow.data.records import REGIONS, Record, Records
from shadow.files import replacing
from shadow.srgb import decode_srgb, encode_srgb

FINER = 2  # pixels of the record, a side, for one of the cutout
EXPOSURE = 0.06, 0.5  # mean of the person's linear colour, at least and at most
FEWEST = 40  # pixels of a hand


@dataclass(frozen=True)
class Cutout:
    """A person in some light."""

    colour: np.ndarray  # (H, W, 3) uint8, straight, sRGB-encoded
    alpha: np.ndarray  # (H, W) uint8
    hands: list[tuple[float, float, float]]  # x, y and radius in pixels

    @property
    def linear(self) -> torch.Tensor:
        """Premultiplied linear colour and alpha (4, H, W), float32."""
        alpha = self.alpha.astype(np.float32)[None] / 255
        colour = LINEAR[self.colour].transpose(2, 0, 1) * alpha
        return torch.from_numpy(np.concatenate([colour, alpha]))

    @property
    def frame(self) -> tuple[bool, bool, bool, bool]:
        """Whether the frame cuts the person at the top, at the bottom, on the left and on the right."""
        inside = self.alpha > 127
        return tuple(bool(edge.any()) for edge in (inside[0], inside[-1], inside[:, 0], inside[:, -1]))  # type: ignore[return-value]


LINEAR = decode_srgb(np.arange(256, dtype=np.float32) / 255)


def cutout(record: Record, rng: np.random.Generator) -> Cutout:
    """Light a record at random, and reduce it to half its size."""
    gloss = rng.choice([0.0, rng.uniform(0.02, 0.2)], p=[0.7, 0.3])
    colour = light(record, everyday_lighting(rng, record.directions), gloss, np.exp(rng.uniform(2, 4)))
    colour *= np.exp(rng.uniform(*np.log(EXPOSURE))) / max(colour.mean(), 1e-6)
    covered = np.ones((len(colour), 1), np.float32)
    planes = F.avg_pool2d(record.image(np.concatenate([colour, covered], axis=1)), FINER)
    alpha = planes[3]
    straight = (planes[:3] / alpha.clamp_min(1e-3)).permute(1, 2, 0).numpy()
    codes = np.round(encode_srgb(straight.clip(0, 1)) * 255).astype(np.uint8)
    return Cutout(codes, np.round(alpha.numpy() * 255).astype(np.uint8), _hands(record))


def _hands(record: Record) -> list[tuple[float, float, float]]:
    if record.regions is None:
        return []
    where = np.zeros(record.mask.shape, bool)
    where[record.mask] = record.regions == REGIONS.index("hands")
    labels, count = ndimage.label(where)
    sizes = ndimage.sum_labels(where, labels, np.arange(1, count + 1))
    found = []
    for number in np.flatnonzero(sizes > FEWEST * FINER**2) + 1:
        y, x = ndimage.center_of_mass(where, labels, number)
        found.append((x / FINER, y / FINER, float(np.sqrt(sizes[number - 1] / np.pi)) / FINER))
    return found


def write(path: Path, person: Cutout) -> None:
    """Write a cutout as a PNG file."""
    text = PngImagePlugin.PngInfo()
    text.add_text("hands", json.dumps(np.round(person.hands, 1).tolist()))
    image = Image.fromarray(np.dstack([person.colour, person.alpha]))
    with replacing(path) as beside:
        image.save(beside, "PNG", pnginfo=text, compress_level=1)


def read(path: Path) -> Cutout:
    """Read a cutout that `write` wrote."""
    with Image.open(path) as image:
        pixels = np.asarray(image)
        return Cutout(pixels[..., :3], pixels[..., 3], json.loads(image.text.get("hands", "[]")))  # type: ignore[attr-defined]


def write_all(records: list[str | Path], out: Path, lightings: int, seed: int = 0) -> int:
    """Write cutouts of records in so many lightings each into a folder; return how many are new."""
    out.mkdir(parents=True, exist_ok=True)
    source, written = Records(records), 0
    for index, (file, member) in enumerate(source.entries):
        name = Path(member or file.name).stem
        paths = [out / f"{name}-{number}.png" for number in range(lightings)]
        if all(path.exists() for path in paths):
            continue
        record = source[index]
        for number, path in enumerate(paths):
            write(path, cutout(record, np.random.default_rng((seed, index, number))))
            written += 1
    return written
