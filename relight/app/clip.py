"""A movie in the app: a frame of it is shown and lit, and the whole movie is saved in that light.

The frame is a photograph like any other. A file beside it says of which movie it is, and the matte that was
accepted says who is followed.
"""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt

from relight.matting.people import files as person_files
from relight.matting.people import finder
from relight.matting.people.choice import CERTAIN
from relight.matting.refine import encoded_srgb, opaque_photograph
from relight.media import images
from relight.media.movies import Movie
from relight.pipeline.options import Lighting, Output, Source

SUFFIXES = (".mp4", ".mov")  # of what is written
CLIP = "clip.json"
SECONDS, STEPS = 10, 0.25  # from the beginning, and between frames, in which somebody is looked for
LEAST = 20  # frames that are looked at, of a short movie too
Report = Callable[..., None]  # (what is done, the share of the task that is done, if that is known)


def read(name: str) -> dict[str, object]:
    """Write the first frame with a person as a PNG, and keep of which movie and frame it is.

    Without the networks that find people, and where nobody is found, it is the first frame.
    """
    movie = Movie(name)
    number = _first_with_person(movie)
    still = f"{Path(name).stem}-frame{number}.png"
    images.write(still, movie.read(number))
    Path(CLIP).write_text(json.dumps({"name": name, "frame": number}))
    return {"still": still, "frame": number}


def _first_with_person(movie: Movie) -> int:
    """Return the first frame in which somebody is found for certain, in steps through the first seconds."""
    if not person_files.are_fetched():
        return 1
    rate = float(movie.rate or 24)
    begin = movie.numbers[: max(1, round(SECONDS * rate))]
    looked_at = begin[:: max(1, min(round(STEPS * rate), len(begin) // LEAST))]
    people = finder.load()
    for number in looked_at:
        encoded = encoded_srgb(opaque_photograph(movie.read(number), "plate"))
        if any(each.certainty >= CERTAIN for each in people.people(encoded)):
            return number
    return 1


def name() -> str | None:
    """Return the name of the movie of which the photograph in this folder is a frame; None for others."""
    return json.loads(Path(CLIP).read_text())["name"] if Path(CLIP).exists() else None


def person(matte: np.ndarray, side: int) -> tuple[int, int]:
    """Return a point (x, y) on a person, deep within their matte (h, w), in pixels of a frame.

    `side`: the longer side of the frame.
    """
    depth = distance_transform_edt(np.pad(matte > 0.5, 1))[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(depth)), depth.shape)
    scale = side / max(matte.shape)
    return int((column + 0.5) * scale), int((row + 0.5) * scale)


def save(movie: str, who: tuple[int, int], lighting: Lighting, output: Output, report: Report) -> None:
    """Do what `relight.render_shot` does for the whole movie, and tell how far it is."""
    from relight.pipeline.render import render_shot

    def progress(done: int, total: int, step: str) -> None:
        report(f"{step}: {done} of {total}", done / total if step == "Relighting" else None)

    problems = render_shot(Source(movie, person=who), lighting, output, progress=progress)
    if problems:
        number, problem = next(iter(problems.items()))
        raise ValueError(f"{len(problems)} frames could not be made; frame {number}: {problem}")
