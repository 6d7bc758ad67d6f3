"""A matte where the photograph has none: networks of others, as ONNX files that users bring themselves.

What a network wants is told by its file's inputs and outputs where these belong to a family of `FAMILIES`,
and has to be said where they do not: a network that is fed wrongly answers with a matte that is wrong, and
says nothing.
"""

import os
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import ArrayLike
from scipy.ndimage import distance_transform_edt, label
from scipy.special import expit

from relight.media import colour
from relight.media.images import scene_linear
from shadow.files import AnyPath
from shadow.onnxfiles import Feeding, OnnxFile, Shape, checked_maps

IMAGENET: dict[str, Any] = {"mean": (0.485, 0.456, 0.406), "std": (0.229, 0.224, 0.225)}
STATES = ("r1i", "r2i", "r3i", "r4i")
RVM_SIDE = 512  # pixels of the longer side at which RVM looks at the whole picture, for full bodies
PART = 0.1  # of the largest connected region's area: what is smaller is no person of its own
# What rembg downloads, for who wants to know before: bytes and licence, where they are known.
DOWNLOADS = {
    "u2net": "176 MB, Apache-2.0",
    "u2netp": "4.6 MB, Apache-2.0",
    "u2net_human_seg": "176 MB, Apache-2.0",
    "isnet-general-use": "179 MB, Apache-2.0",
    "birefnet-general": "973 MB, MIT",
    "birefnet-general-lite": "224 MB, MIT",
    "birefnet-portrait": "973 MB, MIT",
}


@dataclass(frozen=True)
class Family:
    """How networks of one kind are fed and read.

    feeding: as of `shadow.onnxfiles.Feeding`. output: which one is the matte, counted from 0.
    sigmoid: whether the matte is the sigmoid of it, because the file stops short of that.
    """

    feeding: Feeding
    output: int = 0
    sigmoid: bool = False


FAMILIES = {
    # Qin et al., Pattern Recognition 2020: seven maps, the first fused from the others.
    "u2net": Family(Feeding(320, **IMAGENET)),
    # Qin et al., ECCV 2022 (DIS).
    "isnet": Family(Feeding(1024, mean=(0.5, 0.5, 0.5))),
    # Zheng et al., CAAI AIR 2024.
    "birefnet": Family(Feeding(1024, **IMAGENET), sigmoid=True),
    # Ke et al., AAAI 2022.
    "modnet": Family(Feeding(512, "short", mean=(0.5, 0.5, 0.5), std=(0.5, 0.5, 0.5))),
    # Saleh et al., ICCV 2025: the model that finds the foreground alone, and the one that finds three things.
    "david": Family(Feeding(512, "pad", order="bgr")),
    "david-multitask": Family(Feeding(512, "pad", order="bgr"), output=2),
}


class Matter(Protocol):
    """What finds the matte (H, W) of a photograph (H, W, 3), sRGB-encoded in [0, 1].

    recurrent: whether it remembers the frames before; `forget` makes the next frame the first.
    """

    recurrent: bool

    def __call__(self, encoded: np.ndarray) -> np.ndarray: ...

    def forget(self) -> None: ...


def matte(image: ArrayLike, model: AnyPath, *, person: Any = None, **options: Any) -> np.ndarray:
    """The matte of the person in a photograph that has none.

    Parameters
    ----------
    image: (H, W, 3|4), opaque. Integers are sRGB-encoded; floats linear Rec.709.
    model: the path of an ONNX file; or a name that rembg knows, such as "u2net_human_seg", whose file rembg
        downloads once (a warning says which, how large and under which licence, before it does).
    person: of several people, apart from each other: 1 for the largest, the default, 2 for the next...; or
        (x, y), in pixels from the top left: the one nearest to that point.
    options: how a file is fed that is of no family known by its inputs and outputs: see `load`.

    Returns
    -------
    (H, W) float32 in [0, 1].

    Raises
    ------
    ImportError: onnxruntime or rembg is missing (the extra `matte`). FileNotFoundError: no such file.
    TypeError, ValueError: as `relight.Subject`; a file that is no ONNX model, or of an unknown family; one
    that answers with NaN, nobody, or a matte that covers everything.
    """
    found = load(model, **options)(encoded(opaque(image)))
    if found.max() <= 0.5:
        raise ValueError(f"matte: {model} found nobody: its matte is nowhere above {found.max():.2g}")
    return chosen(everywhere_not(found, model), person)


def load(
    model: AnyPath,
    *,
    family: str | None = None,
    size: int | None = None,
    mean: Iterable[float] | None = None,
    std: Iterable[float] | None = None,
    order: str | None = None,
    fit: str | None = None,
    output: int | None = None,
    sigmoid: bool | None = None,
) -> Matter:
    """What finds mattes, of an ONNX file or a name that rembg knows.

    Parameters
    ----------
    family: one of `FAMILIES`, where the file's inputs and outputs do not tell.
    size, mean, std, order, fit: as of `shadow.onnxfiles.Feeding`; where no family is known, `mean` and `std`
        are needed, and `size` unless the file has one.
    output: which of the file's outputs is the matte, counted from 0. sigmoid: whether it still lacks one.

    Raises as `matte`.
    """
    given: dict[str, Any] = {"size": size, "order": order, "fit": fit}
    given |= {"mean": None if mean is None else tuple(mean), "std": None if std is None else tuple(std)}
    feeding: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    told: dict[str, Any] = {"output": output, "sigmoid": sigmoid}
    reading: dict[str, Any] = {name: value for name, value in told.items() if value is not None}
    if Path(model).suffix.lower() != ".onnx":
        if feeding or reading or family:
            raise ValueError(f"matte: rembg knows how {model} is fed; expected no options")
        return _Rembg(str(model))
    file = OnnxFile(model)
    if set(STATES) | {"src"} <= set(file.inputs) and "pha" in file.outputs:
        if feeding or reading or family:
            raise ValueError(f"{model}: is of the family RVM, which takes no options")
        return _Recurrent(file)
    picture = file.picture
    name = family or _family(file)
    if name is not None and name not in FAMILIES:
        raise ValueError(f"family: expected one of {', '.join(FAMILIES)}, got {name!r}")
    shape = file.inputs[picture]
    if name is not None:
        known = FAMILIES[name]
    elif mean is None or std is None or (size is None and not isinstance(shape[2], int)):
        raise ValueError(
            f"{model}: is of no known family: expected family, or mean, std and size; its {file.signature()}"
        )
    else:
        known = Family(Feeding(shape[2] if isinstance(shape[2], int) else 1))
    family_of = replace(known, feeding=replace(known.feeding, **feeding), **reading)
    if not 0 <= family_of.output < len(file.outputs):
        raise ValueError(f"output: expected one of {len(file.outputs)}, counted from 0, got {output}")
    return _Still(file, family_of)


def _family(file: OnnxFile) -> str | None:
    """The family that a file's inputs and outputs tell for sure, or None.

    IS-Net and DAViD's foreground model are not told: many files have one square input of their sizes.
    """
    (name, shape), outputs = next(iter(file.inputs.items())), list(file.outputs.values())
    if shape[2:] == (320, 320) and len(outputs) == 7:
        return "u2net"
    if name == "input_image" and [*file.outputs] == ["output_image"] and shape[2:] == (1024, 1024):
        return "birefnet"
    if shape == ("batch_size", 3, "height", "width") and [name, *file.outputs] == ["input", "output"]:
        return "modnet"
    if shape[2:] == (512, 512) and [_channels(output) for output in outputs] == [1, 3, 1]:
        return "david-multitask"
    return None


def _channels(shape: Shape) -> int | str | None:
    return shape[1] if len(shape) == 4 else 1


class _Still:
    """A network that sees one photograph at a time."""

    recurrent = False

    def __init__(self, file: OnnxFile, family: Family) -> None:
        self._file, self._family = file, family

    def __call__(self, encoded: np.ndarray) -> np.ndarray:
        file, family = self._file, self._family
        fed = family.feeding.fed(encoded)
        answer = file.run({file.picture: fed})[family.output]
        found = checked_maps(file.path, [*file.outputs][family.output], answer, 1)
        low, high = float(found.min()), float(found.max())
        if family.sigmoid and 0 <= low <= high <= 1:
            raise ValueError(f"{file.path}: answers within [0, 1] already: expected sigmoid=False")
        if not family.sigmoid and not -0.02 <= low <= high <= 1.02:
            raise ValueError(
                f"{file.path}: expected a matte in [0, 1], got [{low:.3g}, {high:.3g}]: a file that "
                "lacks its sigmoid wants sigmoid=True"
            )
        found = expit(found) if family.sigmoid else found
        size = (encoded.shape[0], encoded.shape[1])
        return family.feeding.laid(found, size)[..., 0].clip(0, 1)

    def forget(self) -> None:
        """Nothing to forget."""


class _Recurrent:
    """Robust Video Matting (Lin et al., WACV 2022): each frame with the states that the last one left."""

    recurrent = True

    def __init__(self, file: OnnxFile) -> None:
        self._file = file
        self.forget()

    def forget(self) -> None:
        self._states = {name: np.zeros((1, 1, 1, 1), np.float32) for name in STATES}

    def __call__(self, encoded: np.ndarray) -> np.ndarray:
        size = (encoded.shape[0], encoded.shape[1])
        feeds = {"src": np.ascontiguousarray(encoded.transpose(2, 0, 1)[None], np.float32), **self._states}
        if "downsample_ratio" in self._file.inputs:
            feeds["downsample_ratio"] = np.array([min(1, RVM_SIDE / max(size))], np.float32)
        answers = dict(zip(self._file.outputs, self._file.run(feeds), strict=True))
        found = checked_maps(self._file.path, "pha", answers["pha"], 1)[0]
        if found.shape != size:
            raise ValueError(f"{self._file.path}: expected a matte of {size}, got {found.shape}")
        self._states = {name: answers[name.replace("i", "o")] for name in STATES}
        return found.clip(0, 1)


class _Rembg:
    """A network of rembg's, which knows how it is fed, and downloads its file once."""

    recurrent = False

    def __init__(self, name: str) -> None:
        try:
            from rembg.session_factory import new_session
            from rembg.sessions import sessions
        except ImportError as error:
            raise ImportError(
                f"matte: {name} is no .onnx file, and for a name rembg is needed; install it with: "
                "pip install 'relight[matte]'"
            ) from error
        known = sorted({found if isinstance(found, str) else found.name() for found in sessions})
        if name not in known:
            raise ValueError(f"matte: expected an .onnx file or one of {', '.join(known)}; got {name}")
        home = Path(os.environ.get("U2NET_HOME") or Path.home() / ".u2net").expanduser()
        if not (home / f"{name}.onnx").is_file():
            what = DOWNLOADS.get(name, "of a size and licence that rembg's page says")
            warnings.warn(f"matte: rembg downloads {name}.onnx ({what}) to {home}", stacklevel=4)
        self._name, self._session = name, new_session(name)

    def __call__(self, encoded: np.ndarray) -> np.ndarray:
        from PIL import Image

        picture = Image.fromarray(np.rint(encoded * 255).astype(np.uint8))
        return np.asarray(self._session.predict(picture)[0].convert("L"), np.float32) / 255

    def forget(self) -> None:
        """Nothing to forget."""


def opaque(image: ArrayLike) -> np.ndarray:
    """A photograph as (H, W, 3), linear; ValueError where it has transparency."""
    pixels = scene_linear("image", image)
    if pixels.shape[-1] == 4 and pixels[..., 3].min() < 1:
        raise ValueError("image: has transparency, which is a matte already; expected an opaque photograph")
    return pixels[..., :3]


def encoded(pixels: np.ndarray) -> np.ndarray:
    """Linear (H, W, 3) as networks of others want it: sRGB-encoded, [0, 1]."""
    return colour.encode(pixels.clip(0, 1)).clip(0, 1).astype(np.float32)


def everywhere_not(found: np.ndarray, model: AnyPath) -> np.ndarray:
    """A matte as it is; ValueError where it covers the whole picture."""
    if found.min() > 0.5:
        raise ValueError(f"matte: {model} covers everything: its matte is nowhere below {found.min():.2g}")
    return found


def chosen(found: np.ndarray, person: Any = None) -> np.ndarray:
    """A matte (H, W) of one of several people, as `matte` says; of one, the matte as it is.

    People are regions above 0.5 that do not touch; each takes the soft edge and small parts nearest to it.
    """
    regions, count = label(found > 0.5, np.ones((3, 3)))
    areas = np.bincount(regions.ravel(), minlength=count + 1)[1:]
    order = np.argsort(-areas, kind="stable") + 1
    people = [int(region) for region in order if areas[region - 1] >= PART * areas.max()]
    if not people:
        return found
    owner = np.where(np.isin(regions, people), regions, 0)
    nearest = distance_transform_edt(owner == 0, return_distances=False, return_indices=True)
    owner = owner[tuple(nearest)]
    if np.ndim(person) == 1:
        x, y = (int(value) for value in person)
        if not (0 <= x < found.shape[1] and 0 <= y < found.shape[0]):
            raise ValueError(f"person: expected a point in the picture, got {x}/{y}")
        return np.where(owner == owner[y, x], found, 0)
    number = 1 if person is None else person
    if not isinstance(number, int) or not 1 <= number <= len(people):
        raise ValueError(f"person: expected 1 to {len(people)}, as many as there are people, got {person!r}")
    return np.where(owner == people[number - 1], found, 0)


def refined(pixels: np.ndarray, rough: np.ndarray, band: int) -> np.ndarray:
    """A matte (H, W) of a rough mask (H, W) and its photograph (H, W, 3), linear: what lies in a band of
    `band` pixels around the mask's edge is solved by closed-form matting (Levin et al. 2008).

    ValueError for a band of less than 2 pixels, or so wide that nobody is left inside it.
    """
    if band < 2:
        raise ValueError(f"refine_matte: expected a band of 2 pixels or more, got {band}")
    inside = rough > 0.5
    depth = np.where(inside, distance_transform_edt(inside), -distance_transform_edt(~inside))
    if not (depth > band / 2).any() or not (depth < -band / 2).any():
        raise ValueError(f"refine_matte: a band of {band} pixels leaves nothing of the person or behind them")
    trimap = np.where(depth > band / 2, 1.0, np.where(depth < -band / 2, 0.0, 0.5))
    rows, columns = np.nonzero(trimap > 0)
    box = np.s_[max(rows.min() - 2, 0) : rows.max() + 3, max(columns.min() - 2, 0) : columns.max() + 3]
    solve = _pymatting("alpha.estimate_alpha_cf", "estimate_alpha_cf")
    threads = torch.get_num_threads()
    alpha = np.zeros(rough.shape, np.float32)
    alpha[box] = solve(encoded(pixels[box]).astype(float), trimap[box]).clip(0, 1)
    torch.set_num_threads(threads)  # numba has set the process' to the number of processors
    return alpha


def cut_out(pixels: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """A person (H, W, 4), linear and premultiplied, of a photograph (H, W, 3), linear, and the matte (H, W):
    their own colours at soft edges by multi-level foreground estimation (Germer et al. 2020)."""
    estimate = _pymatting("foreground.estimate_foreground_ml", "estimate_foreground_ml")
    threads = torch.get_num_threads()
    own = estimate(pixels, alpha).clip(0)
    torch.set_num_threads(threads)
    own = np.where(alpha[..., None] >= 1, pixels, own)
    return np.concatenate([own * alpha[..., None], alpha[..., None]], axis=-1, dtype=np.float32)


def _pymatting(module: str, name: str) -> Any:
    from importlib import import_module

    try:
        return getattr(import_module(f"pymatting.{module}"), name)
    except ImportError as error:
        raise ImportError("matte: needs PyMatting; install it with: pip install 'relight[matte]'") from error
