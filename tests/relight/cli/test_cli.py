import json
import os
import subprocess
import sys
from typing import get_args

import numpy as np
import OpenImageIO as oiio
import pytest
from helpers import ROOT
from typer.testing import CliRunner

import relight
from relight.cli.commands import app
from relight.cli.training import Model
from relight.compositing.placement import place
from relight.media.movies import Movie
from shadow import analysis
from shadow.networks import checkpoints

LIGHTS = [
    "--light",
    "key:azimuth=-40,elevation=30,intensity=2,colour=1/0.9/0.8",
    "--light",
    "fill:azimuth=60,intensity=0.5",
]
RESB3 = ["--model", "resb3"]


@pytest.fixture
def photo(tmp_path):
    """A photograph (opaque) and its matte, as files."""
    y, x = np.mgrid[:96, :80]
    mask = (np.hypot((x - 40) * 1.5, y - 48) < 40).astype(np.float32)
    image = np.stack([0.2 + 0.5 * mask, 0.3 + 0 * mask, 0.6 - 0.4 * mask], axis=-1)
    relight.write(tmp_path / "photo.png", image)
    relight.write(tmp_path / "mask.png", mask[..., None].repeat(3, -1))
    return [str(tmp_path / "photo.png"), "--mask", str(tmp_path / "mask.png")]


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_apply_writes_every_output(tmp_path, photo):
    picture, preview = tmp_path / "out.exr", tmp_path / "out.png"
    result = run("apply", *photo, *LIGHTS, "-o", picture, "-o", preview)
    assert result.exit_code == 0, result.output
    beauty, layers = relight.read(picture), relight.read_layers(picture)
    assert beauty.shape == (96, 80, 4)
    assert set(layers) == {"C_key", "C_fill"}
    np.testing.assert_allclose(sum(layer[..., :3] for layer in layers.values()), beauty[..., :3], atol=5e-3)
    assert relight.read(preview).shape == (96, 80, 3)  # the photograph has no alpha


def test_apply_equals_the_library(tmp_path, photo):
    assert run("apply", *photo, *LIGHTS, "-o", tmp_path / "out.exr").exit_code == 0
    image, mask = relight.read(photo[0]), relight.read_mask(photo[2])
    lights = [relight.DirectionalLight.parse(text) for text in LIGHTS[1::2]]
    expected = relight.apply(image, lights, mask=mask)
    np.testing.assert_allclose(relight.read(tmp_path / "out.exr"), expected, atol=2e-3)


@pytest.mark.filterwarnings("ignore:the network")
def test_apply_takes_normals_of_any_axes(tmp_path, photo):
    """A flat wall, turned to image left: it catches the light there and none from image right."""
    codes = np.broadcast_to(np.float32([0.1, 0.5, 0.8]), (96, 80, 3))
    spec = oiio.ImageSpec(80, 96, 3, "uint8")
    for name, flip in (("camera.png", 1), ("opencv.png", -1)):
        file = oiio.ImageOutput.create(str(tmp_path / name))
        file.open(str(tmp_path / name), spec)
        file.write_image(np.ascontiguousarray((codes - 0.5) * (1, flip, flip) + 0.5))
        file.close()
    for name, axes in (("camera.png", "+x+y+z"), ("opencv.png", "+x-y-z")):
        arguments = ["--normals", tmp_path / name, "--axes", axes, "-o", tmp_path / "o.exr"]
        result = run("apply", *photo, "--light", "azimuth=-60", "--light", "azimuth=60", *arguments)
        assert result.exit_code == 0, result.output
        layers = relight.read_layers(tmp_path / "o.exr")
        assert layers["C_light1"][48, 40, :3].max() > 0.05
        assert layers["C_light2"][48, 40, :3].max() < 2e-3


def test_background_is_an_image_or_a_colour(tmp_path, photo):
    relight.write(tmp_path / "bg.exr", np.full((20, 30, 3), 0.5, np.float32))
    for background in (tmp_path / "bg.exr", "0.5/0.5/0.5"):
        result = run("apply", *photo, *LIGHTS, "--background", background, "-o", tmp_path / "o.exr")
        assert result.exit_code == 0, result.output
        picture = relight.read(tmp_path / "o.exr")
        assert picture.shape == (96, 80, 3)
        np.testing.assert_allclose(picture[0, 0], 0.5, atol=1e-3)
        layers = relight.read_layers(tmp_path / "o.exr")
        assert set(layers) == {"C_key", "C_fill", "C_background"}
        total = sum(layer[..., :3] for layer in layers.values())
        np.testing.assert_allclose(total, picture, atol=5e-3)


def test_an_environment_lights(tmp_path, photo):
    sky = np.full((16, 32, 3), 0.5, np.float32)
    relight.write(tmp_path / "sky.exr", sky)
    light = f"{tmp_path / 'sky.exr'},intensity=2,rotation=30"
    assert run("apply", *photo, "--environment", light, "-o", tmp_path / "out.exr").exit_code == 0
    image, mask = relight.read(photo[0]), relight.read_mask(photo[2])
    expected = relight.apply(image, relight.EnvironmentLight(sky, intensity=2, rotation=30), mask=mask)
    np.testing.assert_allclose(relight.read(tmp_path / "out.exr"), expected, atol=2e-3)
    assert set(relight.read_layers(tmp_path / "out.exr")) == {"C_environment"}


def test_the_person_stands_in_the_environment(tmp_path, photo):
    relight.write(tmp_path / "sky.exr", np.full((16, 32, 3), 0.5, np.float32))
    result = run(
        *("apply", *photo, "--environment", tmp_path / "sky.exr", "--background", "environment"),
        *("--size", "100x60", "--scale", 0.5, "--offset", "20/-5", "--save-matte", tmp_path / "matte.png"),
        *("-o", tmp_path / "out.exr"),
    )
    assert result.exit_code == 0, result.output
    picture, matte = relight.read(tmp_path / "out.exr"), relight.read_mask(tmp_path / "matte.png")
    assert picture.shape == (60, 100, 3)
    expected = place(relight.read_mask(photo[2]), (60, 100), scale=0.5, offset=(20, -5))
    np.testing.assert_allclose(matte, expected, atol=1e-4)
    np.testing.assert_allclose(picture[matte == 0], 0.5, atol=1e-3)
    assert np.abs(picture[matte == 1] - 0.5).max() > 0.05


@pytest.mark.slow
def test_a_green_screen_is_keyed(tmp_path):
    y, x = np.mgrid[:96, :80]
    person = (np.hypot((x - 40) * 1.5, y - 48) < 40)[..., None]
    relight.write(tmp_path / "studio.png", np.where(person, (0.5, 0.4, 0.3), (0.05, 0.4, 0.08)))
    result = run("apply", tmp_path / "studio.png", "--key", "green", *LIGHTS, "-o", tmp_path / "out.exr")
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(relight.read(tmp_path / "out.exr")[..., 3], person[..., 0], atol=0.02)
    result = run("apply", tmp_path / "studio.png", "--key", "blue", *LIGHTS, "-o", tmp_path / "out.exr")
    assert (result.exit_code, result.output) == (2, "relight: image: shows no blue screen\n")


@pytest.mark.slow
def test_lights_come_from_a_file_and_go_to_one(tmp_path, photo):
    lights = tmp_path / "lights.yaml"
    first, again = tmp_path / "first.exr", tmp_path / "again.exr"
    assert run("apply", *photo, *LIGHTS, "--save-lights", lights, "-o", first).exit_code == 0
    assert relight.read_lights(lights) == [relight.DirectionalLight.parse(text) for text in LIGHTS[1::2]]
    assert run("apply", *photo, "--lights", lights, "-o", again).exit_code == 0
    np.testing.assert_array_equal(relight.read(first), relight.read(again))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"--mask": None}, "relight fetch person brings them (MediaPipe's pose networks (Apache-2.0)"),
        ({"--mask": "gone.png"}, "gone.png: no such file"),
        ({"--light": "key:azimut=3"}, "azimut: not known; did you mean azimuth"),
        (
            {"--light": None},
            "lights: expected at least one (--preset, --light, --environment, --lights, --match, ",
        ),
        ({"--environment": "gone.exr,rotation=3"}, "gone.exr: no such file"),
        ({"--lights": "gone.yaml"}, "gone.yaml: no such file"),
        ({"--background": "gone.exr"}, "gone.exr: no such file"),
        ({"--background": "1/2"}, "background: expected linear red/green/blue"),
        ({"--background": "environment"}, "expected an environment among the lights"),
        ({"--size": "100"}, "size: expected WIDTHxHEIGHT or background, got '100'"),
        ({"--size": "background"}, "size: 'background' expected a background that is an image"),
        ({"--offset": "1"}, "offset: expected RIGHT/UP in pixels"),
        ({"--offset": "a/b"}, "offset: expected RIGHT/UP in pixels"),
        ({"--scale": "0"}, "scale: expected a number above 0"),
        ({"--save-matte": "matte.gif"}, "matte.gif: expected a file name that ends in"),
        ({"--view": "acid"}, "view: expected one of ACES 2.0"),
        (
            {"--exposure": "99", "-o": "out.png"},
            "exposure: expected a number of stops from",
        ),
        ({"--colour-space": "bogus"}, "colour_space: unknown 'bogus'"),
        ({"--normals": "gone.exr"}, "gone.exr: no such file"),
        ({"--normals": "two\nlines.exr"}, "two lines.exr: no such file"),
        ({"--normals": "gone.pt"}, "gone.pt"),
        ({"--normals": "gone.pt", "--axes": "+x-y-z"}, "axes: those of gone.pt are known"),
        ({"-o": "out.gif"}, "out.gif: expected a file name that ends in"),
        ({"-o": "none/out.exr"}, "the folder none does not exist"),
        ({"-o": "out.nk"}, "out.nk: a Nuke script needs an .exr to read"),
        (
            {"--passes": "N,depth"},
            "one of albedo, N, Z, P, visibility, shading, gloss, confidence, got 'depth'",
        ),
    ],
)
def test_bad_input_is_one_line(tmp_path, here, photo, change, message):
    options = {"--mask": photo[2], "--light": "azimuth=10", "-o": "out.exr"} | change
    arguments = [part for option, value in options.items() if value is not None for part in (option, value)]
    result = run("apply", photo[0], *arguments)
    assert result.exit_code == 2
    assert message in result.output
    assert result.output.startswith("relight: ")
    assert result.output.count("\n") == 1
    assert not (tmp_path / "out.exr").exists()


def test_every_visibility_network_can_be_trained():
    assert set(get_args(Model)) == set(analysis.NETWORKS)


def test_apply_writes_layers_and_a_nuke_script(tmp_path, photo):
    outputs = ["-o", tmp_path / "out.exr", "-o", tmp_path / "out.nk"]
    result = run("apply", *photo, *LIGHTS, *outputs, "--passes", "albedo, N")
    assert result.exit_code == 0, result.output
    assert set(relight.read_layers(tmp_path / "out.exr")) == {"C_key", "C_fill", "albedo", "N"}
    assert "\n name Multiply_fill\n" in (tmp_path / "out.nk").read_text()


@pytest.mark.parametrize(
    ("command", "options", "message"),
    [
        ("apply", ["-o", "photo.png"], "photo.png: is read as well, and would be overwritten"),
        ("apply", ["-o", "a.png", "--save-matte", "./x/../mask.png"], "mask.png: is read as well"),
        ("apply", ["-o", "a.png", "--save-matte", "a.png"], "a.png: is written twice"),
        ("apply", ["-o", "a.png", "--background", "b.exr", "-o", "b.exr"], "b.exr: is read as well"),
        ("apply", ["-o", "a.%04d.png"], "frames: expected (first, last)"),
        ("apply", ["-o", "a.mov"], "frames: expected (first, last)"),
        (
            "apply",
            ["-o", "a.png", "--frames", "1-2"],
            "a.png: expected a movie, or a frame number in the name",
        ),
        ("apply", ["-o", "a.png", "--passes", "N"], "passes: are layers of an .exr"),
        ("apply", ["-o", "a.png", "--axes", "+x-y-z"], "axes: expected normals as well (--normals FILE)"),
        ("apply", ["-o", "a.png", "--light", "orbit=9"], "moves; choose one frame (--frames 7)"),
        ("apply", ["-o", "a.png", "--size", "65537x4"], "size: expected 1 to 65536 pixels"),
        ("apply", ["-o", "a.png", "--device", "gpu9"], "device: expected a device of this machine"),
        ("apply", ["-o", "a.png", "--background", "#20202"], "expected linear red/green/blue"),
        ("apply", ["-o", "a.png", "--background", "0.2,0.2,0.2"], "expected a linear colour as 0.2/0.2/0.2"),
        ("video", ["-o", "photo%d.png", "--frames", "1-99999999999999999999"], "first <= last <= 1000000000"),
        ("video", ["-o", "a.####.png", "--background", "a.%02d.png"], "a.####.png: is read as well"),
        (
            "video",
            ["-o", "a.%d.png", "--save-matte", "m.png", "--frames", "1-2"],
            "m.png: expected a frame number in the name",
        ),
        ("video", ["-o", "a.%d.png", "--device", "gpu9"], "device: expected a device of this machine"),
        ("olat", ["-o", "a.exr", "--device", "gpu9"], "device: expected a device of this machine"),
    ],
)
def test_what_can_be_refused_is_refused_before_any_work(
    here, tmp_path, photo, no_networks, command, options, message
):
    (tmp_path / "x").mkdir()
    before = {path: path.read_bytes() for path in tmp_path.glob("*.*")}
    lights = [] if command == "olat" else ["--light", "azimuth=10"]
    result = run(command, *photo, *lights, *options)
    assert result.exit_code == 2, result.output
    assert message in result.output
    assert {path: path.read_bytes() for path in tmp_path.glob("*.*")} == before


@pytest.mark.slow
def test_apply_and_video_take_the_same_look(tmp_path, photo):
    """Placed, with given normals, its matte kept: a frame of a video is the still."""
    normals = np.zeros((96, 80, 3), np.float32)
    normals[..., 2] = 1
    relight.write(tmp_path / "n.exr", normals)
    look = ["--size", "100x60", "--scale", "0.8", "--offset", "5/-3", "--normals", tmp_path / "n.exr"]
    still = run("apply", *photo, *LIGHTS, *look, "-o", tmp_path / "a.exr", "--save-matte", tmp_path / "a.png")
    outputs = ["-o", tmp_path / "v.%d.exr", "--save-matte", tmp_path / "m.%d.png"]
    moved = run("video", *photo, *LIGHTS, *look, *outputs, "--frames", "7-7")
    assert still.exit_code == moved.exit_code == 0, still.output + moved.output
    np.testing.assert_array_equal(relight.read(tmp_path / "a.exr"), relight.read(tmp_path / "v.7.exr"))
    np.testing.assert_array_equal(
        relight.read_mask(tmp_path / "a.png"), relight.read_mask(tmp_path / "m.7.png")
    )


def test_the_version_and_the_examples_of_the_help_are_whole():
    assert run("--version").output == f"relight {relight.__version__}\n"
    text = CliRunner().invoke(app, ["apply", "--help"], env={"COLUMNS": "80", "TERM": "dumb"}).output
    assert "relight apply photo.jpg --preset golden-hour -o out.jpg" in text
    assert "key:azimuth=-40,elevation=30,intensity=2,colour=1/0.9/0.8" in text
    assert "--environment studio.exr,rotation=90,intensity=2" in text


@pytest.mark.slow
def test_olat_writes_passes_and_their_directions(tmp_path, photo):
    result = run("olat", *photo, "-o", tmp_path / "o.exr", "-o", tmp_path / "o.nk")
    assert result.exit_code == 0, result.output
    assert len(relight.read_layers(tmp_path / "o.exr")) == len(relight.read_lights(tmp_path / "o.json")) == 64
    result = run("olat", *photo, "-o", tmp_path / "o.nk")
    assert result.exit_code == 2
    assert "output: expected one .exr and at most one .nk" in result.output


def test_video_relights_frame_by_frame(tmp_path, photo):
    (tmp_path / "lights.yaml").write_text("lights: [{name: sun, azimuth: {1: -60, 3: 60}}]")
    outputs = ["-o", tmp_path / "r.%02d.exr", "-o", tmp_path / "r.mp4", "-o", tmp_path / "r.nk"]
    lights = ["--lights", tmp_path / "lights.yaml", "--light", "key:orbit=8,elevation=20"]
    result = run("video", *photo, *lights, *outputs, "--background", "0.1/0.1/0.1", "--rate", "25")
    assert result.exit_code == 0, result.output
    first, last = (relight.read_layers(tmp_path / f"r.{n}.exr") for n in ("01", "03"))
    assert set(first) == {"C_sun", "C_key", "C_background"}
    assert first["C_sun"][:, :40].sum() > first["C_sun"][:, 40:].sum()
    assert last["C_sun"][:, :40].sum() < last["C_sun"][:, 40:].sum()
    movie = Movie(tmp_path / "r.mp4")
    assert (movie.rate, list(movie.numbers)) == (25, [1, 2, 3])
    assert "last 3\n" in (tmp_path / "r.nk").read_text()


def test_video_names_what_is_wrong(tmp_path, photo):
    for option, message in (
        (["--frames", "one"], "frames: expected numbers such as 1-100, 1-100x2 or 1-10,20,30-40, got 'one'"),
        ([], "frames: expected (first, last), as neither source nor lights say how many"),
        (["--frames", "1-2", "--background", "environment"], "expected an environment among the lights"),
    ):
        result = run("video", *photo, *LIGHTS, "-o", tmp_path / "r.%d.exr", *option)
        assert result.exit_code == 2
        assert message in result.output


def test_video_reports_broken_frames(tmp_path):
    alpha = np.zeros((24, 20, 4), np.float32)
    alpha[4:20, 4:16] = 0.5, 0.4, 0.3, 1
    for number in (1, 2, 3):
        relight.write(tmp_path / f"p.{number}.png", alpha)
    (tmp_path / "p.2.png").write_bytes(b"broken")
    result = run("video", tmp_path / "p.#.png", "--light", "azimuth=20", "-o", tmp_path / "r.#.png")
    assert result.exit_code == 1
    assert "frame 2: " in result.output
    assert (tmp_path / "r.3.png").exists()


def test_help_does_not_load_the_networks():
    program = "import sys, relight.cli.commands; sys.exit(any(m in sys.modules for m in ('torch', 'colour')))"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
    result = run("--help")
    assert result.exit_code == 0
    assert "apply" in result.output


@pytest.mark.slow
def test_from_a_mesh_to_weights_and_their_score(tmp_path):
    """The whole workshop, small: render, pack, draw, train two networks, score them."""
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.creation.capsule(height=1.2, radius=0.25)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    mesh.export(tmp_path / "capsule.ply")
    (tmp_path / "list.txt").write_text("capsule.ply\n")
    records, shards = tmp_path / "records", tmp_path / "shards"
    result = run(
        *("stage", records, "--scan-list", tmp_path / "list.txt", "--views", 2, "--size", 64, "--behind"),
        *("--processes", 1, "--pack", shards, "--sheet", tmp_path / "sheet.png"),
    )
    assert result.exit_code == 0, result.output
    assert "2 records" in result.output
    assert relight.read(tmp_path / "sheet.png").max() > 0.5
    common = ["--records", shards, "--steps", 1, "--size", 128, "--batch", 2, "--workers", 0]
    result = run("train", "shadow", *common, "--out", tmp_path / "field")
    assert result.exit_code == 0, result.output
    field = tmp_path / "field" / "field.safetensors"
    deeper = tmp_path / "deeper"
    result = run("train", "shadow", *common, "--out", deeper, "--init", field, "--blocks", "1,1,2,4,7")
    assert result.exit_code == 0, result.output
    _, metadata = checkpoints.read(deeper / "field.safetensors")
    assert json.loads(metadata["config"])["encoder"] == [1, 1, 2, 4, 7]
    result = run(
        "train", "shading", *common, "--out", tmp_path / "shading", "--init", field, "--visibility", field
    )
    assert result.exit_code == 0, result.output
    result = run("evaluate", "visibility", "--records", shards, "--model", field)
    assert result.exit_code == 0, result.output
    assert "| field | 0." in result.output
    assert "| sign(N·L), true normals | 0." in result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["stage", "records"], "nothing to do"),
        (["stage", "records", "--bodies", "0:1", "--relief"], "--relief: expected scans"),
        (["stage", "records", "--pairs", "0:1", "--relief"], "--relief: expected scans"),
        (["stage", "records", "--bodies", "0:1", "--variants", "0:1"], "--variants: expected --scan"),
        (["stage", "records", "--scan", "a.glb", "--variants", "0"], "--variants: expected FIRST:LAST"),
        (["stage", "records", "--bodies", "three"], "--bodies: expected FIRST:LAST"),
        (["stage", "records", "--pairs", "2"], "--pairs: expected FIRST:LAST"),
        (["stage", "records", "--pack", "shards"], "holds no records"),
        (["evaluate", "visibility", "--records", "absent"], "no such file or folder: absent"),
        (["evaluate", "tables", "--records", "absent", "--out", "report"], "no such file or folder: absent"),
        (["evaluate", "tables", "--records", ".", "--out", "r", "--model", "ours"], "expected NAME=FILE"),
        (["train", "shadow", "--records", ".", "--out", "run"], "steps: expected a number"),
        (["train", "shadow", "--records", ".", "--out", "run", "--no-normals"], "since a field infers"),
        (["train", "shading", "--records", ".", "--out", "run", "--no-normals"], "expects a per-light"),
        (
            ["train", "shading", "--records", ".", "--out", "run", "--visibility", "none"],
            "expects a per-light network",
        ),
        (["train", "shading", "--records", ".", "--out", "run", "--no-depth"], "--no-depth: expected"),
        (["train", "shadow", "--records", ".", "--out", "run", "--blocks", "1,2,3"], "expected 5 numbers"),
        (
            ["train", "shadow", "--records", ".", "--out", "run", "--model", "resb7", "--borders", "4"],
            "--borders: expected a one-pass network",
        ),
        (["train", "shadow", "--records", ".", "--out", "run", "--blocks", "1,1,2,0,6"], "got '1,1,2,0,6'"),
        (["train", "shadow", "--records", ".", "--out", "run", *RESB3, "--blocks", "1,1,2,4,6"], "one-pass"),
        (
            ["train", "shadow", "--records", "absent", "--out", "run", "--steps", "1"],
            "no such file or folder: absent",
        ),
        (["train", "shadow", "--records", ".", "--out", "run", "--steps", "1", "--size", "99"], "multiple"),
    ],
)
def test_the_workshop_names_bad_input(arguments, message, tmp_path, here):
    pytest.importorskip("embreex")
    pytest.importorskip("kornia")
    result = run(*arguments)
    assert result.exit_code == 2
    assert message in result.output


def test_a_warning_is_one_line_without_its_place_in_the_source(tmp_path, photo):
    command = [sys.executable, "-m", "helpers.small_command", "apply", *map(str, photo)]
    done = subprocess.run(
        [*command, "--light", "key:intensity=1e-7", "-o", tmp_path / "a.exr"], capture_output=True, text=True,
        check=True, env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"},
    )  # fmt: skip
    (warning,) = [line for line in done.stderr.splitlines() if "C_key" in line]
    assert warning.startswith("relight: warning: C_key: is so dim")
    assert ".py" not in done.stderr
