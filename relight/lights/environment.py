"""Light from all around: a latitude-longitude map, and the few directional lamps that replace it.

The map follows OpenEXR's convention (ImfEnvmap.h): pixel (0, 0) has latitude +90 and longitude +180 degrees,
and longitude falls along a row. In the camera frame latitude is elevation and longitude azimuth, so the
map's centre is at the camera, its left half at image right, and its edges meet behind the subject.
"""

import functools
import heapq
import itertools
from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from relight import quantities
from relight.arguments import Converted, checked, checked_number, read_settings, required
from relight.lights import plate
from relight.lights.light import DistantLight, Settings
from relight.media import cubemap, images, photo_sphere
from relight.media.content_hash import content_hash
from relight.media.option_texts import split_file_and_settings
from relight.media.regular_file import check_regular_file
from relight.media.resampling import resize, sample
from shadow.directions import from_spherical
from shadow.files import AnyPath, file_version, is_path

MAX_LAMPS = 256  # irradiance within 0.5 % (RMS) of that of all the map's pixels
GRID_ROWS = 256  # of the grid that is divided among the lamps; finer maps are summed to it
MIN_ROWS = 64  # coarser maps are repeated to it, so that a lamp is never the centre of a big pixel
FIELD_OF_VIEW = 40.0  # degrees, vertical: a person head to foot from three metres
MAX_ZOOM = 4  # samples of a map pixel by the smooth filter; between those, linear is enough
FILTER_MARGIN = 3  # pixels around a view
Edge = int | np.ndarray
Region = tuple[int, int, int, int]  # top, bottom, left, right of cells
MAX_NEGATIVE_SHARE = 0.01  # of the mean, below zero, which filters and conversions may leave


@dataclass(frozen=True)
class EnvironmentLight(DistantLight):
    """Light from all directions, like UsdLux's DomeLight.

    Values are radiance and never clipped. Single channels may be negative, for colours outside Rec.709.

    Parameters
    ----------
    image
        The map, latitude-longitude in OpenEXR's convention: a file, or an array (H, 2 H, 3|4), integers sRGB,
        floats linear Rec.709. Its centre is at the camera, its left half at image right, and its left and
        right edges meet behind the subject. An alpha channel is ignored. Six faces of
        a cube, in a strip or a cross, are resampled to such a map, see `relight.media.cubemap`.
    colour_space
        Of the file, where it does not state it, or states what is wrong; see `relight.read`.
    rotation
        Degrees about the vertical axis, in the sense of azimuth: from the camera toward image right.
    intensity, colour, exposure, temperature, locus, tint, source, gel, name
        See `relight.DirectionalLight`. At intensity 1, a surface that faces a sky of radiance 1 all around
        has the value of its albedo.

    Raises
    ------
    FileNotFoundError
        No such file.
    TypeError, ValueError
        Not an image, not twice as wide as high, NaN, infinite or negative light, parameters out of range.

    Examples
    --------
    >>> import numpy as np, relight
    >>> sky = relight.EnvironmentLight(np.ones((8, 16, 3), np.float32), rotation=90, name="sky")
    >>> directions, intensities = sky.samples()
    >>> intensities.sum(axis=0).round(2).tolist()  # a sphere of radiance 1 has 4 π steradians, over π
    [4.0, 4.0, 4.0]
    """

    image: "MapSource" = required()
    _: KW_ONLY
    rotation: quantities.Rotation = 0.0
    colour_space: quantities.ColourSpace = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.image, Panorama):
            object.__setattr__(self, "image", Panorama.of(self.image, self.colour_space))

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a light from text: `studio.exr,rotation=90,intensity=2`; named "environment" by default.

        A name with commas and equals signs may stand in double quotes.
        """
        try:
            path, settings = split_file_and_settings(text)
            return cls(path, **{"name": "environment"} | read_settings(settings, cls.parameters()))
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
        """Estimate the light of the place that a background shows, so that a person fits into it.

        The visible part of the place is behind the person, and `view(size, field_of_view)` shows it again.
        The rest is a guess (see `relight.lights.plate`): the picture is continued to all sides, and the front
        is like the back. Light is added from above until a grey card (18 %) on the ground is as bright as the
        ground, which is the lower half of the picture.

        Parameters
        ----------
        background
            A file, or an opaque image (H, W, 3|4), integers sRGB, floats linear Rec.709.
        field_of_view
            Vertical field of view of the background's camera in degrees, in [0.001, 170].
        highlights
            Brightness of clipped pixels, such as a lamp or the sun, in units of white, at least 1. It has no
            effect on a background with values above 1.
        settings
            Parameters of the light: intensity, colour, exposure, name...; a rotation turns the place.

        Raises
        ------
        FileNotFoundError
            No such file.
        TypeError, ValueError
            Not an image, transparent pixels, NaN, infinite or negative light, parameters out of range.
        """
        field_of_view = checked("field_of_view", field_of_view, quantities.FieldOfView)
        highlights = checked_number("highlights", highlights, 1)
        if is_path(background):
            background = images.read(background)
        pixels = plate.opaque(background)
        return cls(plate.surroundings(pixels, field_of_view, highlights), **settings)

    def settings(self) -> Settings:
        """Return {parameter: value} of the constructor, without those that have their defaults.

        Raises ValueError if the map is an array, which has no file.
        """
        if self.image.path is None:
            raise ValueError(
                "image: the environment is an array; write it to a file and make the light of that"
            )
        return super().settings() | {"image": str(self.image.path)}

    def unit_samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Return unit directions (K, 3), float32, and linear RGB intensities (K, 3) for a power of 1.

        K is at most 256, over the whole sphere, densest where the light is strong. The intensity of a
        direction is the radiance integrated over its region, divided by π: that of a directional light of the
        same irradiance.
        """
        directions, intensities = self.image.lamps
        turn = self.rotation % 360
        axes = from_spherical([turn + 90, 0, turn], [0, 90, 0])  # where x, y and z of the map point
        return directions @ axes, intensities

    def sample_radii(self, count: int) -> np.ndarray:
        return self.image.lamp_radii

    def view(self, size: tuple[int, ...], field_of_view: float = FIELD_OF_VIEW) -> np.ndarray:
        """Render the map as a level camera sees it behind the person.

        The camera looks along -z. With a `rotation` of 0, the left and right edges of the map meet in the
        middle of the view. The light's intensity and colour apply.

        Parameters
        ----------
        size
            (H, W) in pixels.
        field_of_view
            Vertical field of view of the camera in degrees, in [0.001, 170].

        Returns
        -------
        np.ndarray
            (H, W, 3) float32, linear Rec.709, unbounded.

        Raises
        ------
        ValueError
            An empty size, or a field of view out of range.
        """
        height, width = size
        field_of_view = checked("field_of_view", field_of_view, quantities.FieldOfView)
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
    """A latitude-longitude map: `pixels` (H, 2 H, 3) float32, linear Rec.709, and the `path` it is from.

    `cube` tells whether the file holds the faces of a cube.
    """

    def __init__(self, pixels: np.ndarray, path: Path | None = None, cube: bool = False) -> None:
        name = "image" if path is None else path
        height, width = pixels.shape[:2]
        if width != 2 * height:
            raise ValueError(
                f"{name}: expected a map twice as wide as high, got {width} x {height} pixels; or six faces "
                "of a cube, in a strip or a cross"
            )
        grey = pixels[..., :3].mean(axis=-1)
        if grey.min() < -MAX_NEGATIVE_SHARE * abs(grey.mean()):
            row, column = np.unravel_index(grey.argmin(), grey.shape)
            raise ValueError(f"{name}: holds negative light, {grey.min():g} in row {row}, column {column}")
        self.pixels, self.path, self.cube = pixels[..., :3], path, cube

    @classmethod
    def of(cls, image: AnyPath | ArrayLike, colour_space: str | None = None) -> "Panorama":
        """Make a map of an array, or of a file; the last two files' maps are kept in memory."""
        if not is_path(image):
            if colour_space is not None:
                raise ValueError("colour_space: is that of a file; got an array, which is linear Rec.709")
            pixels = images.scene_linear("image", image)
            return cls(cubemap.to_latlong(pixels) if cubemap.is_cube(pixels) else pixels)
        path, _ = images.split_layer(image)  # sky.exr:beauty
        return _read(Path(image), file_version(check_regular_file(path)), colour_space)

    @functools.cached_property
    def content_hash(self) -> str:
        """A hash of the pixels."""
        return content_hash(self.pixels)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Panorama):
            return NotImplemented
        same = (self.path, self.cube) == (other.path, other.cube)
        return self is other or (same and np.array_equal(self.pixels, other.pixels))

    def __hash__(self) -> int:
        return hash((self.path, self.cube, self.pixels.shape))

    def __repr__(self) -> str:
        return f"Panorama({str(self.path) if self.path else self.pixels.shape})"

    def at(self, column: np.ndarray, elevation: np.ndarray, spacing: float) -> np.ndarray:
        """Return radiance (H, W, 3) at map positions: degrees (W,) from the left edge, and degrees up (H, W).

        `spacing` is about that of the samples, in degrees. A finer map is averaged to it first, so that no
        pixel flickers; a coarser one is smoothed, so that no pixel shows.
        """
        degrees = 180 / len(self.pixels)
        zoom = min(degrees / spacing, MAX_ZOOM)
        margin = int(np.ceil(FILTER_MARGIN * max(1, 1 / zoom)))
        left, right = (int(np.floor(edge / degrees)) for edge in (column.min(), column.max()))
        top, bottom = (int(np.floor((90 - edge) / degrees)) for edge in (elevation.max(), elevation.min()))
        columns = np.arange(left - margin, right + margin + 1) % self.pixels.shape[1]
        rows = np.arange(top - margin, bottom + margin + 1).clip(0, len(self.pixels) - 1)
        height, width = (max(1, round(count * zoom)) for count in (len(rows), len(columns)))
        fine = resize(self.pixels[rows][:, columns], (height, width))
        x = (column / degrees - (left - margin)) / len(columns) * 2 - 1
        y = ((90 - elevation) / degrees - (top - margin)) / len(rows) * 2 - 1
        return sample(fine, x, y)

    @functools.cached_property
    def _sums(self) -> np.ndarray:
        """The light sums (K, 7) of each lamp's region, see `_divide`."""
        return _divide(_cells(self.pixels))

    @functools.cached_property
    def lamp_radii(self) -> np.ndarray:
        """The angular radius (K,), radians, of an even disc that is as wide as each lamp's region."""
        energy, vector = self._sums[:, 3], np.linalg.norm(self._sums[:, 4:], axis=1)
        # Directions over a disc of radius a have a mean of length (1 + cos a) / 2.
        length = np.divide(vector, energy, out=np.ones_like(energy), where=energy > 0)
        return np.arccos((2 * length - 1).clip(-1, 1)).astype(np.float32)

    @functools.cached_property
    def lamps(self) -> tuple[np.ndarray, np.ndarray]:
        """Directions (K, 3) and intensities (K, 3), float32, of lamps that light as the map does."""
        lamps = self._sums
        length = np.linalg.norm(lamps[:, 4:], axis=1, keepdims=True)
        front = np.tile([0.0, 0.0, 1.0], (len(lamps), 1))  # for regions without light
        directions = np.divide(lamps[:, 4:], length, out=front, where=length > 0)
        return directions.astype(np.float32), (lamps[:, :3] / np.pi).astype(np.float32)


if TYPE_CHECKING:
    MapSource = Converted["AnyPath | ArrayLike | Panorama", "Panorama"]
else:
    MapSource = object


@functools.lru_cache(maxsize=2)
def _read(path: Path, state: tuple[int, ...], colour_space: str | None) -> Panorama:
    """Read a file's map; `state` identifies this version of the file for the cache."""
    pixels = images.read(path, colour_space=colour_space)
    file, _ = images.split_layer(path)
    pixels = photo_sphere.whole_sphere(file, pixels)
    cube = cubemap.is_cube(pixels)
    if cube:
        pixels = cubemap.to_latlong(pixels, openexr=file.suffix.lower() == ".exr")
    return Panorama(pixels, path, cube)


def _cells(pixels: np.ndarray) -> np.ndarray:
    """Return light sums (h, w, 7), float64, of a grid of at most 256 x 512 cells over a map.

    For each cell: radiance times solid angle in red, green and blue; their mean e, at least zero, as its
    weight; and e times the direction (x, y, z); all summed over the map's own pixels.
    """
    repeat = -(-MIN_ROWS // len(pixels))
    height, width = repeat * pixels.shape[0], repeat * pixels.shape[1]
    latitude = np.pi / 2 - np.arange(height + 1) * np.pi / height
    longitude = np.pi - (np.arange(width) + 0.5) * 2 * np.pi / width
    around = np.stack([np.sin(longitude), np.ones(width), np.cos(longitude)], axis=-1)
    solid_angles = (np.sin(latitude[:-1]) - np.sin(latitude[1:])) * 2 * np.pi / width

    rows = np.unique(np.linspace(0, height, GRID_ROWS + 1).astype(int))
    columns = np.unique(np.linspace(0, width, 2 * GRID_ROWS + 1).astype(int))[:-1]
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


def environments(lights: Iterable[object]) -> list[EnvironmentLight]:
    """Return the environments among lights."""
    return [light for light in lights if isinstance(light, EnvironmentLight)]


def _divide(cells: np.ndarray) -> np.ndarray:
    """Divide a grid of light sums (h, w, 7) into K <= 256 rectangles, and return their light sums (K, 7).

    This is variance minimisation light probe sampling (Viriyothai and Debevec 2009, after the median cut of
    Debevec 2005). The region that a single lamp represents worst is cut in two, at the place and across the
    side that help most. The error of a lamp is the vector irradiance that its region loses by its extent,
    Σe - |Σe d|. So a small bright sun is one lamp, and a wide bright sky many.
    """
    table = np.pad(cells.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0), (0, 0)))

    def total(top: Edge, bottom: Edge, left: Edge, right: Edge) -> np.ndarray:
        return table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]

    def loss(*region: Edge) -> np.ndarray:
        sums = total(*region)
        return sums[..., 3] - np.linalg.norm(sums[..., 4:], axis=-1)

    def cut(top: int, bottom: int, left: int, right: int) -> tuple[Region, Region]:
        """Return the two parts with the least sum of losses."""
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
    while len(regions) < MAX_LAMPS and regions[0][0] < -1e-9 * table[-1, -1, 3]:
        first, second = map(entry, cut(*regions[0][1]))
        heapq.heapreplace(regions, first)
        heapq.heappush(regions, second)
    return np.array([total(*region) for _, region in regions])
