"""A source without alpha keeps its background, and its code values where the person is not."""

import av
import numpy as np
import pytest
from helpers.standins import HEIGHT, WIDTH, FlatShots, somebody

import relight
from relight.media import images, movies
from relight.media.images.decode import load
from relight.media.images.write_image import encoded
from relight.media.video_frames import read_codes

BRIGHT = relight.DirectionalLight(intensity=6, name="key")  # highlights that the display's curve compresses
SIZE = (48, 64)


@pytest.fixture
def stub():
    return FlatShots()


def wall(levels, size=(HEIGHT, WIDTH), dtype=np.uint8):
    """Codes (H, W, 3) of all brightnesses, with a person's at the place of `somebody`."""
    codes = np.random.default_rng(0).integers(0, levels + 1, (*size, 3)).astype(dtype)
    codes[0, 0] = 0xE5, 0xE6, 0xE1
    codes[0, 1] = levels
    return codes


def coverage(size=(HEIGHT, WIDTH)):
    matte = np.zeros(size, np.float32)
    rows, columns = size
    matte[rows // 6 : rows // 6 * 5, columns // 4 : columns // 2] = 1
    matte[rows // 6 : rows // 6 * 5, columns // 2] = 0.4
    return matte


def codes_of(path):
    return load(path).pixels


@pytest.mark.parametrize(
    ("source", "dtype", "output", "factor"),
    [
        ("p.png", np.uint8, "r.png", 1),
        ("p.jpg", np.uint8, "r.png", 1),
        ("p.png", np.uint8, "r.tif", 257),
        ("p.png", np.uint16, "r.tif", 1),
        ("p.tif", np.uint16, "r.tif", 1),
    ],
)
def test_codes_beside_the_person_are_those_of_the_source(stub, tmp_path, source, dtype, output, factor):
    levels = np.iinfo(dtype).max
    relight.write(tmp_path / source, wall(levels, dtype=dtype), depth=dtype.__name__)
    matte = coverage()
    stub.render(tmp_path / source, BRIGHT, tmp_path / output, mask=matte)
    found, given = codes_of(tmp_path / output), codes_of(tmp_path / source)
    assert found.shape == given.shape
    np.testing.assert_array_equal(found[matte == 0], given[matte == 0].astype(int) * factor)
    assert (found[matte == 1] != given[matte == 1].astype(int) * factor).any()


def film(path, codec, layout, count=3):
    """Write a movie of noise in BT.709."""
    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec, 25)
        stream.height, stream.width, stream.pix_fmt = *SIZE, layout
        context = stream.codec_context
        context.color_primaries = context.color_trc = context.colorspace = 1
        for number in range(count):
            random = np.random.default_rng(number)
            rgb = random.integers(0, 256, (*SIZE, 3)).astype(np.uint8)
            file.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24").reformat(format=layout)))
        file.mux(stream.encode())


@pytest.mark.parametrize(
    ("name", "codec", "layout", "output"),
    [
        ("p.mp4", "libx264", "yuv420p", "r.mp4"),
        ("p.mov", "prores_ks", "yuv422p10le", "r.mov"),
        ("p.mp4", "libx264", "yuv420p", "r.mov"),
    ],
)
def test_the_encoder_of_a_movie_gets_the_codes_of_the_source(stub, tmp_path, name, codec, layout, output):
    film(tmp_path / name, codec, layout)
    matte = coverage(SIZE)
    run = {"mask": matte, "temporal_filter": False}
    stub.render(tmp_path / name, BRIGHT, tmp_path / output, phase="frames", **run)
    with av.open(str(tmp_path / name)) as file:
        decoded = [read_codes(frame, frame.format.name) for frame in file.decode(video=0)]
    for number, given in enumerate(decoded, 1):
        found = images.read_codes(tmp_path / f"{output}.frames" / f"{number:06d}.tif")
        np.testing.assert_array_equal(found[matte == 0], given[matte == 0])
    stub.render(tmp_path / name, BRIGHT, tmp_path / output, phase="finalize", **run)
    assert len(movies.Movie(tmp_path / output).numbers) == len(decoded)


def test_a_sequence_keeps_its_codes_in_all_frames(stub, tmp_path):
    for number in (1, 2):
        relight.write(tmp_path / f"p.{number}.png", np.roll(wall(255), number, axis=0))
    stub.render(tmp_path / "p.%d.png", BRIGHT, tmp_path / "r.%d.png", mask=coverage())
    for number in (1, 2):
        found, given = (codes_of(tmp_path / f"{name}.{number}.png") for name in "rp")
        np.testing.assert_array_equal(found[coverage() == 0], given[coverage() == 0])


@pytest.mark.parametrize("output", ["r.png", "r.jpg", "r.tif", "r.hdr"])
@pytest.mark.parametrize("source", ["p.png", "p.jpg", "p.webp", "p.tif", "p.exr", None])
def test_a_source_without_alpha_keeps_its_background(stub, tmp_path, source, output):
    photograph = np.full((HEIGHT, WIDTH, 3), 0.2, np.float32)
    plate = photograph if source is None else tmp_path / source
    if source == "p.webp":
        from PIL import Image

        Image.fromarray(np.full((HEIGHT, WIDTH, 3), 124, np.uint8)).save(plate, lossless=True)
    elif source is not None:
        relight.write(plate, photograph)
    stub.render(plate, BRIGHT, tmp_path / output, mask=coverage())
    found = relight.read(tmp_path / output)
    assert found.shape[-1] == 3
    np.testing.assert_allclose(found[0, -1], 0.2, atol=0.01)


def test_cutting_out_is_asked_for(stub, tmp_path):
    relight.write(tmp_path / "p.png", wall(255))
    stub.render(tmp_path / "p.png", BRIGHT, tmp_path / "r.png", mask=coverage(), background="none")
    np.testing.assert_allclose(relight.read(tmp_path / "r.png")[..., 3], coverage(), atol=1 / 255)
    with pytest.raises(ValueError, match=r"r\.jpg: \.jpg holds no alpha; give a background"):
        stub.render(tmp_path / "p.png", BRIGHT, tmp_path / "r.jpg", mask=coverage(), background="none")


def test_an_exr_holds_the_cut_out_beside_pictures_over_the_plate(stub, tmp_path):
    relight.write(tmp_path / "p.png", wall(255))
    outputs = [tmp_path / "r.exr", tmp_path / "r.png"]
    stub.render(tmp_path / "p.png", BRIGHT, outputs, mask=coverage())
    np.testing.assert_allclose(relight.read(tmp_path / "r.exr")[..., 3], coverage(), atol=1e-3)
    assert "C_background" not in relight.read_layers(tmp_path / "r.exr")
    assert relight.read(tmp_path / "r.png").shape[-1] == 3


def test_an_exr_takes_the_plate_if_that_is_asked_for(stub, tmp_path):
    relight.write(tmp_path / "p.png", wall(255))
    outputs = [tmp_path / "r.exr", tmp_path / "r.png"]
    stub.render(tmp_path / "p.png", BRIGHT, outputs, mask=coverage(), background="plate")
    picture, layers = relight.read(tmp_path / "r.exr"), relight.read_layers(tmp_path / "r.exr")
    assert picture.shape[-1] == 3
    given = relight.read(tmp_path / "p.png")
    np.testing.assert_allclose(picture[coverage() == 0], given[coverage() == 0], rtol=2e-3)
    np.testing.assert_allclose(layers["C_key"][..., :3] + layers["C_background"], picture, atol=2e-3)
    np.testing.assert_array_equal(
        codes_of(tmp_path / "r.png")[coverage() == 0], codes_of(tmp_path / "p.png")[coverage() == 0]
    )


def test_a_source_with_alpha_stays_cut_out(stub, tmp_path):
    relight.write(tmp_path / "p.png", somebody())
    stub.render(tmp_path / "p.png", BRIGHT, tmp_path / "r.png")
    assert relight.read(tmp_path / "r.png").shape[-1] == 4


@pytest.mark.parametrize("background", ["same", "plate", None])
def test_the_photograph_named_as_its_own_background_is_filled_too(stub, tmp_path, background):
    relight.write(tmp_path / "p.png", wall(255))
    dark = relight.DirectionalLight(intensity=0, name="key")
    behind = tmp_path / "p.png" if background == "same" else background
    stub.render(tmp_path / "p.png", dark, tmp_path / "r.png", mask=coverage(), background=behind)
    soft = relight.read(tmp_path / "r.png")[coverage() == 0.4]
    np.testing.assert_array_equal(soft, 0)  # the stand-in fills with black: nothing of the plate shows


def test_a_background_that_is_another_picture_keeps_its_codes(stub, tmp_path):
    relight.write(tmp_path / "street.png", wall(255))
    stub.render(somebody(), BRIGHT, tmp_path / "r.png", background=tmp_path / "street.png")
    free = somebody()[..., 3] == 0
    np.testing.assert_array_equal(codes_of(tmp_path / "r.png")[free], codes_of(tmp_path / "street.png")[free])


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"source": "alpha.png"}, "the source has alpha, so nothing is behind the person"),
        ({"mask": coverage(), "size": (20, 20)}, "the photograph is placed in another frame"),
    ],
)
def test_the_plate_is_refused_where_there_is_none(stub, tmp_path, settings, why):
    relight.write(tmp_path / "alpha.png", somebody())
    relight.write(tmp_path / "p.png", wall(255))
    settings = {"background": "plate", **settings}
    source = tmp_path / settings.pop("source", "p.png")
    with pytest.raises(ValueError, match=f"^background: .* behind the person, as {why}$"):
        stub.render(source, BRIGHT, tmp_path / "r.png", **settings)
    assert not stub.made


@pytest.mark.parametrize(
    ("output", "options", "message"),
    [
        (
            "r.mp4",
            {},
            r"r\.mp4: \.mp4 holds no alpha; give a background \(background=FILE\), or write a \.mov",
        ),
        ("r.mov", {"white": 0.5}, "white: expected a number of at least 1"),
        ("r.mov", {"view": "none such"}, "view: expected one of"),
    ],
)
def test_outputs_are_checked_before_anything_is_analysed(stub, tmp_path, output, options, message):
    for number in (1, 2):
        relight.write(tmp_path / f"p.{number}.png", somebody())
    with pytest.raises(ValueError, match=message):
        stub.render(tmp_path / "p.%d.png", BRIGHT, tmp_path / output, **options)
    assert not stub.made


def test_light_of_a_scene_has_one_curve_with_the_person(stub, tmp_path):
    photograph = np.full((HEIGHT, WIDTH, 3), 0.8, np.float32)
    photograph[0, 0] = 5
    relight.write(tmp_path / "p.exr", photograph)
    stub.render(tmp_path / "p.exr", BRIGHT, tmp_path / "r.png", mask=coverage())
    assert relight.read(tmp_path / "r.png")[-1, -1, 0] < 0.79


def test_a_view_is_of_the_whole_picture(stub, tmp_path):
    relight.write(tmp_path / "p.png", np.full((HEIGHT, WIDTH, 3), 0.5, np.float32))
    stub.render(tmp_path / "p.png", BRIGHT, tmp_path / "r.png", mask=coverage(), view="aces")
    expected = np.rint(255 * encoded(relight.read(tmp_path / "p.png"), view="aces"))
    np.testing.assert_array_equal(codes_of(tmp_path / "r.png")[-1, -1], expected[-1, -1])
