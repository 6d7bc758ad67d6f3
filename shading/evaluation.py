"""Score shading against path tracing (Table 6, Figure 6), and measure shadows that remain in the albedo."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch

from shading import diffuse
from shading.tasks import true_shading
from shadow import normals, visibility
from shadow.data.photographs import Sample
from shadow.data.records import Records
from shadow.evaluation import metrics, pictures, plots
from shadow.evaluation.scores import FRONTAL, photographed, table
from shadow.networks.backbone import ENCODING

BASE = "base image"
BINARY = "base image, binary visibility"  # as in the paper, whose maps are binary
ROWS = {  # of Table 6: the inputs (normals, visibility) of each network, and the paper's RMSE and SSIM
    "baseline visibility": ((True, "baseline"), "0.153 (0.024)", "0.702 (0.062)"),
    "w/o both": ((False, None), "0.140 (0.025)", "0.746 (0.057)"),
    "w/o visibility": ((True, None), "0.139 (0.023)", "0.734 (0.058)"),
    "w/o normals": ((False, "inferred"), "0.137 (0.023)", "0.749 (0.056)"),
    "ours": ((True, "inferred"), "0.135 (0.024)", "0.751 (0.056)"),
}
KEY_SHARE = 0.3  # the shadow of the strongest lamp is evaluated if the lamp has this share of the light
FIGURE_VIEWS = 6  # rows of Figure 6
ERROR_WHITE = 0.5  # absolute error that the heatmaps show as brightest


@dataclass(frozen=True)
class Tally:
    """RMSE and SSIM of maps, collected. A map is that of one light and one record."""

    rmse: list[float] = field(default_factory=list)
    ssim: list[float] = field(default_factory=list)

    def add(self, estimate: torch.Tensor, truth: torch.Tensor, inside: torch.Tensor) -> None:
        """Score maps (D, H, W) of one record; inside: (H, W) bool."""
        self.rmse.extend(metrics.rmse(estimate, truth, inside).tolist())
        self.ssim.extend(metrics.ssim(estimate, truth, inside).tolist())


@dataclass(frozen=True)
class Delight:
    """Scores of an albedo estimate, one for each photograph with a hard shadow."""

    lit: list[float] = field(default_factory=list)  # L1 of the encoded albedo in the key light
    shadow: list[float] = field(default_factory=list)  # the same in the shadow of the key light
    left: list[float] = field(default_factory=list)  # stops by which the albedo is too dark in that shadow

    def add(
        self, encoded: torch.Tensor, truth: torch.Tensor, lit: torch.Tensor, shadow: torch.Tensor
    ) -> None:
        """Score encoded albedo (3, H, W), estimated against true; lit, shadow: (H, W) bool."""
        scale = (truth * lit).sum((-2, -1)) / (encoded * lit).sum((-2, -1)).clamp_min(1e-3)
        encoded = encoded * scale[:, None, None]  # since exposure and white balance are ambiguous
        error = (encoded - truth).abs().mean(dim=0)
        stops = ENCODING * torch.log2(encoded.clamp_min(0.02) / truth.clamp_min(0.02)).mean(dim=0)
        self.lit.append(float(error[lit].mean()))
        self.shadow.append(float(error[shadow].mean()))
        self.left.append(float(stops[lit].mean() - stops[shadow].mean()))


@torch.no_grad()
def evaluate(
    paths: Iterable[str | Path],
    *,
    models: Mapping[str, str | Path] | None = None,
    out: str | Path | None = None,
    normals_model: str | Path | None = None,
    field_model: str | Path = "field",
    seed: int = 0,
    limit: int | None = None,
) -> tuple[dict[str, Tally], dict[str, Delight]]:
    """Score shading networks on records with bounce light, as Table 6 does, and the albedo of "ours".

    Each record, of those that `relight stage --shading` made, is photographed once under a random lighting
    that `seed` determines, and framed on the canvas. Its frontal lights are scored by RMSE inside the mask
    and SSIM in the mask's bounding box (Section 4.4).

    `models`: {row of Table 6: name or .safetensors path}; "ours" is the shipped one unless given. `out`: path
    of a PNG for Figure 6, or None. `field_model`: the visibility field whose maps all rows take;
    `normals_model`: the network whose normals they take, by default that field. `limit`: use this many
    records, spread evenly.

    Returns {row: Tally}, including the base image of "ours", and {"photograph" or "albedo": Delight}. Raises
    FileNotFoundError or ValueError if there are no records, records lack bounce light, weights are damaged,
    or a network does not match its row.
    """
    networks = {name: diffuse.load(path) for name, path in {"ours": "shading", **(models or {})}.items()}
    for name, network in networks.items():
        inputs = getattr(network, "normals", True), getattr(network, "visibility", "inferred")
        if name in ROWS and inputs != ROWS[name][0]:
            raise ValueError(f"model: the network given for the row {name!r} was not trained with its inputs")
    field = visibility.load(field_model)
    elsewhere = None if normals_model is None else normals.load(normals_model)
    records = Records(paths)
    tallies = {name: Tally() for name in (BASE, BINARY, *networks)}
    delights = {"photograph": Delight(), "albedo": Delight()}
    step, rows = max(1, len(records.spread(limit or len(records))) // FIGURE_VIEWS), []
    for number, (record, view, rgb) in enumerate(photographed(records, networks["ours"].size, seed, limit)):
        if record.bounce_float16 is None:
            raise ValueError("records: have no bounce light; render them with `relight stage --shading`")
        mask, frontal = view["mask"][0], view["directions"][:, 2] > FRONTAL
        inside = mask > 0.5
        truth = true_shading({key: value[None] for key, value in view.items()})[0]
        lights, truth = view["directions"][frontal], truth[frontal] * inside
        given = None if elsewhere is None else elsewhere.normals(rgb, mask)
        estimated, visible = field.analyse(rgb, mask, given)
        soft = visible(lights)
        maps = {
            name: diffuse.base(estimated[None], seen[None], lights[None])[0] * inside
            for name, seen in ((BASE, soft), (BINARY, (soft > 0.5).float()))
        }
        for name, network in networks.items():
            analysed = network.analyse(rgb, mask, estimated, visible)
            maps[name] = analysed.shading(lights) * inside
            if name == "ours":
                _score_albedo(delights, analysed.albedo, view, rgb, inside)
        for name, shading in maps.items():
            tallies[name].add(shading, truth, inside)
        if out is not None and number % step == 0:
            rows.append(_figure_row(rgb * inside, truth, maps, (7 * number + 20) % len(lights)))
    if out is not None:
        pictures.write_grid(out, rows)
    return tallies, delights


def _score_albedo(
    delights: dict[str, Delight],
    albedo: torch.Tensor | None,
    view: Sample,
    rgb: torch.Tensor,
    inside: torch.Tensor,
) -> None:
    """Score the albedo, and the photograph as a baseline, if one lamp of the lighting is strong enough.

    Appends to `delights`, {"photograph" or "albedo": Delight}.
    """
    power = view["weights"].sum(dim=1)
    key = int(power.argmax())
    facing = torch.einsum("c,chw->hw", view["directions"][key], view["normals"]) > 0.1
    lit = inside & facing & (view["visibility"][key] > 0.9)
    shadow = inside & facing & (view["visibility"][key] < 0.1)  # cast shadow only, which has a hard edge
    if albedo is None or power[key] < KEY_SHARE * power.sum() or min(lit.sum(), shadow.sum()) < 100:
        return
    truth = view["albedo"] ** (1 / ENCODING)
    for name, image in (("photograph", rgb), ("albedo", albedo)):
        delights[name].add(image.clamp_min(0) ** (1 / ENCODING), truth, lit, shadow)


def _figure_row(
    photo: torch.Tensor, truth: torch.Tensor, maps: dict[str, torch.Tensor], light: int
) -> list[torch.Tensor]:
    """Make one row of Figure 6: photograph, truth, and each estimate with its absolute error."""
    columns = [pictures.show_linear(photo), pictures.show_linear(truth[light][None])]
    for shading in maps.values():
        error = (shading[light] - truth[light]).abs() / ERROR_WHITE
        columns += [pictures.show_linear(shading[light][None]), plots.heat(error)]
    return columns


def report(tallies: dict[str, Tally], delights: dict[str, Delight]) -> str:
    """Format the scores as Markdown tables beside those of the paper."""
    rows = []
    for name in dict.fromkeys((BASE, BINARY, *ROWS, *tallies)):
        own = ["not given", "–"]
        if name in tallies:
            own = [f"{np.mean(v):.3f} ({np.std(v):.3f})" for v in (tallies[name].rmse, tallies[name].ssim)]
        paper = ROWS[name][1:] if name in ROWS else ("–", "–")
        rows.append([name, *own, *paper])
    albedo = []
    for name, delight in delights.items():
        columns = delight.lit, delight.shadow, delight.left
        albedo.append([name, *(f"{np.mean(values):.3f}" if values else "–" for values in columns)])
    return (
        table(["variant", "RMSE ↓", "SSIM ↑", "paper: RMSE", "paper: SSIM"], rows)
        + "\n\n"
        + table(["albedo from", "L1, lit ↓", "L1, in shadow ↓", "shadow left, stops ↓"], albedo)
        + f"\n\nAlbedo: {len(delights['albedo'].lit)} photographs with a hard cast shadow."
    )
