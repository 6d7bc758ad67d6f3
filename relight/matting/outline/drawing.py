"""A matte from what a person draws: an outline around the person, and strokes that say "person" or "not".

The outline becomes a trimap: inside, outside, and a band around the line where either may be. The band is
solved by closed-form matting (Levin et al., PAMI 2008) with a prior for each of its pixels, which joins two
pieces of evidence: how far the pixel is from the line, and whether its colour is found inside or outside
nearby. `outlined` solves the matte on a reduced copy, so that any photograph takes about the same time, and
`refine` brings it to the photograph's own pixels: once more by closed-form matting in a narrow band, then by
the linear model of colour that closed-form matting assumes within small windows (He and Sun, "Fast Guided
Filter", 2015).

Points are (x, y), pixels of the photograph from its top left corner; they may lie beyond the photograph.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image, ImageDraw
from scipy import ndimage
from scipy.special import expit, logit

from relight.matting.outline.background_model import BackgroundModel
from relight.matting.outline.colour_likelihood import OF_LINES, OF_MASKS, colour_log_odds
from relight.matting.outline.holes import holes
from relight.matting.refine import (
    BACKGROUND,
    PERSON,
    UNKNOWN,
    closed_form,
    distance_inside,
    encoded_srgb,
    smooth_where_alike,
    solve_edge,
    upsampled,
)
from relight.media.images import coverage, scene_linear
from relight.media.resampling import resize

SLACK = 0.03  # of the outline's height: how far the true edge may be from the line that was drawn
SOLVED_SIDE = 720  # pixels, the longer side of the copy on which an outline is solved
REFINED_SIDE = 1200  # pixels, the longer side of the copy on which the edge is solved again
BAND = 5  # pixels on either side of the edge that are solved again there
NEARNESS = 3.0  # logarithm of the odds at the band's rim, of being inside
LINE_NEARNESS = 2.0  # the same for lines without a mask
PRIOR = 0.02  # weight of the priors beside the matting Laplacian
MOVES, LEAST_SHIFT = 2, 0.2  # of a sharp mask's edge as a whole, and of its tolerance, from where it counts
MASK_NEARNESS, MASK_PRIOR = 8.0, 0.05  # as `NEARNESS` and `PRIOR`, for sharp masks
CONTRADICTION = 3.0  # of log odds against a sharp mask, deep in the band, from where the band goes on
WIDENINGS, WIDENED = 2, 0.25  # times that it goes on by the tolerance; the distance inside the edge there
UNSURE = 0.05  # a rough matte is sure within this of 0 and 1; between, colours decide, however far the edge
DOUBT = 0.6  # of the logarithm of its odds there: its weight, as a distance
REACH = 6  # pixels around a hole that are solved with it
MARGIN = 0.12  # of the outline's size, of the photograph around it that is looked at
FILTER = "triangle"  # of `resize`, for copies


@dataclass(frozen=True)
class Stroke:
    """A line drawn with a round brush."""

    person: bool  # whether the brush says "person"; otherwise it says "not the person"
    points: ArrayLike  # (N, 2), x and y in pixels; one point is a dot
    radius: float  # of the brush, in pixels


@dataclass(frozen=True)
class Outline:
    """What somebody drew on a photograph."""

    # (N, 2) corners of a closed line around the person, x and y in pixels, three at least. The line may cross
    # itself and leave the photograph.
    lasso: ArrayLike | None = None
    strokes: Sequence[Stroke] = field(default_factory=tuple)  # as drawn: a later one counts where two overlap
    # (H, W) in [0, 1], a matte that the strokes correct, such as a network's; a lasso limits it.
    matte: np.ndarray | None = None
    # Closed lines, each as `lasso`, around what is not the person, such as the gap between arm and body.
    holes: Sequence[ArrayLike] = field(default_factory=tuple)
    # Pixels: how far the true edge may be from that of the matte; about 1 % of its size unless given. With 0
    # the matte is right but for where something was drawn.
    tolerance: float | None = None


def outlined(image: ArrayLike, outline: Outline) -> np.ndarray:
    """Return the matte (H, W) in [0, 1] that an outline means, from a reduced copy of the photograph.

    The image is (H, W, 3|4), opaque: integers are sRGB-encoded, floats linear Rec.709. Raises ValueError if
    nothing was drawn, or nothing of the person is left by it.
    """
    pixels = scene_linear("image", image)[..., :3]
    height, width = pixels.shape[:2]
    top, left, bottom, right = _looked_at(outline, (height, width))
    shrink = min(1.0, SOLVED_SIDE / max(bottom - top, right - left))
    size = (max(3, round((bottom - top) * shrink)), max(3, round((right - left) * shrink)))
    scale = np.array([size[1] / (right - left), size[0] / (bottom - top)])

    known, distance, mask, sharp, touched = _drawn(outline, (top, left, bottom, right), size, scale)
    seen = encoded_srgb(resize(pixels[top:bottom, left:right], size, FILTER))
    right_already = outline.matte is not None and outline.tolerance == 0
    if mask is not None and not sharp and not right_already:
        known, distance = _opened(seen, known, distance, mask)
    alpha = _solved(seen, known, distance, sharp, mask is None)
    if alpha.max() <= 0.5:
        raise ValueError("outline: nothing of the person is inside it; draw around the whole person")
    if (alpha > 0.5).all() and size == (height, width):
        raise ValueError("outline: the whole picture is inside it; expected something behind the person")
    matte = np.zeros((height, width), np.float32)
    if right_already:  # with all its detail, which the copy lacks
        assert outline.matte is not None
        assert mask is not None
        matte[:] = coverage("matte", outline.matte)
        alpha = np.where(touched, alpha - mask, 0)
    matte[top:bottom, left:right] += resize(alpha[..., None], (bottom - top, right - left), FILTER)[..., 0]
    return matte.clip(0, 1)


def inside_of(points: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """Return where a person may be who was drawn around: (H, W) bool, from a closed line (N, 2) in pixels."""
    inside = _filled(points, (size[0], size[1]))
    return distance_inside(inside) > -SLACK * _extent(inside)


def shift_edge(matte: np.ndarray, shift: float = 0.0, feather: float = 0.0) -> np.ndarray:
    """Move the edge of a matte (H, W) in [0, 1], and blur it.

    `shift`: pixels outward, inward if negative; the edge stays as soft as it was. `feather`: standard
    deviation in pixels of the Gaussian that blurs the matte afterwards.

    >>> square = np.zeros((20, 20), np.float32)
    >>> square[5:15, 5:15] = 1
    >>> shift_edge(square, 2)[10].sum().round(), shift_edge(square, -2)[10].sum().round()
    (np.float32(14.0), np.float32(6.0))
    """
    moved = np.asarray(matte, np.float32)
    inside = moved > 0.5
    if shift and inside.any() and not inside.all():
        # Each pixel takes the value of the place that is `shift` further in, across the nearest edge.
        depth = ndimage.distance_transform_edt(inside) - ndimage.distance_transform_edt(~inside)
        inward = np.stack(np.gradient(ndimage.gaussian_filter(depth, 1.0)))
        inward /= np.maximum(np.hypot(*inward), 1e-6)
        places = np.mgrid[: moved.shape[0], : moved.shape[1]] + shift * inward
        moved = ndimage.map_coordinates(moved, places, order=1, mode="nearest")
    if feather:
        moved = ndimage.gaussian_filter(moved, feather, mode="nearest")
    return moved.clip(0, 1)


def refine(image: ArrayLike, matte: np.ndarray) -> np.ndarray:
    """Return a matte (H, W) of a reduced copy, such as `outlined` makes, at the photograph's own detail.

    The image is as in `outlined`, the matte soft at the scale of the copy. Raises ValueError if the matte is
    of another size than the photograph, or shows no person.
    """
    pixels = scene_linear("image", image)[..., :3]
    if matte.shape != pixels.shape[:2]:
        raise ValueError(f"matte: expected the photograph's size {pixels.shape[:2]}, got {matte.shape}")
    rows, columns = np.nonzero(matte > 0)
    if not len(rows):
        raise ValueError("matte: shows no person")
    height, width = matte.shape
    box = np.s_[
        max(rows.min() - 8, 0) : min(rows.max() + 9, height),
        max(columns.min() - 8, 0) : min(columns.max() + 9, width),
    ]
    # Colours mix in linear light: in encoded values, the edge of dark cloth on a bright wall is too thin.
    fine = np.ascontiguousarray(pixels[box].clip(0, 1), np.float32)
    coarse = np.asarray(matte[box], np.float32)
    shrink = min(1.0, REFINED_SIDE / max(coarse.shape))
    size = (max(3, round(coarse.shape[0] * shrink)), max(3, round(coarse.shape[1] * shrink)))
    seen = resize(fine, size, FILTER)
    rough = resize(coarse[..., None], size, FILTER)[..., 0].clip(0, 1)
    alpha = smooth_where_alike(seen, solve_edge(seen, rough, BAND))
    refined = np.zeros((height, width), np.float32)
    refined[box] = alpha if shrink == 1 else upsampled(seen, alpha, fine)
    return refined


def refine_matte(pixels: np.ndarray, rough: np.ndarray, band: int) -> np.ndarray:
    """Find the edge of a rough mask (H, W) in [0, 1] again, in the photograph (H, W, 3), linear Rec.709.

    `band`: width in pixels, at least 2, of the band along the mask's edge in which the true edge is. Colours
    tell the edge, beyond the band too where they contradict the mask. Raises ValueError for a band out of
    range, or so wide that it leaves nothing of the person or of the background; ImportError without PyMatting
    (the extra `matte`).
    """
    if band < 2:
        raise ValueError(f"refine_matte: expected a band of 2 pixels or more, got {band}")
    distance = distance_inside(rough > 0.5)
    if distance.max() <= band / 2 or distance.min() >= -band / 2:
        raise ValueError(f"refine_matte: a band of {band} pixels leaves nothing of the person or behind them")
    sharp = Outline(matte=(rough > 0.5).astype(np.float32), tolerance=band / 2)
    return refine(pixels, outlined(pixels, sharp))


def _looked_at(outline: Outline, size: tuple[int, int]) -> tuple[int, int, int, int]:
    """Return the part of a photograph (H, W) that an outline concerns: top, left, bottom, right."""
    height, width = size
    points = [np.reshape(np.asarray(outline.lasso, float), (-1, 2))] if outline.lasso is not None else []
    for stroke in outline.strokes:
        drawn = np.reshape(np.asarray(stroke.points, float), (-1, 2))
        if stroke.person and len(drawn):
            points += [drawn - stroke.radius, drawn + stroke.radius]
    if outline.matte is not None:
        if outline.matte.shape != size:
            raise ValueError(f"matte: expected the photograph's size {size}, got {outline.matte.shape}")
        rows, columns = np.nonzero(coverage("matte", outline.matte) > 0.05)
        if len(rows):
            points.append(np.array([[columns.min(), rows.min()], [columns.max() + 1, rows.max() + 1]], float))
    drawn = np.concatenate(points) if points else np.zeros((0, 2))
    if not np.isfinite(drawn).all():
        raise ValueError("outline: expected finite points")
    if outline.lasso is not None and len(points[0]) < 3:
        raise ValueError("outline: expected three points or more; draw around the whole person")
    if not len(drawn):
        raise ValueError("outline: nothing was drawn; draw a line around the person")
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    margin = MARGIN * max(high - low) + 4
    left, top = np.floor(np.clip(low - margin, 0, (width, height))).astype(int)
    right, bottom = np.ceil(np.clip(high + margin, 0, (width, height))).astype(int)
    if right - left < 3 or bottom - top < 3:
        raise ValueError("outline: lies beside the photograph; draw around the person")
    return top, left, bottom, right


def _drawn(
    outline: Outline, part: tuple[int, int, int, int], size: tuple[int, int], scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, bool, np.ndarray]:
    """Draw an outline on a copy (h, w): return its trimap, the distance inside the edge, and what it is.

    The distance is in units of the tolerance of the drawn line, infinite under strokes. The third value is
    the mask on the copy, None without one. The fourth one is whether the outline is a
    sharp mask without lines, whose edge may be shifted as a whole; the last one where something was drawn.
    """
    top, left, bottom, right = part
    corner = np.array([left, top])
    inside, rough, slack = np.ones(size, bool), None, 1.0
    if outline.matte is not None:
        given = np.asarray(outline.matte[top:bottom, left:right, None], np.float32)
        rough = resize(given, size, FILTER)[..., 0].clip(0, 1)
        slack = _mask_slack(size) if outline.tolerance is None else max(2.0, outline.tolerance * scale.mean())
    elif outline.lasso is None:
        inside = np.zeros(size, bool)
    if outline.lasso is not None:
        inside = _filled((np.asarray(outline.lasso, float) - corner) * scale, size)
        slack = slack if outline.matte is not None else max(2.0, SLACK * _extent(inside))
    for hole in outline.holes:
        inside = inside & ~_filled((np.reshape(np.asarray(hole, float), (-1, 2)) - corner) * scale, size)
    # The edge of a sharp mask is grey too, but at most two pixels wide.
    unsure = np.zeros(size, bool) if rough is None else inside & (rough > UNSURE) & (rough < 1 - UNSURE)
    unsure = ndimage.binary_opening(unsure, np.ones((3, 3)))
    distance = distance_inside(inside if rough is None else inside & (rough > 0.5)) / slack
    if rough is not None:
        distance = np.where(unsure, (DOUBT * logit(rough.clip(UNSURE, 1 - UNSURE))).clip(-1, 1), distance)
    known = _trimap(distance)
    known[unsure] = UNKNOWN
    touched = ~inside if rough is not None else np.ones(size, bool)
    for stroke in outline.strokes:
        painted = _painted(
            (np.reshape(np.asarray(stroke.points, float), (-1, 2)) - corner) * scale,
            stroke.radius * scale.mean(),
            size,
        )
        known[painted] = PERSON if stroke.person else BACKGROUND
        near = ndimage.binary_dilation(painted, iterations=max(2, round(slack))) & ~painted
        known[near & (known == (BACKGROUND if stroke.person else PERSON))] = UNKNOWN
        touched |= near | painted
        distance = np.where(near, 0.0, np.where(painted, np.inf if stroke.person else -np.inf, distance))
    lines = outline.lasso is not None or len(outline.holes) > 0
    sharp = rough is not None and not lines and not unsure.any()
    return known, distance, rough, sharp, touched


def _opened(
    seen: np.ndarray, known: np.ndarray, distance: np.ndarray, mask: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return a trimap and its distances with the holes opened through which the background shows.

    A stroke that says "person" keeps a hole closed.
    """
    painted = np.isposinf(distance) & (known == PERSON)
    model = BackgroundModel.of(seen, known == BACKGROUND)
    hole = holes(model, np.isfinite(distance) & (distance > 0), mask < 1 - UNSURE)
    hole &= ~ndimage.binary_propagation(hole & ndimage.binary_dilation(painted), mask=hole)
    near = ndimage.binary_dilation(hole, iterations=REACH) & np.isfinite(distance)
    distance = np.where(hole, -1.0, np.where(near, np.minimum(distance, 0), distance))
    known = np.where(near, UNKNOWN, known)
    known[ndimage.binary_erosion(hole)] = BACKGROUND
    return known, distance


def _trimap(distance: np.ndarray) -> np.ndarray:
    """Return what is surely inside, surely outside, and neither, from distances in units of the tolerance."""
    return np.where(distance >= 1, PERSON, np.where(distance <= -1, BACKGROUND, UNKNOWN))


def _solved(
    seen: np.ndarray, known: np.ndarray, distance: np.ndarray, sharp: bool, drawn: bool
) -> np.ndarray:
    """Solve the matte (h, w) of a copy (h, w, 3), encoded, with the trimap `known`.

    `sharp`: its edge is that of a sharp mask; `drawn`: that of a line or strokes without a mask.
    """
    if not (known == PERSON).any() and not ((known == UNKNOWN) & (distance > 0)).any():
        return np.zeros(known.shape, np.float32)
    neighbours, nearness = (OF_LINES, LINE_NEARNESS) if drawn else (OF_MASKS, NEARNESS)
    odds, weight = colour_log_odds(seen, known, distance, neighbours=neighbours), PRIOR
    if sharp:
        for _ in range(MOVES):
            shift = _shift(odds, distance, known == UNKNOWN)
            if abs(shift) < LEAST_SHIFT:
                break
            distance = distance - shift
            known = _trimap(distance)
            odds = colour_log_odds(seen, known, distance)
        for _ in range(WIDENINGS):
            wider, distance = widened(known, distance, odds)
            if (new := wider != known).any():
                odds = np.where(new, colour_log_odds(seen, wider, distance, new), odds)
            known = wider
        nearness, weight = MASK_NEARNESS, MASK_PRIOR
    prior = expit(nearness * distance + odds)
    return closed_form(seen, known, prior, weight * np.abs(2 * prior - 1))


def _shift(odds: np.ndarray, distance: np.ndarray, unknown: np.ndarray) -> float:
    """Return at which distance inside its edge a mask agrees best with the odds."""
    places, cast = distance[unknown], odds[unknown]
    shifts = np.linspace(-0.9, 0.9, 37)
    return float(max(shifts, key=lambda shift: (np.where(places > shift, cast, -cast).sum(), -abs(shift))))


def widened(known: np.ndarray, distance: np.ndarray, odds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a sharp mask's trimap and its distances, the band wider where colours contradict its rims.

    A dilated mask closes narrow gaps, and an eroded one loses fingers, to more than the tolerance.
    """
    square = np.ones((3, 3))
    for side, sign in ((PERSON, 1), (BACKGROUND, -1)):
        against = (known == UNKNOWN) & (sign * distance > 0.5) & (sign * odds < -CONTRADICTION)
        against = ndimage.binary_opening(against, square)
        if not against.any():
            continue
        near = ndimage.binary_dilation(against, square, round(_mask_slack(known.shape)))
        near &= np.isfinite(distance) & (sign * distance > 0)
        known = np.where(near & (known == side), UNKNOWN, known)
        distance = np.where(near, sign * np.minimum(sign * distance, WIDENED), distance)
    return known, distance


def _filled(points: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return the inside (h, w), bool, of a closed line (N, 2) of x and y, which may cross itself."""
    picture = Image.new("1", (size[1], size[0]))
    limits = 4.0 * max(size)
    drawn = np.clip(points - 0.5, -limits, limits)
    ImageDraw.Draw(picture).polygon([tuple(point) for point in drawn], fill=1, outline=1)
    return ndimage.binary_fill_holes(np.asarray(picture))


def _painted(points: np.ndarray, radius: float, size: tuple[int, int]) -> np.ndarray:
    """Return what a round brush covers along a line (N, 2): (h, w), bool."""
    picture = Image.new("1", (size[1], size[0]))
    draw, limits = ImageDraw.Draw(picture), 4.0 * max(size)
    drawn = [tuple(point) for point in np.clip(points - 0.5, -limits, limits)]
    radius = max(0.5, min(radius, limits))
    if len(drawn) > 1:
        draw.line(drawn, fill=1, width=max(1, round(2 * radius)))
    for x, y in drawn:
        draw.ellipse([x - radius, y - radius, x + radius, y + radius], fill=1)
    return np.array(picture)


def _mask_slack(size: tuple[int, ...]) -> float:
    """Return how far the true edge may be from that of a mask (h, w), in pixels."""
    return max(2.0, SLACK / 3 * max(size))


def _extent(drawn: np.ndarray) -> int:
    """Return the larger of a region's height and width, in pixels."""
    rows, columns = np.nonzero(drawn)
    return 0 if not len(rows) else max(int(np.ptp(rows)), int(np.ptp(columns))) + 1
