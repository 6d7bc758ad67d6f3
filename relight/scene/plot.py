"""A lighting plot: the person, the camera and the lights from above and from the side, as a gaffer reads it.

The plan looks down: image right is at the right, the camera below the person. The elevation looks from the
person's left: the camera is at the right. Lamps stand where they are, to scale. Lights that are so far away
that their rays are parallel have no distance; they stand on a circle, and arrows show where they shine.
"""

import math
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as xml

import numpy as np

from relight import quantities
from relight.analysis.camera import DEFAULT_HEIGHT, Camera
from relight.arguments import checks_arguments
from relight.lights.directional import DirectionalLight
from relight.lights.environment import FIELD_OF_VIEW, EnvironmentLight
from relight.lights.light import Light
from relight.lights.near import NearLight, RectLight
from relight.lights.rig import Lights, as_lights, by_name
from relight.media.colour import encode, luminance
from shadow.files import check_writable, replacing

SUFFIXES = (".svg",)
PANEL = 480  # pixels of a view's side
MARGIN = 36
ROW = 24  # pixels of a line of the table
COLUMNS = (
    ("", 0), ("light", 26), ("kind", 150), ("place", 250), ("distance", 440), ("size", 512), ("colour", 694),
    ("intensity", 822), ("against the key", 892),
)  # fmt: skip
WIDTH = 2 * PANEL + 3 * MARGIN
SHARE_OF_RING = 0.72  # of a view's half side, of the circle of lights without a distance
LEAST_EXTENT = 1.6  # metres that a view shows around the person at least
INK, FAINT, PAPER = "#222222", "#c8c8c8", "#ffffff"
DARKEST = 1e-9  # luminance that counts as none


class _Row(NamedTuple):
    """A light as the plot has it."""

    number: int
    name: str
    light: Light
    place: np.ndarray | None  # metres from the subject's middle; None for light from all around
    toward: np.ndarray  # where it shines
    near: bool
    brightness: float  # irradiance of a surface at the person's middle that faces the light


@checks_arguments
def write_plot(
    path: quantities.File,
    lights: Lights,
    *,
    distance: quantities.Side | None = None,
    height: quantities.Height = DEFAULT_HEIGHT,
    field_of_view: quantities.FieldOfView = FIELD_OF_VIEW,
    title: str = "Lighting plot",
) -> Path:
    """Draw a lighting plot: person, camera and lights from above and from the side, and a table of lights.

    The table has angles, distances, sizes, colours and intensities. Brightness is that of a surface at the
    person's middle that faces the light, in stops against the key: the light called "key", or the brightest.

    Parameters
    ----------
    path
        The file, .svg; any browser shows and prints it.
    lights
        A light, or any number of them, or the name of a preset.
    distance
        Metres from the camera to the person's middle; by default that at which the person fills the frame.
    height, field_of_view
        See `relight.Subject`.
    title
        Stands above the plot.

    Returns
    -------
    Path
        The path written.

    Raises
    ------
    TypeError, ValueError
        Not lights, lights that follow a part of the person, or another suffix.
    OSError
        The file cannot be written.

    Examples
    --------
    >>> import relight
    >>> lights = [relight.DirectionalLight(azimuth=-40, elevation=30, name="key")]
    >>> relight.write_plot("plot.svg", lights).name
    'plot.svg'
    """
    path = check_writable(path, SUFFIXES)
    if distance is None:
        distance = height / 2 / math.tan(math.radians(field_of_view) / 2)
    return _draw(path, _Plot(as_lights(lights), distance, height, field_of_view, title))


def plot_of(path: Path, lights: list[Light], camera: Camera, title: str) -> Path:
    """Draw the plot of lights, all of them checked, around the person whom a plate's camera sees."""
    top = 2 * (camera.bottom - camera.middle[1])  # pixels, for the middle is that of the matte
    height = max(0.01, top * camera.distance / camera.focal)
    return _draw(path, _Plot(lights, camera.distance, height, camera.field_of_view, title))


def _draw(path: Path, plot: "_Plot") -> Path:
    with replacing(path) as beside:
        beside.write_bytes(plot.document())
    return path


def _rows(lights: list[Light]) -> list[_Row]:
    rows = []
    for number, (name, light) in enumerate(by_name(lights).items(), 1):
        place, toward, near = None, np.zeros(3), False
        power = float(luminance(light.power))
        if isinstance(light, DirectionalLight):
            place = np.array(light.direction)
        elif isinstance(light, NearLight):
            light.check_placed()
            place, near = np.array(light.position), True
            toward = place + light.axis if light.cone_axis is not None else toward
            power *= light.middle_irradiance
        elif isinstance(light, EnvironmentLight):
            power = float(luminance(light.samples()[1].sum(axis=0, dtype=float)) / 4)
        rows.append(_Row(number, name, light, place, toward, near, power))
    return rows


class _Plot:
    """The drawing."""

    def __init__(
        self, lights: list[Light], distance: float, height: float, field_of_view: float, title: str
    ) -> None:
        self.rows = rows = _rows(lights)
        self.distance, self.height, self.angle, self.title = distance, height, field_of_view, title
        far = [float(np.abs(row.place).max()) for row in rows if row.near and row.place is not None]
        self.extent = 1.12 * max(LEAST_EXTENT, distance, height / 2, *far)
        named = [row for row in rows if row.name == "key"]
        self.key = max(named or rows, key=lambda row: row.brightness) if rows else None

    def document(self) -> bytes:
        """Return the file."""
        high = MARGIN * 3 + PANEL + ROW * (len(self.rows) + 3)
        root = xml.Element(
            "svg", xmlns="http://www.w3.org/2000/svg", viewBox=f"0 0 {WIDTH} {high}", width=f"{WIDTH}",
            height=f"{high}", style="font-family: system-ui, sans-serif; font-size: 12px",
        )  # fmt: skip
        _add(root, "rect", width=WIDTH, height=high, fill=PAPER)
        _text(root, MARGIN, 28, self.title, size=18)
        for left, name, axes in (
            (MARGIN, "From above", (0, 2)),
            (2 * MARGIN + PANEL, "From the side", (2, 1)),
        ):
            self._view(xml.SubElement(root, "g", transform=f"translate({left} {MARGIN + 20})"), name, axes)
        self._table(xml.SubElement(root, "g", transform=f"translate({MARGIN} {2 * MARGIN + PANEL + 30})"))
        return xml.tostring(root, encoding="utf-8", xml_declaration=True)

    def _at(self, place: np.ndarray, axes: tuple[int, int]) -> tuple[float, float]:
        """Return the pixels of a place in a view of two of its axes."""
        scale = PANEL / 2 / self.extent
        down = place[axes[1]] * (1 if axes[1] == 2 else -1)  # the camera is below in the plan, up is up
        return PANEL / 2 + place[axes[0]] * scale, PANEL / 2 + down * scale

    def _view(self, group: xml.Element, name: str, axes: tuple[int, int]) -> None:
        _add(group, "rect", width=PANEL, height=PANEL, fill="none", stroke=FAINT)
        step = 1 if self.extent < 8 else 2 ** math.ceil(math.log2(self.extent / 8))
        for metres in range(-int(self.extent // step) * step, int(self.extent) + 1, step):
            across = PANEL / 2 * (1 + metres / self.extent)
            _line(group, across, 0, across, PANEL, stroke="#eeeeee")
            _line(group, 0, across, PANEL, across, stroke="#eeeeee")
        _text(group, 8, 18, name, size=13)
        unit = PANEL / 2 / self.extent * step
        _line(group, 8, PANEL - 10, 8 + unit, PANEL - 10, stroke=INK)
        _text(group, 12 + unit, PANEL - 6, f"{step} m")
        if axes[1] == 1:
            floor = self._at(np.array([0, -self.height / 2, 0]), axes)[1]
            _line(group, 0, floor, PANEL, floor, stroke=FAINT)
        self._camera(group, axes)
        self._person(group, axes)
        if any(row.place is not None and not row.near for row in self.rows):
            ring = SHARE_OF_RING * PANEL / 2
            _add(group, "circle", cx=PANEL / 2, cy=PANEL / 2, r=ring, fill="none", stroke=FAINT,
                 **{"stroke-dasharray": "3 5"})  # fmt: skip
        labels: list[tuple[float, float]] = []
        for row in self.rows:
            if row.place is not None:
                self._light(group, row, axes, labels)

    def _person(self, group: xml.Element, axes: tuple[int, int]) -> None:
        scale, (x, y) = PANEL / 2 / self.extent, (PANEL / 2, PANEL / 2)
        tall = self.height * scale
        if axes[1] == 2:  # from above: shoulders, and a head with a nose toward the camera
            wide = 0.13 * tall
            _add(group, "ellipse", cx=x, cy=y, rx=wide, ry=wide / 2, fill="#dddddd", stroke=INK)
            _add(group, "circle", cx=x, cy=y, r=0.06 * tall, fill=PAPER, stroke=INK)
            _line(group, x, y + 0.06 * tall, x, y + 0.09 * tall, stroke=INK)
            return
        _add(group, "rect", x=x - 0.06 * tall, y=y - 0.35 * tall, width=0.12 * tall, height=0.85 * tall,
             rx=0.05 * tall, fill="#dddddd", stroke=INK)  # fmt: skip
        _add(group, "circle", cx=x, cy=y - 0.43 * tall, r=0.065 * tall, fill=PAPER, stroke=INK)
        _line(group, x + 0.065 * tall, y - 0.43 * tall, x + 0.085 * tall, y - 0.42 * tall, stroke=INK)

    def _camera(self, group: xml.Element, axes: tuple[int, int]) -> None:
        x, y = self._at(np.array([0.0, 0.0, self.distance]), axes)
        half = math.tan(math.radians(self.angle / 2)) * self.distance
        for side in (-half, half):
            edge = np.array([side, side, 0.0]) if axes[1] == 1 else np.array([side, 0.0, 0.0])
            end = self._at(edge * (1, 1, 0), axes)
            _line(group, x, y, *end, stroke=FAINT)
        _add(group, "rect", x=x - 9, y=y - 6, width=18, height=12, fill=INK)
        away = (0, -12) if axes[1] == 2 else (-12, 0)
        _line(group, x, y, x + away[0], y + away[1], stroke=INK, width=4)
        _text(
            group,
            x + 13,
            y + 16,
            f"camera, {self.distance:.1f} m",
            size=11,
            anchor="end" if x > 380 else "start",
        )

    def _light(
        self, group: xml.Element, row: _Row, axes: tuple[int, int], labels: list[tuple[float, float]]
    ) -> None:
        assert row.place is not None
        if row.near:
            x, y = self._at(row.place, axes)
            aim = self._at(row.toward, axes)
        else:  # projected: one from straight above is in the middle of the plan
            x, y = self._at(row.place * SHARE_OF_RING * self.extent, axes)
            aim = (PANEL / 2, PANEL / 2)
        length = math.dist((x, y), aim)
        if length > 1:
            reach = min(40.0, 0.6 * length) if length > 30 else 16.0
            end = (x + (aim[0] - x) / length * reach, y + (aim[1] - y) / length * reach)
            _arrow(group, (x, y), end)
        if isinstance(row.light, RectLight):
            corners = np.array(row.light.position) + _corners(row.light)
            points = " ".join(f"{u:.1f},{v:.1f}" for u, v in (self._at(c, axes) for c in corners))
            _add(group, "polygon", points=points, fill=_hex(row.light), stroke=INK)
        shape = "circle" if row.near else "rect"
        box = {"cx": x, "cy": y, "r": 8} if row.near else {"x": x - 8, "y": y - 8, "width": 16, "height": 16}
        _add(group, shape, **box, fill=_hex(row.light), stroke=INK)
        left = x > PANEL - 90
        label = f"{row.number} {row.name}"
        high = y - 8
        while any(abs(high - other) < 13 and abs(x - there) < 90 for there, other in labels):
            high -= 13  # above the names of lights nearby
        labels.append((x, high))
        _text(group, x + (-12 if left else 12), high, label, anchor="end" if left else "start", halo=True)

    def _table(self, group: xml.Element) -> None:
        for title, left in COLUMNS:
            _text(group, left, 0, title, weight="bold")
        for row in self.rows:
            y = row.number * ROW
            _line(group, 0, y - 17, WIDTH - 2 * MARGIN, y - 17, stroke="#eeeeee")
            for (_, left), word in zip(COLUMNS, self._words(row), strict=True):
                _text(group, left, y, word)
            swatch = COLUMNS[6][1] - 20
            _add(group, "rect", x=swatch, y=y - 10, width=12, height=12, fill=_hex(row.light), stroke=FAINT)
        note = "squares: no distance (parallel rays, on the dashed circle); circles: lamps, to scale"
        _text(group, 0, (len(self.rows) + 1) * ROW + 6, note, fill="#666666")

    def _words(self, row: _Row) -> tuple[str, ...]:
        light, place = row.light, row.place
        kind = type(light).__name__.removesuffix("Light").lower()
        kind = {"point": "lamp", "rect": "softbox"}.get(kind, kind)
        where, apart = "all around", "none"
        if place is not None:
            azimuth = math.degrees(math.atan2(place[0], place[2]))
            elevation = math.degrees(math.atan2(place[1], math.hypot(place[0], place[2])))
            where = f"{_side(azimuth)}, {abs(elevation):.0f}° {'up' if elevation >= 0 else 'down'}"
            apart = f"{float(np.linalg.norm(place)):.2f} m" if row.near else "far"
        elif isinstance(light, EnvironmentLight):
            where = f"all around, turned {light.rotation:g}°"
        stops = "out"
        if self.key is not None and row.brightness > DARKEST < self.key.brightness:
            stops = f"{math.log2(row.brightness / self.key.brightness):+.1f} stops"
        stops = "key" if row is self.key else stops
        strength = light.intensity * 2.0**light.exposure
        return (
            f"{row.number}", _short(row.name), kind, where, apart, _size(light), _colour(light),
            f"{strength:.3g}", stops,
        )  # fmt: skip


def _side(azimuth: float) -> str:
    """Say an azimuth as people do: degrees toward a side of the picture."""
    if abs(azimuth) < 0.5:
        return "at the camera"
    return f"{abs(azimuth):.0f}° {'right' if azimuth > 0 else 'left'}" + (
        " behind" if abs(azimuth) > 90 else ""
    )


def _size(light: Light) -> str:
    if isinstance(light, DirectionalLight):
        return f"{light.angle:g}° across" if light.angle else "hard"
    if isinstance(light, RectLight):
        return f"{light.width:g} × {light.height:g} m"
    if isinstance(light, NearLight):
        profile = getattr(light, "profile", None)
        shape = f"r {light.extent:g} m" if light.extent else "point"
        cone = f", cone {light.cone:g}°" if light.has_cone else ""
        return _short(profile.path.name, 18) if profile is not None and profile.path else shape + cone
    return ""


def _colour(light: Light) -> str:
    kelvin = None if light.temperature is None else f"{light.temperature:.0f} K"
    tint = f"Duv {light.tint:+.3f}" if light.tint else None
    own = None if max(light.colour) == min(light.colour) else _hex(light)
    return _short(" ".join(filter(None, (light.source, kelvin, tint, light.gel, own))) or "white", 24)


def _short(text: str, most: int = 20) -> str:
    return text if len(text) <= most else f"{text[: most - 1]}…"


def _hex(light: Light) -> str:
    """Return the light's colour as a display shows it, at full brightness."""
    power = np.float32(light.power)
    pixel: np.ndarray = np.asarray(power / max(float(power.max()), 1e-12)).reshape(1, 1, 3)
    shown = encode(pixel, white=1.0)[0, 0]
    return "#" + "".join(f"{round(255 * float(channel)):02x}" for channel in shown)


def _corners(light: RectLight) -> np.ndarray:
    right, up = light.sides
    wide, high = light.width / 2 * right, light.height / 2 * up
    return np.array([-wide - high, wide - high, wide + high, high - wide])


def _add(group: xml.Element, kind: str, **attributes: object) -> xml.Element:
    def shown(value: object) -> str:
        return f"{value:.2f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)

    return xml.SubElement(group, kind, {name: shown(value) for name, value in attributes.items()})


def _line(
    group: xml.Element, x1: float, y1: float, x2: float, y2: float, stroke: str, width: int = 1
) -> None:
    _add(group, "line", x1=x1, y1=y1, x2=x2, y2=y2, stroke=stroke, **{"stroke-width": width})


def _arrow(group: xml.Element, start: tuple[float, float], end: tuple[float, float]) -> None:
    _line(group, *start, *end, stroke=INK)
    angle = math.atan2(end[1] - start[1], end[0] - start[0])
    wings = [(end[0] - 7 * math.cos(angle + s), end[1] - 7 * math.sin(angle + s)) for s in (-0.4, 0.4)]
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in (end, *wings))
    _add(group, "polygon", points=points, fill=INK)


def _text(
    group: xml.Element,
    x: float,
    y: float,
    words: str,
    *,
    size: int = 12,
    anchor: str = "start",
    weight: str = "normal",
    fill: str = INK,
    halo: bool = False,
) -> None:
    style = {"font-size": size, "text-anchor": anchor, "font-weight": weight}
    if halo:  # a light's name stays readable before lines
        style |= {"stroke": PAPER, "stroke-width": 3, "paint-order": "stroke"}
    element = _add(group, "text", x=x, y=y, fill=fill, **style)
    element.text = "".join(each if each.isprintable() else " " for each in words)
