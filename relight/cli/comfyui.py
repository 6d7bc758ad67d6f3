"""`relight comfyui`: the nodes in a ComfyUI folder."""

from pathlib import Path
from typing import Annotated

import typer

from relight.cli.options import console


def comfyui(
    path: Annotated[Path, typer.Argument(help="ComfyUI's folder, which contains custom_nodes.")],
) -> None:
    """Register the ComfyUI nodes: write custom_nodes/relight-nodes/__init__.py into a ComfyUI folder."""
    from relight.comfyui.install import install

    written = install(path)
    console.print(f"{written}: restart ComfyUI, and find the nodes under relight", soft_wrap=True)
