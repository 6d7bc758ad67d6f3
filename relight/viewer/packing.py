"""Pack what the viewer's page knows of a person into one block of bytes: maps on the canvas, and the plate.

The page repeats `Subject.relit` from these alone. The 96 maps of cast shadow, one for each anchor direction,
and those of the residual are of low rank: their principal components are kept, 8 bits each. For any direction
of a light a pixel then costs as many products as there are components.

    uint32, little-endian: bytes of the description
    the description, JSON
    arrays, deflated together (zlib); see `_deflated`
    JPEG files: the photograph, the albedo
"""

import json
import struct
import warnings
import zlib
from collections.abc import Callable

import numpy as np
import torch

from relight.analysis.components import principal_components
from relight.analysis.depth import WorldGeometry
from relight.analysis.light_field import ANCHORS
from relight.analysis.record import AnalysisRecord
from relight.analysis.upsampling import EXTENSION_SHARE, GUIDE_MAX
from relight.media.colour import encode
from relight.media.images.encode import compressed
from relight.media.resampling import fill_unknown, resize
from shading.diffuse import RESIDUAL_BIAS
from shadow.framing import Extension, Framing
from shadow.networks.field import KAPPA, LIT_LOGIT

CAST_RANK, RESIDUAL_RANK = 24, 24  # components kept, as many as shaders/light.glsl mixes
MAX_PLATE_SIDE = 2048  # pixels of the plate in a page; larger plates are reduced
FILES = ("photograph", "albedo")
JPEG_QUALITY = 98  # without subsampling; at 95 the picture's error doubles to 0.012 RMS


def pack(record: AnalysisRecord, matte: np.ndarray, albedo: np.ndarray, *, compression: int = 8) -> bytes:
    """Pack a person as the page takes it.

    The matte is (H, W) in [0, 1], the albedo (H, W, 3) linear, as those of `Subject`. `compression`: of zlib,
    1 (fast) to 9 (small).
    """
    canvas, field = record.maps, record.maps.field
    plate = _ReducedPlate(record, matte, albedo)
    extend = Extension(canvas.known, EXTENSION_SHARE)

    def continued(values: torch.Tensor) -> torch.Tensor:
        """Return values (C, N) of the person's pixels as canvas maps (C, h, w), continued beyond them."""
        return extend(field.silhouette.scatter(values))

    cast, cast_mix = _quantised_components(field.cast, CAST_RANK, continued, LIT_LOGIT)
    residual, residual_mix = _quantised_components(field.residual, RESIDUAL_RANK, continued, 0)
    surface = torch.cat([continued(field.normals), continued(field.sharpness)])
    with warnings.catch_warnings():  # of a guessed height: the page says so where a light comes near
        warnings.simplefilter("ignore")
        depth = extend(canvas.geometry.depth[None])
    guide = (canvas.image / GUIDE_MAX * 255).round().clamp(0, 255)
    arrays: dict[str, np.ndarray] = {
        "features": torch.cat([cast, residual]).numpy().astype(np.uint8),
        "surface": surface.numpy().astype(np.float16).view(np.uint16),
        "rim": (continued(field.rim) * 255).round().clamp(0, 255).numpy().astype(np.uint8),
        "depth": depth.numpy().astype(np.float16).view(np.uint16),
        "guide": torch.cat([guide, canvas.known[None] * 255.0]).numpy().astype(np.uint8),
        "matte": np.round(plate.matte * 255).astype(np.uint8)[None],
        "anchors": ANCHORS.numpy(),
        "cast": cast_mix.numpy(),
        "residual": residual_mix.numpy(),
    }
    stream = _deflated(arrays, compression)
    pictures = (encode(getattr(plate, name).clip(0, 1), white=1) for name in FILES)
    files = [
        compressed(each, "JPEG", quality=JPEG_QUALITY, subsampling=0, optimize=True) for each in pictures
    ]
    description = {
        "size": plate.size[::-1],
        "box": plate.box,
        "canvas": canvas.known.shape[::-1],
        "centre": plate.framing.centre,
        "scale": plate.framing.scale,
        "camera": _camera(canvas.geometry),
        "exposure": plate.exposure,
        "gain": plate.gain,
        "residualBias": RESIDUAL_BIAS,
        "kappa": KAPPA,
        "brightest": GUIDE_MAX,
        "arrays": [
            {"name": name, "type": array.dtype.name, "shape": array.shape} for name, array in arrays.items()
        ],
        "parts": [len(stream), *map(len, files)],
    }
    text = json.dumps(description).encode()
    return b"".join([struct.pack("<I", len(text)), text, stream, *files])


def _camera(geometry: WorldGeometry) -> dict[str, object]:
    """Describe how canvas pixels and depth become positions, see `relight.analysis.camera`."""
    camera, framing = geometry.camera, geometry.framing
    rows, columns = camera.size
    return {
        "size": (columns, rows),
        "focal": camera.focal,
        "middle": camera.middle,
        "distance": camera.distance,
        "centre": framing.centre,
        "scale": framing.scale,
        "metresPerPixel": geometry.metres_per_pixel,
        "guessed": camera.guessed,
    }


class _ReducedPlate:
    """The person on the plate, no larger than a page wants it.

    `size`: (H, W). `box`: left, top, width and height of the person's part of it, to which the rest belongs.
    `photograph`, `albedo`: (h, w, 3), linear; without the background, continued beyond the matte. `matte`:
    (h, w) coverage. `framing`: of the canvas on the box. `gain`: factor of the photograph, which brings it
    into [0, 1]. `exposure`: factor that brings the photograph to the guide's exposure.
    """

    def __init__(self, record: AnalysisRecord, matte: np.ndarray, albedo: np.ndarray) -> None:
        person, framing = record.foreground, record.framing
        rows, columns = person.matte.shape
        shrink = min(1.0, MAX_PLATE_SIDE / max(person.size))
        size = (max(1, round(rows * shrink)), max(1, round(columns * shrink)))
        left, top = (round(start * shrink) for start in (person.left, person.top))
        self.size = tuple(max(1, round(side * shrink)) for side in person.size)
        self.box = (left, top, size[1], size[0])
        own = person.scatter(record.colour)
        colour, matte, albedo = (image[person.box] for image in (own, matte, albedo))
        inside = matte > 0
        brightest = float(np.quantile(colour[inside], 0.999))
        self.gain = min(1.0, 1 / max(brightest, 1e-6)) if brightest <= 1 else 1 / brightest
        # Continued, so that the JPEG has no edge that rings.
        self.photograph = resize(fill_unknown(colour, inside), size) * np.float32(self.gain)
        self.albedo = resize(fill_unknown(albedo, inside), size)
        self.matte = resize(np.ascontiguousarray(matte[..., None]), size)[..., 0].clip(0, 1)
        centre = tuple(
            c * side / old for c, side, old in zip(framing.centre, size[::-1], (columns, rows), strict=True)
        )
        self.framing = Framing((centre[0], centre[1]), framing.scale * rows / size[0], framing.canvas, size)
        self.exposure = float(record.exposure) / self.gain


def _quantised_components(
    maps: torch.Tensor, rank: int, continued: Callable[[torch.Tensor], torch.Tensor], offset: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the principal components of maps (K, N) as codes (rank, h, w) in [0, 255], and what mixes them.

    The mix is (K, rank + 1): map k is `mix[k, :rank] @ codes / 255 + mix[k, rank]`, with `offset` added.
    """
    basis, coefficients = principal_components(maps, rank)
    low = coefficients.amin(dim=1, keepdim=True)
    span = (coefficients.amax(dim=1, keepdim=True) - low).clamp_min(1e-9)
    codes = (continued((coefficients - low) / span) * 255).round().clamp(0, 255)
    return codes, torch.cat([basis * span.T, basis @ low + offset], dim=1)


def _deflated(arrays: dict[str, np.ndarray], compression: int) -> bytes:
    """Deflate arrays one after the other.

    Their bytes lie plane by plane, the lowest bytes of all values first, and each is stored as the difference
    to the byte before it in its row: neighbouring pixels are alike.
    """
    parts = []
    for array in arrays.values():
        planes = np.ascontiguousarray(array).view(np.uint8).reshape(*array.shape, array.dtype.itemsize)
        planes = np.moveaxis(planes, -1, 0)
        parts.append(np.diff(planes, axis=-1, prepend=np.uint8(0)).astype(np.uint8).tobytes())
    return zlib.compress(b"".join(parts), compression)
