import numpy as np
import OpenImageIO as oiio

from shadow.directions import olat
from shadow.evaluation import plots


def read(path):
    return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)


def test_a_light_from_the_upper_right_is_drawn_there(tmp_path):
    lights = olat()
    wanted = np.argmax(lights @ [0.6, 0.5, 0.62])
    plots.hemispheres(tmp_path / "h.png", lights, {"one": np.arange(64) == wanted}, side=200, margin=40)
    picture = read(tmp_path / "h.png")
    assert picture.shape == (320, 280, 3)
    disc = picture[40:240, 40:240]
    bright = (disc[..., 0] > 0.9) & (disc[..., 2] < 0.3)  # the upper end of viridis is yellow
    y, x = np.argwhere(bright).mean(axis=0)
    np.testing.assert_allclose([x, y], [100 + 100 * lights[wanted, 0], 100 - 100 * lights[wanted, 1]], atol=6)


def test_curves_lie_where_their_values_are(tmp_path):
    x = np.array([0.01, 0.1, 1])
    series = {"up": (np.array([0.6, 0.7, 0.9]), np.full(3, 0.02)), "low": (np.full(3, 0.55), np.zeros(3))}
    plots.curves(tmp_path / "c.png", x, series, "x", "y")
    picture = read(tmp_path / "c.png")
    rows = {}
    for name, colour in zip(series, plots.COLOURS, strict=True):
        close = abs(picture - colour).max(axis=-1) < 0.1
        rows[name] = [np.median(np.nonzero(close[:330, column])[0]) for column in (100, 600)]
    assert rows["up"][1] < rows["up"][0] - 100
    assert abs(rows["low"][1] - rows["low"][0]) < 2
    assert rows["low"][0] > rows["up"][0]
