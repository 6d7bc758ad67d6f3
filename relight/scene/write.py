"""Write a person as an asset of a 3D program, by the suffix of the file."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import numpy as np

from relight.lights.directional import DirectionalLight
from relight.media import images
from relight.scene.asset import Asset, companion
from relight.scene.gltf import write as gltf
from relight.scene.nuke import person_group
from relight.scene.nuke.layers import NAMES, Basis, layers_of
from relight.scene.person import Person
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


AnyPerson = TypeVar("AnyPerson", bound=Person)
Add = Callable[[int, Person], None]  # writes a frame of that number


@contextmanager
def stage_sequence(
    path: Path, asset: Callable[[AnyPerson], Asset], rate: float
) -> Iterator[Callable[[int, AnyPerson], None]]:
    """Write a person who moves, frame by frame: .usda, .usdc or .usdz, complete once it is closed.

    `asset`: makes what is written of a subject. Frames that show nobody are left out.
    """
    with usd.sequence(path, rate) as add:
        yield lambda number, subject: None if subject.is_empty else add(number, asset(subject))


def write_script(
    path: AnyPath,
    subject: Person,
    lights: Sequence[DirectionalLight],
    gloss: float = 0.0,
    amount: float = 1.0,
) -> Path:
    """Write a Nuke script that lights a `relight.Subject`, and the layers it reads: `<name>_layers.exr`."""
    path = Path(path)
    basis = Basis.of([subject])
    picture = companion(path, LAYERS)
    _write_layers(picture, subject, basis)
    person_group.write(path, picture, basis, lights, subject.size, gloss=gloss, amount=amount)
    return path


def spread(numbers: Sequence[int]) -> Sequence[int]:
    """Return the frames of a shot, evenly spread, whose components all frames of a script share."""
    return numbers[:: -(-len(numbers) // BASIS_FRAMES)]


@contextmanager
def script_sequence(
    path: Path,
    chosen: Mapping[int, Person],
    numbers: Sequence[int],
    lights: Sequence[DirectionalLight],
    rate: float,
    gloss: float = 0.0,
    amount: float = 1.0,
) -> Iterator[Add]:
    """Write a Nuke script that lights a person who moves, and its layers: `<name>_layers.%04d.exr`.

    `chosen`: {frame: its subject}, the frames of `spread`, whose components all frames share. `numbers`: all
    frames, `rate` a second. `lights`, `gloss`, `amount`: what the knobs begin with. The script is written
    when it is closed. Raises ValueError if none of the chosen frames shows a person, or frames differ in
    size.
    """
    shown = [subject for subject in chosen.values() if not subject.is_empty]
    if not shown:
        looked = ", ".join(map(str, chosen))
        raise ValueError(f"frames: expected some that show the person; frames {looked} do not")
    basis, size = Basis.of(shown), shown[0].size

    def add(number: int, subject: Person) -> None:
        if not subject.is_empty and subject.size != size:
            raise ValueError(f"frame {number}: has size {subject.size}, the first has {size}")
        _write_layers(companion(path, LAYERS, FRAME % number), subject, basis, size)

    yield add
    person_group.write(
        path, companion(path, LAYERS, FRAME), basis, lights, size, frames=(numbers[0], numbers[-1]),
        rate=rate, gloss=gloss, amount=amount,
    )  # fmt: skip


def _write_layers(path: Path, subject: Person, basis: Basis, size: tuple[int, int] = (0, 0)) -> None:
    """Write the layers of a person, or zeros of a size where there is none."""
    if subject.is_empty:
        picture = np.zeros((*size, 4), np.float32)
        layers = {name: picture[..., :3] for name in NAMES}
    else:
        picture, layers = layers_of(subject, basis)
    images.write(path, picture, layers=layers, autocrop=True)
