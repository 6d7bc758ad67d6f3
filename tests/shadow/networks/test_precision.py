"""Networks run in bfloat16 where that is fast, and in float32 by themselves elsewhere."""

import os
import subprocess
import sys

import pytest
import torch

from shadow.networks import precision
from shadow.networks.precision import autocast, freeze, native_bfloat16, with_cast_weights

CPU = torch.device("cpu")
AVX2 = {"ATEN_CPU_CAPABILITY": "avx2", "ONEDNN_MAX_CPU_ISA": "AVX2"}  # a processor without AVX-512


def test_a_processor_without_avx512_has_no_native_bfloat16():
    question = "import torch; from shadow.networks import precision; " \
        "print(precision.native_bfloat16(torch.device('cpu')))"  # fmt: skip
    for variables in (AVX2, AVX2 | {"ATEN_CPU_CAPABILITY": ""}):
        answer = subprocess.run(
            [sys.executable, "-c", question],
            env=os.environ | variables,
            capture_output=True,
            text=True,
            check=True,
        )
        assert answer.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("name", "amx", "native"),
    [("Intel Xeon", True, True), ("Intel Xeon", False, False), ("AMD EPYC", False, True)],
)
def test_an_intel_processor_without_amx_is_slower_in_bfloat16(monkeypatch, name, amx, native):
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: True)
    monkeypatch.setattr(torch.cpu, "_is_amx_tile_supported", lambda: amx)
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"cpu_name": name})
    monkeypatch.setattr(torch.ops.mkldnn, "_is_mkldnn_bf16_supported", lambda: True)
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: "AVX512")
    assert native_bfloat16(CPU) is native


def test_a_torch_that_cannot_be_asked_means_float32(monkeypatch):
    monkeypatch.delattr(torch.cpu, "_is_avx512_bf16_supported", raising=False)
    assert not native_bfloat16(CPU)
    assert not native_bfloat16(torch.device("mps"))


@pytest.mark.parametrize("native", [True, False])
def test_autocast_follows_the_processor(monkeypatch, native):
    monkeypatch.setattr("shadow.networks.precision.native_bfloat16", lambda device: native)
    layer, image = torch.nn.Conv2d(3, 4, 1), torch.zeros(1, 3, 8, 8)
    with autocast(CPU):
        assert layer(image).dtype == (torch.bfloat16 if native else torch.float32)
        with autocast(CPU, enabled=False):
            assert layer(image).dtype == torch.float32


def test_a_frozen_network_is_cast_once_and_computes_the_same(monkeypatch):
    monkeypatch.setattr(precision, "native_bfloat16", lambda device: True)
    network = torch.nn.Sequential(torch.nn.Conv2d(3, 8, 3), torch.nn.SiLU(), torch.nn.Conv2d(8, 2, 1))
    image = torch.rand(1, 3, 16, 16)
    assert with_cast_weights(network) is network  # its parameters may still change
    with torch.no_grad(), autocast(CPU):
        expected = network(image)
        freeze(network)
        copy = with_cast_weights(network)
        assert copy is with_cast_weights(network)
        assert torch.equal(copy(image), expected)
    assert {parameter.dtype for parameter in copy.parameters()} == {torch.bfloat16}
    assert {parameter.dtype for parameter in network.parameters()} == {torch.float32}
    with precision.using("float32"):
        assert with_cast_weights(network) is network
