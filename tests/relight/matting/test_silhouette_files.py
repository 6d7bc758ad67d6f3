"""The network that cuts people out is fetched piece by piece, and only if it is the published one."""

import hashlib
import http.server
import io
import os
import sys
import tarfile
import threading

import pytest

from relight.errors import DamagedFileError, MissingNetworksError
from relight.matting import silhouette_files

CONTENTS = os.urandom(2500)  # in pieces of 1,000 bytes
PIECES = [CONTENTS[start : start + 1000] for start in range(0, 2500, 1000)]
LICENCE = b"the licence"


def sha256(contents):
    return hashlib.sha256(contents).hexdigest()


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """The folder that the network goes to, of a published file of three small pieces; no npm is there."""
    monkeypatch.setenv("RELIGHT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    for name, value in {
        "PIECES": tuple(map(sha256, PIECES)),
        "PIECE_BYTES": 1000,
        "BYTES": 2500,
        "SHA256": sha256(CONTENTS),
        "OTHERS": {"ThirdPartyLicenses.json": (20, sha256(LICENCE))},
        "CONTENT_URL": "http://127.0.0.1:9",  # where nobody answers
    }.items():
        monkeypatch.setattr(silhouette_files, name, value)
    return tmp_path / "cache" / "person"


def package(path, pieces=PIECES, licence=LICENCE, names=None):
    """Write a package as npm's: the pieces in another order than theirs, and files that nobody wants."""
    names = names or [sha256(piece) for piece in pieces]
    with tarfile.open(path, "w:gz") as archive:
        entries = [*zip(names, pieces, strict=True)][::-1]
        for name, contents in [("program.js", b"alert(1)"), *entries, ("ThirdPartyLicenses.json", licence)]:
            entry = tarfile.TarInfo(f"package/dist/{name}")
            entry.size = len(contents)
            archive.addfile(entry, io.BytesIO(contents))
    return path


def test_a_package_is_unpacked_and_kept(tmp_path, cache):
    assert not silhouette_files.are_fetched()
    with pytest.raises(MissingNetworksError, match="relight fetch silhouette brings IS-Net"):
        silhouette_files.fetched()
    told = []
    assert silhouette_files.fetch(package(tmp_path / "p.tgz"), lambda *step: told.append(step)) == cache
    assert silhouette_files.fetched().read_bytes() == CONTENTS
    assert sorted(path.name for path in cache.iterdir()) == ["ThirdPartyLicenses.json", "isnet.onnx"]
    assert told[-1] == (2500, 2500, "Writing IS-Net")


def test_what_is_not_the_published_file_is_refused_and_leaves_nothing(tmp_path, cache):
    names = [sha256(piece) for piece in PIECES]
    wrong = [PIECES[0], b"x" * 1000, PIECES[2]]
    with pytest.raises(DamagedFileError, match="is not the one that was published"):
        silhouette_files.fetch(package(tmp_path / "wrong.tgz", wrong, names=names))
    with pytest.raises(DamagedFileError, match="pieces of IS-Net are missing; expected @imgly"):
        silhouette_files.fetch(package(tmp_path / "empty.tgz", []))
    with pytest.raises(DamagedFileError, match="is larger than expected"):
        silhouette_files.fetch(package(tmp_path / "large.tgz", [b"x" * 2000], names=names[:1]))
    with pytest.raises(DamagedFileError, match="is larger than expected"):
        silhouette_files.fetch(package(tmp_path / "licence.tgz", licence=b"x" * 30))
    (tmp_path / "text.tgz").write_text("no package")
    with pytest.raises(DamagedFileError, match=r"text\.tgz: expected the package @imgly"):
        silhouette_files.fetch(tmp_path / "text.tgz")
    whole = package(tmp_path / "whole.tgz").read_bytes()
    (tmp_path / "half.tgz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DamagedFileError, match=r"half\.tgz: expected the package"):
        silhouette_files.fetch(tmp_path / "half.tgz")
    with pytest.raises(FileNotFoundError, match="no such file"):
        silhouette_files.fetch(tmp_path / "none.tgz")
    assert not silhouette_files.are_fetched()


def test_a_licence_that_is_another_is_not_kept(tmp_path, cache):
    silhouette_files.fetch(package(tmp_path / "p.tgz", licence=b"another"))
    assert [path.name for path in cache.iterdir()] == ["isnet.onnx"]


def test_a_damaged_file_in_the_cache_is_said_and_fetched_again(tmp_path, cache):
    silhouette_files.fetch(package(tmp_path / "p.tgz"))
    (cache / "isnet.onnx").write_bytes(CONTENTS[:-1])
    with pytest.raises(DamagedFileError, match="relight fetch silhouette brings it again"):
        silhouette_files.fetched()
    silhouette_files.fetch(package(tmp_path / "p.tgz"))
    assert silhouette_files.fetched()


@pytest.fixture
def network(monkeypatch):
    """A content network of the pieces: those that it was asked for, and what it answers wrongly."""
    asked, broken = [], {}

    class Answers(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            name = self.path[1:]
            asked.append(name)
            if name not in map(sha256, PIECES):
                return self.send_error(404)
            self.send_response(200)
            self.end_headers()
            self.wfile.write(broken.get(name, PIECES[[*map(sha256, PIECES)].index(name)]))

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Answers) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        monkeypatch.setattr(silhouette_files, "CONTENT_URL", f"http://127.0.0.1:{server.server_port}")
        yield asked, broken
        server.shutdown()


def test_without_npm_the_pieces_come_from_the_content_network(cache, network):
    asked, _ = network
    silhouette_files.fetch()
    assert silhouette_files.fetched().read_bytes() == CONTENTS
    assert asked == [*map(sha256, PIECES)]
    silhouette_files.fetch()
    assert len(asked) == 3, "what is there is fetched again"


def test_an_interrupted_fetch_goes_on_where_it_stopped(cache, network):
    asked, broken = network
    broken[sha256(PIECES[1])] = b"torn"
    with pytest.raises(DamagedFileError, match="is not the one that was published"):
        silhouette_files.fetch()
    assert not silhouette_files.are_fetched()
    broken.clear()
    asked.clear()
    silhouette_files.fetch()
    assert asked == [*map(sha256, PIECES[1:])], "the first piece was there"
    assert silhouette_files.fetched().read_bytes() == CONTENTS


def test_without_a_network_it_says_why_and_what_to_do(cache):
    with pytest.raises(ConnectionError, match=r"could not download .*127\.0\.0\.1.*--from FILE"):
        silhouette_files.fetch()


def npm(tmp_path, script):
    """Install a program that stands for npm."""
    program = tmp_path / "bin" / "npm"
    program.parent.mkdir()
    program.write_text(f"#!{sys.executable}\nimport sys\n{script}\n")
    program.chmod(0o755)


@pytest.mark.skipif(sys.platform == "win32", reason="a script of Unix")
def test_npm_downloads_the_package_with_the_users_settings(tmp_path, cache):
    made = package(tmp_path / "made.tgz")
    npm(
        tmp_path,
        "import shutil; assert sys.argv[1:3] == ['pack', '@imgly/background-removal-data@1.4.5']\n"
        f"shutil.copy({str(made)!r}, sys.argv[sys.argv.index('--pack-destination') + 1] + '/p.tgz')",
    )
    told = []
    silhouette_files.fetch(progress=lambda *step: told.append(step))
    assert silhouette_files.fetched().read_bytes() == CONTENTS
    assert told[0][2] == "Downloading @imgly/background-removal-data 1.4.5"


@pytest.mark.skipif(sys.platform == "win32", reason="a script of Unix")
def test_where_npm_fails_the_content_network_is_asked(tmp_path, cache, network):
    npm(tmp_path, "print('npm error code E404\\nnpm error FetchError: no such registry'); sys.exit(1)")
    silhouette_files.fetch()
    assert silhouette_files.fetched()


@pytest.mark.skipif(sys.platform == "win32", reason="a script of Unix")
def test_both_reasons_are_said(tmp_path, cache):
    npm(tmp_path, "print('npm error code E404\\nnpm error FetchError: no such registry'); sys.exit(1)")
    with pytest.raises(ConnectionError, match=r"npm: FetchError: no such registry; 127\.0\.0\.1") as raised:
        silhouette_files.fetch()
    assert "\n" not in str(raised.value)


@pytest.mark.skipif(sys.platform != "linux", reason="/dev/full is of Linux")
def test_a_full_disk_is_said(tmp_path, cache):
    cache.mkdir(parents=True)
    (cache / ".isnet.onnx.part").symlink_to("/dev/full")
    with pytest.raises(OSError, match=r"isnet\.onnx: cannot be written: No space left"):
        silhouette_files.fetch(package(tmp_path / "p.tgz"))
    assert not silhouette_files.are_fetched()
