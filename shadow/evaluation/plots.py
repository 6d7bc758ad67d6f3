"""The figures of the report, drawn with matplotlib (extra `train`)."""

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import torch

from shadow.files import replacing
from shadow.installing import install_command

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def heat(values: torch.Tensor) -> torch.Tensor:
    """Show values (H, W) in [0, 1] as a picture (3, H, W) in the colours of viridis."""
    colours = _matplotlib().colormaps["viridis"](values.clamp(0, 1).numpy())
    return torch.from_numpy(colours[..., :3]).permute(2, 0, 1).float()


def hemispheres(path: Path, directions: np.ndarray, panels: Mapping[str, np.ndarray]) -> None:
    """Draw values over the frontal hemisphere, seen from the camera (x right, y up), as in Figure 2.

    directions: (D, 3) unit vectors. panels: {title: (D,)}, side by side, each with its own scale. Each point
    of a disc has the colour of the nearest direction.
    """
    step = (np.arange(600) + 0.5) / 300 - 1
    x, y = np.meshgrid(step, step)
    inside = x**2 + y**2 <= 1
    z = np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))
    nearest = (np.stack([x, y, z], axis=-1) @ np.transpose(directions)).argmax(axis=-1)
    figure = _figure(4 * len(panels), 4)
    for number, (title, values) in enumerate(panels.items(), 1):
        axes = figure.add_subplot(1, len(panels), number)
        disc = np.where(inside, np.asarray(values, float)[nearest], np.nan)
        shown = axes.imshow(disc, origin="lower", extent=(-1, 1, -1, 1))
        axes.set_title(title)
        axes.set_axis_off()
        figure.colorbar(shown, ax=axes, orientation="horizontal", fraction=0.05, pad=0.02, format="%.3f")
    _write(path, figure)


def curves(
    path: Path, x: np.ndarray, series: Mapping[str, tuple[np.ndarray, np.ndarray]], x_label: str, y_label: str
) -> None:
    """Draw a figure of curves, see `figure_of_curves`, as a PNG."""
    _write(path, figure_of_curves(x, series, x_label, y_label))


def figure_of_curves(
    x: np.ndarray, series: Mapping[str, tuple[np.ndarray, np.ndarray]], x_label: str, y_label: str
) -> "Figure":
    """Draw {name: (mean, standard deviation)}, each (N,), over ascending x (N,) on a logarithmic axis.

    As in Figure 4, each line has a band of one standard deviation on either side.
    """
    figure = _figure(6.5, 4)
    axes = figure.add_subplot()
    for name, (mean, deviation) in series.items():
        (line,) = axes.plot(x, mean, label=name)
        axes.fill_between(
            x, mean - deviation, mean + deviation, color=line.get_color(), alpha=0.2, linewidth=0
        )
    axes.set(xscale="log", xlabel=x_label, ylabel=y_label, xlim=(x[0], x[-1]))
    axes.grid(alpha=0.4)
    axes.legend()
    return figure


def _matplotlib() -> ModuleType:
    try:
        import matplotlib
    except ImportError as error:
        raise ImportError(f"plots: need matplotlib; install it with: {install_command('train')}") from error
    return matplotlib


def _figure(width: float, height: float) -> "Figure":
    """Return a new figure of a size in inches that needs no display."""
    _matplotlib()
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _write(path: Path, figure: "Figure") -> None:
    with replacing(path) as beside:
        figure.savefig(beside, format="png", dpi=100)
