"""Find the people in a photograph, and a mask of each, with MediaPipe's two pose networks.

The detector sees the picture, and overlapping parts of it for small people, and answers with the middle of a
person's hips and a point on the circle around the whole person. The landmark network sees the square around
that circle, turned so that the person is upright. It answers with a better circle, and with a mask of 256
pixels a side (Bazarevsky et al., "BlazePose", 2020). After two looks the circle is right,
and the masks of three squares and of their mirror images are averaged. Whoever is cut by the frame is often
detected only where the picture has room below. OpenVINO runs both in float32 on one thread, so that
machines of one kind agree to the bit. The files are those of `relight.matting.person_files`.
"""

import functools
import itertools
import logging
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from scipy.ndimage import distance_transform_edt
from scipy.special import expit

from relight.errors import EmptyMatteError
from relight.matting import person_files
from relight.matting.refine import ALL, encoded_srgb, opaque_photograph
from relight.media.resampling import resize
from shadow.files import AnyPath
from shadow.framing import affine_sample
from shadow.installing import install_command

DETECTOR_SIDE, LANDMARK_SIDE = 224, 256  # pixels of the networks' square inputs
STRIDES = (8, 16, 32, 32, 32)  # pixels of the detector's layers of anchors; each cell has two anchors
HIPS, RIM = 33, 34  # rows of the landmarks: the middle of the hips, and the circle's upper end
LANDMARK_VALUES = 5  # x, y, z, visibility, presence
ROOM = 1.25  # side of the square that the landmark network sees, in diameters of the circle
LOOKS = 2  # of the landmark network until the circle is right: that of a detection may be far off
HOPELESS = 0.005  # presence in all of them from which nobody is there
SQUARES = (1.0, 0.9, 0.8)  # sides of the squares whose masks are averaged, of that around the circle
PRESENT, CERTAIN = 0.3, 0.8  # certainty from which somebody is there, and is not looked for any more
SCORES = (0.5, 0.1)  # of detections, at least; lower ones count where the higher ones lead to nobody
MOST = 8  # detections of one score and share that are looked at, the best ones
SAME_FACE = 0.3  # intersection over union of two detections' boxes from which they are of one person
SAME_PERSON = 0.6  # the same, of two masks
ALIKE = 1.0  # distance of circles up to which they may be of one person in two frames
PART = 0.6  # of a person's radius: a smaller circle whose middle is on them is around a part of them
REDUCED_SIDE = 1024  # pixels, the longer side of the copy on which the detector looks
SHARES = (1.0, 1.4, 0.5, 0.25)  # sides of the parts that the detector sees, of the picture's longer side


NOBODY = (
    "matte: found no person in the photograph: give a mask (--mask), draw an outline (relight app), or name "
    "a matting model (--matte)"
)
LOG = logging.getLogger("relight")


@dataclass(frozen=True)
class Circle:
    """The circle around a person: `centre` (x, y) and `radius` in pixels, and the unit vector `up` (x, y)."""

    centre: np.ndarray
    radius: float
    up: np.ndarray

    @classmethod
    def of(cls, hips: np.ndarray, rim: np.ndarray) -> "Circle":
        """Return the circle around the hips (x, y) whose upper end is at `rim` (x, y)."""
        radius = max(float(np.hypot(*(rim - hips))), 1e-3)
        return cls(np.asarray(hips, float), radius, (rim - hips) / radius)

    def square(self, side: int) -> np.ndarray:
        """Return the matrix (2, 3) from a canvas of `side` pixels, on which the person is upright."""
        step = 2 * ROOM * self.radius / side
        x, y = self.up
        turn = step * np.array([[-y, -x], [x, -y]])
        return np.concatenate([turn, (self.centre - turn @ [side / 2, side / 2])[:, None]], axis=1)

    def distance(self, other: "Circle") -> float:
        """Return how unlike another circle is, in place and in size: 0 for the same."""
        moved = float(np.hypot(*(self.centre - other.centre))) / other.radius
        return moved + abs(float(np.log(self.radius / other.radius)))


@dataclass(frozen=True)
class DetectedPerson:
    """Somebody in a picture: their circle, and their mask (256, 256) in [0, 1] in the square around it.

    presence: the landmark network's opinion, in [0, 1], that somebody is there, a mean of its last looks.
    """

    circle: Circle
    mask: np.ndarray
    presence: float = 1.0

    @property
    def certainty(self) -> float:
        """The presence, and less for who is not upright, as what only looks like somebody seldom is."""
        return self.presence * ((1.5 - float(self.circle.up[1])) / 2.5) ** 2

    @property
    def area(self) -> float:
        """Pixels of the picture that the mask covers."""
        return float(self.mask.mean()) * (2 * ROOM * self.circle.radius) ** 2

    def has_part(self, circle: Circle) -> bool:
        """Return whether a smaller circle is around a part of this person, such as an arm."""
        square = self.circle.square(len(self.mask))
        column, row = np.floor(np.linalg.solve(square[:, :2], circle.centre - square[:, 2])).astype(int)
        inside = 0 <= row < len(self.mask) and 0 <= column < len(self.mask)
        return inside and circle.radius < PART * self.circle.radius and bool(self.mask[row, column] > 0.5)

    def on(self, size: tuple[int, int]) -> np.ndarray:
        """Return the mask on the picture: (H, W) float32 in [0, 1]."""
        side = len(self.mask)
        square = self.circle.square(side)
        corners = square @ np.array([[0, side, 0, side], [0, 0, side, side], [1, 1, 1, 1]])
        limits = np.array([size[1], size[0]])
        left, top = np.floor(corners.min(axis=1)).clip(0, limits).astype(int)
        right, bottom = np.ceil(corners.max(axis=1)).clip(0, limits).astype(int)
        found = np.zeros(size, np.float32)
        if right > left and bottom > top:
            turn = np.linalg.inv(square[:, :2])
            offset = turn @ (np.array([left, top]) - square[:, 2])
            matrix = torch.tensor(np.concatenate([turn, offset[:, None]], axis=1), dtype=torch.float32)
            part = affine_sample(torch.from_numpy(self.mask)[None], matrix, (bottom - top, right - left))
            found[top:bottom, left:right] = part[0].numpy()
        return found


def find(image: ArrayLike, person: Any = None) -> np.ndarray:
    """Find the person in a photograph: their mask, soft and coarse.

    Parameters
    ----------
    image
        (H, W, 3|4), opaque. Integers are sRGB-encoded; floats linear Rec.709.
    person
        Which of several people: 1 is the largest, the default, 2 the next; (x, y), in pixels from the top
        left, selects the one nearest to that point; (x, y, radius) the one most like that circle in place and
        size, around the hips; "all" takes everybody together.

    Returns
    -------
    np.ndarray
        (H, W) float32 in [0, 1], an outline for `relight.matting.outline`, which refines its edge.

    Raises
    ------
    ImportError
        OpenVINO is missing (the extra `auto`).
    relight.errors.MissingNetworksError
        The networks have not been fetched: see `relight.matting.person_files.fetch`.
    relight.errors.EmptyMatteError
        Nobody was found.
    ValueError
        A person that is not there; an image that `relight.Subject` refuses.

    Examples
    --------
    >>> from skimage import data  # doctest: +SKIP
    >>> relight.matting.person.find(data.astronaut()).shape  # doctest: +SKIP
    (512, 512)
    """
    return load().mask(encoded_srgb(opaque_photograph(image)), person)


@functools.lru_cache(maxsize=1)
def load() -> "PersonFinder":
    """Return the two networks, which are read once in a process. Raises as `find` does."""
    _openvino()  # before the files, which are of no use without it
    finder = PersonFinder(*person_files.fetched())
    LOG.info("The person is found by %s.", person_files.NETWORKS)
    return finder


class FoundPerson:
    """The person found in each photograph, refined at its own detail: a model of `relight.matte`.

    `person`: see `find`.
    """

    recurrent = False
    selects = True

    def __init__(self, person: Any = None) -> None:
        self._finder, self._person = load(), _circle(person)

    def __call__(self, encoded: np.ndarray) -> np.ndarray:
        """Return the matte (H, W) of a photograph (H, W, 3), encoded in [0, 1]; zero if nobody is there."""
        from relight.matting import outline  # whose parts of SciPy take long to load

        try:
            mask = self._finder.mask(encoded, self._person)
        except EmptyMatteError:
            return np.zeros(encoded.shape[:2], np.float32)
        codes = np.rint(encoded * 255).astype(np.uint8)
        return outline.refine(codes, outline.outlined(codes, outline.Outline(matte=mask)))

    @property
    def followed(self) -> tuple[int, int, int] | None:
        """The circle (x, y, radius) of whoever is followed, in pixels; None before `follow`, and for all."""
        if not isinstance(self._person, Circle):
            return None
        x, y = np.rint(self._person.centre).astype(int).tolist()
        return x, y, max(1, round(self._person.radius))

    def follow(self, encoded: np.ndarray) -> bool:
        """From now on take whoever is most like the person of this photograph, in place and in size.

        Return whether somebody is there.
        """
        found = self._finder.people(encoded, thorough=self._person is not None)
        if found and not (isinstance(self._person, str) and self._person == ALL):
            self._person = found[_index(found, self._person, encoded.shape[:2])].circle
        return bool(found)

    def reset(self) -> None:
        """Do nothing: each photograph is looked at by itself."""


class PersonFinder:
    """Both networks: `detector` and `landmarks` are the paths of their files, in a format of OpenVINO's."""

    def __init__(self, detector: AnyPath, landmarks: AnyPath) -> None:
        core = _openvino().Core()
        settings = {"INFERENCE_NUM_THREADS": 1, "NUM_STREAMS": 1, "INFERENCE_PRECISION_HINT": "f32"}
        self._detector, self._landmarks = (
            core.compile_model(str(path), "CPU", settings) for path in (detector, landmarks)
        )
        self._anchors = _anchors()

    def mask(self, encoded: np.ndarray, person: Any = None) -> np.ndarray:
        """Return the mask (H, W) of a person in a photograph (H, W, 3), sRGB-encoded; see `find`."""
        size, person = (encoded.shape[0], encoded.shape[1]), _circle(person)
        near = person if isinstance(person, Circle) else None
        found = self.people(encoded, thorough=person is not None and near is None, near=near)
        if not found:
            raise EmptyMatteError(NOBODY)
        return mask_of(found, person, size)

    def people(
        self, encoded: np.ndarray, thorough: bool = False, near: Circle | None = None
    ) -> list[DetectedPerson]:
        """Return everybody in a photograph (H, W, 3), encoded in [0, 1]: who is certain, the largest first.

        Smaller parts of the picture are looked at until somebody is found who is like `near`, if that is
        given; all of them if `thorough`.
        """
        shrink = min(1.0, REDUCED_SIDE / max(encoded.shape[:2]))
        reduced = resize(encoded, tuple(max(1, round(n * shrink)) for n in encoded.shape[:2]), "triangle")
        scale = np.array(encoded.shape[1::-1]) / reduced.shape[1::-1]
        copy, full = map(_planes, (reduced, encoded))
        found: list[DetectedPerson] = []
        for score, share in itertools.product(SCORES, SHARES):
            seen = list(found)
            for hips, rim in self._detections(copy, share, score)[:MOST]:
                # A circle that is large on the reduced copy has all the detail there that its mask needs.
                large = 2 * ROOM * float(np.hypot(*(rim - hips))) >= LANDMARK_SIDE
                picture, factor = (copy, scale) if large else (full, np.ones(2))
                start = Circle.of(hips * scale, rim * scale)
                if not any(each.certainty >= CERTAIN and each.has_part(start) for each in seen):
                    seen += self._person(picture, start, factor)
            found = _distinct(seen, encoded.shape[:2])
            enough = any(
                each.certainty >= CERTAIN and (near is None or each.circle.distance(near) < ALIKE)
                for each in found
            )
            if found and (share == SHARES[-1] or (enough and not thorough)):
                break
        return sorted(
            found, key=lambda each: (each.certainty < CERTAIN, -min(each.certainty, CERTAIN), -each.area)
        )

    def _detections(
        self, picture: torch.Tensor, share: float, least: float
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the hips and the circle's rim, (x, y), of everybody that the detector sees in the parts.

        `least` is the least score.
        """
        scores, boxes, points = [], [], []
        for left, top, side in _parts(picture.shape[2], picture.shape[1], share):
            step = side / DETECTOR_SIDE
            seen = _sampled(picture, np.array([[step, 0, left], [0, step, top]]), DETECTOR_SIDE)
            answers, odds = self._detector(seen * 2 - 1).values()
            score = expit(odds[0, :, 0].clip(-100, 100))
            kept = score > least
            values = answers[0][kept].reshape(-1, 6, 2) / DETECTOR_SIDE  # a centre, a size, four points
            values[:, [0, 2, 3, 4, 5]] += self._anchors[kept][:, None]
            corner = np.array([left, top])
            scores.append(score[kept])
            boxes.append(np.stack([values[:, 0] * side + corner, values[:, 1] * side], axis=1))
            points.append(values[:, 2:4] * side + corner)
        score, box, point = map(np.concatenate, (scores, boxes, points))
        found, order = [], np.argsort(-score, kind="stable")
        while len(order):
            best, others = order[0], order[1:]
            found.append((point[best, 0], point[best, 1]))
            order = others[_overlaps(box[best], box[others]) < SAME_FACE]
        return found

    def _person(self, picture: torch.Tensor, around: Circle, scale: np.ndarray) -> list[DetectedPerson]:
        """Return who is in a circle of the full picture, seen in a copy (3, h, w); nobody or one.

        `scale` (x, y) leads from the copy to the picture.
        """
        factor = float(scale.mean())
        circle = Circle(around.centre / scale, around.radius / factor, around.up)
        opinions = []
        for _ in range(LOOKS):
            square = circle.square(LANDMARK_SIDE)
            presence, _, points = self._look(_sampled(picture, square, LANDMARK_SIDE, "border"))
            opinions.append(presence)
            circle = Circle.of(*(points @ square[:, :2].T + square[:, 2]))
        if max(opinions) < HOPELESS:
            return []
        del opinions[:-1]  # the first ones are of circles that may be far off
        sums = torch.zeros(2, LANDMARK_SIDE, LANDMARK_SIDE)  # of masks, and how many show each pixel
        for share in SQUARES:
            square = Circle(circle.centre, circle.radius * share, circle.up).square(LANDMARK_SIDE)
            canvas = _sampled(picture, square, LANDMARK_SIDE, "border")
            (first, mask, _), (second, mirrored, _) = self._look(canvas), self._look(canvas[:, :, ::-1])
            opinions += [first, second]
            both = torch.from_numpy((mask + mirrored[:, ::-1]) / 2)
            corner = LANDMARK_SIDE / 2 * (1 - 1 / share)
            inside = torch.tensor([[1 / share, 0, corner], [0, 1 / share, corner]])
            sums += affine_sample(torch.stack([both, torch.ones_like(both)]), inside, sums.shape[1:])
        place = Circle(circle.centre * scale, circle.radius * factor, circle.up)
        person = DetectedPerson(place, (sums[0] / sums[1]).numpy(), float(np.mean(opinions)))
        return [person] if person.certainty >= PRESENT else []

    def _look(self, canvas: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Return the presence, the mask and the two points (x, y) of the next circle on a canvas."""
        landmarks, presence, logits, *_ = self._landmarks(np.ascontiguousarray(canvas)).values()
        points = landmarks.reshape(-1, LANDMARK_VALUES)[[HIPS, RIM], :2]
        return float(presence.ravel()[0]), expit(logits[0, :, :, 0].astype(np.float32)), points


def mask_of(found: Sequence[DetectedPerson], person: Any, size: tuple[int, int]) -> np.ndarray:
    """Return the mask (H, W) of one of several people without the others, or of all; see `find`."""
    if isinstance(person, str) and person == ALL:
        return np.max([each.on(size) for each in found], axis=0)
    chosen = found[_index(found, person, size)]
    mask = chosen.on(size)
    for other in found:
        if other is not chosen and other.certainty >= CERTAIN:
            theirs = other.on(size)
            mask = np.where(theirs > mask, np.minimum(mask, 1 - theirs), mask)
    return mask


def _circle(person: Any) -> Any:
    """Return the circle that (x, y, radius) means, and anything else unchanged."""
    if not isinstance(person, tuple | list) or len(person) != 3:
        return person
    x, y, radius = map(float, person)
    if not radius > 0:
        raise ValueError(f"person: expected a radius above 0, got {radius:g}")
    return Circle(np.array([x, y]), radius, np.array([0.0, -1.0]))


def _index(found: Sequence[DetectedPerson], person: Any, size: tuple[int, int]) -> int:
    """Return which person is meant."""
    if isinstance(person, Circle):
        return int(np.argmin([each.circle.distance(person) for each in found]))
    if np.ndim(person) == 1 and not isinstance(person, str) and len(person) == 2:
        x, y = (int(value) for value in person)
        if not (0 <= x < size[1] and 0 <= y < size[0]):
            raise ValueError(f"person: expected a point in the picture, got {x}/{y}")
        inside = [each.on(size) > 0.5 for each in found]
        far = [float(distance_transform_edt(~mask)[y, x]) if mask.any() else float("inf") for mask in inside]
        return int(np.argmin(far))
    number = 1 if person is None else person
    if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= len(found):
        raise ValueError(
            f"person: expected 1 to {len(found)}, as many as there are people, (x, y), "
            f"(x, y, radius) or 'all', got {person!r}"
        )
    return number - 1


def _distinct(people: Sequence[DetectedPerson], size: tuple[int, ...]) -> list[DetectedPerson]:
    """Return each person once, as the most certain look shows them, or the larger one of two equal looks."""
    shrink = REDUCED_SIDE / 4 / max(size)
    small = (max(1, round(size[0] * shrink)), max(1, round(size[1] * shrink)))
    kept: list[DetectedPerson] = []
    masks: list[np.ndarray] = []
    for person in sorted(people, key=lambda each: (-round(each.certainty, 2), -each.area)):
        circle = person.circle
        circle = Circle(circle.centre * shrink, circle.radius * shrink, circle.up)
        mask = DetectedPerson(circle, person.mask).on(small) > 0.5
        if mask.any() and not any(
            (mask & theirs).sum() >= SAME_PERSON * min(mask.sum(), theirs.sum()) for theirs in masks
        ):
            kept.append(person)
            masks.append(mask)
    return kept


def _parts(width: int, height: int, share: float) -> Iterator[tuple[float, float, float]]:
    """Yield the squares (left, top, side) in pixels that cover a picture, half overlapping.

    A square that is larger than the picture has room below it, where a body that the frame cuts goes on.
    """
    side = share * max(width, height)
    if share > 1:
        yield (width - side) / 2, 0.0, side
        return
    for top in _starts(height, side):
        for left in _starts(width, side):
            yield left, top, side


def _starts(length: float, side: float) -> Sequence[float]:
    """Return where squares begin along a length, the only one centred."""
    if length <= side:
        return [(length - side) / 2]
    return [
        float(start) for start in np.linspace(0, length - side, int(np.ceil(2 * (length / side - 1))) + 1)
    ]


def _anchors() -> np.ndarray:
    """Return the centres (2254, 2) of the detector's anchors, as fractions of its input."""
    centres = []
    for stride in STRIDES:
        cells = DETECTOR_SIDE // stride
        rows, columns = np.mgrid[:cells, :cells] + 0.5
        centres.append(np.repeat(np.stack([columns, rows], axis=-1).reshape(-1, 2) / cells, 2, axis=0))
    return np.concatenate(centres).astype(np.float32)


def _overlaps(box: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return the intersection over union (N,) of a box with others; a box is a centre and a size (2, 2)."""
    low = np.maximum(box[0] - box[1] / 2, others[:, 0] - others[:, 1] / 2)
    high = np.minimum(box[0] + box[1] / 2, others[:, 0] + others[:, 1] / 2)
    shared = (high - low).clip(0).prod(axis=1)
    return shared / (box[1].prod() + others[:, 1].prod(axis=1) - shared).clip(1e-9)


def _planes(picture: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1), np.float32))


def _sampled(picture: torch.Tensor, matrix: np.ndarray, side: int, beyond: str = "zeros") -> np.ndarray:
    """Sample a picture (3, H, W) on a canvas, (1, side, side, 3). The detector expects black beyond it."""
    canvas = affine_sample(picture, torch.tensor(matrix, dtype=torch.float32), (side, side), beyond)
    return np.ascontiguousarray(canvas.permute(1, 2, 0)[None].numpy())


def _openvino() -> ModuleType:
    """Import OpenVINO without its telemetry, which would report the import to its makers.

    Raises ImportError if OpenVINO is missing.
    """
    with _hidden("openvino_telemetry"):
        try:
            import openvino
        except ImportError as error:
            raise ImportError(
                f"matte: to find the person OpenVINO is needed; install it with: {install_command('auto')}"
            ) from error
    return openvino


@contextmanager
def _hidden(name: str) -> Iterator[None]:
    """Let a module look as if it were not installed."""
    before = {each: sys.modules.pop(each) for each in [*sys.modules] if each.split(".")[0] == name}
    sys.modules[name] = None  # type: ignore[assignment]  # Python's sign that it cannot be imported
    try:
        yield
    finally:
        del sys.modules[name]
        sys.modules.update(before)
