"""Measure how light the inferred albedo of a face is, for skin of six tones. Prints a table.

OMP_NUM_THREADS=1 python benchmarks/skin_tones.py RECORDS [--views 8]

RECORDS is a folder that `relight stage RECORDS --behind --shading` wrote, of bodies. A view is photographed
in a key light and a sky before a wall, in 8 bits, once with its skin in each of the tones. The camera exposes
for white, or for the mean of the picture, as meters do. The error is in stops: how much lighter than the true
albedo (more than 0) or darker (less) the median of the face is, in green; "spread" is the RMS over views.
"Before" is the albedo as the network gives it. The face is labelled in the records. Where `relight fetch
person` has brought the landmark network, skin bounds the lightness as well.
"""

import argparse

import numpy as np
from albedo_colour import ANGLES, lamp

import relight
from relight.media.colour import encode
from shadow.data import photographs
from shadow.data.records import REGIONS, Record, Records

TONES = {  # linear Rec.709 albedo, from fair to dark
    "1": (0.62, 0.42, 0.33), "2": (0.52, 0.32, 0.23), "3": (0.42, 0.23, 0.15),
    "4": (0.3, 0.15, 0.085), "5": (0.17, 0.08, 0.045), "6": (0.09, 0.044, 0.028),
}  # fmt: skip
WALLS = (0.75, 0.3)  # albedo, by view
SKY = 0.35  # of the light
METERED = 0.22  # linear mean of a picture that is exposed for it
LIKE_FACE = 0.12  # largest distance in log R/G and log B/G of other skin from the face's
FAR = 1.5  # largest distance of its log luminance


def recoloured(record: Record, tone) -> tuple[np.ndarray, np.ndarray]:
    """Return the albedo (N, 3) with skin of this tone, and where (N,) the face is."""
    face = record.regions == REGIONS.index("face")
    logs = np.log(np.maximum(record.albedo, 1e-4))
    colour, level = logs[:, ::2] - logs[:, 1:2], logs[:, 1]
    middle = np.median(record.albedo[face], axis=0)
    apart = np.abs(colour - np.median(colour[face], axis=0)).max(axis=1)
    skin = face | ((apart < LIKE_FACE) & (np.abs(level - np.median(level[face])) < FAR))
    albedo = record.albedo.copy()
    albedo[skin] = np.clip(albedo[skin] * (np.array(tone) / middle), 0.005, 0.95)
    return albedo, face


def photograph(record: Record, index: int, albedo: np.ndarray, metered: bool) -> np.ndarray:
    """Return the codes (H, W, 3) of a view with this albedo."""
    azimuth, elevation = ANGLES[index % len(ANGLES)]
    key = lamp(record.directions, azimuth, elevation)
    sky = np.full_like(key, 4 / len(key))
    weights = np.float32(((1 - SKY) * key + SKY * sky) * np.ones(3))
    light = photographs.light(record, weights) / np.maximum(record.albedo, 1e-4)
    person = record.image(light * albedo).permute(1, 2, 0).numpy()
    wall = np.float32(WALLS[index % len(WALLS)])
    picture = np.where(record.mask[..., None], person, wall)
    exposure = METERED / picture.mean() if metered else 1.0
    return np.uint8(np.round(255 * encode((picture * exposure).clip(0, 1))))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("records")
    parser.add_argument("--views", type=int, default=8)
    given = parser.parse_args()
    records = Records([given.records])
    print("| exposed for | tone | true | before | spread | after | spread | views |")
    print("|---|---|---|---|---|---|---|---|")
    for metered in (False, True):
        for name, tone in TONES.items():
            wrong = []
            for index in records.spread(given.views):
                record = records[index]
                albedo, face = recoloured(record, tone)
                if face.sum() < 50:
                    continue
                codes = photograph(record, index, albedo, metered)
                subject = relight.Subject(codes, record.mask)
                shown = record.image(face[:, None])[0].numpy() > 0
                found = np.median(subject.albedo[shown, 1])
                before = found / subject.old_light.lightness
                wrong.append(np.log2(np.maximum([before, found], 1e-3) / np.median(albedo[face, 1])))
            mean, spread = np.mean(wrong, axis=0), np.sqrt(np.mean(np.square(wrong), axis=0))
            print(
                f"| {'the mean' if metered else 'white'} | {name} | {tone[1]:.3f} | {mean[0]:+.2f} | "
                f"{spread[0]:.2f} | {mean[1]:+.2f} | {spread[1]:.2f} | {len(wrong)} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
