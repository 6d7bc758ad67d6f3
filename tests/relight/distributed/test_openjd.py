"""A job for a farm: what the template says, and the same frames from it as from one process."""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers import forked, shots
from helpers.killing import differences
from helpers.stored import store
from openjd.model import decode_job_template
from typer.testing import CliRunner

import relight
from relight.cli.commands import app

LIGHTS = ["--light", "key:azimuth=-40,elevation=30", "--light", "rim:azimuth=150,orbit=20"]
SCENE = ["--lights", "scene.gltf", "--subject-at", "0/0/-3"]
OUTPUTS = ["relit.%04d.exr", "relit.nk", "relit.mov"]


@pytest.fixture
def shot(tmp_path, here):
    """Five plates and mattes of somebody who walks, and the desk they lie on."""
    Path("plates").mkdir()
    y, x = np.mgrid[:60, :50]
    for number in range(1, 6):
        mask = (np.hypot((x - 18 - 3 * number) / 9, (y - 30) / 26) < 1).astype(np.float32)
        stripes = (0.3 + 0.2 * np.sin(y / 4 + number))[..., None] * (1, 0.8, 0.6)
        relight.write(f"plates/p.{number:04d}.exr", stripes.astype(np.float32))
        relight.write_mask(f"plates/m.{number:04d}.png", mask)
    return ["plates/p.%04d.exr", "--mask", "plates/m.%04d.png"]


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def written(*words, path="job.json"):
    result = run("job", *words, *(word for output in OUTPUTS for word in ("-o", output)), "-o", path)
    assert result.exit_code == 0, result.output
    return json.loads(Path(path).read_text())


def command(template, step):
    return " ".join(template["steps"][step]["script"]["actions"]["onRun"]["args"])


def options(template, step):
    (embedded,) = template["steps"][step]["script"]["embeddedFiles"]
    assert "--options {{Task.File.Options}}" in command(template, step)
    return json.loads(embedded["data"])


@pytest.mark.parametrize(
    ("words", "steps"),
    [
        ([], ["Light"]),
        (["--plot", "plot.svg"], ["Light", "Finish"]),
        (["--report", "shot.json"], ["Light", "Finish"]),
    ],
)
def test_what_is_of_all_frames_is_written_by_a_last_step(shot, words, steps):
    assert run("job", *shot, *LIGHTS, "-o", "lit.%04d.exr", "-o", "job.json", *words).exit_code == 0
    template = json.loads(Path("job.json").read_text())
    assert [step["name"] for step in template["steps"]][1:] == steps
    for word in words[:1]:
        assert word in command(template, len(steps))


def test_the_template_is_valid_and_says_all_of_the_shot(shot):
    template = written(
        *shot, *LIGHTS, "--frames", "1-5", "--chunk-size", 2, "--passes", "N", "--height", "1.6"
    )
    decode_job_template(template=template, supported_extensions=["TASK_CHUNKING"])
    assert [step["name"] for step in template["steps"]] == ["Analyse", "Light", "Finish"]
    assert [step.get("dependencies") for step in template["steps"][1:]] == [
        [{"dependsOn": "Analyse"}],
        [{"dependsOn": "Light"}],
    ]
    analysing, lighting, finishing = (command(template, step) for step in range(3))
    assert options(template, 0) == {"source": {"height": 1.6, "reference": 1}}
    assert "--mask {{Param.MaskFolder}}/{{Param.Mask}}" in analysing
    assert "--frames {{Task.Param.Frames}}" in analysing
    assert "--mask" not in lighting
    assert options(template, 1) == options(template, 2) == {"output": {"passes": ["N"]}}
    assert "--phase finalize --frames {{Param.Frames}}" in finishing
    defaults = {one["name"]: one["default"] for one in template["parameterDefinitions"]}
    assert defaults["Frames"] == "1-5"
    assert defaults["ChunkSize"] == 2
    assert defaults["PlateFolder"] == "plates"
    assert defaults["Lights"] == "job.lights.yaml"
    assert len(relight.read_lights("job.lights.yaml")) == 2


def test_frames_with_gaps_and_files_elsewhere(shot, tmp_path):
    Path("job").mkdir()
    with pytest.warns(UserWarning, match="frames 7-9:2 are not there yet"):
        template = written(*shot, *LIGHTS, "--frames", "1-9x2", path="job/job.json")
    decode_job_template(template=template, supported_extensions=["TASK_CHUNKING"])
    (numbers,) = template["steps"][0]["parameterSpace"]["taskParameterDefinitions"]
    assert numbers["chunks"]["rangeConstraint"] == "NONCONTIGUOUS"
    found = {one["name"]: one for one in template["parameterDefinitions"]}
    assert found["PlateFolder"]["type"] == "STRING"  # a template's own paths lie beside it
    assert found["PlateFolder"]["default"] == str(tmp_path / "plates")
    assert found["Analysis"]["type"] == "PATH"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "relit.%04d.exr"], "output: expected one job"),
        (["-o", "r.%04d.exr", "-o", "job.json", "--size", "background"], "size: expected WIDTHxHEIGHT"),
        (["-o", "r.nk", "-o", "job.json"], "a Nuke script needs an .exr"),
        (["-o", "plates/p.%04d.exr", "-o", "job.json"], "is read as well"),
        (["-o", "r.%04d.exr", "-o", "job.json", "--frames", "5-1"], "frames: expected"),
    ],
)
def test_what_is_refused_leaves_no_job(shot, words, message):
    result = run("job", *shot, *LIGHTS, *words)
    assert result.exit_code == 2
    assert message in result.output
    assert not Path("job.json").exists()
    assert not Path("job.lights.yaml").exists()


def test_a_lights_file_is_read_and_never_written(shot):
    text = "# the client's own\nlights:\n- {name: key, azimuth: -40}\n"
    Path("key.yaml").write_text(text)
    template = written(*shot, "--lights", "key.yaml")
    assert Path("key.yaml").read_text() == text
    defaults = {one["name"]: one["default"] for one in template["parameterDefinitions"]}
    assert defaults["Lights"] == "key.yaml"
    result = run(
        "job", *shot, "--lights", "key.yaml", *LIGHTS, "--save-lights", "key.yaml", "-o", "r.%04d.exr",
        "-o", "job.json",
    )  # fmt: skip
    assert result.exit_code == 2
    assert "key.yaml: is read as well" in result.output
    assert Path("key.yaml").read_text() == text


def test_a_preset_stays_a_preset_whose_light_follows_from_the_person(shot):
    template = written(*shot, "--preset", "rim", "--amount", "0.5")
    assert options(template, 1) == {"lighting": {"preset": "rim", "amount": 0.5}}
    assert not Path("job.lights.yaml").exists()
    template = written(*shot, "--preset", "rim", "--light", "extra:azimuth=20")
    assert options(template, 1)["lighting"]["preset"] == "rim"
    assert [light.name for light in relight.read_lights("job.lights.yaml")] == ["extra"]


def test_the_analysis_has_the_field_of_view_of_the_scene_s_camera(shot):
    shots.write_scene(Path("scene.gltf"), field_of_view=28)
    template = written(*shot, *SCENE)
    assert options(template, 0)["source"]["field_of_view"] == pytest.approx(28)


@pytest.mark.parametrize(
    ("outputs", "further", "background"),
    [
        (["r.mp4"], [], "p.%04d.exr"),
        (["r.%04d.png"], [], "p.%04d.exr"),
        (["r.%04d.png"], ["--background", "none"], "none"),
        (["r.%04d.exr", "r.%04d.png"], [], None),
        (["r.%04d.exr"], ["--background", "plate"], "p.%04d.exr"),
    ],
)
def test_the_plate_is_named_where_pictures_keep_it(shot, outputs, further, background):
    result = run("job", *shot, *LIGHTS, *further, *(w for o in outputs for w in ("-o", o)), "-o", "job.json")
    assert result.exit_code == 0, result.output
    template = json.loads(Path("job.json").read_text())
    defaults = {each["name"]: each.get("default") for each in template["parameterDefinitions"]}
    if background == "none":
        assert options(template, 1)["lighting"]["background"] == "none"
    else:
        assert defaults.get("Background") == background


def test_an_output_without_alpha_beside_an_exr_is_refused_at_once(shot):
    result = run("job", *shot, *LIGHTS, "-o", "r.%04d.exr", "-o", "r.mp4", "-o", "job.json")
    assert result.exit_code == 2
    assert "r.mp4: .mp4 holds no alpha; give a background (--background FILE)" in " ".join(
        result.output.split()
    )


def test_frames_are_those_of_a_moving_background(shot):
    for number in (1, 2, 3):
        relight.write(f"bg.{number:04d}.png", np.full((60, 50, 3), 0.2, np.float32))
    still = ["plates/p.0001.exr", "--mask", "plates/m.0001.png", "--background", "bg.%04d.png"]
    template = written(*still, LIGHTS[0], LIGHTS[1])
    assert template["parameterDefinitions"][0]["default"] == "1-3"


def test_a_plate_is_read_in_the_colour_space_that_is_given(shot):
    plate = np.full((60, 50, 3), 0.4, np.float32)
    store(Path("plate.dpx"), plate, "uint16", oiio__ColorSpace="KodakLog")
    words = ["plate.dpx", "--mask", "plates/m.0001.png", *LIGHTS, "--frames", "1-2"]
    assert written(*words, "--colour-space", "ARRI LogC4")["steps"]
    result = run("job", *words, "-o", "r.%04d.exr", "-o", "other.json")
    assert result.exit_code == 2
    assert "--colour-space" in " ".join(result.output.split()) or "colour_space" in result.output


@pytest.fixture
def farm(here):
    """Runs a job, or a part of it, with this Python's `relight` on the path, on a small canvas."""
    Path("bin").mkdir()

    def run_openjd(*words):
        path = f"{Path('bin').resolve()}:{os.environ['PATH']}"
        program = [sys.executable, "-m", "openjd", "run", "job.json", *map(str, words)]
        done = subprocess.run(program, env=os.environ | {"PATH": path}, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr

    with forked.small_command("bin/relight"):
        yield run_openjd


@pytest.mark.slow
def test_a_job_makes_what_one_process_makes(shot, farm):
    """Whole, and task by task in another order."""
    where = [word for output in OUTPUTS for word in ("-o", f"one/{output}")]
    Path("one").mkdir()
    computed = ["--threads", 1, "--precision", "float32"]
    assert run("analyse", *shot, "-o", "one/p.relight", *computed).exit_code == 0
    assert run("video", "one/p.relight", *LIGHTS, "--threads", 1, *where).exit_code == 0
    written(*shot, *LIGHTS, "--frames", "1-5", "--chunk-size", 3, *computed)
    for folder, runs in {
        "whole": [[]],
        "parts": [
            ["--step", "Analyse", "-tp", "Frames=4-5"],
            ["--step", "Analyse", "-tp", "Frames=1-3"],
            ["--step", "Light", "-tp", "Frames=5-5"],
            ["--step", "Light", "--tasks", '[{"Frames": "1-2"}, {"Frames": "3-4"}]'],
            ["--step", "Finish"],
        ],
    }.items():
        Path(folder).mkdir()
        places = {name: f"{folder}" for name in ("OutputFolder", "Output1Folder", "Output2Folder")}
        places["Analysis"] = f"{folder}/p.relight"
        given = [word for name, value in places.items() for word in ("-p", f"{name}={value}")]
        for words in runs:
            farm(*given, *words)
        assert differences(Path(folder), Path("one")) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lights", "lens"),
    [(["--preset", "rim"], []), (SCENE, ["--field-of-view", 30])],
    ids=["preset", "scene"],
)
def test_a_job_lights_by_a_preset_or_a_scene_as_the_commands_do(shot, farm, lights, lens):
    shots.write_scene(Path("scene.gltf"), field_of_view=30)
    Path("one").mkdir()
    Path("farm").mkdir()
    computed = ["--threads", 1, "--precision", "float32"]
    for words in (
        ["analyse", *shot, *lens, *computed, "--frames", "2-3", "-o", "p.relight"],
        ["apply", "p.relight", *lights, "--threads", 1, "-o", "one/relit.%04d.exr"],
        ["job", *shot, *lights, *computed, "--frames", "2-3", "-o", "farm/relit.%04d.exr", "-o", "job.json"],
    ):
        result = run(*words)
        assert result.exit_code == 0, result.output
    farm("-p", "Analysis=farm.relight")
    assert differences(Path("farm"), Path("one")) == []


@pytest.mark.parametrize(
    "name", ["shot{{v2}}.json", "a\nb.json", "x{{{y}}}.yaml", "z\x1b\x9c.json", "}}.json"]
)
def test_any_name_makes_a_job_that_is_valid(tmp_path, name):
    folder = tmp_path / "a{{x}}"
    folder.mkdir()
    with contextlib.chdir(folder):
        pixels = np.zeros((48, 40, 4), np.float32)
        pixels[6:46, 10:30] = 0.4, 0.3, 0.2, 1
        relight.write("p.exr", pixels)
        relight.write("b.exr", pixels[..., :3], layers={"wall": pixels[..., :3] + 0.1})
        lighting = relight.Lighting(relight.DirectionalLight(azimuth=3, name="key"), background="b.exr:wall")
        relight.write_job(name, "p.exr", lighting, "o.exr")
        template = yaml.safe_load(Path(name).read_text())
    decode_job_template(template=template, supported_extensions=["TASK_CHUNKING"])
    data = template["steps"][-1]["script"]["embeddedFiles"][0]["data"]
    assert "{{" not in data
    assert json.loads(data)["lighting"]["background"].endswith("a{{x}}/b.exr:wall")
