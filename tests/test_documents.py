"""Every command and snippet of README.md and docs, run as a reader would run it."""

import re
import runpy
import shlex
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from helpers import ROOT, documents, stated_table
from helpers.architecture import FOLDERS
from helpers.documents import DOCUMENTS, blocks
from typer.main import get_command

import relight
import shading
import shadow
from relight.cli.commands import app
from relight.media.movies import Movie
from shadow.training.tasks import per_light

README = (ROOT / "README.md").read_text()
RUN = {"sh", "python", "yaml"}
# What cannot be shipped, and how many blocks need it.
NEEDS = {
    "a ComfyUI folder": 1,
    "MakeHuman's assets": 1,
    "ICT-FaceKit's ict.npz and MakeHuman's assets": 1,
    "photographs without people": 1,
    "a model of your own": 1,
    "a CUDA GPU": 3,
    "a Dask cluster": 2,
    "the networks that find people": 1,
    "a network connection": 9,
    "Windows": 1,
    "the program openjd, of openjd-cli": 1,
    "your own copy of PIFuHD's checkpoint": 1,
}


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("desk")
    documents.lay_out(folder)
    return folder


@pytest.fixture
def reader(desk, here, monkeypatch):
    """A folder with what the documents name, as the working folder."""
    for path in desk.iterdir():
        (here / path.name).symlink_to(path.resolve())
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return here


def read(document, folder):
    """Do what a document says, in its order; snippets of Python go on where those before them ended."""
    names = {"__name__": "reader"}
    for block in blocks(document):
        if block.needs is not None:
            continue
        if block.language == "yaml":
            (folder / "read.yaml").write_text(block.text)
            assert relight.read_lights(folder / "read.yaml"), block
        elif block.language == "python":
            exec(compile("\n" * (block.line - 1) + block.text, str(document), "exec"), names)
        elif block.language == "sh":
            for words in block.commands():
                try:
                    documents.run(words, folder)
                except AssertionError as error:
                    raise AssertionError(f"{block}: {shlex.join(words)}: {error}") from error


def named(path):
    return path.name


@pytest.fixture
def narrow(monkeypatch):
    """The paper's `resb7` with few channels: a step of Muon takes ten seconds in its own 46 million weights.

    `resb3` keeps its channels.
    """

    def task(latent, with_normals=True):
        whole = per_light(latent, with_normals)
        few = {"widths": (8, 8, 16, 16, 32)} if latent == "resb7" else {}
        return replace(whole, config=whole.config | few)

    monkeypatch.setattr("shadow.training.tasks.per_light", task)


@pytest.fixture
def small_workers():
    """Workers of Dask run the networks on a small canvas, as this process does."""
    dask = pytest.importorskip("dask")
    pytest.importorskip("distributed")  # before its configuration is changed
    with dask.config.set({"distributed.worker.preload": [str(ROOT / "tests/helpers/small_worker.py")]}):
        yield


@pytest.fixture
def one_pool(monkeypatch):
    """The processes of the light stage stay for the commands after it: they know by then how bodies look."""
    pools = []

    def pool(*arguments, **options):
        pools[:] = pools or [ProcessPoolExecutor(*arguments, **options)]
        return nullcontext(pools[0])

    monkeypatch.setattr("shadow.lightstage.stage.ProcessPoolExecutor", pool)
    yield
    for each in pools:
        each.shutdown()


@pytest.mark.filterwarnings("ignore:the network 'shading' was trained with")  # as docs/compositing.md says
@pytest.mark.slow
@pytest.mark.parametrize("document", DOCUMENTS, ids=named)
def test_what_a_document_says_works(document, reader, narrow, one_pool, small_workers):
    read(document, reader)


@pytest.mark.usefixtures("full_canvas")
@pytest.mark.slow
def test_the_figures_are_drawn_anew(reader, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("sys.argv", ["figures.py", str(reader)])
    runpy.run_path(str(ROOT / "docs" / "figures.py"), run_name="__main__")
    for name in ("axes.png", "way.png"):
        kept = relight.read(ROOT / "docs" / name)
        drawn = relight.read(reader / name)
        assert kept.shape == drawn.shape  # fonts of other machines are let be
        assert np.abs(kept - drawn).mean() < 0.02
        assert (ROOT / "docs" / name).stat().st_size < 300_000


def test_every_block_is_tried_or_says_what_it_needs():
    found = [block for document in DOCUMENTS for block in blocks(document)]
    assert {block.language for block in found} == RUN
    assert Counter(block.needs for block in found if block.needs is not None) == NEEDS
    fences = sum(document.read_text().count("```") for document in DOCUMENTS)
    assert fences == 2 * len(found)  # none is indented, or unlike the others


def test_a_command_that_fails_is_noticed(reader):
    (reader / "wrong.md").write_text("```sh\nrelight apply photo.png --light azimuth=-40 -o relit.png\n```\n")
    with pytest.raises(AssertionError, match=r"relight apply photo\.png"):  # it has no matte
        read(reader / "wrong.md", reader)


def test_the_readme_command_relights_the_bundled_person(reader):
    (reader / "examples").unlink()
    (reader / "examples").symlink_to(ROOT / "examples")  # in its own size
    command = next(block for block in blocks(ROOT / "README.md") if "relight apply" in block.text)
    (words,) = command.commands()
    documents.run(words, reader, apart=True)
    picture = relight.read(reader / "relit.exr")
    layers = relight.read_layers(reader / "relit.exr")
    assert set(layers) == {"C_key", "C_rim", "C_background"}
    total = sum(layer[..., :3] for layer in layers.values())
    np.testing.assert_allclose(total, picture[..., :3], atol=3e-3)
    assert relight.read(reader / "relit.png").shape == picture.shape
    assert picture.shape[:2] == relight.read(ROOT / "examples" / "person.png").shape[:2]


def test_the_readme_snippet_writes_both_lights(reader):
    snippet = next(block for block in blocks(ROOT / "README.md") if block.language == "python")
    exec(compile(snippet.text, "README.md", "exec"), {})
    assert set(relight.read_layers(reader / "relit.exr")) == {"C_key", "C_rim"}


@pytest.mark.slow
def test_the_readme_orbit_is_a_movie_in_which_the_light_moves(reader):
    block = next(block for block in blocks(ROOT / "README.md") if "orbit.mp4" in block.text)
    (words,) = block.commands()
    documents.run(words, reader)
    movie = Movie(reader / "orbit.mp4")
    first, last = (movie.read(movie.numbers[index]) for index in (0, -1))
    assert np.abs(first - last).max() > 0.05


def test_ci_runs_the_readme_test_command_and_then_what_is_slow():
    command = re.search(r"## Run the tests\s+```sh\n(.*?)\n```", README, re.DOTALL).group(1)
    program = (ROOT / ".ci" / "run").read_text()
    assert f"({command})\n" in program
    assert program.index(".venv/bin/pytest -m slow") > program.index(command)


def test_the_readme_is_short_and_its_links_lead_somewhere():
    assert len(README.splitlines()) <= 150
    card = ROOT / "shadow" / "weights" / "MODEL_CARD.md"
    assert len(card.read_text().splitlines()) <= 185
    for document in [*DOCUMENTS, card]:
        for target in re.findall(r"\]\(([^)\s]+)\)", document.read_text()):
            path, _, heading = target.partition("#")
            if path.startswith("http"):
                continue
            linked = document.parent / path if path else document
            assert linked.exists(), f"{document.name}: {target}"
            if heading:
                headings = re.findall(r"^#+ (.*)$", linked.read_text(), re.MULTILINE)
                anchors = [re.sub(r"[^\w -]", "", text.lower()).replace(" ", "-") for text in headings]
                assert heading in anchors, f"{document.name}: {target}"


@pytest.mark.parametrize("package", [relight, shadow, shading], ids=lambda package: package.__name__)
def test_every_public_name_is_in_a_document(package):
    pages = "\n".join(page.read_text() for page in DOCUMENTS if page.name != "architecture.md")
    for name in package.__all__:
        assert re.search(rf"\b{package.__name__}\.{name}\b", pages), f"{package.__name__}.{name}"


def test_options_in_prose_are_those_of_a_command():
    def options(command):
        yield from (option for given in command.params for option in (*given.opts, *given.secondary_opts))
        for each in getattr(command, "commands", {}).values():
            yield from options(each)

    ours = {*options(get_command(app)), "--help"}
    programs = [*(ROOT / "benchmarks").rglob("*.py"), *(ROOT / "examples").glob("*.py")]
    ours |= {found for path in programs for found in re.findall(r'"(--[\w-]+)"', path.read_text())}
    for document in [*DOCUMENTS, ROOT / "shadow" / "weights" / "MODEL_CARD.md"]:
        prose = documents.FENCE.sub("", document.read_text())
        named = {*re.findall(r"(?<![\w-])--[a-z][\w-]*", re.sub(r"<!--.*?-->", "", prose, flags=re.DOTALL))}
        assert named <= ours, f"{document.name}: {named - ours}"


def test_the_architecture_names_files_and_functions_that_exist():
    page = (ROOT / "docs" / "architecture.md").read_text()
    folder, named = None, []
    for name in re.findall(r"`([\w/]+(?:\.\w+)?)`", page):
        if "/" in name:
            folder = ROOT / name if (ROOT / name).is_dir() else (ROOT / name).parent
            named.append(ROOT / name)
        elif name.endswith((".py", ".js")):  # beside the file that was named before it
            named.append(folder / name)
    assert len(named) > 50
    assert not [path for path in named if not path.exists()]
    sources = "".join(path.read_text() for path in named if path.suffix == ".py")
    for cls, function in re.findall(r"`([A-Z]\w+)\.(\w+)`", page):
        assert f"class {cls}" in sources, cls
        assert f"def {function}(" in sources, function


def test_the_architecture_says_the_order_that_the_tests_check():
    page = (ROOT / "docs" / "architecture.md").read_text()
    rows = re.findall(r"^\| `relight/(\w+)(?:\.py)?` \|", page, re.MULTILINE)
    present = [name for name in FOLDERS if list((ROOT / "relight").glob(f"{name}*"))]
    assert rows == present


def test_the_table_of_what_files_state_is_that_of_the_tests():
    _, written, _ = stated_table.documented()
    assert written == stated_table.table(), "run python tests/helpers/stated_table.py"
