import numpy as np
import OpenImageIO as oiio
import pytest

import relight
from relight.pipeline.olat import olat_lights, write_olat
from shadow import directions

IMAGE = np.zeros((40, 30, 4), np.float32)
IMAGE[5:35, 5:25] = (0.4, 0.3, 0.2, 1)


def header(path):
    return oiio.ImageInput.open(str(path)).spec()


def test_olat_lights_are_the_olat_directions():
    for behind in (False, True):
        lights = olat_lights(behind)
        np.testing.assert_allclose([light.direction for light in lights], directions.olat(behind), atol=1e-6)
        assert len({light.name for light in lights}) == len(lights)


@pytest.mark.slow
def test_one_file_of_layers(tmp_path):
    steps = []
    outputs = [tmp_path / "o.exr", tmp_path / "o.nk"]
    paths = write_olat(IMAGE, outputs, progress=lambda *step: steps.append(step))
    assert [path.name for path in paths] == ["o.exr", "o.json", "o.nk"]
    assert steps[0] == (1, 64, "Lights")
    assert steps[63] == (64, 64, "Lights")
    beauty, layers = relight.read(tmp_path / "o.exr"), relight.read_layers(tmp_path / "o.exr")
    assert list(layers) == [f"C_olat_{number:02d}" for number in range(1, 65)]
    total = sum(layers.values())
    assert np.abs(total - beauty[..., :3]).max() <= 0.5 * np.spacing(np.float16(beauty.max()))
    lights = relight.read_lights(tmp_path / "o.json")
    expected = relight.Subject(IMAGE).relit(lights[10])[..., :3]
    np.testing.assert_allclose(layers["C_olat_11"], expected, atol=1e-3)
    spec = header(tmp_path / "o.exr")
    np.testing.assert_allclose(spec.getattribute("relight:olat_11"), directions.olat()[10], atol=1e-6)
    assert (tmp_path / "o.nk").read_text().count("\nMultiply {") == 64


@pytest.mark.slow
def test_a_sequence_has_one_frame_per_light_and_the_plates_alpha(tmp_path):
    paths = write_olat(IMAGE, tmp_path / "o.%04d.exr", behind=True)
    assert paths[:96] == [tmp_path / f"o.{number:04d}.exr" for number in range(1, 97)]
    assert paths[96] == tmp_path / "o.json"
    lights = relight.read_lights(tmp_path / "o.json")
    for number in (1, 64, 96):
        spec = header(paths[number - 1])
        np.testing.assert_allclose(
            spec.getattribute("relight:direction"), lights[number - 1].direction, atol=1e-5
        )
    picture = relight.read(paths[63])
    np.testing.assert_array_equal(picture[..., 3], IMAGE[..., 3])


@pytest.mark.parametrize(
    ("output", "message"),
    [("o.png", "expected a file name that ends in .exr"), ("none/o.exr", "the folder .*none does not exist")],
)
def test_olat_refuses_other_formats_and_missing_folders(tmp_path, output, message):
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        write_olat(IMAGE, tmp_path / output)
    assert list(tmp_path.iterdir()) == []
