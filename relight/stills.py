"""A relit still, from files to files."""

import os
from collections.abc import Callable, Iterable
from pathlib import Path

from relight import keying
from relight.cutting import Cutting
from relight.floor import Floor
from relight.lights.environment import FIELD_OF_VIEW
from relight.lights.light import Light, by_name
from relight.matching import Matching, lights_in
from relight.media import images, movies, nuke
from relight.media.sequences import Sequence
from relight.outputs import check, check_display, write_picture
from relight.preparation import Placement, Preparation, Source, Surface
from relight.rendering import Background, check_exr_type, check_names, described, render_subject
from relight.subject import Subject
from shadow import inputs
from shadow.directions import CAMERA


def render_still(
    source: Source,
    lights: Light | Iterable[Light],
    outputs: str | Path | Iterable[str | Path],
    *,
    mask: Source | None = None,
    key: str | None = None,
    cutting: Cutting | None = None,
    background: Background | str | Path | None = None,
    field_of_view: float = FIELD_OF_VIEW,
    placement: Placement | None = None,
    matching: Matching | None = None,
    colour_space: str | None = None,
    normals: Surface | None = None,
    axes: str = CAMERA,
    depth: Source | None = None,
    height: float | None = None,
    passes: Iterable[str] = (),
    exr_type: str = "half",
    autocrop: bool = False,
    floor: Floor | None = None,
    view: str | None = None,
    exposure: float = 0.0,
    save_matte: str | Path | None = None,
    save_lights: str | Path | None = None,
    device: str | None = None,
    progress: Callable[[str], None] | None = None,
) -> list[Path]:
    """Relight the person in a photograph, and write the picture.

    Parameters
    ----------
    source, mask, key, cutting, colour_space, normals, axes, depth, height, background, field_of_view,
        placement, matching: as of `relight.preparation.Preparation`; stills alone.
    lights: a light, or any number of them.
    outputs: a path or several: files that `relight.write` writes, of which an .exr holds light groups and
        passes as layers; and with an .exr, a Nuke script, .nk, that rebuilds the mix.
    passes: further layers of an .exr, of relight.rendering.PASSES.
    exr_type: "half" or "float", what an .exr holds. autocrop: whether it stores the person's box alone; as
        of `relight.write`.
    floor: relight.Floor that the person stands on: their shadow falls on the background.
    view, exposure: how light becomes what a display shows, see `relight.media.colour.encode`.
    save_matte: also write the matte alone, grey: PNG, TIFF or OpenEXR.
    save_lights: also write the lights to a lights file.
    device: where the networks run, such as "cuda"; the CPU unless given.
    progress: called with what is being done, before each step.

    Returns
    -------
    The paths written, in this order: pictures, the matte, scripts.

    Raises
    ------
    FileNotFoundError, OSError: a file cannot be read or written. TypeError, ValueError: bad arguments,
    outputs that are read as well, two lights of one name. All but what the picture itself shows is refused
    before the networks run.
    """
    report = progress or (lambda what: None)
    paths = [Path(path) for path in ([outputs] if isinstance(outputs, str | Path) else outputs)]
    matte_path = None if save_matte is None else Path(save_matte)
    lights_path = None if save_lights is None else Path(save_lights)
    for path in (source, mask, background, normals, depth, *paths, matte_path):
        if isinstance(path, str | os.PathLike) and (movies.is_movie(path) or Sequence.of(path) is not None):
            raise ValueError(f"{path}: expected one picture's file; frames are made by a video")
    lights, matching = list(by_name(lights).values()), matching or Matching()
    read = (source, mask, background, normals, depth, matching.reference, matching.mask, *lights)
    check(paths, read, mattes=matte_path, lights=lights_path, maps=matching.keeps(lights_path))
    passes = check_names(passes, paths)
    display = {"view": view, "exposure": exposure}
    check_display(display)
    check_exr_type(exr_type)
    inputs.device("device", device)
    prepared = Preparation(
        source, mask=mask, key=key, cutting=cutting, colour_space=colour_space, normals=normals, axes=axes,
        depth=depth, height=height, background=background, field_of_view=field_of_view, placement=placement,
        matching=matching,
    )  # fmt: skip
    prepared.check_lights(lights)
    if any(path.suffix.lower() == ".nk" for path in paths):
        nuke.check_layers(f"C_{name}" for name in by_name(lights))
    if (key is not None or cutting is not None) and not keying.is_compiled():
        report(keying.COMPILING)
    reference = matching.person(cutting)
    person = prepared.person(0)
    lights += prepared.borrowed(0, person.plate.shape[:2])
    if floor is not None:
        floor.check(person.plate, person.matte)
    if reference is not None:
        report("Matching")
        lights += lights_in(*reference, device=device)
    report("Relighting")
    subject = Subject(
        person.plate, person.matte, normals=person.normals, depth=person.depth, height=height,
        field_of_view=field_of_view, device=device,
    )  # fmt: skip
    backdrop = prepared.backdrop(0, lights, person.plate.shape[:2])
    picture, layers = render_subject(
        subject, lights, background=backdrop, passes=passes, exr_type=exr_type, floor=floor
    )
    if lights_path is not None:
        matching.write_lights(lights_path, lights)
    settings, metadata = {"depth": exr_type, "autocrop": autocrop}, described(subject, passes)
    for path in (pictures := [path for path in paths if path.suffix.lower() != ".nk"]):
        report(f"Writing {path}")
        write_picture(path, picture, layers, display, settings, metadata)
    mattes = [] if matte_path is None else [matte_path]
    for path in mattes:
        images.write_mask(path, person.plate[..., 3] if person.matte is None else person.matte)
    scripts = [path for path in paths if path not in pictures]
    for path in scripts:
        exr = next(other for other in pictures if other.suffix.lower() == ".exr")
        groups = {name.removeprefix("C_"): (exr, name) for name in layers if name.startswith("C_")}
        nuke.write_script(path, groups, picture.shape[:2])
    return [*pictures, *mattes, *scripts]
