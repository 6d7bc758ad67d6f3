"""Folds that an artist painted into a scan's texture, raised from its surface instead.

The textures of posed avatars hold folds that their meshes lack. A network that learns from them as they are
learns that what looks like a fold is flat.
"""

import torch
import torch.nn.functional as F
from kornia.filters import gaussian_blur2d, guided_blur, spatial_gradient

from shadow.data.records import ENCODING, Record
from shadow.framing import bounding_box

WINDOW = 1 / 27  # of the subject's height: wider than a fold, narrower than a garment
EDGE = 0.01  # variance of the encoded albedo above which a contrast is the edge of something
PAINT = 0.25  # log contrast beyond which a dark spot is rather a print, a seam or an eyebrow than a fold
LEAST_Z = 0.05  # of a unit normal that stays visible


def raise_folds(record: Record, height: float = 1.0) -> Record:
    """The record with the fine contrast of its albedo as relief: dark is deep (after Langer and Zucker 1994).

    `height` is how far a log unit of contrast stands out, in windows. The albedo loses what the normals gain,
    so that a photograph still shows a fold there, but lit by its lights. What turns away from a light gets
    dark; what turns toward it from the dark stays so, and the shadows that folds cast are not traced. Bounce
    light, if there is any, stays that of the smooth surface.
    """
    mask = torch.from_numpy(record.mask)
    top, _, bottom, _ = bounding_box(mask)
    window = 2 * round((bottom - top) * WINDOW / 2) + 1
    paint = record.image(record.albedo ** (1 / ENCODING))[None]
    smooth = guided_blur(paint, paint, window, EDGE)
    contrast = torch.log((paint.mean(1, True) + 0.02) / (smooth.mean(1, True) + 0.02))
    contrast = contrast * torch.exp(-((contrast / PAINT) ** 2)) * mask
    share = gaussian_blur2d(mask[None, None].float(), 5, (1.0, 1.0)).clamp_min(1e-3)
    contrast = gaussian_blur2d(contrast, 5, (1.0, 1.0)) / share  # without the grain of the texture
    right_down = spatial_gradient(contrast, "diff")[0, 0]
    inner = 1 - F.max_pool2d(1 - mask[None].float(), 3, stride=1, padding=1)
    slope = height * window * (right_down * inner)[:, mask].T * torch.tensor([1, -1])
    smooth_normals = torch.from_numpy(record.normals)
    turned = smooth_normals - torch.cat([slope, torch.zeros(len(slope), 1)], dim=1) * smooth_normals[:, 2:]
    turned[:, 2].clamp_min_(LEAST_Z)
    normals = F.normalize(turned, dim=1).numpy()
    lit = record.visibility * (normals @ record.directions.T > 0)
    kept = torch.exp(-ENCODING * contrast[0, 0])[mask].numpy()
    return Record.of(
        record.mask,
        normals,
        record.albedo * kept[:, None],
        lit,
        record.directions,
        record.about | {"relief": height},
        None if record.bounce_float16 is None else record.bounce,
        record.depth,
    )
