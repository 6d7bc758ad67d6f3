"""Binary layers of USD (.usdc): each byte of one may be wrong, and USD itself trusts all of them."""

import subprocess
import sys

import pytest

from relight.scene.lights import read_lights
from relight.scene.usd import stage as scene_stage

pytest.importorskip("pxr")
from pxr import Sdf, Usd, UsdLux


@pytest.mark.parametrize("name", ["set.usda", "set.usdc"])
def test_references_within_a_stage_are_followed(tmp_path, name):
    path = tmp_path / "set.usda"
    path.write_text(
        '#usda 1.0\ndef DistantLight "key"\n{\n}\n'
        'def DistantLight "other" (\n    references = </key>\n)\n{\n}\n'
    )
    if name != path.name:
        Sdf.Layer.FindOrOpen(str(path)).Export(str(tmp_path / name))
    assert [light.name for light in read_lights(tmp_path / name)] == ["key", "other"]


def crate(path):
    """A .usdc of a light, at which a byte can be changed."""
    stage = Usd.Stage.CreateNew(str(path))
    light = UsdLux.SphereLight.Define(stage, "/lamp")
    light.CreateIntensityAttr(3.0)
    for time in range(1, 9):
        light.GetIntensityAttr().Set(float(time), time)
    stage.GetRootLayer().Save()
    return path.read_bytes()


@pytest.mark.parametrize("drawn", ["", "subLayers", "references"])
@pytest.mark.states("USD", "a damaged .usdc that ends USD, or takes its memory or time", "refused")
def test_no_byte_of_a_crate_ends_the_process(tmp_path, drawn):
    """Every 101st or 211th byte of a .usdc, exchanged one at a time: one line, or lights."""
    path, whole = tmp_path / "set.usdc", crate(tmp_path / "whole.usdc")
    asked = path if not drawn else tmp_path / "set.usda"
    if drawn == "subLayers":
        asked.write_text("#usda 1.0\n(\n    subLayers = [@./set.usdc@]\n)\n")
    elif drawn:
        asked.write_text('#usda 1.0\ndef "all" (\n    references = @./set.usdc@</lamp>\n)\n{\n}\n')
    outcomes = set()
    for at in range(8, len(whole), 211 if drawn else 101):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x41]) + whole[at + 1 :])
        try:
            refused = None
            read_lights(asked, subject_at=(0, 0, 0))
        except ValueError as error:
            refused = str(error)
            assert refused.startswith(str(asked))
            assert "\n" not in refused
        outcomes.add(refused is None)
    assert outcomes == {True, False}


def test_a_stage_that_takes_too_much_memory_is_refused_within_bounds(tmp_path, monkeypatch):
    crate(tmp_path / "set.usdc")
    monkeypatch.setattr(scene_stage, "MEMORY", 100 << 20)  # less than USD alone takes
    with pytest.raises(ValueError, match=r"set\.usdc: is damaged: USD (ends|cannot)"):
        read_lights(tmp_path / "set.usdc", subject_at=(0, 0, 0))


@pytest.mark.parametrize("name", ["set.usdc", "set.usda"])
def test_what_usd_raises_after_another_process_could_read_the_file_is_one_line(tmp_path, monkeypatch, name):
    """USD reads memory beyond a damaged layer, so that two processes do not see the same."""
    monkeypatch.setattr(scene_stage, "layer_problem", lambda path, version: "")
    (tmp_path / "set.usda").write_text("#usda 1.0\n(\n    subLayers = [@./set.usdc@]\n)\n")
    whole = crate(tmp_path / "whole.usdc")
    (tmp_path / "set.usdc").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=rf"^{tmp_path / name}: [^\n]*$"):
        read_lights(tmp_path / name, subject_at=(0, 0, 0))


def test_a_layer_that_is_drawn_in_is_read_again_after_it_changed(tmp_path):
    lamp = '#usda 1.0\ndef SphereLight "{}"\n{{\n}}\n'
    (tmp_path / "set.usda").write_text("#usda 1.0\n(\n    subLayers = [@./lamps.usda@]\n)\n")
    (tmp_path / "lamps.usda").write_text(lamp.format("key"))
    held = Sdf.Layer.FindOrOpen(str(tmp_path / "lamps.usda"))  # as by another stage that is open
    (tmp_path / "lamps.usda").write_text(lamp.format("other"))
    assert [light.name for light in read_lights(tmp_path / "set.usda", subject_at=(0, 0, 0))] == ["other"]
    assert held.GetPrimAtPath("/other")


FULL = """
import resource, signal, sys, relight, pxr
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (300, 300))
for path in sys.argv[1:]:
    try: relight.write_lights(path, [relight.DirectionalLight(name=f"l{i}") for i in range(50)])
    except OSError as error: print(error)
"""


def test_a_full_disk_is_an_error_of_the_file(tmp_path):
    """By a limit of the size of files, in a process of its own.

    Without bytecode (-B): CPython 3.11 keeps what the limit leaves of it, which no process can import later.
    """
    paths = [str(tmp_path / f"rig.{suffix}") for suffix in ("usda", "usdc", "usdz")]
    command = [sys.executable, "-B", "-c", FULL, *paths]
    ran = subprocess.run(command, capture_output=True, text=True, check=True)
    for path, said in zip(paths, ran.stdout.splitlines(), strict=True):
        assert said.startswith(f"{path}: cannot be written: ")
        assert "TMPDIR" in said
    assert not [*tmp_path.iterdir()]
