"""Average the maps of a photograph and of its mirror image, whose errors differ.

Maps are computed at the subject's pixels only, which are about a quarter of the canvas.
"""

import torch
import torch.nn.functional as F

from shadow.networks.backbone import take_blocks
from shadow.torch_settings import own_settings

with own_settings():
    MIRROR = torch.tensor([-1.0, 1.0, 1.0])  # factors that convert a vector to the mirror image's frame
FLIPPED = [1, 0, 3, 2]  # for each pixel of a 2 x 2 block, in the order of `take_blocks`, its mirrored pixel


def with_mirror(images: torch.Tensor) -> torch.Tensor:
    """Return images (1, C, h, w) and their mirror images: (2, C, h, w)."""
    return torch.cat([images, images.flip(-1)])


def mirrored_blocks(blocks: torch.Tensor, width: int) -> torch.Tensor:
    """Return the places in the mirror image of 2 x 2 blocks of an image with an even `width` in pixels."""
    columns = width // 2
    return blocks // columns * columns + columns - 1 - blocks % columns


class Pixels:
    """The pixels of a subject on the canvas: where the mask (h, w) is above zero, N of them, in row order."""

    def __init__(self, mask: torch.Tensor) -> None:
        self.shape = mask.shape
        self.pixels = (mask > 0).flatten().nonzero()[:, 0]  # (N,) on the canvas

    def take(self, maps: torch.Tensor) -> torch.Tensor:
        """Return the values (C, N) of canvas maps (C, h, w)."""
        return maps.flatten(1).index_select(1, self.pixels)

    def scatter(self, values: torch.Tensor) -> torch.Tensor:
        """Return values (C, N) as canvas maps (C, h, w), zero outside the subject."""
        canvas = values.new_zeros(len(values), self.shape.numel())
        return canvas.index_copy_(1, self.pixels, values).unflatten(1, self.shape)


class Silhouette(Pixels):
    """The N pixels of a subject, ordered by their place within a 2 x 2 block first, and by block second.

    The networks write block by block, and in this order the pixels of every second row and column are a
    slice. The canvas has an even number of rows and columns.
    """

    def __init__(self, mask: torch.Tensor) -> None:
        self.shape = mask.shape
        inside = mask > 0
        row, column = F.max_pool2d(inside[None].float(), 2)[0].nonzero(as_tuple=True)
        own = row * (mask.shape[1] // 2) + column
        self.blocks = torch.stack(
            [own, mirrored_blocks(own, mask.shape[1])]
        )  # (2, P) of the photograph and of its mirror image
        number = torch.arange(mask.numel(), device=mask.device).view(1, 1, *mask.shape)
        corners = take_blocks(number, own[None])[0, 0]  # (4, P) pixels of the canvas
        within = inside.flatten()[corners]
        corner, block = within.nonzero(as_tuple=True)
        flipped = torch.tensor(FLIPPED, device=mask.device)[corner]
        # (N,) each, among the pixels of the blocks of the photograph, and of its mirror image
        self._taken = [block * 4 + place for place in (corner, flipped)]
        self.pixels = corners[corner, block]
        self._in_first_corner = int(within[0].sum())

    def sides(self, maps: torch.Tensor) -> list[torch.Tensor]:
        """Return values (C, N) of the photograph and of its mirror image, from block maps (2, C, 4, P).

        From maps (1, C, 4, P), it is the photograph's alone.
        """
        # The networks write the channels of a pixel side by side, so selecting rows is a fast copy.
        pixels = maps.permute(0, 3, 2, 1).flatten(1, 2)
        return [side.index_select(0, taken).T for side, taken in zip(pixels, self._taken, strict=False)]

    def at_half_resolution(self) -> tuple[slice, torch.Tensor]:
        """Return which of the N pixels lie in every second row and column, and their flat indices (n,) in a
        map (h/2, w/2) of these.
        """
        width, chosen = self.shape[1], slice(0, self._in_first_corner)
        row, column = self.pixels[chosen] // width // 2, self.pixels[chosen] % width // 2
        return chosen, row * (width // 2) + column
