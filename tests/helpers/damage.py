"""Files whose bytes are damaged: pictures, mattes, movies, weights and analysis caches; and undamaged ones.

Kinds of hostile inputs, as `fuzzing` describes them.
"""

import itertools
import json
import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from fractions import Fraction
from pathlib import Path
from random import Random
from unittest import mock

import av
import numpy as np
import torch

import relight
import shading
import shadow
from helpers import hostile
from helpers.invariants import ALLOWED, require, require_finite, require_named, require_same
from helpers.pifuhd_checkpoints import narrow
from helpers.pifuhd_checkpoints import save as save_pifuhd
from relight.media.movies import Movie, write_movie
from shading.diffuse import ShadingField
from shadow import normals
from shadow.networks import checkpoints
from shadow.networks.field import VisibilityField

SMALL_CANVAS = 128  # pixels in height
SHIPPED_CANVAS = 512
NARROW = {"size": SMALL_CANVAS, "widths": (4, 4), "encoder": (1, 1), "decoder": (1,)}
# Codec and pixels of the movies that others write; None where we do.
MOVIES = {
    "straight.mov": None,
    "opaque.mov": None,
    "ours.mp4": None,
    "theirs.mp4": ("mpeg4", "yuv420p"),
    "theirs.avi": ("mpeg4", "yuv420p"),
    "theirs.mkv": ("ffv1", "yuv444p"),
    "theirs.webm": ("libvpx-vp9", "yuv420p"),
    "theirs.mxf": ("mpeg2video", "yuv420p"),
    "photographs.avi": ("mjpeg", "yuvj420p"),
    "animation.mov": ("qtrle", "argb"),
}


def damaged_image(random: Random, folder: Path) -> None:
    """A picture's file with bytes changed, cut off, doubled or shuffled."""
    path = _damaged_file(random, folder)
    try:
        picture = relight.read(path)
    except ALLOWED as error:
        require_named(path, error)
        raise
    require(picture.ndim == 3 and picture.shape[-1] in (3, 4) and picture.dtype == np.float32, "no picture")
    require_finite("read", picture)


def damaged_mask(random: Random, folder: Path) -> None:
    """The same as a matte."""
    path = _damaged_file(random, folder, grey=random.random() < 0.7)
    try:
        mask = relight.read_mask(path)
    except ALLOWED as error:
        require_named(path, error)
        raise
    require(mask.ndim == 2 and mask.dtype == np.float32, "no matte")
    require(mask.min() >= 0 and mask.max() <= 1, "matte out of [0, 1]")


def _damaged_file(random: Random, folder: Path, grey: bool = False) -> Path:
    suffix, depth, alpha = random.choice(hostile.GREY if grey else hostile.FORMATS)
    whole = folder / f"whole-{grey}-{depth}-{alpha}{suffix}"  # the same for all inputs of a folder
    if grey and not whole.exists():
        relight.write_mask(whole, np.random.default_rng(1).uniform(0, 1, (24, 20)), depth=depth)
    elif not whole.exists():
        pixels = np.random.default_rng(1).uniform(0, 1, (24, 20, 4 if alpha else 3)).astype(np.float32)
        pixels[..., :3] *= pixels[..., 3:] if alpha else 1
        relight.write(whole, pixels, depth=depth)
    path = folder / f"damaged{random.choice([suffix] * 9 + ['.png', '.exr', '.jpg'])}"
    damaged = hostile.damaged(random, whole.read_bytes())
    path.write_bytes(hostile.resealed(damaged) if suffix == ".png" and random.random() < 0.7 else damaged)
    return path


def containers(random: Random, folder: Path) -> None:
    """The same pixels in two files, and in a file and none."""
    rng = np.random.default_rng(random.randrange(2**32))
    shape = (random.randrange(1, 40), random.randrange(1, 40), random.choice([3, 4]))
    dtype = random.choice([np.uint8, np.uint16])
    pixels = rng.integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)
    depth = np.dtype(dtype).name
    pictures = []
    for name in ("one.png", "other.tif"):
        relight.write(folder / name, pixels, depth=depth)
        pictures.append(relight.read(folder / name))
        require_finite(name, pictures[-1])
    require_same("PNG and TIFF", *pictures)
    relight.write(folder / "light.exr", pictures[0], depth="float")
    require(
        np.array_equal(relight.read(folder / "light.exr"), pictures[0]), "other floats from an OpenEXR file"
    )
    relight.write(folder / "light.tif", pictures[0], depth="float")
    require_same("floats from a TIFF", relight.read(folder / "light.tif"), pictures[0], 1e-6)
    opaque = pictures[0][..., :3]
    relight.write(folder / "light.hdr", opaque)
    require_same("HDR", relight.read(folder / "light.hdr"), opaque, 0.01)


def damaged_movie(random: Random, folder: Path) -> None:
    """A movie of four frames, of one of several codecs and containers."""
    name = random.choice([*MOVIES])
    whole = folder / name
    if not whole.exists():
        _write_movie(whole)
    path = folder / f"damaged{whole.suffix}"
    path.write_bytes(hostile.damaged(random, whole.read_bytes()))
    try:
        movie = Movie(path)
        require(movie.rate is None or movie.rate > 0, f"{movie.rate} frames a second")
        for number in random.sample(movie.numbers, min(3, len(movie.numbers))):
            frame = movie.read(number)
            require(frame.ndim == 3 and frame.shape[-1] in (3, 4) and frame.dtype == np.float32, "no frame")
            require_finite("frame", frame)
    except ALLOWED as error:
        require_named(path, error)
        raise


def _write_movie(path: Path) -> None:
    frames = np.random.default_rng(1).uniform(0, 1, (4, 24, 32, 4)).astype(np.float32)
    codec = MOVIES[path.name]
    if codec is None:
        frames[..., :3] *= frames[..., 3:]
        return write_movie(path, frames if path.stem == "straight" else frames[..., :3])
    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec[0], Fraction(24))
        stream.width, stream.height, stream.pix_fmt = 32, 24, codec[1]
        for frame in frames:
            codes = np.ascontiguousarray((frame[..., :3] * 255).astype(np.uint8))
            file.mux(
                stream.encode(av.VideoFrame.from_ndarray(codes, format="rgb24").reformat(format=codec[1]))
            )
        file.mux(stream.encode())


SERIAL = itertools.count()  # networks are cached by their file's name: each has its own


def damaged_weights(random: Random, folder: Path) -> None:
    """Weights of our two networks, and a checkpoint of PIFuHD's; what is loaded sees a picture."""
    kind = random.choice(["field", "shading", "pifuhd", "pifuhd legacy"])
    suffix = ".pt" if "pifuhd" in kind else ".safetensors"
    whole = folder / f"{kind}{suffix}"
    if not whole.exists():
        _write_weights(whole)
    path = folder / f"damaged-{next(SERIAL)}{suffix}"
    path.write_bytes(_damaged_tensors(random, whole.read_bytes()))
    rgb, mask = np.full((24, 20, 3), 0.5, np.float32), np.zeros((24, 20), np.float32)
    mask[4:20, 6:14] = 1
    try:
        if kind == "field":
            maps = shadow.infer(rgb, mask, np.eye(3, dtype=np.float32), model=path)
        elif kind == "shading":
            maps = shading.infer(rgb, mask, np.eye(3, dtype=np.float32), model=path)
        else:
            network = normals.load(path)
            require(all(value.isfinite().all() for value in network.parameters()), "NaN or infinite weights")
            return
        require_finite("maps", maps)
        require(maps.min() >= 0 and maps.max() <= 1, "maps out of [0, 1]")
    except ALLOWED as error:
        require_named(path, error)
        raise
    finally:
        path.unlink()


def _damaged_tensors(random: Random, content: bytes) -> bytes:
    draw = random.random()
    return hostile.edited_header(random, content) if draw < 0.4 else hostile.damaged(random, content)


def _write_weights(path: Path) -> None:
    torch.manual_seed(1)
    if path.suffix == ".pt":
        save_pifuhd(path, narrow(), legacy="legacy" in path.stem)
    else:
        network = VisibilityField(**NARROW) if path.stem == "field" else ShadingField(**NARROW)
        for parameter in network.parameters():
            torch.nn.init.normal_(parameter, std=0.1)
        checkpoints.save(path, network, path.stem, NARROW, {"steps": 3})


@contextmanager
def small_canvas(rows: int = SMALL_CANVAS) -> Iterator[None]:
    """Networks for the shipped canvas on one of fewer rows, by default at a sixteenth of the cost.

    Their classes say so, not the networks, of which a process keeps eight and reads others again.
    """

    def size(network) -> int:
        own = network.__dict__["size"]
        return rows if own == SHIPPED_CANVAS else own

    patched = property(size, lambda network, own: network.__dict__.update(size=own))
    with ExitStack() as patches:
        for network in (VisibilityField, ShadingField):
            patches.enter_context(mock.patch.object(network, "size", patched, create=True))
        yield


def kept_person(folder: Path, given: bool = False) -> Path:
    """The analysis cache of a person, their albedo inferred or `given`."""
    path = folder / f"kept-{given}.safetensors"
    if not path.exists():
        rng = np.random.default_rng(1)
        mask = np.zeros((24, 20), np.float32)
        mask[4:22, 6:14] = rng.uniform(0.6, 1, (18, 8))
        image = rng.uniform(0, 1, (24, 20, 3)).astype(np.float32)
        with small_canvas():
            relight.Subject(image, mask, albedo=image if given else None).save(path)
    return path


def kept_shapes(random: Random, folder: Path) -> None:
    """An analysis cache of which a tensor or array has another shape or type, its length fitting or not."""
    content = kept_person(folder, random.choice([True, False])).read_bytes()
    end = 8 + int.from_bytes(content[:8], "little")
    header = json.loads(content[8:end])
    path = folder / "damaged.safetensors"
    if random.random() < 0.6:  # our own header, which says what the compressed bytes become
        about = json.loads(header["__metadata__"]["relight"])
        _reshape(random, about)
        header["__metadata__"]["relight"] = json.dumps(about)
        text = json.dumps(header).encode()
        path.write_bytes(len(text).to_bytes(8, "little") + text + content[end:])
        return _relit(path)
    name = random.choice([name for name in header if name != "__metadata__"])
    tensor, count = header[name], random.randrange(5)
    tensor["shape"] = [random.choice([0, 1, 3, 20, 24, 2**20, 2**31, 2**40, 2**63]) for _ in range(count)]
    tensor["dtype"] = random.choice([tensor["dtype"]] * 5 + ["F64", "U8", "I64", "BF16", "X"])
    if random.random() < 0.5:
        tensor["data_offsets"][1] = tensor["data_offsets"][0] + random.choice([0, 1, 24 * 20, 2**33])
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + content[end:])
    _relit(path)


def _reshape(random: Random, about: dict) -> None:
    """Say another shape or type of an array, or another size of the plate or the box around the person."""
    if random.random() < 0.2:
        about[random.choice(["size", "box", "corner"])] = [
            random.choice([0, 1, 24, 40, 2**13, 2**20, 2**40]) for _ in "yx"
        ]
        return
    array = about["arrays"][random.choice(list(about["arrays"]))]
    side = random.randrange(len(array[1]))
    array[1][side] = random.choice([array[1][side] + 1, array[1][side] * 2, 0, 1, 2**20, 2**31, 2**40])
    if random.random() < 0.3:
        array[1] = random.choice([array[1][::-1], [*array[1], 1], [math.prod(array[1])]])
    if random.random() < 0.2:
        array[0] = random.choice(["<f8", "|u1", "<i8", "|O", "x"])


def damaged_analysis(random: Random, folder: Path) -> None:
    """The analysis cache of a person: it is refused, or the person can be relit."""
    whole = kept_person(folder, random.choice([True, False]))
    path = folder / "damaged.safetensors"
    path.write_bytes(_damaged_tensors(random, whole.read_bytes()))
    _relit(path)


def _relit(path: Path) -> None:
    """Load a kept person and relight them: they are refused by name, or the picture is one."""
    lights = [relight.DirectionalLight(azimuth=40), relight.PointLight((0, 0.5, 2))]
    try:
        subject = relight.Subject.load(path)
    except ALLOWED as error:
        require_named(path, error)
        raise
    picture = subject.relit(lights)
    require(picture.dtype == np.float32 and picture.shape == (*subject.size, 4), "no picture")
    require_finite("relit", picture)
    require(picture[..., 3].min() >= 0 and picture[..., 3].max() <= 1, "alpha out of [0, 1]")
