"""`relight comfyui`: the nodes' registration in a ComfyUI folder."""

import importlib.util
import subprocess
import sys
import tomllib

import pytest
from typer.testing import CliRunner

from relight.cli.commands import app
from relight.comfyui import NODE_CLASS_MAPPINGS
from relight.comfyui.install import install


@pytest.fixture
def comfyui(tmp_path):
    for name in ("custom_nodes", "models"):
        (tmp_path / name).mkdir()
    return tmp_path


def test_two_lines_register_the_nodes(comfyui):
    result = CliRunner().invoke(app, ["comfyui", str(comfyui)])
    assert result.exit_code == 0, result.output
    file = comfyui / "custom_nodes" / "relight-nodes" / "__init__.py"
    assert len(file.read_text().splitlines()) == 2
    spec = importlib.util.spec_from_file_location("registered", file)  # as ComfyUI loads it
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.NODE_CLASS_MAPPINGS is NODE_CLASS_MAPPINGS
    assert set(module.NODE_DISPLAY_NAME_MAPPINGS) == set(NODE_CLASS_MAPPINGS)
    assert (file.parent / module.WEB_DIRECTORY / "relight.js").is_file()
    before = file.read_bytes()
    assert install(comfyui) == file  # again
    assert file.read_bytes() == before
    assert {path.name for path in file.parent.iterdir() if path.is_file()} == {
        "__init__.py",
        "pyproject.toml",
    }
    offered = sorted(path.name for path in (file.parent / "example_workflows").iterdir())
    assert offered == ["moving_light.json", "place.json", "portrait.json"]
    registry = tomllib.loads((file.parent / "pyproject.toml").read_text())
    assert registry["project"]["name"] == file.parent.name  # the registry names the folder so
    assert registry["tool"]["comfy"]["DisplayName"] == "Relight"


def test_other_folders_are_refused(comfyui, tmp_path):
    (tmp_path / "other").mkdir()
    with pytest.raises(ValueError, match="expected ComfyUI's folder"):
        install(tmp_path / "other")
    with pytest.raises(FileNotFoundError, match="no such folder"):
        install(tmp_path / "none")
    theirs = comfyui / "custom_nodes" / "relight-nodes"
    theirs.mkdir()
    (theirs / "nodes.py").write_text("")
    with pytest.raises(ValueError, match="holds other nodes"):
        install(comfyui)
    assert [path.name for path in theirs.iterdir()] == ["nodes.py"]
    result = CliRunner().invoke(app, ["comfyui", str(tmp_path / "other")])
    assert result.exit_code == 2


def test_a_failed_write_leaves_nothing(comfyui, monkeypatch):
    monkeypatch.setattr("relight.comfyui.install.LINES", 3)  # no text
    with pytest.raises(TypeError):
        install(comfyui)
    assert not list((comfyui / "custom_nodes").iterdir())


def test_the_folder_does_not_hide_the_package(comfyui):
    """ComfyUI loads a folder under its own name in some versions, and one installs in custom_nodes."""
    earlier = comfyui / "custom_nodes" / "relight"
    earlier.mkdir()
    (earlier / "__init__.py").write_text("from relight.comfyui import NODE_CLASS_MAPPINGS")
    folder = install(comfyui).parent
    assert not earlier.exists()
    load = (
        "import importlib.util, sys\n"
        f"spec = importlib.util.spec_from_file_location({folder.name!r}, r'{folder}/__init__.py')\n"
        f"sys.modules[{folder.name!r}] = module = importlib.util.module_from_spec(spec)\n"
        "spec.loader.exec_module(module)\n"
        "assert module.NODE_CLASS_MAPPINGS\n"
        "from relight.comfyui.install import install\n"
        "install('..')\n"
    )
    subprocess.run([sys.executable, "-c", load], check=True, cwd=folder.parent)
    assert not folder.name.isidentifier()  # no import statement can find it


def test_loaders_may_name_the_module_as_they_like(comfyui):
    """After the folder (hiddenswitch, ComfyUI of 2023), or after its path with other signs for dots."""
    file = install(comfyui)
    load = (
        "import importlib.util, sys\n"
        f"path = r'{file.parent}'\n"
        "names = 'relight-nodes', 'relight_nodes', 'custom_nodes.relight-nodes', path.replace('.', '_x_')\n"
        "for name in names:\n"
        "    spec = importlib.util.spec_from_file_location(name, path + '/__init__.py')\n"
        "    sys.modules[name] = module = importlib.util.module_from_spec(spec)\n"
        "    spec.loader.exec_module(module)\n"
        "    assert module.NODE_CLASS_MAPPINGS\n"
        "import relight\n"
        "assert relight.DirectionalLight\n"
    )
    subprocess.run([sys.executable, "-c", load], check=True, cwd=file.parent)


def test_somebody_elses_folder_of_that_name_stays(comfyui):
    theirs = comfyui / "custom_nodes" / "relight"
    theirs.mkdir()
    (theirs / "__init__.py").write_text("NODE_CLASS_MAPPINGS = {}")
    install(comfyui)
    assert theirs.exists()
