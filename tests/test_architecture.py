import ast
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LOWER = {"shadow": set(), "shading": {"shadow"}, "relight": {"shadow", "shading"}}


def imported(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module.split(".")[0]


@pytest.mark.parametrize("package", LOWER)
def test_imports_run_one_way(package):
    files = list((ROOT / package).rglob("*.py"))
    assert files
    for path in files:
        ours = {name for name in imported(path) if name in LOWER} - {package}
        assert ours <= LOWER[package], f"{path} imports {ours}"


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
