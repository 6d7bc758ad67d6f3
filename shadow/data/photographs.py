"""Random photographs of records, with a new random lighting each time (Section 3, "Data Generation")."""

from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F

from shadow.data.lightings import LUMINANCE, everyday_lighting, random_lighting
from shadow.data.records import ENCODING, REGIONS, Record
from shadow.data.skin import scatter
from shadow.framing import Framing, affine_sample, bounding_box

LOCAL_CONTRAST_SIGMA = 0.03  # of the blur that separates local contrast, relative to the picture's height
BLOCK = 16  # pixels of a JPEG's block of colour
MARGIN = 8  # canvas pixels around the subject, to which an inaccurate matte may reach


def light(record: Record, weights: np.ndarray, gloss: float = 0.0, shininess: float = 20.0) -> np.ndarray:
    """Light the record by `weights` (D, 3) and return its linear colour (N, 3).

    The light is direct (Section 3), with bounce light if the record has it, and subsurface scattering on
    skin. `gloss` adds a Blinn-Phong highlight, seen from the camera's axis, that the albedo does not explain.
    """
    # In torch, whose threads the data loader's workers can limit; NumPy's BLAS would use every core.
    normals, visibility = torch.from_numpy(record.normals), torch.from_numpy(record.visibility)
    lights, power = torch.from_numpy(record.directions), torch.from_numpy(weights)
    shining = power.any(dim=1)
    shading = (normals @ lights[shining].T).clamp_min_(0).mul_(visibility[:, shining])
    strength, patterns = map(torch.from_numpy, record.bounce)
    bounced = (strength @ torch.einsum("kdc,dc->kc", patterns, power)).clamp_min_(0)
    colour = torch.from_numpy(record.albedo) * (scatter(record, shading @ power[shining]) + bounced)
    if gloss > 0:
        bright = power.sum(dim=1) > 0.1
        half = F.normalize(lights[bright] + torch.tensor([0.0, 0.0, 1.0]), dim=1)
        peaks = (normals @ half.T).clamp_min_(0).pow_(shininess).mul_(visibility[:, bright])
        colour += gloss * (peaks @ power[bright])
    return colour.numpy()


class PictureStyle(NamedTuple):
    """The tones and colours that cameras, phones and raw converters give to a picture, on encoded values.

    The default changes nothing. Local contrast comes first, then the tone curve, then saturation.
    """

    contrast: float = 0.0  # of a sigmoid from (0, 0) to (1, 1); its slope at the pivot is 1.2 at 3, 1.7 at 6
    pivot: float = 0.5  # encoded value at which the sigmoid is steepest
    saturation: float = 1.0  # factor of the difference from grey
    local_contrast: float = 0.0  # factor added to the difference from the blurred luma

    def __call__(self, encoded: torch.Tensor) -> torch.Tensor:
        """Return the picture (3, H, W) of an encoded picture (3, H, W), both in [0, 1]."""
        if self.local_contrast:
            from kornia.filters import gaussian_blur2d

            luma, sigma = _luma(encoded), LOCAL_CONTRAST_SIGMA * encoded.shape[1]
            kernel = (4 * round(sigma) + 1,) * 2
            blurred = gaussian_blur2d(luma[None], kernel, (sigma, sigma), border_type="replicate")[0]
            encoded = (encoded + self.local_contrast * (luma - blurred)).clamp(0, 1)
        if self.contrast:
            ends = torch.tensor([0.0, 1.0]).to(encoded)
            low, high = torch.sigmoid(self.contrast * (ends - self.pivot))
            encoded = (torch.sigmoid(self.contrast * (encoded - self.pivot)) - low) / (high - low)
        return torch.lerp(_luma(encoded), encoded, self.saturation).clamp(0, 1)


def _luma(encoded: torch.Tensor) -> torch.Tensor:
    """Return the luma (1, H, W) of an encoded picture (3, H, W)."""
    return torch.einsum("chw,c->hw", encoded, torch.from_numpy(LUMINANCE).to(encoded))[None]


def random_style(rng: np.random.Generator) -> PictureStyle:
    """Draw a picture style such as phones and raw converters have."""
    return PictureStyle(
        contrast=rng.uniform(0.5, 6),
        pivot=rng.uniform(0.4, 0.6),
        saturation=float(np.clip(np.exp(rng.normal(0.12, 0.2)), 0.7, 1.6)),
        local_contrast=rng.uniform(0, 0.6),
    )


class Camera(NamedTuple):
    """What is drawn for the camera of `photograph`."""

    tint: np.ndarray  # (3,) factors of the white balance
    exposure: float  # mean of the person's linear colour
    behind: np.ndarray | None  # (3,) linear background at the matte's edge, or the image's own
    shot: float  # noise of a value of 1
    read: float  # noise of a value of 0
    # Standard normal values of the picture's shape; None: drawn where the picture is made.
    noise: np.ndarray | None
    blurred: bool  # as a camera's noise is by demosaicing and compression

    @classmethod
    def draw(cls, rng: np.random.Generator, shape: tuple[int, ...] | None = None) -> "Camera":
        """Draw a camera, and its noise for a picture of a shape (3, H, W)."""
        tint = np.exp(rng.normal(0, 0.08, 3)).astype(np.float32)
        exposure = np.exp(rng.uniform(np.log(0.06), np.log(0.6)))
        behind = rng.uniform(0, 1, 3).astype(np.float32) ** 2 if rng.random() < 0.5 else None
        shot, read = np.exp(rng.uniform(np.log([1e-4, 1e-4]), np.log([2e-2, 4e-3])))
        noise = None if shape is None else rng.standard_normal(shape, np.float32)
        return cls(tint, exposure, behind, shot, read, noise, rng.random() < 0.5)

    def __call__(
        self, rgb: torch.Tensor, mask: torch.Tensor, style: PictureStyle | None = None
    ) -> torch.Tensor:
        """Return the picture (3, H, W) of a linear image of that shape, on any device; see `photograph`."""
        mean = (rgb * mask).sum() / (3 * mask.sum()).clamp_min(1)
        tint = torch.from_numpy(self.tint).view(3, 1, 1).to(rgb.device)
        rgb = rgb * tint * (self.exposure / mean.clamp_min(1e-6))
        if self.behind is not None:
            rgb = torch.lerp(torch.from_numpy(self.behind).view(3, 1, 1).to(rgb.device), rgb, mask)
        noise = torch.randn_like(rgb) if self.noise is None else torch.from_numpy(self.noise)
        if self.blurred:
            noise = F.avg_pool2d(noise, 3, stride=1, padding=1) * 2
        rgb = rgb + noise * (self.shot**2 * rgb.clamp_min(0) + self.read**2).sqrt()
        encoded = rgb.clamp(0, 1) ** (1 / ENCODING)
        if style is not None:
            encoded = style(encoded)
        return ((encoded * 255).round() / 255) ** ENCODING


def photograph(
    rgb: torch.Tensor, mask: torch.Tensor, rng: np.random.Generator, style: PictureStyle | None = None
) -> torch.Tensor:
    """Simulate a camera that sees a linear image (3, H, W), and return its picture as a linear image.

    The camera applies exposure, white balance, background colour at the matte's edge, sensor noise, clipping,
    its picture style and quantisation to 8 bits.
    """
    return Camera.draw(rng, tuple(rgb.shape))(rgb, mask, style)


def compress(rgb: torch.Tensor, quality: float | torch.Tensor) -> torch.Tensor:
    """Compress a linear image (3, H, W) as JPEG of a quality in [1, 100]. H and W are multiples of 16.

    Images (B, 3, H, W) have a quality each, (B,).
    """
    from kornia.enhance import jpeg_codec_differentiable

    encoded = rgb.clamp(0, 1) ** (1 / ENCODING)
    images, qualities = encoded.view(-1, *encoded.shape[-3:]), torch.as_tensor(quality).float().view(-1)
    return jpeg_codec_differentiable(images, qualities.to(rgb.device)).view(rgb.shape).clamp(0, 1) ** ENCODING


def sharpen(rgb: torch.Tensor, factor: float | torch.Tensor) -> torch.Tensor:
    """Sharpen a linear image (3, H, W) by a `factor` above 1, or blur it by a `factor` in [0, 1).

    The filter has 3 x 3 pixels and works on the encoded image. Images (B, 3, H, W) have a factor each, (B,).
    """
    from kornia.enhance import sharpness

    return sharpness(rgb.clamp(0, 1) ** (1 / ENCODING), factor) ** ENCODING


class MatteError(NamedTuple):
    """What makes an inaccurate matte of a mask, such as a matting tool makes.

    Its edge is soft or hard, and lies inside or outside the subject's edge by up to 1 % of the height.
    Thinner parts are lost, and thinner gaps are filled.
    """

    reach: float  # of the soft edge, relative to the height
    level: np.ndarray  # (1, 1, 9, 7) value of the softened mask at which the edge lies, over the picture
    slope: float  # of the edge

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "MatteError":
        reach = rng.uniform(0.004, 0.012)
        level = rng.uniform(0.15, 0.85, (1, 1, 9, 7)).astype(np.float32)
        return cls(reach, level, np.exp(rng.uniform(np.log(3.5), np.log(12))))

    def __call__(self, mask: torch.Tensor) -> torch.Tensor:
        """Return the matte (1, H, W) of a mask (1, H, W)."""
        side = 2 * round(self.reach * mask.shape[1]) + 1
        soft = F.avg_pool2d(mask, side, stride=1, padding=side // 2, count_include_pad=False)
        level = torch.from_numpy(self.level).to(mask.device)
        level = F.interpolate(level, mask.shape[1:], mode="bilinear", align_corners=True)[0]
        return ((soft - level) * self.slope + 0.5).clamp(0, 1)


class Sample(dict):
    """Tensors of one training example, on the canvas and in its (possibly rotated) camera frame.

    All but the photograph and the matte are valid inside the mask only.

    - rgb (3, h, w): the linear photograph.
    - matte (1, h, w): the second input of the network.
    - mask (1, h, w): the intersection of the subject and the matte.
    - normals (3, h, w), unit; albedo (3, h, w), linear.
    - directions (L, 3); visibility (L, h, w) in [0, 1].
    - weights (L, 3): the light from each direction in the photograph.
    - bounce_patterns (L, K) and bounce (K, h, w), whose product is the bounce light in Rec.709 luminance.
    - depth (1, h, w): away from the camera, relative to its mean in the mask, in units of the mask's height
      on this canvas; depth_known (1,). Both are zero if the record has no depth.
    - regions (2, h, w): the fraction of each pixel that belongs to a face, and to hands; zero if the record
      has no regions.
    """


class Scene(NamedTuple):
    """What is drawn for one photograph, besides its camera."""

    weights: np.ndarray  # (D, 3) of the lighting
    chosen: np.ndarray  # (L,) directions whose visibility is returned
    gloss: float
    shininess: float
    turn: np.ndarray  # (2, 2) rotation and reflection of the picture, x right and y up
    matrix: torch.Tensor  # (2, 3) from canvas to record


def draw_scene(
    record: Record,
    rng: np.random.Generator,
    size: tuple[int, int],
    lights: int | None = None,
    augment: bool = True,
    lighting: np.ndarray | None = None,
) -> Scene:
    """Draw the light and the place on the canvas of a photograph; the arguments are those of `sample`."""
    draw = everyday_lighting if augment else random_lighting
    weights = draw(rng, record.directions) if lighting is None else lighting
    chosen, shining = rng.permutation(len(record.directions)), np.any(weights, axis=1)
    if lights is not None and shining.sum() <= lights:
        chosen = chosen[np.argsort(~shining[chosen], kind="stable")]
    chosen = np.sort(chosen[:lights])
    gloss = rng.choice([0.0, rng.uniform(0.02, 0.2)], p=[0.7, 0.3])
    shininess = np.exp(rng.uniform(2, 4))
    return Scene(weights, chosen, gloss, shininess, *_placement(record, rng, size, augment))


def sample(
    record: Record,
    rng: np.random.Generator,
    size: tuple[int, int],
    lights: int | None = None,
    augment: bool = True,
    lighting: np.ndarray | None = None,
) -> Sample:
    """Draw a random photograph of the record and its ground truth, framed on a canvas of `size` (h, w).

    `lights` directions are drawn from the record's set, those that light the photograph first; None uses all
    of them in order. With `augment` the picture is flipped, rotated in the image plane, scaled and moved, and
    normals and directions rotate with it. `lighting` (D, 3) are the weights of the record's directions, drawn
    if None.
    """
    record = record.cropped(size[0])
    weights, chosen, gloss, shininess, turn, matrix = draw_scene(record, rng, size, lights, augment, lighting)
    bounce, patterns = record.bounce
    rank, traced = bounce.shape[1], record.bounce_float16 is not None
    depth = np.zeros((record.mask.sum(), 1), np.float32) if record.depth is None else record.depth
    values = [
        np.ones((record.mask.sum(), 1), np.float32),
        light(record, weights, gloss, shininess),
        record.normals,
        record.albedo,
        bounce if traced else bounce[:, :0],
        depth,
        record.shares,
        record.visibility[:, chosen],
    ]
    rows, columns = window_of(record, matrix, size)
    matrix = torch.cat([matrix[:, :2], matrix @ torch.tensor([[columns.start], [rows.start], [1.0]])], dim=1)
    window = rows.stop - rows.start, columns.stop - columns.start
    planes = affine_sample(record.image(np.concatenate(values, axis=1)), matrix, window)
    mask = planes[:1]
    straight = planes[1:] / mask.clamp_min(0.02)  # bilinear sampling has premultiplied by the mask
    channels = [3, 3, 3, rank if traced else 0, 1, len(REGIONS) - 1, len(chosen)]
    rgb, normals, albedo, bounce, depth, regions, visibility = straight.split(channels)
    frame = torch.eye(3)
    frame[:2, :2] = torch.from_numpy(turn)
    turned = torch.einsum("ij,jhw->ihw", frame, normals)
    rgb, matte = Flaws.draw(rng, tuple(rgb.shape))(rgb, mask) if augment else (rgb, mask)
    images = {
        "rgb": rgb,
        "matte": matte,
        "mask": torch.minimum(mask, matte),
        "normals": turned / turned.square().sum(dim=0).clamp_min(1e-12).sqrt(),
        "albedo": albedo.clamp(0, 1),
        "visibility": visibility.clamp(0, 1),
        "bounce": bounce if traced else bounce.new_zeros(rank, *window),
        "depth": canvas_depth(depth[None], mask[None], torch.tensor([mask_height(record)]), matrix[None])[0],
        "regions": regions.clamp(0, 1),
    }
    around = columns.start, size[1] - columns.stop, rows.start, size[0] - rows.stop
    return Sample(
        {name: F.pad(image, around) for name, image in images.items()},
        directions=torch.from_numpy(record.directions[chosen]) @ frame.T,
        weights=torch.from_numpy(weights[chosen]),
        depth_known=torch.tensor([float(record.depth is not None)]),
        bounce_patterns=torch.from_numpy(patterns[:, chosen] @ LUMINANCE).T.contiguous(),
    )


def window_of(record: Record, matrix: torch.Tensor, size: tuple[int, int]) -> tuple[slice, slice]:
    """Return the rows and columns of the canvas that a cropped record reaches, and a margin.

    The rest of the canvas is empty, and half of it usually is. The edges are multiples of BLOCK.
    """
    height, width = record.mask.shape
    corners = torch.tensor([[0, 0], [width, 0], [0, height], [width, height]]).float()
    reached = torch.linalg.solve(matrix[:, :2], (corners - matrix[:, 2]).T)  # (2, 4), x and y on the canvas
    low, high = (reached.amin(dim=1) - MARGIN) // BLOCK, -((reached.amax(dim=1) + MARGIN) // -BLOCK)
    (left, top), (right, bottom) = (low * BLOCK).int().tolist(), (high * BLOCK).int().tolist()
    return _within(top, bottom, size[0]), _within(left, right, size[1])


def _within(start: int, stop: int, extent: int) -> slice:
    """Return the part of a span that lies in [0, extent], and at least BLOCK of it."""
    start = min(max(start, 0), extent - BLOCK)
    return slice(start, max(min(stop, extent), start + BLOCK))


def mask_height(record: Record) -> float:
    """Return the height of the record's mask in its pixels."""
    top, _, bottom, _ = bounding_box(torch.from_numpy(record.mask))
    return float(bottom - top)


def canvas_depth(
    depth: torch.Tensor, mask: torch.Tensor, heights: torch.Tensor, matrices: torch.Tensor
) -> torch.Tensor:
    """Convert depth (B, 1, h, w) in units of the height of the records' masks to the unit of `Sample`.

    The canvas may show a part of the subject, or show it larger. mask: (B, 1, h, w). heights: (B,), see
    `mask_height`. matrices: (B, 2, 3) from canvas to record.
    """
    inside = mask > 0.5
    mean = (depth * inside).sum(dim=(1, 2, 3)) / inside.sum(dim=(1, 2, 3)).clamp_min(1)
    rows = inside.any(dim=3)[:, 0].float()
    first, last = rows.argmax(dim=1), rows.shape[1] - rows.flip(1).argmax(dim=1)
    magnification = torch.linalg.det(matrices[:, :, :2]).abs().rsqrt()
    unit = (magnification * heights / (last - first)).view(-1, 1, 1, 1)
    return (depth - mean.view(-1, 1, 1, 1)) * unit * (mask > 0) * rows.any(dim=1).view(-1, 1, 1, 1)


def _placement(
    record: Record, rng: np.random.Generator, size: tuple[int, int], augment: bool
) -> tuple[np.ndarray, torch.Tensor]:
    """Draw the placement of the record on a canvas of `size` (h, w).

    Returns the rotation (2, 2) of the picture, x right and y up, and the matrix (2, 3) from canvas to record
    that `affine_sample` takes.
    """
    framing = Framing.around(torch.from_numpy(record.mask), size[0])
    turn = np.eye(2)
    scale, shift = 1.0, np.zeros(2)
    if augment:
        angle = np.radians(np.clip(rng.normal(0, 12), -40, 40))
        below, beside = record.mask[-1].any(), record.mask[:, [0, -1]].any()
        if beside:  # the canvas is narrow: a large rotation would show the vertical edge of the frame
            angle /= 4
        flip = rng.choice([-1.0, 1.0])
        turn = np.diag([flip, 1]) @ [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        scale = np.exp(rng.normal(0, 0.08))
        shift = rng.normal(0, 0.03, 2) * size[0]
        if below:  # keep the lower edge of the frame, which rotates with the body, outside
            shift[1] -= abs(np.sin(angle)) * size[1] / 2
        if below or rng.random() < 0.15:  # a portrait: the frame cuts the body
            zoom = rng.uniform(1.05, 1.5) if below else rng.uniform(1.3, 2.6)
            scale *= zoom
            shift[1] -= (zoom - 1) * rng.uniform(0.2, 0.45) * size[0]  # toward the head
    # From canvas to record, in pixels with y down: the inverse of the rotation, then of the scale.
    downward = np.diag([1.0, -1.0])
    linear = downward @ turn.T @ downward / (scale * framing.scale)
    offset = np.array(framing.centre) - linear @ (np.array([size[1], size[0]]) / 2 + shift * [1, -1])
    matrix = torch.from_numpy(np.concatenate([linear, offset[:, None]], axis=1)).float()
    return turn, matrix


class Flaws(NamedTuple):
    """What is drawn for the camera and the matte of a photograph that is trained on."""

    style: PictureStyle | None
    camera: Camera
    sharpness: float | None  # factor of `sharpen`
    quality: float | None  # of `compress`
    matte: MatteError | None

    @classmethod
    def draw(cls, rng: np.random.Generator, shape: tuple[int, ...] | None = None) -> "Flaws":
        """Draw them, with the noise of a picture of a shape (3, H, W)."""
        return cls(
            random_style(rng) if rng.random() < 1 / 3 else None,
            Camera.draw(rng, shape),
            rng.uniform(0, 4) if rng.random() < 0.3 else None,
            rng.uniform(30, 95) if rng.random() < 0.3 else None,
            MatteError.draw(rng) if rng.random() < 0.3 else None,
        )

    def __call__(self, rgb: torch.Tensor, mask: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the picture (3, h, w) and the matte (1, h, w) of a linear image and its mask."""
        rgb = self.camera(rgb, mask, self.style)
        if self.sharpness is not None:
            rgb = sharpen(rgb, self.sharpness)
        if self.quality is not None:
            rgb = compress(rgb, self.quality)
        return rgb, mask if self.matte is None else self.matte(mask)
