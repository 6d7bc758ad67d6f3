"""The virtual light stage: cameras around a figure, and ray-traced truth for every direction of the set.

No path tracer is needed for visibility: the hit points of the camera rays, then one shadow ray to each
light (Section 3, "Data Generation"). Path-traced shading is direct light, which normals and visibility
give, and the bounce light of bounce.py.
"""

import hashlib
import os
from collections.abc import Callable, Collection
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from shadow import directions
from shadow.data import records
from shadow.lightstage import bounce, relief, scans, variants
from shadow.lightstage.figure import Figure
from shadow.lightstage.people import bodies, pairs
from shadow.lightstage.scene import Scene, Surface

FRONTAL = 1.5  # exponent that draws the azimuths of portraits toward the face; 1 leaves them even


@dataclass(frozen=True)
class View:
    """A camera that looks at the figure's vertical axis, or past it. The defaults are those of Section 3."""

    azimuth: float = 0.0  # degrees around the figure, from its front toward its left hand
    distance: float = 1.75  # metres from the axis
    height: float = 0.9  # metres above the floor
    pitch: float = 0.0  # degrees, positive looks up
    fov: float = 70.0  # degrees, of the square image
    pan: float = 0.0  # degrees, positive looks past the axis to image left

    def rotation(self) -> np.ndarray:
        """World to camera (3, 3)."""
        a, p = np.radians([self.azimuth + self.pan, self.pitch])
        around = [[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]]
        tilt = [[1, 0, 0], [0, np.cos(p), np.sin(p)], [0, -np.sin(p), np.cos(p)]]
        return np.array(tilt) @ np.array(around)

    def position(self) -> np.ndarray:
        """The camera in the world (3,)."""
        a = np.radians(self.azimuth)
        return np.array([self.distance * np.sin(a), self.height, self.distance * np.cos(a)])


def views(
    count: int, figure: Figure | None = None, rng: np.random.Generator | None = None, portrait: bool = False
) -> list[View]:
    """`count` views evenly around the subject: those of Section 3, or with `rng` jittered around `figure`.

    Jitter is of angle, camera height and distance; a longer distance comes with a longer lens, and the
    camera is tilted and framed so that the whole figure is seen, as a photographer would; or, with
    `portrait`, its head alone to the upper three quarters of it, and rather from the front than from behind.
    """
    angles = 360 / count * np.arange(count)
    if rng is None or figure is None:
        return [View(float(angle)) for angle in angles]
    camera = _portrait if portrait else _whole
    angles = angles + rng.uniform(0, 360)
    return [camera(figure, (angle + rng.uniform(-0.5, 0.5) * 360 / count) % 360, rng) for angle in angles]


def _frontal(azimuth: float) -> float:
    """An azimuth in [0, 360) moved toward the face, where it stays on its side: of even ones nearly two in
    three are then within 90 degrees of it, as most portraits are."""
    side = (azimuth + 180) % 360 - 180
    return float(np.sign(side) * 180 * (abs(side) / 180) ** FRONTAL) % 360


def _whole(figure: Figure, azimuth: float, rng: np.random.Generator) -> View:
    """A camera that sees all of the figure."""
    top = figure.vertices[:, 1].max()
    reach = max(top / 2, np.linalg.norm(figure.vertices[:, [0, 2]], axis=1).max())
    distance, height = rng.uniform(1.75, 5.0), np.clip(rng.normal(1.0, 0.35), 0.3, 2.0)
    pitch = np.degrees(np.arctan2(top / 2 - height, distance))
    fov = 2 * np.degrees(np.arctan(reach * rng.uniform(1.1, 1.3) / (distance - 0.2)))
    return View(*map(float, (azimuth, distance, height, pitch, fov)))


def _portrait(figure: Figure, azimuth: float, rng: np.random.Generator) -> View:
    """A camera at the height of what it looks at, or nearly: the figure from its top down to a random cut."""
    azimuth = _frontal(azimuth)
    top = figure.vertices[:, 1].max()
    span = top * np.exp(rng.uniform(np.log(0.15), np.log(0.75)))
    across, middle, along = figure.vertices[figure.vertices[:, 1] > top - span].mean(axis=0)
    distance, height = rng.uniform(1.3, 4.0), np.clip(rng.normal(middle, 0.2), 0.3, 2.0)
    x, _, z = View(azimuth, distance, height).position() - (across, 0, along)
    away = np.hypot(x, z)
    aside = np.degrees(np.arctan(rng.normal(0, 0.1) * span / away))  # nobody stands just in the middle
    pan = (np.degrees(np.arctan2(x, z)) + aside - azimuth + 180) % 360 - 180
    pitch = np.degrees(np.arctan2(top - span / 2 - height, away))
    fov = 2 * np.degrees(np.arctan(span / 2 * rng.uniform(1.02, 1.2) / (away - 0.1)))
    return View(*map(float, (azimuth, distance, height, pitch, fov, pan)))


def camera_rays(view: View, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions (size * size, 3), in row order, of the pixels' centres in the camera frame."""
    extent = np.tan(np.radians(view.fov) / 2)
    step = extent * ((np.arange(size) + 0.5) * 2 / size - 1)
    x, y = np.meshgrid(step, -step)
    rays = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3)
    return np.zeros_like(rays), rays


def render(
    figure: Figure, view: View, size: int, lights: np.ndarray, bounced: bool = False
) -> records.Record:
    """Ray-trace one view of a figure.

    Parameters
    ----------
    figure: Figure, in metres.
    view: View.
    size: pixels of the square image's side.
    lights: (D, 3) unit directions in the camera frame.
    bounced: trace the light that the figure throws on itself as well, which path-traced shading needs.

    Returns
    -------
    Record. Visibility is zero where the geometric or the shading normal faces away from the light, so that
    smooth normals cannot leak light through a coarse surface.

    Raises
    ------
    ValueError: the camera sees nothing of the figure.
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
    """Depth (N, 1) as `Record.depth` has it, and the camera that takes it back to positions."""
    focal = len(mask) / 2 / np.tan(np.radians(view.fov) / 2)
    away = -surface.position[:, 2:]
    rows = np.flatnonzero(mask.any(axis=1))
    height = (rows[-1] + 1 - rows[0]) / focal * away.mean()
    camera = {"focal": float(focal), "mean_depth": float(away.mean() / height)}
    return (away - away.mean()) / height, camera


def _bounce(
    scene: Scene, surface: Surface, mask: np.ndarray, lights: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Bounce light in factors, (N, K) and (K, D, 3), traced at a quarter of the pixels: it is smooth."""
    quarter = np.zeros_like(mask)
    quarter[::2, ::2] = True
    sparse = surface.take(quarter[mask])
    shading = bounce.bounce(scene, sparse, lights, np.random.default_rng(seed))
    strength, patterns = bounce.factors(shading)
    return bounce.spread(strength, sparse, surface, mask), patterns


def _seed(*parts: object) -> int:
    return int.from_bytes(hashlib.sha256(repr(parts).encode()).digest()[:8])


@dataclass(frozen=True)
class Source:
    """Where a figure comes from. What it is may take a second to make, so a worker does."""

    name: str  # what its records are called
    load: Callable[[], Figure]

    @classmethod
    def body(cls, seed: int, split: str, *, simulate: bool = False, cache: Path | None = None) -> "Source":
        """A clothed body; simulate, cache: as of `bodies.body`."""
        name = f"body-{split}-{seed:06d}" + ("-simulated" if simulate else "")
        return cls(name, partial(bodies.body, seed, split, simulate=simulate, cache=cache))

    @classmethod
    def pair(cls, seed: int, split: str) -> "Source":
        """Two clothed people in touch."""
        return cls(f"pair-{split}-{seed:06d}", partial(pairs.pair, seed, split))

    @classmethod
    def scan(cls, path: str | Path) -> "Source":
        """A mesh or scan, as of `scans.load`."""
        return cls(f"scan-{Path(path).stem}", partial(scans.load, path))

    @classmethod
    def variant(cls, path: str | Path, number: int, folded: bool = False) -> "Source":
        """A scan in another build and other colours, as of `variants.variant`."""
        name = f"scan-{variants.name(path, number, folded)}"
        return cls(name, partial(variants.variant, path, number, folded))


def _render_figure(
    source: Source,
    out: Path,
    view_count: int,
    size: int,
    behind: bool,
    jitter: bool,
    portrait: bool,
    bounced: bool,
    raised: bool,
) -> tuple[int, int]:
    """All the views of one figure: (records written, bytes written)."""
    os.environ["OMP_NUM_THREADS"] = "1"
    paths = [out / f"{source.name}-{index:02d}.npz" for index in range(view_count)]
    if all(path.exists() for path in paths):
        return 0, 0
    figure = source.load()
    rng = np.random.default_rng(_seed(source.name)) if jitter or portrait else None
    lights = directions.olat(behind)
    sizes = []
    for path, view in zip(paths, views(view_count, figure, rng, portrait), strict=True):
        if not path.exists():
            record = render(figure, view, size, lights, bounced)
            # A normal map holds the folds that are painted elsewhere: raised, they would be there twice.
            painted = raised and figure.detail is None
            sizes.append(records.write(path, relief.raise_folds(record) if painted else record))
    return len(sizes), sum(sizes)


def render_all(
    sources: Collection[Source],
    out: str | Path,
    *,
    views: int = 9,
    size: int = 512,
    behind: bool = False,
    jitter: bool = False,
    portrait: bool = False,
    bounced: bool = False,
    raised: bool = False,
    processes: int | None = None,
    pool: Executor | None = None,
) -> tuple[int, int, dict[str, Exception]]:
    """Render records of figures into the folder `out`, one process a core; or by a pool of other machines.

    Views that are there already are left: an interrupted run goes on where it stopped. The result depends
    on the arguments alone, not on the order or the number of processes.

    Parameters
    ----------
    sources: Sources.
    views: views a figure, evenly around it (Section 3: 9).
    size: pixels of the square image's side (Section 3: 512).
    behind: 32 directions behind the subject as well as the 64 of the frontal hemisphere.
    jitter: vary camera height, distance and field of view.
    portrait: jitter, and come close: the frame cuts the figure, somewhere from its neck to its shins.
    bounced: bounce light too, for path-traced shading.
    raised: the fine contrast of the albedo as relief, see relief.py; of scans that have no normal map, whose
        folds are only painted.
    processes: default one a core.
    pool: instead of processes; its workers see `out` and the sources under the same paths.

    Returns
    -------
    (records written, bytes written), and the errors by the source's name.
    """
    out = Path(out).absolute()  # a worker may have another working directory
    out.mkdir(parents=True, exist_ok=True)
    work = partial(
        _render_figure,
        out=out,
        view_count=views,
        size=size,
        behind=behind,
        jitter=jitter,
        portrait=portrait,
        bounced=bounced,
        raised=raised,
    )
    written, size_on_disk = 0, 0
    errors: dict[str, Exception] = {}
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    # One thread each: a forked process that inherits torch's threads waits for them forever, since a fork
    # copies none, and there is a process a core anyway. DataLoader's workers do the same.
    own: AbstractContextManager[Executor]
    if pool is None:
        own = ProcessPoolExecutor(
            processes or os.cpu_count(), initializer=torch.set_num_threads, initargs=(1,)
        )
    else:
        own = nullcontext(pool)
    with own as workers, Progress(*columns) as progress:
        task = progress.add_task("rendering", total=len(sources))
        for future in as_completed(jobs := {workers.submit(work, source): source for source in sources}):
            try:
                count, size_of_views = future.result()
                written, size_on_disk = written + count, size_on_disk + size_of_views
            except ValueError as error:  # a mesh that cannot be read must not stop the night's run
                errors[jobs[future].name] = error
            progress.advance(task)
    return written, size_on_disk, errors
