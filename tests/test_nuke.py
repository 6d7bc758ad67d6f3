import re
import shutil
import subprocess

import numpy as np
import pytest

import relight
from relight.media.nuke import write_script

NODE = re.compile(r"^(\w+) \{\n((?: .*\n)*)\}$", re.MULTILINE)
RNG = np.random.default_rng(2)


def knobs(body):
    return dict(line.strip().split(" ", 1) for line in body.splitlines())


def play(script, folder):
    """What the script's last node shows: an interpreter of the few nodes that scripts of ours have."""
    stack, names = [], {}
    for line in re.split(r"\n(?=\w)", script):
        line = line.strip()
        if line.startswith("set "):
            names[line.split()[1]] = stack[-1]
        elif line.startswith("push $"):
            stack.append(names[line.removeprefix("push $")])
        elif match := NODE.fullmatch(line):
            kind, knob = match[1], knobs(match[2])
            if kind == "Read":
                file = folder / knob["file"].strip('"')
                stack.append((relight.read(file), relight.read_layers(file)))
            elif kind == "Shuffle":
                picture, layers = stack.pop()
                layer = {re.sub(r"\W", "_", name): values for name, values in layers.items()}[knob["in"]]
                stack.append((np.concatenate([layer[..., :3], picture[..., 3:]], axis=-1), layers))
            elif kind == "Multiply":
                picture, layers = stack.pop()
                assert knob["channels"] == "rgb"
                stack.append((picture * ([float(knob["value"])] * 3 + [1.0])[: picture.shape[-1]], layers))
            elif kind == "Merge2":
                (b, layers), (a, _) = stack.pop(), stack.pop()
                assert knob["operation"] == "plus"
                assert knob["output"] == "rgb"
                stack.append((np.concatenate([a[..., :3] + b[..., :3], b[..., 3:]], axis=-1), layers))
    ((picture, _),) = stack  # nothing is left over
    return picture


@pytest.fixture
def groups(tmp_path):
    """A file of three light groups, as `relight apply` writes it."""
    layers = {f"C_{name}": RNG.random((6, 8, 4), np.float32) for name in ("key", "rim light", "fill")}
    picture = sum(layers.values())
    picture[..., 3] = 0.5
    relight.write(tmp_path / "mix.exr", picture, layers=layers)
    return {name.removeprefix("C_"): (tmp_path / "mix.exr", name) for name in layers}


def test_the_script_rebuilds_the_picture(groups, tmp_path):
    write_script(tmp_path / "mix.nk", groups, (6, 8))
    script = (tmp_path / "mix.nk").read_text()
    beauty = relight.read(tmp_path / "mix.exr")
    np.testing.assert_allclose(play(script, tmp_path), beauty, rtol=2e-3)
    # A light at half its strength.
    dimmed = re.sub(r"value 1(\n name Multiply_key)", r"value 0.5\1", script)
    key = relight.read_layers(tmp_path / "mix.exr")["C_key"][..., :3]
    np.testing.assert_allclose(play(dimmed, tmp_path)[..., :3], beauty[..., :3] - 0.5 * key, rtol=2e-3)


def test_the_script_is_well_formed(groups, tmp_path):
    write_script(tmp_path / "mix.nk", groups, (6, 8), rate=23.976)
    script = (tmp_path / "mix.nk").read_text()
    assert script.count("{") == script.count("}")
    assert len(re.findall(r"^Multiply \{", script, re.MULTILINE)) == 3
    assert len(re.findall(r"^Merge2 \{", script, re.MULTILINE)) == 2
    names = re.findall(r"^ name (\S+)$", script, re.MULTILINE)
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r"[A-Za-z]\w*", name) for name in names)
    assert " fps 23.976\n" in script
    assert ' label "rim light"\n' in script
    assert str(tmp_path) not in script  # the folder may move


def test_sequences_keep_their_frame_number_and_range(tmp_path):
    (tmp_path / "shot").mkdir()
    groups = {"key": (tmp_path / "relit.%04d.exr", "C_key")}
    write_script(tmp_path / "shot" / "mix.nk", groups, (6, 8), frames=(1001, 1020))
    script = (tmp_path / "shot" / "mix.nk").read_text()
    assert ' file "../relit.%04d.exr"\n first 1001\n last 1020\n' in script
    assert " first_frame 1001\n last_frame 1020\n" in script


def test_a_file_a_light(groups, tmp_path):
    passes = {}
    for number, (name, (file, layer)) in enumerate(groups.items(), 1):
        path = tmp_path / f"pass.{number:04d}.exr"
        relight.write(path, relight.read_layers(file)[layer])
        passes[name] = (path, None)
    write_script(tmp_path / "passes.nk", passes, (6, 8))
    picture = play((tmp_path / "passes.nk").read_text(), tmp_path)
    np.testing.assert_allclose(picture[..., :3], relight.read(tmp_path / "mix.exr")[..., :3], rtol=2e-3)


@pytest.mark.skipif(shutil.which("tclsh") is None, reason="no Tcl on this machine")
def test_odd_names_survive_tcl(tmp_path):
    name = 'a "b" [c] {d} $e \\f'
    write_script(tmp_path / "m.nk", {name: (tmp_path / "m.exr", "C_x")}, (6, 8))
    label = re.search(r"^ label (.*)$", (tmp_path / "m.nk").read_text(), re.MULTILINE)[1]
    echoed = subprocess.run(
        ["tclsh"], input=f"puts {label}", capture_output=True, text=True, check=True
    ).stdout
    assert echoed == name + "\n"


def test_bad_arguments_leave_nothing(tmp_path):
    with pytest.raises(ValueError, match="groups: expected at least one"):
        write_script(tmp_path / "m.nk", {}, (6, 8))
    with pytest.raises(FileNotFoundError):
        write_script(tmp_path / "none" / "m.nk", {"key": (tmp_path / "m.exr", "C_key")}, (6, 8))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("first", "second"), [("主光", "辅光"), ("a b", "a_b"), ("key.1", "key-1")])
def test_layers_that_are_one_to_nuke_are_refused(tmp_path, first, second):
    groups = {name: (tmp_path / "m.exr", f"C_{name}") for name in (first, second)}
    with pytest.raises(ValueError, match=f"layers: 'C_{first}' and 'C_{second}' are one to Nuke, C_"):
        write_script(tmp_path / "m.nk", groups, (6, 8))
    assert list(tmp_path.iterdir()) == []
    # Each in a file of its own they are no layers, and told apart.
    files = {name: (tmp_path / f"{number}.exr", None) for number, name in enumerate((first, second))}
    write_script(tmp_path / "m.nk", files, (6, 8))
    nodes = re.findall(r"^ name (\S+)$", (tmp_path / "m.nk").read_text(), re.MULTILINE)
    assert len(set(nodes)) == len(nodes)
