"""OpenVINO, which runs the networks that find people and cut them out."""

import functools
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Protocol, TypeAlias

import numpy as np

from shadow.installing import install_command

HINTS = {"float32": "f32", "bfloat16": "bf16"}  # OpenVINO's names of precisions


class Answers(Protocol):
    """Arrays, in the order of a network's outputs."""

    def __getitem__(self, output: int, /) -> np.ndarray: ...

    def values(self) -> Iterable[np.ndarray]: ...


Network: TypeAlias = Callable[[np.ndarray], Answers]


@functools.lru_cache(maxsize=8)
def compiled(path: str, precision: str = "float32", threads: int = 1) -> Network:
    """Return the network of a file in a format of OpenVINO's, compiled for the processor.

    One thread and float32 let machines of one kind agree to the bit. Raises ImportError without OpenVINO.
    """
    settings = {
        "INFERENCE_NUM_THREADS": threads,
        "NUM_STREAMS": 1,
        "INFERENCE_PRECISION_HINT": HINTS[precision],
    }
    return openvino().Core().compile_model(path, "CPU", settings)


def openvino() -> ModuleType:
    """Import OpenVINO without its telemetry, which would report the import to its makers.

    Raises ImportError if OpenVINO is missing.
    """
    with _hidden("openvino_telemetry"):
        try:
            import openvino as package
        except ImportError as error:
            raise ImportError(
                f"matte: to find the person OpenVINO is needed; install it with: {install_command('auto')}"
            ) from error
    return package


@contextmanager
def _hidden(name: str) -> Iterator[None]:
    """Let a module look as if it were not installed."""
    before = {each: sys.modules.pop(each) for each in [*sys.modules] if each.split(".")[0] == name}
    sys.modules[name] = None  # type: ignore[assignment]  # Python's sign that it cannot be imported
    try:
        yield
    finally:
        del sys.modules[name]
        sys.modules.update(before)
