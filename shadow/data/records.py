"""Training records, each of which is one rendered view.

A record holds the results of the light stage inside the mask: normals, albedo, depth, one visibility bit for
each light direction and, optionally, bounce light. `shadow.data.photographs` renders a new photograph from it
each time. On disk a record is one compressed .npz file; a shard is a zip archive of such files.
"""

import io
import json
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from shadow.files import replacing
from shadow.framing import bounding_box

SHARD_BYTES = 60 * 2**20
BOUNCE_RANK = 8  # rank of the factorised bounce light of a view, which keeps 96 % of it
REGIONS = ("other", "face", "hands")  # labels of pixels
OF_PIXELS = ("normals_int8", "albedo_uint8", "visibility_bits", "bounce_float16", "depth_float16", "regions")
ENCODING = 2.2  # albedo is stored as 8 bits of albedo ** (1 / 2.2), which resolves dark cloth better


@dataclass(frozen=True)
class Record:
    """One view, with N pixels inside the mask, in row order, and D directions.

    The fields have the types of the file, so that a record that is written and read back is the same. The
    properties convert them to floats.
    """

    mask: np.ndarray  # (H, W) bool
    normals_int8: np.ndarray  # (N, 3) camera-frame normals × 127
    albedo_uint8: np.ndarray  # (N, 3) encoded albedo × 255
    visibility_bits: np.ndarray  # (N, ceil(D / 8)) uint8, packed along the directions
    directions: np.ndarray  # (D, 3) float32 unit vectors, camera frame
    about: dict = field(default_factory=dict)  # figure, split, view and other values that JSON can hold
    bounce_float16: np.ndarray | None = None  # (N, K); its product with bounce_patterns is the bounce light
    bounce_patterns: np.ndarray | None = None  # (K, D, 3); both are None if bounce light was not traced
    depth_float16: np.ndarray | None = None  # (N, 1), see `depth`; None in old records
    regions: np.ndarray | None = None  # (N,) uint8, indices into REGIONS; None if unknown, as in scans

    @classmethod
    def of(
        cls,
        mask: np.ndarray,
        normals: np.ndarray,
        albedo: np.ndarray,
        visibility: np.ndarray,
        directions: np.ndarray,
        about: dict[str, Any] | None = None,
        bounce: tuple[np.ndarray, np.ndarray] | None = None,
        depth: np.ndarray | None = None,
        regions: np.ndarray | None = None,
    ) -> "Record":
        """Make a record from floats inside the mask.

        normals (N, 3) unit, albedo (N, 3) linear in [0, 1], visibility (N, D) bool, bounce light as factors
        (N, K) and (K, D, 3), depth (N, 1), regions (N,).
        """
        shares, patterns = (None, None) if bounce is None else bounce
        return cls(
            mask.astype(bool),
            np.round(normals * 127).astype(np.int8),
            np.round(np.clip(albedo, 0, 1) ** (1 / ENCODING) * 255).astype(np.uint8),
            np.packbits(visibility.astype(bool), axis=1),
            directions.astype(np.float32),
            about or {},
            None if shares is None else shares.astype(np.float16),
            None if patterns is None else patterns.astype(np.float32),
            None if depth is None else depth.astype(np.float16),
            None if regions is None else regions.astype(np.uint8),
        )

    @property
    def normals(self) -> np.ndarray:
        """Camera-frame normals (N, 3), float32 unit vectors."""
        vectors = self.normals_int8.astype(np.float32)
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

    @property
    def albedo(self) -> np.ndarray:
        """Albedo (N, 3), float32, linear in [0, 1]."""
        return (self.albedo_uint8.astype(np.float32) / 255) ** ENCODING

    @property
    def visibility(self) -> np.ndarray:
        """Visibility (N, D), uint8: 1 is lit."""
        return np.unpackbits(self.visibility_bits, axis=1, count=len(self.directions))

    @property
    def bounce(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounce light as two factors, (N, K) and (K, D, 3), float32: zero if it was not traced."""
        if self.bounce_float16 is None or self.bounce_patterns is None:
            return (
                np.zeros((len(self.normals_int8), BOUNCE_RANK), np.float32),
                np.zeros((BOUNCE_RANK, len(self.directions), 3), np.float32),
            )
        return self.bounce_float16.astype(np.float32), self.bounce_patterns

    @property
    def depth(self) -> np.ndarray | None:
        """Depth (N, 1) along the camera's axis, float32, or None if it was not recorded.

        It increases away from the camera and is relative to the mean over the subject's pixels. Its unit is
        the height of the mask at that mean depth. `about["camera"]` has the values that convert it to
        positions: `focal`, the focal length in pixels, and `mean_depth`, the distance from the camera to the
        mean depth in the same unit.
        """
        return None if self.depth_float16 is None else self.depth_float16.astype(np.float32)

    @property
    def shares(self) -> np.ndarray:
        """Masks of faces and of hands (N, 2), float32, 0 or 1; zero if the regions are unknown."""
        if self.regions is None:
            return np.zeros((len(self.normals_int8), len(REGIONS) - 1), np.float32)
        return (self.regions[:, None] == np.arange(1, len(REGIONS))).astype(np.float32)

    def image(self, values: np.ndarray) -> torch.Tensor:
        """Return values inside the mask (N, C) as an image (C, H, W), float32, zero outside the mask."""
        canvas = np.zeros((values.shape[1], *self.mask.shape), np.float32)
        canvas[:, self.mask] = values.T
        return torch.from_numpy(canvas)

    def cropped(self, height: int) -> "Record":
        """Return the record without the empty margins of its frame, and at a lower resolution if possible.

        Only every n-th pixel is kept, with the largest n for which the subject is still at least `height`
        pixels tall. One empty pixel stays on each side that had any, to show that the frame does not cut the
        subject there.
        """
        top, left, bottom, right = bounding_box(torch.from_numpy(self.mask))
        rows, columns = self.mask.shape
        around = ((min(top, 1), min(rows - bottom, 1)), (min(left, 1), min(columns - right, 1)))
        stride = max(1, (bottom - top) // height)
        if stride == 1:
            return replace(self, mask=np.pad(self.mask[top:bottom, left:right], around))
        order = np.full(self.mask.shape, -1)
        order[self.mask] = np.arange(len(self.normals_int8))
        order = order[top:bottom:stride, left:right:stride]
        indices, about = order[order >= 0], self.about
        if "camera" in about:
            about = about | {"camera": about["camera"] | {"focal": about["camera"]["focal"] / stride}}
        pixels = {name: getattr(self, name) for name in OF_PIXELS}
        return replace(
            self,
            mask=np.pad(order >= 0, around),
            about=about,
            **{name: values[indices] for name, values in pixels.items() if values is not None},
        )


def to_bytes(record: Record) -> bytes:
    """Encode a record as the bytes of its compressed .npz file."""
    stream = io.BytesIO()
    perhaps = {
        "bounce": record.bounce_float16,
        "bounce_patterns": record.bounce_patterns,
        "depth": record.depth_float16,
        "regions": record.regions,
    }
    known: dict[str, Any] = {name: values for name, values in perhaps.items() if values is not None}
    np.savez_compressed(
        stream,
        size=np.array(record.mask.shape),
        mask=np.packbits(record.mask),
        normals=record.normals_int8,
        albedo=record.albedo_uint8,
        visibility=record.visibility_bits,
        directions=record.directions,
        about=np.frombuffer(json.dumps(record.about).encode(), np.uint8),
        **known,
    )
    return stream.getvalue()


def from_bytes(data: bytes, name: str | Path = "record") -> Record:
    """Decode the record that `to_bytes` wrote. Raises ValueError with its name if it is damaged."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            size = tuple(arrays["size"])
            return Record(
                np.unpackbits(arrays["mask"], count=size[0] * size[1]).reshape(size).astype(bool),
                arrays["normals"],
                arrays["albedo"],
                arrays["visibility"],
                arrays["directions"],
                json.loads(arrays["about"].tobytes()),
                arrays.get("bounce"),
                arrays.get("bounce_patterns"),
                arrays.get("depth"),
                arrays.get("regions"),
            )
    except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"records: {name} is damaged or not a record: {error}") from error


def write(path: Path, record: Record) -> int:
    """Write a record to a file, and return the file's size in bytes."""
    data = to_bytes(record)
    with replacing(path) as beside:
        beside.write_bytes(data)
    return len(data)


def pack(folder: str | Path, out: str | Path) -> list[Path]:
    """Pack the records of `folder` into shards `out`/shard-000.zip, ... of at most 60 MiB; return the paths.

    Records are distributed over the shards in a fixed random order, so that any subset of shards is a random
    sample.
    """
    files = sorted(Path(folder).glob("*.npz"))
    if not files:
        raise ValueError(f"folder: {folder} holds no records (.npz)")
    order = np.random.default_rng(0).permutation(len(files))
    Path(out).mkdir(parents=True, exist_ok=True)
    shards: list[list[Path]] = []
    room = 0
    for file in (files[i] for i in order):
        size = file.stat().st_size + 2 * len(file.name) + 128  # with the headers of a zip entry
        if size > room:
            shards.append([])
            room = SHARD_BYTES - 1024
        shards[-1].append(file)
        room -= size
    paths = []
    for number, members in enumerate(shards):
        path = Path(out) / f"shard-{number:03d}.zip"
        with replacing(path) as beside, zipfile.ZipFile(beside, "w", zipfile.ZIP_STORED) as archive:
            for file in members:
                archive.write(file, file.name)
        paths.append(path)
    return paths


class Records:
    """The records under some paths, by index: folders of .npz files and .zip shards, or single files."""

    def __init__(self, paths: Iterable[str | Path]) -> None:
        self.entries: list[tuple[Path, str | None]] = []  # (file, member of the archive or None)
        for path in map(Path, paths):
            if not path.exists():
                raise FileNotFoundError(f"records: no such file or folder: {path}")
            # A hidden file is a record that is being written; see `shadow.files.replacing`.
            for file in sorted(path.glob("[!.]*")) if path.is_dir() else [path]:
                if file.suffix == ".npz":
                    self.entries.append((file, None))
                elif file.suffix == ".zip":
                    with zipfile.ZipFile(file) as archive:
                        self.entries += [(file, name) for name in sorted(archive.namelist())]
        if not self.entries:
            raise ValueError(f"records: no records (.npz) or shards (.zip) in {', '.join(map(str, paths))}")

    def __len__(self) -> int:
        return len(self.entries)

    def spread(self, count: int) -> list[int]:
        """Return the indices of `count` evenly spread records, or of all if there are fewer."""
        return np.linspace(0, len(self) - 1, min(count, len(self))).round().astype(int).tolist()

    def __getitem__(self, index: int) -> Record:
        file, member = self.entries[index]
        if member is None:
            return from_bytes(file.read_bytes(), file)
        with zipfile.ZipFile(file) as archive:
            return from_bytes(archive.read(member), f"{file}:{member}")
