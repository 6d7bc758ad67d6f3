"""A photograph and its mirror image, seen together: the mean of what a network says of the two.

A network's errors in the one are others than in the other. Both are asked for the subject's pixels alone,
which are some quarter of the canvas.
"""

import torch
import torch.nn.functional as F

from shadow.networks.backbone import take_blocks

MIRROR = torch.tensor([-1.0, 1.0, 1.0])  # takes a vector to the camera frame of the mirrored picture
FLIPPED = [1, 0, 3, 2]  # the pixels of a 2 x 2 block, in `take_blocks`' order, as the mirror image has them


def with_mirror(images: torch.Tensor) -> torch.Tensor:
    """(1, C, h, w) to (2, C, h, w): the images, and their mirror images."""
    return torch.cat([images, images.flip(-1)])


class Pixels:
    """The pixels of a subject on the canvas: where the mask (h, w) is above zero, N of them, in row order."""

    def __init__(self, mask: torch.Tensor) -> None:
        self.shape = mask.shape
        self.pixels = (mask > 0).flatten().nonzero()[:, 0]  # (N,) on the canvas

    def take(self, maps: torch.Tensor) -> torch.Tensor:
        """The values (C, N) of canvas maps (C, h, w)."""
        return maps.flatten(1).index_select(1, self.pixels)

    def scatter(self, values: torch.Tensor) -> torch.Tensor:
        """Values (C, N) as canvas maps (C, h, w), zero outside the subject."""
        canvas = values.new_zeros(len(values), self.shape.numel())
        return canvas.index_copy_(1, self.pixels, values).unflatten(1, self.shape)


class Silhouette(Pixels):
    """The same pixels, N of them, in the order in which the networks write them.

    The canvas has an even number of rows and columns. The order of the pixels is this class's own: by their
    place in their block of 2 x 2 pixels, then by block, since the networks write block by block.
    """

    def __init__(self, mask: torch.Tensor) -> None:
        self.shape = mask.shape
        inside = mask > 0
        row, column = F.max_pool2d(inside[None].float(), 2)[0].nonzero(as_tuple=True)
        columns = mask.shape[1] // 2
        own, mirrored = row * columns + column, row * columns + columns - 1 - column
        self.blocks = torch.stack([own, mirrored])  # (2, P) of the photograph and of its mirror image
        number = torch.arange(mask.numel(), device=mask.device).view(1, 1, *mask.shape)
        corners = take_blocks(number, own[None])[0, 0]  # (4, P) pixels of the canvas
        within = inside.flatten()[corners]
        corner, block = within.nonzero(as_tuple=True)
        flipped = torch.tensor(FLIPPED, device=mask.device)[corner]
        # (N,) each, among the pixels of the blocks of the photograph, and of its mirror image
        self._taken = [place * len(own) + block for place in (corner, flipped)]
        self.pixels = corners.flatten()[self._taken[0]]
        self._halves = [0, *within[:2].sum(dim=1).cumsum(0).tolist()]

    def sides(self, maps: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The values (C, N) of the photograph and of its mirror image, of maps (2, C, 4, P) of the blocks."""
        own, mirrored = (
            side.flatten(1).index_select(1, taken) for side, taken in zip(maps, self._taken, strict=True)
        )
        return own, mirrored

    def halved(self, column: int) -> tuple[slice, torch.Tensor, torch.Size]:
        """What a map at every second row and column, from column 0 or 1 on, shows of the subject: which of
        the N pixels, where they are in that map, and the map's size (h / 2, w / 2)."""
        chosen = slice(self._halves[column], self._halves[column + 1])
        width = self.shape[1]
        row, place = self.pixels[chosen] // width, self.pixels[chosen] % width
        size = torch.Size((self.shape[0] // 2, width // 2))
        return chosen, row // 2 * size[1] + place // 2, size
