"""What the outputs of a shot keep of its source: the shape of pixels, timecode, camera metadata, sound."""

import json
import warnings
from fractions import Fraction

import av
import numpy as np
import OpenImageIO as oiio
import pytest
from helpers.foreign_files import disc, ramp
from helpers.stored import store
from safetensors import safe_open
from safetensors.numpy import save_file

import relight
from relight.errors import DamagedFileError
from relight.media import movies
from relight.media.images import TypedValue
from relight.media.movies.tracks import Tracks, read_tags
from relight.media.timecode import pack_timecode
from relight.pipeline.plate_metadata import PlateMetadata

KEY = relight.DirectionalLight(azimuth=-40, elevation=20, name="key")
RATE = Fraction(24000, 1001)
CUT = np.dstack([ramp(), disc()])


def spec_of(path):
    return oiio.ImageInput.open(str(path)).spec()


def plate(path, width=32, **attributes):
    """A person of 32 stored columns, as they look 64 wide."""
    alpha = disc()[:, :: 64 // width, None] / 255
    light = 0.2 + 0.3 * np.linspace(0, 1, width, dtype=np.float32)[None, :, None].repeat(64, 0).repeat(3, -1)
    return store(path, np.dstack([light * alpha, alpha]).astype(np.float32), "half", **attributes)


def film(path, frames=6, *, timecode="01:00:00:22", sound="pcm_s16le", aspect=None, rate=RATE):
    """A movie of a person with timecode, tags, and a second of sound for each second."""
    with av.open(str(path), "w", options={"movflags": "use_metadata_tags"}) as file:
        file.metadata["com.apple.quicktime.make"] = "ARRI"
        stream = file.add_stream("prores_ks", rate, options={"profile": "4"})
        stream.width = stream.height = 64
        stream.pix_fmt = "yuva444p10le"
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = Fraction(aspect)
        if timecode is not None:
            stream.metadata["timecode"] = timecode
        track = file.add_stream(sound, 48000, layout="mono") if sound else None
        for number in range(frames):
            frame = av.VideoFrame.from_ndarray(CUT, format="rgba")
            frame.pts = number
            file.mux(stream.encode(frame))
            if track is not None:
                samples = np.full((1, 2002), 1000 * (number + 1), np.int16)
                heard = av.AudioFrame.from_ndarray(samples, format="s16", layout="mono")
                heard.sample_rate, heard.pts = 48000, 2002 * number
                file.mux(track.encode(heard))
        file.mux(stream.encode())
        if track is not None:
            file.mux(track.encode())
    return path


def heard(path):
    """The samples of a movie's sound."""
    with av.open(str(path)) as file:
        if not file.streams.audio:
            return np.zeros(0)
        return np.concatenate([frame.to_ndarray().reshape(-1) for frame in file.decode(audio=0)])


def packets(path):
    """For each packet of a movie's sound, when the frame that it belongs to begins, in ms, and its sample."""
    with av.open(str(path)) as file:
        stream = file.streams.audio[0]
        found = [(each.pts, each.decode()[0].to_ndarray()) for each in file.demux(stream) if each.size]
    assert {len(np.unique(samples)) for _, samples in found} == {1}
    return [(int(pts // 2002 * 2002 // 48), int(samples[0, 0])) for pts, samples in found]


@pytest.mark.parametrize("width", [32, 128])
def test_pixels_that_are_not_square_are_delivered_as_they_came(stub, tmp_path, width):
    aspect = 64 / width
    plate(tmp_path / "a.exr", min(width, 64), PixelAspectRatio=aspect)
    stored = spec_of(tmp_path / "a.exr")
    lights = [KEY, relight.DirectionalLight(name="b")]
    written = {"passes": ["N"], "save_matte": tmp_path / "m.exr"}
    with pytest.warns(UserWarning, match="are written with such pixels again"):
        stub.render(str(tmp_path / "a.exr"), lights, tmp_path / "b.exr", **written)
    for name in ("b.exr", "m.exr"):
        spec = spec_of(tmp_path / name)
        assert (spec.width, spec.height) == (stored.width, stored.height)
        assert spec.getattribute("PixelAspectRatio") == pytest.approx(aspect)
    raw = oiio.ImageInput.open(str(tmp_path / "b.exr"))
    names, pixels = raw.spec().channelnames, raw.read_image("float")
    channels = {name: pixels[..., index] for index, name in enumerate(names)}
    total = np.sum([channels[f"C_{light}.R"] for light in ("key", "b")], axis=0)
    np.testing.assert_array_equal(channels["R"], total.astype(np.float16))  # rounded, they still sum to it
    assert set(np.unique(channels["N.X"])) <= set(np.unique(stub.made[0].normals[..., 0].astype(np.float16)))


def test_a_picture_of_another_size_has_square_pixels(stub, tmp_path):
    plate(tmp_path / "a.exr", PixelAspectRatio=2.0)
    with pytest.warns(UserWarning, match="square pixels"):
        stub.render(str(tmp_path / "a.exr"), KEY, tmp_path / "b.exr", size=(48, 48))
    assert spec_of(tmp_path / "b.exr").get_float_attribute("PixelAspectRatio", 1) == 1
    stub.render(str(tmp_path / "a.exr"), KEY, tmp_path / "b.png")  # viewers do not look at it
    assert relight.read(tmp_path / "b.png").shape == (64, 64, 4)


def test_an_analysis_cache_knows_the_shape_of_pixels(tmp_path):
    plate(tmp_path / "a.exr", PixelAspectRatio=2.0)
    with pytest.warns(UserWarning, match="square pixels"):
        relight.analyse_shot(str(tmp_path / "a.exr"), tmp_path / "a.relight")
    relight.render_shot(str(tmp_path / "a.relight"), KEY, tmp_path / "b.exr")
    spec = spec_of(tmp_path / "b.exr")
    assert (spec.width, spec.height, spec.getattribute("PixelAspectRatio")) == (32, 64, 2)


MATRIX = tuple(map(float, range(16)))


def shot_on_set(path):
    """A plate as a camera's software writes it, with timecode, rate, lens and matrix."""
    spec = oiio.ImageSpec(64, 64, 4, "half")
    spec.attribute("smpte:TimeCode", oiio.TypeTimeCode, (0x10203004, 0))
    spec.attribute("FramesPerSecond", oiio.TypeRational, (24000, 1001))
    spec.attribute("worldToCamera", oiio.TypeMatrix, MATRIX)
    for name, value in {
        "lensModel": "Cooke",
        "isoSpeed": 800.0,
        "Software": "x",
        "relight:olat": "x",
    }.items():
        spec.attribute(name, value)
    spec.attribute(
        "chromaticities", oiio.TypeDesc("float[8]"), (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32, 0.34)
    )
    file = oiio.ImageOutput.create(str(path))
    assert file.open(str(path), spec)
    file.write_image((CUT / 255).astype(np.float32))
    file.close()


def test_an_exr_keeps_timecode_and_camera(stub, tmp_path):
    shot_on_set(tmp_path / "a.exr")
    stub.render(str(tmp_path / "a.exr"), KEY, [tmp_path / "b.exr", tmp_path / "b.png"])
    found = spec_of(tmp_path / "b.exr")
    assert found.getattribute("smpte:TimeCode") == (0x10203004, 0)
    assert found.getattribute("FramesPerSecond") == (24000, 1001)
    assert found.getattribute("worldToCamera") == MATRIX
    assert (found.getattribute("lensModel"), found.getattribute("isoSpeed")) == ("Cooke", 800)
    assert found.getattribute("chromaticities")[0] == pytest.approx(0.64)  # its own
    assert found.getattribute("Software").startswith("relight")
    assert found.getattribute("relight:olat") is None


def test_a_movie_keeps_timecode_tags_and_sound(stub, tmp_path):
    film(tmp_path / "a.mov")
    stub.render(str(tmp_path / "a.mov"), KEY, tmp_path / "b.mov")
    assert read_tags(tmp_path / "b.mov")[0] == "01:00:00:22"
    assert read_tags(tmp_path / "b.mov")[1]["com.apple.quicktime.make"] == "ARRI"
    np.testing.assert_array_equal(heard(tmp_path / "b.mov"), heard(tmp_path / "a.mov"))
    stub.render(str(tmp_path / "a.mov"), KEY, tmp_path / "c.mov", frames="3-5")
    assert read_tags(tmp_path / "c.mov")[0] == "01:00:01:00"
    assert packets(tmp_path / "c.mov") == [(2002 * n // 48, 1000 * (n + 3)) for n in range(3) for _ in "ab"]
    assert movies.Movie(tmp_path / "c.mov").numbers == range(1, 4)


def test_sound_ends_with_its_part_of_the_movie(tmp_path):
    part = Tracks(sound=film(tmp_path / "a.mov"), start=2 / RATE, end=3 / RATE)
    movies.write_movie(tmp_path / "b.mov", [CUT] * 3, rate=RATE, tracks=part)
    assert packets(tmp_path / "b.mov") == [(0, 3000), (0, 3000)]  # of the first of three frames


def test_compressed_sound_is_that_of_its_part_from_the_first_sample(tmp_path):
    source = film(tmp_path / "a.mov", 14, sound="aac", timecode=None)
    part = Tracks(sound=source, start=11 / RATE, end=14 / RATE)  # it begins in the middle of a packet
    movies.write_movie(tmp_path / "b.mp4", [CUT[..., :3]] * 3, rate=RATE, tracks=part)
    whole, found = heard(source), heard(tmp_path / "b.mp4")
    assert 3 * 2002 <= len(found) < 3 * 2002 + 1024  # whole packets
    np.testing.assert_allclose(found, whole[11 * 2002 :][: len(found)], atol=1e-3)


def test_sound_that_a_container_does_not_hold_leaves_the_movie_without(tmp_path):
    source = film(tmp_path / "a.mkv", sound="libopus")
    part = Tracks(sound=source, end=6 / RATE)
    with pytest.warns(UserWarning, match=r"b\.mov: holds no sound of the codec opus; the sound is left out"):
        movies.write_movie(tmp_path / "b.mov", [CUT] * 6, rate=RATE, tracks=part)
    assert movies.Movie(tmp_path / "b.mov").numbers == range(1, 7)


def test_sound_of_another_rate_is_left_out_with_a_word(stub, tmp_path):
    film(tmp_path / "a.mov", 3)
    with pytest.warns(UserWarning, match=r"b\.mov: has no sound, as its frames are not all"):
        stub.render(str(tmp_path / "a.mov"), KEY, tmp_path / "b.mov", rate=12)
    assert heard(tmp_path / "b.mov").size == 0


def test_frames_of_a_movie_have_its_timecode(stub, tmp_path):
    film(tmp_path / "a.mov", 3, sound=None)
    stub.render(str(tmp_path / "a.mov"), KEY, tmp_path / "b.%04d.exr")
    packed = [spec_of(tmp_path / f"b.{n:04d}.exr").getattribute("smpte:TimeCode")[0] for n in (1, 2, 3)]
    assert packed == [0x01000022, 0x01000023, 0x01000100]
    assert spec_of(tmp_path / "b.0001.exr").getattribute("FramesPerSecond") == (24000, 1001)
    assert spec_of(tmp_path / "b.0001.exr").getattribute("Make") == "ARRI"
    stub.render(str(tmp_path / "b.%04d.exr"), KEY, tmp_path / "c.mov", rate=24)
    assert read_tags(tmp_path / "c.mov")[0] == "01:00:00:22"


def test_frames_are_asked_for_by_timecode(stub, tmp_path):
    source = film(tmp_path / "a.mov")  # from 01:00:00:22, 24 frames a second
    stub.render(source, KEY, tmp_path / "r.%d.exr", frames="01:00:00:23-01:00:01:01x2,6")
    assert sorted(path.name for path in tmp_path.glob("r.*.exr")) == ["r.2.exr", "r.4.exr", "r.6.exr"]
    expected = r"frames: expected timecodes of the source, 01:00:00:22 to 01:00:01:03, got 01:00:01:04"
    with pytest.raises(ValueError, match=expected):
        stub.render(source, KEY, tmp_path / "r.%d.exr", frames="01:00:01:04")
    with pytest.raises(ValueError, match=r"got 01:00:00;23"):  # which drops no numbers at 24 a second
        stub.render(source, KEY, tmp_path / "r.%d.exr", frames="01:00:00;23")
    silent = film(tmp_path / "b.mov", timecode=None)
    with pytest.raises(ValueError, match=r"frames: expected numbers, as .*b.mov states no timecode"):
        stub.render(silent, KEY, tmp_path / "r.%d.exr", frames="01:00:00:23")


def test_timecode_that_openexr_cannot_hold_is_said_once(stub, tmp_path):
    film(tmp_path / "a.mov", 45, timecode="01:00:00:00", sound=None, rate=60)
    with pytest.warns(UserWarning, match=r"OpenEXR files hold no timecode at 60 frames a second") as said:
        stub.render(str(tmp_path / "a.mov"), KEY, tmp_path / "b.%04d.exr", frames=(38, 42))
    assert sum("no timecode" in str(one.message) for one in said) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stub.render(str(tmp_path / "a.mov"), KEY, tmp_path / "c.mov", frames=(1, 2))
    assert read_tags(tmp_path / "c.mov")[0] == "01:00:00:00"
    assert not any(spec_of(path).getattribute("smpte:TimeCode") for path in tmp_path.glob("b.*.exr"))


@pytest.mark.parametrize("timecode", ["01:00:00;05", "01:00:00:27"])
def test_timecode_that_is_none_at_the_rate_is_left_out_with_a_word(stub, tmp_path, timecode):
    header = {"smpte:TimeCode": TypedValue("timecode", pack_timecode(timecode))}
    alpha = disc()[..., None] / np.float32(255)
    relight.write(tmp_path / "p.0001.exr", np.concatenate([alpha] * 4, axis=-1), metadata=header)
    with pytest.warns(UserWarning, match=f"b.mov: has no timecode, as {timecode} is none at 24 frames"):
        stub.render(str(tmp_path / "p.%04d.exr"), KEY, tmp_path / "b.mov", rate=24)
    assert read_tags(tmp_path / "b.mov")[0] is None


def test_a_matroska_file_says_its_timecode_in_capitals(tmp_path):
    with av.open(str(tmp_path / "a.mkv"), "w") as file:
        file.metadata["title"] = "take 3"
        stream = file.add_stream("ffv1", 25)
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        stream.metadata["timecode"] = "10:20:30:12"
        file.mux(stream.encode(av.VideoFrame(64, 64, "yuv420p")))
        file.mux(stream.encode())
    with av.open(str(tmp_path / "a.mkv")) as file:
        assert "TIMECODE" in file.streams[0].metadata
    assert read_tags(tmp_path / "a.mkv") == ("10:20:30:12", {"title": "take 3"}, False)


@pytest.mark.parametrize(
    ("name", "stated", "rate"),
    [
        ("a.%04d.exr", {"FramesPerSecond": (25, 1)}, 25),
        ("a.%04d.exr", {"FramesPerSecond": (24000, 1001)}, RATE),
        ("a.%04d.exr", {"FramesPerSecond": (25, 0)}, 24),
        ("a.%04d.dpx", {"dpx:FrameRate": 30.0}, 30),
        ("a.%04d.exr", {}, 24),
    ],
)
def test_a_movie_of_a_sequence_has_the_rate_that_its_files_state(stub, tmp_path, name, stated, rate):
    for number in (1, 2):
        spec = oiio.ImageSpec(64, 64, 3, "half" if name.endswith("exr") else "uint16")
        for key, value in stated.items():
            spec.attribute(key, oiio.TypeRational if isinstance(value, tuple) else oiio.TypeFloat, value)
        spec.attribute("oiio:ColorSpace", "lin_rec709")
        file = oiio.ImageOutput.create(str(tmp_path / (name % number)))
        assert file.open(str(tmp_path / (name % number)), spec)
        file.write_image(np.full((64, 64, 3), 0.2, np.float32))
        file.close()
    source, mask = str(tmp_path / name), np.float32(disc() / 255)
    stub.render(source, KEY, tmp_path / "b.mov", mask=mask)
    assert movies.Movie(tmp_path / "b.mov").rate == rate
    stub.render(source, KEY, tmp_path / "c.mov", rate=50, mask=mask)
    assert movies.Movie(tmp_path / "c.mov").rate == 50


def test_a_movie_of_pixels_that_are_not_square_says_so(stub, tmp_path):
    film(tmp_path / "a.mov", 2, aspect=2)
    with pytest.warns(UserWarning, match="are written with such pixels again"):
        stub.render(str(tmp_path / "a.mov"), KEY, tmp_path / "b.mov")
    with av.open(str(tmp_path / "b.mov")) as file:
        stream = file.streams.video[0]
        assert (stream.width, stream.height, stream.sample_aspect_ratio) == (64, 64, 2)


# The analysis cache in place of the plates


def header_of(path):
    """{name: (type, value)} of a file, without what tells how it was made."""
    made = ("DateTime", "Exif:ImageUniqueID", "relight:")
    return {
        each.name: (str(each.type), each.value)
        for each in spec_of(path).extra_attribs
        if not each.name.startswith(made)
    }


def analysed(source, folder):
    assert relight.analyse_shot(str(source), folder) == {}
    return str(folder)


def test_an_exr_relit_from_a_cache_has_the_header_of_its_plate(tmp_path):
    shot_on_set(tmp_path / "a.exr")
    cache = analysed(tmp_path / "a.exr", tmp_path / "a.relight")
    relight.render_shot(str(tmp_path / "a.exr"), KEY, tmp_path / "direct.exr")
    (tmp_path / "a.exr").unlink()
    with pytest.warns(UserWarning, match=r"a\.exr is not there to compare with"):
        relight.render_shot(cache, KEY, tmp_path / "kept.exr")
    found = header_of(tmp_path / "kept.exr")
    assert found == header_of(tmp_path / "direct.exr")
    assert found["smpte:TimeCode"] == ("timecode", (0x10203004, 0))
    assert found["worldToCamera"] == ("matrix", MATRIX)


def test_a_movie_relit_from_a_cache_has_timecode_tags_and_sound(tmp_path):
    movie = film(tmp_path / "a.mov", 3)
    cache = analysed(movie, tmp_path / "a.relight")
    outputs = [tmp_path / "b.mov", tmp_path / "b.%04d.exr"]
    relight.render_shot(cache, KEY, outputs, frames="2-3")
    timecode, tags, _ = read_tags(tmp_path / "b.mov")
    assert (timecode, tags["com.apple.quicktime.make"]) == ("01:00:00:23", "ARRI")
    assert list(np.unique(heard(tmp_path / "b.mov"))) == [2000, 3000]  # the sound of frames 2 and 3
    found = header_of(tmp_path / "b.0003.exr")
    assert found["smpte:TimeCode"][1] == (0x01000100, 0)
    assert found["FramesPerSecond"] == ("rational", (24000, 1001))
    assert found["Make"][1] == "ARRI"
    movie.unlink()
    with pytest.warns(UserWarning, match=r"c\.mov: has no sound, as .*a\.mov is not there"):
        relight.render_shot(cache, KEY, tmp_path / "c.mov")
    assert (read_tags(tmp_path / "c.mov")[0], heard(tmp_path / "c.mov").size) == ("01:00:00:22", 0)


def test_a_cache_of_an_earlier_version_is_lit_and_says_what_it_lacks(tmp_path):
    shot_on_set(tmp_path / "a.exr")
    cache = analysed(tmp_path / "a.exr", tmp_path / "a.relight")
    edit_provenance(tmp_path / "a.relight" / "still.safetensors", lambda kept: kept.pop("plate_metadata"))
    with pytest.warns(UserWarning, match="keeps no timecode, camera metadata and sound of its plates; run"):
        relight.render_shot(cache, KEY, tmp_path / "b.exr")
    assert "smpte:TimeCode" not in header_of(tmp_path / "b.exr")
    damaged = {"version": 1, "header": {"a": ["float", {}]}, "timecode": None, "tags": {}, "sound": None}
    shown = damaged | {"shown": ["0", "0"]}
    large = shown | {"header": {"smpte:TimeCode": ["timecode", [2**40, 0]]}}
    for damaged_part in (shown, large, damaged, {"version": 9}, 3):
        edit_provenance(
            tmp_path / "a.relight" / "still.safetensors",
            lambda kept, new=damaged_part: kept.update(plate_metadata=new),
        )
        with pytest.raises(DamagedFileError, match=r"still\.safetensors: "):
            relight.render_shot(cache, KEY, tmp_path / "c.exr")


def edit_provenance(path, edit):
    with safe_open(path, "np") as file:
        about = json.loads(file.metadata()["relight"])
        tensors = {name: file.get_tensor(name) for name in about["arrays"]}
    edit(about["provenance"])
    save_file(tensors, path, {"relight": json.dumps(about)})


def test_long_values_stay_out_of_a_cache(tmp_path):
    rate = TypedValue("rational", (24000, 1001))
    stated = PlateMetadata({"a": TypedValue("string", "x" * 20000), "b": rate})
    kept = json.loads(json.dumps(stated.to_json(tmp_path)))
    found = PlateMetadata.from_json(kept, tmp_path).header
    assert found == {"b": rate}
