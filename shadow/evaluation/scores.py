"""Score visibility networks and their normals on records, as in Sections 4.1 to 4.3."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import torch
from rich.progress import track

from shadow import normals, visibility
from shadow.analysis import VisibilityNetwork
from shadow.data.lightings import KINDS, everyday_lighting
from shadow.data.photographs import Sample, photograph, sample
from shadow.data.records import Record, Records
from shadow.evaluation import metrics
from shadow.framing import canvas_size
from shadow.networks.backbone import ENCODING, EXPOSURE
from shadow.networks.field import VisibilityField
from shadow.normals import NormalsSource

FRONTAL = 1e-6  # least z of a frontal light: the paper's 64 lights have z > 0
TRUE, ESTIMATED = "sign(N·L), true normals", "sign(N·L), estimated normals"


@dataclass(frozen=True)
class Score:
    """Mean and standard deviation over the maps, as in the paper's tables."""

    rmse: tuple[float, float]
    dice: tuple[float, float]

    @property
    def psnr(self) -> float:
        """PSNR of the mean RMSE, in dB (Section 4.1)."""
        return float(metrics.psnr(torch.tensor(self.rmse[0])))


@dataclass(frozen=True)
class ScoredView:
    """A photograph of a record on a canvas, with the true visibility of the frontal lights."""

    rgb: torch.Tensor  # (3, h, w) linear photograph
    scene: torch.Tensor  # (3, h, w) linear, before the simulated camera
    mask: torch.Tensor  # (h, w)
    normals: torch.Tensor  # (3, h, w) true
    albedo: torch.Tensor  # (3, h, w) true, linear
    lights: torch.Tensor  # (D, 3)
    visibility: torch.Tensor  # (D, h, w) 0 or 1

    @classmethod
    def of(
        cls, record: Record, seed: tuple[int, int], height: int, lighting: np.ndarray | None = None
    ) -> "ScoredView":
        """Make the view of `record` on a canvas of `height` pixels.

        `seed` determines the simulated camera. `lighting`, weights (D, 3) over the record's directions, is
        drawn by `seed` if None.
        """
        rng = np.random.default_rng(seed)
        drawn = sample(record, rng, canvas_size(height), augment=False, lighting=lighting)
        frontal = drawn["directions"][:, 2] > FRONTAL
        lit = (drawn["visibility"][frontal] > 0.5).float()
        rgb = photograph(drawn["rgb"], drawn["mask"], rng)
        device = best_device()
        truth = (drawn["mask"][0], drawn["normals"], drawn["albedo"], drawn["directions"][frontal], lit)
        return cls(*(tensor.to(device) for tensor in (rgb, drawn["rgb"], *truth)))

    def given(self, surface: NormalsSource, network: VisibilityNetwork) -> torch.Tensor | None:
        """Infer the normals (3, h, w) that a visibility network is given, by the network `surface`.

        Returns None if `surface` is that network itself, which infers normals together with its maps.
        """
        return None if surface is network else surface.normals(self.rgb, self.mask)

    def binary(
        self, network: VisibilityNetwork, given: torch.Tensor | None
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return normals (3, h, w), given or the network's own, and the network's maps (D, h, w) bool."""
        surface, visibility = network.analyse(self.rgb, self.mask, given)
        assert surface is not None  # a per-light network is given normals
        return surface, visibility(self.lights) > 0.5

    def sign(self, surface: torch.Tensor) -> torch.Tensor:
        """Return the baseline of Section 4.1, (D, h, w) bool, from normals (3, h, w)."""
        return torch.einsum("dc,chw->dhw", self.lights, surface) > 0


@dataclass(frozen=True)
class Tally:
    """RMSE and Dice of maps, collected. A map is that of one light and one record."""

    rmse: list[float] = field(default_factory=list)
    dice: list[float] = field(default_factory=list)
    lights: list[list[float]] = field(default_factory=list)

    def add(self, binary: torch.Tensor, view: ScoredView, chosen: torch.Tensor | slice = slice(None)) -> None:
        """Score binary maps (D, h, w) against the view's maps of all lights, or of the `chosen` ones."""
        estimate, truth, inside = binary[chosen].float(), view.visibility[chosen], view.mask > 0.5
        self.rmse.extend(metrics.rmse(estimate, truth, inside).tolist())
        self.dice.extend(metrics.dice(estimate, truth, inside).tolist())
        self.lights.extend(view.lights[chosen].tolist())

    def score(self) -> Score:
        """Return the Score over all maps."""
        return Score(*((float(np.mean(x)), float(np.std(x))) for x in (self.rmse, self.dice)))

    def by_light(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return directions (D, 3), and the mean and standard deviation (D,) of their RMSE (Figure 2)."""
        lights, index = np.unique(np.round(self.lights, 4), axis=0, return_inverse=True)
        groups = [np.array(self.rmse)[index.ravel() == i] for i in range(len(lights))]
        return lights, np.array([g.mean() for g in groups]), np.array([g.std() for g in groups])


def compare(
    records: Records,
    networks: Mapping[str, VisibilityNetwork],
    surface: NormalsSource,
    *,
    seed: int = 0,
    limit: int | None = None,
    light: str | None = None,
) -> tuple[dict[str, Tally], float]:
    """Score each network of `networks` {name: network} on records, and both sign(N·L) baselines.

    Each record is photographed once under a random lighting that `seed` determines, or in everyday light of
    the kind `light` (`lightings.KINDS`), and framed on the canvas of each network. The binary maps of all
    frontal lights are scored inside the mask. The baselines use the canvas of the first network. All networks
    take the normals of `surface`, see `normals_of`.

    Returns {name: Tally} and the mean angular error of the estimated normals in degrees.
    """
    tallies = {name: Tally() for name in (*networks, ESTIMATED, TRUE)}
    first, angles = next(iter(networks.values())), []
    for index in track(records.spread(limit or len(records)), "evaluating"):
        record, lighting = records[index], None
        if light is not None:
            rng = np.random.default_rng((seed, index, KINDS.index(light)))
            lighting = everyday_lighting(rng, record.directions, light)
        views: dict[int, tuple[ScoredView, torch.Tensor]] = {}  # of each size of canvas
        for name, network in networks.items():
            given: torch.Tensor | None
            if network.size in views:
                view, given = views[network.size]
            else:
                view = ScoredView.of(record, (seed, index), network.size, lighting)
                given = view.given(surface, network)
            estimated, binary = view.binary(network, given)
            views[network.size] = view, estimated
            tallies[name].add(binary, view)
        view, estimated = views[first.size]
        tallies[ESTIMATED].add(view.sign(estimated), view)
        tallies[TRUE].add(view.sign(view.normals), view)
        angles.append(float(metrics.angular_error(estimated, view.normals, view.mask > 0.5)))
    return tallies, float(np.mean(angles))


def photographed(
    records: Records,
    height: int,
    seed: int,
    limit: int | None,
    *,
    suited: Callable[[Record], bool] = lambda record: True,
    lights: int | None = None,
    lighting: Callable[[np.random.Generator, np.ndarray], np.ndarray] | None = None,
) -> Iterator[tuple[Record, Sample, torch.Tensor]]:
    """Photograph each of `limit` records once that is suited, on a canvas of `height` pixels.

    `lights` and `lighting`, which draws the weights, are those of `sample`. Yields the record, the truth, and
    the linear picture (3, h, w) that a camera took.
    """
    for index in track(records.spread(limit or len(records)), "evaluating"):
        record, rng = records[index], np.random.default_rng((seed, index))
        if suited(record):
            weights = None if lighting is None else lighting(rng, record.directions)
            drawn = sample(record, rng, canvas_size(height), lights, augment=False, lighting=weights)
            yield record, drawn, photograph(drawn["rgb"], drawn["mask"], rng)


def best_device() -> torch.device:
    """Return the device of photographs and networks that are scored: a GPU if there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def normals_of(network: VisibilityNetwork, model: str | Path | None = None) -> Any:
    """Return the network whose normals a visibility network is given.

    It is `model`, a name or path for `shadow.normals.load`, if that is given. Otherwise it is the network
    itself, or the shipped field if the network infers no normals. It is on the network's device.
    """
    if model is None and isinstance(network, VisibilityField):
        return network
    return normals.load(model or "field", device=next(network.parameters()).device)


def evaluate(
    paths: Iterable[str | Path],
    *,
    model: str | Path = "field",
    normals_model: str | Path | None = None,
    seed: int = 0,
    limit: int | None = None,
    light: str | None = None,
) -> tuple[dict[str, Score], float]:
    """Score visibility on records against sign(N·L) from estimated and from true normals, see `compare`.

    The paths are of record folders or shards. `model`, `normals_model`: names of shipped weights or
    .safetensors paths; see `normals_of`. `limit`: use this many records, spread evenly. Returns {"field":
    Score, "sign(N·L), estimated normals": Score, "sign(N·L), true normals": Score}, and the mean angular
    error of the normals in degrees.
    """
    if light not in (None, *KINDS):
        raise ValueError(f"light: expected one of {', '.join(KINDS)}, got {light!r}")
    network = visibility.load(model, best_device())
    surface = normals_of(network, normals_model)
    tallies, angle = compare(Records(paths), {"field": network}, surface, seed=seed, limit=limit, light=light)
    return {name: tally.score() for name, tally in tallies.items()}, angle


def report(scores: dict[str, Score], angle: float) -> str:
    """Format the scores as a Markdown table."""
    rows = []
    for name, score in scores.items():
        rmse, dice = ("{:.3f} ({:.3f})".format(*pair) for pair in (score.rmse, score.dice))
        rows.append([name, rmse, f"{score.psnr:.2f}", dice])
    scored = table(["visibility", "RMSE ↓", "PSNR ↑", "Dice ↑"], rows)
    return f"{scored}\n\nEstimated normals: mean angular error {angle:.1f} degrees."


def table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Format a table as Markdown."""
    header = list(header)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, ["---"] * len(header), *rows))


def intensity_sweep(
    records: Records,
    network: VisibilityNetwork,
    surface: NormalsSource,
    levels: np.ndarray,
    *,
    seed: int = 0,
    limit: int | None = None,
) -> list[tuple[Tally, Tally]]:
    """Return a Tally of the network and one of sign(N·L) for each intensity of the input (Figure 4).

    At level 1 the mean inside the mask is that of a normal exposure, 0.2 of white. A camera is simulated: 8
    bits, display-encoded, clipped at white. Normals are estimated from its picture at each level.
    """
    tallies = [(Tally(), Tally()) for _ in levels]
    for index in track(records.spread(limit or len(records)), "intensities"):
        view = ScoredView.of(records[index], (seed, index), network.size)
        exposed = view.scene * (EXPOSURE * view.mask.sum() * 3 / (view.scene * view.mask).sum())
        for level, (ours, baseline) in zip(levels, tallies, strict=True):
            encoded = (level * exposed).clamp(0, 1) ** (1 / ENCODING)
            seen = replace(view, rgb=((encoded * 255).round() / 255) ** ENCODING)
            estimated, binary = seen.binary(network, seen.given(surface, network))
            ours.add(binary, view)
            baseline.add(view.sign(estimated), view)
    return tallies


def against_soft_maps(
    records: Records,
    folder: str | Path,
    network: VisibilityNetwork,
    surface: NormalsSource,
    *,
    seed: int = 0,
    limit: int | None = None,
) -> dict[str, tuple[Tally, Tally]]:
    """Score soft visibility maps of another method, thresholded by Otsu's method, and ours (Table 5).

    Each file of `folder` is a map with the name <record>_<light>: the file name of the record, and the
    two-digit number of the light in its direction set (`shadow.directions.olat`), such as
    body-000007-02_13.png. It is a .npy array (H, W) of the record's size, or an image whose first channel is
    used. Larger values mean more light, on any scale.

    Returns {figure: (theirs, ours)}, Tallies of the frontal lights that have files. Raises ValueError if
    there are no files, or a file has another size.
    """
    soft_maps = _soft_maps(folder)
    tallies: dict[str, tuple[Tally, Tally]] = {}
    for index in track(records.spread(limit or len(records)), "soft maps"):
        file, member = records.entries[index]
        name = Path(member or file).stem
        record = records[index]
        bits, known = np.zeros_like(record.visibility), np.zeros(len(record.directions), bool)
        for light in soft_maps.get(name, {}):
            path = soft_maps[name][light]
            if light >= len(known):
                raise ValueError(f"soft: {path}: the record has {len(known)} lights, counted from 0")
            grey = _grey(path)
            if grey.shape != record.mask.shape:
                raise ValueError(f"soft: {path}: expected size {record.mask.shape}, got {grey.shape}")
            bits[:, light], known[light] = _binary(grey[record.mask]), True
        chosen = torch.from_numpy(known[record.directions[:, 2] > FRONTAL])
        if not chosen.any():
            continue
        # Their maps take the place of the record's visibility, so that they are resampled like the truth.
        packed = np.packbits(bits, axis=1)
        view = ScoredView.of(record, (seed, index), network.size)
        other = ScoredView.of(replace(record, visibility_bits=packed), (seed, index), network.size)
        theirs, ours = tallies.setdefault(record.about.get("figure", name), (Tally(), Tally()))
        theirs.add(other.visibility, view, chosen)
        ours.add(view.binary(network, view.given(surface, network))[1], view, chosen)
    if not tallies:
        raise ValueError(f"soft: expected maps of these records in {folder}, such as {name}_07.png")
    return tallies


def _soft_maps(folder: str | Path) -> dict[str, dict[int, Path]]:
    """List the files in a folder as {record: {light: path}}."""
    files: dict[str, dict[int, Path]] = {}
    for path in sorted(Path(folder).iterdir()):
        record, _, light = path.stem.rpartition("_")
        if record and light.isdigit():
            files.setdefault(record, {})[int(light)] = path
    return files


def _binary(grey: np.ndarray) -> np.ndarray:
    """Threshold a map by Otsu's method. A constant map is lit unless it is zero."""
    return grey > (0 if grey.min() == grey.max() else metrics.otsu(torch.from_numpy(grey)))


def _grey(path: Path) -> np.ndarray:
    """Read an array (H, W), float32, from a .npy file or the first channel of an image."""
    if path.suffix == ".npy":
        grey = np.load(path, allow_pickle=False).astype(np.float32)
        if grey.ndim != 2:
            raise ValueError(f"soft: {path}: expected an array (H, W), got shape {grey.shape}")
    else:
        image = oiio.ImageBuf(str(path))
        if image.has_error:
            raise ValueError(f"soft: {path} is not an image: {image.geterror()}")
        grey = np.ascontiguousarray(np.asarray(image.get_pixels("float"))[..., 0])
    if not np.isfinite(grey).all():
        raise ValueError(f"soft: {path} contains NaN or infinite values")
    return grey
