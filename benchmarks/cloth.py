"""Measure what simulated garments cost, and whether they stay outside the body.

Prints the seconds of one core for each dressed body. For each kind of garment it prints the number of
vertices and the share of them that lie more than 1 mm inside the body, or inside the garments under it.

OMP_NUM_THREADS=1 python benchmarks/cloth.py [first seed] [bodies]

Good shares inside the body are near 0. Figures to compare with are in docs/training.md.
"""

import sys
import time
from collections import defaultdict

import numpy as np

from shadow.lightstage.people.cloth.garments import Wardrobe
from shadow.lightstage.people.cloth.nearest import MeshSurface
from shadow.lightstage.people.cloth.simulation import Simulator
from shadow.lightstage.people.generate import bodies, outfits, poses

DEEP = 0.001  # metres
LONG = 0.2  # metres below the hip from which a top is a dress
FIRST, COUNT = (int(word) for word in (sys.argv[1:] + ["1000", "20"][len(sys.argv) - 1 :])[:2])


class Noting(Simulator):
    """Keeps the garments, as cut and as they hang."""

    def drape(self, cut, between, solid):
        hung = super().drape(cut, between, solid)
        self.__dict__.setdefault("sewn", []).append((cut, hung))
        return hung


def dressed(seed):
    rng = bodies.random_generator(seed, "training")
    shape = bodies.Shape.draw(rng)
    pose = poses.draw(shape.skeleton, rng)
    pose.raise_heels(outfits.heel(rng, shape.woman))
    person = shape.posed(pose)
    simulator = Noting(person, f"training-{seed:06d}")
    outfits.dress(Wardrobe(person, rng, simulator), rng, "training", shape.woman)
    return person, simulator.sewn


def kind(person, cut, upper):
    """upper: whether there is a top under it."""
    if not cut.spans:
        return "trousers"
    if cut.rest[:, 1].max() < person.skeleton.head("spine03")[1]:
        return "skirt"
    if upper:
        return "jacket, coat"
    return "dress" if cut.rest[:, 1].min() < person.skeleton.head("upperleg01.L")[1] - LONG else "top"


def figures(person, sewn):
    """(kind, vertices, how many are deep in the body, how many in the garments under it) of each garment."""
    tights = person.base.tights
    body = MeshSurface(person.posed(tights.weights, person.tights_rest), tights.faces)
    under, upper = [], False
    for cut, hung in sewn:
        name = kind(person, cut, upper)
        upper |= name in ("top", "dress")
        poked = np.any([surface.heights(hung)[0] < -DEEP for surface in under] or [[False]], axis=0)
        yield name, len(hung), (body.heights(hung)[0] < -DEEP).sum(), poked.sum()
        under.append(MeshSurface(hung, cut.faces))


dressed(0)  # loads the body model and compiles
seconds, shares, table = [], [], defaultdict(list)
for seed in range(FIRST, FIRST + COUNT):
    start = time.process_time()
    person, sewn = dressed(seed)
    seconds.append(time.process_time() - start)
    rows = list(figures(person, sewn))
    for name, *row in rows:
        table[name].append(row)
    total, deep, _ = np.sum([row[1:] for row in rows], axis=0)
    shares.append(100 * deep / total)
    print(f"{seed}: {seconds[-1]:5.1f} s, {total} vertices, {shares[-1]:.3f} % in the body", flush=True)
print("garment        count  vertices  in the body, %   worst  in what is under, %")
for name, column in sorted(table.items()):
    count, deep, under = np.array(column).T
    print(
        f"{name:14}{len(count):6}{count.mean():10.0f}{100 * deep.sum() / count.sum():16.3f}"
        f"{100 * (deep / count).max():8.3f}{100 * under.sum() / count.sum():21.3f}"
    )
print(f"{np.mean(seconds):.1f} s a body on average, {np.max(seconds):.1f} s at most;")
print(f"in the body {np.mean(shares):.3f} % of the vertices on average, {np.max(shares):.3f} % at worst")
