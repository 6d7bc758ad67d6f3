"""Convert folds that are painted in the texture of a scan to relief.

The textures of posed avatars show folds that their meshes lack. A network that is trained on them unchanged
learns that what looks like a fold is flat.
"""

import torch
import torch.nn.functional as F

from shadow.data.records import ENCODING, Record
from shadow.framing import bounding_box

WINDOW = 1 / 27  # of the filter, as a share of the subject's height: between a fold and a garment in size
EDGE_VARIANCE = 0.01  # of the encoded albedo, above which a contrast is the edge of an object
PAINT_CONTRAST = 0.25  # log contrast above which a dark spot is more likely a print, a seam or an eyebrow
MIN_NORMAL_Z = 0.05  # of the new unit normals, so that their surface stays visible


def raise_folds(record: Record, height: float = 1.0) -> Record:
    """Return the record with the fine contrast of its albedo as relief, where dark is deep.

    The assumption is that of Langer and Zucker (1994).

    `height` is the height of a log unit of contrast, in windows. The contrast is removed from the albedo, so
    that a photograph still shows a fold there, but lit by its own lights. Pixels that turn away from a light
    become unlit. Pixels that turn toward a light stay as they were, shadows cast by the folds are not traced,
    and bounce light is that of the smooth surface.
    """
    from kornia.filters import gaussian_blur2d, guided_blur, spatial_gradient

    mask = torch.from_numpy(record.mask)
    top, _, bottom, _ = bounding_box(mask)
    window = 2 * round((bottom - top) * WINDOW / 2) + 1
    paint = record.image(record.albedo ** (1 / ENCODING))[None]
    smooth = guided_blur(paint, paint, window, EDGE_VARIANCE)
    contrast = torch.log((paint.mean(1, True) + 0.02) / (smooth.mean(1, True) + 0.02))
    contrast = contrast * torch.exp(-((contrast / PAINT_CONTRAST) ** 2)) * mask
    share = gaussian_blur2d(mask[None, None].float(), 5, (1.0, 1.0)).clamp_min(1e-3)
    contrast = gaussian_blur2d(contrast, 5, (1.0, 1.0)) / share  # removes the grain of the texture
    right_down = spatial_gradient(contrast, "diff")[0, 0]
    inner = 1 - F.max_pool2d(1 - mask[None].float(), 3, stride=1, padding=1)
    slope = height * window * (right_down * inner)[:, mask].T * torch.tensor([1, -1])
    smooth_normals = torch.from_numpy(record.normals)
    turned = smooth_normals - torch.cat([slope, torch.zeros(len(slope), 1)], dim=1) * smooth_normals[:, 2:]
    turned[:, 2].clamp_min_(MIN_NORMAL_Z)
    normals = F.normalize(turned, dim=1).numpy()
    lit = record.visibility * (normals @ record.directions.T > 0)
    factor = torch.exp(-ENCODING * contrast[0, 0])[mask].numpy()
    return Record.of(
        record.mask,
        normals,
        record.albedo * factor[:, None],
        lit,
        record.directions,
        record.about | {"relief": height},
        None if record.bounce_float16 is None else record.bounce,
        record.depth,
    )
