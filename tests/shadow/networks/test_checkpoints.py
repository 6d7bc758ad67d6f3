import json
import zipfile

import pytest
import torch
from safetensors.torch import save_file

from shading import diffuse
from shadow import normals, visibility
from shadow.networks import checkpoints
from shadow.networks.field import VisibilityField

SMALL = {"size": 128, "widths": (8, 8), "encoder": (1, 1), "decoder": (1,)}


@pytest.fixture
def saved(tmp_path):
    torch.manual_seed(0)
    network = VisibilityField(**SMALL)
    path = tmp_path / "small.safetensors"
    return network, path, checkpoints.save(path, network, "field", SMALL, {"steps": 3})


def test_round_trip_to_half_precision(saved):
    network, path, _ = saved
    back = visibility.load(path)
    assert back.size == 128
    for key, value in network.state_dict().items():
        torch.testing.assert_close(back.state_dict()[key], value.half().float(), rtol=0, atol=0)
    assert list(path.parent.iterdir()) == [path]


def test_a_file_that_is_written_again_is_read_again(saved):
    _, path, _ = saved
    first = visibility.load(path)
    assert visibility.load(path) is first
    torch.manual_seed(1)
    checkpoints.save(path, VisibilityField(**SMALL), "field", SMALL, {"steps": 4})
    second = visibility.load(path)
    assert second.origin.sha256 == checkpoints.sha256(path) != first.origin.sha256
    assert second.origin.recipe == {"steps": 4}


def test_shrunk_weights_are_half_as_large_and_nearly_the_same(saved, tmp_path):
    network, path, _ = saved
    small = tmp_path / "shrunk.safetensors"
    checksum = checkpoints.shrink(path, small)
    assert checkpoints.sha256(small) == checksum
    back = visibility.load(small)
    assert back.origin.sha256 == visibility.load(path).origin.sha256  # still the same weights
    assert json.loads(checkpoints.read(small)[1]["recipe"]) == {"steps": 3}
    for key, value in network.state_dict().items():
        step = value.abs().amax(dim=(1, 2, 3), keepdim=True) / 127 if value.ndim == 4 else torch.tensor(1e-3)
        assert ((back.state_dict()[key] - value).abs() <= 0.51 * step + 1e-3).all(), key
    wide = VisibilityField(size=128)
    checkpoints.save(path, wide, "field", {"size": 128}, {})
    checkpoints.shrink(path, small)
    assert small.stat().st_size < 0.55 * path.stat().st_size


def test_recipe_travels_with_the_weights(saved):
    _, metadata = checkpoints.read(saved[1])
    assert json.loads(metadata["recipe"]) == {"steps": 3}


def test_damage_is_found(saved):
    _, path, checksum = saved
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ValueError, match="damaged"):
        checkpoints.read(path, checksum)
    with pytest.raises(ValueError, match="not a safetensors file, or is truncated"):
        visibility.load(path)


@pytest.mark.parametrize("size", [0, -128, 100, 2**40, 128.5])
def test_a_canvas_that_cannot_be_is_refused(saved, size):
    _, path, _ = saved
    state, metadata = checkpoints.read(path)
    config = json.dumps({**json.loads(metadata["config"]), "size": size})
    save_file(state, path, metadata | {"config": config})
    with pytest.raises(ValueError, match=f"{path.name} does not fit this version's network: size: expected"):
        visibility.load(path)


@pytest.mark.parametrize("odd", [float("nan"), float("inf")])
def test_weights_that_are_not_finite_are_refused(saved, odd):
    network, path, _ = saved
    with torch.no_grad():
        network.backbone.head.bias[0] = odd
    checkpoints.save(path, network, "field", SMALL, {})
    with pytest.raises(
        ValueError, match=r"small.safetensors is damaged: backbone.head.bias holds NaN or inf"
    ):
        visibility.load(path)


def test_another_network_is_refused(saved):
    with pytest.raises(ValueError, match="holds a 'field' network, expected shading"):
        diffuse.load(saved[1])


def test_weights_of_another_shape_are_refused(saved):
    network, path, _ = saved
    checkpoints.save(path.with_name("wide.safetensors"), network, "field", {**SMALL, "widths": (8, 16)}, {})
    with pytest.raises(ValueError, match="does not fit"):
        visibility.load(path.with_name("wide.safetensors"))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError):
        visibility.load(tmp_path / "absent.safetensors")


@pytest.mark.parametrize("package", ["shadow", "shading"])
def test_shipped_weights_are_what_the_index_says(package):
    from importlib import resources

    folder = resources.files(package) / "weights"
    for name, entry in json.loads((folder / "index.json").read_text()).items():
        _, metadata = checkpoints.read(folder / entry["file"], entry["sha256"])
        assert metadata["network"] == name
        assert json.loads(metadata["recipe"])["images"] > 0


@pytest.mark.parametrize(
    ("tensors", "metadata", "message"),
    [
        (["a"], {"network": "field"}, "lacks the constructor arguments"),
        (
            ["a"],
            {"network": "field", "config": "{"},
            "does not fit this version's network: Expecting property",
        ),
        (["a"], {"network": "field", "config": "[1, 2]"}, "does not fit this version's network: .* mapping"),
        (
            ["a"],
            {"network": "field", "config": '{"foo": 1}'},
            "does not fit .* unexpected keyword argument 'foo'",
        ),
        (["a"], {"network": "field", "config": "{}"}, "does not fit this version's network: Error"),
        (["a.scale"], {"network": "field", "config": "{}"}, "is damaged: a scale has no tensor of its size"),
    ],
)
def test_odd_files_are_refused_in_one_line(tmp_path, tensors, metadata, message):
    path = tmp_path / "odd.safetensors"
    save_file({name: torch.zeros(2) for name in tensors}, path, metadata)
    for load in (visibility.load, normals.load):
        with pytest.raises(ValueError, match=f"^weights: {path} {message}.*$") as caught:
            load(path)
        assert len(str(caught.value)) < 600


def test_a_package_in_an_archive_is_told_to_be_installed(tmp_path, monkeypatch):
    archive = tmp_path / "wheel.zip"
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("zipped/__init__.py", "")
        file.writestr("zipped/weights/index.json", "{}")
    monkeypatch.syspath_prepend(archive)
    with pytest.raises(FileNotFoundError, match="within an archive; install the package"):
        checkpoints.load("field", {}, package="zipped")
