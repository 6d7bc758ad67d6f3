"""Infer a matte with a third-party network, as an ONNX file that the user provides.

The inputs and outputs of a file may identify one of `FAMILIES`, which says how its input is prepared.
Otherwise the caller has to say it: with the wrong input, a network silently returns a wrong matte.
"""

import os
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit

from relight import quantities
from relight.arguments import checks_arguments
from relight.errors import EmptyMatteError
from relight.matting import cutout_network, silhouette_files
from relight.matting.people.finder import NOBODY, FoundPerson
from relight.matting.refine import PersonChoice, encoded_srgb, opaque_photograph, select_person
from shadow.files import AnyPath, is_path
from shadow.installing import install_command
from shadow.networks.onnx import MAX_SIDE, OnnxFile, Preprocessing, checked_maps
from shadow.torch_settings import isolated


class ModelOptions(TypedDict, total=False):
    """How a network's input is prepared and its output read, see `load`."""

    family: str | None
    size: int | None
    mean: Iterable[float] | None
    std: Iterable[float] | None
    order: str | None
    fit: str | None
    output: int | None
    sigmoid: bool | None
    silhouette: str | None


class Normalisation(TypedDict):
    """Of red, green and blue: the input is (value - mean) / std."""

    mean: tuple[float, ...]
    std: tuple[float, ...]


AUTO = "auto"  # the model that finds the person
IMAGENET: Normalisation = {"mean": (0.485, 0.456, 0.406), "std": (0.229, 0.224, 0.225)}
STATES = ("r1i", "r2i", "r3i", "r4i")
MIN_CODE_PEAK = 32  # a matte in codes of 8 bits reaches this where anybody is, and logits do not
RVM_INFERENCE_SIDE = 512  # pixels of the longer side at which RVM looks at the whole picture, for full bodies
# The size and licence of files that rembg downloads, for the warning before it does.
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
    """How the input of a kind of network is prepared, and its output read.

    preprocessing: see `shadow.networks.onnx.Preprocessing`. output: index of the matte among the outputs.
    sigmoid: whether the file lacks the sigmoid that makes a matte of its output.
    """

    preprocessing: Preprocessing
    output: int = 0
    sigmoid: bool = False


FAMILIES = {
    # Qin et al., Pattern Recognition 2020: seven maps, the first fused from the others.
    "u2net": Family(Preprocessing(320, **IMAGENET)),
    # Qin et al., ECCV 2022 (DIS).
    "isnet": Family(Preprocessing(1024, mean=(0.5, 0.5, 0.5))),
    # Zheng et al., CAAI AIR 2024.
    "birefnet": Family(Preprocessing(1024, **IMAGENET), sigmoid=True),
    # Ke et al., AAAI 2022.
    "modnet": Family(Preprocessing(512, "short", mean=(0.5, 0.5, 0.5), std=(0.5, 0.5, 0.5))),
    # Saleh et al., ICCV 2025: the model that finds the foreground alone, and the one that finds three things.
    "david": Family(Preprocessing(512, "pad", order="bgr")),
    "david-multitask": Family(Preprocessing(512, "pad", order="bgr"), output=2),
}


class MattingModel(Protocol):
    """A function from a photograph (H, W, 3), sRGB-encoded in [0, 1], to its matte (H, W) in [0, 1].

    recurrent: whether its state depends on the frames before; after `reset` the next frame is the first.
    selects: whether its matte is that of the chosen person already, and not of everybody.
    """

    recurrent: bool
    selects: bool

    def __call__(self, encoded: np.ndarray) -> np.ndarray: ...

    def reset(self) -> None: ...


@isolated
@checks_arguments
def matte(
    image: ArrayLike, model: quantities.File, *, person: PersonChoice = None, **options: Unpack[ModelOptions]
) -> np.ndarray:
    """Infer the matte of the person in a photograph.

    Parameters
    ----------
    image
        (H, W, 3|4), opaque. Integers are sRGB-encoded; floats linear Rec.709.
    model
        "auto", which finds people (see `relight.matting.people.finder`); the path of an ONNX file; or a name
        that rembg knows, such as "u2net_human_seg", whose file rembg downloads once (a warning says which,
        how large and under which licence, before it does).
    person
        Which of several people: 1 is the largest, the default, 2 the next; (x, y), in pixels from the top
        left, selects the one nearest to that point; "all" takes everybody together. An ONNX file and rembg
        tell apart only people who do not touch.
    options
        The input format of a file of an unknown family, see `load`.

    Returns
    -------
    np.ndarray
        (H, W) float32 in [0, 1].

    Raises
    ------
    ImportError
        Onnxruntime or rembg is missing (the extra `matte`); or OpenVINO (the extra `auto`).
    relight.errors.MissingNetworksError
        The networks of "auto" have not been fetched: `relight fetch person`.
    FileNotFoundError
        No such file.
    TypeError, ValueError
        An image that `relight.Subject` refuses; a file that is not an ONNX model, or of an unknown family; a
        matte with NaN, or one that covers everything.
    relight.errors.EmptyMatteError
        The network found no person.

    Examples
    --------
    >>> import numpy as np, relight
    >>> photograph = np.full((64, 48, 3), 0.5, np.float32)
    >>> relight.matte(photograph, "missing.onnx")
    Traceback (most recent call last):
        ...
    FileNotFoundError: missing.onnx: no such file
    """
    network = load(model, person=person, **options)
    found = checked_matte(network(encoded_srgb(opaque_photograph(image))), model)
    return found if network.selects else select_person(found, person)


def load(
    model: AnyPath,
    *,
    person: PersonChoice = None,
    family: str | None = None,
    size: int | None = None,
    mean: Iterable[float] | None = None,
    std: Iterable[float] | None = None,
    order: str | None = None,
    fit: str | None = None,
    output: int | None = None,
    sigmoid: bool | None = None,
    silhouette: str | None = None,
) -> MattingModel:
    """Load a matting network from an ONNX file, or by a name that rembg knows.

    `model` and `person` as in `matte`; "auto" finds each person by itself, and cuts them out by the network
    that `relight fetch silhouette` brings, or by that of the file `silhouette`, which sees single pictures
    and which the other options describe then; "matting" is the package's own network, and a .safetensors file
    one that `relight train matting` wrote. `family`: one of `FAMILIES`, unless the file's inputs and
    outputs identify it. `size`, `mean`, `std`, `order`, `fit`: see `shadow.networks.onnx.Preprocessing`;
    without a known family `mean` and `std` are needed, and `size` unless the file has one. `output`: index of
    the matte among the file's outputs. `sigmoid`: whether the file lacks the sigmoid that makes a matte of
    its output. Raises as `matte` does.
    """
    if not is_path(model):
        raise TypeError(
            f"matte: expected 'auto', an .onnx file or the name of a model, got {type(model).__name__}; "
            "give the matte itself as mask"
        )
    given: dict[str, object] = {"size": size, "order": order, "fit": fit}
    given |= {"mean": None if mean is None else tuple(mean), "std": None if std is None else tuple(std)}
    preparation: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    options: dict[str, object] = {"output": output, "sigmoid": sigmoid}
    reading: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
    if model == AUTO:
        if silhouette is not None and cutout_network.is_one(silhouette):
            if preparation or reading or family:
                raise ValueError(f"silhouette: {silhouette} takes no options")
            return FoundPerson(person, cutout_network.CutoutNetwork(silhouette))
        if silhouette is not None:
            network = load(silhouette, family=family, **preparation, **reading)
            if network.selects or network.recurrent:
                raise ValueError(f"silhouette: expected a network of single pictures, got {silhouette}")
            return FoundPerson(person, lambda crop, mask: network(crop))
        if preparation or reading or family:
            raise ValueError("matte: 'auto' takes no options without silhouette=FILE, which they are of")
        finder = FoundPerson(person)
        if not silhouette_files.are_fetched():
            warnings.warn(
                "matte: the network that cuts people out is the package's own, of 512 pixels a side; "
                f"{silhouette_files.COMMAND} brings {silhouette_files.ABOUT}, which keeps more of hair, "
                "hands and what people hold",
                stacklevel=3,
            )
        return finder
    if silhouette is not None:
        raise ValueError("silhouette: expected the model 'auto', which finds the person for it")
    if Path(model).suffix.lower() != ".onnx":
        if preparation or reading or family:
            raise ValueError(f"matte: rembg prepares the input of {model} itself; expected no options")
        return _Rembg(str(model))
    file = OnnxFile(model)
    if set(STATES) | {"src"} <= set(file.inputs) and "pha" in file.outputs:
        if preparation or reading or family:
            raise ValueError(f"{model}: is of the family RVM, which takes no options")
        return _RobustVideoMatting(file)
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
        known = Family(Preprocessing(_side(model, shape[2])))
    family_of = replace(known, preprocessing=replace(known.preprocessing, **preparation), **reading)
    candidates = [index for index, channels in enumerate(file.channels) if channels == 1]
    if name is None and output is None and len(candidates) > 1:
        raise ValueError(
            f"output: {model} has several outputs that may be the matte, expected one of "
            f"{', '.join(map(str, candidates))}, counted from 0; its {file.signature()}"
        )
    if not 0 <= family_of.output < len(file.outputs):
        raise ValueError(f"output: expected one of {len(file.outputs)}, counted from 0, got {output}")
    return _StillNetwork(file, family_of)


def _family(file: OnnxFile) -> str | None:
    """Return the family of networks that a file's inputs and outputs identify, or None.

    IS-Net and DAViD's foreground model are not identified: many files have one square input of their sizes.
    """
    name, shape = next(iter(file.inputs.items()))
    if shape[2:] == (320, 320) and len(file.outputs) == 7:
        return "u2net"
    if name == "input_image" and [*file.outputs] == ["output_image"] and shape[2:] == (1024, 1024):
        return "birefnet"
    if shape == ("batch_size", 3, "height", "width") and [name, *file.outputs] == ["input", "output"]:
        return "modnet"
    if shape[2:] == (512, 512) and file.channels == [1, 3, 1]:
        return "david-multitask"
    return None


def _side(model: AnyPath, size: int | str | None) -> int:
    """Return the side of the input that a file states, 1 where it is free."""
    side = size if isinstance(size, int) else 1
    if side > MAX_SIDE:
        raise ValueError(f"{model}: expected an input of up to {MAX_SIDE} pixels a side, got {side}")
    return side


class _StillNetwork:
    """A network that sees one photograph at a time."""

    recurrent = False
    selects = False

    def __init__(self, file: OnnxFile, family: Family) -> None:
        self._file, self._family = file, family

    def __call__(self, encoded: np.ndarray) -> np.ndarray:
        file, family = self._file, self._family
        found = file.maps(encoded, family.preprocessing, family.output, 1)
        low, high = float(found.min()), float(found.max())
        codes = low >= 0 and MIN_CODE_PEAK <= high <= 255.5  # logits are negative off the person
        if family.sigmoid and (codes or 0 <= low <= high <= 1):
            full = 255 if codes else 1
            raise ValueError(f"{file.path}: answers within [0, {full}] already: expected sigmoid=False")
        if codes:
            found, low, high = found / 255, low / 255, high / 255
        if not family.sigmoid and not -0.02 <= low <= high <= 1.02:
            advice = ": a file that lacks its sigmoid wants sigmoid=True" if low < 0 else ", or in [0, 255]"
            raise ValueError(f"{file.path}: expected a matte in [0, 1], got [{low:.3g}, {high:.3g}]{advice}")
        found = expit(found) if family.sigmoid else found
        size = (encoded.shape[0], encoded.shape[1])
        return family.preprocessing.restore(found, size)[..., 0].clip(0, 1)

    def reset(self) -> None:
        """Do nothing: the network has no state."""


class _RobustVideoMatting:
    """Robust Video Matting (Lin et al., WACV 2022): each frame with the states that the last one left."""

    recurrent = True
    selects = False

    def __init__(self, file: OnnxFile) -> None:
        self._file = file
        self.reset()

    def reset(self) -> None:
        self._states = {name: np.zeros((1, 1, 1, 1), np.float32) for name in STATES}

    def __call__(self, encoded: np.ndarray) -> np.ndarray:
        size = (encoded.shape[0], encoded.shape[1])
        feeds = {"src": np.ascontiguousarray(encoded.transpose(2, 0, 1)[None], np.float32), **self._states}
        if "downsample_ratio" in self._file.inputs:
            feeds["downsample_ratio"] = np.array([min(1, RVM_INFERENCE_SIDE / max(size))], np.float32)
        answers = dict(zip(self._file.outputs, self._file.run(feeds), strict=True))
        found = checked_maps(self._file.path, "pha", answers["pha"], 1)[0]
        if found.shape != size:
            raise ValueError(f"{self._file.path}: expected a matte of {size}, got {found.shape}")
        self._states = {name: answers[name.replace("i", "o")] for name in STATES}
        return found.clip(0, 1)


class _Rembg:
    """A network of rembg, which prepares its input and downloads its file once."""

    recurrent = False
    selects = False

    def __init__(self, name: str) -> None:
        try:
            from rembg.session_factory import new_session
            from rembg.sessions import sessions
        except ImportError as error:
            raise ImportError(
                f"matte: {name} is no .onnx file, and for a name rembg is needed; install it with: "
                f"{install_command('matte')}"
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

    def reset(self) -> None:
        """Do nothing: the network has no state."""


def checked_matte(found: np.ndarray, model: AnyPath) -> np.ndarray:
    """Return a matte (H, W); raises `EmptyMatteError` if it shows nobody, ValueError if it is full."""
    if found.max() <= 0.5:
        nobody = f"matte: {model} found no person: its matte is nowhere above {found.max():.2g}"
        raise EmptyMatteError(NOBODY if model == AUTO else nobody)
    return reject_full_matte(found, model)


def reject_full_matte(found: np.ndarray, model: AnyPath) -> np.ndarray:
    """Return a matte (H, W); raises ValueError if it covers the whole picture."""
    if found.min() > 0.5:
        raise ValueError(f"matte: {model} covers everything: its matte is nowhere below {found.min():.2g}")
    return found
