"""Find the people in a photograph, and a mask of each, with MediaPipe's two pose networks.

The detector sees the picture, and overlapping parts of it for small people, and answers with the middle of a
person's hips and a point on the circle around the whole person. The landmark network sees the square around
that circle, turned so that the person is upright. It answers with a better circle, and with a mask of 256
pixels a side (Bazarevsky et al., "BlazePose", 2020). After two views the circle is right, and the masks of
three squares and of their mirror images are averaged. The mask of who is meant is then taken from further
squares. Each counts by how sure it is, and by how well its mirror image agrees. Whoever is cut by the frame
is often detected only where the picture has room below. OpenVINO runs both in float32 on one thread, so that
machines of one kind agree to the bit. The files are those of `relight.matting.people.files`.
"""

import functools
import itertools
import logging
import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import ArrayLike
from scipy.special import expit

from relight.errors import EmptyMatteError
from relight.matting import cutout_network, silhouette
from relight.matting.openvino_runtime import compiled, openvino
from relight.matting.people import files as person_files
from relight.matting.people import neighbours
from relight.matting.people.choice import CERTAIN, Choice, as_circle, distinct
from relight.matting.people.detector import SHARES, Detector
from relight.matting.people.region import LANDMARK_SIDE, Circle, Copies, DetectedPerson, View, joined, sampled
from relight.matting.people.track import Seen
from relight.matting.refine import PersonChoice, encoded_srgb, opaque_photograph
from shadow.files import AnyPath

HIPS, RIM = 33, 34  # rows of the landmarks: the middle of the hips, and the circle's upper end
LANDMARK_VALUES = 5  # x, y, z, visibility, presence
ROUNDS = 2  # of the landmark network until the circle is right: that of a detection may be far off
HOPELESS = 0.005  # presence in all of them from which nobody is there
SQUARES = (1.0, 0.9, 0.8)  # sides of the squares whose masks are averaged, of that around the circle
NEAR_AND_FAR = (
    1.3,
    1.0,
    0.8,
)  # sides of the squares of the further views, and of those around what they show
FRAME = 1.6  # side of the square in which these masks are joined; the others lie in it, almost
SPREAD = 0.05  # uncertainty by which a view counts 1/e of another; see `View.uncertainty`
USELESS = 0.75  # uncertainty of the best view from which none adds to the first ones
LIKELY = 0.5  # certainty from which somebody counts as a neighbour; what only resembles somebody has less
PRESENT = 0.3  # certainty from which somebody is there
SCORES = (0.5, 0.1)  # of detections, at least; lower ones count where the higher ones lead to nobody
MOST = 8  # detections of one score and share that are looked at, the best ones
ALIKE = 1.0  # distance of circles up to which they may be of one person in two frames
UNSCALED = np.ones(2)

NOBODY = (
    "matte: found no person in the photograph: give a mask (mask=FILE), draw an outline in the application, "
    "or name a matting model (matte=MODEL)"
)
UNCERTAIN = (
    "matte: it is uncertain whether what was found is a person: look at the matte, turn a picture that is "
    "not upright, or say who is meant (person=X/Y)"
)
LOG = logging.getLogger("relight")


def find(image: ArrayLike, person: PersonChoice | Circle = None) -> np.ndarray:
    """Find the person in a photograph: their mask (H, W) in [0, 1], soft and coarse.

    `relight.matting.outline.refine` refines its edge. The image is (H, W, 3|4), opaque: integers are
    sRGB-encoded, floats linear Rec.709. `person`: which of several people. 1 is the largest, the default, 2
    the next; (x, y), in pixels from the top left, selects the one nearest to that point; (x, y, radius) the
    one most like that circle in place and size, around the hips; "all" takes everybody together.

    Raises ImportError without OpenVINO (the extra `auto`); MissingNetworksError if the networks have not been
    fetched, see `person_files.fetch`; EmptyMatteError if nobody was found; ValueError for a person that is
    not there or an image that `relight.Subject` refuses.

    >>> from skimage import data  # doctest: +SKIP
    >>> relight.matting.people.finder.find(data.astronaut()).shape  # doctest: +SKIP
    (512, 512)
    """
    return load().mask(encoded_srgb(opaque_photograph(image)), person)


@functools.lru_cache(maxsize=1)
def load() -> "PersonFinder":
    """Return the two networks, which are read once in a process. Raises as `find` does."""
    openvino()  # before the files, which are of no use without it
    finder = PersonFinder(*person_files.fetched())
    LOG.info("The person is found by %s.", person_files.NETWORKS)
    return finder


class FoundPerson:
    """The person found in each photograph, at its own detail: a model of `relight.matte`.

    `person`: see `find`. `network`: what cuts the person out where they were found; IS-Net if it has been
    fetched. Without one, the package's own network mends the coarse mask, whose edge is then solved by its
    colours, see `relight.matting.outline.drawing`. `is_rough`: whether the mask's edge follows the
    photograph's and no more.
    """

    recurrent = False
    selects = True

    def __init__(
        self,
        person: PersonChoice | Circle = None,
        network: silhouette.Silhouette | None = None,
        is_rough: bool = False,
    ) -> None:
        self._finder, self._person, self._is_rough = load(), as_circle(person), is_rough
        self._network = None if is_rough else network or silhouette.load()

    def __call__(self, encoded: np.ndarray) -> np.ndarray:
        """Return the matte (H, W) of a photograph (H, W, 3), encoded in [0, 1]; zero if nobody is there."""
        return self.matte(encoded, self._person)

    def matte(
        self,
        encoded: np.ndarray,
        person: PersonChoice | Circle,
        people: Sequence[DetectedPerson] | None = None,
    ) -> np.ndarray:
        """Return the matte of a photograph as a call does, of another person.

        `people`: who is in it, unless they are to be looked for.
        """
        try:
            choice = self._finder.choose(encoded, person, people)
        except EmptyMatteError:
            return np.zeros(encoded.shape[:2], np.float32)
        if choice.index is not None and choice.people[choice.index].certainty < CERTAIN:
            warnings.warn(UNCERTAIN, stacklevel=2)
        if self._is_rough:
            return silhouette.rough_matte(encoded, choice)
        if self._network is not None:
            more = functools.partial(self._finder.with_more_views, encoded)
            return silhouette.person_matte(encoded, choice, self._network, more)
        choice = self._finder.with_more_views(encoded, choice)
        from relight.matting import outline  # whose parts of SciPy take long to load

        codes = np.rint(encoded * 255).astype(np.uint8)
        mask = silhouette.mended_mask(encoded, choice, cutout_network.load())
        return outline.refine(codes, outline.outlined(codes, outline.Outline(matte=mask)))

    def seen(self, encoded: np.ndarray, near: Circle | None) -> Seen:
        """Return who is in a photograph, among them whoever is `near` if they are there."""
        thorough = self._person is not None and near is None
        return Seen.of(encoded, self._finder.people(encoded, thorough, near))

    def reset(self) -> None:
        """Do nothing: each photograph is looked at by itself."""


class PersonFinder:
    """Both networks: `detector` and `landmarks` are the paths of their files, in a format of OpenVINO's."""

    def __init__(self, detector: AnyPath, landmarks: AnyPath) -> None:
        self._detector, self._landmarks = Detector(compiled(str(detector))), compiled(str(landmarks))

    def mask(self, encoded: np.ndarray, person: PersonChoice | Circle = None) -> np.ndarray:
        """Return the mask (H, W) of a person in a photograph (H, W, 3), sRGB-encoded; see `find`."""
        return self.with_more_views(encoded, self.choose(encoded, person)).mask()

    def choose(
        self,
        encoded: np.ndarray,
        person: PersonChoice | Circle = None,
        people: Sequence[DetectedPerson] | None = None,
    ) -> Choice:
        """Return who is meant in a photograph (H, W, 3), sRGB-encoded; see `find`.

        `people`: who is in it, unless they are to be looked for.
        """
        size, person = (encoded.shape[0], encoded.shape[1]), as_circle(person)
        near = person if isinstance(person, Circle) else None
        copies = Copies.of(encoded)
        thorough = person is not None and near is None
        found = self._people(copies, thorough, near) if people is None else list(people)
        if not found:
            raise EmptyMatteError(NOBODY)
        choice = Choice.of(found, person, size)
        if choice.index is None:
            return choice
        is_point = not isinstance(person, int | str | Circle | None)
        at = np.array(person, float) if is_point else None
        first = found[choice.index]
        found[choice.index] = neighbours.alone(
            copies.for_circle(first.circle), first, self._detector, self.look, at
        )
        return replace(choice, people=tuple(found))

    def people(
        self, encoded: np.ndarray, thorough: bool = False, near: Circle | None = None
    ) -> list[DetectedPerson]:
        """Return everybody in a photograph (H, W, 3), encoded in [0, 1]: who is certain, the largest first.

        Smaller parts of the picture are looked at until somebody is found who is like `near`, if that is
        given; all of them if `thorough`.
        """
        return self._people(Copies.of(encoded), thorough, near)

    def turns_to_upright(self, encoded: np.ndarray, found: Sequence[DetectedPerson]) -> int:
        """Return by how many quarter turns, clockwise, somebody in a photograph comes to stand upright.

        It is 0 if somebody does so already. `found`: who was found in it, (H, W, 3), encoded in [0, 1]. On
        its side, and upside down, the networks see either nobody or parts that resemble somebody.
        """
        if found and found[0].certainty >= CERTAIN:
            copies = Copies.of(encoded)
            seen = self._detector(copies.reduced, SHARES[0], SCORES[1])[:MOST]
            circles = [Circle.of(hips * copies.scale, rim * copies.scale) for hips, rim in seen]
            if any(found[0].circle.distance(circle) < ALIKE for circle in circles):
                return 0
        areas = [found[0].area if found and found[0].certainty >= CERTAIN else 0.0]
        for turns in (1, 2, 3):
            copies = Copies.of(np.ascontiguousarray(np.rot90(encoded, -turns)))
            upright = [
                person.area
                for hips, rim in self._detector(copies.reduced, SHARES[0], SCORES[0])[:1]
                for person in self.look(copies.reduced, Circle.of(hips, rim), copies.scale)
                if person.certainty >= CERTAIN
            ]
            areas.append(max(upright, default=0.0))
        return int(np.argmax(areas))

    def _people(self, copies: Copies, thorough: bool, near: Circle | None) -> list[DetectedPerson]:
        found: list[DetectedPerson] = []
        for score, share in itertools.product(SCORES, SHARES):
            seen = list(found)
            for hips, rim in self._detector(copies.reduced, share, score)[:MOST]:
                start = Circle.of(hips * copies.scale, rim * copies.scale)
                if not any(each.certainty >= CERTAIN and each.has_part(start) for each in seen):
                    picture, scale = copies.for_circle(start)
                    seen += self.look(picture, start, scale)
            found = distinct(seen, copies.size)
            enough = any(
                each.certainty >= CERTAIN and (near is None or each.circle.distance(near) < ALIKE)
                for each in found
            )
            # The largest person may be one whom the frame cuts, and whom only the second share shows.
            if found and (share == SHARES[-1] or (enough and not thorough and share != SHARES[0])):
                break
        return sorted(
            found, key=lambda each: (each.certainty < CERTAIN, -min(each.certainty, CERTAIN), -each.area)
        )

    def look(
        self, picture: torch.Tensor, around: Circle, scale: np.ndarray = UNSCALED
    ) -> list[DetectedPerson]:
        """Return who is in a circle of the full picture, seen in a copy (3, h, w); nobody or one.

        The copy is sRGB-encoded in [0, 1]; `scale` (x, y) leads from it to the picture.
        """
        circle, opinions = around.reduced(scale), []
        for _ in range(ROUNDS):
            square = circle.square(LANDMARK_SIDE)
            presence, _, points = self._infer(sampled(picture, square, LANDMARK_SIDE, "border"))
            opinions.append(presence)
            circle = Circle.of(*(points[[HIPS, RIM]] @ square[:, :2].T + square[:, 2]))
        if max(opinions) < HOPELESS:
            return []
        del opinions[:-1]  # the first ones are of circles that may be far off
        views = [self._view(picture, circle.of_size(share)) for share in SQUARES]
        opinions += [presence for view in views for presence in view.presences]
        place = Circle(circle.centre * scale, circle.radius * float(scale.mean()), circle.up)
        mask = joined(views, circle, LANDMARK_SIDE)
        person = DetectedPerson(place, mask, float(np.mean(opinions)), views[0].landmarks * scale)
        return [person] if person.certainty >= PRESENT else []

    def with_more_views(self, encoded: np.ndarray, choice: Choice) -> Choice:
        """Return a choice with a mask from more views, near and far, and around what these show.

        Before clutter a single view may take parts of it for the person. It then seldom agrees with its
        mirror image. Beside other people all views may agree on a part of a neighbour, so the choice is
        unchanged unless it is of one person alone.
        """
        if choice.index is None or sum(each.certainty >= LIKELY for each in choice.people) > 1:
            return choice
        person = choice.people[choice.index]
        if person.rivals is not None:
            return choice
        picture, scale = Copies.of(encoded).for_circle(person.circle)
        circle = person.circle.reduced(scale)
        views = [self._view(picture, circle.of_size(share)) for share in NEAR_AND_FAR]
        views += [
            self._view(picture, view.next.of_size(share)) for view in list(views) for share in NEAR_AND_FAR
        ]
        uncertainties = np.array([view.uncertainty for view in views])
        if uncertainties.min() > USELESS:
            return choice
        mask = joined(
            views,
            circle.of_size(FRAME),
            2 * LANDMARK_SIDE,
            np.exp(-(uncertainties - uncertainties.min()) / SPREAD),
        )
        better = replace(person, circle=person.circle.of_size(FRAME), mask=mask)
        return replace(choice, people=tuple(better if each is person else each for each in choice.people))

    def _view(self, picture: torch.Tensor, circle: Circle) -> View:
        """Look at the square around a circle of a picture (3, h, w), and at its mirror image."""
        square = circle.square(LANDMARK_SIDE)
        canvas = sampled(picture, square, LANDMARK_SIDE, "border")
        (first, mask, points), (second, mirrored, others) = (
            self._infer(canvas),
            self._infer(canvas[:, :, ::-1]),
        )
        points, others = (
            each @ square[:, :2].T + square[:, 2] for each in (points, others * [-1, 1] + [LANDMARK_SIDE, 0])
        )
        around = Circle.of(*((points + others) / 2)[[HIPS, RIM]])
        return View(circle, (mask, mirrored[:, ::-1]), (first, second), points, around, picture.shape[1:])

    def _infer(self, canvas: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Return the presence, the mask and the landmarks (x, y) on a canvas."""
        landmarks, presence, logits, *_ = self._landmarks(np.ascontiguousarray(canvas)).values()
        points = landmarks.reshape(-1, LANDMARK_VALUES)[:, :2]
        return float(presence.ravel()[0]), expit(logits[0, :, :, 0].astype(np.float32)), points
