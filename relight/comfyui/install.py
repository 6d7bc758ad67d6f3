"""Registers the nodes in a ComfyUI folder: what `relight comfyui` calls."""

import shutil
from pathlib import Path

from relight.version import __version__
from shadow.files import AnyPath, replacing

# With a hyphen, so that it cannot be imported: a folder `relight` would hide the package where a loader names
# a module after its folder, and where Python runs in custom_nodes.
FOLDER = "relight-nodes"
WORKFLOWS = "example_workflows"  # ComfyUI offers the workflows in this folder as templates
MINE = {"__init__.py", "pyproject.toml", WORKFLOWS}
LINES = '''"""The nodes of relight, which is installed as a package; written by `relight comfyui`."""
from relight.comfyui import NODE_CLASS_MAPPINGS, NODE_DISPLAY_NAME_MAPPINGS, WEB_DIRECTORY  # noqa: F401
'''

REGISTRY = """# For ComfyUI's registry, `comfy node publish`: fill in your publisher's name.
[project]
name = "relight-nodes"
version = "{version}"
description = "Relight a photographed person: cast shadows for any light, exactly linear, on a CPU."
license = "Apache-2.0"

[tool.comfy]
PublisherId = ""
DisplayName = "Relight"
"""


def install(comfyui: AnyPath) -> Path:
    """Write `custom_nodes/relight-nodes/__init__.py`, which imports the nodes, into a ComfyUI folder.

    Beside it are the example workflows, which ComfyUI offers, and a `pyproject.toml` for its registry. The
    folder is that of ComfyUI's program, or the data folder of ComfyUI Desktop. An earlier file is replaced,
    whole or not at all, and the folder `custom_nodes/relight` of an earlier version is removed. Returns the
    file.

    Raises FileNotFoundError if there is no such folder, ValueError if it is not ComfyUI's or has other nodes
    in `custom_nodes/relight-nodes`, OSError if the file cannot be written.
    """
    root = Path(comfyui)
    if not root.is_dir():
        raise FileNotFoundError(f"{root}: no such folder")
    if not (root / "custom_nodes").is_dir() or not any(
        (root / name).is_dir() for name in ("comfy", "models")
    ):
        raise ValueError(f"{root}: expected ComfyUI's folder, the one that holds custom_nodes and models")
    folder = root / "custom_nodes" / FOLDER
    file = folder / "__init__.py"
    if folder.exists() and not _is_ours(folder):
        raise ValueError(f"{folder}: holds other nodes; expected this folder to be free")
    new = not folder.exists()
    folder.mkdir(exist_ok=True)
    workflows = Path(__file__).with_name(WORKFLOWS).glob("*.json")
    contents = {folder / WORKFLOWS / workflow.name: workflow.read_text("utf-8") for workflow in workflows}
    contents |= {folder / "pyproject.toml": REGISTRY.format(version=__version__), file: LINES}
    try:
        (folder / WORKFLOWS).mkdir(exist_ok=True)
        for path, content in contents.items():
            with replacing(path) as beside:
                beside.write_text(content, encoding="utf-8")
    except BaseException:
        if new:
            shutil.rmtree(folder)
        raise
    if _is_ours(earlier := folder.with_name("relight")):
        shutil.rmtree(earlier)
    return file


def _is_ours(folder: Path) -> bool:
    """Return whether a folder holds what `install` writes, and nothing else."""
    file = folder / "__init__.py"
    names = {path.name for path in folder.glob("*")} - {"__pycache__"}
    return file.name in names <= MINE and "relight.comfyui" in file.read_text(encoding="utf-8")
