from importlib.metadata import PackageNotFoundError, version

import numpy as np
import OpenImageIO as oiio
import pytest
import torch

try:
    version(
        "matplotlib"
    )  # colour-science puts a stand-in in its place, which `pytest.importorskip` would find
except PackageNotFoundError:
    pytest.skip("needs Matplotlib (extra train)", allow_module_level=True)

from shadow.directions import olat
from shadow.evaluation import plots


def read(path):
    return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)[..., :3]


def test_a_light_from_the_upper_right_is_drawn_there(tmp_path):
    lights = olat()
    wanted = np.argmax(lights @ [0.6, 0.5, 0.62])
    plots.hemispheres(tmp_path / "h.png", lights, {"one": np.arange(64) == wanted})
    picture = read(tmp_path / "h.png")[:340]  # without the colour bar below
    purple = (abs(picture - [0.267, 0.005, 0.329]).max(axis=-1) < 0.05).nonzero()  # viridis' lower end
    yellow = ((picture[..., 0] > 0.9) & (picture[..., 1] > 0.8) & (picture[..., 2] < 0.3)).nonzero()
    top, bottom = purple[0].min(), purple[0].max()
    left, right = purple[1].min(), purple[1].max()
    x = (yellow[1].mean() - left) / (right - left) * 2 - 1
    y = 1 - (yellow[0].mean() - top) / (bottom - top) * 2
    np.testing.assert_allclose([x, y], lights[wanted, :2], atol=0.05)


def test_curves_hold_their_values():
    x = np.array([0.01, 0.1, 1])
    series = {"up": (np.array([0.6, 0.7, 0.9]), np.full(3, 0.02)), "low": (np.full(3, 0.55), np.zeros(3))}
    (axes,) = plots.figure_of_curves(x, series, "intensity", "Dice").axes
    assert (axes.get_xscale(), axes.get_xlabel(), axes.get_ylabel()) == ("log", "intensity", "Dice")
    for line, (name, (mean, _)) in zip(axes.lines, series.items(), strict=True):
        assert line.get_label() == name
        np.testing.assert_array_equal(line.get_xydata(), np.stack([x, mean], axis=1))
    band = axes.collections[0].get_paths()[0].vertices
    assert (band[:, 1].min(), band[:, 1].max()) == (pytest.approx(0.58), pytest.approx(0.92))


def test_heat_is_bright_where_values_are_high():
    picture = plots.heat(torch.tensor([[0.0, 0.5, 1.0, 2.0]]))
    brightness = picture.mean(dim=0)[0]
    assert picture.shape == (3, 1, 4)
    assert brightness[0] < brightness[1] < brightness[2] == brightness[3]


def test_without_matplotlib_the_extra_is_named(missing, tmp_path):
    missing("matplotlib")
    with pytest.raises(ImportError, match=r"install it with: python -m pip install '.*\[train\]'"):
        plots.curves(tmp_path / "c.png", np.ones(2), {}, "x", "y")
    assert not list(tmp_path.iterdir())
