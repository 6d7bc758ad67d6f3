"""Measure how well estimated light replaces the true light. Bodies of the light stage are relit by light that
is estimated from a plate, or from a photograph of another body, and compared with how they look in that
place.

python benchmarks/matching.py [bodies]

Body and place number k have the seed k. Each body is photographed in another light and analysed. It is then
relit by the light that is estimated from a plate of the place (`relight.EnvironmentLight.from_plate`). It is
also placed in the previous place, and relit by the light that is estimated from a photograph of the previous
body there (`relight.match`).

Prints the RMSE in linear light over the body, as a share of the truth's RMS. Beside it are the errors of two
uniform grey environments: one has the energy of the estimated light, the other has the energy of the place
itself, which is unknown in practice. The last two columns are the errors of the estimated light and of the
grey one, each at the exposure that fits the truth best.

Figures to compare with are in docs/lights.md; the estimated light should beat both grey ones.
"""

import sys
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from places import KINDS, Place
from rich.progress import track

import relight
from shadow.data import lightings, photographs
from shadow.directions import olat
from shadow.lightstage import stage
from shadow.lightstage.people.generate import bodies

SIZE = 320  # pixels of a body's picture
PLATE = (360, 540)
MEAN = 0.2  # of a photograph, linear
COLUMNS = ("found", "grey, its energy", "grey, the place's energy", "found, exposed", "grey, exposed")


@dataclass
class Scene:
    """A body, the place it stands in, and the place before, in which it is lit as well."""

    seed: int

    @cached_property
    def place(self):
        return Place(KINDS[self.seed % len(KINDS)], self.seed)

    @cached_property
    def sky(self):
        """The light of the place."""
        return relight.EnvironmentLight(self.place.map())

    def shoot(self, other):
        """Ray-trace the body for this place's lights, for the `other` scene's, and for a photograph's."""
        samples = [self.sky.samples(), other.sky.samples()]
        directions = np.concatenate([olat(behind=True), *(sample[0] for sample in samples)])
        figure = bodies.body(self.seed, "generalisation")
        view = stage.views(1, figure, np.random.default_rng(self.seed))[0]
        self.record = stage.render(figure, view, SIZE, directions, bounced=True)
        self.mask = self.record.mask.astype(np.float32)
        none = np.zeros_like(directions)
        ends = np.cumsum([len(olat(behind=True)), *(len(sample[0]) for sample in samples)])
        self.truths = []
        for (_, powers), end in zip(samples, ends[1:], strict=True):
            weights = none.copy()
            weights[end - len(powers) : end] = powers
            self.truths.append(self._lit(weights))
        weights = none.copy()
        weights[: ends[0]] = lightings.everyday_lighting(
            np.random.default_rng(self.seed), directions[: ends[0]]
        )
        taken = self._lit(weights)
        self.photograph = _recorded(taken * MEAN / taken[self.record.mask].mean())

    def _lit(self, weights):
        """The body (H, W, 3) in weights (D, 3) of the directions."""
        return self.record.image(photographs.light(self.record, weights)).permute(1, 2, 0).numpy()

    def subject(self):
        return relight.Subject(self.photograph, self.mask)


def _recorded(light):
    """Linear light as a camera records it: 8 bits, sRGB."""
    encoded = relight.media.colour.encode(np.float32(light.clip(0, 1)), white=1.0)
    return np.round(encoded.clip(0, 1) * 255).astype(np.uint8)


def grey(energy):
    """A light from all around, of the summed intensity `energy`."""
    return relight.EnvironmentLight(np.full((8, 16, 3), energy / 12, np.float32))


def energy(lights):
    return 3 * np.mean(sum(light.samples()[1].sum(axis=0) for light in lights))


def errors(scene, subject, lights, truth, place):
    """What COLUMNS name."""
    inside = scene.record.mask

    def error(lights, exposed=False):
        found, there = subject.relit(lights)[inside][:, :3], truth[inside]
        gain = (found * there).sum() / (found**2).sum() if exposed else 1
        return np.sqrt(((gain * found - there) ** 2).mean() / (there**2).mean())

    even = grey(energy(lights)), grey(energy([place.sky]))
    return [error(lights), *map(error, even), error(lights, True), error(even[0], True)]


def measure(seeds):
    """Per kind of light found, {seed: errors}."""
    scenes = [Scene(seed) for seed in seeds]
    before = scenes[-1:] + scenes[:-1]
    tables = {"from the plate": {}, "from another's photograph": {}}
    for scene, other in track(list(zip(scenes, before, strict=True)), "bodies"):
        scene.shoot(other)
    for scene, other in track(list(zip(scenes, before, strict=True)), "light"):
        subject = scene.subject()
        plate = relight.EnvironmentLight.from_plate(scene.place.plate(PLATE))
        tables["from the plate"][scene.seed] = errors(scene, subject, [plate], scene.truths[0], scene)
        matched = relight.match(subject, _recorded(other.truths[0]), mask=other.mask)
        tables["from another's photograph"][scene.seed] = errors(
            scene, subject, matched, scene.truths[1], other
        )
    return tables


def main(count=20):
    for name, table in measure(range(int(count))).items():
        print(f"\nLight {name}\n\n| body | {' | '.join(COLUMNS)} |\n|---|{'---|' * len(COLUMNS)}")
        for seed, row in table.items():
            print(f"| {seed} | {' | '.join(f'{value:.2f}' for value in row)} |")
        rows = np.array(list(table.values()))
        print(f"| mean | {' | '.join(f'{value:.2f}' for value in rows.mean(axis=0))} |")
        print(f"| median | {' | '.join(f'{value:.2f}' for value in np.median(rows, axis=0))} |")
        found, same, there, exposed, even = rows.T
        print(
            f"\nOf {len(rows)}, smaller than with the grey light of its energy: {(found < same).sum()}; with "
            f"that of the place's energy: {(found < there).sum()}; exposed: {(exposed < even).sum()}."
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
