"""Requests to the server that are wrong or end early, and what stays of them: no browser and no worker."""

import asyncio
import functools
import itertools
import os
import re
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
import tifffile
from helpers import ROOT
from helpers.clothed import clothed
from PIL import Image

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")

from starlette.requests import Request

import relight
from relight.app import tasks, worker
from relight.app.answers import refusing
from relight.app.server import VIEWER_NAMES, Server
from relight.app.session import Session
from relight.app.worker import Refused, Worker


class Refusing:
    """A worker that refuses everything."""

    async def run(self, *given, **options):
        raise Refused("is damaged")


@pytest.fixture
def session(tmp_path):
    found = Session(tmp_path)
    yield found
    found.close()


def answer(session, endpoint, body=b"", ends=False, worker=None, **path):
    """The status of a request; `ends`: the page goes away before its body has come.

    `endpoint`: the method's name, and the task that it takes.
    """
    parts = [{"type": "http.request", "body": body, "more_body": ends}, {"type": "http.disconnect"}]

    async def receive():
        return parts.pop(0)

    scope = {
        "type": "http", "method": "POST", "path": "/", "headers": [], "query_string": b"name=sky.exr",
        "path_params": path,
    }  # fmt: skip
    name, *task = endpoint.split()
    wrapped = refusing(functools.partial(getattr(Server(session, worker or Refusing()), name), *task))
    return asyncio.run(wrapped(Request(scope, receive)))


def size(folder):
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize(
    ("endpoint", "ends"),
    [  # a model is read when it is used, and not refused before
        *itertools.product(["add", "surroundings environment", "surroundings background"], [False, True]),
        ("add_model", True),
    ],
)
def test_nothing_stays_of_an_upload_that_is_refused_or_ends_early(session, endpoint, ends):
    found = answer(session, endpoint, b"x" * 100_000, ends)
    assert found.status_code in ((499, 415) if ends else (422,))
    assert size(session.folder) == 0
    assert not session.photographs


@pytest.mark.parametrize("body", [b"[" * 100_000, b"{", b"[]", b'{"drawn": [1]}', b'{"drawn": 5}', b"\xff"])
def test_json_that_means_nothing_is_refused(session, body):
    photograph = session.new_photograph("a.png")
    photograph.about = {"cut_out": False}
    assert answer(session, "analyse", body, id=photograph.id).status_code in (400, 422)


@pytest.mark.parametrize("look", [b"[1]", b"3", b'{"environment": 4}', b'{"background": {}}', b'"x"'])
def test_looks_that_mean_nothing_are_refused(session, look):
    photograph = session.new_photograph("a.png")
    photograph.scene = {}
    body = b'{"suffix": ".png", "look": ' + look + b"}"
    assert answer(session, "save", body, id=photograph.id).status_code in (400, 404)


@pytest.mark.parametrize(
    "drawn", [{"strokes": [{}]}, {"strokes": 5}, {"lasso": {"a": 1}}, {"strokes": [[1]]}, {"lasso": "1/2"}]
)
def test_drawings_that_mean_nothing_are_a_sentence(tmp_path, drawn, capfd):
    np.save(tmp_path / tasks.REDUCED, np.zeros((20, 20, 3), np.float16))

    class Wire:
        def send(self, what):
            pass

    before = os.getcwd()
    try:
        kind, said = worker.answer_to(tasks, "outline_of", str(tmp_path), {"drawn": drawn}, Wire())
    finally:
        os.chdir(before)
    assert kind == "refused"
    assert said != worker.DEFECT
    assert not capfd.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="names are Unicode there")
@pytest.mark.parametrize(
    ("name", "quoted"),
    [
        (b"caf\xe9.jpg", b"caf%E9.jpg"),  # Latin-1, as old archives have it
        (b"\x8e\xca\x90^.png", b"%8E%CA%90%5E.png"),  # Shift JIS
        (b"f\xfches/me.tif", b"f%FChes/me.tif"),  # a folder
        ("ca\u0301fe %41.jpg".encode(), b"ca%CC%81fe%20%2541.jpg"),
    ],
)
def test_names_in_the_root_that_are_no_utf8_can_be_chosen(session, tmp_path, name, quoted):
    place = os.fsencode(tmp_path) + b"/" + name
    try:
        os.makedirs(os.path.dirname(place), exist_ok=True)
        with open(place, "wb") as file:
            file.write(b"x")
    except OSError:
        pytest.skip("this file system has none")
    found = answer(session, "about")
    assert found.status_code == 200
    assert quoted in found.body
    chosen = answer(session, "add_from_root", b'{"path": "' + quoted + b'"}')
    assert chosen.status_code == 422  # by the worker
    assert not session.photographs


def bomb(path, width, height):
    """A PNG of one bit a pixel that has none of its pixels: it cannot be decoded."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = zlib.compress(b"")
    header = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    signature = b"\x89PNG\r\n\x1a\n"
    path.write_bytes(signature + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b""))


@pytest.mark.parametrize("task", ["read", "environment", "background"])
def test_pictures_of_too_many_pixels_are_refused_before_they_are_decoded(tmp_path, here, task):
    bomb(tmp_path / "sky.png", 200, 100)
    spec = oiio.ImageSpec(8, 8, 3, "half")
    spec.full_width = spec.full_height = 1000  # the display window is what is allocated
    out = oiio.ImageOutput.create("w.exr")
    out.open("w.exr", spec)
    out.write_image(np.ones((8, 8, 3), np.float32))
    out.close()
    Path("w.exr").write_bytes(Path("w.exr").read_bytes()[:-8])  # nor can this one
    relight.media.images.limit_pixels(10_000)
    try:
        for name in ("sky.png", "w.exr"):
            with pytest.raises(ValueError, match="pixels; expected"):
                getattr(tasks, task)(name, lambda what: None)
    finally:
        relight.media.images.limit_pixels(None)


def anamorphic(path):
    spec = oiio.ImageSpec(60, 60, 3, "half")
    spec.attribute("PixelAspectRatio", 10.0)
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), spec)
    out.write_image(np.ones((60, 60, 3), np.float32))
    out.close()


def after_a_reduced_page(path):
    with tifffile.TiffWriter(path) as file:
        for side, reduced in ((8, 1), (50, 0)):
            file.write(np.zeros((side, side, 3), np.uint8), photometric="rgb", subfiletype=reduced)


def sphere(path):
    """A part of a photo sphere of 800 x 400 pixels."""
    stated = {
        "FullPanoWidthPixels": 800, "FullPanoHeightPixels": 400, "CroppedAreaImageWidthPixels": 80,
        "CroppedAreaImageHeightPixels": 40, "CroppedAreaLeftPixels": 0, "CroppedAreaTopPixels": 0,
    }  # fmt: skip
    xmp = "<x " + " ".join(f'GPano:{name}="{value}"' for name, value in stated.items()) + "/>"
    Image.new("RGB", (80, 40)).save(path, xmp=xmp.encode())


@pytest.mark.parametrize(
    ("name", "write", "task", "most"),
    [
        ("wide.exr", anamorphic, "read", 10_000),
        ("wide.exr", anamorphic, "background", 10_000),
        ("pages.tif", after_a_reduced_page, "read", 1000),
        ("pages.tif", after_a_reduced_page, "load_matte", 1000),
        ("sphere.jpg", sphere, "environment", 10_000),
    ],
)
def test_pixels_that_a_header_does_not_tell_are_limited_as_well(tmp_path, here, name, write, task, most):
    """The worker's process refuses what becomes large after its first header: see `worker._serve`."""
    write(tmp_path / name)
    relight.media.images.limit_pixels(most)
    try:
        with pytest.raises(ValueError, match=rf"{name}: .*pixels; expected 0 million at most"):
            getattr(tasks, task)(name, lambda what: None)
    finally:
        relight.media.images.limit_pixels(None)


@pytest.fixture
def at_home(monkeypatch):
    """Gives the user a home."""
    return lambda folder: monkeypatch.setenv("HOME", folder)


@pytest.mark.parametrize("home", ["/", "//", "", ".", None])
def test_a_home_that_is_none_is_no_reason_to_fail(home, at_home, monkeypatch):
    def at():
        raise RuntimeError("Could not determine home directory.")

    if home is None:
        monkeypatch.setattr(worker.Path, "home", at)
    else:
        at_home(home)
    assert worker.as_sentence("colour: expected 1/0.9/0.8.", "/tmp/x") == "colour: expected 1/0.9/0.8."


@pytest.mark.parametrize("home", ["/home/ada", "/home/ada/", "/h"])
def test_sentences_have_no_home_and_no_other_folder_is_one(home, at_home):
    at_home(home)
    place = home.rstrip("/")
    said = worker.as_sentence(f"{place}/a.png: see {place}vance/b.png and half{place}", "/tmp/x")
    assert said == f"~/a.png: see {place}vance/b.png and half{place}"


@pytest.mark.parametrize(
    ("task", "arguments"),
    [
        ("outline_of", {"drawn": "x" * 5_000_000}),
        ("analyse", {"drawn": {"strokes": [{"points": [[0.5, 0.5]] * 200_000}]}}),
        ("save", {"look": {"lights": [f"light{number}:azimuth=10" for number in range(200_000)]}}),
    ],
)
def test_a_large_request_does_not_stop_the_server(task, arguments):
    """The process takes nothing from its pipe, as while it is busy, and the server still answers."""
    stuck = Worker()
    sending = asyncio.Event()

    async def main():
        from multiprocessing import Pipe

        ours, theirs = Pipe()
        stuck._connection = ours
        stuck.start = lambda: None
        stuck.stop = theirs.close
        job = asyncio.ensure_future(stuck.run(task, "/tmp", arguments))
        for _ in range(3):
            await asyncio.sleep(0.01)  # the loop goes on
        assert not job.done()
        sending.set()
        theirs.close()
        with pytest.raises(Refused):
            await job
        ours.close()

    asyncio.run(asyncio.wait_for(main(), 60))
    assert sending.is_set()


def test_a_photograph_that_was_removed_comes_back_until_the_next_one_goes(session):
    first, second = session.new_photograph("a.jpg"), session.new_photograph("b.jpg")
    (first.folder / "a.jpg").write_bytes(b"first")
    assert answer(session, "remove", id=first.id).status_code == 200
    assert [*session.photographs] == [second.id]
    assert answer(session, "bring_back", id=first.id).status_code == 200
    assert (session.photograph(first.id).folder / "a.jpg").read_bytes() == b"first"
    assert answer(session, "bring_back", id=first.id).status_code == 404
    session.remove(first)
    session.remove(second)
    assert not first.folder.exists()
    with pytest.raises(Refused, match="drop it again"):
        session.bring_back(first.id)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="has no SIGHUP")
@pytest.mark.parametrize("signals", [["SIGHUP"], ["SIGTERM"], ["SIGINT"], ["SIGHUP", "SIGHUP", "SIGTERM"]])
def test_a_closed_terminal_leaves_nothing_behind(tmp_path, signals):
    import signal
    import urllib.request

    from helpers.serving import served

    Image.fromarray(np.full((40, 30, 4), 90, np.uint8)).save(tmp_path / "a.png")
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    with served(TMPDIR=str(temporary)) as (address, process):
        post = urllib.request.Request(
            f"{address}photographs?name=a.png", (tmp_path / "a.png").read_bytes(),
            {"Origin": address[: address.index("/", 8)]}, method="POST",
        )  # fmt: skip
        with urllib.request.urlopen(post, timeout=120) as said:
            assert said.status == 200
        assert [*temporary.glob("relight-app-*/photographs/*/a.png")]
        for name in signals:
            process.send_signal(getattr(signal, name))
        process.wait(60)
    assert not [*temporary.glob("relight-app-*")]


def test_a_file_that_something_else_removed_is_a_sentence(session):
    """A program that cleans temporary folders up, or a tab that removed the photograph meanwhile."""
    photograph = session.new_photograph("a.png")
    photograph.about, photograph.scene = {"preview": "none.jpg"}, {}
    photograph.outputs.add("a-relit.png")
    for endpoint, path in (("preview", {}), ("pack", {}), ("download", {"name": "a-relit.png"})):
        found = answer(session, endpoint, id=photograph.id, **path)
        assert found.status_code == 404, endpoint
        assert b"drop the photograph again" in found.body


@pytest.mark.skipif(sys.platform == "win32", reason="has no such limit")
@pytest.mark.parametrize("task", ["read", "outline_of", "load_matte", "analyse", "save"])
def test_a_full_disk_is_a_sentence_in_every_step(tmp_path, task, monkeypatch):
    """Files can have no more than 100 bytes, which ends each write as a full disk does."""
    import resource
    import signal

    # CPython 3.11 keeps what the limit leaves of bytecode, which no process can import later.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    plate, matte = clothed(seed=1)
    codes = (np.dstack([np.clip(plate[..., :3], 0, 1), matte]) * 255).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "a.png")
    Image.fromarray(codes[..., 3]).save(tmp_path / "matte.png")
    look = {"lights": ["key:azimuth=-40"]}
    drawn = {"lasso": [[0.1, 0.1], [0.9, 0.1], [0.5, 0.9]]}
    arguments = {
        "read": {"name": "a.png"}, "outline_of": {"drawn": drawn}, "load_matte": {"name": "matte.png"},
        "analyse": {"name": "a.png", "mask": None, "drawn": None},
        "save": {"name": "a.png", "mask": None, "look": look, "output": "a-relit.png", "passes": []},
    }  # fmt: skip

    class Wire:
        def send(self, what):
            pass

    def ask(name):
        return worker.answer_to(tasks, name, str(tmp_path), arguments[name], Wire())

    before, limit = os.getcwd(), resource.getrlimit(resource.RLIMIT_FSIZE)
    old = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        assert ask("read")[0] == "done"
        held = {path.name for path in tmp_path.iterdir()}
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, limit[1]))
        kind, said = ask(task)
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        if task != "outline_of":  # writes nothing
            assert kind == "refused", said
            assert said not in (worker.DEFECT, worker.STOPPED)
            assert str(tmp_path) not in said
        assert not {path.name for path in tmp_path.iterdir()} - held, "half a file stays"
        assert ask(task)[0] == "done"  # when there is room again
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        signal.signal(signal.SIGXFSZ, old)
        os.chdir(before)


def test_the_page_is_given_what_it_takes_from_the_viewer():
    """One name that is missing would leave an empty page."""
    web, taken = ROOT / "relight" / "app" / "web", set()
    for file in web.glob("*.js"):
        for names in re.findall(r'import \{([^}]*)\} from "\.\./viewer\.js"', file.read_text()):
            taken |= {name.split(" as ")[0].strip() for name in names.split(",") if name.strip()}
    assert taken == set(VIEWER_NAMES)
