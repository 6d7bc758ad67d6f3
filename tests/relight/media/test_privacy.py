"""No place, owner, serial number or folder of the source reaches an output, a cache or a page."""

import numpy as np
import OpenImageIO as oiio
import pytest

import relight
from relight.media import images
from relight.media.movies.tracks import read_tags
from relight.media.privacy import is_private

KEPT = {"Exif:FNumber": 2.8, "Model": "ALEXA", "title": "take 3", "lensModel": "24-70 / 2.8"}
KEPT |= {"comment": "see https://example.com/a/b", "shutter": "1/125", "timecode": "01:00:00:12"}
KEPT |= {"Exif:SubjectDistance": 3.0, "note": "either/or: yes/no", "geometry": "x"}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("GPS:Latitude", (48.0, 51.0, 30.0)),
        ("latitude", 48.85),
        ("location-eng", "+48.8584+002.2945/"),
        ("com.apple.quicktime.location.ISO6709", "x"),
        ("note", "+48.8584+002.2945/"),
        ("owner", "Jane"),
        ("Exif:CameraOwnerName", "Jane"),
        ("Exif:BodySerialNumber", "123"),
        ("cameraSerialNumber", "123"),
        ("HostComputer", "desk"),
        ("comment", "from /home/jane/plates"),
        ("input", r"C:\plates\a.exr"),
        ("input", "path:/mnt/plates/a.exr"),
        ("input", "[/mnt/plates/a.exr]"),
        ("input", "~jane/a.exr"),
        ("input", r"\\server\share\a.exr"),
        ("input", "smb://nas/share/a.exr"),
        ("cameraUuid", "5f9c"),
        ("lens_serial_number", "12"),
        ("com.apple.quicktime.location.accuracy.horizontal", "14.2"),
        ("\xa9xyz", "x"),
        ("IPTC:City", "Wien"),
    ],
)
def test_what_tells_of_a_person_is_private(name, value):
    assert is_private(name, value)


@pytest.mark.parametrize("name", KEPT)
def test_the_scene_and_its_camera_are_not(name):
    assert not is_private(name, KEPT[name])


def test_an_exr_keeps_its_camera_and_loses_its_place(tmp_path):
    spec = oiio.ImageSpec(16, 16, 4, "half")
    for name, value in {**KEPT, "latitude": 48.85, "longitude": 2.29, "owner": "Jane"}.items():
        spec.attribute(name, value)
    plate = np.zeros((16, 16, 4), np.float32)
    plate[4:12, 4:12] = 0.4, 0.4, 0.4, 1
    output = oiio.ImageOutput.create(str(tmp_path / "p.exr"))
    output.open(str(tmp_path / "p.exr"), spec)
    output.write_image(plate)
    output.close()
    assert relight.render_shot(tmp_path / "p.exr", relight.DirectionalLight(), tmp_path / "r.exr") == {}
    written = images.read_metadata(tmp_path / "r.exr")
    assert written["Model"].value == "ALEXA"
    assert not [name for name in written if name in ("latitude", "longitude", "owner")]
    assert b"Jane" not in (tmp_path / "r.exr").read_bytes()  # OpenImageIO calls the owner Copyright


def test_tags_of_a_movie_have_no_place(tmp_path):
    import av

    with av.open(str(tmp_path / "a.mov"), "w", options={"movflags": "use_metadata_tags"}) as container:
        container.metadata.update({"location": "+48.8584+002.2945/", "title": "take 3"})
        stream = container.add_stream("mpeg4", rate=24)
        stream.width = stream.height = 16
        frame = av.VideoFrame.from_ndarray(np.zeros((16, 16, 3), np.uint8), format="rgb24")
        for packet in [*stream.encode(frame), *stream.encode(None)]:
            container.mux(packet)
    _, tags, _ = read_tags(tmp_path / "a.mov")
    assert tags.get("title") == "take 3"
    assert not any(map(is_private, tags, tags.values()))
