"""USD stages, opened with care: what they draw in is inside their own folder, and composes without errors."""

from __future__ import annotations

import functools
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from relight.media.regular_file import check_regular_file
from relight.scene.usd import probe
from shadow.files import AnyPath, file_version
from shadow.installing import install_command

if TYPE_CHECKING:
    from pxr import Sdf, Usd

SUFFIXES = (".usda", ".usdc", ".usdz", ".usd")
MOST_LAYERS = 10_000
TEXT = b"#usda"
# What a binary layer may take while it is read for the first time: bytes of memory, USD's own included, and
# seconds of a processor; more for large ones. The time on the clock is bounded too, on a busy machine.
MEMORY, MEMORY_PER_BYTE = 3 << 30, 16
BEYOND = "is damaged: USD ends, or takes too much memory or time, while it reads it"
SECONDS, BYTES_PER_SECOND, WALL = 20, 10 << 20, 6


def usd() -> ModuleType:
    """Return the package `pxr`; ModuleNotFoundError with advice where it is missing."""
    try:
        import pxr
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(f"USD needs the extra scene: {install_command('scene')}") from error
    return pxr


def open_stage(path: AnyPath, *, allow_external: bool = False) -> Usd.Stage:
    """Open a USD stage: .usda, .usdc, .usdz or .usd.

    `allow_external` lets the stage draw in files from outside its own folder. Raises FileNotFoundError if the
    file, or one that it draws in, is missing; ValueError for no USD file, files from outside its folder,
    layers that include themselves and other errors of composition.
    """
    usd()
    from pxr import Tf, Usd

    path = check_regular_file(path)
    _check_binary(path)
    try:
        layer = _opened(str(path.resolve()))
    except Tf.ErrorException as error:
        raise ValueError(f"{path}: is not a USD stage: {first_line(error)}") from error
    if layer is None:
        raise ValueError(f"{path}: is not a USD stage")
    folder = path.resolve().parent
    try:
        _check_layers(path, layer, folder, allow_external)
        stage = Usd.Stage.Open(layer)
    except Tf.ErrorException as error:
        raise ValueError(f"{path}: cannot be composed: {first_line(error)}") from error
    errors = stage.GetCompositionErrors()
    if errors:
        raise ValueError(f"{path}: cannot be composed: {first_line(errors[0])}")
    return stage


def _opened(file: str) -> Sdf.Layer | None:
    """Return the layer of a file, None for no USD file; raises Tf.ErrorException if it cannot be read."""
    from pxr import Sdf

    layer = Sdf.Layer.FindOrOpen(file)
    if layer is not None:
        layer.Reload()  # somebody may have opened it before it changed
    return layer


def _check_binary(path: Path, asset: str | None = None) -> None:
    """Raise ValueError if a binary layer cannot be read within bounds; text is let pass.

    `asset`: what USD calls a file that the stage at `path` draws in.
    """
    file = path if asset is None else Path(asset.partition("[")[0])
    try:
        with file.open("rb") as opened:
            is_text = opened.read(len(TEXT)) == TEXT
    except OSError:
        return  # which is reported where the stage draws it in
    problem = "" if is_text else layer_problem(file.resolve(), file_version(file))
    if problem:
        raise ValueError(f"{path}: {problem}" if asset is None else f"{path}: draws in {asset}: {problem}")


@functools.lru_cache(maxsize=64)
def layer_problem(path: Path, version: tuple[int, ...]) -> str:
    """Return what is wrong with a USD file, by a process of its own that reads it; "" for nothing.

    `version` tells the cache when the file has been written again. Where no such process starts, as in some
    hosts of Python, nothing is known to be wrong.
    """
    size = path.stat().st_size
    seconds = SECONDS + size // BYTES_PER_SECOND
    limits = (str(MEMORY + MEMORY_PER_BYTE * size), str(seconds))
    program = [sys.executable, "-P", str(Path(__file__).with_name("probe.py")), str(path), *limits]
    with tempfile.TemporaryDirectory(prefix="relight-", ignore_cleanup_errors=True) as folder:
        surroundings = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        surroundings |= {"TMPDIR": folder}  # USD reports its crashes there
        try:
            ran = subprocess.run(
                program, capture_output=True, env=surroundings, timeout=WALL * seconds, check=False
            )
        except subprocess.TimeoutExpired:
            return BEYOND
        except OSError:
            return ""
    started, _, problem = ran.stdout.decode(errors="replace").partition("\n")
    if started != probe.STARTED or ran.returncode == 0:
        return ""
    return problem.strip() if ran.returncode == probe.REFUSED else BEYOND


def check_inside(path: AnyPath, found: str, what: str) -> None:
    """Raise ValueError unless the file `found`, which `what` names, is inside the folder of a stage."""
    folder = Path(path).resolve().parent
    real = Path(os.path.realpath(found.partition("[")[0]))
    if folder not in real.parents:
        raise ValueError(
            f"{path}: {what} lies outside the stage's folder, {found}; move it there, or allow external "
            "files (allow_external=True)"
        )


def _check_layers(path: Path, layer: Sdf.Layer, folder: Path, allow_external: bool) -> None:
    """Follow what a layer draws in; errors for missing and external files, and for layers in a circle."""

    done: set[str] = set()

    def follow(layer: Sdf.Layer, above: tuple[str, ...]) -> None:
        if layer.identifier in above:
            raise ValueError(f"{path}: includes itself, by way of {layer.GetDisplayName()}")
        if layer.identifier in done:
            return
        done.add(layer.identifier)
        _check_specs(path, layer)
        if len(done) > MOST_LAYERS:
            raise ValueError(f"{path}: draws in more than {MOST_LAYERS} files")
        for asset in filter(None, layer.GetCompositionAssetDependencies()):  # "" refers within the layer
            if not allow_external and os.path.isabs(asset):
                raise ValueError(
                    f"{path}: has the absolute path {asset}; expected one relative to the stage, or allow "
                    "external files (allow_external=True)"
                )
            resolved = layer.ComputeAbsolutePath(asset)
            if not allow_external:
                check_inside(path, resolved, asset)
            _check_binary(path, resolved)
            below = _opened(resolved)
            if below is None:
                raise FileNotFoundError(f"{path}: draws in {asset}, which is missing or no USD file")
            follow(below, (*above, layer.identifier))

    follow(layer, ())


def _check_specs(path: Path, layer: Sdf.Layer) -> None:
    """Raise ValueError if a layer lists prims or properties that it does not hold.

    USD ends the process where it composes such a layer, which a damaged .usdc can be.
    """
    from pxr import Sdf

    listed: list[Sdf.Spec] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, listed.append)
    # Targets of relationships and connections are listed too, and are no objects of their own.
    specs = [each for each in listed if each.IsPrimPath() or each.IsPrimPropertyPath()]
    if not all(layer.GetObjectAtPath(spec) for spec in specs):
        raise ValueError(f"{path}: is damaged: {layer.GetDisplayName()} lists what it does not hold")


def first_line(error: object) -> str:
    """Return the first line of USD's message, without the place in USD's own source."""
    try:
        said = " ".join(str(error).split())
    except UnicodeDecodeError:  # USD quotes a damaged file
        return "it is damaged"
    match = re.search(r" : '(.*?)'(?= Error in |$)", said)  # the first of several
    return re.sub(r"pxrInternal\S*", "the grammar", match[1] if match else said)[:300]
