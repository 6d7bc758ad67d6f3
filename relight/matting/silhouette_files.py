"""The file of the network that cuts people out: fetched once, when asked for, and kept for all photographs.

It is IS-Net as ONNX, in pieces out of a package for npm, of which nothing is installed or run.
"""

import hashlib
import http.client
import os
import shutil
import subprocess
import tarfile
import tempfile
import time
import urllib.request
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO
from urllib.parse import urlsplit

from relight.errors import DamagedFileError, MissingNetworksError
from relight.matting.people.files import Progress, folder
from shadow.files import AnyPath, replacing

PACKAGE, VERSION = "@imgly/background-removal-data", "1.4.5"
NETWORK = "IS-Net"
ABOUT = f"{NETWORK} (Qin et al., ECCV 2022), 88 MB"
LICENCE = (
    "its package says MIT, its makers' Apache-2.0 is worded for code, their training data has terms for "
    "research; whether the weights may be used commercially is not settled, and is yours to decide"
)
COMMAND = "relight fetch silhouette"
FILE, BYTES = "isnet.onnx", 88_188_479
SHA256 = "b6e8497ba978a6f5fbb647e419d2696cd80df5a23cb6a8ea532021911bd76acb"
PIECE_BYTES = 4 << 20  # of each piece but the last one
PIECES = (  # the SHA-256 of each piece, which is its name in the package too
    "fe1b9f06af9d2147016884f4eb683d4dc540244a7453c3b742ae527725df2eec",
    "724543b36c7b5eddfbd7f55cb5a7c1676b2089c277611850c257efa42212d8a2",
    "f9290547b2e34555536647c1e2ca456348170eef1aee05d8fd522f5a051f260c",
    "897d4d8a3f9f8c07f439300a5d81c8be4b0fcecf19ca6d77929b1750fedd8306",
    "cbcda0a0c830ba51928e7935d9d3cfe1c4dc258bf117f2c76d047113ab8f9f8c",
    "4c44c8b64af9f044623ceace7cc55e0bc348394f7ff63629d46118c0a03c9c54",
    "8b2e3d773d7084c5cfac1c04d69d3586e4b8914a840d2b582dfde4940d698957",
    "024e3d8beaf517d25496b73e36b0e0498110652753273e0dd8b591ad7c1c9e2f",
    "1b8eaad4cd019b76e7eba964a38711a0bdeafbd10b6208c1107403a64dbd902a",
    "0c8c5c24237304482ccc70a50008b73c8ef53e4656068da32b635607cca0c8c9",
    "a5b8c519c832bc46b2ae5a9887fac1e3d5cc76a04846d8c3544875c7f2b40960",
    "7b1dd767c5c1c0156b8d13bb34d4c1d11e014723b10cddc25c93e89a28e7cd96",
    "3f5638267419916c9d4d906ff25f721d3d2e034851ea01566f0d2d6f943550b8",
    "9927e74b3a0638d4cf5701e78e66d77476a4ba68c75831f1c8ea9117ec7f8809",
    "3315eb3c14ca3ff5c03c80fac58f486a14264dd0bb9c168c096f2bd2531ba438",
    "230f667e0332dc09ef08aacbf1992c40ce112192f95dfc14231a3ef515f9a2c7",
    "e01a157b677e0e17815cd738dcda7e6daa268898d006b52b5d3604c439e6c96e",
    "529f1df7d027b0315090ba15d42ef32998cac2efd6783c62f6b11cedf4c548f3",
    "6cfd013f552a05e9fc81156e6d6de593668e0247a3970feae22e285c16d13e62",
    "3f31511c3c16a29cf81b32379f51ead2bd082677b48b1dcc11a66beeb37cc729",
    "01f6efcc8a01c727d99073ceede8e64c654fa3c4612b006e69e22dc663236943",
    "145d8355f50b7847de5d04815124790867fe1752a0013bdf6ce28882b5e0a2fc",
)
OTHERS = {  # files of the package that are kept beside the network: the largest size in bytes, the SHA-256
    "ThirdPartyLicenses.json": (1024, "edd2aae7f6a6b1c5351967593d9d639123063f1634c6fbdbcbdd51aa592ea50b"),
}
PACKAGE_BYTES = 136_455_985  # of the package as npm downloads it
MAX_UNPACKED = 1 << 30  # bytes of a package, unpacked, up to which it is read
CONTENT_URL = f"https://staticimgly.com/{PACKAGE}/{VERSION}/dist"  # the package's public content network
TIMEOUT, POLL = 30.0, 0.2  # seconds without an answer; between two looks at what npm has downloaded

Source = Callable[[set[str]], Iterator[tuple[str, bytes]]]  # of the pieces of these names


def are_fetched() -> bool:
    """Return whether the file is there, without reading it. Raises OSError as `person_files.folder` does."""
    return (folder() / FILE).is_file()


def fetched() -> Path:
    """Return the path of the network, whose contents have been checked.

    Raises MissingNetworksError if it was not fetched, DamagedFileError for another file than the published
    one.
    """
    path = folder() / FILE
    try:
        intact = _sha256(path) == SHA256
    except (FileNotFoundError, NotADirectoryError) as error:
        raise MissingNetworksError(f"matte: {COMMAND} brings {ABOUT}, which cuts people out") from error
    if not intact:
        raise DamagedFileError(f"{path}: is damaged; {COMMAND} brings it again")
    return path


def fetch(package: AnyPath | None = None, progress: Progress | None = None) -> Path:
    """Bring the network that cuts people out, and return the folder that keeps it.

    It is taken from `package`, the file `imgly-background-removal-data-1.4.5.tgz`; otherwise, unless it is
    there and intact, npm downloads the package to a temporary folder; without npm, or where that fails, the
    pieces come over HTTPS. Each piece is checked and kept at once, so that an interrupted fetch goes on after
    the last piece that is there. `progress` is called with what is done, of how much, in bytes, and words
    that say what is being done.

    Raises FileNotFoundError if there is no such package; DamagedFileError for a piece or a package that is
    not the published one; ConnectionError if it cannot be downloaded; OSError if the folder cannot be
    written.

    >>> from relight.matting import silhouette_files
    >>> silhouette_files.fetch()  # doctest: +SKIP
    PosixPath('/home/ada/.cache/relight/person')
    """
    report = progress or (lambda done, total, what: None)
    kept = folder()  # first: a download that cannot be kept is not begun
    kept.mkdir(parents=True, exist_ok=True)
    if package is not None:
        return _unpacked(Path(package), kept, report)
    with suppress(MissingNetworksError, DamagedFileError):
        return fetched().parent
    reasons = []
    if npm := shutil.which("npm"):
        with tempfile.TemporaryDirectory() as scratch:
            try:
                return _unpacked(_packed(npm, Path(scratch), report), kept, report)
            except ConnectionError as error:
                reasons.append(str(error))
    try:
        return _assembled(kept, _downloaded, report)
    except ConnectionError as error:
        reasons.append(str(error))
    raise ConnectionError(
        f"{COMMAND}: could not download {PACKAGE} {VERSION}: {'; '.join(reasons)}; or bring the package "
        f"(npm pack {PACKAGE}@{VERSION}) from elsewhere and name it: {COMMAND} --from FILE"
    )


def _unpacked(package: Path, kept: Path, report: Progress) -> Path:
    """Take the network and its licences out of a package."""
    if not package.is_file():
        raise FileNotFoundError(f"{package}: no such file")
    others: dict[str, bytes] = {}

    def pieces(wanted: set[str]) -> Iterator[tuple[str, bytes]]:
        limits = dict.fromkeys(wanted, PIECE_BYTES) | {name: size for name, (size, _) in OTHERS.items()}
        for name, contents in _members(package, limits):
            if name in OTHERS:
                others[name] = contents
            else:
                yield name, contents

    try:
        _assembled(kept, pieces, report)
    except (tarfile.TarError, zlib.error, EOFError) as error:
        raise DamagedFileError(f"{package}: expected the package {PACKAGE} {VERSION}: {error}") from error
    for name, contents in others.items():
        if hashlib.sha256(contents).hexdigest() == OTHERS[name][1]:
            with replacing(kept / name) as temporary:
                temporary.write_bytes(contents)
    return kept


def _members(package: Path, limits: dict[str, int]) -> Iterator[tuple[str, bytes]]:
    """Yield the name and the contents of the files of a package that have a limit; none may be larger."""
    unpacked = 0
    with tarfile.open(package, "r|gz") as archive:
        for member in archive:
            unpacked += member.size
            name = Path(member.name).name
            if unpacked > MAX_UNPACKED or (name in limits and member.size > limits[name]):
                raise DamagedFileError(f"{package}: {member.name!r} is larger than expected")
            if member.isfile() and name in limits:
                file = archive.extractfile(member)
                assert file is not None
                yield name, file.read()


def _assembled(kept: Path, source: Source, report: Progress) -> Path:
    """Write the pieces that are not there yet, from a source of them, and name the file when it is whole."""
    beside, target = kept / f".{FILE}.part", kept / FILE
    try:
        beside.touch()
        with beside.open("r+b") as file:
            places = dict(_missing(file))
            for name, contents in source(set(places)):
                if name not in places:
                    continue
                if hashlib.sha256(contents).hexdigest() != name:
                    raise DamagedFileError(
                        f"{COMMAND}: the piece {name[:12]}… is not the one that was published"
                    )
                file.seek(places.pop(name))
                file.write(contents)
                report(BYTES - len(places) * PIECE_BYTES, BYTES, f"Writing {NETWORK}")
            if places:
                raise DamagedFileError(
                    f"{COMMAND}: {len(places)} pieces of {NETWORK} are missing; expected {PACKAGE} {VERSION}"
                )
            os.fsync(file.fileno())
        if _sha256(beside) != SHA256:
            raise DamagedFileError(f"{COMMAND}: the pieces do not make the file that was published")
        os.replace(beside, target)
    except OSError as error:
        if isinstance(error, ConnectionError) or error.errno is None:
            raise
        raise OSError(error.errno, f"{target}: cannot be written: {error.strerror}") from error
    return kept


def _missing(file: BinaryIO) -> Iterator[tuple[str, int]]:
    """Yield the names and the places of the pieces that a file does not hold yet."""
    for number, name in enumerate(PIECES):
        file.seek(number * PIECE_BYTES)
        if hashlib.sha256(file.read(PIECE_BYTES)).hexdigest() != name:
            yield name, number * PIECE_BYTES


def _downloaded(wanted: set[str]) -> Iterator[tuple[str, bytes]]:
    """Yield pieces from the package's public content network."""
    for name in (name for name in PIECES if name in wanted):
        try:
            with urllib.request.urlopen(f"{CONTENT_URL}/{name}", timeout=TIMEOUT) as answer:
                yield name, answer.read(PIECE_BYTES)
        except (OSError, http.client.HTTPException) as error:  # URLError and time-outs are of OSError
            reason = getattr(error, "reason", None) or error
            raise ConnectionError(f"{urlsplit(CONTENT_URL).hostname}: {reason}") from error


def _packed(npm: str, scratch: Path, report: Progress) -> Path:
    """Download the package by npm, which knows the user's registry, proxy and certificates."""
    what = f"Downloading {PACKAGE} {VERSION}"
    words = [npm, "pack", f"{PACKAGE}@{VERSION}", "--pack-destination", str(scratch)]
    words += [
        "--cache",
        str(scratch / "cache"),
        "--ignore-scripts",
        "--loglevel",
        "error",
        "--no-update-notifier",
    ]
    with (
        (scratch / "log").open("w+", errors="replace") as log,
        subprocess.Popen(words, cwd=scratch, stdout=log, stderr=log, stdin=subprocess.DEVNULL) as process,
    ):
        try:
            while process.poll() is None:  # npm tells nothing: what it has downloaded is in its cache
                cached = sum(path.stat().st_size for path in (scratch / "cache").rglob("*") if path.is_file())
                report(min(cached, PACKAGE_BYTES), PACKAGE_BYTES, what)
                time.sleep(POLL)
        except BaseException:
            process.kill()
            raise
        log.seek(0)
        lines = [line.strip() for line in log if line.strip()]
    packages = [*scratch.glob("*.tgz")]
    if process.returncode or len(packages) != 1:
        errors = [line for line in lines if "Error:" in line] or lines or ["no reason given"]
        raise ConnectionError(f"npm: {errors[0].removeprefix('npm error ')}")
    return packages[0]


def _sha256(path: Path) -> str:
    """Return the SHA-256 of a file, which is read in parts."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
