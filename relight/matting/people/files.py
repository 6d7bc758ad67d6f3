"""The files of the two networks that find people: fetched once, when asked for, and kept for all photographs.

They are MediaPipe's (Apache-2.0), and are taken out of its package for Python, of which nothing is installed
or run. Newer packages do not hold them.
"""

import hashlib
import importlib.metadata
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from relight.errors import DamagedFileError, MissingNetworksError
from shadow.files import AnyPath, replacing

PACKAGE, VERSION = "mediapipe", "0.10.14"
NETWORKS = "MediaPipe's pose networks"
ABOUT = f"{NETWORKS} (Apache-2.0), 9.4 MB out of a package of 36 MB"
COMMAND = "relight fetch person"
FILES = {  # file: its place in the package, its SHA-256
    "pose_detection.tflite": (
        "mediapipe/modules/pose_detection/pose_detection.tflite",
        "9ba9dd3d42efaaba86b4ff0122b06f29c4122e756b329d89dca1e297fd8f866c",
    ),
    "pose_landmark_full.tflite": (
        "mediapipe/modules/pose_landmark/pose_landmark_full.tflite",
        "e9a5c5cb17f736fafd4c2ec1da3b3d331d6edbe8a0d32395855aeb2cdfd64b9f",
    ),
}
LICENCE = f"{PACKAGE}-{VERSION}.dist-info/LICENSE"
RAW_PROGRESS = (24, 1)  # the first version of pip that prints bytes
MAX_LICENCE_BYTES = 1 << 20
MAX_BYTES = 64 << 20  # of a file in the package; the largest has 6.4 MB

Progress = Callable[[int, int, str], None]


def folder() -> Path:
    """Return the folder in the user's cache where the files are kept; it need not exist.

    It is in `$RELIGHT_CACHE` if that is set; otherwise in `$XDG_CACHE_HOME/relight` or `~/.cache/relight`,
    on macOS in `~/Library/Caches/relight`, on Windows in `%LOCALAPPDATA%\\relight`. Raises OSError if the
    user has no such folder.
    """
    if chosen := os.environ.get("RELIGHT_CACHE"):
        return Path(chosen).absolute() / "person"
    variable = "LOCALAPPDATA" if os.name == "nt" else "XDG_CACHE_HOME"
    named = os.environ.get(variable, "")
    if Path(named).is_absolute():
        return Path(named) / "relight" / "person"
    try:
        home = Path.home()
    except RuntimeError:
        home = Path()
    if not home.is_absolute():
        raise OSError("the user has no home folder, to keep the networks in: set RELIGHT_CACHE to a folder")
    caches = (
        "Library/Caches" if sys.platform == "darwin" else "AppData/Local" if os.name == "nt" else ".cache"
    )
    return home / caches / "relight" / "person"


def are_fetched() -> bool:
    """Return whether both files are there, without reading them. Raises as `folder` does."""
    return all((folder() / name).is_file() for name in FILES)


def fetched() -> tuple[Path, Path]:
    """Return the paths of the detector and of the landmark network, whose contents have been checked.

    Raises MissingNetworksError for a file that was not fetched, DamagedFileError for another than the
    published one.
    """
    paths = [folder() / name for name in FILES]
    for path, (_, sha256) in zip(paths, FILES.values(), strict=True):
        try:
            contents = path.read_bytes()
        except (FileNotFoundError, NotADirectoryError) as error:
            raise MissingNetworksError(
                f"matte: the networks that find the person are missing: {COMMAND} brings them ({ABOUT}), "
                "once; or give the person's matte (mask=FILE), name a matting model (matte=MODEL), or "
                "key the person from a screen (key=green)"
            ) from error
        if hashlib.sha256(contents).hexdigest() != sha256:
            raise DamagedFileError(f"{path}: is damaged; {COMMAND} brings it again")
    return paths[0], paths[1]


def fetch(wheel: AnyPath | None = None, progress: Progress | None = None) -> Path:
    """Bring the files of the networks that find people, and return the folder that keeps them.

    They are taken from `wheel`, `mediapipe-0.10.14-….whl` of any system; otherwise, unless they are there
    and intact, pip downloads it to a temporary folder. `progress` is called with what is done, of how much,
    in bytes, and words that say what is being done.

    Raises FileNotFoundError if there is no such wheel; DamagedFileError if it is none, or does not hold the
    files that were published; OSError if pip is missing or cannot download it, or the folder cannot be
    written.

    >>> from relight.matting.people import files as person_files
    >>> person_files.fetch()  # doctest: +SKIP
    PosixPath('/home/ada/.cache/relight/person')
    """
    report = progress or (lambda done, total, what: None)
    kept = folder()  # first: a download that cannot be kept is not begun
    kept.mkdir(parents=True, exist_ok=True)
    if wheel is not None:
        return _unpacked(Path(wheel), kept)
    with suppress(MissingNetworksError, DamagedFileError):
        return fetched()[0].parent
    with tempfile.TemporaryDirectory() as scratch:
        return _unpacked(_downloaded(Path(scratch), report), kept)


def _unpacked(wheel: Path, kept: Path) -> Path:
    """Take the files out of a wheel; nothing is kept unless both are those that were published."""
    if not wheel.is_file():
        raise FileNotFoundError(f"{wheel}: no such file")
    contents = {}
    try:
        with zipfile.ZipFile(wheel) as archive:
            for name, (place, sha256) in FILES.items():
                if archive.getinfo(place).file_size > MAX_BYTES:
                    raise DamagedFileError(f"{wheel}: {place} is larger than expected")
                contents[name] = archive.read(place)
                if hashlib.sha256(contents[name]).hexdigest() != sha256:
                    raise DamagedFileError(f"{wheel}: {place} is not the file that was published")
            if archive.getinfo(LICENCE).file_size > MAX_LICENCE_BYTES:
                raise DamagedFileError(f"{wheel}: {LICENCE} is larger than expected")
            licence = archive.read(LICENCE)
    except KeyError as error:
        raise DamagedFileError(
            f"{wheel}: does not hold the networks; expected a wheel of {PACKAGE} {VERSION}"
        ) from error
    except (zipfile.BadZipFile, EOFError, NotImplementedError) as error:
        raise DamagedFileError(f"{wheel}: expected a wheel of {PACKAGE} {VERSION}: {error}") from error
    for name, each in {"LICENSE": licence, **contents}.items():
        with replacing(kept / name) as temporary:
            temporary.write_bytes(each)
    return kept


def _downloaded(scratch: Path, report: Progress) -> Path:
    """Download the wheel by pip, which knows the user's index, proxy and certificates."""
    try:
        version = tuple(int(part) for part in re.findall(r"\d+", importlib.metadata.version("pip"))[:2])
    except importlib.metadata.PackageNotFoundError as error:
        raise FileNotFoundError(
            f"{COMMAND}: this Python has no pip to download with; download a wheel of {PACKAGE} {VERSION} "
            f"from pypi.org and name it: {COMMAND} --wheel FILE"
        ) from error
    words = [sys.executable, "-m", "pip", "download", f"{PACKAGE}=={VERSION}", "--no-deps", "--dest", "."]
    words += ["--only-binary", ":all:", "--python-version", "3.12", "--platform", "manylinux2014_x86_64"]
    words += ["--no-input", "--disable-pip-version-check"]
    words += ["--progress-bar", "raw" if version >= RAW_PROGRESS else "off"]
    what = f"Downloading {PACKAGE} {VERSION}"
    report(0, 0, what)
    lines: list[str] = []
    with subprocess.Popen(
        words, cwd=scratch, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    ) as process:
        try:
            for line in process.stdout or ():
                bytes_of = re.fullmatch(r"Progress (\d+) of (\d+)\s*", line)
                if bytes_of:
                    report(int(bytes_of[1]), int(bytes_of[2]), what)
                elif line.strip():
                    lines.append(line.strip())
        except BaseException:
            process.kill()
            raise
    wheels = [*scratch.glob("*.whl")]
    if process.returncode or len(wheels) != 1:
        errors = [line for line in lines if line.startswith("ERROR")]
        reason = (errors or lines or ["no reason given"])[-1]
        raise ConnectionError(
            f"{COMMAND}: pip could not download {PACKAGE} {VERSION}: {reason}; or download the wheel "
            f"elsewhere and name it: {COMMAND} --wheel FILE"
        )
    return wheels[0]
