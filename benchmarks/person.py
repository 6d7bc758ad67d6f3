"""Find rendered people in front of photographs, and compare the mattes with the truth.

Forty pictures: people of the light stage under everyday lights, 28 whole ones and 12 whom the frame cuts,
over photographs of scikit-image, as JPEG of quality 90. Prints the intersection over union of the mask that
the networks give and of the refined matte, both above one half, and the seconds of a core that both take.

OMP_NUM_THREADS=1 python benchmarks/person.py draped.zip draped-close.zip [--pictures FOLDER]

The records are made by `relight stage draped --bodies 6300:6330 --simulate --views 6 --size 448 --behind
--jitter --pack`, the same with 6340:6360, and `relight stage draped-close --bodies 6330:6336 --simulate
--views 4 --size 448 --behind --portrait --pack`. Figures to compare with are in docs/compositing.md.
"""

import argparse
import io
import time
import zipfile
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter
from skimage import data

from relight.matting import outline, person
from relight.media.colour import encode
from relight.media.resampling import resize
from shadow.data import photographs, records

# Bodies that sit on nothing and carry nothing: the networks are asked for people, not for chairs and bags.
BODIES = (
    *(6304, 6306, 6307, 6309, 6313, 6314, 6315, 6316, 6324, 6325, 6326, 6340, 6341, 6342, 6343, 6344, 6346),
    *(6347, 6348, 6350, 6351, 6352, 6353, 6354, 6355, 6357, 6358, 6359),
)
CUT = 12
BACKGROUNDS = ("coffee", "rocket", "brick", "grass", "gravel", "motorcycle")
SIZE = (640, 560)  # of a picture, pixels: a person of 448 and what is around them


def background(name):
    """A photograph without people, (H, W, 3) linear, that covers SIZE."""
    codes = data.stereo_motorcycle()[0] if name == "motorcycle" else getattr(data, name)()
    codes = np.stack([codes] * 3, axis=-1) if codes.ndim == 2 else codes[..., :3]
    linear = (codes.astype(np.float32) / 255) ** 2.2
    scale = max(SIZE[0] / linear.shape[0], SIZE[1] / linear.shape[1])
    covering = resize(linear, tuple(int(np.ceil(n * scale)) for n in linear.shape[:2]))
    return covering[: SIZE[0], : SIZE[1]]


def picture(rng, record, behind):
    """A photograph (H, W, 3), uint8, of a record's person, and where they are."""
    rows, columns = np.nonzero(record.mask)
    top, left = rows.min(), columns.min()
    crop = np.s_[top : rows.max() + 1, left : columns.max() + 1]
    colour = record.image(photographs.light(record, photographs.everyday_lighting(rng, record.directions)))
    colour, mask = colour.permute(1, 2, 0).numpy()[crop], record.mask[crop]
    frame, (height, width) = record.mask.shape, mask.shape
    # Where the record's frame cuts the person, the picture's does too.
    cut = (top == 0, rows.max() + 1 == frame[0], left == 0, columns.max() + 1 == frame[1])
    y = 0 if cut[0] else SIZE[0] - height if cut[1] else rng.integers(0, SIZE[0] - height + 1)
    x = 0 if cut[2] else SIZE[1] - width if cut[3] else rng.integers(0, SIZE[1] - width + 1)
    end_y = y + height if cut[0] and cut[1] else SIZE[0]
    end_x = x + width if cut[2] and cut[3] else SIZE[1]
    where, person_colour = np.zeros(SIZE, bool), np.zeros((*SIZE, 3), np.float32)
    where[y : y + height, x : x + width] = mask
    person_colour[y : y + height, x : x + width] = colour * mask[..., None]
    alpha = gaussian_filter(where.astype(np.float32), 0.6)[..., None]
    soft = gaussian_filter(person_colour, (0.6, 0.6, 0))
    mean = colour[mask].mean()
    seen = soft * (0.25 / mean) + (1 - alpha) * behind
    codes = np.round(encode(seen[:end_y, :end_x].clip(0)) * 255).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(codes).save(file, "JPEG", quality=90)
    return np.array(Image.open(file)), where[:end_y, :end_x]


def overlap(matte, where):
    found = matte > 0.5
    return (found & where).sum() / (found | where).sum()


def whole(path):
    """A record of each of BODIES, seen from another side each time."""
    with zipfile.ZipFile(path) as archive:
        for number, body in enumerate(BODIES):
            views = sorted(name for name in archive.namelist() if f"{body:06d}" in name)
            yield views[number % len(views)], archive.read(views[number % len(views)])


def cut(path):
    """CUT records, spread over a pack."""
    with zipfile.ZipFile(path) as archive:
        names = sorted(archive.namelist())
        for index in np.linspace(0, len(names) - 1, CUT):
            yield names[int(index)], archive.read(names[int(index)])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("whole", type=Path)
    parser.add_argument("cut", type=Path)
    parser.add_argument("--pictures", type=Path, help="Keep the pictures and mattes in this folder.")
    options = parser.parse_args()
    people = [*whole(options.whole), *cut(options.cut)]
    rows = []
    for number, (name, stored) in enumerate(people):
        record = records.from_bytes(stored, name)
        rng = np.random.default_rng(number)
        behind = background(BACKGROUNDS[number % len(BACKGROUNDS)])
        codes, where = picture(rng, record, behind)
        begun = time.process_time()
        mask = person.find(codes)
        found = time.process_time()
        matte = outline.refine(codes, outline.outlined(codes, outline.Outline(matte=mask)))
        done = time.process_time()
        rows.append((overlap(mask, where), overlap(matte, where), found - begun, done - found))
        print(
            number,
            name,
            BACKGROUNDS[number % len(BACKGROUNDS)],
            *(f"{value:.3f}" for value in rows[-1]),
            flush=True,
        )
        if options.pictures:
            options.pictures.mkdir(exist_ok=True)
            grey = [np.repeat((m * 255).astype(np.uint8)[..., None], 3, 2) for m in (where, mask, matte)]
            Image.fromarray(np.hstack([codes, *grey])).save(options.pictures / f"{number:02d}.png")
    for what, part in (("whole", rows[:-CUT]), ("cut", rows[-CUT:]), ("all", rows)):
        masks, mattes, finding, refining = np.transpose(part)
        print(
            f"{what}: mask mean {masks.mean():.3f} least {masks.min():.3f}; refined mean {mattes.mean():.3f} "
            f"least {mattes.min():.3f}; seconds {np.median(finding):.2f} + {np.median(refining):.2f}"
        )


if __name__ == "__main__":
    main()
