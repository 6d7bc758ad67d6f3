"""Lighting that photographers know by name: `relight/presets.yaml`, the same everywhere."""

import math
from typing import cast

from relight import quantities
from relight.arguments import checked, checks_arguments, shown
from relight.lights.files import Entry, from_entries
from relight.lights.light import Light
from relight.lights.preset_table import Preset, document, known

HEIGHT = 1.75  # metres of the person for whom the file is written


@checks_arguments
def presets(height: quantities.Height = HEIGHT) -> dict[str, list[Light]]:
    """Return all lighting presets, by name.

    Parameters
    ----------
    height
        Metres of the person, in [0.01, 100]: lamps near them are placed and dimmed in proportion.

    Returns
    -------
    dict[str, list[Light]]
        {name: lights}. Wherever lights are taken, a name alone stands for them.

    Raises
    ------
    TypeError, ValueError
        No height.

    Examples
    --------
    >>> import relight
    >>> [light.name for light in relight.presets()["rembrandt"]]
    ['key', 'fill']
    """
    return {name: named(name, height=height) for name in document()}


def named(name: str, argument: str = "preset", height: float = HEIGHT) -> list[Light]:
    """Return the lights of a preset, which is given as an `argument`, for a person of a height in metres.

    Raises ValueError for another name, and as `presets` does.
    """
    scale = checked("height", height, quantities.Height) / HEIGHT
    lights = from_entries([_scaled(entry, scale) for entry in _known(name, argument)["lights"]])
    return cast("list[Light]", lights)  # none of the file's moves


def gloss(name: str) -> float:
    """Return the gloss of a preset, 0 by default. Raises ValueError for another name."""
    return float(_known(name, "preset").get("gloss", 0))


def _known(name: str, argument: str) -> Preset:
    """Return what the file says of a preset. Raises as `named` does."""
    if not isinstance(name, str):
        raise TypeError(f"{argument}: expected the name of a preset, got {shown(name)}")
    try:
        return document()[known(name)]
    except ValueError as error:
        raise ValueError(f"{argument}: {error}") from None


def _scaled(entry: Entry, scale: float) -> Entry:
    """Return an entry for a person `scale` times as high: as bright, for light falls off with distance."""
    if "position" not in entry or scale == 1:
        return entry
    position = [scale * value for value in entry["position"]]
    exposure = entry.get("exposure", 0) + 2 * math.log2(scale)
    return entry | {"position": position, "radius": scale * entry["radius"], "exposure": exposure}
