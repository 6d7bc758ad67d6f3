"""Random photographs of records, lit anew each time one is drawn (Section 3, "Data Generation")."""

from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from kornia.enhance import jpeg_codec_differentiable, sharpness

from shadow.data.records import ENCODING, REGIONS, Record
from shadow.data.skin import scattered
from shadow.directions import from_spherical
from shadow.framing import Framing, affine_sample, bounding_box

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)  # of linear Rec.709 (ITU-R BT.709)
KINDS = ("hard", "sky", "any")  # of everyday light


def random_lighting(rng: np.random.Generator, directions: np.ndarray, unfilled: float = 0.0) -> np.ndarray:
    """Weights (D, 3) of a random lighting over `directions` (D, 3): any mixture is weights over the set.

    One to four hard lights, each of its own colour, above an ambient environment that varies slowly with
    direction. Real photographs go from one to the other, so the share of hard light does too. `unfilled` of
    the lightings, a share in [0, 1], have no ambient light, as on a dark stage.
    """
    hard = np.zeros((len(directions), 3), np.float32)
    for _ in range(rng.choice([1, 2, 3, 4], p=[0.5, 0.3, 0.12, 0.08])):
        # Key lights stand above and before the subject more often than not.
        odds = np.exp(1.0 * directions[:, 2] + 0.7 * directions[:, 1])
        tint = np.exp(rng.normal(0, 0.15, 3))
        hard[rng.choice(len(directions), p=odds / odds.sum())] += rng.uniform(0.3, 1.0) * tint
    axis = rng.normal(size=(3, 3))  # a main direction and two lesser ones
    axis[0, 1] = abs(axis[0, 1]) + 0.5  # light comes from above more often
    cosines = directions @ axis.T / np.linalg.norm(axis, axis=1)
    lobes = rng.uniform(0.05, 0.3) + np.exp(rng.uniform(0, 3, 3) * (cosines - 1))
    lobes[np.arange(len(directions)) % 3 != rng.integers(3)] = 0  # a third of the samples is enough
    soft = lobes * rng.uniform(0, 1, 3) @ np.exp(rng.normal(0, 0.12, (3, 3)))
    soft = soft / soft.sum(axis=0).mean()
    share = rng.choice([rng.uniform(0.6, 0.95), rng.uniform(0, 0.6), 0.0], p=[0.5, 0.3, 0.2])
    if unfilled and rng.random() < unfilled:
        share = 1.0
    return (share * hard / hard.sum() * 3 + (1 - share) * 4 * soft).astype(np.float32)


def everyday_lighting(
    rng: np.random.Generator, directions: np.ndarray, kind: str | None = None
) -> np.ndarray:
    """Weights (D, 3) of a random lighting over `directions` (D, 3), as pictures that are relit were taken in.

    A third are "hard", one or two lamps or the sun, with 0 to 10 % of ambient light; a third "sky", with a
    large key; a third "any", as of `random_lighting`. In the first two the key is as warm as lamps and a low
    sun are, the sky bluer than it, and the ground throws the key's light back, warmer still. `kind`: one of
    KINDS, drawn if None.
    """
    kind = rng.choice(KINDS) if kind is None else kind
    if kind == "any":
        return random_lighting(rng, directions, unfilled=0.1)
    odds = np.exp(1.0 * directions[:, 2] + 0.7 * directions[:, 1])
    count = rng.choice([1, 2], p=[0.65, 0.35]) if kind == "hard" else 1
    keys = rng.choice(len(directions), size=count, replace=False, p=odds / odds.sum())
    warmth = rng.uniform(-0.1, 0.6, count)
    key = np.zeros((len(directions), 3))
    if kind == "hard":
        share = 1 - rng.choice([0, rng.uniform(0, 0.1)], p=[0.25, 0.75])
        key[keys] = _warm(warmth) * rng.uniform(0.3, 1.0, (count, 1))
    else:
        share = rng.uniform(0.2, 0.65)
        breadth = rng.uniform(6, 20)  # half its strength 28 to 15 degrees from its middle
        key = np.exp(breadth * (directions @ directions[keys[0]] - 1))[:, None] * _warm(warmth)
        key[key.sum(axis=1) < 0.05] = 0  # what is faint costs time and is not seen
    up = directions[:, 1:2]
    ground = rng.uniform(0.05, 0.35) * _warm(warmth[:1] + rng.uniform(0, 0.25))
    sky = (0.55 + 0.45 * up) ** rng.uniform(0.5, 2) * _warm(warmth[:1] - rng.uniform(0.05, 0.7))
    ambient = sky + np.maximum(-up, 0) * ground
    ambient[np.arange(len(directions)) % 3 != rng.integers(3)] = 0  # a third of the samples is enough
    ambient *= 3 / ambient.sum()
    # Of what comes from all around, a surface gets a quarter: so much more of it is as bright as the key.
    return (share * key / key.sum() * 3 + (1 - share) * 4 * ambient).astype(np.float32)


def _warm(warmth: np.ndarray) -> np.ndarray:
    """Linear Rec.709 (N, 3) of luminance 1, of lights of warmth (N,): about 0.6 at 3000 K, 0 at 6500 K, -0.2
    at 9000 K."""
    colour = np.exp(np.asarray(warmth)[:, None] * [0.9, 0.0, -1.7])
    return colour / (colour @ LUMINANCE)[:, None]


def softbox(directions: np.ndarray, azimuth: float = 40.0, elevation: float = 35.0) -> np.ndarray:
    """Weights (D,) of a large softbox over `directions` (D, 3), which sum to one: a lobe that has half its
    strength 24 degrees from where the softbox stands, by default at upper right."""
    lobe = np.exp(8 * (directions @ from_spherical(azimuth, elevation) - 1))
    return lobe / lobe.sum()


def light(record: Record, weights: np.ndarray, gloss: float = 0.0, shininess: float = 20.0) -> np.ndarray:
    """The record photographed under `weights` (D, 3): linear colour (N, 3), by direct light (Section 3) and,
    if that was traced, by what bounces of it. On skin the direct light is `scattered`.

    `gloss` adds a Blinn-Phong highlight, seen from the camera axis, that the albedo does not explain.
    """
    # In torch, whose threads the data loader's workers can limit; BLAS behind NumPy takes every core.
    normals, visibility = torch.from_numpy(record.normals), torch.from_numpy(record.visibility)
    lights, power = torch.from_numpy(record.directions), torch.from_numpy(weights)
    shining = power.any(dim=1)
    shading = (normals @ lights[shining].T).clamp_min_(0).mul_(visibility[:, shining])
    strength, patterns = map(torch.from_numpy, record.bounce)
    bounced = (strength @ torch.einsum("kdc,dc->kc", patterns, power)).clamp_min_(0)
    colour = torch.from_numpy(record.albedo) * (scattered(record, shading @ power[shining]) + bounced)
    if gloss > 0:
        bright = power.sum(dim=1) > 0.1
        half = F.normalize(lights[bright] + torch.tensor([0.0, 0.0, 1.0]), dim=1)
        peaks = (normals @ half.T).clamp_min_(0).pow_(shininess).mul_(visibility[:, bright])
        colour += gloss * (peaks @ power[bright])
    return colour.numpy()


def photograph(rgb: torch.Tensor, mask: torch.Tensor, rng: np.random.Generator) -> torch.Tensor:
    """A linear image (3, H, W) as a camera would deliver it: exposure, white balance, a background shining
    through the matte's edge, sensor noise, clipping, 8 bits; linear again."""
    mean = (rgb * mask).sum() / (3 * mask.sum()).clamp_min(1)
    tint = torch.from_numpy(np.exp(rng.normal(0, 0.08, 3)).astype(np.float32)).view(3, 1, 1)
    rgb = rgb * tint * (np.exp(rng.uniform(np.log(0.06), np.log(0.6))) / mean.clamp_min(1e-6))
    if rng.random() < 0.5:
        behind = torch.from_numpy(rng.uniform(0, 1, 3).astype(np.float32) ** 2).view(3, 1, 1)
        rgb = torch.lerp(behind, rgb, mask)
    shot, read = np.exp(rng.uniform(np.log([1e-4, 1e-4]), np.log([2e-2, 4e-3])))
    noise = torch.from_numpy(rng.standard_normal(rgb.shape, np.float32))
    if rng.random() < 0.5:  # a camera's noise is blurred by demosaicing and compression
        noise = F.avg_pool2d(noise, 3, stride=1, padding=1) * 2
    rgb = rgb + noise * (shot**2 * rgb.clamp_min(0) + read**2).sqrt()
    encoded = rgb.clamp(0, 1) ** (1 / ENCODING)
    return ((encoded * 255).round() / 255) ** ENCODING


def compress(rgb: torch.Tensor, quality: float) -> torch.Tensor:
    """A linear image (3, H, W) after a JPEG file of this quality in [1, 100]; sides are multiples of 16."""
    encoded = rgb.clamp(0, 1) ** (1 / ENCODING)
    return jpeg_codec_differentiable(encoded[None], torch.tensor([float(quality)]))[0].clamp(0, 1) ** ENCODING


def sharpen(rgb: torch.Tensor, factor: float) -> torch.Tensor:
    """A linear image (3, H, W) as a camera sharpens it by a `factor` above 1, or as a lens blurs it by one in
    [0, 1): 3 x 3 pixels on the encoded image."""
    return sharpness(rgb.clamp(0, 1) ** (1 / ENCODING), factor) ** ENCODING


def rough_matte(mask: torch.Tensor, rng: np.random.Generator) -> torch.Tensor:
    """A matte (1, H, W) as somebody's tool cuts it: here inside the subject's edge, there outside, by up to a
    hundredth of the height; the edge soft or hard, and what is thinner than that lost or filled."""
    reach = 2 * round(rng.uniform(0.004, 0.012) * mask.shape[1]) + 1
    soft = F.avg_pool2d(mask, reach, stride=1, padding=reach // 2, count_include_pad=False)
    level = torch.from_numpy(rng.uniform(0.15, 0.85, (1, 1, 9, 7)).astype(np.float32))
    level = F.interpolate(level, mask.shape[1:], mode="bilinear", align_corners=True)[0]
    return ((soft - level) * np.exp(rng.uniform(np.log(3.5), np.log(12))) + 0.5).clamp(0, 1)


class Sample(dict):
    """Tensors of one training example, all in the canvas and its (possibly turned) camera frame.

    rgb (3, h, w) linear photograph; matte (1, h, w), which a network is given with it; mask (1, h, w), where
    the subject is and the matte says so; normals (3, h, w) unit; albedo (3, h, w) linear; directions (L, 3);
    visibility (L, h, w) in [0, 1]; weights (L, 3), what each direction shone with in the photograph. Bounce
    light, in Rec.709 luminance, is bounce_patterns (L, K) times bounce (K, h, w). depth (1, h, w), away from
    the camera, is relative to its mean in the mask, in units of the height that the mask has here; it is
    zero, and depth_known (1,) too, where the record has none. regions (2, h, w): the share of each pixel that
    is of a face, and of hands; zero where the record does not say. What is not the photograph's holds inside
    the mask.
    """


def sample(
    record: Record,
    rng: np.random.Generator,
    size: tuple[int, int],
    lights: int | None = None,
    augment: bool = True,
    lighting: np.ndarray | None = None,
) -> Sample:
    """A random photograph of the record, with its truth, framed on a canvas of `size` (h, w).

    `lights` directions are drawn from the record's set (all of them, in order, if None), those that light the
    photograph among them if there is room. With `augment` the picture is flipped, turned in the image plane,
    scaled and moved, and normals and directions turn with it. `lighting`, weights (D, 3) over the record's
    directions, is drawn if None.
    """
    record = record.cropped(size[0])
    count = len(record.directions)
    weights: Any = lighting
    if weights is None:
        draw = everyday_lighting if augment else random_lighting
        weights = draw(rng, record.directions)
    chosen, shining = rng.permutation(count), weights.any(axis=1)
    if lights is not None and shining.sum() <= lights:
        chosen = chosen[np.argsort(~shining[chosen], kind="stable")]
    chosen = np.sort(chosen[:lights])
    gloss = rng.choice([0.0, rng.uniform(0.02, 0.2)], p=[0.7, 0.3])
    bounce, patterns = record.bounce
    depth = np.zeros((record.mask.sum(), 1), np.float32) if record.depth is None else record.depth
    values = [
        np.ones((record.mask.sum(), 1), np.float32),
        light(record, weights, gloss, np.exp(rng.uniform(2, 4))),
        record.normals,
        record.albedo,
        bounce,
        depth,
        record.shares,
        record.visibility[:, chosen],
    ]
    turn, matrix = _movement(record, rng, size, augment)
    planes = affine_sample(record.image(np.concatenate(values, axis=1)), matrix, size)
    mask = planes[:1]
    straight = planes[1:] / mask.clamp_min(0.02)  # bilinear sampling premultiplied by the mask
    channels = [3, 3, 3, bounce.shape[1], 1, len(REGIONS) - 1, len(chosen)]
    rgb, normals, albedo, bounce, depth, regions, visibility = straight.split(channels)
    frame = torch.eye(3)
    frame[:2, :2] = torch.from_numpy(turn)
    turned = torch.einsum("ij,jhw->ihw", frame, normals)
    rgb, matte = _delivered(rgb, mask, rng) if augment else (rgb, mask)
    return Sample(
        rgb=rgb,
        matte=matte,
        mask=torch.minimum(mask, matte),
        normals=turned / turned.square().sum(dim=0).clamp_min(1e-12).sqrt(),
        albedo=albedo.clamp(0, 1),
        directions=torch.from_numpy(record.directions[chosen]) @ frame.T,
        visibility=visibility.clamp(0, 1),
        weights=torch.from_numpy(weights[chosen]),
        bounce=bounce,
        depth=_depth_on(depth, mask, record, matrix),
        depth_known=torch.tensor([float(record.depth is not None)]),
        regions=regions.clamp(0, 1),
        bounce_patterns=torch.from_numpy(patterns[:, chosen] @ LUMINANCE).T.contiguous(),
    )


def _depth_on(depth: torch.Tensor, mask: torch.Tensor, record: Record, matrix: torch.Tensor) -> torch.Tensor:
    """Depth (1, h, w) in units of the record's height, as Sample has it: less of the subject may show, or
    show larger. mask: (1, h, w). matrix: (2, 3) from canvas to record."""
    inside = mask > 0.5
    if not inside.any():
        return torch.zeros_like(depth)
    (top, _, bottom, _), (upper, _, lower, _) = map(bounding_box, (torch.from_numpy(record.mask), mask[0]))
    magnification = float(torch.linalg.det(matrix[:, :2]).abs().rsqrt())
    return (depth - depth[inside].mean()) * magnification * (bottom - top) / (lower - upper) * (mask > 0)


def _movement(
    record: Record, rng: np.random.Generator, size: tuple[int, int], augment: bool
) -> tuple[np.ndarray, torch.Tensor]:
    """How the record lies on a canvas of `size` (h, w): the turn (2, 2) of the picture, x right and y up, and
    the matrix (2, 3) that `affine_sample` takes from canvas to record."""
    framing = Framing.around(torch.from_numpy(record.mask), size[0])
    turn = np.eye(2)
    scale, shift = 1.0, np.zeros(2)
    if augment:
        angle = np.radians(np.clip(rng.normal(0, 12), -40, 40))
        below, beside = record.mask[-1].any(), record.mask[:, [0, -1]].any()
        if beside:  # the canvas is narrow: turned far, it would show the frame's upright edge
            angle /= 4
        flip = rng.choice([-1.0, 1.0])
        turn = np.diag([flip, 1]) @ [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        scale = np.exp(rng.normal(0, 0.08))
        shift = rng.normal(0, 0.03, 2) * size[0]
        if below:  # what is turned with the body, the frame's edge, stays outside
            shift[1] -= abs(np.sin(angle)) * size[1] / 2
        if below or rng.random() < 0.15:  # a portrait: the frame cuts the body
            zoom = rng.uniform(1.05, 1.5) if below else rng.uniform(1.3, 2.6)
            scale *= zoom
            shift[1] -= (zoom - 1) * rng.uniform(0.2, 0.45) * size[0]  # toward the head
    # Canvas to record, in pixels with y down: the inverse of turn, then of scale.
    downward = np.diag([1.0, -1.0])
    linear = downward @ turn.T @ downward / (scale * framing.scale)
    offset = np.array(framing.centre) - linear @ (np.array([size[1], size[0]]) / 2 + shift * [1, -1])
    matrix = torch.from_numpy(np.concatenate([linear, offset[:, None]], axis=1)).float()
    return turn, matrix


def _delivered(
    rgb: torch.Tensor, mask: torch.Tensor, rng: np.random.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    """A linear image (3, h, w) and its mask (1, h, w) as a camera and a matting tool deliver them."""
    rgb, matte = photograph(rgb, mask, rng), mask
    if rng.random() < 0.3:
        rgb = sharpen(rgb, rng.uniform(0, 4))
    if rng.random() < 0.3:
        rgb = compress(rgb, rng.uniform(30, 95))
    if rng.random() < 0.3:
        matte = rough_matte(mask, rng)
    return rgb, matte
