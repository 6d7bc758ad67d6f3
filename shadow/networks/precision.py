"""In which precision a processor runs networks fastest: bfloat16 where it is native, else float32.

On x86-64 without AVX-512's bfloat16 instructions, bfloat16 is five to thirteen times slower than float32.
"""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar

import torch

PRECISIONS = ("bfloat16", "float32")
_CHOSEN: ContextVar[str | None] = ContextVar("precision", default=None)


def native_bfloat16(device: torch.device | str) -> bool:
    """Whether bfloat16 is faster than float32 on a device of this machine.

    A processor that cannot be asked, and one other than x86-64, counts as not.
    """
    device = torch.device(device)
    if device.type == "cuda":
        with torch.cuda.device(device):
            return torch.cuda.is_bf16_supported(including_emulation=False)
    if device.type != "cpu":
        return False
    # What the processor has; what oneDNN takes of it (ONEDNN_MAX_CPU_ISA), and torch (ATEN_CPU_CAPABILITY).
    # No public function says the first two, so another version of torch may lack the private ones.
    try:
        supported = torch.cpu._is_avx512_bf16_supported() and torch.ops.mkldnn._is_mkldnn_bf16_supported()
    except (AttributeError, RuntimeError):
        return False
    return supported and torch.backends.cpu.get_cpu_capability() == "AVX512"


@contextmanager
def using(precision: str | None) -> Iterator[None]:
    """Within this block networks run in that precision, of PRECISIONS, on any processor: so that machines
    that share a job agree. None leaves it to each. ValueError for what is neither."""
    if precision is not None and precision not in PRECISIONS:
        raise ValueError(f"precision: expected {' or '.join(PRECISIONS)}, got {precision!r}")
    token = _CHOSEN.set(precision)
    try:
        yield
    finally:
        _CHOSEN.reset(token)


def in_use(device: torch.device | str) -> str:
    """The precision that networks run in on a device: the one chosen, or what is fast there."""
    return _CHOSEN.get() or ("bfloat16" if native_bfloat16(device) else "float32")


def autocast(device: torch.device | str, enabled: bool = True) -> AbstractContextManager:
    """The context in which a network runs in the precision that is `in_use`; with `enabled=False` in float32,
    inside another such context too.

    It belongs around networks alone: sampling positions in bfloat16 turned normals by 6 degrees.
    """
    device = torch.device(device)
    if enabled and in_use(device) == "bfloat16":
        return torch.autocast(device.type, torch.bfloat16)
    return torch.autocast(device.type, enabled=False)
