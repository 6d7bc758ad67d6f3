"""What the server keeps while it runs: photographs and other files, in a folder removed when it stops."""

import filecmp
import os
import re
import secrets
import shutil
import tempfile
from collections.abc import AsyncIterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from relight.app.messages import Answer, Drawing, PersonOutline
from relight.app.worker import Refused
from relight.media.images.read_image import READ as PICTURES
from relight.media.movies.read_movie import READ as MOVIES

UPLOAD_BYTES = 1 << 30  # of a file, at most
SESSION_BYTES = 16 << 30  # of all files of a session
PHOTOGRAPHS = 100  # at once
LISTED = 500  # files of the root folder that the page lists
NAME_BYTES = 120  # of UTF-8: file systems allow 255, and outputs are named after the photograph
MODELS = (".onnx",)
PHOTOGRAPHED = (*PICTURES, *MOVIES)  # what shows a person
MOVIE_OUTPUTS = (".mp4", ".mov")
MASK_SUFFIX = "-matte.png"  # after a photograph's name without its own suffix


@dataclass
class Photograph:
    """A photograph of the session."""

    id: str  # its name in addresses: random
    name: str  # of its file, as commands have it
    folder: Path  # holds its file and what is made of it
    about: Answer = field(default_factory=dict)  # what `relight.app.tasks.read` found
    # The name of its matte's file; None if the photograph has alpha, or no outline is accepted yet.
    mask: str | None = None
    drawn: Drawing | None = None  # the drawing that the matte is of
    scene: Mapping[str, object] | None = None  # what the viewer begins with, once the photograph is analysed
    movie: str | None = None  # the name of the movie of which it is a frame
    source: str = ""  # the name of its file before it was turned, if it was
    turns: int = 0  # by quarters, clockwise
    people: list[PersonOutline] = field(default_factory=list)  # who was found, see `relight.app.people`
    outputs: set[str] = field(default_factory=set)  # names of files that can be downloaded

    @property
    def stem(self) -> str:
        """The name without its suffix."""
        return Path(self.name).stem

    def writes(self, name: str) -> bool:
        """Return whether a file of this name is made of the photograph, now or later."""
        return (
            name in self.outputs or name == f"{self.stem}{MASK_SUFFIX}" or Path(name).stem == self.output("")
        )

    def output(self, suffix: str) -> str:
        """Return the name of the relit picture's file, or of the movie's."""
        whole = self.movie is not None and suffix in MOVIE_OUTPUTS
        return f"{Path(self.movie or '').stem if whole else self.stem}-relit{suffix}"

    def to_json(self) -> dict[str, object]:
        """Return what the page shows of the photograph, in types of JSON."""
        return {
            "id": self.id,
            "name": self.name,
            "mask": self.mask,
            "movie": self.movie,
            "turns": self.turns,
            "people": self.people,
            "drawn": self.drawn,
            "analysed": self.scene is not None,
            **{key: self.about.get(key) for key in ("width", "height", "cut_out", "preview", "notes")},
        }


class Session:
    """Photographs and other files of one run of the server.

    `root`: the folder that files may be chosen from, or None. `folder`: temporary; `close` removes it.
    """

    def __init__(self, root: Path | None = None) -> None:
        self.root = None if root is None else root.resolve()
        self.folder = Path(tempfile.mkdtemp(prefix="relight-app-"))
        self.photographs: dict[str, Photograph] = {}
        self._removed: Photograph | None = None  # the last one, which can be brought back
        self._files: dict[str, Path] = {}

    def close(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def photograph(self, identity: str) -> Photograph:
        """Return a photograph; raises Refused if there is none of that id."""
        photograph = self.photographs.get(identity)
        if photograph is None:
            raise Refused("This photograph is no longer here: drop it again.", 404)
        return photograph

    def new_photograph(self, name: str) -> Photograph:
        """Make room for a photograph's file; raises Refused for another kind of file, or one too many."""
        if len(self.photographs) >= PHOTOGRAPHS:
            raise Refused(f"{PHOTOGRAPHS} photographs are open, the most that fit: remove some first.", 409)
        photograph = Photograph(secrets.token_hex(8), checked_name(name, PHOTOGRAPHED), self.folder)
        photograph.folder = self.folder / "photographs" / photograph.id
        photograph.folder.mkdir(parents=True)
        self.photographs[photograph.id] = photograph
        return photograph

    def remove(self, photograph: Photograph) -> None:
        """Remove a photograph and all that was made of it; the last one can be brought back."""
        self.empty_bin()
        self._removed = self.photographs.pop(photograph.id, None)

    def bring_back(self, identity: str) -> Photograph:
        """Bring back the photograph that was removed last; raises Refused for another one."""
        photograph = self._removed
        if photograph is None or photograph.id != identity:
            raise Refused("This photograph is no longer here: drop it again.", 404)
        self._removed = None
        self.photographs[photograph.id] = photograph
        return photograph

    def empty_bin(self) -> None:
        """Delete what was removed last."""
        if self._removed is not None:
            shutil.rmtree(self._removed.folder, ignore_errors=True)
            self._removed = None

    def discard(self, photograph: Photograph) -> None:
        """Delete a photograph that could not be read."""
        self.photographs.pop(photograph.id, None)
        shutil.rmtree(photograph.folder, ignore_errors=True)

    def new_file(self, name: str, suffixes: tuple[str, ...]) -> tuple[str, Path]:
        """Make room for another file, such as an environment: its id and path."""
        identity = secrets.token_hex(8)
        path = self.folder / "files" / identity / checked_name(name, suffixes)
        path.parent.mkdir(parents=True)
        self._files[identity] = path
        return identity, path

    def remove_file(self, identity: str) -> None:
        """Forget another file; where it has been lent, it stays."""
        path = self._files.pop(identity, None)
        if path is not None:
            shutil.rmtree(path.parent, ignore_errors=True)

    def file(self, identity: str) -> Path:
        """Return the path of another file; raises Refused if there is none of that id."""
        path = self._files.get(identity)
        if path is None:
            raise Refused("This file is no longer here: drop it again.", 404)
        return path

    def lend(self, identity: str, photograph: Photograph) -> str:
        """Link another file beside a photograph, where commands name it; return its name there.

        A file whose name is taken, or will be that of an output, gets a number. The photograph itself is not
        linked a second time.
        """
        path = self.file(identity)
        name, number = path.name, 1
        while True:
            beside = photograph.folder / name
            if not photograph.writes(name):
                if not beside.exists():
                    os.link(path, beside)
                if beside.samefile(path) or filecmp.cmp(path, beside, shallow=False):
                    return name
            number += 1
            name = f"{path.stem}-{number}{path.suffix}"

    def in_root(self) -> Iterator[str]:
        """Yield the pictures that may be chosen, relative to the root."""
        if self.root is None:
            return
        for folder, folders, names in os.walk(self.root):
            folders[:] = sorted(name for name in folders if not name.startswith("."))
            for name in sorted(names):
                if Path(name).suffix.lower() in PHOTOGRAPHED and not name.startswith("."):
                    yield str((Path(folder) / name).relative_to(self.root))

    def copy_from_root(self, relative: str) -> Photograph:
        """Copy a picture from the root; raises Refused for a path or link that leads out of it."""
        sentence = "This file is not in the folder that relight app was started with."
        if self.root is None or "\0" in relative:
            raise Refused(sentence, 403)
        path = (self.root / relative).resolve()
        if not path.is_relative_to(self.root):
            raise Refused(sentence, 403)
        if not path.is_file():
            raise Refused(f"{Path(relative).name}: no longer exists.", 404)
        if path.stat().st_size > UPLOAD_BYTES:
            raise Refused(_too_large(path.name), 413)
        photograph = self.new_photograph(path.name)
        try:
            shutil.copyfile(path, photograph.folder / photograph.name)
        except OSError as error:
            self.discard(photograph)
            raise Refused(_unwritten(error), 507) from error
        return photograph

    async def receive(self, chunks: AsyncIterable[bytes], path: Path) -> None:
        """Write an upload; raises Refused if it is empty or too large, or if the disk is full."""
        if self._size() > SESSION_BYTES // 2:
            self.empty_bin()
        size, room = 0, SESSION_BYTES - self._size()
        try:
            with path.open("xb") as file:
                async for chunk in chunks:
                    size += len(chunk)
                    if size > UPLOAD_BYTES:
                        raise Refused(_too_large(path.name), 413)
                    if size > room:
                        raise Refused("The session is full: remove some photographs first.", 413)
                    file.write(chunk)
        except OSError as error:
            raise Refused(_unwritten(error), 507) from error
        if not size:
            raise Refused(f"{path.name}: is empty.")

    def _size(self) -> int:
        """Return the size of all that the session holds, in bytes."""
        return sum(path.lstat().st_size for path in self.folder.rglob("*") if not path.is_dir())


def checked_name(name: str, suffixes: tuple[str, ...]) -> str:
    """Return a file's name without its folders, as a file system and a command can have it.

    Raises Refused: its suffix is none of `suffixes`.
    """
    last = re.split(r"[/\\]", name)[-1]
    last = re.sub(r"[\x00-\x1f\x7f]", "", last).strip()
    last = re.sub(r"[\ud800-\udfff]", "_", last)  # bytes that are no UTF-8
    stem, suffix = Path(last).stem, Path(last).suffix
    if suffix.lower() not in suffixes:
        kinds = "JPEG, PNG, HEIC, raw, EXR or TIFF" if ".jpg" in suffixes else " or ".join(suffixes)
        kinds = f"{kinds} file, or a movie" if ".mp4" in suffixes else f"{kinds} file"
        raise Refused(f"{last or 'This file'}: expected a {kinds}.", 415)
    stem = stem.lstrip("-.").encode()[: NAME_BYTES - len(suffix)].decode(errors="ignore") or "photograph"
    # A number sign or a percent sign would make the name a frame of a sequence.
    return re.sub(r"#|%(?=\d*d)", "_", stem) + suffix


def _too_large(name: str) -> str:
    return f"{name}: is larger than {UPLOAD_BYTES >> 20} MB, the limit of an upload."


def _unwritten(error: OSError) -> str:
    return (
        f"The file could not be saved: {error.strerror or 'the disk may be full'}. Make room, and try again."
    )
