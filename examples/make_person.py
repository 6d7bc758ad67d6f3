"""How the bundled photograph was made: a body of the generalisation split on the virtual light stage.

python examples/make_person.py [seed] [file]

Needs the extra `stage`. Rendered at twice the size and averaged, so that the matte has soft edges. Bodies
have changed since: the same seed now gives another person.
"""

import sys
from pathlib import Path

import numpy as np

import relight
from shadow import directions
from shadow.data import lightings, photographs
from shadow.installing import install_command

try:
    from shadow.lightstage import stage
    from shadow.lightstage.people.generate import bodies
except ModuleNotFoundError as error:
    sys.exit(f"needs {error.name}; install it with: {install_command('stage')}")

SIZE = 1024
seed = int(sys.argv[1]) if len(sys.argv) > 1 else 13
path = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("person.png")

lights = directions.olat(behind=True)
view = stage.View(azimuth=8, distance=3.5, height=1.2, pitch=-5, fov=34)
record = stage.render(bodies.body(seed, "generalisation"), view, 2 * SIZE, lights)

# A large softbox at upper right and a pale room: the old light that relighting has to take out again.
weights = np.full((len(lights), 3), 0.6 / len(lights), np.float32) * (1 + lights[:, 1:2])
weights += np.float32([1.25, 1.2, 1.12]) * lightings.softbox(lights)[:, None]
colour = record.image(photographs.light(record, weights)).numpy()
premultiplied = np.concatenate([colour, record.mask[None]]).transpose(1, 2, 0)  # black outside the person
pixels = premultiplied.reshape(SIZE, 2, SIZE, 2, 4).mean(axis=(1, 3), dtype=np.float32)
rows, columns = (np.flatnonzero(pixels[..., 3].any(axis=axis)) for axis in (1, 0))
margin = SIZE // 20
box = np.s_[
    max(rows[0] - margin, 0) : rows[-1] + margin, max(columns[0] - 2 * margin, 0) : columns[-1] + 2 * margin
]
relight.write(path, np.ascontiguousarray(pixels[box]))
print(f"wrote {path}")
