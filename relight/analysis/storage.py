"""The analysis cache's file: an `AnalysisRecord`, or that a frame shows no person.

The file is a safetensors file. Its metadata's `relight` is JSON, the header: the measures of the person, the
provenance, and the dtype, shape and checksum of each array. Each array is a tensor of bytes, compressed by
`relight.analysis.array_codec`. P are the person's pixels on the plate, in row-major order in the box around
the matte; N their pixels on the networks' canvas, in row-major order.

Colour is stored as half floats; for a person who fills most of an HD frame with 6 of the 10 bits of their
mantissa, since the others hold little but the sensor's noise. The maps of the 96 anchor directions are stored
as principal components, at most 8 bits each. The loss is a hundredth of the networks' own error.
"""

import json
import math
import zlib
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeAlias, TypedDict

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.numpy import load as from_bytes
from safetensors.numpy import save as to_bytes

from relight.analysis.array_codec import compress, decompress
from relight.analysis.camera import Camera
from relight.analysis.components import principal_components
from relight.analysis.depth import ProvidedDepth, WorldGeometry
from relight.analysis.foreground import Foreground
from relight.analysis.light_field import LightField
from relight.analysis.maps import AnalysisMaps
from relight.analysis.old_light import OldLight
from relight.analysis.record import AnalysisRecord
from relight.analysis.upsampling import GUIDE_MAX
from relight.errors import DamagedFileError, StaleAnalysisError
from relight.media.regular_file import check_regular_file
from shadow.files import AnyPath, check_writable, replacing
from shadow.framing import Framing
from shadow.networks.mirror import Pixels

SUFFIX = ".safetensors"
FORMAT = 7
SHORTENING_PIXELS = 600_000  # a larger person's colour is shortened, for under 4 MB a frame of HD
SHORTENED_BITS = 4  # of a half float's mantissa: steps of 1 %, as 8 bits of sRGB have in mid-grey
RANK = {"cast": 32, "residual": 16}  # principal components of each kind of maps
MIN_STEP = {"cast": 0.1, "residual": 0.005}  # least step between two 8-bit codes of a component
HALF_MAX = 65504.0
ANCHORS = 96  # light directions for which the networks have maps
MAX_CANVAS_SIDE = 8192  # pixels
MAX_BOX_PIXELS = 2**27  # of the plate, around the person
PLATE_PIXELS = 2**29  # of a plate, at most: pictures of that size are made from it
BASE_BYTES, MAX_EXPANSION = 2**28, 100  # arrays of a file may take BASE_BYTES + MAX_EXPANSION times its size


class SourceState(TypedDict):
    """A file from which a frame was analysed, see `relight.media.content_hash.FileRecord`."""

    path: str
    size: int
    modified: int
    sha256: str


class Provenance(TypedDict, total=False):
    """What an analysis states of its making; a frame of a shot, all of it."""

    options: str
    version: str
    weights: list[str]
    rate: str | None
    field_of_view: float
    pixel_aspect: float
    precision: str | None
    threads: int | None
    reference: int | None
    content_hash: str
    sources: list[SourceState]
    plate_metadata: dict[str, object]


Header: TypeAlias = dict[str, Any]  # of a file, in the types of JSON: any, until it is checked


def write_record(path: AnyPath, record: AnalysisRecord, provenance: Mapping[str, object]) -> None:
    """Write a record and its provenance, which JSON must hold, to a file: whole or not at all.

    Raises ValueError for another suffix than `.safetensors`, OSError if the file cannot be written.
    """
    path = check_writable(path, (SUFFIX,))
    data = pack_record(record, provenance)
    with replacing(path) as beside:
        beside.write_bytes(data)


def pack_record(record: AnalysisRecord, provenance: Mapping[str, object]) -> bytes:
    """Return the content of the file that `write_record` writes."""
    if record.is_empty:
        about: Header = {"format": FORMAT, "empty": record.foreground.size, "arrays": {}}
        return to_bytes({}, {"relight": json.dumps({**about, "provenance": {**provenance}})})
    arrays = _plate_arrays(record) | _canvas_arrays(record)
    person, framing = record.foreground, record.framing
    tensors = {name: compress(array) for name, array in arrays.items()}
    header = {
        "format": FORMAT,
        "size": person.size,
        "corner": (person.top, person.left),
        "box": person.alpha.shape,
        "photographed": person.photographed,
        "exposure": record.exposure,
        "centre": framing.centre,
        "scale": framing.scale,
        "camera": asdict(record.maps.geometry.camera),
        "old_light": record.old_light._asdict(),
        "arrays": {
            name: (array.dtype.str, array.shape, zlib.crc32(tensors[name].data))
            for name, array in arrays.items()
        },
        "provenance": {**provenance},
    }
    return to_bytes(tensors, {"relight": json.dumps(header)})


def read_header(path: AnyPath) -> Header:
    """Read the header of a file, without its arrays.

    Raises FileNotFoundError; DamagedFileError for a damaged file or no analysis; StaleAnalysisError for the
    format of another version; UnsupportedFileError for what is no regular file, such as a device or a pipe.
    """
    return _open(path, whole=False)[0]


def read_record(path: AnyPath) -> tuple[AnalysisRecord, Provenance]:
    """Read a record and its provenance; raises as `read_header`."""
    header, tensors = _open(path)
    return _checked_record(str(path), header, tensors, Path(path).stat().st_size), header["provenance"]


def unpack_record(data: bytes) -> AnalysisRecord:
    """Return the record of what `pack_record` returned; raises as `read_record`."""
    try:
        start = 8 + int.from_bytes(data[:8], "little")
        header = json.loads(json.loads(data[8:start])["__metadata__"]["relight"])
        tensors = from_bytes(data)
    except (SafetensorError, RecursionError, LookupError, TypeError, ValueError) as error:
        raise DamagedFileError(f"a pickled Subject is damaged: {error}") from error
    if header.get("format") != FORMAT:
        raise StaleAnalysisError("a pickled Subject is of another version; analyse the plate again")
    return _checked_record("a pickled Subject", header, tensors, len(data))


def _checked_record(where: str, header: Header, tensors: dict[str, np.ndarray], size: int) -> AnalysisRecord:
    """Return the record of a header and tensors, which an error calls `where`; `size` is of all bytes."""
    if "empty" in header:
        _check_size(where, header["empty"])
        return AnalysisRecord.of_nobody((header["empty"][0], header["empty"][1]))
    try:
        _check_measures(header)
        _check_shapes(header, size)
        arrays = {}
        for name, (dtype, shape, checksum) in header["arrays"].items():
            if zlib.crc32(tensors[name].data) != checksum:
                raise ValueError(f"the checksum of {name} does not match")
            arrays[name] = decompress(tensors[name], dtype, tuple(shape))
        return _restored(header, arrays)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, RuntimeError) as error:
        raise DamagedFileError(f"{where}: is damaged: {error}") from error


def _open(path: AnyPath, whole: bool = True) -> tuple[Header, dict[str, np.ndarray]]:
    """Return a file's header and, if `whole`, its tensors of bytes."""
    path = check_regular_file(path)
    try:
        with safe_open(path, framework="np") as file:
            header = json.loads((file.metadata() or {}).get("relight", "{}"))
            names = header.get("arrays", {})
            tensors = {name: file.get_tensor(name) for name in names if whole}
    except (SafetensorError, RecursionError, ValueError) as error:
        raise DamagedFileError(f"{path}: is damaged or truncated, or no safetensors file: {error}") from error
    except (AttributeError, TypeError) as error:
        raise DamagedFileError(f"{path}: is damaged: {error}") from error
    if "format" not in header:
        raise DamagedFileError(f"{path}: is no analysis by relight")
    if "empty" in header:
        _check_size(str(path), header["empty"])
    if header["format"] != FORMAT:
        raise StaleAnalysisError(
            f"{path}: has format {header['format']}, expected {FORMAT}; analyse the plate again"
        )
    if not isinstance(header.get("provenance"), dict):
        raise DamagedFileError(f"{path}: is no analysis by relight")
    return header, tensors


def _check_size(where: str, size: object) -> None:
    """Raise DamagedFileError for what is no size of a frame, which is written alike in all formats."""
    sides = list(size) if isinstance(size, list) else []
    if len(sides) != 2 or not all(type(side) is int and side > 0 for side in sides):
        raise DamagedFileError(f"{where}: is damaged: expected the size of a frame, got {str(size)[:40]}")
    if math.prod(sides) > PLATE_PIXELS:
        raise DamagedFileError(f"{where}: is damaged: a frame of {sides[0]} x {sides[1]} pixels is too large")


def _plate_arrays(record: AnalysisRecord) -> dict[str, np.ndarray]:
    """Return the arrays at the plate's resolution."""
    person = record.foreground
    unit = _unit(record.exposure)
    arrays = {
        "inside": np.packbits(person.alpha.numpy() > 0),
        "coverage": _half(person.coverage).clip(np.finfo(np.float16).smallest_subnormal),
        "colour": shortened(record.colour.T * unit),
    }
    if record.provided_albedo is not None:
        arrays["provided_albedo"] = shortened(record.provided_albedo.T)
    own = person.matte.flatten()[person.pixels]
    if not torch.equal(own, person.coverage):  # noise and specks are left out of the matte
        arrays["matte"] = _half(own)
    edge = person.edge.flatten()[person.pixels]
    if not torch.equal(edge, person.coverage):  # the pictures' edge is feathered
        arrays["edge"] = _half(edge)
    return arrays


def _canvas_arrays(record: AnalysisRecord) -> dict[str, np.ndarray]:
    """Return the arrays on the networks' canvas."""
    maps = record.maps
    field = maps.field.in_row_order()
    silhouette = field.silhouette
    within = silhouette.scatter(torch.ones(1, len(silhouette.pixels), dtype=torch.uint8))[0]
    unit = _unit(record.exposure)
    arrays = {
        "within": (within + maps.known).numpy(),  # 1 where the matte is above zero, 2 above a half
        "image": (maps.image * (255 / GUIDE_MAX)).round().clamp(0, 255).to(torch.uint8).numpy(),
        "normals": _half(field.normals),
        "sharpness": _half(field.sharpness),
        "rim": (field.rim * 255).round().to(torch.uint8).numpy(),
        "albedo": _half(silhouette.take(maps.albedo)),
        "depth": _half(silhouette.take(maps.geometry.depth[None])),
    }
    if record.face is not None:
        arrays["face"] = silhouette.take(record.face[None].to(torch.uint8)).numpy()
    if maps.light is not None:
        arrays["light"] = _half(silhouette.take(maps.light) * unit)
    for name, values in (("cast", field.cast), ("residual", field.residual)):
        arrays |= _quantised_components(name, values)
    return arrays


def _quantised_components(name: str, maps: torch.Tensor) -> dict[str, np.ndarray]:
    """Return codes (R, N) in 8 bits, with `maps = basis (K, R) · codes + offset (K, 1)`."""
    basis, coefficients = principal_components(maps, RANK[name])
    low, high = coefficients.aminmax(dim=1, keepdim=True)
    step = ((high - low) / 255).clamp_min(MIN_STEP[name])  # the same for most: their errors count alike
    codes = ((coefficients - low) / step).round().to(torch.uint8)
    return {
        name: codes.numpy(),
        f"{name}_basis": (basis * step.T).numpy(),
        f"{name}_offset": (basis @ low).numpy(),
    }


def _check_measures(header: Header) -> None:
    """Raise ValueError for measures that no person in a picture has."""
    size, corner, box = (tuple(header[name]) for name in ("size", "corner", "box"))
    camera = header["camera"]
    sides = list(zip(size, corner, box, strict=True))
    if not all(type(pixels) is int for side in sides for pixels in side):
        raise ValueError("measures in pixels are no whole numbers")
    if math.prod(size) > PLATE_PIXELS:
        raise ValueError(f"a plate of {size} pixels is too large")
    if not all(0 <= first < first + extent <= whole for whole, first, extent in sides):
        raise ValueError(f"a box of {box} pixels at {corner} is not in a plate of {size}")
    if tuple(camera["size"]) != size:
        raise ValueError(f"the camera's plate is one of {camera['size']} pixels, not of {size}")
    old_light = OldLight(**header["old_light"])
    lengths = (len(old_light.ambient), len(old_light.slopes), len(old_light.middle))
    numbers = [*old_light.ambient, *old_light.slopes, *old_light.middle, *old_light[2:5]]
    numbers.append(old_light.lightness)
    if lengths != (2, 6, 2) or not np.isfinite(numbers).all():
        raise ValueError(f"expected the colour of a light, got {header['old_light']}")
    positive = [header["exposure"], header["scale"], camera["focal"], camera["distance"]]
    if not np.isfinite([*positive, *header["centre"], *camera["middle"], camera["bottom"]]).all():
        raise ValueError("a measure is not finite")
    if min(positive) <= 0:
        raise ValueError(f"expected measures above zero, got {min(positive)}")


def _check_shapes(header: Header, file_bytes: int) -> None:
    """Raise ValueError for shapes and dtypes that do not fit each other, or are too large for the file."""
    arrays = header["arrays"]
    shapes = {name: tuple(shape) for name, (_, shape, _) in arrays.items()}
    if not all(type(side) is int and side > 0 for shape in shapes.values() for side in shape):
        raise ValueError("the shape of an array is not of positive whole numbers")
    box, canvas = math.prod(header["box"]), shapes["within"]
    plate, pixels = shapes["coverage"][0], shapes["sharpness"][-1]
    expected = {
        "inside": ("|u1", (-(-box // 8),)),
        "coverage": ("<f2", (plate,)),
        "colour": ("<f2 <u2", (3, plate)),
        "provided_albedo": ("<f2 <u2", (3, plate)),
        "matte": ("<f2", (plate,)),
        "edge": ("<f2", (plate,)),
        "within": ("|u1", canvas),
        "image": ("|u1", (3, *canvas)),
        "normals": ("<f2", (3, pixels)),
        "sharpness": ("<f2", (1, pixels)),
        "rim": ("|u1", (1, pixels)),
        "face": ("|u1", (1, pixels)),
        "albedo": ("<f2", (3, pixels)),
        "depth": ("<f2", (1, pixels)),
        "light": ("<f2", (3, pixels)),
    }
    for name in RANK:
        rank = shapes[name][0]
        expected[name] = ("|u1", (rank, pixels))
        expected[f"{name}_basis"] = ("<f4", (ANCHORS, rank))
        expected[f"{name}_offset"] = ("<f4", (ANCHORS, 1))
    for name, (dtype, _, _) in arrays.items():
        dtypes, shape = expected[name]
        if dtype not in dtypes.split() or shapes[name] != shape:
            raise ValueError(f"{name} is {dtype} {shapes[name]}, expected {dtypes} {shape}")
    if len(canvas) != 2 or max(canvas) > MAX_CANVAS_SIDE or pixels > math.prod(canvas):
        raise ValueError(f"{pixels} pixels on a canvas of {canvas}")
    if box > MAX_BOX_PIXELS or plate > box or max(shapes[name][0] for name in RANK) > ANCHORS:
        raise ValueError(f"{plate} pixels of a person in a box of {box}")
    needed = sum(math.prod(shapes[name]) * np.dtype(dtype).itemsize for name, (dtype, _, _) in arrays.items())
    if needed > BASE_BYTES + MAX_EXPANSION * file_bytes:
        raise ValueError(f"a file of {file_bytes} bytes claims arrays of {needed}")


def _restored(header: Header, arrays: dict[str, np.ndarray]) -> AnalysisRecord:
    tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}
    exposure = float(header["exposure"])
    rows, columns = header["box"]
    inside = torch.from_numpy(np.flatnonzero(np.unpackbits(arrays["inside"], count=rows * columns)))
    box = rows, columns

    def in_the_box(name: str) -> torch.Tensor:
        values = torch.zeros(rows * columns)
        values[inside] = tensors[name].float()
        return values.view(box)

    size, (top, left) = tuple(header["size"]), header["corner"]
    alpha = in_the_box("coverage")
    matte, edge = (in_the_box(name) if name in tensors else alpha for name in ("matte", "edge"))
    person = Foreground(size, (top, left), alpha, matte, bool(header["photographed"]), edge)
    framing = Framing(tuple(header["centre"]), header["scale"], tuple(arrays["within"].shape), box)
    on_plate = framing.shifted(left, top, size)
    camera = Camera(**{name: _tuple(value) for name, value in header["camera"].items()})
    albedo = lengthened(arrays["provided_albedo"]).T if "provided_albedo" in arrays else None
    colour = lengthened(arrays["colour"]).T / _unit(exposure)
    maps = _restored_maps(tensors, on_plate, camera, exposure)
    old_light = OldLight(**{name: _tuple(value) for name, value in header["old_light"].items()})
    face = maps.field.silhouette.scatter(tensors["face"])[0] > 0 if "face" in tensors else None
    return AnalysisRecord(person, colour, albedo, exposure, framing, maps, old_light, face)


def _restored_maps(
    tensors: dict[str, torch.Tensor], framing: Framing, camera: Camera, exposure: float
) -> AnalysisMaps:
    within = tensors["within"]
    silhouette = Pixels(within)

    def values(name: str) -> torch.Tensor:
        return tensors[name].float()

    def from_components(name: str) -> torch.Tensor:
        return torch.addmm(tensors[f"{name}_offset"], tensors[f"{name}_basis"], values(name))

    field = LightField(
        silhouette,
        values("normals"),
        values("sharpness"),
        from_components("cast"),
        from_components("residual"),
        values("rim") / 255,
    )
    light = silhouette.scatter(values("light")) / _unit(exposure) if "light" in tensors else None
    depth = silhouette.scatter(values("depth"))[0]
    return AnalysisMaps(
        framing,
        within > 1,
        tensors["image"] * (GUIDE_MAX / 255),
        silhouette.scatter(field.normals),
        field,
        silhouette.scatter(values("albedo")),
        light,
        WorldGeometry(camera, framing, ProvidedDepth(depth, within > 1)),
    )


def _tuple(value: object) -> Any:
    """Return JSON's lists as tuples."""
    return tuple(value) if isinstance(value, list) else value


def _unit(exposure: float) -> float:
    """Return the power of two next to the exposure: it brings colour to about one, exactly undone."""
    return 2.0 ** round(math.log2(exposure))


def _half(values: torch.Tensor) -> np.ndarray:
    return values.clamp(-HALF_MAX, HALF_MAX).half().numpy()


def shortened(values: torch.Tensor, most: int | None = None) -> np.ndarray:
    """Return values (C, P) >= 0 as half floats; for a large person as the first bits of these, in uint16.

    `most`: pixels of which all bits are kept, SHORTENING_PIXELS unless given.
    """
    halves = _half(values)
    if halves.shape[-1] <= (SHORTENING_PIXELS if most is None else most):
        return halves
    halves = halves + np.float16(0)  # the bits of -0.0 are those of a large number
    bits = halves.view(np.uint16) + np.uint16(1 << SHORTENED_BITS - 1)
    return np.minimum(bits, halves.dtype.type(HALF_MAX).view(np.uint16)) >> SHORTENED_BITS


def lengthened(array: np.ndarray) -> torch.Tensor:
    """Return the values that `shortened` was given, to its precision."""
    halves = (array << SHORTENED_BITS).view(np.float16) if array.dtype == np.uint16 else array
    return torch.from_numpy(halves).float()
