import ast
import graphlib
import pkgutil
import subprocess
import sys
import tomllib
from importlib import import_module
from types import ModuleType

import pytest
from helpers import ROOT
from helpers.architecture import FOLDERS

import relight

APART = {
    f"shadow.{role}" for role in ("data", "training", "evaluation", "lightstage")
}  # what made the weights
LOWER = {"shadow": set(), "shading": {"shadow"}, "relight": {"shadow", "shading"}}


def imported(path):
    """Dotted names of all that a file imports, in its functions too."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively, which these tests do not follow"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def within(name, packages):
    return any(name == package or name.startswith(f"{package}.") for package in packages)


@pytest.mark.parametrize("package", LOWER)
def test_imports_run_one_way(package):
    files = list((ROOT / package).rglob("*.py"))
    assert files
    for path in files:
        ours = {top for name in imported(path) if (top := name.split(".")[0]) in LOWER} - {package}
        assert ours <= LOWER[package], f"{path} imports {ours}"


# `Subject.view` and `Subject.export` hand the person over to what is built upon them, when they are called.
UPWARD = {("subject", "viewer"), ("subject", "scene")}


def module_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for package in LOWER for path in (ROOT / package).rglob("*.py")}


def dependencies(name):
    """The modules of ours that a module imports, in its functions too."""
    for found in imported(MODULES[name]):
        while found and found not in MODULES:
            found = found.rpartition(".")[0]
        if found and found not in (name, "relight"):  # the top package hands out names lazily
            yield found


def test_no_files_import_each_other_in_a_circle():
    sorter = graphlib.TopologicalSorter({name: {*dependencies(name)} for name in MODULES})
    sorter.prepare()  # CycleError names the circle


def test_the_folders_of_relight_import_downward():
    def folder(name):
        return name.split(".")[1] if name.startswith("relight.") else None

    for name in MODULES:
        if (above := folder(name)) is None or above == "errors":
            continue
        assert above in FOLDERS, f"{name} is in no folder of the design"
        for other in dependencies(name):
            below = folder(other)
            if below in (None, "errors") or (above, below) in UPWARD:
                continue
            assert FOLDERS.index(above) <= FOLDERS.index(below), f"{name} imports {other}"


def test_what_infers_does_not_import_what_made_its_weights():
    files = [
        path
        for path in (ROOT / "shadow").rglob("*.py")
        if not within(".".join(path.relative_to(ROOT).with_suffix("").parts), APART)
    ]
    assert {"visibility.py", "normals.py", "framing.py", "field.py"} <= {path.name for path in files}
    for path in files:
        assert not [name for name in imported(path) if within(name, APART)], path


RELIT = """
import sys
import numpy as np
import relight

person = np.zeros((64, 48, 4), np.float32)
person[8:56, 12:36] = 0.3, 0.3, 0.3, 1
subject = relight.Subject(person)
assert subject.relit([relight.DirectionalLight(azimuth=-40, elevation=30)])[20, 20, :3].min() > 0
print(*sys.modules)
"""


def test_relighting_loads_nothing_that_training_or_keying_alone_needs():
    command = [sys.executable, "-c", RELIT]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    loaded = run.stdout.split()
    assert "shading.diffuse" in loaded
    assert not [name for name in loaded if within(name, APART | {"trimesh", "anny", "mitsuba", "numba"})]


def test_no_module_takes_the_place_of_a_public_name():
    names = [module.name for module in pkgutil.walk_packages(relight.__path__, "relight.")]
    assert "relight.subject" in names
    assert not {name.removeprefix("relight.") for name in names} & set(relight.__all__)
    for name in names:
        if not name.endswith("__main__"):
            import_module(name)
    for name in relight.__all__:  # a lazy export is looked up the first time, an attribute the second
        first, second = getattr(relight, name), getattr(relight, name)
        assert first is second, name
        assert not isinstance(first, ModuleType), name


def test_editors_see_the_lazy_exports():
    """What type checkers are shown to import is what `relight` hands out."""
    tree = ast.parse((ROOT / "relight" / "__init__.py").read_text())
    (shown,) = (node for node in tree.body if isinstance(node, ast.If))
    assert ast.unparse(shown.test) == "TYPE_CHECKING"
    found = {alias.name: node.module for node in shown.body for alias in node.names}
    assert found == relight._EXPORTS


@pytest.mark.parametrize("package", LOWER)
def test_type_checkers_trust_the_annotations(package):
    assert (ROOT / package / "py.typed").is_file()
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    assert "py.typed" in setuptools["package-data"][package]


def test_the_light_stage_is_not_needed_at_run_time():
    for package in LOWER:
        for path in (ROOT / package).rglob("*.py"):
            if "lightstage" not in path.parts:
                top_level = ast.parse(path.read_text()).body
                names = [ast.unparse(node) for node in top_level if isinstance(node, ast.ImportFrom)]
                assert not any("lightstage" in name for name in names), path


def test_every_package_and_weight_file_is_installed():
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    folders = {path.parent.relative_to(ROOT) for package in LOWER for path in (ROOT / package).rglob("*.py")}
    assert {".".join(folder.parts) for folder in folders} == set(setuptools["packages"])
    for package in ("shadow", "shading"):
        patterns = setuptools["package-data"][package]
        for path in (ROOT / package / "weights").iterdir():
            assert any(path.relative_to(ROOT / package).match(pattern) for pattern in patterns), path


PEOPLE = ("generate", "accessories", "cloth", "body")  # each folder imports only those after it


@pytest.mark.parametrize("folder", PEOPLE)
def test_the_folders_of_people_import_one_way(folder):
    package = "shadow.lightstage.people"
    files = list((ROOT / "shadow" / "lightstage" / "people" / folder).glob("*.py"))
    assert len(files) > 1
    above = {f"{package}.{name}" for name in PEOPLE[: PEOPLE.index(folder)]}
    for path in files:
        assert not [name for name in imported(path) if within(name, above)], path


PIPELINE = ROOT / "relight" / "pipeline"
# What the folders above the pipeline may know of it: a shot, its options, and the public functions.
OFFERED = {"shot", "frame_numbers", "run", "options", "option_fields"} | {
    "render",
    "analyse",
    "track",
    "olat",
    "export",
}
COMMANDS_ALONE = {"early_checks", "many"}  # what a command line refuses early; runs over many pictures
MAKERS = {"FrameReader", "FrameAnalyser", "ReadLog", "Persons", "using"}


@pytest.mark.parametrize("folder", ["app", "comfyui", "distributed", "viewer", "cli"])
def test_what_stands_above_the_pipeline_knows_only_shots_and_options(folder):
    more = {"comfyui": {"persons"}, "cli": COMMANDS_ALONE}  # a batch of images is no file
    offered = OFFERED | more.get(folder, set())
    for path in (ROOT / "relight" / folder).glob("*.py"):
        known = {name.split(".")[2] for name in imported(path) if within(name, {"relight.pipeline"})}
        assert known <= offered, f"{path} imports {known - offered}"


def called(path):
    """Names of the functions and classes that a file calls."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call):
            yield node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


def test_only_a_shot_makes_what_reads_and_analyses_its_frames():
    assert set(called(PIPELINE / "shot.py")) >= MAKERS
    for folder in ("pipeline", "app", "cli", "distributed", "viewer"):
        for path in (ROOT / "relight" / folder).glob("*.py"):
            assert path.name == "shot.py" or not MAKERS & set(called(path)), path


def test_constructors_of_the_pipeline_have_at_most_six_parameters():
    constructors = [
        (path, node)
        for path in PIPELINE.glob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef) and node.name == "__init__"
    ]
    assert constructors
    for path, node in constructors:
        assert len([*node.args.args, *node.args.kwonlyargs]) - 1 <= 6, f"{path}:{node.lineno}"


def test_fetching_networks_and_files_of_options_load_no_torch():
    """Torch takes 200 MB and most of a second."""
    program = "import sys, shadow, shadow.files\n"
    program += "from relight.matting import silhouette_files\nfrom relight.matting.people import files\n"
    program += "assert 'analyse' in dir(shadow); assert 'torch' not in sys.modules; shadow.analyse\n"
    subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=True)


OURS = {"relight", "shading", "shadow"}
OF_NAMED_TUPLES = {"_asdict", "_fields", "_replace"}


def private_names(path):
    """The private names of our modules and classes that a test imports, calls or replaces."""
    tree, known = ast.parse(path.read_text()), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in OURS:
            known |= {alias.asname or alias.name for alias in node.names}
            yield from (alias.name for alias in node.names if is_private(alias.name))
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and is_private(node.attr):
            if getattr(node.value, "id", None) in known:
                yield ast.unparse(node)
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") in {"setattr", "object"}:
            replaced = ".".join(ast.unparse(each).strip("'\"") for each in node.args[:2])
            first, *rest = replaced.split(".")
            if first in known | OURS and any(map(is_private, rest)):
                yield replaced


def is_private(name):
    return name.startswith("_") and not name.startswith("__") and name not in OF_NAMED_TUPLES


def test_tests_know_no_private_names():
    for path in (ROOT / "tests").rglob("*.py"):
        assert not list(private_names(path)), path
