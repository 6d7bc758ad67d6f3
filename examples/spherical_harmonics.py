"""What a relighter loses that keeps light in low-order spherical harmonics (the paper's Appendix A).

python examples/spherical_harmonics.py [person.png] [folder] [--traced]

A pixel's transfer is its shading, visibility × max(N·L, 0), as a function of the light's direction L. Ours
answers for a direction. A relighter on spherical harmonics projects transfer and light on the first of them
and multiplies coefficients: it lights with what they keep of a directional light, a lobe tens of degrees
wide, and its shadow edges are as soft. Prints a table and draws a picture.

An order loses nothing where our own edges are as soft as its lobe: what there is to lose in the end is seen
with --traced, which does the same to the bundled person's ray-traced transfer (needs the extra `stage`, and a
minute).
"""

import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from scipy.special import roots_legendre, sph_harm_y

import relight
from shadow.directions import from_spherical

ORDERS = range(2, 9)
AZIMUTH, ELEVATION = 65, 15  # of the picture's light: the arm throws its shadow on the coat
PATH = np.arange(-100, 140, 2)  # azimuths of the light as it turns through there
SHARPEST = 0.02  # share of the pixels whose edges are measured: most others have the slow fall of N·L alone
HEIGHT = 480  # pixels of the picture's rows


def harmonics(directions):
    """Real spherical harmonics up to the last order, (81, D), of directions (D, 3)."""
    degree, order = np.array([(n, m) for n in range(ORDERS[-1] + 1) for m in range(-n, n + 1)]).T[:, :, None]
    x, y, z = directions.T
    values = sph_harm_y(degree, abs(order), np.arccos(y.clip(-1, 1)), np.arctan2(x, z))
    return np.where(order < 0, values.imag, values.real) * np.where(order == 0, 1, np.sqrt(2))


def reconstructed(coefficients, order, directions):
    """What the harmonics up to `order` keep of a function (81, ...), at directions (D, 3): (D, ...)."""
    count = (order + 1) ** 2
    return np.tensordot(harmonics(directions)[:count].T, coefficients[:count], axes=1)


def projected(shade, rows=20):
    """The transfer of every pixel on the harmonics, (81, H, W): an integral over the sphere."""
    height, weight = roots_legendre(rows)  # Gauss-Legendre in height, even steps of azimuth
    coefficients = 0
    for elevation, solid_angle in zip(np.degrees(np.arcsin(height)), weight * np.pi / rows, strict=True):
        directions = from_spherical(180 / rows * np.arange(2 * rows), elevation)
        basis = (harmonics(directions) * solid_angle).astype(np.float32)
        coefficients = coefficients + np.tensordot(basis, shade(directions), axes=1)
    return coefficients


def fall(curve):
    """Degrees along the path in which shading falls from 90 % to 10 % of its maximum; NaN if it does not."""
    start = curve.argmax()
    azimuth = []
    for level in (0.9 * curve[start], 0.1 * curve[start]):
        below = start + np.flatnonzero(curve[start:] < level)
        if not len(below):
            return np.nan
        azimuth.append(np.interp(level, curve[[below[0], below[0] - 1]], PATH[[below[0], below[0] - 1]]))
    return azimuth[1] - azimuth[0]


def compare(name, shade, mask):
    """Table rows, and the shading in the picture's light: whole, then by order, (8, H, W)."""
    light, path = from_spherical([AZIMUTH], [ELEVATION]), from_spherical(PATH, ELEVATION)
    coefficients = projected(shade)
    pictures = [shade(light)[0]] + [reconstructed(coefficients, order, light)[0] for order in ORDERS]
    curves = shade(path)[:, mask]
    curves, transfer = (values[:, curves.max(axis=0) > 0.3] for values in (curves, coefficients[:, mask]))
    widths = np.array([fall(curve) for curve in curves.T])
    edges = np.argsort(widths)[: max(1, int(SHARPEST * len(widths)))]  # NaN comes last
    rows = [f"| {name} | | 0° | | {np.median(widths[edges]):.0f}° |"]
    turned = np.arange(180)
    for order, picture in zip(ORDERS, pictures[1:], strict=True):
        lobe = reconstructed(harmonics(from_spherical([0], [0]))[:, 0], order, from_spherical(turned, 0))
        half = turned[np.argmax(lobe < lobe[0] / 2)]
        error = np.sqrt(np.mean((picture - pictures[0])[mask] ** 2))
        width = np.nanmedian([fall(c) for c in reconstructed(transfer[:, edges], order, path).T])
        rows.append(f"| order {order} | {(order + 1) ** 2} | {2 * half}° | {error:.3f} | {width:.0f}° |")
    return rows, np.stack(pictures)


def traced(size=320):
    """The bundled person's ray-traced shading, and the mask: the body and camera of make_person.py."""
    from shadow.lightstage import stage
    from shadow.lightstage.people.generate import bodies

    body = bodies.body(13, "generalisation")
    view = stage.View(azimuth=8, distance=3.5, height=1.2, pitch=-5, fov=34)

    def shade(directions):
        record = stage.render(body, view, size, directions)
        return record.image((record.normals @ directions.T).clip(0) * record.visibility).numpy()

    return shade, stage.render(body, view, size, from_spherical([0], [0])).mask


def lights(width):
    """The light itself, whole and by order, (8, h, w), over azimuth (-180 at left) and elevation."""
    azimuth, elevation = np.linspace(-180, 180, width), np.linspace(90, -90, width // 2)
    sphere = from_spherical(*np.meshgrid(azimuth, elevation)).reshape(-1, 3)
    light = from_spherical(AZIMUTH, ELEVATION)
    kept = [reconstructed(harmonics(light[None])[:, 0], order, sphere) for order in ORDERS]
    maps = [sphere @ light > np.cos(np.radians(3)), *(lobe / lobe.max() for lobe in kept)]
    return np.stack(maps).reshape(8, width // 2, width)


def strip(pictures, titles, size):
    """Pictures (8, h, w) at `size` (height, width), in a row with their titles above: (H, W)."""
    region = oiio.ROI(0, size[1], 0, size[0], 0, 1, 0, 1)
    images = (oiio.ImageBuf(np.ascontiguousarray(p, np.float32)[..., None]) for p in pictures.clip(0, 1))
    scaled = [oiio.ImageBufAlgo.resize(image, "triangle", roi=region).get_pixels("float") for image in images]
    page = oiio.ImageBuf(np.concatenate([np.pad(p, ((32, 8), (4, 4), (0, 0))) for p in scaled], axis=1))
    for column, title in enumerate(titles):
        oiio.ImageBufAlgo.render_text(page, 6 + column * (size[1] + 8), 22, title, 18)
    return page.get_pixels("float")[..., 0]


arguments = [argument for argument in sys.argv[1:] if argument != "--traced"]
person = Path(arguments[0]) if arguments else Path(__file__).with_name("person.png")
folder = Path(arguments[1]) if len(arguments) > 1 else Path("out")
folder.mkdir(parents=True, exist_ok=True)

image = np.ascontiguousarray(relight.read(person)[::3, ::3])  # the networks see no more
sources = [("ours", relight.Subject(image).shading, image[..., 3] > 0.5)]
if "--traced" in sys.argv:
    sources.append(("ray traced", *traced()))

names, strips = [f"order {order}" for order in ORDERS], []
print("| transfer | coefficients | light's width | RMSE | edge's width |\n|---|---|---|---|---|")
for name, shade, mask in sources:
    rows, pictures = compare(name, shade, mask)
    print("\n".join(rows))
    y, x = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    pictures = pictures[:, y[0] : y[-1] + 1, x[0] : x[-1] + 1]
    width = HEIGHT * pictures.shape[2] // pictures.shape[1]
    if not strips:
        strips.append(strip(lights(width), ["light", *names], (width // 2, width)))
    strips.append(strip(pictures, [name, *names], (HEIGHT, width)))
page = np.zeros((sum(map(len, strips)), max(s.shape[1] for s in strips), 3), np.float32)
for top, row in zip(np.cumsum([0, *map(len, strips)]), strips, strict=False):
    page[top : top + len(row), : row.shape[1]] = row[..., None]
relight.write(folder / "spherical_harmonics.png", page)
print(f"\nwrote {folder / 'spherical_harmonics.png'}")
