"""What the server keeps and whom it answers, without a browser."""

import asyncio

import pytest

pytest.importorskip("starlette")
pytest.importorskip("uvicorn")

from helpers.guarded import status

from relight.app.answers import while_connected
from relight.app.session import PICTURES, Session, checked_name
from relight.app.worker import Refused


@pytest.fixture
def session(tmp_path):
    (tmp_path / "root" / "sub").mkdir(parents=True)
    (tmp_path / "root" / "a.jpg").write_bytes(b"picture")
    (tmp_path / "root" / "sub" / "b.exr").write_bytes(b"picture")
    (tmp_path / "root" / "notes.txt").write_bytes(b"text")
    (tmp_path / "outside.jpg").write_bytes(b"private")
    (tmp_path / "root" / "link.jpg").symlink_to(tmp_path / "outside.jpg")
    found = Session(tmp_path / "root")
    yield found
    found.close()


def test_requests_need_the_token_this_host_and_no_other_origin():
    assert status() == 200
    assert status(host="localhost:8000", origin="http://localhost:8000") == 200
    for path in ("/", "/secret-toke/", "/secret-token2/", "//secret-token/", "/session"):
        assert status(path) == 403
    assert status(host="rebound.example:8000") == 403  # a name that was made to point here
    assert status(host="127.0.0.1:9999") == 403
    assert status(host="") == 403
    for origin in ("http://other.example", "null", "http://localhost:8000", "https://127.0.0.1:8000"):
        assert status(origin=origin) == 403


def test_files_of_the_root_alone_can_be_taken(session, tmp_path):
    assert set(session.in_root()) == {"a.jpg", "link.jpg", "sub/b.exr"}
    assert session.copy_from_root("sub/b.exr").name == "b.exr"
    for path in (
        "../outside.jpg",
        "link.jpg",
        str(tmp_path / "outside.jpg"),
        "sub/../../outside.jpg",
        "a\0.jpg",
    ):
        with pytest.raises(Refused, match="not in the folder"):
            session.copy_from_root(path)
    with pytest.raises(Refused, match=r"none.jpg: no longer exists"):
        session.copy_from_root("none.jpg")
    with pytest.raises(Refused, match=r"notes.txt: expected a JPEG"):
        session.copy_from_root("notes.txt")
    assert len(session.photographs) == 1


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("me.jpg", "me.jpg"),
        ("../../etc/me.JPG", "me.JPG"),
        ("C:\\photos\\me.png", "me.png"),
        ("-o.png", "o.png"),
        ("shot.%04d.exr", "shot._04d.exr"),
        ("shot.####.exr", "shot.____.exr"),
        ("a\nb.tif", "ab.tif"),
        (".jpg.jpg", "jpg.jpg"),
        ("x" * 400 + ".jpeg", "x" * 115 + ".jpeg"),
        ("\u5199" * 100 + ".jpg", "\u5199" * 38 + ".jpg"),  # file systems count bytes
        ("caf\udce9.jpg", "caf_.jpg"),
    ],
)
def test_names_are_what_commands_and_file_systems_can_have(given, kept):
    assert checked_name(given, PICTURES) == kept


def test_files_of_one_name_are_lent_side_by_side(session):
    photograph = session.new_photograph("me.jpg")
    (photograph.folder / "me.jpg").write_bytes(b"me")
    (photograph.folder / "me-relit.png").write_bytes(b"saved")
    lent = {}
    for name, content in (("studio.jpg", b"sky"), ("studio.jpg", b"street"), ("me-relit.png", b"back")):
        identity, path = session.new_file(name, PICTURES)
        path.write_bytes(content)
        lent[identity] = content
    for _ in range(2):
        names = [session.lend(identity, photograph) for identity in lent]
        assert names == ["studio.jpg", "studio-2.jpg", "me-relit-2.png"]
        assert [(photograph.folder / name).read_bytes() for name in names] == list(lent.values())
    assert (photograph.folder / "me-relit.png").read_bytes() == b"saved"
    identity, path = session.new_file("me.jpg", PICTURES)
    path.write_bytes(b"me")  # the photograph itself, as its own background
    assert session.lend(identity, photograph) == "me.jpg"
    for name in (
        "me.jpg",
        "me-matte.png",
        "me-relit.jpg",
    ):  # nothing that is written later is written over it
        identity, path = session.new_file(name, PICTURES)
        path.write_bytes(b"another")
        assert session.lend(identity, photograph) == name.replace(".", "-2.")


@pytest.mark.parametrize("stays", [True, False])
def test_work_ends_when_the_page_goes_away(stays):
    ended = []

    class Asked:
        async def is_disconnected(self):
            return not stays

    async def work():
        try:
            await asyncio.sleep(1)
            return "done"
        except asyncio.CancelledError:
            ended.append(True)
            raise

    if stays:
        assert asyncio.run(while_connected(Asked(), work())) == "done"
    else:
        with pytest.raises(Refused, match="gone away"):
            asyncio.run(while_connected(Asked(), work()))
    assert ended == ([] if stays else [True])


@pytest.mark.parametrize("given", ["", "photo", "photo.svg", "photo.jpg.html", "..", "photo.jpg/"])
def test_names_of_no_picture_are_refused(given):
    with pytest.raises(Refused, match="expected a JPEG"):
        checked_name(given, PICTURES)


async def chunks(*parts):
    for part in parts:
        yield part


def test_uploads_are_bounded_in_size_and_number(session, tmp_path, monkeypatch):
    monkeypatch.setattr("relight.app.session.UPLOAD_BYTES", 10)
    monkeypatch.setattr("relight.app.session.PHOTOGRAPHS", 2)
    asyncio.run(session.receive(chunks(b"1234", b"5678"), tmp_path / "a.jpg"))
    assert (tmp_path / "a.jpg").read_bytes() == b"12345678"
    with pytest.raises(Refused, match=r"b.jpg: is larger than"):
        asyncio.run(session.receive(chunks(b"1234", b"5678", b"901"), tmp_path / "b.jpg"))
    with pytest.raises(Refused, match=r"c.jpg: is empty"):
        asyncio.run(session.receive(chunks(), tmp_path / "c.jpg"))
    monkeypatch.setattr("relight.app.session.SESSION_BYTES", 2)
    with pytest.raises(Refused, match="session is full"):
        asyncio.run(session.receive(chunks(b"123"), tmp_path / "d.jpg"))
    session.new_photograph("a.jpg")
    session.new_photograph("b.jpg")
    with pytest.raises(Refused, match="2 photographs are open"):
        session.new_photograph("c.jpg")


def test_a_full_disk_is_said_without_a_path(session):
    with pytest.raises(Refused, match="No space left on device") as refused:
        asyncio.run(session.receive(chunks(b"x" * 100000), _Full()))
    assert "/" not in str(refused.value)


class _Full:
    """A path on a disk that is full."""

    name = "a.jpg"

    def open(self, mode):
        return open("/dev/full", "wb", buffering=0)


def test_the_folder_goes_when_the_session_ends(session):
    photograph = session.new_photograph("a.jpg")
    assert photograph.folder.is_dir()
    session.close()
    assert not session.folder.exists()
