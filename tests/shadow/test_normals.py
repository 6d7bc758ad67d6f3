import warnings

import numpy as np
import pytest
import torch

import relight
import shading
import shadow
from shadow import normals, visibility
from shadow.directions import olat
from shadow.networks import checkpoints
from shadow.networks.field import VisibilityField
from shadow.networks.unet import PerLight

SMALL = {"size": 128, "widths": (8, 8, 8, 8, 8), "encoder": (1, 1, 1, 1, 1), "decoder": (1, 1, 1, 1)}


def save(path, recipe=None, seed=0):
    """A small field with random parameters; its sha256."""
    torch.manual_seed(seed)
    network = VisibilityField(**SMALL)
    torch.nn.init.normal_(network.backbone.head.weight, std=0.1)
    return checkpoints.save(path, network, "field", SMALL, recipe or {})


def leaning(rgb, mask):
    """A function of the image that says: all leans to image right."""
    assert isinstance(rgb, np.ndarray)
    assert rgb.shape == (*mask.shape, 3)
    return np.broadcast_to(np.float32([0.6, 0, 0.8]), rgb.shape)


# One interface


@pytest.mark.parametrize(
    ("source", "axes"),
    [
        (leaning, "+x+y+z"),
        (lambda rgb, mask: 3 * leaning(rgb, mask) * (1, 1, -1), "+x+y-z"),
        (lambda rgb, mask: torch.from_numpy(leaning(rgb, mask)[..., ::-1].copy()), "+z-y+x"),
        (np.broadcast_to((0.6, 0, 0.8), (200, 160, 3)), "+x+y+z"),
    ],
)
def test_functions_and_arrays_in_any_convention(person, source, axes):
    rgb, mask = person
    found = shadow.infer_normals(rgb, mask, model=normals.load(source, axes=axes))
    np.testing.assert_allclose(found, mask[..., None] * (0.6, 0, 0.8), atol=1e-6)
    as_torch = shadow.infer_normals(*map(torch.from_numpy, person), model=normals.load(source, axes=axes))
    np.testing.assert_allclose(as_torch, found, atol=1e-6)


@pytest.mark.filterwarnings("ignore:the network")
def test_whatever_takes_normals_takes_every_source(person, tmp_path):
    rgb, mask = person
    lights, field, mine = olat()[-3:], tmp_path / "field.safetensors", tmp_path / "mine.safetensors"
    save(field)
    save(mine, seed=1)
    array = shadow.infer_normals(rgb, mask, model=leaning)
    expected = shadow.infer(rgb, mask, lights, model=field, normals=array)
    for source in (leaning, normals.load(leaning), normals.load(array)):
        found = shadow.infer(rgb, mask, lights, model=field, normals=source)
        np.testing.assert_allclose(found, expected, atol=1e-5)
    by_path, loaded = (
        shadow.infer(rgb, mask, lights, model=field, normals=source) for source in (mine, normals.load(mine))
    )
    np.testing.assert_array_equal(by_path, loaded)
    by_path_of_its_own, by_default = (
        shadow.infer(rgb, mask, lights, model=field, normals=source) for source in (field, None)
    )
    np.testing.assert_array_equal(by_path_of_its_own, by_default)
    assert abs(by_path - expected).max() > 0.1
    albedo = shading.infer_albedo(rgb, mask, normals=array)
    np.testing.assert_allclose(shading.infer_albedo(rgb, mask, normals=leaning), albedo, atol=1e-5)


def test_a_function_sees_the_photograph_of_a_premultiplied_plate():
    """Colour as photographed, not darkened by its alpha; the whole plate, not a crop of it."""
    image = np.zeros((80, 60, 4), np.float32)
    image[20:60, 15:45] = (0.2, 0.1, 0.05, 0.5)
    image[25:55, 20:40] = (0.4, 0.2, 0.1, 1)
    seen = {}

    def look(rgb, mask):
        seen.update(rgb=rgb, mask=mask)
        return leaning(rgb, mask)

    with pytest.warns(UserWarning, match="those of 'look'"):
        subject = relight.Subject(image, normals=look)
    assert seen["rgb"].shape == (80, 60, 3)
    np.testing.assert_array_equal(seen["mask"], image[..., 3])
    np.testing.assert_allclose(seen["rgb"][image[..., 3] > 0], np.tile((0.4, 0.2, 0.1), (1200, 1)), rtol=1e-5)
    inside = image[..., 3] > 0
    np.testing.assert_allclose(subject.normals[inside], np.tile((0.6, 0, 0.8), (1200, 1)), atol=1e-3)


@pytest.mark.parametrize(
    ("source", "axes", "message"),
    [
        ("field", "+x-y-z", "axes: those of field are known"),
        (VisibilityField(**SMALL), "+x-y-z", "axes: those of VisibilityField are known"),
        ("normals.png", "+x+y+z", "relight.read_normals reads images"),
        ("unheard-of", "+x+y+z", "unknown weights 'unheard-of'"),
        (leaning, "xyz", "axes: expected each of x, y and z once"),
    ],
)
def test_bad_sources_are_named(source, axes, message):
    with pytest.raises(ValueError, match=message):
        normals.load(source, axes=axes)


def test_a_network_that_says_no_normals_is_refused(tmp_path):
    config = {"latent": "resb3", "widths": [8, 8, 16, 16, 32]}
    checkpoints.save(tmp_path / "maps.safetensors", PerLight(**config), "resb3", config, {})
    with pytest.raises(ValueError, match="holds a 'resb3' network, expected field"):
        normals.load(tmp_path / "maps.safetensors")


@pytest.mark.parametrize(
    ("answer", "error", "message"),
    [
        (lambda rgb, mask: rgb[1:], ValueError, "normals: expected shape"),
        (lambda rgb, mask: rgb * np.nan, ValueError, "normals: contains NaN"),
        (lambda rgb, mask: (rgb * 255).astype(np.uint8), TypeError, "normals: expected a float array"),
        (lambda rgb, mask: rgb * (1, 1, -1), ValueError, "normals: point away from the camera"),
    ],
)
def test_bad_answers_are_named(person, answer, error, message):
    with pytest.raises(error, match=message):
        shadow.infer_normals(*person, model=answer)


# Networks keep to the normals that they were trained with


def silent(function):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return function()


def test_shipped_networks_fit_each_other(person):
    rgb, mask = person
    silent(lambda: shading.infer(rgb, mask, olat()[:1]))
    silent(lambda: relight.Subject(rgb, mask))


def test_normals_that_were_inferred_before_are_no_foreigners(person):
    rgb, mask = person
    found = shadow.infer_normals(rgb, mask)
    silent(lambda: relight.Subject(rgb, mask, normals=found))


@pytest.mark.slow
def test_other_normals_warn_naming_both(person, tmp_path):
    rgb, mask = person
    checksum = save(tmp_path / "mine.safetensors")
    own = normals.load().origin.sha256
    theirs = rf"of 'field' \({own[:8]}\) and is given those of 'mine' \({checksum[:8]}\)"
    with pytest.warns(UserWarning, match=theirs):
        shading.infer(rgb, mask, olat()[:1], normals=tmp_path / "mine.safetensors")
    with pytest.warns(UserWarning, match="'shading' was trained .* given those of 'leaning'"):
        shading.infer_albedo(rgb, mask, normals=leaning)
    with pytest.warns(UserWarning, match="'shading' was trained .* of 'another program'") as caught:
        relight.Subject(rgb, mask, normals=normals.load(leaning(rgb, mask)))
    assert all(warning.filename == __file__ for warning in caught)


def test_weights_are_known_by_their_contents_not_their_name(person, tmp_path):
    """A field trained with another's normals: called `field` like the shipped one, and renamed later."""
    rgb, mask = person
    theirs, mine = tmp_path / "field.safetensors", tmp_path / "mine.safetensors"
    checksum = save(theirs, seed=1)
    save(mine, {"normals": "field", "normals_sha256": checksum})
    renamed = theirs.rename(tmp_path / "renamed.safetensors")
    silent(lambda: shadow.infer(rgb, mask, olat()[:1], model=mine, normals=renamed))
    with pytest.warns(UserWarning, match=rf"'field' \({checksum[:8]}\) and is given those of 'field' \("):
        shadow.infer(rgb, mask, olat()[:1], model=mine, normals="field")
    with pytest.warns(UserWarning, match=rf"'field' \({checksum[:8]}\) and is given those of 'mine' \("):
        shadow.infer(rgb, mask, olat()[:1], model=mine)


@pytest.mark.parametrize("recipe", [{}, {"normals": None}])
def test_a_field_that_learned_with_its_own_says_nothing(person, tmp_path, recipe):
    rgb, mask = person
    save(tmp_path / "field.safetensors", recipe)
    silent(
        lambda: shadow.infer(
            rgb, mask, olat()[:1], model=tmp_path / "field.safetensors", normals=normals.load(leaning)
        )
    )


def test_each_network_of_a_subject_speaks_for_itself(person, tmp_path):
    rgb, mask = (torch.from_numpy(array) for array in person)
    save(tmp_path / "one.safetensors", {"normals": "pifuhd"})
    save(tmp_path / "two.safetensors", {"normals": "leaning"})
    field, agreeing = (visibility.load(tmp_path / f"{name}.safetensors") for name in ("one", "two"))
    image = rgb.permute(2, 0, 1)
    with pytest.warns(UserWarning, match="'one' was trained with the normals of 'pifuhd'") as caught:
        normals.resolve(leaning, image, mask, field, agreeing)
    assert len(caught) == 1


@pytest.mark.slow
def test_a_sequence_warns_once(person):
    """By Python's own default filter: once for each place in the caller's code and each network."""
    rgb, mask = person
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        for _ in range(3):
            relight.Subject(rgb, mask, normals=leaning, albedo=rgb)
    messages = [str(warning.message) for warning in caught]
    assert len(messages) == len(set(messages)) >= 1
