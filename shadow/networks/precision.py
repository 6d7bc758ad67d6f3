"""The precision in which networks run: bfloat16 where the processor has it natively, float32 elsewhere.

On x86-64 without AVX-512's bfloat16 instructions, bfloat16 is 5 to 13 times slower than float32. With them,
but without AMX, an Intel core takes 1.4 times as long in bfloat16.
"""

import copy
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from weakref import WeakKeyDictionary

import torch
from torch import nn

PRECISIONS = ("bfloat16", "float32")
_CHOSEN: ContextVar[str | None] = ContextVar("precision", default=None)
_FROZEN: WeakKeyDictionary[nn.Module, nn.Module | None] = WeakKeyDictionary()  # network: its bfloat16 copy
_CASTING = threading.Lock()


def native_bfloat16(device: torch.device | str) -> bool:
    """Return whether bfloat16 is faster than float32 on a device of this machine.

    The answer is no for a processor that cannot be asked, and for one other than x86-64.
    """
    device = torch.device(device)
    if device.type == "cuda":
        with torch.cuda.device(device):
            return torch.cuda.is_bf16_supported(including_emulation=False)
    if device.type != "cpu":
        return False
    # What the processor supports, and what oneDNN (ONEDNN_MAX_CPU_ISA) and torch (ATEN_CPU_CAPABILITY) use of
    # it. Some of these functions are not public, or new, so another version of torch may lack them.
    try:
        supported = torch.cpu._is_avx512_bf16_supported() and torch.ops.mkldnn._is_mkldnn_bf16_supported()
        slow = not torch.cpu._is_amx_tile_supported() and "Intel" in torch.cpu.get_capabilities()["cpu_name"]
    except (AttributeError, RuntimeError):
        return False
    return supported and not slow and torch.backends.cpu.get_cpu_capability() == "AVX512"


@contextmanager
def using(precision: str | None) -> Iterator[None]:
    """Run the networks in `precision`, one of PRECISIONS, within this block.

    Machines with different processors agree in this way on one precision for a job. With None, each uses the
    fast one. Raises ValueError for any other value.
    """
    if precision is not None and precision not in PRECISIONS:
        raise ValueError(f"precision: expected {' or '.join(PRECISIONS)}, got {precision!r}")
    token = _CHOSEN.set(precision)
    try:
        yield
    finally:
        _CHOSEN.reset(token)


def in_use(device: torch.device | str) -> str:
    """Return the precision that networks run in on a device: the one chosen, or the fast one there."""
    return _CHOSEN.get() or ("bfloat16" if native_bfloat16(device) else "float32")


def autocast(device: torch.device | str, enabled: bool = True) -> AbstractContextManager:
    """Return the context in which a network runs in the precision that is `in_use`.

    With `enabled=False` it runs in float32, even inside another such context. Enclose the networks only:
    sampling positions in bfloat16 turned normals by 6 degrees.
    """
    device = torch.device(device)
    if enabled and in_use(device) == "bfloat16":
        return torch.autocast(device.type, torch.bfloat16)
    return torch.autocast(device.type, enabled=False)


def freeze(network: nn.Module) -> None:
    """Declare that a network's parameters never change again, so that a cast copy of them may be kept."""
    _FROZEN[network.requires_grad_(False)] = None


def with_cast_weights(network: nn.Module) -> nn.Module:
    """Return the network, or a copy with bfloat16 weights, to be called inside `autocast`.

    Autocast casts all weights at every call. The weights of a frozen network on the CPU are cast once
    instead, and the copy is kept as long as the network. It computes bit-identical values.
    """
    device = next(network.parameters()).device
    if network not in _FROZEN or device.type != "cpu" or in_use(device) != "bfloat16":
        return network
    with _CASTING:
        if (half := _FROZEN[network]) is None:
            convolutions = (module for module in network.modules() if isinstance(module, nn.Conv2d))
            cast = {
                id(parameter): nn.Parameter(parameter.bfloat16(), requires_grad=False)
                for convolution in convolutions
                for parameter in convolution.parameters()
            }
            _FROZEN[network] = half = copy.deepcopy(network, cast)  # the memo replaces the parameters
    return half
