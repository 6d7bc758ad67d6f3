"""Options are declared once, in the fields of four dataclasses; everything else is generated from them."""

import ast
import json
import subprocess
import sys
from dataclasses import fields
from typing import get_args

import numpy as np
import pytest
from helpers import ROOT
from typer.testing import CliRunner

import relight
from relight import Compute, Lighting, Output, Source
from relight.arguments import about, parameters
from relight.cli.commands import app
from relight.pipeline.option_fields import Phase, from_json, to_json
from relight.pipeline.options import GROUPS
from relight.rendering import PASSES

FULL = {
    "source": Source(
        "p.%04d.exr", mask="m.mov", key="green", matte="rvm.onnx,size=320", refine_matte=4, feather=2.5,
        person=(3, 4), size=(1080, 1920), placement="fill", scale=0.5, offset=(3, -4), colour_space="ACEScg",
        normals="n.exr",
        axes="+x-y-z", depth="d.exr", height=1.8, field_of_view=30, temporal_filter=False,
    ),
    "lighting": Lighting(
        [relight.DirectionalLight(azimuth=-40, name="key"), relight.MovingLight(azimuth={1: 0, 9: 90})],
        light=("fill:azimuth=3",), background=(0.1, 0.2, 0.3), match="a.jpg", match_mask="b.png",
        floor=relight.Floor(height=1.5, horizon=0.45), gloss=0.5,
    ),
    "output": Output(
        ["a.%d.exr", "a.mov"], passes=("N", "albedo"), exr_type="float", autocrop=True, view="aces",
        exposure=1.0, white=2.0, save_matte="m.%d.png", save_lights="l.yaml", rate=25.0,
    ),
    "compute": Compute(device="cuda", precision="float32", threads=3),
}  # fmt: skip


@pytest.mark.parametrize("name", GROUPS)
def test_json_carries_options_unchanged(name):
    document = json.loads(json.dumps(to_json(FULL[name])))
    again = from_json(GROUPS[name], document)
    assert to_json(again) == to_json(FULL[name])
    for each in fields(again):
        if each.name != "lights":  # whose keyframes are numbers of another type
            assert getattr(again, each.name) == getattr(FULL[name], each.name)
    with pytest.raises(ValueError, match="speed: not known; expected "):
        from_json(GROUPS[name], {"speed": 3})


def test_a_preset_brings_its_gloss():
    brought = relight.presets()
    assert Lighting("rim").effective_gloss == Lighting(preset="rim").effective_gloss > 0
    assert Lighting("rim", gloss=0).effective_gloss == 0
    assert Lighting("rim", gloss=0.25).effective_gloss == 0.25
    assert Lighting(brought["rim"]).effective_gloss == 0  # lights alone
    assert from_json(Lighting, to_json(Lighting("rim", gloss=0))).effective_gloss == 0
    assert "gloss" not in to_json(Lighting("rim"))
    with pytest.raises(ValueError, match="preset: no preset is called 'rimm'; did you mean rim"):
        _ = Lighting(preset="rimm").effective_gloss


def test_json_names_what_it_cannot_hold():
    with pytest.raises(
        TypeError, match="plate: expected a path or a number, which JSON can hold, got ndarray"
    ):
        to_json(Source(np.zeros((2, 2, 3))))


def test_only_what_is_given_is_stored():
    assert to_json(Source("p.png")) == {"plate": "p.png"}
    assert to_json(Compute()) == {}


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: Source("a.png", key="red"), ValueError, "key: expected one of green, blue, got 'red'"),
        (lambda: Output("a.exr", exr_type="double"), ValueError, "exr_type: expected one of half, float"),
        (lambda: Output("a.exr", passes="albdo"), ValueError, "passes: .*got 'albdo'; did you mean albedo?"),
        (lambda: Lighting(3), TypeError, "lights: expected lights or the path of a lights file, got 3"),
        (lambda: Lighting(gloss="1"), TypeError, "gloss: expected a number from 0 to 1, got '1'"),
        (lambda: Lighting(color=3), TypeError, r"color: not known; expected lights, .* \(Lighting\)"),
        (lambda: Source("a.png", heigth=1), TypeError, "heigth: not known; did you mean height?"),
        (lambda: Source("a.png", size=(0, 5)), ValueError, r"size: expected \(height, width\) of at least 1"),
        (lambda: Source("a.png", size="5"), ValueError, "size: expected WIDTHxHEIGHT or background, got '5'"),
        (
            lambda: Source(None),
            TypeError,
            "plate: expected a picture, .* got None",
        ),
        (lambda: Lighting(preset="Golden Hours"), ValueError, "preset: .*; did you mean golden-hour"),
        (lambda: Compute(threads=True), TypeError, "threads: expected a whole number from 1 to 1024"),
    ],
)
def test_wrong_values_name_their_field(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_a_plain_value_stands_for_its_options():
    lamp = relight.DirectionalLight()
    assert Source.of("a.png") == Source("a.png")
    assert Lighting.of(lamp) == Lighting([lamp])
    assert Output.of("a.png") == Output(["a.png"])
    assert Source("a.png", key="green").key == "green"


@pytest.mark.parametrize("command", ["apply", "video", "job"])
def test_every_option_is_on_the_command_line(command):
    text = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "300", "TERM": "dumb"}).output
    for kind in GROUPS.values():
        for each in fields(kind):
            if each.name not in ("plate", "paths"):
                assert f"--{each.name.replace('_', '-')}" in text, each.name
                assert about(parameters(kind)[each.name].kind).help.split()[0] in text


def test_options_are_imported_without_anything_heavy():
    program = "import sys, relight.pipeline.options; print(*sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert not {"torch", "numpy", "colour", "OpenImageIO", "typer"} & set(run.stdout.split())


def test_an_option_is_declared_in_one_place():
    """Layers pass the objects on: no function of the pipeline, farm or command line spells options."""
    names = {each.name for kind in GROUPS.values() for each in fields(kind)} - {"compute", "lights", "paths"}
    names -= {"rate", "threads", "precision", "device", "key", "normals", "depth", "person", "size", "height"}
    for folder in ("pipeline", "distributed", "cli"):
        for path in (ROOT / "relight" / folder).glob("*.py"):
            if folder == "cli" and path.stem in ("stage", "training", "evaluation"):
                continue
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.FunctionDef):
                    arguments = {each.arg for each in (*node.args.args, *node.args.kwonlyargs)}
                    assert len(arguments & names) <= 2, f"{path.name}: {node.name} spells {arguments & names}"


def test_options_of_a_file_give_way_to_the_command_line(tmp_path, here):
    plate = np.zeros((40, 30, 4), np.float32)
    plate[5:35, 5:25] = 0.4, 0.3, 0.2, 1
    relight.write("p.exr", plate)
    document = {"output": {"passes": ["N"], "exr_type": "float"}, "lighting": {"light": ["key:azimuth=9"]}}
    (tmp_path / "o.json").write_text(json.dumps(document))
    words = ["apply", "p.exr", "-o", "a.exr", "--options", "o.json", "--passes", "albedo"]
    run = CliRunner().invoke(app, words)
    assert run.exit_code == 0, run.output
    assert set(relight.read_layers("a.exr")) == {"C_key", "albedo"}
    (tmp_path / "o.json").write_text('{"sources": {}}')
    refused = CliRunner().invoke(app, words)
    assert (refused.exit_code, refused.output.count("\n")) == (2, 1)
    assert "o.json: expected an object of source, lighting, output, compute" in refused.output


def test_phases_have_three_names():
    assert list(get_args(Phase)) == ["all", "frames", "finalize"]


def test_the_help_names_all_passes():
    assert ", ".join(PASSES) in about(parameters(Output)["passes"].kind).help


def test_paths_become_absolute_and_nothing_else_does(tmp_path, here):
    for name in ("a.exr", "m.onnx"):
        (tmp_path / name).touch()
    source = Source("a.exr:albedo", mask="m.%04d.png", matte="m.onnx,size=320", normals="field").absolute()
    assert source.plate == f"{tmp_path}/a.exr:albedo"
    assert source.mask == f"{tmp_path}/m.%04d.png"
    assert source.matte == f"{tmp_path}/m.onnx,size=320"
    assert source.normals == "field"
    assert Lighting(background=(0.1, 0.2, 0.3)).absolute().background == (0.1, 0.2, 0.3)
    for word in ("environment", "plate", "none"):
        assert Lighting(background=word).absolute().background == word
    assert Output(["b.exr"]).absolute().paths == (tmp_path / "b.exr",)


def test_lights_and_a_background_are_taken_as_objects_and_as_the_command_takes_them():
    key = relight.DirectionalLight(azimuth=-40, name="key")
    lighting = relight.Lighting(light=[key, "rim:azimuth=150"], background="0.03/0.03/0.04")
    assert [light.name for light in lighting.rig().lights] == ["key", "rim"]
    assert lighting.background == (0.03, 0.03, 0.04)
    assert relight.Lighting(light=key).light == (key,)
    assert relight.Lighting(light="key:azimuth=-40").rig().lights[0].name == "key"
    with pytest.raises(TypeError, match="light: expected lights or their texts, got 3"):
        relight.Lighting(light=[3])
