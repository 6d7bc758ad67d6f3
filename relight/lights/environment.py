"""Light from all around: a latitude-longitude map, and the directions it comes down to.

The map follows OpenEXR's convention (ImfEnvmap.h): pixel (0, 0) has latitude +90 and longitude +180 degrees,
and longitude falls along a row. In the camera frame latitude is elevation and longitude azimuth, so the
map's centre is at the camera, its left half at image right, and its edges meet behind the subject.
"""

import functools
import heapq
import itertools
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import OpenImageIO as oiio
import torch
import torch.nn.functional as F
from numpy.typing import ArrayLike

from relight.lights import plate
from relight.lights.light import Light, checked_number, parse_settings
from relight.media import images
from relight.media.buffers import to_array, to_buffer
from relight.media.identity import identity
from shadow.directions import from_spherical
from shadow.files import AnyPath

LAMPS = 256  # directions at most: irradiance within 0.5 % (RMS) of that of all the map's pixels
ROWS = 256  # of the grid that is divided among the lamps; finer maps are summed to it
FEWEST_ROWS = 64  # coarser maps are repeated to it, so that a lamp is never a big pixel's centre
FIELD_OF_VIEW = 40.0  # degrees, vertical: a person head to foot from three metres
SMOOTH = 4  # samples a map pixel that a cubic-like filter makes; between those, linear will do
MARGIN = 3  # pixels around a view, for the filter
Edge = int | np.ndarray
Region = tuple[int, int, int, int]  # top, bottom, left, right of cells
NEGATIVE = 0.01  # share of the mean below zero that filters and conversions may leave


@dataclass(frozen=True, init=False)
class EnvironmentLight(Light):
    """Light from all around, as UsdLux's DomeLight: rims from behind included.

    Parameters
    ----------
    image: the map, latitude-longitude in OpenEXR's convention: a file, or an array (H, 2 H, 3|4), integers
        sRGB, floats linear Rec.709. Its centre is at the camera, its left half at image right, and its left
        and right edges meet behind the subject. An alpha channel is ignored.
    rotation: degrees about the vertical; turns the world as azimuth does, from the camera toward image right.
    intensity, colour, exposure, temperature, locus, name: as of `relight.DirectionalLight`. At intensity 1, a
        surface that faces a sky of radiance 1 all around has the value of its albedo.

    Values are radiance and never clipped; single channels may be negative, as colours outside Rec.709 are.

    Raises
    ------
    FileNotFoundError: no such file. TypeError, ValueError: not an image, not twice as wide as high, NaN,
    infinite or negative light, parameters that are out of range.
    """

    image: "Panorama"
    rotation: float

    def __init__(
        self,
        image: "AnyPath | ArrayLike | Panorama",
        *,
        rotation: float = 0.0,
        intensity: float = 1.0,
        colour: Iterable[float] = (1.0, 1.0, 1.0),
        exposure: float = 0.0,
        temperature: float | None = None,
        locus: str = "planckian",
        name: str | None = None,
    ) -> None:
        self._set(
            image=image if isinstance(image, Panorama) else Panorama.of(image),
            rotation=checked_number("rotation", rotation),
            intensity=intensity,
            colour=colour,
            exposure=exposure,
            temperature=temperature,
            locus=locus,
            name=name,
        )

    @classmethod
    def parse(cls, text: str) -> Self:
        """A light from text: `studio.exr,rotation=90,intensity=2`; its name is "environment" unless given."""
        path, *settings = text.split(",")
        while settings and "=" not in settings[0]:  # a comma in the file's name
            path += f",{settings.pop(0)}"
        try:
            return cls(path, **{"name": "environment"} | parse_settings(cls, settings))
        except (TypeError, ValueError) as error:
            raise ValueError(f"environment {text!r}: {error}") from error

    @classmethod
    def from_plate(
        cls,
        background: AnyPath | ArrayLike,
        field_of_view: float = FIELD_OF_VIEW,
        *,
        highlights: float = plate.HIGHLIGHTS,
        **settings: Any,
    ) -> Self:
        """The light of the place that a background shows: in it, a person looks as if they stood there.

        Parameters
        ----------
        background: a file, or an opaque image (H, W, 3|4), integers sRGB, floats linear Rec.709.
        field_of_view: vertical, of the camera that took it, in degrees, above 0 and up to 170.
        highlights: how many times as bright as white that is which the camera clipped, at least 1: a lamp or
            the sun. Of a background with values above 1, nothing is taken to be clipped.
        settings: intensity, colour, exposure, name... as of the light itself; a rotation turns the place.

        What the background shows is behind the person, and `view(size, field_of_view)` shows it again. The
        light from elsewhere is a guess (see `relight.lights.plate`): the front is like the back, left is like
        left and up like up, and so much light comes from above that a grey card (18 %) that lies on the
        ground, the lower half of the picture, is as bright as the ground.

        Raises
        ------
        FileNotFoundError: no such file. TypeError, ValueError: not an image, transparent pixels, NaN,
        infinite or negative light, parameters that are out of range.
        """
        field_of_view = checked_number("field_of_view", field_of_view, 1e-3, 170)
        highlights = checked_number("highlights", highlights, 1)
        if isinstance(background, str | os.PathLike):
            background = images.read(background)
        pixels = plate.opaque(background)
        return cls(plate.surroundings(pixels, field_of_view, highlights), **settings)

    def settings(self) -> dict[str, Any]:
        """{parameter: value} of the constructor, as far as they are not its defaults.

        ValueError if the map is an array: it has no file to name.
        """
        if self.image.path is None:
            raise ValueError(
                "image: the environment is an array; write it to a file and make the light of that"
            )
        return {"image": str(self.image.path)} | super().settings()

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """What the light comes down to: unit directions (K, 3) and linear RGB intensities (K, 3), float32.

        K is at most 256, over the whole sphere, most where the light is. A direction's intensity is the
        radiance integrated over its region, over π: what a directional light needs for the same irradiance.
        """
        directions, intensities = self.image.lamps
        turn = self.rotation % 360
        axes = from_spherical([turn + 90, 0, turn], [0, 90, 0])  # where x, y and z of the map point
        return directions @ axes, (intensities * self.power).astype(np.float32)

    def view(self, size: tuple[int, ...], field_of_view: float = FIELD_OF_VIEW) -> np.ndarray:
        """What a level camera sees of it behind the person: (H, W, 3) float32, linear Rec.709, unbounded.

        Parameters
        ----------
        size: (H, W) in pixels.
        field_of_view: the camera's vertical one in degrees, above 0 and up to 170.

        The camera looks along -z, from where the light comes that is behind the person: for a map turned by
        `rotation` of 0, its left and right edges meet in the middle of the view. The light's intensity and
        colour apply. Raises ValueError for an empty size or a field of view out of range.
        """
        height, width = size
        field_of_view = checked_number("field_of_view", field_of_view, 1e-3, 170)
        if min(height, width) < 1:
            raise ValueError(f"size: expected (height, width) of at least 1, got {size}")
        half = np.tan(np.radians(field_of_view / 2))
        y = (half - (np.arange(height) + 0.5) * 2 * half / height).astype(np.float32)[:, None]
        x = np.float32((np.arange(width) + 0.5) * 2 * half / height - half * width / height)
        turn = np.degrees(np.arctan(x)) + self.rotation % 360  # rightward from the seam, along the map
        elevation = np.degrees(np.arctan2(y, np.hypot(x, 1)))
        seen = self.image.at(turn, elevation, 2 * np.degrees(half) / height)
        return seen * self.power.astype(np.float32)


class Panorama:
    """A latitude-longitude map: `pixels` (H, 2 H, 3) float32, linear Rec.709, and the `path` it is from."""

    def __init__(self, pixels: np.ndarray, path: Path | None = None) -> None:
        name = "image" if path is None else path
        height, width = pixels.shape[:2]
        if width != 2 * height:
            raise ValueError(f"{name}: expected a map twice as wide as high, got {width} x {height} pixels")
        grey = pixels[..., :3].mean(axis=-1)
        if grey.min() < -NEGATIVE * abs(grey.mean()):
            row, column = np.unravel_index(grey.argmin(), grey.shape)
            raise ValueError(f"{name}: holds negative light, {grey.min():g} in row {row}, column {column}")
        self.pixels, self.path = pixels[..., :3], path

    @classmethod
    def of(cls, image: AnyPath | ArrayLike) -> "Panorama":
        """A map from a file, of which the last few are kept in memory, or from an array."""
        if not isinstance(image, str | os.PathLike):
            return cls(images.scene_linear("image", image))
        path = Path(image)
        if not path.exists():
            raise FileNotFoundError(f"{path}: no such file")
        file = path.stat()
        return _read(path, (file.st_dev, file.st_ino, file.st_size, file.st_mtime_ns))

    @functools.cached_property
    def identity(self) -> str:
        """Differs where the pixels do."""
        return identity(self.pixels)

    def __repr__(self) -> str:
        return f"Panorama({str(self.path) if self.path else self.pixels.shape})"

    def at(self, column: np.ndarray, elevation: np.ndarray, spacing: float) -> np.ndarray:
        """Radiance (H, W, 3) at map positions: degrees (W,) from the left edge, and degrees up (H, W).

        `spacing` in degrees is about that of the samples: a finer map is averaged to it first, so that no
        pixel flickers, and a coarser one is smoothed, so that none shows.
        """
        degrees = 180 / len(self.pixels)
        zoom = min(degrees / spacing, SMOOTH)
        margin = int(np.ceil(MARGIN * max(1, 1 / zoom)))
        left, right = (int(np.floor(edge / degrees)) for edge in (column.min(), column.max()))
        top, bottom = (int(np.floor((90 - edge) / degrees)) for edge in (elevation.max(), elevation.min()))
        columns = np.arange(left - margin, right + margin + 1) % self.pixels.shape[1]
        rows = np.arange(top - margin, bottom + margin + 1).clip(0, len(self.pixels) - 1)
        height, width = (max(1, round(count * zoom)) for count in (len(rows), len(columns)))
        region = oiio.ROI(0, width, 0, height, 0, 1, 0, 3)
        part = to_buffer(self.pixels[rows][:, columns])
        fine = to_array(oiio.ImageBufAlgo.resize(part, "blackman-harris", roi=region))
        x = (column / degrees - (left - margin)) / len(columns) * 2 - 1
        y = ((90 - elevation) / degrees - (top - margin)) / len(rows) * 2 - 1
        grid = np.stack([np.broadcast_to(x, y.shape), y], axis=-1)
        source = torch.from_numpy(fine.reshape(height, width, 3)).permute(2, 0, 1)
        seen = F.grid_sample(source[None], torch.from_numpy(np.float32(grid))[None], align_corners=False)
        return seen[0].permute(1, 2, 0).numpy()

    @functools.cached_property
    def _sums(self) -> np.ndarray:
        """The light sums (K, 7) of what each lamp stands for; see `_divide`."""
        return _divide(_cells(self.pixels))

    @functools.cached_property
    def spreads(self) -> np.ndarray:
        """The angular radius (K,) in radians of an even disc that spreads as what a lamp stands for does."""
        energy, vector = self._sums[:, 3], np.linalg.norm(self._sums[:, 4:], axis=1)
        # Directions over a disc of radius a have a mean of length (1 + cos a) / 2.
        length = np.divide(vector, energy, out=np.ones_like(energy), where=energy > 0)
        return np.arccos((2 * length - 1).clip(-1, 1)).astype(np.float32)

    @functools.cached_property
    def lamps(self) -> tuple[np.ndarray, np.ndarray]:
        """Directions (K, 3) and intensities (K, 3), float32, that light as the map does."""
        lamps = self._sums
        length = np.linalg.norm(lamps[:, 4:], axis=1, keepdims=True)
        front = np.tile([0.0, 0.0, 1.0], (len(lamps), 1))  # where nothing shines, any direction will do
        directions = np.divide(lamps[:, 4:], length, out=front, where=length > 0)
        return directions.astype(np.float32), (lamps[:, :3] / np.pi).astype(np.float32)


@functools.lru_cache(maxsize=2)
def _read(path: Path, state: tuple[int, ...]) -> Panorama:
    """A file's map; `state` is there to tell a file that has changed."""
    return Panorama(images.read(path), path)


def _cells(pixels: np.ndarray) -> np.ndarray:
    """Light sums (h, w, 7), float64, of a grid of at most 256 x 512 cells over a map.

    Of each cell: radiance times solid angle in red, green and blue; their mean e, not below zero, as its
    weight; and e times the direction (x, y, z), both summed over the map's own pixels.
    """
    repeat = -(-FEWEST_ROWS // len(pixels))
    height, width = repeat * pixels.shape[0], repeat * pixels.shape[1]
    latitude = np.pi / 2 - np.arange(height + 1) * np.pi / height
    longitude = np.pi - (np.arange(width) + 0.5) * 2 * np.pi / width
    around = np.stack([np.sin(longitude), np.ones(width), np.cos(longitude)], axis=-1)
    solid_angles = (np.sin(latitude[:-1]) - np.sin(latitude[1:])) * 2 * np.pi / width

    rows = np.unique(np.linspace(0, height, ROWS + 1).astype(int))
    columns = np.unique(np.linspace(0, width, 2 * ROWS + 1).astype(int))[:-1]
    cells = np.empty((len(rows) - 1, len(columns), 7))
    for index, (top, bottom) in enumerate(itertools.pairwise(rows)):
        middle = (latitude[top:bottom] + latitude[top + 1 : bottom + 1])[:, None, None] / 2
        colour = pixels[np.arange(top, bottom) // repeat].repeat(repeat, axis=1).astype(np.float64)
        colour *= solid_angles[top:bottom, None, None]
        weight = colour.mean(axis=-1, keepdims=True).clip(0)
        towards = around * np.concatenate([np.cos(middle), np.sin(middle), np.cos(middle)], axis=-1)
        sums = np.concatenate([colour, weight, weight * towards], axis=-1).sum(axis=0)
        cells[index] = np.add.reduceat(sums, columns)
    return cells


def _divide(cells: np.ndarray) -> np.ndarray:
    """The light sums (K, 7) of K <= 256 rectangles that divide a grid of light sums (h, w, 7).

    Variance minimisation light probe sampling (Viriyothai and Debevec 2009, after the median cut of Debevec
    2005): the region that one lamp stands for worst is cut in two, where and across whichever side helps
    most. Lamp and region differ by the vector irradiance that a region loses by being spread out,
    Σe - |Σe d|: so a small bright sun is one lamp, and a wide bright sky many.
    """
    table = np.pad(cells.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0), (0, 0)))

    def total(top: Edge, bottom: Edge, left: Edge, right: Edge) -> np.ndarray:
        return table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]

    def loss(*region: Edge) -> np.ndarray:
        sums = total(*region)
        return sums[..., 3] - np.linalg.norm(sums[..., 4:], axis=-1)

    def cut(top: int, bottom: int, left: int, right: int) -> tuple[Region, Region]:
        """The two parts whose losses add up to the least."""
        rows, columns = np.arange(top + 1, bottom), np.arange(left + 1, right)
        across = loss(top, rows, left, right) + loss(rows, bottom, left, right)
        down = loss(top, bottom, left, columns) + loss(top, bottom, columns, right)
        if across.min(initial=np.inf) <= down.min(initial=np.inf):
            row = rows[across.argmin()]
            return (top, row, left, right), (row, bottom, left, right)
        column = columns[down.argmin()]
        return (top, bottom, left, column), (top, bottom, column, right)

    def entry(region: Region) -> tuple[float, Region]:
        top, bottom, left, right = region
        single = bottom - top == 1 and right - left == 1
        return 0.0 if single else -float(loss(*region)), region  # heapq has the smallest first

    regions = [entry((0, cells.shape[0], 0, cells.shape[1]))]
    while len(regions) < LAMPS and regions[0][0] < -1e-9 * table[-1, -1, 3]:
        first, second = map(entry, cut(*regions[0][1]))
        heapq.heapreplace(regions, first)
        heapq.heappush(regions, second)
    return np.array([total(*region) for _, region in regions])
