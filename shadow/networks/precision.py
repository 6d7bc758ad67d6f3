"""In which precision a processor runs networks fastest: bfloat16 where it is native, else float32.

On x86-64 without AVX-512's bfloat16 instructions, bfloat16 is five to thirteen times slower than float32.
"""

import contextlib
from contextlib import AbstractContextManager

import torch


def native_bfloat16(device: torch.device | str) -> bool:
    """Whether bfloat16 is faster than float32 on a device of this machine."""
    device = torch.device(device)
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    if device.type != "cpu":
        return False
    # The one says which kernels torch takes, as ATEN_CPU_CAPABILITY may have it; the other, which no public
    # function says, what the processor has.
    supported = getattr(torch.cpu, "_is_avx512_bf16_supported", lambda: False)
    return torch.backends.cpu.get_cpu_capability() == "AVX512" and supported()


def autocast(device: torch.device | str, enabled: bool = True) -> AbstractContextManager:
    """The context in which a network runs in bfloat16 where that is native, else as it is.

    It belongs around networks alone: sampling positions in bfloat16 turned normals by 6 degrees.
    """
    device = torch.device(device)
    if enabled and native_bfloat16(device):
        return torch.autocast(device.type, torch.bfloat16)
    return contextlib.nullcontext()
