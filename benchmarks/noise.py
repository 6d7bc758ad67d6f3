"""Measure how much of a photograph's noise the albedo amplifies. Prints a table.

OMP_NUM_THREADS=1 python benchmarks/noise.py RECORDS [--views 8]

RECORDS is a folder or a zip of records, as `relight stage RECORDS --behind --shading` writes them. Each view
is photographed in a key light and a weak sky, once as it is and once in black clothes, as codes of 8 bits and
as JPEG. Prints the RMS difference, encoded, of the albedo from that of the photograph before it became codes,
over the same light, in the key's shadow: of colour, R - Y and B - Y, and of lightness Y. "Before" is the
photograph over the light, with its noise. Lower is better.
"""

import argparse
import io

import numpy as np
from albedo_colour import ANGLES, MEAN, MIN_PIXELS, RIM, lamp
from PIL import Image
from scipy.ndimage import binary_erosion

import relight
from relight.media.colour import encode
from relight.media.images import scene_linear
from shadow.data import photographs
from shadow.data.records import Record, Records

SKY = 0.06  # of the light
BLACK_CLOTH = 0.12  # factor of the clothes' albedo
HEAD = 0.2  # of the person's height
KEY_SHARE = 0.15  # of the luminance, below which a pixel is in the key's shadow
QUALITIES = {"codes of 8 bits": None, "JPEG 90": 90, "JPEG 75": 75}


def photograph(record: Record, index: int, factor: float, quality: int | None):
    """Return codes (H, W, 3), the same without noise, linear, and where (H, W) the key's shadow is."""
    azimuth, elevation = ANGLES[index % len(ANGLES)]
    key = lamp(record.directions, azimuth, elevation)
    sky = np.full_like(key, 4 / len(key))
    parts = [
        photographs.light(record, np.float32(weights * np.ones(3)))
        for weights in ((1 - SKY) * key, SKY * sky)
    ]
    seen = record.image(sum(parts) * (MEAN / sum(parts).mean())).permute(1, 2, 0).numpy()
    rows = np.nonzero(record.mask.any(axis=1))[0]
    clothes = np.arange(len(seen)) > rows[0] + HEAD * np.ptp(rows)
    paint = np.where(clothes, factor, 1)[:, None, None]
    clean = (seen * paint).clip(0, 1)
    codes = np.uint8(np.round(255 * encode(clean)))
    if quality is not None:
        data = io.BytesIO()
        Image.fromarray(codes).save(data, "jpeg", quality=quality)
        codes = np.array(Image.open(data))
    levels = [np.maximum(part.mean(axis=1, keepdims=True), 1e-6) for part in parts]
    share = record.image(levels[0] / sum(levels))
    return codes, clean, binary_erosion(record.mask, iterations=RIM) & (share[0].numpy() < KEY_SHARE)


def errors(albedo, clean, shadow):
    """Return the RMS difference of colour and of lightness in the shadow (H, W)."""
    noise = np.diff(
        [image[shadow].clip(0, 1) ** (1 / photographs.ENCODING) for image in (clean, albedo)], axis=0
    )
    lightness = noise[0].mean(axis=-1)
    colour = noise[0][..., ::2] - lightness[..., None]
    return [float(np.sqrt((values**2).mean())) for values in (colour, lightness)]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("records")
    parser.add_argument("--views", type=int, default=8)
    given = parser.parse_args()
    records = Records([given.records])
    found: dict[str, list] = {}
    for index in records.spread(given.views):
        for cloth, factor in (("as it is", 1), ("black", BLACK_CLOTH)):
            for name, quality in QUALITIES.items():
                codes, clean, shadow = photograph(records[index], index, factor, quality)
                if shadow.sum() < MIN_PIXELS:
                    continue
                subject = relight.Subject(codes, records[index].mask)
                light = np.maximum(subject.upsampled(subject.record.maps.light), 1e-6)
                noisy = scene_linear("codes", codes) / light
                scores = [errors(albedo, clean / light, shadow) for albedo in (noisy, subject.albedo)]
                found.setdefault(f"{cloth}, {name}", []).append(scores)
    print("| clothes, file | colour, before | after | lightness, before | after | views |")
    print("|---|---|---|---|---|---|")
    for name, values in found.items():
        (colour, lightness), (less_colour, less_lightness) = np.mean(values, axis=0)
        figures = (colour, less_colour, lightness, less_lightness)
        print(f"| {name} | " + " | ".join(f"{x:.4f}" for x in figures) + f" | {len(values)} |")


if __name__ == "__main__":
    main()
