"""What a command refuses at once, before torch is loaded for seconds: names of files and texts of lights.

A run checks all of it again, and the rest, where it belongs.
"""

import os
import re
from collections.abc import Iterable, Iterator
from typing import cast

from relight.arguments import meant
from relight.lights.moving import parse
from relight.media import images
from relight.media.option_texts import split_file_and_settings
from relight.media.sequences import FrameSequence
from relight.pipeline.options import Lighting, Output, Source
from relight.pipeline.outputs import check_outputs
from relight.quantities import BACKGROUNDS

ADDRESS = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]+://")  # of a picture on the network
LIKELY_NAMES = 200  # files of a folder among which the one that is meant is looked for


def check_early(
    source: Source | None = None, lighting: Lighting | None = None, output: Output | None = None
) -> None:
    """Raise FileNotFoundError or ValueError for options of a command line that cannot be meant.

    A command that has outputs needs lights as well.
    """
    if output is not None:
        check_outputs(output, _read_paths(source, lighting))
    if lighting is not None:
        for text in cast("Iterable[str]", lighting.light):
            parse(text)
    for path in _read_paths(source, lighting):
        check_there(path)
    if lighting is not None and output is not None:
        lighting.check_any()


def check_there(path: str) -> None:
    """Raise FileNotFoundError for no such file, ValueError for an address; frames are looked for later."""
    if ADDRESS.match(path):
        raise ValueError(f"{path}: is an address; download the picture, and give the name of its file")
    file, _ = images.split_layer(path)
    if file.exists() or FrameSequence.of(path) is not None:
        return
    folder = file.parent
    names = sorted(os.listdir(folder))[:LIKELY_NAMES] if folder.is_dir() else []
    near = meant(file.name, names)
    raise FileNotFoundError(f"{path}: no such file{f'; did you mean {folder / near}?' if near else ''}")


def _read_paths(source: Source | None, lighting: Lighting | None) -> Iterator[str]:
    """Yield the paths of pictures and lights files that are read."""
    given: list[object] = []
    if source is not None:
        given += [source.plate, source.mask, source.track]
    if lighting is not None:
        background = lighting.background
        given += [lighting.lights, lighting.match, lighting.match_mask, lighting.paint]
        given += [split_file_and_settings(text)[0] for text in lighting.environment]
        given += [background] if background not in BACKGROUNDS else []
    yield from (os.fspath(each) for each in given if isinstance(each, str | os.PathLike))
