"""Torch's settings of the calling program: they neither change our results nor are changed by us.

A program may set a default dtype of float64, a default device, autocast or inference mode for its own work.
Public functions are `isolated` from all four: they compute in float32, on the device that they are given, and
what they return is an ordinary tensor. Default device, autocast and inference mode belong to the thread, and
the caller's are there again afterwards. The default dtype belongs to the process: if it is another one, it is
float32 while an isolated function runs, in other threads too.
"""

import functools
import inspect
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import ParamSpec, TypeVar

import torch

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
Class = TypeVar("Class", bound=type)
AUTOCAST = ("cpu", "cuda")


class _DefaultDtype:
    """Float32 as the default dtype while anybody needs it."""

    def __init__(self) -> None:
        self._lock, self._users, self._callers = threading.Lock(), 0, torch.float32

    def __enter__(self) -> None:
        with self._lock:
            if not self._users:
                self._callers = torch.get_default_dtype()
                torch.set_default_dtype(torch.float32)
            self._users += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._users -= 1
            if not self._users:
                torch.set_default_dtype(self._callers)


_float32 = _DefaultDtype()


@contextmanager
def own_settings() -> Iterator[None]:
    """Compute with our settings inside the block, and leave the caller's as they were.

    >>> torch.set_default_dtype(torch.float64)
    >>> with own_settings():
    ...     print(torch.zeros(1).dtype)
    torch.float32
    >>> torch.get_default_dtype()
    torch.float64
    >>> torch.set_default_dtype(torch.float32)
    """
    with ExitStack() as stack:
        if torch.get_default_dtype() != torch.float32 or _float32._users:
            stack.enter_context(_float32)
        if torch.get_default_device().type != "cpu":
            stack.enter_context(torch.device("cpu"))
        for kind in AUTOCAST:
            if torch.is_autocast_enabled(kind):
                stack.enter_context(torch.autocast(kind, enabled=False))
        if torch.is_inference_mode_enabled():
            stack.enter_context(torch.inference_mode(False))
        yield


def isolated(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Let a function compute with `own_settings`."""

    @functools.wraps(function)
    def run(*given: Arguments.args, **named: Arguments.kwargs) -> Result:
        with own_settings():
            return function(*given, **named)

    return run


def isolated_class(kind: Class) -> Class:
    """Let the methods and properties of a class compute with `own_settings`, generators apart."""
    for name, member in list(vars(kind).items()):
        if name.startswith("_") and name != "__init__":
            continue
        wrapped: object = None
        if isinstance(member, functools.cached_property):
            cached = functools.cached_property(isolated(member.func))
            cached.__set_name__(kind, name)
            wrapped = cached
        elif isinstance(member, property) and member.fget is not None:
            wrapped = property(isolated(member.fget), member.fset, member.fdel, member.__doc__)
        elif isinstance(member, classmethod):
            wrapped = classmethod(isolated(member.__func__))
        elif inspect.isfunction(member) and not inspect.isgeneratorfunction(member):
            wrapped = isolated(member)
        if wrapped is not None:
            setattr(kind, name, wrapped)
    return kind
