import numpy as np
import OpenImageIO as oiio
import pytest
import torch

from shadow.data import records
from shadow.evaluation import pictures


def test_a_grid_is_what_was_given(tmp_path):
    red, blue = torch.zeros(3, 4, 5), torch.zeros(3, 4, 5)
    red[0], blue[2] = 1, 1
    pictures.write_grid(tmp_path / "grid.png", [[red, blue], [blue, red]])
    pixels = oiio.ImageBuf(str(tmp_path / "grid.png")).get_pixels("uint8")
    assert pixels.shape == (8, 10, 3)
    np.testing.assert_array_equal(pixels[1, [1, 6]], [[255, 0, 0], [0, 0, 255]])
    np.testing.assert_array_equal(pixels[6, [1, 6]], [[0, 0, 255], [255, 0, 0]])
    assert [path.name for path in tmp_path.iterdir()] == ["grid.png"]


def test_contact_sheet_of_records(ball, tmp_path):
    for number in range(3):
        records.write(tmp_path / f"{number}.npz", ball)
    pictures.contact_sheet([tmp_path], tmp_path / "sheet.png", count=2)
    pixels = oiio.ImageBuf(str(tmp_path / "sheet.png")).get_pixels("uint8")
    assert pixels.shape == (2 * 256, 7 * 192, 3)
    assert pixels.max() > 200


def test_an_unwritable_path_is_named(tmp_path):
    with pytest.raises(OSError, match="cannot write"):
        pictures.write_grid(tmp_path / "absent" / "grid.png", [[torch.zeros(3, 4, 4)]])
