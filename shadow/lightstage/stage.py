"""The virtual light stage: cameras around a figure, and ray-traced ground truth for a set of lights.

For visibility, one shadow ray is traced from each hit of a camera ray to each light (Section 3, "Data
Generation"). Path-traced shading is the sum of direct light, which follows from normals and visibility, and
the bounce light of bounce.py.
"""

import hashlib
import multiprocessing
import os
from collections import Counter
from collections.abc import Callable, Collection
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, replace
from functools import partial
from multiprocessing.context import BaseContext
from pathlib import Path

import numpy as np
import torch
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from shadow import directions
from shadow.data import records
from shadow.lightstage import bounce, relief, scans, variants
from shadow.lightstage.figure import Figure
from shadow.lightstage.people.generate import bodies, heads, pairs
from shadow.lightstage.scene import Scene, Surface

FRONTAL = 1.5  # exponent that moves the azimuths of portraits toward the face; 1 is a uniform distribution


@dataclass(frozen=True)
class View:
    """A camera around the figure. The defaults are those of Section 3."""

    azimuth: float = 0.0  # degrees around the figure, from its front toward its left hand
    distance: float = 1.75  # metres from the axis
    height: float = 0.9  # metres above the floor
    pitch: float = 0.0  # degrees, positive looks up
    fov: float = 70.0  # degrees, of the square image
    pan: float = 0.0  # degrees, positive looks past the axis to image left

    def rotation(self) -> np.ndarray:
        """Return the rotation (3, 3) from world to camera."""
        a, p = np.radians([self.azimuth + self.pan, self.pitch])
        around = [[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]]
        tilt = [[1, 0, 0], [0, np.cos(p), np.sin(p)], [0, -np.sin(p), np.cos(p)]]
        return np.array(tilt) @ np.array(around)

    def position(self) -> np.ndarray:
        """Return the position (3,) of the camera in the world, in metres."""
        a = np.radians(self.azimuth)
        return np.array([self.distance * np.sin(a), self.height, self.distance * np.cos(a)])


def views(
    count: int,
    figure: Figure | None = None,
    rng: np.random.Generator | None = None,
    portrait: bool = False,
    head: bool = False,
) -> list[View]:
    """Return `count` evenly spaced views: those of Section 3 or, with `rng`, jittered ones of `figure`.

    Jitter varies angle, camera height and distance, with a longer lens at a longer distance. The camera is
    pitched and framed so that the whole figure is visible. With `portrait`, it frames between the head and
    the upper three quarters of the figure, more often from the front. With `head`, it frames between the head
    and the figure down to the waist, mostly within 60 degrees of the front.
    """
    angles = 360 / count * np.arange(count)
    if rng is None or figure is None:
        return [View(float(angle)) for angle in angles]
    if head:
        return [_head(figure, float(rng.choice([30, 30, 30, 80]) * rng.normal()), rng) for _ in range(count)]
    camera = _portrait if portrait else _whole
    angles = angles + rng.uniform(0, 360)
    return [camera(figure, (angle + rng.uniform(-0.5, 0.5) * 360 / count) % 360, rng) for angle in angles]


def _frontal(azimuth: float) -> float:
    """Move an azimuth in [0, 360) toward the front, on the same side.

    Of uniformly distributed azimuths, nearly two thirds are then within 90 degrees of the front, as in most
    portraits.
    """
    side = (azimuth + 180) % 360 - 180
    return float(np.sign(side) * 180 * (abs(side) / 180) ** FRONTAL) % 360


def _whole(figure: Figure, azimuth: float, rng: np.random.Generator) -> View:
    """Draw a camera that sees the whole figure."""
    top = figure.vertices[:, 1].max()
    reach = max(top / 2, np.linalg.norm(figure.vertices[:, [0, 2]], axis=1).max())
    distance, height = rng.uniform(1.75, 5.0), np.clip(rng.normal(1.0, 0.35), 0.3, 2.0)
    pitch = np.degrees(np.arctan2(top / 2 - height, distance))
    fov = 2 * np.degrees(np.arctan(reach * rng.uniform(1.1, 1.3) / (distance - 0.2)))
    return View(*map(float, (azimuth, distance, height, pitch, fov)))


def _portrait(figure: Figure, azimuth: float, rng: np.random.Generator) -> View:
    """Draw a camera that sees the figure from its top to a random cut, from about the height of that part."""
    azimuth = _frontal(azimuth)
    top = figure.vertices[:, 1].max()
    span = top * np.exp(rng.uniform(np.log(0.15), np.log(0.75)))
    across, middle, along = figure.vertices[figure.vertices[:, 1] > top - span].mean(axis=0)
    distance, height = rng.uniform(1.3, 4.0), np.clip(rng.normal(middle, 0.2), 0.3, 2.0)
    x, _, z = View(azimuth, distance, height).position() - (across, 0, along)
    away = np.hypot(x, z)
    aside = np.degrees(np.arctan(rng.normal(0, 0.1) * span / away))  # people are not exactly centred
    pan = (np.degrees(np.arctan2(x, z)) + aside - azimuth + 180) % 360 - 180
    pitch = np.degrees(np.arctan2(top - span / 2 - height, away))
    fov = 2 * np.degrees(np.arctan(span / 2 * rng.uniform(1.02, 1.2) / (away - 0.1)))
    return View(*map(float, (azimuth, distance, height, pitch, fov, pan)))


def _head(figure: Figure, azimuth: float, rng: np.random.Generator) -> View:
    """Draw a camera that sees the head alone, or the figure down to the waist, from 0.35 to 1.8 m.

    The azimuth is relative to the direction of the face.
    """
    face, front, top = _face(figure)
    span = np.exp(rng.uniform(np.log(0.28), np.log(0.7)))
    away = np.exp(rng.uniform(np.log(0.35), np.log(1.8))) + 0.1
    towards = front + np.radians(azimuth)
    eye = face + away * np.array([np.sin(towards), rng.normal(0, 0.12), np.cos(towards)])
    position = np.degrees(np.arctan2(eye[0], eye[2]))
    aside = np.degrees(np.arctan(rng.normal(0, 0.08) * span / away))
    pan = (np.degrees(towards) + aside - position + 180) % 360 - 180
    pitch = np.degrees(np.arctan2(top - span / 2 - eye[1], away))
    fov = 2 * np.degrees(np.arctan(span / 2 * rng.uniform(1.02, 1.25) / (away - 0.1)))
    return View(*map(float, (position % 360, np.hypot(eye[0], eye[2]), eye[1], pitch, min(fov, 85.0), pan)))


def _face(figure: Figure) -> tuple[np.ndarray, float, float]:
    """Return the middle (3,) of the face, the azimuth in radians to which it looks, and the head's top.

    A figure without regions is taken to look forward, with its head at the top.
    """
    top = figure.vertices[:, 1].max()
    if figure.regions is None or not (of_face := figure.regions == records.REGIONS.index("face")).any():
        head = figure.vertices[figure.vertices[:, 1] > top - 0.24].mean(axis=0)
        return head, 0.0, top
    points = figure.vertices[figure.faces[of_face]].mean(axis=1)
    normal = figure.normals[figure.faces[of_face]].mean(axis=(0, 1))
    middle = points.mean(axis=0)
    near = np.linalg.norm(figure.vertices[:, [0, 2]] - middle[[0, 2]], axis=1) < 0.16
    high = figure.vertices[near & (figure.vertices[:, 1] < middle[1] + 0.3), 1].max()
    # A raised hand or a tall hat must not push the face out of the frame.
    return middle, float(np.arctan2(normal[0], normal[2])), float(min(high, middle[1] + 0.2))


def camera_rays(view: View, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and directions (size * size, 3) of rays through pixel centres, in row order.

    They are in the camera frame.
    """
    extent = np.tan(np.radians(view.fov) / 2)
    step = extent * ((np.arange(size) + 0.5) * 2 / size - 1)
    x, y = np.meshgrid(step, -step)
    rays = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3)
    return np.zeros_like(rays), rays


def render(
    figure: Figure, view: View, size: int, lights: np.ndarray, bounced: bool = False
) -> records.Record:
    """Ray-trace one view of a figure, a square image of `size` pixels a side.

    `lights`: (D, 3) unit directions in the camera frame. `bounced`: whether to trace bounce light too, which
    path-traced shading needs. Visibility is zero where the geometric or the shading normal faces away from
    the light, so that interpolated normals do not leak light through a coarse surface. Raises ValueError if
    the camera sees nothing of the figure.
    """
    scene = Scene(figure, view.rotation(), view.position())
    seen, surface = scene.trace(*camera_rays(view, size))
    if not seen.any():
        raise ValueError(f"view: the camera sees nothing of {figure.name} from {view}")
    mask, lit = seen.reshape(size, size), scene.visibility(surface, lights)
    indirect = _bounce(scene, surface, mask, lights, _seed(figure.name, view)) if bounced else None
    depth, camera = _depth(surface, mask, view)
    about = {"figure": figure.name, "view": asdict(view), "camera": camera}
    truth = mask, surface.normal, surface.albedo, lit, lights, about, indirect, depth
    return records.Record.of(*truth, regions=surface.region)


def _depth(surface: Surface, mask: np.ndarray, view: View) -> tuple[np.ndarray, dict[str, float]]:
    """Return depth (N, 1) in the unit of `Record.depth`, and the values that convert it to positions."""
    focal = len(mask) / 2 / np.tan(np.radians(view.fov) / 2)
    away = -surface.position[:, 2:]
    rows = np.flatnonzero(mask.any(axis=1))
    height = (rows[-1] + 1 - rows[0]) / focal * away.mean()
    camera = {"focal": float(focal), "mean_depth": float(away.mean() / height)}
    return (away - away.mean()) / height, camera


def _bounce(
    scene: Scene, surface: Surface, mask: np.ndarray, lights: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Trace bounce light at a quarter of the pixels, since it is smooth; return factors (N, K), (K, D, 3)."""
    quarter = np.zeros_like(mask)
    quarter[::2, ::2] = True
    sparse = surface.take(quarter[mask])
    shading = bounce.indirect_shading(scene, sparse, lights, np.random.default_rng(seed))
    strength, patterns = bounce.factorise(shading)
    return bounce.upsample(strength, sparse, surface, mask), patterns


def _seed(*parts: object) -> int:
    return int.from_bytes(hashlib.sha256(repr(parts).encode()).digest()[:8])


@dataclass(frozen=True)
class FigureSource:
    """The name of a figure and a function that makes it, to be called in a worker process."""

    name: str  # prefix of the names of its records
    load: Callable[[], Figure]

    @classmethod
    def body(
        cls,
        seed: int,
        split: str,
        *,
        simulate: bool = False,
        cache: Path | None = None,
        assets: Path | None = None,
    ) -> "FigureSource":
        """Return the source of a clothed body; see `bodies.body`."""
        name = f"body-{split}-{seed:06d}" + "-simulated" * simulate + "-makehuman" * (assets is not None)
        return cls(name, partial(bodies.body, seed, split, simulate=simulate, cache=cache, assets=assets))

    @classmethod
    def head(cls, seed: int, split: str, folder: Path, assets: Path | None = None) -> "FigureSource":
        """Return the source of a person with a head of ICT-FaceKit; see `heads.head`."""
        name = f"head-{split}-{seed:06d}" + "-makehuman" * (assets is not None)
        return cls(name, partial(heads.head, seed, split, folder, assets))

    @classmethod
    def pair(cls, seed: int, split: str) -> "FigureSource":
        """Return the source of two clothed people who touch each other; see `pairs.pair`."""
        return cls(f"pair-{split}-{seed:06d}", partial(pairs.pair, seed, split))

    @classmethod
    def scan(cls, path: str | Path, normal_map: bool = True) -> "FigureSource":
        """Return the source of a mesh or scan; see `scans.load`."""
        return cls(f"scan-{Path(path).stem}", partial(scans.load, path, normal_map))

    @classmethod
    def variant(
        cls, path: str | Path, number: int, folded: bool = False, normal_map: bool = True
    ) -> "FigureSource":
        """Return the source of a scan with another build and other colours; see `variants.variant`."""
        name = f"scan-{variants.name(path, number, folded)}"
        return cls(name, partial(variants.variant, path, number, folded, normal_map))


def _clean_processes() -> BaseContext:
    """Return how to start processes without threads of this one: forks of a server that has this module."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    return context


@dataclass(frozen=True)
class Settings:
    """What is rendered of each figure. The defaults are those of Section 3."""

    views: int = 9  # around each figure
    size: int = 512  # side of the square image in pixels
    behind: bool = False  # whether to add 32 directions behind the subject to the 64 in front
    # Number of directions, drawn at random for each view, instead of those. With `behind`, a third of them
    # are behind the subject. Fewer directions take less time, and networks see more different ones.
    lights: int | None = None
    jitter: bool = False  # whether to vary camera height, distance and field of view
    portrait: bool = False  # close-up views with jitter: the frame cuts the figure between neck and shins
    head: bool = False  # views of the head, down to the waist at most
    bounced: bool = False  # whether to trace bounce light, for path-traced shading
    raised: bool = False  # whether painted folds of scans without a normal map become relief (relief.py)
    # Whether to draw other fabrics and colours of a body's clothes for each view. Their shape stays.
    fabrics: bool = False


def _render_figure(source: FigureSource, out: Path, settings: Settings) -> tuple[int, int]:
    """Render all views of one figure; return the number of records and bytes written."""
    os.environ["OMP_NUM_THREADS"] = "1"
    paths = [out / f"{source.name}-{index:02d}.npz" for index in range(settings.views)]
    if all(path.exists() for path in paths):
        return 0, 0
    figure, behind = source.load(), settings.behind
    portrait, head = settings.portrait, settings.head
    rng = np.random.default_rng(_seed(source.name)) if settings.jitter or portrait or head else None
    lights = directions.olat(behind)
    sizes = []
    for path, view in zip(paths, views(settings.views, figure, rng, portrait, head), strict=True):
        if not path.exists():
            own = np.random.default_rng(_seed(path.stem))
            if settings.lights is not None:
                lights = directions.stratified(settings.lights, own, behind)
            if settings.fabrics and figure.redraw_fabrics is not None:
                figure = replace(figure, albedo=figure.redraw_fabrics(own))
            record = render(figure, view, settings.size, lights, settings.bounced)
            # A normal map already has the folds that are painted in the texture.
            painted = settings.raised and figure.normal_map is None
            sizes.append(records.write(path, relief.raise_folds(record) if painted else record))
    return len(sizes), sum(sizes)


def render_all(
    sources: Collection[FigureSource],
    out: str | Path,
    settings: Settings,
    *,
    processes: int | None = None,
    pool: Executor | None = None,
) -> tuple[int, int, dict[str, Exception]]:
    """Render records of figures into the folder `out`, in one process for each core or in a given pool.

    Existing views are kept, so an interrupted run continues where it stopped. The result depends on sources
    and settings only, not on the order or the number of `processes`. The workers of a `pool` see `out` and
    the sources under the same paths.

    Returns the number of records and of bytes written, and {source name: error}. Raises ValueError if two
    sources have one name.
    """
    for name, count in Counter(source.name for source in sources).items():
        if count > 1:
            raise ValueError(f"sources: two are named {name!r}, as their records would be; rename a file")
    out = Path(out).absolute()  # a worker may have another working directory
    out.mkdir(parents=True, exist_ok=True)
    work = partial(_render_figure, out=out, settings=settings)
    written, size_on_disk = 0, 0
    errors: dict[str, Exception] = {}
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    own: AbstractContextManager[Executor]
    if pool is None:
        # A fork of this process would wait forever for the threads of torch and Embree, which it lacks.
        own = ProcessPoolExecutor(
            processes or os.cpu_count(), _clean_processes(), initializer=torch.set_num_threads, initargs=(1,)
        )
    else:
        own = nullcontext(pool)
    with own as workers, Progress(*columns) as progress:
        task = progress.add_task("rendering", total=len(sources))
        for future in as_completed(jobs := {workers.submit(work, source): source for source in sources}):
            try:
                count, size_of_views = future.result()
                written, size_on_disk = written + count, size_on_disk + size_of_views
            except ValueError as error:  # one unreadable mesh must not stop a long run
                errors[jobs[future].name] = error
            progress.advance(task)
    return written, size_on_disk, errors
