"""Weights by name: safetensors files shipped in the packages, checked against their sha256.

A file describes its network in its metadata, as JSON: `network` (the class), `config` (its constructor
arguments) and `recipe` (how it was trained). Tensors are stored as float16 and loaded as float32.
Convolutions may be stored as int8 with a scale for each output channel, which takes half the space.
"""

import functools
import hashlib
import json
import os
import reprlib
import textwrap
import threading
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as to_bytes
from torch import nn

from shadow.files import file_version, replacing
from shadow.framing import canvas_size
from shadow.networks.precision import freeze

Network = TypeVar("Network", bound=nn.Module)
_LOADING = threading.Lock()
SCALE = ".scale"  # suffix of the key of an int8 tensor's scales


class Origin(NamedTuple):
    """The source of a network's parameters, in `network.origin` of a network that was loaded from a file."""

    name: str  # file name without its suffix
    sha256: str | None  # of the file, or of the original if it was shrunk; unlike the name it is unique
    recipe: dict  # how it was trained, from the file's metadata


def sha256(path: str | os.PathLike) -> str:
    """Return the hexadecimal sha256 of a file."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read(
    path: str | os.PathLike, checksum: str | None = None
) -> tuple[dict[str, torch.Tensor], dict[str, str]]:
    """Read (state, metadata) from a .safetensors file. Raises ValueError if it is damaged."""
    data = Path(path).read_bytes()
    if checksum and hashlib.sha256(data).hexdigest() != checksum:
        raise ValueError(f"weights: {path} is damaged (its sha256 differs); install the package again")
    try:
        with safe_open(path, framework="pt") as file:
            state, metadata = {key: file.get_tensor(key) for key in file.keys()}, file.metadata() or {}  # noqa: SIM118
    except SafetensorError as error:
        raise ValueError(f"weights: {path} is not a safetensors file, or is truncated: {error}") from error
    scales = {key.removesuffix(SCALE): state.pop(key) for key in list(state) if key.endswith(SCALE)}
    try:
        return state | {key: state[key].float() * scale for key, scale in scales.items()}, metadata
    except (KeyError, RuntimeError) as error:
        raise ValueError(f"weights: {path} is damaged: a scale has no tensor of its size") from error


def check_finite(what: str, network: nn.Module) -> None:
    """Raise ValueError if a parameter is NaN or infinite; the message begins with `what`."""
    for key, value in network.state_dict().items():
        if not torch.isfinite(torch.stack(value.aminmax())).all():  # aminmax propagates NaN
            raise ValueError(f"{what} is damaged: {key} holds NaN or infinite values")


@functools.lru_cache(maxsize=8)
def _load(
    path: Path, version: tuple[int, ...], checksum: str | None, kinds: tuple, device: torch.device
) -> Any:
    """Load a file; `version` tells the cache when it has been written again, see `file_version`."""
    state, metadata = read(path, checksum)
    networks = dict(kinds)
    if metadata.get("network") not in networks:
        raise ValueError(
            f"weights: {path} holds a {metadata.get('network')!r} network, expected {' or '.join(networks)}"
        )
    if "config" not in metadata:
        raise ValueError(f"weights: {path} lacks the constructor arguments of its network (metadata config)")
    try:
        with torch.device("meta"):  # no memory and no random numbers for parameters that are replaced anyway
            network = networks[metadata["network"]](**json.loads(metadata["config"]))
        layouts = {4: torch.channels_last}
        values = {
            key: value.to(torch.float32, memory_format=layouts.get(value.ndim, torch.preserve_format))
            for key, value in state.items()
        }
        network.load_state_dict(values, strict=True, assign=True)
        canvas_size(network.size)
        recipe = json.loads(metadata.get("recipe", "{}"))
    except Exception as error:  # invalid constructor arguments raise many kinds of errors
        reason = textwrap.shorten(str(error), 300)
        raise ValueError(f"weights: {path} does not fit this version's network: {reason}") from error
    if checksum is None:  # shipped weights are finite, and undamaged
        check_finite(f"weights: {path}", network)
    identity = metadata.get("shrunk_from") or checksum or sha256(path)
    network.origin = Origin(path.stem, identity, recipe)
    network = network.eval().to(device, memory_format=torch.channels_last)
    freeze(network)
    return network


def load(
    name: str | os.PathLike,
    networks: Mapping[str, type[Network]],
    *,
    package: str,
    device: torch.device | str = "cpu",
) -> Network:
    """Load the network `name` for inference on `device`.

    The network is shared between all callers on that device, who must not change it. `name`: a name in
    `<package>/weights/index.json`, or the path of a .safetensors file. `networks`: {network: class}, the
    classes that are accepted. `package`: "shadow" or "shading".

    Raises ValueError if the name is unknown, the file is damaged, or the network is of another kind;
    FileNotFoundError if `name` is a path at which there is no file, or if the package runs from an archive.
    """
    kinds = tuple(networks.items())
    if not isinstance(name, str | os.PathLike):
        raise TypeError(f"model: expected the name of weights or of a file, got {type(name).__name__}")
    if str(name).endswith(".safetensors"):
        return _shared(Path(name).resolve(strict=True), None, kinds, device)
    folder = resources.files(package) / "weights"
    if not Path(str(folder)).is_dir():
        raise FileNotFoundError(
            f"weights: {folder} is within an archive; install the package, which unpacks it"
        )
    index = json.loads((folder / "index.json").read_text())
    if str(name) not in index:
        shown = reprlib.repr(str(name))
        raise ValueError(f"model: unknown weights {shown}, expected a .safetensors path or {sorted(index)}")
    return _shared(Path(str(folder / index[name]["file"])), index[name]["sha256"], kinds, device)


def checksum(name: str, package: str) -> str:
    """Return the sha256 of the weights `name` that "shadow" or "shading" ships."""
    return json.loads((resources.files(package) / "weights" / "index.json").read_text())[name]["sha256"]


def _shared(path: Path, checksum: str | None, kinds: tuple, device: torch.device | str) -> Any:
    with _LOADING:  # concurrent threads share one network
        return _load(path, file_version(path), checksum, kinds, torch.device(device))


def save(path: str | os.PathLike, network: nn.Module, kind: str, config: dict, recipe: dict) -> str:
    """Write `network` as float16 safetensors and return the file's sha256."""
    state = {
        key: value.detach().half() if value.is_floating_point() else value.detach()
        for key, value in network.state_dict().items()
    }
    metadata = {"network": kind, "config": json.dumps(config), "recipe": json.dumps(recipe)}
    return _write(path, state, metadata)


def shrink(source: str | os.PathLike, target: str | os.PathLike) -> str:
    """Store the convolutions of a weights file as int8 in a new file, and return its sha256.

    The values of an output channel are rounded to multiples of 1/127 of the largest magnitude. This changes
    the field's normals by 0.1 degrees on average.
    """
    state, metadata = read(source)
    small = {}
    for key, value in state.items():
        if value.ndim < 4:
            small[key] = value.half()
            continue
        scale = value.float().abs().amax(dim=(1, 2, 3), keepdim=True).clamp_min(1e-12) / 127
        small[key], small[key + SCALE] = (value.float() / scale).round().to(torch.int8), scale
    return _write(target, small, metadata | {"shrunk_from": sha256(source)})


def _write(path: str | os.PathLike, state: dict[str, torch.Tensor], metadata: dict[str, str]) -> str:
    """Write tensors and metadata; returns the file's sha256."""
    data = to_bytes({key: value.cpu().contiguous() for key, value in state.items()}, metadata)
    with replacing(path) as beside:
        beside.write_bytes(data)
    return sha256(path)
