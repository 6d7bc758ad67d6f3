"""The two figures of the tables' report, drawn with OpenImageIO, which runs wherever the library does."""

import numpy as np
import OpenImageIO as oiio
import torch

from shadow.evaluation.pictures import DISPLAY, write_grid

INK, PAPER, GRID = 0.15, 1.0, 0.88
COLOURS = ((0.12, 0.35, 0.75), (0.85, 0.37, 0.05))  # of curves
FINE = 3  # samples a pixel and axis, for smooth edges


def _colour(values):
    """Values (...) in [0, 1] as display colours (..., 3) of the map viridis."""
    grey = np.ascontiguousarray(values, np.float32).reshape(1, -1, 1)
    mapped = oiio.ImageBufAlgo.color_map(oiio.ImageBuf(grey), 0, "viridis")
    return mapped.get_pixels(oiio.FLOAT).reshape(*np.shape(values), 3) ** DISPLAY


def heat(values):
    """Values (H, W) in [0, 1] as a picture (3, H, W)."""
    return torch.from_numpy(_colour(values.clamp(0, 1).numpy())).permute(2, 0, 1).float()


def _reduced(fine):
    """(FINE h, FINE w, 3) averaged to (h, w, 3)."""
    height, width, _ = fine.shape
    return fine.reshape(height // FINE, FINE, width // FINE, FINE, 3).mean(axis=(1, 3))


def _written(path, picture, texts):
    """Write (h, w, 3) as a PNG, with texts (x, y, text, alignment, colour) on it."""
    canvas = oiio.ImageBuf(np.ascontiguousarray(picture, np.float32))
    for x, y, text, align, colour in texts:
        oiio.ImageBufAlgo.render_text(
            canvas, int(x), int(y), text, 15, "", np.broadcast_to(colour, 3).tolist(), align, "center"
        )
    write_grid(path, [[torch.from_numpy(canvas.get_pixels(oiio.FLOAT)).permute(2, 0, 1)]])


def hemispheres(path, directions, panels, side=300, margin=40):
    """Draw values over the frontal hemisphere, seen from the camera (x right, y up), as Figure 2 does.

    directions: (D, 3) unit vectors. panels: {title: (D,)}, side by side, each with its own scale below. Every
    point of a disc has the colour of the nearest direction.
    """
    step = (np.arange(side * FINE) + 0.5) * 2 / (side * FINE) - 1
    x, y = np.meshgrid(step, -step)
    inside = x**2 + y**2 <= 1
    z = np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))
    nearest = (np.stack([x, y, z], axis=-1) @ np.transpose(directions)).argmax(axis=-1)
    columns, texts = [], []
    for number, (title, values) in enumerate(panels.items()):
        low, high = float(np.min(values)), float(np.max(values))
        disc = _colour((np.asarray(values) - low) / max(high - low, 1e-9))[nearest]
        panel = np.full((side + 3 * margin, side + 2 * margin, 3), PAPER)
        panel[margin : -2 * margin, margin:-margin] = _reduced(np.where(inside[..., None], disc, PAPER))
        panel[-margin - 12 : -margin, margin:-margin] = _colour(np.linspace(0, 1, side))
        left = number * panel.shape[1] + margin
        below = len(panel) - margin + 14
        texts.append((left + side / 2, margin / 2, title, "center", INK))
        texts += [(left, below, f"{low:.3f}", "left", INK), (left + side, below, f"{high:.3f}", "right", INK)]
        columns.append(panel)
    _written(path, np.concatenate(columns, axis=1), texts)


def curves(path, x, series, x_label, y_label, size=(400, 650)):
    """Draw {name: (mean, standard deviation)} of values in [0, 1], each (N,), over ascending x (N,) on a
    logarithmic axis: lines in bands of one deviation either side, as Figure 4 does."""
    height, width = size
    left, right, top, bottom = 60, width - 30, 40, height - 60
    x = np.log10(x)
    low = np.floor(min(np.min(mean - deviation) for mean, deviation in series.values()) * 10) / 10
    low = float(np.clip(low, 0, 0.9))

    def across(value):
        return left + (value - x[0]) / (x[-1] - x[0]) * (right - left)

    def down(value):
        return bottom - (value - low) / (1 - low) * (bottom - top)

    fine = np.full((height * FINE, width * FINE, 3), PAPER)
    column = (np.arange(width * FINE) + 0.5) / FINE
    row = ((np.arange(height * FINE) + 0.5) / FINE)[:, None]
    plot = (column >= left) & (column <= right) & (row >= top) & (row <= bottom)
    ticks = np.arange(np.ceil(x[0]), x[-1] + 1e-6), np.arange(round(low * 10), 11) / 10
    for tick in ticks[0]:
        fine[plot & (abs(column - across(tick)) < 0.5)] = GRID
    for tick in ticks[1]:
        fine[plot & (abs(row - down(tick)) < 0.5)] = GRID
    where = x[0] + (column - left) / (right - left) * (x[-1] - x[0])
    texts = [(across(tick), bottom + 16, f"{10**tick:g}", "center", INK) for tick in ticks[0]]
    texts += [(left - 8, down(tick), f"{tick:.1f}", "right", INK) for tick in ticks[1]]
    texts += [
        ((left + right) / 2, bottom + 42, x_label, "center", INK),
        (left - 8, top - 24, y_label, "right", INK),
    ]
    drawn = list(zip(series.items(), COLOURS, strict=False))
    for (_, (mean, deviation)), colour in drawn:
        middle, spread = np.interp(where, x, mean), np.interp(where, x, deviation)
        band = plot & (row > down(middle + spread)) & (row < down(middle - spread))
        fine[band] = 0.82 * fine[band] + 0.18 * np.array(colour)
    for number, ((name, (mean, _)), colour) in enumerate(drawn):
        curve = down(np.interp(where, x, mean))
        slope = np.gradient(curve, column)
        fine[plot & (abs(row - curve) < 1.2 * np.sqrt(1 + slope**2))] = colour
        texts.append((right - 10, bottom - 16 - 22 * number, name, "right", colour))
    _written(path, _reduced(fine), texts)
