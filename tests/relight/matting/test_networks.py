"""Mattes by ONNX files, which are made here: small graphs whose answer is known."""

import numpy as np
import pytest
from helpers.onnx_models import channel, recurrent, save

pytest.importorskip("onnxruntime")
helper = pytest.importorskip("onnx").helper

import relight
from relight.matting import networks, outline, refine
from relight.media import colour


@pytest.fixture
def photograph():
    """Red, 0.8 as encoded, where the person is, and dark blue, 0.2: (90, 70, 3) uint8, and where."""
    image, there = np.full((90, 70, 3), (0, 0, 51), np.uint8), np.zeros((90, 70), bool)
    there[20:80, 15:50] = True
    image[there] = (204, 0, 0)
    return image, there


PLAIN = {"mean": (0, 0, 0), "std": (1, 1, 1)}


def test_a_matte_lies_where_the_person_is(tmp_path, photograph):
    image, there = photograph
    found = relight.matte(image, channel(tmp_path / "m.onnx", 0), **PLAIN)
    assert (found.shape, found.dtype) == ((90, 70), np.float32)
    assert (found[there].max(), found[~there].min()) == (pytest.approx(0.8, abs=0.01), 0)
    assert np.abs((found > 0.4) ^ there).mean() < 0.01


@pytest.mark.parametrize("kind", ["FLOAT16", "DOUBLE"])
def test_networks_of_other_floats_give_the_same_matte(tmp_path, photograph, kind):
    image, _ = photograph
    expected = relight.matte(image, channel(tmp_path / "a.onnx", 0), **PLAIN)
    found = relight.matte(image, channel(tmp_path / "b.onnx", 0, kind=kind), **PLAIN)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_codes_of_8_bits_are_a_matte(tmp_path, photograph):
    image, _ = photograph
    nodes = [
        helper.make_node("Slice", ["x", "from", "to", "axis"], ["c"]),
        helper.make_node("Mul", ["c", "codes"], ["y"]),
    ]
    constants = {"from": np.int64([0]), "to": np.int64([1]), "axis": np.int64([1]), "codes": np.float32(255)}
    model = save(tmp_path / "m.onnx", nodes, {"x": [1, 3, 64, 64]}, {"y": [1, 1, 64, 64]}, **constants)
    expected = relight.matte(image, channel(tmp_path / "a.onnx", 0), **PLAIN)
    np.testing.assert_allclose(relight.matte(image, model, **PLAIN), expected, atol=1e-5)
    with pytest.raises(ValueError, match=r"answers within \[0, 255\] already: expected sigmoid=False"):
        relight.matte(image, model, sigmoid=True, **PLAIN)


def test_one_of_two_outputs_has_to_be_chosen(tmp_path, photograph):
    image, there = photograph
    model = channel(tmp_path / "m.onnx", 0, extra=1)
    with pytest.raises(ValueError, match=r"output: .* has several outputs that may be the matte, .* 0, 1"):
        relight.matte(image, model, **PLAIN)
    found = relight.matte(image, model, output=0, **PLAIN)
    assert np.abs((found > 0.4) ^ there).mean() < 0.01


def test_a_network_without_a_size_is_refused_by_name(tmp_path, photograph):
    model = channel(tmp_path / "m.onnx", 0, (1, 3, 0, 0))
    with pytest.raises(ValueError, match=r"m\.onnx: expected one input \(N, 3, H, W\)"):
        relight.matte(photograph[0], model, **PLAIN)


@pytest.mark.parametrize("fit", ["stretch", "pad", "short"])
def test_every_way_to_fit_lays_the_matte_back_in_place(tmp_path, photograph, fit):
    image, there = photograph
    shape = (1, 3, "h", "w")
    found = relight.matte(image, channel(tmp_path / "m.onnx", 0, shape), size=64, fit=fit, **PLAIN)
    assert ((found > 0.4) ^ there).mean() < 0.02


def test_order_mean_and_deviation_are_those_said(tmp_path, photograph):
    image, there = photograph
    model = channel(tmp_path / "m.onnx", 2)
    bgr = relight.matte(image, model, order="bgr", mean=(0, 0, 0), std=(1.25, 1, 2))
    assert bgr[there].max() == pytest.approx(0.64, abs=0.01)  # red, over its own deviation
    with pytest.raises(ValueError, match=r"m\.onnx found no person"):
        relight.matte(image, model, **PLAIN)


def test_logits_become_a_matte_and_are_never_taken_for_one(tmp_path, photograph):
    image, there = photograph
    model = channel(tmp_path / "m.onnx", 0)
    scaled = {"mean": (0.4, 0, 0), "std": (0.04, 1, 1)}  # logits of -10 and 10
    found = relight.matte(image, model, sigmoid=True, **scaled)
    assert found[there].max() > 0.999
    assert found[~there].min() < 1e-3
    with pytest.raises(ValueError, match=r"expected a matte in \[0, 1\], got \[-10, 10\].*sigmoid=True"):
        relight.matte(image, model, **scaled)
    with pytest.raises(ValueError, match="expected sigmoid=False"):
        relight.matte(image, model, sigmoid=True, **PLAIN)


SHAPES = {
    "u2net": ((1, 3, 320, 320), "x", ("y",), 6),
    "birefnet": ((1, 3, 1024, 1024), "input_image", ("output_image",), 0),
    "modnet": (("batch_size", 3, "height", "width"), "input", ("output",), 0),
}


@pytest.mark.parametrize("family", SHAPES)
def test_known_families_are_told_by_inputs_and_outputs(tmp_path, photograph, family):
    image, there = photograph
    shape, name, outputs, extra = SHAPES[family]
    model = channel(tmp_path / "m.onnx", 0, shape, name, outputs, extra=extra)
    expected = networks.FAMILIES[family]
    red = (0.8 - expected.preprocessing.mean[0]) / expected.preprocessing.std[0]
    if family == "birefnet":  # logits
        found = relight.matte(image, model)
        assert found[there].max() == pytest.approx(1 / (1 + np.exp(-red)), abs=0.01)
    elif family == "modnet":  # red is 0.6, blue's red -1: no matte, which is said
        with pytest.raises(ValueError, match=r"got \[-1, 0\.6\]"):
            relight.matte(image, model)
    else:
        with pytest.raises(ValueError, match=r"got \[-2\.12, 1\.38\]"):
            relight.matte(image, model)


def test_a_multitask_model_gives_its_third_output(tmp_path, photograph):
    image, there = photograph
    nodes = [
        helper.make_node("Slice", ["x", "a", "one", "axis"], ["depth"]),
        helper.make_node("Identity", ["x"], ["normals"]),
        helper.make_node("Slice", ["x", "b", "c", "axis"], ["foreground"]),
    ]
    plane, shape = [1, 1, 512, 512], [1, 3, 512, 512]
    numbers = {"a": 0, "one": 1, "b": 2, "c": 3, "axis": 1}
    numbers = {name: np.int64([value]) for name, value in numbers.items()}
    model = save(
        tmp_path / "m.onnx",
        nodes,
        {"x": shape},
        {"depth": plane, "normals": shape, "foreground": plane},
        **numbers,
    )
    found = relight.matte(image, model)  # the third channel of blue, green, red
    assert ((found > 0.4) ^ there).mean() < 0.01


def test_states_go_from_frame_to_frame_and_are_forgotten(tmp_path, photograph):
    matter = networks.load(recurrent(tmp_path / "rvm.onnx"))
    frame = refine.encoded_srgb(colour.decode(photograph[0], "sRGB"))
    tops = [matter(frame).max() for _ in range(3)]
    np.testing.assert_allclose(tops, (0.8, 0.9, 1), atol=1e-3)
    matter.reset()
    assert matter(frame).max() == pytest.approx(0.8, abs=1e-3)
    assert matter.recurrent


# Several people


def two():
    found = np.zeros((60, 100), np.float32)
    found[10:50, 5:30] = 1
    found[20:50, 70:90] = 1
    found[20:50, 69] = found[10:50, 30] = 0.4
    found[2:5, 72:75] = 1  # a hand
    return found


def test_the_largest_person_is_taken_with_their_soft_edge():
    alone = refine.select_person(two())
    np.testing.assert_array_equal(alone[:, :31], two()[:, :31])
    assert not alone[:, 60:].any()


@pytest.mark.parametrize("person", [2, (65, 30), (99, 0)])
def test_another_is_taken_by_number_or_by_the_nearest_point(person):
    other = refine.select_person(two(), person)
    np.testing.assert_array_equal(other[:, 60:], two()[:, 60:])  # with the hand
    assert not other[:, :40].any()


@pytest.mark.parametrize(
    ("person", "message"), [(3, "expected 1 to 2"), (0, "expected 1 to 2"), ((100, 3), "a point in the pict")]
)
def test_a_person_who_is_not_there_is_an_error(person, message):
    with pytest.raises(ValueError, match=message):
        refine.select_person(two(), person)


# Rough masks, and colours at soft edges


def soft_disc():
    """A photograph of a red disc with a soft rim before green; its true matte."""
    y, x = np.mgrid[:80, :80] - 39.5
    alpha = ((30 - np.hypot(x, y)) / 8).clip(0, 1).astype(np.float32)[..., None]
    return alpha * np.float32((0.6, 0.1, 0.1)) + (1 - alpha) * np.float32((0.05, 0.5, 0.1)), alpha[..., 0]


def test_a_rough_mask_becomes_a_matte():
    pixels, alpha = soft_disc()
    hard = np.float32(alpha > 0.4)
    soft = outline.refine_matte(pixels, hard, 14)
    edge = (alpha > 0.05) & (alpha < 0.95)
    assert np.abs(soft - alpha)[edge].mean() < 0.4 * np.abs(hard - alpha)[edge].mean()
    assert (soft[alpha == 1].min(), soft[:5].max()) == (pytest.approx(1, abs=0.02), 0)


def test_a_mask_in_steps_becomes_a_smooth_outline():
    """Of a disc before a wall, both of coarse cloth; the mask has an eighth of its resolution."""
    y, x = np.mgrid[:160, :160] - 79.5
    radius = np.hypot(x, y)
    alpha = np.float32((60.5 - radius).clip(0, 1))
    own, behind = np.float32((0.5, 0.1, 0.1)), np.float32((0.1, 0.3, 0.1))
    cloth = 1 + 0.2 * np.random.default_rng(0).normal(size=(2, 160, 160, 1))
    pixels = alpha[..., None] * own * cloth[0] + (1 - alpha[..., None]) * behind * cloth[1]
    steps = np.float32(alpha[4::8, 4::8] > 0.5).repeat(8, 0).repeat(8, 1)
    smooth = outline.refine_matte(np.float32(pixels.clip(0, 1)), steps, 20)
    edge = np.abs(radius - 60) < 12
    assert np.abs(smooth - alpha)[edge].mean() < 0.08 * np.abs(steps - alpha)[edge].mean()


@pytest.mark.parametrize(("band", "message"), [(1, "2 pixels or more"), (200, "leaves nothing")])
def test_a_band_that_solves_nothing_is_an_error(band, message):
    pixels, alpha = soft_disc()
    with pytest.raises(ValueError, match=message):
        outline.refine_matte(pixels, alpha, band)


# What is wrong is said


def bad_file(path):
    path.write_bytes(b"no model")
    return path


def two_inputs(path):
    nodes = [helper.make_node("Add", ["a", "b"], ["y"])]
    return save(path, nodes, {name: [1, 3, 8, 8] for name in "ab"}, {"y": [1, 3, 8, 8]})


@pytest.mark.parametrize(
    ("make", "options", "message"),
    [
        (bad_file, PLAIN, "is no ONNX model that can be opened"),
        (two_inputs, PLAIN, r"expected one input \(N, 3, H, W\), got inputs a \(1, 3, 8, 8\), b"),
        (lambda path: channel(path, 0), {}, r"of no known family: .* inputs x \(1, 3, 64, 64\); outputs y"),
        (lambda path: channel(path, 0, then="Log"), PLAIN, "'y' holds NaN or infinite values"),
        (lambda path: channel(path, 1), PLAIN, "found no person"),
        (
            lambda path: channel(path, 0, (1, 3, 10**5, 64)),
            PLAIN,
            r"m\.onnx: .* up to 8192 pixels a side, got",
        ),
        (lambda path: channel(path, 0), {"mean": (-0.9, 0, 0), "std": (1.7, 1, 1)}, "covers everything"),
        (lambda path: channel(path, 0), {**PLAIN, "order": "abc"}, "order: expected rgb or bgr"),
        (lambda path: channel(path, 0), {**PLAIN, "std": (0, 1, 1)}, "std: expected three numbers > 0"),
        (lambda path: channel(path, 0), {**PLAIN, "output": 3}, "output: expected one of 1"),
        (lambda path: channel(path, 0), {"family": "x"}, "family: expected one of u2net"),
        (lambda path: channel(path, 0), {**PLAIN, "size": 32}, "does not run on this photograph"),
    ],
)
def test_bad_models_are_one_line(tmp_path, photograph, make, options, message):
    with pytest.raises(ValueError, match=message) as caught:
        relight.matte(photograph[0], make(tmp_path / "m.onnx"), **options)
    assert "\n" not in str(caught.value)


def test_a_missing_file_and_a_transparent_picture(tmp_path, photograph):
    with pytest.raises(FileNotFoundError, match="no such file"):
        relight.matte(photograph[0], tmp_path / "none.onnx")
    clear = np.zeros((90, 70, 4), np.uint8)
    with pytest.raises(ValueError, match="has transparency"):
        relight.matte(clear, channel(tmp_path / "m.onnx", 0), **PLAIN)
