"""In which precision a processor runs networks fastest: bfloat16 where it is native, else float32.

On x86-64 without AVX-512's bfloat16 instructions, bfloat16 is five to thirteen times slower than float32.
"""

from contextlib import AbstractContextManager

import torch


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


def autocast(device: torch.device | str, enabled: bool = True) -> AbstractContextManager:
    """The context in which a network runs in bfloat16 where that is native, else in float32; with
    `enabled=False` in float32, inside another such context too.

    It belongs around networks alone: sampling positions in bfloat16 turned normals by 6 degrees.
    """
    device = torch.device(device)
    if enabled and native_bfloat16(device):
        return torch.autocast(device.type, torch.bfloat16)
    return torch.autocast(device.type, enabled=False)
