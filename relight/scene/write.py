"""Write a person as an asset of a 3D program, by the suffix of the file."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from relight.lights.directional import DirectionalLight
from relight.media import images
from relight.scene.asset import Asset, companion
from relight.scene.gltf import write as gltf
from relight.scene.nuke import person_group
from relight.scene.nuke.layers import NAMES, Basis, layers_of
from relight.scene.usd import write as usd
from shadow.files import AnyPath

LAYERS, FRAME = "layers", "%04d"  # in the names of the files beside a script
BASIS_FRAMES = 8  # of a shot, evenly spread, whose components all its frames share


def companions(path: Path, texture: str) -> list[Path]:
    """Return what is written beside an asset or a script: its texture or layers, of one frame or of many."""
    content = {".nk": LAYERS, ".usda": texture, ".usdc": texture}.get(path.suffix.lower())
    return [] if content is None else [companion(path, content), companion(path, content, FRAME)]


def write(path: AnyPath, asset: Asset) -> Path:
    """Write the asset: .glb, .usda, .usdc or .usdz. A stage that is no package has its texture beside it."""
    path = Path(path)
    if path.suffix.lower() == ".glb":
        gltf.write(path, asset)
    else:
        usd.write(path, asset)
    return path


def write_sequence(path: AnyPath, frames: Iterable[tuple[int, Asset]], rate: float) -> Path:
    """Write a person who moves, from (frame number, asset): .usda, .usdc or .usdz."""
    path = Path(path)
    usd.write_sequence(path, frames, rate)
    return path


def write_script(path: AnyPath, subject: Any, lights: Sequence[DirectionalLight], gloss: float = 0.0) -> Path:
    """Write a Nuke script that lights a `relight.Subject`, and the layers it reads: `<name>_layers.exr`."""
    path = Path(path)
    basis = Basis.of([subject])
    picture = companion(path, LAYERS)
    _write_layers(picture, subject, basis)
    person_group.write(path, picture, basis, lights, subject.size, gloss=gloss)
    return path


def write_script_sequence(
    path: AnyPath,
    person: Callable[[int], Any],
    numbers: Sequence[int],
    lights: Sequence[DirectionalLight],
    rate: float,
    progress: Callable[[int, int, str], None],
    gloss: float = 0.0,
) -> Path:
    """Write a Nuke script that lights a person who moves, and its layers: `<name>_layers.%04d.exr`.

    `person`: the `relight.Subject` of a frame, which may be empty. `numbers`: the frames, `rate` a second.
    `lights`, `gloss`: what the knobs begin with. `progress` is called with (frames done, frames in all, what
    is done). Raises ValueError if none of the frames shows a person, or they differ in size.
    """
    path = Path(path)
    step = -(-len(numbers) // BASIS_FRAMES)
    chosen = [subject for number in numbers[::step] if not (subject := person(number)).is_empty]
    if not chosen:
        looked = ", ".join(str(number) for number in numbers[::step])
        raise ValueError(f"frames: expected some that show the person; frames {looked} do not")
    basis, size = Basis.of(chosen), chosen[0].size
    del chosen
    for done, number in enumerate(numbers):
        progress(done, len(numbers), "Frames")
        subject = person(number)
        if not subject.is_empty and subject.size != size:
            raise ValueError(f"frame {number}: has size {subject.size}, the first has {size}")
        _write_layers(companion(path, LAYERS, FRAME % number), subject, basis, size)
    progress(len(numbers), len(numbers), "Frames")
    picture = companion(path, LAYERS, FRAME)
    person_group.write(
        path, picture, basis, lights, size, frames=(numbers[0], numbers[-1]), rate=rate, gloss=gloss
    )
    return path


def _write_layers(path: Path, subject: Any, basis: Basis, size: tuple[int, int] = (0, 0)) -> None:
    """Write the layers of a person, or zeros of a size where there is none."""
    if subject.is_empty:
        picture = np.zeros((*size, 4), np.float32)
        layers = {name: picture[..., :3] for name in NAMES}
    else:
        picture, layers = layers_of(subject, basis)
    images.write(path, picture, layers=layers, autocrop=True)
