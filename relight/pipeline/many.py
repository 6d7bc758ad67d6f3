"""Many pictures relit in one run: the networks are loaded once, and one that fails stops no other."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from relight.media.images.read_image import READ
from relight.media.images.write_image import DEPTHS
from relight.media.movies import WRITTEN, is_movie
from relight.media.sequences import TOKEN
from relight.pipeline.early_checks import check_there
from relight.pipeline.option_fields import Report
from relight.pipeline.options import Output, Source
from shadow.files import is_path

ANALYSIS = ".relight"  # of the name of an analysis cache, a folder too
NAME = "{name}"  # in an output's name: that of the picture, without its suffix
PICTURE, MOVIE = ".png", ".mp4"  # written to a folder where the source's own format is not written


class OneOfMany(NamedTuple):
    """A picture among many: what is read, and the files that are written of it."""

    source: Source
    output: Output


def pictures_in(folder: Path) -> list[Path]:
    """Return the pictures and movies of a folder, by name; none of an analysis cache."""
    if folder.suffix.lower() == ANALYSIS:
        return []
    shown = (path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    return sorted(path for path in shown if path.suffix.lower() in READ or is_movie(path))


def many(source: Source, further: Iterable[str], output: Output) -> list[OneOfMany]:
    """Return the pictures of a command that names several, folders of pictures, or an output with {name}.

    Empty for one picture with outputs of its own. Raises ValueError for outputs that do not tell the
    pictures apart.
    """
    given: list[Any] = [source.plate, *further]
    folders = {path: pictures_in(Path(path)) for path in given if is_path(path) and Path(path).is_dir()}
    outputs = [*output.paths, *_further_outputs(output).values()]
    named = any(NAME in str(path) or path.is_dir() for path in outputs)
    if len(given) == 1 and not any(folders.values()) and not named:
        return []
    plates = [Path(plate) for path in given for plate in folders.get(path) or [path]]
    listed = [OneOfMany(replace(source, plate=plate), _named(output, plate)) for plate in plates]
    written: dict[Path, object] = {}
    for each in listed:
        for path in (*each.output.paths, *_further_outputs(each.output).values()):
            if path in written:
                if path in outputs:
                    example = f"such as out/{NAME}.png, or a folder"
                    raise ValueError(
                        f"{path}: expected {NAME} in the name, {example}, for {len(plates)} pictures"
                    )
                raise ValueError(f"{path}: is that of two pictures, {written[path]} and {each.source.plate}")
            written[path] = each.source.plate
    return listed


def render_many(
    listed: Iterable[OneOfMany], render: Callable[..., dict[int, str]], progress: Report, **options: object
) -> dict[str, str]:
    """Render pictures one by one with a function such as `render_shot`; return {picture: error}.

    `options`: further arguments of the function.
    """
    listed, problems = list(listed), {}
    for done, (source, output) in enumerate(listed):
        progress(done, len(listed), "Pictures")
        try:
            check_there(str(source.plate))
            failed = render(source, output=output, **options)
            if failed:
                number, problem = next(iter(failed.items()))
                raise ValueError(f"{len(failed)} frames failed; frame {number}: {problem}")
        except (OSError, ValueError) as error:
            problems[str(source.plate)] = str(error)
    progress(len(listed), len(listed), "Pictures")
    return problems


def make_folders(listed: Iterable[OneOfMany]) -> None:
    """Make the folders that the outputs are written to."""
    for each in listed:
        for path in (*each.output.paths, *_further_outputs(each.output).values()):
            path.parent.mkdir(parents=True, exist_ok=True)


def _is_target_folder(path: Path) -> bool:
    return path.is_dir() or not path.suffix


def _further_outputs(output: Output) -> dict[str, Path]:
    fields = {name: getattr(output, name) for name in ("save_matte", "save_lights", "report", "plot")}
    return {name: path for name, path in fields.items() if path is not None}


def _named(output: Output, plate: Path) -> Output:
    """Return the outputs of one picture: {name} is its name, and a folder gets a file of that name."""
    name = TOKEN.sub("", plate.stem).rstrip("._-") or plate.stem
    suffix = plate.suffix.lower()
    if suffix not in (*DEPTHS, *WRITTEN):
        suffix = MOVIE if is_movie(plate) else PICTURE

    def file(path: Path) -> Path:
        filled = Path(str(path).replace(NAME, name))
        return filled / f"{name}{suffix}" if _is_target_folder(filled) else filled

    further: dict[str, Any] = {field: file(path) for field, path in _further_outputs(output).items()}
    return replace(output, paths=tuple(map(file, output.paths)), **further)
