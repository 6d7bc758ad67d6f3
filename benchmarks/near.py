"""Measure lights in the room: their cost compared with a distant light, and their errors on rendered people.

python benchmarks/near.py                      # cost, one thread, in processor time
python benchmarks/near.py --truth [BODIES]     # against rays, on bodies of the generalisation split

The light stage gives the truth: it casts a ray to the lamp from each point that the camera sees. The lamp
stands 0.7 to 2 m from the middle of the body. "Directional" is a distant light from the same position.
Shading is of direct light. The irradiance of each lamp is 1 at the middle of the body. The true camera and
height are given.

Figures to compare with are in docs/lights.md; lower errors are better.
"""

import argparse
import time
from functools import partial
from pathlib import Path

import numpy as np
import torch
from timing import quickest

import relight
from relight.lights.light import Light
from shadow.directions import olat

REPEATS = 7
SIZE = 448  # pixels of the rendered frames
LAMPS = 4  # a body
BODIES = 20
NEAREST, FARTHEST = 0.7, 2.0  # metres


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("image", nargs="?", default=Path(__file__).parents[1] / "examples" / "person.png")
    parser.add_argument("--truth", nargs="?", type=int, const=BODIES)
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    if chosen.truth is None:
        cost(chosen.image)
    else:
        report(truth(chosen.truth))


def cost(path: Path) -> None:
    """Print the seconds of new lights, and ratios, which hold on any machine."""
    subject = relight.Subject(relight.read(path))
    start = time.process_time()
    subject._record.maps.geometry.positions  # noqa: B018
    print(f"depth, once: {time.process_time() - start:.2f} s")
    place, centre = (-0.6, 0.4, 0.8), (0.0, 0.0, 0.0)
    hard, soft = relight.DirectionalLight(place), relight.DirectionalLight(place, angle=10)
    lights: list[tuple[str, Light, Light]] = [
        ("point", relight.PointLight(place), hard),
        ("sphere", relight.PointLight(place, radius=0.1), soft),
        ("rectangle", relight.RectLight(place, centre, 1.0, 0.5), soft),
    ]
    for name, near, far in lights:
        ours, theirs = (quickest(partial(subject.relit, light), REPEATS) for light in (near, far))
        kind = "hard" if far is hard else "soft"
        print(f"{name}: {ours:.3f} s; {kind} distant light {theirs:.3f} s; ratio {ours / theirs:.1f}")


def truth(bodies: int) -> dict[str, np.ndarray]:
    """{what: (lamps,) RMSE}, and of depth {what: (bodies,) per cent of the height}."""
    scores: dict[str, list[float]] = {}
    for seed in range(bodies):
        for name, value in scored(seed):
            scores.setdefault(name, []).append(value)
    return {name: np.array(values) for name, values in scores.items()}


def scored(seed: int):
    """Yield (what, error) of one body."""
    from shadow.lightstage import stage
    from shadow.lightstage.people.generate import bodies
    from shadow.lightstage.scene import Scene

    rng = np.random.default_rng(seed)
    figure = bodies.body(seed, "generalisation")
    (view,) = stage.views(1, figure, rng)
    scene = Scene(figure, view.rotation(), view.position())
    seen, surface = scene.trace(*stage.camera_rays(view, SIZE))
    mask = seen.reshape(SIZE, SIZE)
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    away = -surface.position[:, 2].astype(np.float64)
    slope = np.tan(np.radians(view.fov) / 2) * 2 / SIZE  # metres of a pixel at one metre
    corner = [columns[0] + columns[-1] + 1 - SIZE, SIZE - rows[0] - rows[-1] - 1]
    middle = np.median(away) * np.array([corner[0] * slope / 2, corner[1] * slope / 2, -1.0])
    height = (rows[-1] + 1 - rows[0]) * slope * np.median(away)

    subject = relight.Subject(
        photographed(scene, surface, mask, rng),
        mask.astype(np.float32),
        height=height,
        field_of_view=view.fov,
    )
    depth = subject.depth[mask]
    for name, estimate in (("depth", depth), ("no depth", np.zeros_like(depth))):
        error = np.abs(estimate - estimate.mean() - away + away.mean()).mean()
        yield name, 100 * error / height
    for _ in range(LAMPS):
        place = lamp(surface.position - middle, rng)
        lit, shaded = rays(scene, surface, place + middle)
        distance = np.linalg.norm(place)
        near = relight.PointLight(place, intensity=distance**2)
        for name, light in (("near", near), ("directional", relight.DirectionalLight(place))):
            yield f"visibility, {name}", rmse(subject.unshadowed(light)[mask], lit)
            yield f"shading, {name}", rmse(subject.lighting(light)[mask][:, 0], shaded * distance**2)


def photographed(scene, surface, mask: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(H, W, 3) of the body in three lights and a little from everywhere."""
    lights = olat()[rng.choice(len(olat()), 3, replace=False)]
    facing = (surface.normal @ lights.T).clip(0) * scene.visibility(surface, lights)
    image = np.zeros((*mask.shape, 3), np.float32)
    image[mask] = surface.albedo * (0.2 + facing @ rng.uniform(0.2, 0.6, 3))[:, None]
    return image


def lamp(positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A place (3,) 0.7 to 2 m from the middle, before or beside the body, and 0.3 m clear of it."""
    while True:
        way = rng.normal(size=3)
        way[2] = abs(way[2])
        place = way / np.linalg.norm(way) * rng.uniform(NEAREST, FARTHEST)
        if np.linalg.norm(positions - place, axis=1).min() > 0.3:
            return place


def rays(scene, surface, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Visibility and shading (N,) of a lamp of intensity 1 at `place`, camera frame."""
    from shadow.lightstage.scene import OFFSET

    ways = place - surface.position
    distance = np.linalg.norm(ways, axis=1)
    ways = ways / distance[:, None]
    cosine = (surface.normal * ways).sum(axis=1)
    facing = np.flatnonzero((cosine > 0) & ((surface.geometric * ways).sum(axis=1) > 0))
    origins = (surface.position + OFFSET * surface.geometric)[facing]
    hit = scene.trace(origins, ways[facing])
    gone = np.full(len(facing), np.inf)
    gone[hit[0]] = np.linalg.norm(hit[1].position - origins[hit[0]], axis=1)
    lit = np.zeros(len(ways))
    lit[facing] = gone > distance[facing]
    return lit, lit * cosine.clip(0) / distance**2


def rmse(estimate: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean((estimate - truth) ** 2)))


def report(scores: dict[str, np.ndarray]) -> None:
    """Print the means, and of how many lamps ours is the better."""
    for what in ("visibility", "shading"):
        near, far = scores[f"{what}, near"], scores[f"{what}, directional"]
        better = f"better for {(near < far).sum()} of {len(near)} lamps"
        print(f"{what}: RMSE {near.mean():.3f}, directional {far.mean():.3f}; {better}")
    print(
        f"depth: {scores['depth'].mean():.2f} % of the height off; {scores['no depth'].mean():.2f} % without"
    )


if __name__ == "__main__":
    main()
