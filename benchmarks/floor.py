"""Compare shadows on the floor with traced rays, for rendered bodies on a plane, each under one hard light.

OMP_NUM_THREADS=1 python benchmarks/floor.py [VIEWS] [picture.png]     # intersection over union, a table
OMP_NUM_THREADS=1 python benchmarks/floor.py --figure docs/floor.png   # where the missing back shows
OMP_NUM_THREADS=1 python benchmarks/floor.py --cost                    # seconds a light at 1920 x 1080

Bodies are of the generalisation split. The light stage gives the truth: it casts a ray to the light from each
point of the plane that the camera sees. A point is in shadow where less than half of the light is left.
"Matte laid flat" takes the matte for a card that stands at the feet and faces the camera, and shears its
shadow along the light, as compositors do by hand. The true horizon, body height and lens are given.

Figures to compare with are in docs/compositing.md; a higher intersection over union is better.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from near import photographed

import relight
from relight.compositing.floor_shadow import FloorShadow, middle
from relight.compositing.shadow_caster import ShadowCaster
from shadow.directions import from_spherical

SIZE = 448  # pixels of the rendered frames
WIDER = 1.4  # than what shows the body alone
ELEVATIONS = 20, 60  # degrees
FIGURE = 7, 12  # bodies


class View:
    """A body on its plane, the camera that sees both, and the true shadow in a light."""

    def __init__(self, seed):
        from shadow.lightstage import stage
        from shadow.lightstage.people.generate import bodies
        from shadow.lightstage.scene import Scene

        rng = np.random.default_rng(seed)
        figure = bodies.body(seed, "generalisation")
        (view,) = stage.views(1, figure, rng)
        view = replace(view, fov=2 * np.degrees(np.arctan(WIDER * np.tan(np.radians(view.fov / 2)))))
        scene = Scene(figure, view.rotation(), view.position())
        origins, rays = stage.camera_rays(view, SIZE)
        seen, surface = scene.trace(origins, rays)
        up = view.rotation() @ [0, 1, 0]
        self.direction = self._drawn(rng, np.radians(view.pitch))
        below = np.flatnonzero((rays @ up < -1e-3) & ~seen)
        points = rays[below] * (view.height / -(rays[below] @ up))[:, None]
        lights = np.broadcast_to(self.direction, points.shape)
        hit = scene._embree.run(np.float32(points + 1e-3 * up), np.float32(lights), query="OCCLUDED") == 0
        self.mask, shadow, floor = seen.reshape(SIZE, SIZE), np.zeros_like(seen), np.zeros_like(seen)
        shadow[below], floor[below] = hit, True
        self.shadow, self.ground = shadow.reshape(SIZE, SIZE), floor.reshape(SIZE, SIZE)
        self.image = photographed(scene, surface, self.mask, rng)
        self.depth = np.zeros((SIZE, SIZE), np.float32)
        self.depth[self.mask] = -surface.position[:, 2]
        self.fov = view.fov
        slope = np.tan(np.radians(view.fov / 2)) * 2 / SIZE
        rows = np.flatnonzero(self.mask.any(axis=1))
        self.height = (rows[-1] + 1 - rows[0]) * slope * np.median(self.depth[self.mask])
        self.floor = relight.Floor(horizon=0.5 - up[2] / up[1] / slope / SIZE)

    @staticmethod
    def _drawn(rng, pitch):
        """A direction to a light, drawn about the vertical of the floor."""
        x, y, z = from_spherical(rng.uniform(-180, 180), rng.uniform(*ELEVATIONS))
        return np.array([x, y * np.cos(pitch) + z * np.sin(pitch), z * np.cos(pitch) - y * np.sin(pitch)])

    def subject(self, depth=None):
        return relight.Subject(
            self.image, np.float32(self.mask), depth=depth, height=self.height, field_of_view=self.fov
        )

    def score(self, left):
        """Intersection over union of what is left of the light (H, W, 3) with the truth."""
        found, true = (left[..., 0] < 0.5) & self.ground, self.shadow
        return (found & true).sum() / max((found | true).sum(), 1)


def laid_flat(view, subject):
    """The shadow (H, W, 3) of a card that has the matte's outline."""
    space, known = subject._record.maps.geometry, subject._record.maps.known
    positions = space.positions + middle(space.camera)[:, None, None]
    plane = view.floor.plane(space.camera, positions[:, known])
    feet = view.floor.soles(space.camera, positions[:, known])[:, 0]
    toward = torch.tensor([0.0, 0.0, 1.0]) - plane.normal * plane.normal[2]
    rays = positions[:, known].T
    card = rays * ((toward @ feet) / (rays @ toward))[:, None]
    stance = FloorShadow(space.camera, plane, ShadowCaster(card, space.metres_per_pixel), 1.0)
    return stance.shadows({"light": relight.DirectionalLight(view.direction)})[1]


def table(views, picture=None):
    scores, shown = [], []
    for seed in range(views):
        view = View(seed)
        if not view.shadow.any():
            continue
        subject = view.subject()
        light = relight.DirectionalLight(view.direction)
        found = {"flat": laid_flat(view, subject)}
        found["own"] = subject.shadows(light, view.floor)[1]
        found["true"] = view.subject(view.depth).shadows(light, view.floor)[1]
        scores.append([view.score(left) for left in found.values()])
        print(f"{seed}: " + ", ".join(f"{score:.3f}" for score in scores[-1]), file=sys.stderr)
        truth = np.where(view.shadow, 0.0, 1.0)[..., None].repeat(3, axis=2)
        shown.append(np.concatenate([drawn(view, left) for left in (truth, *found.values())], axis=1))
    flat, *ours = np.array(scores).T
    print("| shadow | intersection over union | better than flat |\n|---|---|---|")
    print(f"| the matte laid flat | {flat.mean():.3f} | |")
    for name, score in zip(("the library's own depth", "true depth"), ours, strict=True):
        print(f"| `--floor`, {name} | {score.mean():.3f} | {(score > flat).sum()} of {len(flat)} |")
    if picture:
        relight.write(picture, np.float32(np.concatenate(shown)))


def figure(path):
    """Draw the true shadow beside the one from true depth, of FIGURE."""
    rows = []
    for seed in FIGURE:
        view = View(seed)
        light = relight.DirectionalLight(view.direction)
        ours = view.subject(view.depth).shadows(light, view.floor)[1]
        truth = np.where(view.shadow, 0.0, 1.0)[..., None].repeat(3, axis=2)
        rows.append([drawn(view, left)[SIZE // 8 : -SIZE // 16] for left in (truth, ours)])
    relight.write(path, np.float32(np.concatenate([np.concatenate(row, axis=1) for row in rows])))


def drawn(view, left):
    """The body before its shadow (H, W, 3)."""
    return np.where(view.mask[..., None], view.image, 0.1 + 0.5 * left).clip(0, 1)


def cost():
    """Print processor seconds of one thread: the best of three."""
    torch.set_num_threads(1)
    person = relight.read(Path(__file__).parent.parent / "examples" / "person.png")
    plate = relight.place(person, (1080, 1920), scale=0.75, offset=(0, -60))
    subject, floor = relight.Subject(plate), relight.Floor(horizon=0.45)
    subject.depth  # noqa: B018
    sky = np.full((32, 64, 3), 0.5, np.float32)
    lights = {
        "hard": relight.DirectionalLight(azimuth=-50, elevation=40),
        "soft": relight.DirectionalLight(azimuth=-50, elevation=40, angle=20),
        "lamp of a radius": relight.PointLight((-0.9, 0.8, 0.6), radius=0.1),
        "environment": relight.EnvironmentLight(sky),
    }
    for name, light in lights.items():
        times = []
        for _ in range(3):
            start = time.process_time()
            subject.shadows(light, floor)
            times.append(time.process_time() - start)
        print(f"{name}: {min(times):.2f} s")


if __name__ == "__main__":
    if sys.argv[1:] == ["--cost"]:
        cost()
    elif sys.argv[1:2] == ["--figure"]:
        figure(sys.argv[2])
    else:
        table(*map(int, sys.argv[1:2] or ["20"]), *sys.argv[2:])
