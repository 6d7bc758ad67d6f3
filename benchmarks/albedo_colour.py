"""Measure how much of the old light's colour the albedo keeps, and whether a photograph that is relit by its
own lights stays itself. Prints a table.

OMP_NUM_THREADS=1 python benchmarks/albedo_colour.py RECORDS [--views 8] [--keep-tint]

RECORDS is a folder that `relight stage RECORDS --behind --shading` wrote, of bodies or scans. Each view is
photographed in several lights, in 8 bits, some with a camera's tone curve or as JPEG. The error is the RMS
difference of the albedo's log-chromaticity, log R/G and log B/G, from the true albedo's, where the key light
shone and where it did not. A tint of the whole picture is no error: the median difference in the light is
taken off first. With --keep-tint nothing is corrected, to compare with.
"Relit" is the RMS difference, encoded, of the photograph from `subject.relit(fit_lights(photograph))`, and
"inside" is the same without the rim of the mask, where a person's colour is continued from inside.

Figures to compare with are in docs/history.md; lower is better.
"""

import argparse
import io
from dataclasses import dataclass

import numpy as np
import torch
from PIL import Image
from scipy.ndimage import binary_erosion

import relight
from relight.analysis.old_light import OldLight
from shadow.data import photographs
from shadow.data.records import Record, Records
from shadow.directions import from_spherical
from shadow.srgb import encode_srgb

SUN, LOW_SUN, SKY, EVENING_SKY = (1, 0.95, 0.85), (1, 0.72, 0.45), (0.85, 0.95, 1.1), (0.7, 0.9, 1.35)
ORANGE, BLUE = (1, 0.62, 0.35), (0.4, 0.65, 1)
RED_WALL = (2.46, 0.29, 0.25)  # light that a saturated wall throws back, mean 1
SHARE = 1 / 6  # of the light that is the sky's
KEY_BY_WALL, ROOM_BY_WALL, WALL = 0.75, 0.5, 0.4  # power of a white key, of a white room, of the wall
ANGLES = (
    (-50, 35),
    (55, 45),
    (-25, 55),
    (75, 20),
)  # azimuth and elevation of the key, by view
MEAN = 0.2  # linear, of a photograph's person
MIN_ALBEDO, MIN_ENCODED, MAX_ENCODED = 0.02, 0.03, 0.985  # other pixels have no colour to measure
MIN_PIXELS = 200
RIM = 4  # pixels, whose colour is continued from inside


@dataclass(frozen=True)
class Photograph:
    """A view in some light."""

    pixels: np.ndarray  # (H, W, 3) uint8
    mask: np.ndarray  # (H, W) bool
    albedo: np.ndarray  # (H, W, 3) true, linear
    key: np.ndarray  # (H, W) the key's share of the luminance


def lightings(directions, index):
    """{name: (weights (D, 3) of the key, of the rest, contrast of the tone curve, JPEG quality)}."""
    azimuth, elevation = ANGLES[index % len(ANGLES)]
    key, rim = lamp(directions, azimuth, elevation), lamp(directions, -1.6 * azimuth, 15)
    up = (0.55 + 0.45 * directions[:, 1]).clip(0)[:, None] ** 1.2
    sky = 4 * up / up.sum() / 3
    side = -90 if azimuth > 0 else 90  # away from the key, where its light falls
    wall = 0.7 * broad(directions, side, -5) + 0.3 * broad(directions, side / 2, -60)
    beside_wall = KEY_BY_WALL * key * np.ones(3), ROOM_BY_WALL * up / up.sum() + WALL * wall * RED_WALL

    def lit(sun, ambient, share=SHARE):
        return (1 - share) * key * sun, 3 * share * sky * ambient

    return {
        "neutral": (*lit((1, 1, 1), (1, 1, 1)), 0, None),
        "neutral, curve": (*lit((1, 1, 1), (1, 1, 1)), 3, None),
        "sun and sky": (*lit(SUN, SKY), 0, None),
        "sun and sky, curve": (*lit(SUN, SKY), 3, None),
        "sun and sky, curve, JPEG": (*lit(SUN, SKY), 3, 75),
        "evening": (*lit(LOW_SUN, EVENING_SKY), 0, None),
        "two gels": (key * ORANGE, rim * BLUE + 0.1 * sky, 0, None),
        "red wall": (*beside_wall, 0, None),
        "red wall, curve": (*beside_wall, 3, None),
    }


def lamp(directions, azimuth, elevation):
    """(D, 1), one in the direction that is nearest."""
    weights = np.zeros((len(directions), 1))
    weights[np.argmax(directions @ from_spherical(azimuth, elevation))] = 1
    return weights


def broad(directions, azimuth, elevation):
    """(D, 1), sum 1, light of a large surface on one side."""
    weights = (directions @ from_spherical(azimuth, elevation)).clip(0)[:, None] ** 1.5
    return weights / weights.sum()


def photograph(record: Record, key, rest, contrast, quality) -> Photograph:
    """Photograph a record."""
    parts = [photographs.light(record, np.float32(weights)) for weights in (key, rest)]
    exposure = MEAN / sum(parts).mean()
    linear = record.image(sum(parts) * exposure).clamp(0, 1)
    encoded = torch.from_numpy(encode_srgb(linear.numpy())).float()  # as pictures of 8 bits are read
    encoded = photographs.PictureStyle(contrast=contrast)(encoded).permute(1, 2, 0).numpy()
    pixels = np.uint8(np.round(255 * encoded))
    if quality is not None:
        data = io.BytesIO()
        Image.fromarray(pixels).save(data, "jpeg", quality=quality)
        pixels = np.array(Image.open(data))
    share = parts[0].mean(axis=1, keepdims=True) / np.maximum(sum(parts).mean(axis=1, keepdims=True), 1e-6)
    albedo = record.image(record.albedo).permute(1, 2, 0).numpy()
    return Photograph(pixels, record.mask, albedo, record.image(share)[0].numpy())


def chromaticity(rgb):
    """(..., 2), log R/G and log B/G of linear colours (..., 3)."""
    logs = np.log(np.maximum(rgb, 1e-4))
    return logs[..., ::2] - logs[..., 1:2]


def errors(subject: relight.Subject, seen: Photograph) -> tuple[float, ...] | None:
    """Return the RMS error in the key's light, in its shadow, and of the picture in its own lights, whole and
    inside."""
    encoded = seen.pixels / 255
    clear = seen.mask & (seen.albedo.min(axis=-1) > MIN_ALBEDO) & (encoded.max(axis=-1) < MAX_ENCODED)
    clear &= encoded.min(axis=-1) > MIN_ENCODED
    lit, shadow = clear & (seen.key > 0.7), clear & (seen.key < 0.15)
    if min(lit.sum(), shadow.sum()) < MIN_PIXELS:
        return None
    wrong = chromaticity(subject.albedo) - chromaticity(seen.albedo)
    wrong = wrong - np.median(wrong[lit], axis=0)
    again = subject.relit(relight.fit_lights(seen.pixels, subject))[..., :3]
    difference = encode_srgb(again.clip(0, 1)) - encoded
    inside = binary_erosion(seen.mask, iterations=RIM)
    each = (wrong[lit], wrong[shadow], difference[seen.mask], difference[inside])
    return tuple(float(np.sqrt(np.mean(values**2))) for values in each)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("records")
    parser.add_argument("--views", type=int, default=8)
    parser.add_argument("--keep-tint", action="store_true", help="leave the light's colour in the albedo")
    given = parser.parse_args()
    records = Records([given.records])
    old_light = OldLight() if given.keep_tint else None
    found: dict[str, list] = {}
    for index in records.spread(given.views):
        record = records[index]
        for name, lighting in lightings(record.directions, index).items():
            seen = photograph(record, *lighting)
            scored = errors(relight.Subject(seen.pixels, seen.mask, old_light=old_light), seen)
            if scored is not None:
                found.setdefault(name, []).append(scored)
    print("| light | in the light | in its shadow | relit | inside | views |\n|---|---|---|---|---|---|")
    for name, values in found.items():
        print(
            f"| {name} | " + " | ".join(f"{x:.3f}" for x in np.mean(values, axis=0)) + f" | {len(values)} |"
        )


if __name__ == "__main__":
    main()
