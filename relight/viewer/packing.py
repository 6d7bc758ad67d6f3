"""What the viewer's page knows of a subject, in one block of bytes: maps on the canvas, and the plate.

The page repeats `Subject.relit` from these alone. The 96 maps of cast shadow, one an anchor direction, are
almost linear combinations of a few, and so are those of the residual: their principal components are kept, 8
bits each. Whatever the direction of a light, it then costs as many products a pixel as there are components.

    uint32, little-endian: bytes of the description
    the description, JSON
    arrays, deflated together (zlib); see `_deflated`
    JPEG files: the photograph, the albedo
"""

import io
import json
import struct
import warnings
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np
import OpenImageIO as oiio
import torch
from PIL import Image

from relight.canvas import Elsewhere
from relight.depth import Space
from relight.media.buffers import to_array, to_buffer
from relight.media.colour import encode
from relight.upsampling import BRIGHTEST
from shading.diffuse import HAZE, Shading
from shadow.framing import Framing
from shadow.networks.field import KAPPA, LIT, Visibility

if TYPE_CHECKING:
    from relight.subject import Subject

CAST, RESIDUAL = 24, 24  # components kept, as many as shaders/light.glsl mixes
LARGEST = 2048  # pixels a side of the plate in a page; larger plates are reduced
FILES = ("photograph", "albedo")
QUALITY = 98  # of JPEG, without subsampling: at 95 the picture would be off by 0.012 (RMS), now by half that


def pack(subject: "Subject") -> bytes:
    """A subject as the page takes it.

    Raises
    ------
    ValueError: a subject that was steadied: the mean of several frames has no maps of its own.
    """
    canvas = subject._canvas
    shading, visibility = (
        maps.maps if isinstance(maps, Elsewhere) else maps for maps in (canvas.shading, canvas.visibility)
    )
    if not isinstance(shading, Shading) or not isinstance(visibility, Visibility):
        raise ValueError("subject: is steadied; the page shows a frame as it was analysed")
    plate = _Plate(subject)
    maps, extend = visibility.maps, subject._extend

    def continued(values: torch.Tensor) -> torch.Tensor:
        """Values (C, N) of the subject's pixels as canvas maps (C, h, w), continued beyond them."""
        return extend(visibility.silhouette.scatter(values.cpu()))

    cast, cast_mix = _components(maps.cast.cpu(), CAST, continued, LIT)
    residual, residual_mix = _components(shading.residual.cpu(), RESIDUAL, continued, 0)
    surface = torch.cat([continued(maps.normals), continued(maps.sharpness)])
    with warnings.catch_warnings():  # of a guessed height: the page says so where a light comes near
        warnings.simplefilter("ignore")
        depth = extend(canvas.space.depth[None])
    guide = (canvas.image / BRIGHTEST * 255).round().clamp(0, 255)
    arrays: dict[str, np.ndarray] = {
        "features": torch.cat([cast, residual]).numpy().astype(np.uint8),
        "surface": surface.numpy().astype(np.float16).view(np.uint16),
        "depth": depth.numpy().astype(np.float16).view(np.uint16),
        "guide": torch.cat([guide, canvas.known[None] * 255.0]).numpy().astype(np.uint8),
        "matte": np.round(plate.matte * 255).astype(np.uint8)[None],
        "anchors": visibility.anchors.cpu().numpy(),
        "cast": cast_mix.numpy(),
        "residual": residual_mix.numpy(),
    }
    stream = _deflated(arrays)
    files = [_jpeg(getattr(plate, name)) for name in FILES]
    description = {
        "size": plate.size[::-1],
        "box": plate.box,
        "canvas": canvas.known.shape[::-1],
        "centre": plate.framing.centre,
        "scale": plate.framing.scale,
        "camera": _camera(canvas.space),
        "exposure": plate.exposure,
        "gain": plate.gain,
        "haze": HAZE,
        "kappa": KAPPA,
        "brightest": BRIGHTEST,
        "arrays": [
            {"name": name, "type": array.dtype.name, "shape": array.shape} for name, array in arrays.items()
        ],
        "parts": [len(stream), *map(len, files)],
    }
    text = json.dumps(description).encode()
    return b"".join([struct.pack("<I", len(text)), text, stream, *files])


def _camera(space: Space) -> dict[str, Any]:
    """What takes pixels of the canvas and their depth to the room and back: see `relight.depth`."""
    camera, framing = space.camera, space.framing
    rows, columns = camera.size
    return {
        "size": (columns, rows),
        "focal": camera.focal,
        "middle": camera.middle,
        "distance": camera.distance,
        "centre": framing.centre,
        "scale": framing.scale,
        "metresPerPixel": space.metres_per_pixel,
        "guessed": camera.guessed,
    }


class _Plate:
    """The subject on the plate, no larger than a page wants it.

    Attributes
    ----------
    size: (H, W). box: left, top, width and height of the person's part of it, which all the rest shows.
    photograph, albedo: (h, w, 3), linear; without the background, continued beyond the matte.
    matte: (h, w) coverage. framing: of the canvas on the box.
    gain: that the photograph was multiplied with, to be within [0, 1].
    exposure: that takes the photograph to the guide's exposure.
    """

    def __init__(self, subject: "Subject") -> None:
        person, framing = subject._person, subject._framing
        rows, columns = person.matte.shape
        shrink = min(1.0, LARGEST / max(subject.size))
        size = (max(1, round(rows * shrink)), max(1, round(columns * shrink)))
        left, top = (round(start * shrink) for start in (person.left, person.top))
        self.size = tuple(max(1, round(side * shrink)) for side in subject.size)
        self.box = (left, top, size[1], size[0])
        own = person.scatter(subject._colour)
        colour, matte, albedo = (
            image[person.top : person.top + rows, person.left : person.left + columns]
            for image in (own, subject.matte, subject.albedo)
        )
        brightest = float(np.quantile(colour[matte > 0], 0.999))
        self.gain = min(1.0, 1 / max(brightest, 1e-6)) if brightest <= 1 else 1 / brightest
        self.photograph = _resized(_filled(colour, matte > 0), size) * np.float32(self.gain)
        self.albedo = _resized(_filled(albedo, matte > 0), size)
        self.matte = _resized(np.ascontiguousarray(matte[..., None]), size)[..., 0].clip(0, 1)
        centre = tuple(
            c * side / old for c, side, old in zip(framing.centre, size[::-1], (columns, rows), strict=True)
        )
        self.framing = Framing((centre[0], centre[1]), framing.scale * rows / size[0], framing.canvas, size)
        self.exposure = float(subject._exposure) / self.gain


def _components(
    maps: torch.Tensor, rank: int, continued: Any, offset: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """The principal components of maps (K, N): codes (rank, h, w) in 0 to 255, and what mixes them.

    The mix is (K, rank + 1): map k is `mix[k, :rank] @ codes / 255 + mix[k, rank]`, and `offset` is added.
    """
    left, strengths, right = torch.linalg.svd(maps, full_matrices=False)
    strongest = right[:rank] * strengths[:rank, None]
    if len(strongest) < rank:  # a subject of fewer pixels than that
        strongest = torch.cat([strongest, strongest.new_zeros(rank - len(strongest), maps.shape[1])])
        left = torch.cat([left, left.new_zeros(len(left), rank - left.shape[1])], dim=1)
    low = strongest.amin(dim=1, keepdim=True)
    span = (strongest.amax(dim=1, keepdim=True) - low).clamp_min(1e-9)
    codes = (continued((strongest - low) / span) * 255).round().clamp(0, 255)
    return codes, torch.cat([left[:, :rank] * span.T, left[:, :rank] @ low + offset], dim=1)


def _deflated(arrays: dict[str, np.ndarray]) -> bytes:
    """Arrays one after the other, deflated.

    Their bytes lie plane by plane, the lowest bytes of all values first, and each byte less the one before
    it in its row: neighbouring pixels are alike.
    """
    parts = []
    for array in arrays.values():
        planes = np.ascontiguousarray(array).view(np.uint8).reshape(*array.shape, array.dtype.itemsize)
        planes = np.moveaxis(planes, -1, 0)
        parts.append(np.diff(planes, axis=-1, prepend=np.uint8(0)).astype(np.uint8).tobytes())
    return zlib.compress(b"".join(parts), 9)


def _filled(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """An image (h, w, 3) continued from where it is known: a JPEG then has no edge to ring at."""
    trusted = np.concatenate([image * known[..., None], known[..., None]], axis=-1, dtype=np.float32)
    filled = to_array(oiio.ImageBufAlgo.fillholes_pushpull(to_buffer(np.ascontiguousarray(trusted))))
    return np.where(known[..., None], image, filled[..., :3]).astype(np.float32)


def _resized(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    if image.shape[:2] == size:
        return image
    region = oiio.ROI(0, size[1], 0, size[0], 0, 1, 0, image.shape[2])
    resized = oiio.ImageBufAlgo.resize(to_buffer(image), "blackman-harris", roi=region)
    return to_array(resized).reshape(*size, image.shape[2])


def _jpeg(linear: np.ndarray) -> bytes:
    codes = np.round(encode(linear.clip(0, 1), white=1) * 255).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(codes).save(file, "JPEG", quality=QUALITY, subsampling=0, optimize=True)
    return file.getvalue()
