"""The analysed person: albedo, normals, visibility and shading, ready for any number of lights."""

import copy
from functools import cached_property

import numpy as np
import OpenImageIO as oiio
import torch
import torch.nn.functional as F

from relight import steadying
from relight.media.colour import luminance
from relight.media.images import scene_linear
from relight.steadying import Canvas
from relight.upsampling import JointBilateral
from shading import diffuse
from shading.albedo import solve_lighting
from shadow import inputs
from shadow import normals as normals_module
from shadow import visibility as visibility_module
from shadow.directions import olat
from shadow.framing import Extension, Framing, bounding_box

CLEAN = 0.98  # coverage above which a photograph's pixel holds no background to speak of
FAINT = 0.05  # coverage below which premultiplied colour is too coarse to divide by
REACH = 0.08  # of the canvas, how far maps are continued beyond the matte: for hair and soft edges
DARK = 1e-3  # squared albedo at which the photographed shading is as much guess as measurement
DEEPEST = 0.02  # least photographed shading, as a share of the mean: bounds the noise that delighting lifts
BATCH = 64  # directions at a time


class Subject:
    """A person in an image, analysed once; then each light costs a weighted sum and no network.

    The networks run when the subject is made, so that bad input fails there and relighting takes a
    predictable time. They see a canvas around the person; what they find is brought back to the plate's own
    pixels, guided by its colours, while texture comes from the plate itself.

    Parameters
    ----------
    image: (H, W, 3|4). Integers are sRGB-encoded with straight alpha; floats linear Rec.709, premultiplied.
    mask: (H, W) in [0, 1], or uint8 or uint16 over the full range: the matte of the person. Needed unless the
        image has alpha, which it replaces. Pixels that a mask covers in part, and the rim of a hard mask, are
        taken to show the background too, so their colour is continued from inside.
    albedo: (H, W, 3) to use instead of inferring it; integers sRGB, floats linear in [0, 1].
    normals: (H, W, 3) camera-frame normals (x right, y up, z to the camera) to use instead of inferring them;
        or anything else that `shadow.normals.load` takes, such as a PIFuHD checkpoint.

    Raises
    ------
    TypeError: a dtype that is not welcome. ValueError: wrong shapes, NaN or infinite values, values out of
    range, neither mask nor alpha, an empty mask.
    """

    def __init__(self, image, mask=None, albedo=None, normals=None):
        pixels = scene_linear("image", image)
        alpha = _matte(pixels, mask)
        self._size = tuple(alpha.shape)
        given_albedo = None if albedo is None else _given_albedo(albedo, self._size)
        field, shader = visibility_module.load(), diffuse.load()
        photograph = None if normals is None else _photograph(pixels)
        surface = normals_module.resolve(normals, photograph, alpha, field, shader)

        top, left, bottom, right = bounding_box(alpha, threshold=0)
        # An empty pixel around it, unless the plate ends there: so the framing sees which sides are cut.
        top, left = max(top - 1, 0), max(left - 1, 0)
        bottom, right = min(bottom + 1, self._size[0]), min(right + 1, self._size[1])
        box = np.s_[..., top:bottom, left:right]
        alpha = alpha[box]
        foreground = _foreground(pixels[top:bottom, left:right], alpha, photographed=mask is not None)
        self._box, self._matte = np.s_[top:bottom, left:right], alpha
        self._pixels = (alpha > 0).flatten().nonzero()[:, 0]  # in the box
        self._where = (
            (self._pixels // (right - left) + top) * self._size[1] + self._pixels % (right - left) + left
        )
        self._alpha = alpha.flatten()[self._pixels]

        self._framing = framing = Framing.around(alpha, field.size)
        framed_mask = framing.crop(alpha[None])[0].clamp(0, 1)
        framed = _crop(framing, foreground)
        known = framed_mask > 0.5
        surface = normals_module.on_canvas(None if surface is None else surface[box], framing)
        surface, visibility = field.analyse(framed, framed_mask, surface)
        analysed = shader.analyse(framed, framed_mask, surface, visibility)

        exposure = 0.2 / framed[:, known].mean().clamp_min(1e-6)
        guide, framed_guide = (_display(colour * exposure) for colour in (foreground, framed))
        self._extend = Extension(framed_mask, REACH)
        self._enlarge = JointBilateral(framing, guide, framed_guide, known, self._pixels)
        if given_albedo is None:
            light, found = _photographed_shading(framed, analysed.albedo, known), analysed.albedo
            self._colour = foreground.flatten(1)[:, self._pixels].T
        else:
            light, found = None, _crop(framing, given_albedo[box])
            self._albedo = given_albedo[box].flatten(1)[:, self._pixels].T
        self._use(
            Canvas(
                framing.shifted(left, top, self._size), known, framed_guide,
                surface, visibility, analysed.shading, found, light,
            )
        )  # fmt: skip

    def _use(self, canvas):
        """Take what the networks found from `canvas`."""
        self._canvas = canvas
        if canvas.light is not None:
            light = self._to_plate(canvas.light).clamp_min(1e-30)  # farther out than maps reach, it is zero
            self._albedo = (self._colour / light).clamp(0, 1)

    def steadied(self, around):
        """The same person with the trembling of the networks taken out, for sequences.

        `around` are the subjects of a few frames before and after, as they were made. Where these agree, the
        maps become their mean; where something moves, as a shadow does, each frame keeps its own. See
        `relight.steadying`.
        """
        steady = copy.copy(self)
        for name in ("albedo", "normals", "_texture"):
            steady.__dict__.pop(name, None)
        steady._use(steadying.steadied(self._canvas, [subject._canvas for subject in around]))
        return steady

    def relit(self, lights):
        """The person in new light.

        Parameters
        ----------
        lights: a light, or any number of them; none gives black.

        Returns
        -------
        (H, W, 4) float32, linear Rec.709, premultiplied, never clipped. Exactly linear: the colour of
        `relit(a + b)` is that of `relit(a)` plus that of `relit(b)`, and twice the intensity gives twice the
        colour, to float32 rounding. Alpha is the matte.
        """
        picture = torch.empty(len(self._pixels), 4)
        torch.mul(self._lighting(lights), self._texture, out=picture[:, :3])
        picture[:, 3] = self._alpha
        return self._scatter(picture)

    def layers(self, lights):
        """The person in each light alone: {name: (H, W, 4)}, lights without a name as `light1`, `light2`...

        Each is a complete premultiplied picture and carries the matte as its alpha. The colours of all layers
        sum to the colour of `relit(lights)`; the alpha, which is the same person's coverage, does not add up.
        ValueError if two lights have one name.
        """
        return {name: self.relit(light) for name, light in by_name(lights).items()}

    def lighting(self, lights):
        """What the lights would do to a white person: (H, W, 3) float32, linear, zero outside the matte.

        The colour of `relit(lights)` is `albedo × lighting(lights) × alpha`: with the albedo, what a
        compositor needs to grade light and colour apart. Raises as `relit` does.
        """
        return self._scatter(self._lighting(lights))

    def fitted(self, image):
        """The lighting in which the person looks most like `image`, see `relight.fit_lights`.

        Returns directions (96, 3), `shadow.directions.olat(behind=True)`, and their intensities (96, 3) >= 0.
        """
        pixels = scene_linear("image", image)
        if pixels.shape[:2] != self._size:
            raise ValueError(f"image: expected the subject's size {self._size}, got {pixels.shape[:2]}")
        foreground = _foreground(pixels[self._box], self._matte, photographed=pixels.shape[-1] == 3)
        framed, directions = _crop(self._framing, foreground), torch.from_numpy(olat(behind=True))
        shading, canvas = self._canvas.shading(directions), self._canvas
        powers = solve_lighting(framed, canvas.albedo, shading, canvas.known.float())
        return directions.numpy(), powers.numpy()

    def unshadowed(self, light):
        """The share of a light that no part of the person blocks: (H, W) float32 in [0, 1], zero outside.

        Of a hard light its visibility; of a soft one or an environment the mean over its directions, weighted
        by their luminance.
        """
        directions, powers = light.samples()
        weights = luminance(powers).clip(0)
        weights = weights / max(weights.sum(), 1e-9)
        shape = self._canvas.known.shape
        maps = _weighted_sum(self._canvas.visibility, [(directions, weights[:, None])], shape, channels=1)
        return self._scatter(self._to_plate(maps))[..., 0]

    @cached_property
    def albedo(self):
        """(H, W, 3) float32 linear Rec.709 in [0, 1]: the plate's texture without its light; zero outside."""
        return self._scatter(self._albedo)

    @cached_property
    def normals(self):
        """(H, W, 3) float32 unit vectors in the camera frame, at the networks' detail; zero outside."""
        return self._scatter(F.normalize(self._to_plate(self._canvas.normals), dim=1))

    def visibility(self, directions):
        """Self-shadow maps (D, H, W) float32 in [0, 1]: 1 = lit, zero outside the matte.

        `directions` (D, 3) point toward the lights. Raises TypeError or ValueError for a wrong shape or
        dtype, NaN or infinite values, or a direction of zero length.
        """
        maps = self._canvas.visibility(inputs.directions("directions", directions))
        return np.ascontiguousarray(self._scatter(self._to_plate(maps)).transpose(2, 0, 1))

    def shading(self, directions):
        """Diffuse shading (D, H, W) float32 in [0, 1] by one unit light at a time, zero outside the matte.

        `directions` (D, 3) point toward the lights. Linear; 1 is a surface that faces an unoccluded light.
        Raises as `visibility` does.
        """
        maps = self._canvas.shading(inputs.directions("directions", directions))
        return np.ascontiguousarray(self._scatter(self._to_plate(maps)).transpose(2, 0, 1))

    @cached_property
    def _texture(self):
        """The albedo of the subject's pixels, premultiplied (P, 3)."""
        return self._albedo * self._alpha[:, None]

    def _lighting(self, lights):
        """Σ intensity · shading of the subject's pixels (P, 3)."""
        samples = [light.samples() for light in as_lights(lights)]
        canvas = self._canvas
        return self._to_plate(_weighted_sum(canvas.shading, samples, canvas.known.shape, channels=3))

    def _to_plate(self, maps):
        """Canvas maps (C, h, w) to the subject's pixels on the plate (P, C)."""
        return self._enlarge(self._extend(maps))

    def _scatter(self, values):
        """The subject's pixels (P, C) to an image (H, W, C) that is zero elsewhere."""
        image = np.zeros((self._size[0] * self._size[1], values.shape[1]), np.float32)
        torch.from_numpy(image).index_copy_(0, self._where, values)
        return image.reshape(*self._size, -1)


def as_lights(lights):
    """One light or an iterable of lights as a list."""
    lights = [lights] if hasattr(lights, "samples") or hasattr(lights, "at") else lights
    try:
        lights = list(lights)
    except TypeError as error:
        raise TypeError(f"lights: expected lights, got {type(lights).__name__}") from error
    for light in lights:
        if hasattr(light, "at"):
            raise TypeError(
                f"lights: {light.name or 'a light'} moves; give the light of one frame, light.at(frame)"
            )
        if not hasattr(light, "samples"):
            raise TypeError(f"lights: expected lights, e.g. DirectionalLight, got {type(light).__name__}")
    return lights


def by_name(lights):
    """{name: light}, those without a name as `light1`, `light2`...; ValueError if two have one name."""
    lights = as_lights(lights)
    names = [light.name or f"light{number}" for number, light in enumerate(lights, 1)]
    if len(set(names)) < len(names):
        raise ValueError(f"lights: expected different names, got {', '.join(names)}")
    return dict(zip(names, lights, strict=True))


def _weighted_sum(maps, samples, shape, channels):
    """Σ power · maps(direction) on the canvas: (channels, h, w).

    `samples` are directions (D, 3) and powers (D, channels); `maps` takes directions to (D, h, w). The
    result's channels lie together in memory, as the lookup of the enlargement wants them.
    """
    total = torch.zeros(shape.numel(), channels)
    for directions, powers in samples:
        batches = (torch.from_numpy(np.float32(values)).split(BATCH) for values in (directions, powers))
        for batch, power in zip(*batches, strict=True):
            total.addmm_(maps(batch).flatten(1).T, power)
    return total.T.unflatten(1, shape)


def _matte(pixels, mask):
    """The subject's coverage (H, W), from the mask if given, else from the alpha channel."""
    if mask is not None:
        mask = np.asarray(mask)
        if mask.dtype in (np.uint8, np.uint16):
            mask = mask / np.float32(np.iinfo(mask.dtype).max)
        return inputs.mask("mask", mask, pixels.shape[:2])
    if pixels.shape[-1] == 3:
        raise ValueError("mask: the image has no alpha channel, so give the person's matte as a mask")
    if pixels[..., 3].min() == 1:
        raise ValueError("mask: the image is opaque everywhere, so give the person's matte as a mask")
    return inputs.mask("image's alpha", pixels[..., 3], pixels.shape[:2])


def _photograph(pixels):
    """The plate's colour (3, H, W), its own alpha, if any, taken out: what a foreign normals network sees."""
    rgb = torch.from_numpy(np.ascontiguousarray(pixels)).permute(2, 0, 1)
    return rgb[:3] / rgb[3:].clamp_min(FAINT) if len(rgb) == 4 else rgb


def _given_albedo(albedo, size):
    """The caller's albedo as (3, H, W) in [0, 1], checked."""
    pixels = scene_linear("albedo", albedo)
    if pixels.shape != (*size, 3):
        raise ValueError(f"albedo: expected shape {(*size, 3)}, the size of the image, got {pixels.shape}")
    if pixels.min() < 0 or pixels.max() > 1:
        raise ValueError(f"albedo: expected values in [0, 1], got [{pixels.min():g}, {pixels.max():g}]")
    return torch.from_numpy(pixels).permute(2, 0, 1)


def _foreground(pixels, alpha, photographed):
    """The person's own colour (3, H, W), not premultiplied, continued beyond the matte's edge.

    Premultiplied colour is divided by its alpha where there is enough of it. In a photograph with a separate
    mask, partly covered pixels show the background as well: only nearly covered ones are trusted, and those
    beside an empty one, which a hard mask only calls covered, where there are no others near. The rest is
    filled from these by push-pull (Gortler et al. 1996), so that no background, and no black, gets in.
    """
    rgb, own_alpha = pixels[..., :3], pixels[..., 3:]
    matte = alpha.numpy()[..., None]
    known = matte >= (min(CLEAN, matte.max()) if photographed else FAINT)
    if own_alpha.size:
        known &= own_alpha >= FAINT
        rgb = np.divide(rgb, own_alpha, out=np.zeros_like(rgb), where=known)
    if not known.any():
        raise ValueError("mask: the image is transparent where the mask shows a subject")
    if photographed:
        covered, empty = torch.from_numpy(known[None, ..., 0]), alpha[None] == 0
        inner = covered & ~_within(1, empty)
        known = (inner | covered & ~_within(2, inner))[0, ..., None].numpy()
    trusted = np.concatenate([rgb * known, known], axis=-1, dtype=np.float32)
    filled = oiio.ImageBufAlgo.fillholes_pushpull(oiio.ImageBuf(np.ascontiguousarray(trusted))).get_pixels(
        "float"
    )[..., :3]
    return torch.from_numpy(np.where(known, rgb, filled).clip(0)).permute(2, 0, 1)


def _within(reach, pixels):
    """Where (1, H, W) one of these pixels is at most `reach` pixels away."""
    return F.max_pool2d(pixels.float(), 2 * reach + 1, stride=1, padding=reach) > 0


def _crop(framing, colour):
    """Plate colour (3, H, W) on the canvas, as a mean over what the plate covers: no black at its frame."""
    covered = framing.crop(torch.ones_like(colour[:1]))
    return framing.crop(colour) / covered.clamp_min(1e-6) * (covered > 0)


def _display(colour):
    """Exposed linear colour as the eye spaces it, for comparing: about [0, 1]."""
    return colour.clamp(0, 4) ** (1 / 2.2)


def _photographed_shading(framed, albedo, known):
    """The light that the person was photographed in, on the canvas (1, h, w): image over albedo.

    It has no colour, since the albedo has the photograph's. Least squares of image = shading · albedo over
    3 x 3 pixels, drawn toward the mean light where the albedo is too dark to tell. Positive everywhere on the
    subject.
    """
    mean = (framed[:, known].mean() / albedo[:, known].mean().clamp_min(1e-6)).clamp_min(1e-6)
    products = torch.stack([framed * albedo, albedo**2]).mean(dim=1)
    around = F.avg_pool2d(products * known, 3, stride=1, padding=1)
    shading = (around[:1] + DARK * mean) / (around[1:] + DARK)
    return torch.maximum(shading, DEEPEST * mean)
