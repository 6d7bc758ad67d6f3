"""An analysed person in a file: the pixels that relighting needs, and what the networks found.

The file is a safetensors file. Its metadata's `relight` is JSON: the measures of the person, and each array's
dtype and shape. An array is stored as a tensor of bytes, deflated (zlib, whose checksum tells damage): of
two-byte numbers first all low bytes and then all high ones, of integers the differences along the last axis,
of two-byte ones folded (0, -1, 1, -2... are 0, 1, 2, 3...). Pixels are the person's on the plate, P in row
order in the box around the matte, and on the networks' canvas, N in row order.

Colour is kept as half floats; that of a person who fills most of a frame with 6 of the 10 bits of their
mantissa, since the others hold little but the sensor's noise.

The maps of the 96 anchor directions are kept as their principal components over the person's pixels, in 8
bits at most: they are of low rank, and what is lost is a hundredth of the networks' own error.
"""

import json
import math
import zlib
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as to_bytes

from relight.canvas import Canvas, Field
from relight.depth import Camera, Given, Space
from relight.foreground import Foreground
from shadow.files import AnyPath, check_writable, replacing
from shadow.framing import Framing
from shadow.networks.mirror import Pixels

SUFFIX = ".safetensors"
FORMAT = 2
LARGE = 600_000  # plate's pixels of a person above which colour is shortened, for under 4 MB a frame of HD
SHORTENED = 4  # bits by which it is: steps of 1 %, as 8 bits of sRGB have in mid-grey
# Principal components of each kind of maps, and the least step between two of their codes.
RANK = {"cast": 32, "residual": 16}
STEP = {"cast": 0.1, "residual": 0.005}
GUIDE = 4 ** (1 / 2.2)  # largest value of the canvas' image
HALF = 65504.0


class Kept(NamedTuple):
    """What a `relight.Subject` is made of, without the networks."""

    person: Foreground
    colour: torch.Tensor  # (P, 3) the person's own, linear
    albedo: torch.Tensor | None  # (P, 3) where it was given
    exposure: float
    framing: Framing  # of the person's box
    canvas: Canvas


def write(path: AnyPath, kept: Kept, made_of: Mapping[str, Any]) -> None:
    """Keep a person in a file, and with it what it is `made_of`, as JSON holds it. The file is whole or not
    there; raises as `shadow.files.check_writable` and writing do."""
    path = check_writable(path, (SUFFIX,))
    arrays = _plate_arrays(kept) | _canvas_arrays(kept)
    person, framing = kept.person, kept.framing
    about = {
        "format": FORMAT,
        "size": person.size,
        "corner": (person.top, person.left),
        "box": person.alpha.shape,
        "photographed": person.photographed,
        "exposure": kept.exposure,
        "centre": framing.centre,
        "scale": framing.scale,
        "camera": asdict(kept.canvas.space.camera),
        "arrays": {name: (array.dtype.str, array.shape) for name, array in arrays.items()},
        "made_of": {**made_of},
    }
    _save(path, {name: np.frombuffer(_deflated(array), np.uint8) for name, array in arrays.items()}, about)


def _save(path: Path, tensors: dict[str, np.ndarray], about: dict[str, Any]) -> None:
    data = to_bytes(tensors, {"relight": json.dumps(about)})
    with replacing(path) as beside:
        beside.write_bytes(data)


def write_nobody(path: AnyPath, size: tuple[int, ...], made_of: Mapping[str, Any]) -> None:
    """Keep that nobody is in a picture of `size` (H, W); raises as `write` does."""
    about = {"format": FORMAT, "nobody": size, "arrays": {}, "made_of": {**made_of}}
    _save(check_writable(path, (SUFFIX,)), {}, about)


def read_about(path: AnyPath) -> dict[str, Any]:
    """What a file says of itself, without its arrays. FileNotFoundError: there is none. ValueError: it is no
    analysis that was kept, is damaged, or of another format."""
    return _opened(path, whole=False)[0]


def read(path: AnyPath) -> tuple[Kept, dict[str, Any]]:
    """A person out of a file, and what it is made of. Raises as `read_about` does; ValueError for nobody."""
    about, tensors = _opened(path)
    if "nobody" in about:
        raise ValueError(f"{path}: nobody is in that frame")
    try:
        arrays = {
            name: _inflated(tensors[name], np.dtype(dtype), tuple(shape))
            for name, (dtype, shape) in about["arrays"].items()
        }
        return _restored(about, arrays), about["made_of"]
    except (zlib.error, IndexError, KeyError, TypeError, ValueError, RuntimeError) as error:
        raise ValueError(f"{path}: is damaged: {error}") from error


def _opened(path: AnyPath, whole: bool = True) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        with safe_open(path, framework="np") as file:
            about = json.loads((file.metadata() or {}).get("relight", "{}"))
            names = about.get("arrays", {})
            tensors = {name: file.get_tensor(name) for name in names if whole}
    except (SafetensorError, json.JSONDecodeError) as error:
        raise ValueError(f"{path}: is damaged or truncated, or no safetensors file: {error}") from error
    except (AttributeError, TypeError) as error:
        raise ValueError(f"{path}: is damaged: {error}") from error
    if "format" not in about or not isinstance(about.get("made_of"), dict):
        raise ValueError(f"{path}: is no analysis that was kept by relight")
    if about["format"] != FORMAT:
        raise ValueError(
            f"{path}: is of format {about['format']}, expected {FORMAT}; analyse the plate again"
        )
    return about, tensors


def _plate_arrays(kept: Kept) -> dict[str, np.ndarray]:
    """What is kept at the plate's resolution."""
    person = kept.person
    unit = _unit(kept.exposure)
    arrays = {
        "inside": np.packbits(person.alpha.numpy() > 0),
        "coverage": _half(person.coverage).clip(np.finfo(np.float16).smallest_subnormal),
        "colour": _shortened(kept.colour.T * unit),
    }
    if kept.albedo is not None:
        arrays["given_albedo"] = _shortened(kept.albedo.T)
    own = person.matte.flatten()[person.pixels]
    if not torch.equal(own, person.coverage):  # noise and specks are left out of it
        arrays["matte"] = _half(own)
    return arrays


def _canvas_arrays(kept: Kept) -> dict[str, np.ndarray]:
    """What is kept on the networks' canvas."""
    canvas = kept.canvas
    field = Field.of(canvas.shading)
    place = field.silhouette
    within = place.scatter(torch.ones(1, len(place.pixels), dtype=torch.uint8))[0]
    unit = _unit(kept.exposure)
    arrays = {
        "within": (within + canvas.known).numpy(),  # 1 of the matte, 2 above a half
        "image": (canvas.image * (255 / GUIDE)).round().clamp(0, 255).to(torch.uint8).numpy(),
        "normals": _half(field.normals),
        "sharpness": _half(field.sharpness),
        "albedo": _half(place.take(canvas.albedo)),
        "depth": _half(place.take(canvas.space.depth[None])),
    }
    if canvas.light is not None:
        arrays["light"] = _half(place.take(canvas.light) * unit)
    for name, maps in (("cast", field.cast), ("residual", field.residual)):
        arrays |= _components(name, maps)
    return arrays


def _components(name: str, maps: torch.Tensor) -> dict[str, np.ndarray]:
    """Maps (K, N) as RANK codes (R, N) in 8 bits, with `maps = basis (K, R) · codes + offset (K, 1)`."""
    _, vectors = torch.linalg.eigh((maps @ maps.T).double())
    basis = vectors[:, -RANK[name] :].flip(1).float()
    parts = basis.T @ maps
    low, high = parts.aminmax(dim=1, keepdim=True)
    step = ((high - low) / 255).clamp_min(STEP[name])  # one for all but the first, since all count alike
    codes = ((parts - low) / step).round().to(torch.uint8)
    return {
        name: codes.numpy(),
        f"{name}_basis": (basis * step.T).numpy(),
        f"{name}_offset": (basis @ low).numpy(),
    }


def _restored(about: dict[str, Any], arrays: dict[str, np.ndarray]) -> Kept:
    _check_measures(about)
    tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}
    exposure = float(about["exposure"])
    rows, columns = about["box"]
    inside = torch.from_numpy(np.flatnonzero(np.unpackbits(arrays["inside"], count=rows * columns)))
    alpha, matte = torch.zeros(2, rows * columns)
    alpha[inside] = tensors["coverage"].float()
    if "matte" in tensors:
        matte[inside] = tensors["matte"].float()
    else:
        matte = alpha
    size, (top, left) = tuple(about["size"]), about["corner"]
    box = rows, columns
    person = Foreground(size, (top, left), alpha.view(box), matte.view(box), bool(about["photographed"]))
    framing = Framing(tuple(about["centre"]), about["scale"], tuple(arrays["within"].shape), box)
    on_plate = framing.shifted(left, top, size)
    camera = Camera(**{name: _tuple(value) for name, value in about["camera"].items()})
    given = _lengthened(arrays["given_albedo"]).T if "given_albedo" in arrays else None
    colour = _lengthened(arrays["colour"]).T / _unit(exposure)
    return Kept(person, colour, given, exposure, framing, _canvas(tensors, on_plate, camera, exposure))


def _check_measures(about: dict[str, Any]) -> None:
    """ValueError for measures that no person in a picture has."""
    size, corner, box = (tuple(about[name]) for name in ("size", "corner", "box"))
    camera = about["camera"]
    sides = list(zip(size, corner, box, strict=True))
    if not all(type(pixels) is int for side in sides for pixels in side):
        raise ValueError("measures in pixels are no whole numbers")
    if not all(0 <= first < first + extent <= whole for whole, first, extent in sides):
        raise ValueError(f"a box of {box} pixels at {corner} is not in a plate of {size}")
    if tuple(camera["size"]) != size:
        raise ValueError(f"the camera's plate is one of {camera['size']} pixels, not of {size}")
    positive = [about["exposure"], about["scale"], camera["focal"], camera["distance"]]
    if not np.isfinite([*positive, *about["centre"], *camera["middle"], camera["bottom"]]).all():
        raise ValueError("a measure is not finite")
    if min(positive) <= 0:
        raise ValueError(f"expected measures above zero, got {min(positive)}")


def _canvas(tensors: dict[str, torch.Tensor], framing: Framing, camera: Camera, exposure: float) -> Canvas:
    within = tensors["within"]
    place = Pixels(within)

    def taken(name: str) -> torch.Tensor:
        return tensors[name].float()

    def maps(name: str) -> torch.Tensor:
        return torch.addmm(tensors[f"{name}_offset"], tensors[f"{name}_basis"], taken(name))

    field = Field(place, taken("normals"), taken("sharpness"), maps("cast"), maps("residual"))
    visibility, shading = field.functions()
    light = place.scatter(taken("light")) / _unit(exposure) if "light" in tensors else None
    depth = place.scatter(taken("depth"))[0]
    return Canvas(
        framing,
        within > 1,
        tensors["image"] * (GUIDE / 255),
        place.scatter(field.normals),
        visibility,
        shading,
        place.scatter(taken("albedo")),
        light,
        Space(camera, framing, Given(depth, within > 1)),
    )


def _tuple(value: Any) -> Any:
    """JSON's lists as the tuples that they were."""
    return tuple(value) if isinstance(value, list) else value


def _unit(exposure: float) -> float:
    """The power of two next to the exposure: half floats times it are about one, and round as before."""
    return 2.0 ** round(math.log2(exposure))


def _half(values: torch.Tensor) -> np.ndarray:
    return values.clamp(-HALF, HALF).half().numpy()


def _shortened(values: torch.Tensor) -> np.ndarray:
    """Values (C, P) >= 0 as half floats; of a large person the first bits of these, as integers."""
    halves = _half(values)
    if halves.shape[-1] <= LARGE:
        return halves
    bits = halves.view(np.uint16) + np.uint16(1 << SHORTENED - 1)
    return np.minimum(bits, halves.dtype.type(HALF).view(np.uint16)) >> SHORTENED


def _lengthened(array: np.ndarray) -> torch.Tensor:
    """The values of what `_shortened` returned."""
    halves = (array << SHORTENED).view(np.float16) if array.dtype == np.uint16 else array
    return torch.from_numpy(halves).float()


def _deflated(array: np.ndarray) -> bytes:
    strategy = zlib.Z_DEFAULT_STRATEGY
    if array.dtype == np.uint16:
        steps: Any = np.diff(array.view(np.int16), axis=-1, prepend=np.int16(0))
        array, strategy = (steps << 1) ^ (steps >> 15), zlib.Z_RLE  # noise has no matches farther away
    elif array.dtype == np.uint8:
        array = np.diff(array, axis=-1, prepend=np.uint8(0))  # modulo 256
    if array.itemsize == 2:
        array = np.ascontiguousarray(array).view(np.uint8).reshape(-1, 2).T
    deflater = zlib.compressobj(strategy=strategy)
    return deflater.compress(array.tobytes()) + deflater.flush()


def _inflated(data: np.ndarray, dtype: np.dtype, shape: tuple[int, ...]) -> np.ndarray:
    """The array of a tensor of bytes; ValueError where that is not of the size it says."""
    expected = math.prod(shape) * dtype.itemsize
    inflater = zlib.decompressobj()
    found = np.frombuffer(inflater.decompress(data.data, expected + 1), np.uint8)
    if len(found) != expected or not inflater.eof:
        raise ValueError(f"holds {len(found)} bytes of an array of {expected}")
    if dtype == np.uint8:
        return torch.tensor(found.reshape(shape)).cumsum(-1, dtype=torch.uint8).numpy()  # faster than NumPy's
    if dtype.itemsize == 2:
        low, high = found.reshape(2, -1)
        found = (high * np.uint16(256) | low).reshape(shape)
    if dtype == np.uint16:
        steps = torch.from_numpy((found >> 1).view(np.int16) ^ -(found & 1).view(np.int16))
        return steps.cumsum(-1, dtype=torch.int16).numpy().view(dtype)
    return found.view(dtype).reshape(shape).copy()
