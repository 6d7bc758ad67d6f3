"""Random photographs of many records at once, on any device: the batches of `shadow.data.photographs.sample`.

A GPU needs a fraction of a millisecond for a photograph, but single calls for each would keep it waiting for
the processor. So the random numbers are drawn on the processor as for `sample`, and the pictures of a whole
mini-batch are made together, from records that the device holds.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
import torch.nn.functional as F

from shadow.data.photographs import Flaws, Scene, canvas_depth, compress, draw_scene, mask_height, sharpen
from shadow.data.records import ENCODING, REGIONS, Record
from shadow.data.skin import pixels_per_metre, scatter_images
from shadow.framing import affine_sample

IMAGES = "inside", "normals", "albedo", "bits", "depth", "regions"
GROUP = 16  # photographs made at once, since all lights of one take 50 MB and more


class Draw(NamedTuple):
    """The random numbers of one photograph."""

    number: int  # of the record
    scene: Scene
    flaws: Flaws | None  # None for a clean photograph and an exact matte


class Stack:
    """Records that a device holds, as images in the types of their files, to make photographs of."""

    def __init__(self, records: Sequence[Record], size: tuple[int, int], device: torch.device) -> None:
        """Move records to the device, for photographs of `size` (h, w).

        Raises ValueError if the records have different numbers of directions, or bounce light, which only
        shading learns.
        """
        crops = [record.cropped(size[0]) for record in records]
        if any(crop.bounce_float16 is not None for crop in crops):
            raise ValueError("records: expected no bounce light; make them without --shading")
        if len({len(crop.directions) for crop in crops}) != 1:
            raise ValueError("records: expected the same number of directions in all of them")
        self.size, self.device = size, device
        self.shape = tuple(np.max([crop.mask.shape for crop in crops], axis=0).tolist())
        nothing = np.zeros((0, 1))
        # For drawing scenes, which needs no pixels.
        self.outlines = [
            replace(
                crop, normals_int8=nothing, albedo_uint8=nothing, visibility_bits=nothing,
                bounce_float16=None, bounce_patterns=None, depth_float16=None, regions=None,
            )
            for crop in crops
        ]  # fmt: skip
        self.inside, self.normals, self.albedo, self.bits, self.depth, self.regions = self._images(crops)
        depths = [crop.depth_float16 for crop in crops]
        self.directions = torch.from_numpy(np.stack([crop.directions for crop in crops])).to(device)
        self.depth_known = torch.tensor([[float(depth is not None)] for depth in depths], device=device)
        self.heights = torch.tensor([mask_height(crop) for crop in crops], device=device)
        self.scales = torch.tensor([pixels_per_metre(crop) for crop in crops], device=device)

    def _images(self, crops: list[Record]) -> list[torch.Tensor]:
        """Return the fields of the records as images (R, C, H, W) of the stack's size.

        The device puts the pixels in their places, so that the processor only reads files.
        """
        images: list[torch.Tensor] = []
        for number, crop in enumerate(crops):
            count = len(crop.normals_int8)
            depth, regions = crop.depth_float16, crop.regions
            fields = [
                np.ones((count, 1), bool), crop.normals_int8, crop.albedo_uint8, crop.visibility_bits,
                np.zeros((count, 1), np.float16) if depth is None else depth,
                np.zeros((count, 1), np.uint8) if regions is None else regions[:, None],
            ]  # fmt: skip
            values = [torch.from_numpy(field).to(self.device) for field in fields]
            images = images or [
                torch.zeros((len(crops), value.shape[1], *self.shape), dtype=value.dtype, device=self.device)
                for value in values
            ]
            row, column = torch.from_numpy(crop.mask).to(self.device).nonzero(as_tuple=True)
            for image, value in zip(images, values, strict=True):
                image[number].flatten(1)[:, row * self.shape[1] + column] = value.T
        return images

    def __len__(self) -> int:
        return len(self.outlines)

    def extend(self, records: Sequence[Record]) -> None:
        """Add records, which have as many directions as those that are there."""
        other = Stack(records, self.size, self.device)
        if other.directions.shape[1] != self.directions.shape[1]:
            raise ValueError("records: expected the same number of directions in all of them")
        self.shape = max(self.shape[0], other.shape[0]), max(self.shape[1], other.shape[1])
        for name in IMAGES:
            both = [_enlarged(getattr(stack, name), self.shape) for stack in (self, other)]
            setattr(self, name, torch.cat(both))
        for name in ("directions", "depth_known", "heights", "scales"):
            setattr(self, name, torch.cat([getattr(self, name), getattr(other, name)]))
        self.outlines += other.outlines

    def draw(
        self, number: int, rng: np.random.Generator, lights: int | None = None, augment: bool = True
    ) -> Draw:
        """Draw the random numbers of a photograph of a record; the arguments are those of `sample`."""
        scene = draw_scene(self.outlines[number], rng, self.size, lights, augment)
        return Draw(number, scene, Flaws.draw(rng) if augment else None)

    @torch.no_grad()
    def photographs(self, draws: Sequence[Draw]) -> dict[str, torch.Tensor]:
        """Return the tensors of `Sample` with a batch axis, but those of albedo and bounce light.

        They are those of `sample` for the same random numbers, but for the noise, which the device draws.
        """
        groups = [draws[start : start + GROUP] for start in range(0, len(draws), GROUP)]
        made = [self._photographs(group) for group in groups]
        return {name: torch.cat([each[name] for each in made]) for name in made[0]}

    def _photographs(self, draws: Sequence[Draw]) -> dict[str, torch.Tensor]:
        numbers = torch.tensor([draw.number for draw in draws], device=self.device)
        scenes = [draw.scene for draw in draws]
        turns, matrices, weights, chosen = (
            torch.from_numpy(np.stack(each)).to(self.device)
            for each in (
                [scene.turn.astype(np.float32) for scene in scenes],
                [scene.matrix.numpy() for scene in scenes],
                [scene.weights for scene in scenes],
                [scene.chosen for scene in scenes],
            )
        )
        inside = self.inside[numbers].float()
        visibility = _unpacked(self.bits[numbers], self.directions.shape[1])
        normals = self.normals[numbers].float()
        normals = normals / normals.norm(dim=1, keepdim=True).clamp_min(1)
        shown = visibility.gather(1, chosen[:, :, None, None].expand(-1, -1, *self.shape))
        regions = self.regions[numbers] == torch.arange(1, len(REGIONS), device=self.device).view(-1, 1, 1)
        light = self._light(numbers, normals, visibility, weights, regions.any(dim=1, keepdim=True), scenes)
        albedo = (self.albedo[numbers].float() / 255) ** ENCODING
        images = [inside, albedo * light[0] + light[1], normals, self.depth[numbers].float(), regions, shown]
        layers = torch.cat([image.float() for image in images], dim=1)
        placed = zip(layers, [scene.matrix for scene in scenes], strict=True)
        planes = torch.stack([affine_sample(image, matrix, self.size) for image, matrix in placed])
        mask, straight = planes[:, :1], planes[:, 1:] / planes[:, :1].clamp_min(0.02)
        rgb, normals, depth, regions, shown = straight.split(
            [3, 3, 1, len(REGIONS) - 1, len(chosen[0])], dim=1
        )
        frame = torch.eye(3, device=self.device).repeat(len(draws), 1, 1)
        frame[:, :2, :2] = turns
        turned = torch.einsum("bij,bjhw->bihw", frame, normals)
        flaws = [draw.flaws for draw in draws if draw.flaws is not None]
        rgb, matte = _flawed(rgb, mask, flaws) if flaws else (rgb, mask)
        lights = self.directions[numbers].gather(1, chosen[:, :, None].expand(-1, -1, 3))
        return {
            "rgb": rgb,
            "matte": matte,
            "mask": torch.minimum(mask, matte),
            "normals": turned / turned.square().sum(dim=1, keepdim=True).clamp_min(1e-12).sqrt(),
            "visibility": shown.clamp(0, 1),
            "directions": lights @ frame.mT,
            "depth": canvas_depth(depth, mask, self.heights[numbers], matrices),
            "depth_known": self.depth_known[numbers],
            "regions": regions.clamp(0, 1),
        }

    def _light(
        self,
        numbers: torch.Tensor,
        normals: torch.Tensor,
        visibility: torch.Tensor,
        weights: torch.Tensor,
        skin: torch.Tensor,
        scenes: Sequence[Scene],
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the light on white and the highlights, both (B, 3, H, W); see `photographs.light`."""
        lights = self.directions[numbers]
        facing = torch.einsum("bdc,bchw->bdhw", lights, normals).clamp_min_(0).mul_(visibility)
        diffuse = scatter_images(torch.einsum("bdhw,bdc->bchw", facing, weights), skin, self.scales[numbers])
        gloss, shininess = (
            torch.tensor([getattr(scene, name) for scene in scenes], device=self.device)
            .float()
            .view(-1, 1, 1, 1)
            for name in ("gloss", "shininess")
        )
        halves = F.normalize(lights + torch.tensor([0.0, 0.0, 1.0], device=self.device), dim=2)
        peaks = torch.einsum("bdc,bchw->bdhw", halves, normals).clamp_min_(0).pow_(shininess).mul_(visibility)
        bright = weights * (weights.sum(dim=2, keepdim=True) > 0.1)
        return diffuse, gloss * torch.einsum("bdhw,bdc->bchw", peaks, bright)


def _enlarged(images: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Return images (R, C, H, W) with zeros below and to the right, up to `shape`."""
    return F.pad(images, (0, shape[1] - images.shape[3], 0, shape[0] - images.shape[2]))


def _unpacked(bits: torch.Tensor, count: int) -> torch.Tensor:
    """Unpack `count` bits D of (B, ceil(D / 8), H, W), the highest first, as numpy.packbits packs them."""
    shifts = torch.arange(7, -1, -1, device=bits.device, dtype=torch.uint8).view(1, 1, 8, 1, 1)
    return (bits[:, :, None] >> shifts & 1).flatten(1, 2)[:, :count].float()


def _flawed(
    rgb: torch.Tensor, mask: torch.Tensor, flaws: Sequence[Flaws]
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the pictures (B, 3, h, w) and mattes (B, 1, h, w) of linear images and masks; see `Flaws`."""
    each_image = zip(flaws, rgb, mask, strict=True)
    pictures = torch.stack([each.camera(image, inside, each.style) for each, image, inside in each_image])
    for name, change in (("sharpness", sharpen), ("quality", compress)):
        values = {index: getattr(each, name) for index, each in enumerate(flaws)}
        values = {index: value for index, value in values.items() if value is not None}
        if values:
            chosen = torch.tensor(list(values), device=rgb.device)
            given = torch.tensor(list(values.values()), dtype=torch.float32, device=rgb.device)
            pictures[chosen] = change(pictures[chosen], given)
    matte = [
        inside if each.matte is None else each.matte(inside) for each, inside in zip(flaws, mask, strict=True)
    ]
    return pictures, torch.stack(matte)
