"""Light estimated from pictures: from a photograph of a person, or from a background."""

import warnings
from dataclasses import replace
from typing import cast

import numpy as np

from relight.analysis.foreground import linear_plate, plate_coverage
from relight.analysis.light_solver import LightSolver
from relight.arguments import checks_arguments
from relight.lights.directional import DirectionalLight
from relight.lights.environment import EnvironmentLight
from relight.lights.plate import few_rows, opaque, whole_field_of_view
from relight.lights.rig import FewLights
from relight.matting.sequence import MattingOptions, SequenceMatting
from relight.media import images, movies
from relight.media.sequences import Reader
from relight.subject import Subject
from shadow import inputs
from shadow.files import AnyPath, is_path
from shadow.torch_settings import isolated

PLATE = "plate"  # the name of the background's light
FILL = "background_fill"  # that of the background's light that fills the shadows of others
MATCH_PREFIX = "match"  # of the names of a reference's lights
DROPPED_SHARE = 0.01  # share of all light that the weakest lights of a reference have together
WINDOW_RADIUS = 12  # frames before and after one whose backgrounds light it as well: a second in all


@isolated
@checks_arguments
def fit_lights(
    image: inputs.Array, subject: Subject | None = None, *, count: FewLights | None = None
) -> list[DirectionalLight]:
    """Estimate the lights of a photograph: those in which the subject looks most like the image.

    Image = albedo × Σ weight × shading is solved for the weights of the 96 OLAT directions by non-negative
    least squares (`shading.infer_lighting`). To light another person like a reference picture, fit the
    reference, and pass its lights to the other person's `Subject.relit`, or see `match`.

    Parameters
    ----------
    image
        (H, W, 3|4) as `relight.Subject` takes it.
    subject
        The Subject of that picture, or of another picture of the same person in the same pose and framing. By
        default it is made from the image, which then needs alpha.

    count
        Number of lights at most, in [1, 32]: neighbours are merged into lights with an angle. None: one for
        each direction, up to 96, which explain the picture best.

    Returns
    -------
    list[DirectionalLight]
        The lights, the strongest first, named `fit1`, `fit2`...; none for a black picture. They include the
        exposure. The colour cast of a subject's own photograph is part of its albedo, so the sum of such
        lights is about white.

    Raises
    ------
    TypeError, ValueError
        As `relight.Subject`; an image of another size than the subject's.

    Examples
    --------
    >>> image = relight.read("reference.png")
    >>> lights = relight.fit_lights(image, relight.Subject(image, relight.read_mask("matte.png")))
    """
    person = Subject(image) if subject is None else subject
    return _fitted(person, image) if count is None else _few(person, image, count)


def _few(subject: Subject, image: inputs.Array, count: int) -> list[DirectionalLight]:
    """Return at most `count` lights, see `fit_lights`."""
    grid = subject.light_grid()
    wanted = grid.photographed(image).double().numpy()
    solved = LightSolver(grid, []).solve(wanted, np.ones(len(grid)), count)
    lights = cast(list[DirectionalLight], solved)  # for none were there
    lights.sort(key=lambda light: -light.power.sum())
    return [replace(light, name=f"fit{number}") for number, light in enumerate(lights, 1)]


def _fitted(subject: Subject, image: inputs.Array) -> list[DirectionalLight]:
    """See `fit_lights`."""
    directions, powers = subject.fit_lighting(image)
    order = np.argsort(-powers.sum(axis=1), kind="stable")
    shining = [index for index in order if powers[index].any()]
    return [
        DirectionalLight(directions[index].tolist(), colour=powers[index].tolist(), name=f"fit{number}")
        for number, index in enumerate(shining, 1)
    ]


@isolated
@checks_arguments
def match(
    subject: Subject, reference: inputs.Array, *, mask: inputs.Array | None = None
) -> list[DirectionalLight]:
    """Estimate the lights of a photograph of another person, to relight a subject with them.

    Parameters
    ----------
    subject
        relight.Subject, the person to relight.
    reference
        (H, W, 3|4), the photograph of another person, as `relight.Subject` takes it.
    mask
        (H, W), the matte of that person; needed unless the reference has alpha.

    Returns
    -------
    list[DirectionalLight]
        Lights for `subject.relit`, the strongest first, named `match1`, `match2`...; none for a black
        picture. They have the exposure of the reference: a surface of the same albedo becomes as bright as
        there. The weakest lights, together 1 % of the light, are dropped, and the others are scaled to the
        same sum. A tint of the whole reference counts as part of its albedo (see `relight.fit_lights`).

    Raises
    ------
    TypeError
        No Subject.
    TypeError, ValueError
        As `relight.Subject`, of the reference.

    Examples
    --------
    >>> subject = relight.Subject(relight.read("examples/person.png"))
    >>> lights = relight.match(subject, relight.read("reference_cut.png"))
    >>> picture = subject.relit(lights)
    """
    if not isinstance(subject, Subject):
        raise TypeError(f"subject: expected a relight.Subject, got {type(subject).__name__}")
    images.scene_linear("reference", reference)  # which is no image of the subject's
    if mask is not None:
        images.coverage("mask", mask)
    return lights_in(reference, mask)


def lights_in(
    reference: inputs.Array, mask: inputs.Array | None = None, device: str | None = None
) -> list[DirectionalLight]:
    """Estimate the lights of a photograph, as `match` does. `device`: where the networks run."""
    return lights_on(Subject(reference, mask, device=device), reference)


def lights_on(person: Subject, photograph: inputs.Array) -> list[DirectionalLight]:
    """Estimate the lights of the photograph of an analysed person, as `match` does."""
    lights = _fitted(person, photograph)
    if not lights:
        return []
    powers = np.array([light.power for light in lights])
    shares = powers.mean(axis=1).cumsum() / powers.mean(axis=1).sum()
    kept = int((shares < 1 - DROPPED_SHARE).sum()) + 1
    brighter = powers.sum(axis=0) / np.maximum(powers[:kept].sum(axis=0), 1e-9)
    powers = powers[:kept] * brighter
    # The scale differs from colour to colour, so two lights of about equal power may have changed places.
    order = np.argsort(-powers.mean(axis=1), kind="stable")
    return [
        replace(lights[index], colour=powers[index].tolist(), name=f"{MATCH_PREFIX}{number}")
        for number, index in enumerate(order, 1)
    ]


def read_reference(
    reference: inputs.Array | AnyPath,
    mask: inputs.Array | AnyPath | None,
    matting: MattingOptions | None = None,
) -> tuple[inputs.Array, inputs.Array | None]:
    """Read and check the photograph of another person and their matte, images or files.

    `matting`: how the matte is inferred if there is none. Raises ValueError if there then is none, or it is
    empty.
    """
    if is_path(reference):
        reference = images.read(reference)
    if is_path(mask):
        mask = images.read_mask(mask)
    try:
        pixels = linear_plate(reference)
        alone = mask is None and (pixels.shape[-1] == 3 or pixels[..., 3].min() == 1)
        if alone and matting is not None and matting.model is not None:
            there = replace(matting, person=None)  # which is the person of the plate
            return SequenceMatting(there, lambda number: reference, None).matte(0)
        if alone:
            raise ValueError(
                "the reference has no matte; expected one with alpha, or its matte (match_mask=FILE)"
            )
        plate_coverage(pixels, mask)
    except ValueError as error:
        raise ValueError(f"match: {error}") from error
    return reference, mask


class PlateLight:
    """The light of a background: once for a still, for each frame of one that moves.

    The light of a moving background is averaged over a second with a Hann window, so that it does not
    flicker.
    """

    def __init__(self, backgrounds: Reader, field_of_view: float) -> None:
        """Take the picture's vertical field of view in degrees; the background covers the picture."""
        if isinstance(backgrounds, movies.Movie):  # a second reader: going back starts a movie over
            backgrounds = movies.Movie(backgrounds.path, colour_space=backgrounds.colour_space)
        self._backgrounds, self._field_of_view = backgrounds, field_of_view
        self._maps: dict[int, np.ndarray] = {}
        self._unreadable: set[int] = set()  # frames that were warned of

    def check(self, option: str) -> None:
        """Raise ValueError, by the option's name, unless the background, or its first frame, is opaque."""
        first = self._backgrounds.read((self._backgrounds.numbers or [0])[0])
        if np.ndim(first) != 3:
            raise ValueError(f"{option}: expected a background that is an image (background=FILE)")
        opaque(first)

    def frames_for(self, number: int) -> list[int]:
        """Return the frames of the background whose light is averaged for a frame."""
        if self._backgrounds.numbers is None:
            return [0]
        there = set(self._backgrounds.numbers)
        return [n for n in range(number - WINDOW_RADIUS, number + WINDOW_RADIUS + 1) if n in there]

    def at(self, number: int, size: tuple[int, ...]) -> EnvironmentLight:
        """Return the light of a frame, whose picture has a `size` (H, W).

        Raises as reading and `EnvironmentLight.from_plate` do.
        """
        seen = self.frames_for(number)
        self._maps = {n: found for n, found in self._maps.items() if n in seen}
        for n in seen:
            if n not in self._maps:
                try:
                    self._maps[n] = self._map(n, size)
                except (OSError, ValueError) as error:
                    if n == number or self._backgrounds.numbers is None:
                        raise
                    self._warn(n, error)
        seen = [n for n in seen if n in self._maps]
        if not seen:
            self._backgrounds.read(number)  # raises, and names the missing frame
        weights = [np.cos(np.pi / 2 * (n - number) / (WINDOW_RADIUS + 1)) ** 2 for n in seen]
        return EnvironmentLight(np.average([self._maps[n] for n in seen], 0, weights), name=PLATE)

    def _warn(self, number: int, error: Exception) -> None:
        """Warn, once for each frame, that a frame of the background cannot be read."""
        if number not in self._unreadable:
            self._unreadable.add(number)
            warnings.warn(
                f"background: frame {number}: {error}; its light is that of the frames before and after it",
                stacklevel=3,
            )

    def _map(self, number: int, size: tuple[int, ...]) -> np.ndarray:
        """Return the environment map of a frame of the background."""
        pixels = opaque(self._backgrounds.read(number))
        whole = whole_field_of_view(pixels.shape, size, self._field_of_view)
        if self._backgrounds.numbers is not None:
            pixels = few_rows(pixels)
        return EnvironmentLight.from_plate(pixels, whole).image.pixels
