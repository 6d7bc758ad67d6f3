"""Find rendered people in photographs of places, and compare the mattes with the truth.

Forty pictures: 27 whole people of the light stage who stand on the ground, and 13 whom the frame cuts as in
portraits, as JPEG of quality 90. Seven of nine places are panoramas, whose light is on the person as well and
which are out of focus, since they have three pixels a degree; a garage and a wall of scikit-image are sharp,
with an everyday light. The camera stands 1.5 m high, and exposes for the person. Prints the intersection over
union of the mask that the pose networks give and of the matte, both above one half, and the seconds of a core
that both take. The network of `relight fetch silhouette` cuts the matte out if it is in the cache; name
another folder (RELIGHT_CACHE) for the way without.

OMP_NUM_THREADS=1 python benchmarks/person.py draped.zip draped-close.zip WORLDS [--pictures FOLDER]

WORLDS is a folder of latitude-longitude EXRs: `datafiles/studiolights/world` of Blender, photographs by Greg
Zaal (CC0). The records are made by `relight stage draped --bodies 6300:6330 --simulate --views 6 --size 448
--behind --jitter --pack`, the same with 6340:6360, and `relight stage draped-close --bodies 6330:6336
--simulate --views 4 --size 448 --behind --portrait --pack`. docs/compositing.md has figures to compare with.
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

from relight.lights.environment import EnvironmentLight
from relight.matting.people import finder
from relight.matting.refine import encoded_srgb, opaque_photograph
from relight.media.colour import decode, encode
from relight.media.resampling import resize
from shadow.data import lightings, photographs, records

# Bodies that sit on nothing and carry nothing: the networks are asked for people, not for chairs and bags.
BODIES = (
    *(6304, 6306, 6307, 6309, 6313, 6314, 6315, 6316, 6324, 6325, 6326, 6340, 6341, 6343, 6344, 6346, 6347),
    *(6348, 6350, 6351, 6352, 6353, 6354, 6355, 6357, 6358, 6359),
)
CUT_BODIES, CUT = range(6331, 6336), 13  # 6330 sits on a chair
WORLDS = ("city", "courtyard", "forest", "interior", "sunrise", "sunset", "studio")
PLACES = (*WORLDS, "garage", "wall")
SIZE = (640, 560)  # of a picture, pixels: a person of 448 and what is around them
FIELD_OF_VIEW = 60.0  # degrees, of a picture's height
EYE = 1.5 / 1.75  # height of the camera, and of the horizon in a level view, of a person's height
HEAD = 100  # pixels below a portrait's uppermost one where the horizon is: at the eyes, roughly
ALBEDO = 0.2  # mean of the person in the picture, linear


def place(rng, name, worlds, horizon):
    """Return a photograph of a place, (H, W, 3) linear, its horizon at a row, and its light or None."""
    if name in WORLDS:
        sky = EnvironmentLight(worlds / f"{name}.exr", rotation=rng.uniform(0, 360))
        # A level camera's view has its horizon in the middle; the picture is a part of a higher one.
        half = max(horizon, SIZE[0] - horizon)
        slope = np.tan(np.radians(FIELD_OF_VIEW / 2)) * 2 * half / SIZE[0]
        view = sky.view((2 * half, SIZE[1]), 2 * np.degrees(np.arctan(slope)))
        return view[half - horizon :][: SIZE[0]], sky
    codes = data.brick() if name == "wall" else data.stereo_motorcycle()[0]
    codes = np.stack([codes] * 3, axis=-1) if codes.ndim == 2 else codes[..., :3]
    linear = decode(codes.astype(np.float32) / 255, "sRGB")
    scale = max(SIZE[0] / linear.shape[0], SIZE[1] / linear.shape[1])
    covering = resize(linear, tuple(int(np.ceil(n * scale)) for n in linear.shape[:2]))
    return covering[: SIZE[0], : SIZE[1]], None


def weights(rng, directions, sky):
    """Return the light (D, 3) from a record's directions: the sky's, or a random one."""
    if sky is None:
        return lightings.everyday_lighting(rng, directions)
    where, colours = sky.samples()
    gathered = np.zeros((len(directions), 3), np.float32)
    np.add.at(gathered, np.argmax(where @ directions.T, axis=1), colours)
    return gathered


def picture(rng, record, name, worlds):
    """Return a photograph (H, W, 3), uint8, of a record's person in a place, and where they are."""
    rows, columns = np.nonzero(record.mask)
    top, left = rows.min(), columns.min()
    crop = np.s_[top : rows.max() + 1, left : columns.max() + 1]
    mask, frame = record.mask[crop], record.mask.shape
    height, width = mask.shape
    # Where the record's frame cuts the person, the picture's does too. The others stand near its lower end.
    cut = (top == 0, rows.max() + 1 == frame[0], left == 0, columns.max() + 1 == frame[1])
    whole = not any(cut)
    lowest = SIZE[0] - height
    y = 0 if cut[0] else lowest - rng.integers(10, 50) if whole else lowest
    x = 0 if cut[2] else SIZE[1] - width if cut[3] else rng.integers(0, SIZE[1] - width + 1)
    end_x = x + width if cut[2] and cut[3] else SIZE[1]
    behind, sky = place(rng, name, worlds, y + (round((1 - EYE) * height) if whole else HEAD))
    colour = record.image(photographs.light(record, weights(rng, record.directions, sky)))
    colour = colour.permute(1, 2, 0).numpy()[crop]
    exposure = ALBEDO / colour[mask].mean()
    where, person_colour = np.zeros(SIZE, bool), np.zeros((*SIZE, 3), np.float32)
    where[y : y + height, x : x + width] = mask
    person_colour[y : y + height, x : x + width] = colour * mask[..., None] * exposure
    alpha = gaussian_filter(where.astype(np.float32), 0.6)[..., None]
    soft = gaussian_filter(person_colour, (0.6, 0.6, 0))
    seen = soft + (1 - alpha) * behind * (exposure if sky else 1)
    codes = np.round(encode(seen[:, :end_x].clip(0, 1)) * 255).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(codes).save(file, "JPEG", quality=90)
    return np.array(Image.open(file)), where[:, :end_x]


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
    """CUT records of CUT_BODIES, spread over a pack."""
    with zipfile.ZipFile(path) as archive:
        names = sorted(name for name in archive.namelist() if int(name.split("-")[2]) in CUT_BODIES)
        for index in np.linspace(0, len(names) - 1, CUT):
            yield names[int(index)], archive.read(names[int(index)])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("whole", type=Path)
    parser.add_argument("cut", type=Path)
    parser.add_argument("worlds", type=Path)
    parser.add_argument("--pictures", type=Path, help="Keep the pictures and mattes in this folder.")
    options = parser.parse_args()
    people = [*whole(options.whole), *cut(options.cut)]
    rows, model = [], finder.FoundPerson()
    for number, (name, stored) in enumerate(people):
        record = records.from_bytes(stored, name)
        rng = np.random.default_rng(number)
        behind = PLACES[number % len(PLACES)]
        codes, where = picture(rng, record, behind, options.worlds)
        begun = time.process_time()
        mask = finder.find(codes)
        found = time.process_time()
        matte = model(encoded_srgb(opaque_photograph(codes)))
        done = time.process_time()
        rows.append((overlap(mask, where), overlap(matte, where), found - begun, done - found))
        print(
            number,
            name,
            behind,
            *(f"{value:.3f}" for value in rows[-1]),
            flush=True,
        )
        if options.pictures:
            options.pictures.mkdir(parents=True, exist_ok=True)
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
