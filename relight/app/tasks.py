"""What the worker process computes.

Each function runs in a photograph's folder and names files relative to it.
Pictures are made by the code of `relight apply`, pages by that of `relight view`.
"""

import base64
import json
import re
import warnings
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import ParamSpec

import numpy as np
import torch

from relight.app import clip, drawing, matching, painting, people, preset_pictures, turning
from relight.app.drawing import MODEL, REDUCED
from relight.app.messages import AS_IT_IS, IN_PLACE, NO_LOOK, Drawing, Form, Look, Place
from relight.app.pictures import png, resized
from relight.compositing.floor import Floor
from relight.compositing.placement import place
from relight.errors import EmptyMatteError
from relight.light_estimation import PlateLight
from relight.lights import presets
from relight.lights.environment import FIELD_OF_VIEW, EnvironmentLight
from relight.lights.rig import as_lights, scaled
from relight.matting import networks, outline, refine, silhouette_files
from relight.matting.people import files as person_files
from relight.matting.people import finder
from relight.matting.sequence import MattingOptions
from relight.media import images
from relight.media.colour import encode
from relight.media.images.encode import compressed
from relight.media.images.write_image import encoded
from relight.media.resampling import size_within
from relight.media.sequences import Still
from relight.pipeline.options import Lighting, Output, Source
from relight.quantities import NONE, PLATE
from relight.rendering import lit_backdrop, partial_shadow
from relight.scene.plot import plot_of
from relight.subject import Subject
from relight.viewer.initial_state import fill_lamps, scene_of
from relight.viewer.packing import pack
from shadow.files import replacing

PREVIEW_SIDE = 1600  # pixels, the longer side of what the page shows and the outline is solved on
PREVIEWS = "page"  # folder of what the page shows: no upload has this name, which has no suffix
BACKGROUND_SIDE = 2048  # pixels, the longer side of a background on the page, at most
KEPT = 2  # subjects that are kept in memory, for stills
KEPT_PIXELS = 4_000_000  # of a photograph that was saved, whose subject is kept for the next file, at most
ORIGINAL = "original"  # as a background: the photograph itself
PLOT = "plot.svg"  # beside the previews
MATTE, PACK = "matte.npy", "pack.bin"
LOADED, EDGE = "loaded.npy", "edge.json"  # a matte from a file, in full; what is done to the accepted matte
SIDE = "side.txt"  # the photograph's longer side, in pixels
READ, ANALYSED, RELIT = 0.3, 0.5, 0.9  # shares of the time to save 24 megapixels that have passed, roughly
Arguments = ParamSpec("Arguments")
Report = Callable[..., None]  # (what is done, the share of the task that is done, if that is known)

subjects: OrderedDict[str, Subject] = OrderedDict()
kept_subjects: dict[tuple[object, ...], Subject] = {}  # at full size, of the files that were saved last


def load_networks() -> None:
    """Read the weights of the networks."""
    from shading import diffuse
    from shadow import analysis

    analysis.load(device=torch.device("cpu"))
    diffuse.load(device=torch.device("cpu"))


def load_matting() -> None:
    """Solve a small outline, which compiles the solver or loads its compiled code."""
    square = outline.Outline([(8, 8), (24, 8), (24, 24), (8, 24)])
    outline.outlined(np.random.default_rng(0).random((32, 32, 3), np.float32), square)


def load_finder() -> None:
    """Read the networks that find people and cut them out, where they have been fetched."""
    if person_files.are_fetched():
        finder.FoundPerson()


PREPARATIONS: tuple[Callable[[], object], ...] = (  # the worker runs them while nobody waits for it
    load_networks,
    load_finder,
    partial(scene_of, (1, 1)),  # the colours of temperatures, which every page has
    load_matting,
)


def read(name: str, report: Report) -> dict[str, object]:
    """Read a photograph; write the copy that the page shows, and the one that outlines are solved on."""
    pixels = images.read(name)
    height, width = pixels.shape[:2]
    if min(height, width) < 16:
        raise ValueError(f"{name}: expected 16 pixels a side or more, got {width} x {height}")
    cut_out = pixels.shape[-1] == 4 and float(pixels[..., 3].min()) < 1
    size = size_within(pixels.shape, PREVIEW_SIDE)
    reduced = resized(pixels if cut_out else np.ascontiguousarray(pixels[..., :3]), size)
    _save_array(REDUCED, reduced)
    Path(SIDE).write_text(str(max(height, width)))
    Path(PREVIEWS).mkdir(exist_ok=True)
    preview, kind = f"{PREVIEWS}/preview.{'png' if cut_out else 'jpg'}", "PNG" if cut_out else "JPEG"
    # It may be the background as well.
    Path(preview).write_bytes(compressed(encoded(reduced), kind, quality=95, subsampling=0))
    return {"width": width, "height": height, "cut_out": cut_out, "preview": preview}


def read_clip(name: str, report: Report) -> dict[str, object]:
    """Take the first frame with a person out of a movie, see `clip.read`."""
    return clip.read(name)


def outline_of(drawn: Drawing, report: Report) -> dict[str, object]:
    """Return the matte of a drawn outline, as a grey PNG of the preview's size."""
    return {"png": png(drawing.shifted(drawing.solved(drawn), *drawing.edge_of(drawn)))}


def fetch_person(report: Report) -> dict[str, object]:
    """Bring the networks that find people."""
    person_files.fetch(progress=_megabytes(report))
    return {}


def fetch_silhouette(report: Report) -> dict[str, object]:
    """Bring the network that cuts people out."""
    silhouette_files.fetch(progress=_megabytes(report))
    return {}


def _megabytes(report: Report) -> Callable[[int, int, str], None]:
    """Return what reports a download that is told in bytes."""

    def told(done: int, total: int, what: str) -> None:
        if total:
            report(f"{what}: {done / 1e6:.0f} of {total / 1e6:.0f} MB", done / total)
        else:
            report(what)

    return told


def find_person(person: int | str, report: Report) -> dict[str, object]:
    """Find the people, and keep the matte of one of them, which an outline may correct.

    `person`: their number, the largest is 1; or "everyone". Returns who is there, the matte's name, and what
    is odd about it, see `relight.app.people`.
    """
    report("Finding the person")
    found = people.found()
    if not found.people and found.turns:
        return {"people": [], "model": None, "oddity": "turned", "turns": found.turns}
    everyone = person == people.EVERYONE
    if not everyone and not 1 <= int(person) <= max(1, len(found.people)):
        raise ValueError(f"person: expected 1 to {len(found.people)}, got {person}")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", re.escape(finder.UNCERTAIN))  # `oddity` says so
        matte = finder.FoundPerson().matte(found.picture, "all" if everyone else person, found.people)
    if matte.max() <= 0.5:
        raise EmptyMatteError("No person was found: draw a line around them.")
    model = people.EVERYONE if everyone else f"person-{person}"
    _keep_matte(matte, drawing.matte_file(model))
    about = {"oddity": found.oddity(person, matte), "turns": found.turns}
    return {"people": found.outlines(), "model": model, **about}


def turn(name: str, turns: int, report: Report) -> dict[str, object]:
    """Turn a photograph clockwise by quarter turns, 0 to 3; what was found in it is forgotten."""
    found = [path for path in Path().glob("*.npy") if drawing.PERSON.fullmatch(path.stem)]
    for path in (*map(Path, (MODEL, MATTE, EDGE, LOADED)), *found):
        path.unlink(missing_ok=True)
    drawing.forget()
    return {"name": turning.turned(name, turns) if turns else name}


def matte_by_model(model: str, report: Report) -> dict[str, object]:
    """Return the matte that a network finds, as a grey PNG; the outline may correct it.

    `model` is as `relight apply --matte` takes it.
    """
    report("Finding the person")
    reduced = drawing.reduced()
    matting = MattingOptions.parse(model)
    if matting is None or matting.model is None:
        raise ValueError("model: expected an ONNX file, or the name of a model")
    matte = outline.refine(reduced, networks.matte(reduced, matting.model, **matting.options))
    _keep_matte(matte)
    return {"png": png(matte)}


def load_matte(name: str, report: Report) -> dict[str, object]:
    """Take a matte from a file, of the photograph's proportions, as that of a model."""
    loaded, size = images.read_mask(name), drawing.reduced().shape[:2]
    if abs(loaded.shape[1] / loaded.shape[0] / (size[1] / size[0]) - 1) > 0.01:
        raise ValueError(
            f"{name}: expected a matte of the photograph's proportions, "
            f"got {loaded.shape[1]} x {loaded.shape[0]}"
        )
    _save_array(LOADED, loaded)
    matte = resized(loaded[..., None].astype(np.float32), size)[..., 0].clip(0, 1)
    _keep_matte(matte)
    return {"png": png(matte)}


def _save_array(name: str, array: np.ndarray) -> None:
    """Write an array as half floats: whole or not at all, where the disk is full."""
    with replacing(name) as beside, beside.open("wb") as file:
        np.save(file, array.astype(np.float16))


def _keep_matte(found: np.ndarray, name: str = MODEL) -> None:
    """Keep the matte that a network found; an outline may start from it."""
    _save_array(name, found)
    drawing.forget()


def analyse(name: str, mask: str | None, drawn: Drawing | None, report: Report) -> dict[str, object]:
    """Refine an outline, analyse the person, and write what the page shows, all on the reduced copy.

    The matte's file, `mask`, is written at full resolution when it is needed: see `full_matte`.
    """
    reduced = drawing.reduced()
    matte, feather = None, 0.0
    if mask is not None and drawn is not None:
        edge = drawing.edge_kind(drawn)
        report("Refining the edge")
        unshifted = drawing.solved(drawn)
        if edge == drawing.SOLVED:
            unshifted = outline.refine(reduced[..., :3], unshifted)
        shift, feather = drawing.edge_of(drawn)
        matte = drawing.shifted(unshifted, shift)
    report("Analysing the person")
    subject = Subject(reduced, matte, feather=feather * max(reduced.shape))
    report("Preparing the light")
    packed = pack(subject.record, subject.matte, subject.albedo, compression=1)
    with replacing(PACK) as beside:
        beside.write_bytes(packed)
    if mask is not None and matte is not None:  # until here, what was accepted before is kept
        _save_array(MATTE, unshifted)
        Path(EDGE).write_text(json.dumps({"shift": shift, "feather": feather, "kind": edge}))
        Path(mask).unlink(missing_ok=True)
    scene: dict[str, object] = {**scene_of(subject.size, title=name, command=command_of(name, mask))}
    if reduced.shape[-1] == 3:
        plate = compressed(encoded(subject.clean_plate(reduced)), "JPEG", quality=95, subsampling=0)
        lamps = fill_lamps(reduced, reduced.shape[:2], FIELD_OF_VIEW)
        original = {"name": name, "data": base64.b64encode(plate).decode(), "lamps": lamps}
        scene |= {"opaque": True, "original": original}
    scene["presetGains"] = {preset: round(subject.preset_gain(preset), 4) for preset in presets.document()}
    for key in [key for key in subjects if key.startswith(_key(name))]:
        del subjects[key]  # those elsewhere in the picture too
    keep(name, subject)
    return {"scene": scene}


def full_matte(name: str, mask: str, report: Report) -> dict[str, object]:
    """Write the accepted matte at the photograph's own size and detail, unless that has been done."""
    if not Path(mask).exists():
        edge, pixels = json.loads(Path(EDGE).read_text()), images.read(name)
        report("Refining the edge", 0.0)
        matte = np.load(LOADED if edge["kind"] == drawing.FILE else MATTE).astype(np.float32)
        if matte.shape != pixels.shape[:2] and edge["kind"] == drawing.FOUND:
            matte = refine.upsampled(drawing.reduced()[..., :3].clip(0, 1), matte, pixels[..., :3].clip(0, 1))
        elif matte.shape != pixels.shape[:2]:
            matte = resized(matte[..., None], pixels.shape[:2])[..., 0].clip(0, 1)
            matte = outline.refine(pixels, matte) if edge["kind"] == drawing.SOLVED else matte
        images.write_mask(mask, drawing.shifted(matte, edge["shift"]))
    return {"file": mask}


def environment(name: str, report: Report) -> dict[str, object]:
    """Return an environment map as the page's program takes it."""
    light = EnvironmentLight(name)
    entry = scene_of((1, 1), light)["environment"]
    assert entry is not None
    return {"path": name, "lamps": entry["lamps"]}


def background(name: str, report: Report) -> dict[str, object]:
    """Return a background as the page shows it, behind photographs of any shape: a JPEG, in base64."""
    pixels = images.read(name)[..., :3]
    size = size_within(pixels.shape, BACKGROUND_SIDE)
    return {**(scene_of(size, background=pixels, background_name=name)["backdrop"] or {})}


def still(name: str, mask: str | None, look: Look, report: Report) -> dict[str, object]:
    """Relight the reduced copy and return a PNG, for browsers that cannot render it themselves."""
    subject, lighting = _subject(name, mask, report, look), lighting_of(look)
    lights = as_lights(lighting.rig().lights)
    behind = lighting.background
    if isinstance(behind, str) and behind != NONE:
        behind = images.read(behind)
    if lighting.fill:
        pixels = drawing.reduced() if behind is None else behind
        around = PlateLight(Still(pixels), FIELD_OF_VIEW)
        around.check("fill")
        lights = [*lights, *scaled([around.at(0, subject.size)], lighting.fill_amount)]
    picture = subject.relit(lights, lighting.effective_gloss, lighting.amount)
    if behind is None:
        behind = subject.clean_plate(drawing.reduced())
    back = None
    if isinstance(behind, np.ndarray | tuple):
        shadow = None
        if lighting.floor is not None:
            shadow = partial_shadow(subject.shadows(lights, lighting.floor)[1], lighting.amount)
        back = lit_backdrop(
            subject, picture, behind, shadow, lighting.background_blur, lighting.background_light
        )
        if back.max() > 1:  # light of a scene has one curve with the person
            picture, back = images.composited(picture, back), None
    return {"png": png(encoded(picture, back, exposure=exposure_of(look)))}


def floor_shadow(name: str, mask: str | None, look: Look, report: Report) -> dict[str, object]:
    """Return the factors by which the person's shadow on the floor dims the background: an encoded PNG."""
    subject, lighting = _subject(name, mask, report, look), lighting_of(look)
    if lighting.floor is None:
        raise ValueError("floor: expected one")
    lights = as_lights(lighting.rig().lights)
    return {"png": png(encode(subject.shadows(lights, lighting.floor)[1], white=1))}


def paint(name: str, mask: str | None, look: Look, strokes: object, report: Report) -> dict[str, object]:
    """Return the lights that strokes on the person ask for, see `relight.app.painting`."""
    subject, lighting = _subject(name, mask, report), lighting_of(look)
    lights, gloss = as_lights(lighting.rig().lights), lighting.effective_gloss
    began = json.dumps([look.get("lights"), look.get("environment"), gloss])
    return painting.painted(began, subject, lights, strokes, gloss)


def confidence(name: str, mask: str | None, light: str | None, report: Report) -> dict[str, object]:
    """Return how sure the shadows of a light are, or those of all directions, as a grey PNG."""
    of = None if light is None else as_lights(lighting_of({"lights": [light]}).rig().lights)[0]
    return {"png": png(_subject(name, mask, report).confidence(of))}


def plot(name: str, mask: str | None, look: Look, report: Report) -> dict[str, object]:
    """Draw the lighting plot of the lights, as `relight apply --plot` does."""
    subject, lights = _subject(name, mask, report), as_lights(lighting_of(look).rig().lights)
    return {"file": str(plot_of(Path(PREVIEWS, PLOT), lights, subject.camera, name))}


def match(
    name: str, mask: str | None, look: Look, reference: str | None, report: Report
) -> dict[str, object]:
    """Return lights as those of another photograph, or of the background if `reference` is None."""
    subject = _subject(name, mask, report)
    report("Matching the light")
    if reference is not None:
        return {"lights": matching.of_photograph(subject, images.read(reference))}
    behind = look.get("background")
    if behind == ORIGINAL:
        pixels = drawing.reduced()
    elif isinstance(behind, Mapping):
        pixels = images.read(behind["file"])
    else:
        raise ValueError("There is no picture behind the person: open one as the background.")
    return {"lights": matching.of_background(subject, pixels[..., :3])}


def preset_picture(name: str, mask: str | None, preset: str, report: Report) -> dict[str, object]:
    """Return a small picture of the person in the light of a preset: a PNG."""
    subject = _subject(name, mask, report)
    small = preset_pictures.small_of(subject, drawing.reduced())
    return {"png": png(encoded(preset_pictures.picture(small, preset, subject.preset_gain(preset))))}


def _subject(name: str, mask: str | None, report: Report, look: Look = NO_LOOK) -> Subject:
    """Return the subject of the reduced copy, which is analysed again unless it is kept.

    `look`: places the photograph in the picture, if it is given.
    """
    placement = _placement(look)
    subject = subjects.get(_key(name, placement))
    if subject is None:
        report("Analysing the person")
        matte, feather, reduced = None, 0.0, drawing.reduced()
        if mask is not None:
            edge = json.loads(Path(EDGE).read_text())
            matte = drawing.shifted(np.load(MATTE).astype(np.float32), edge["shift"])
            feather = edge["feather"] * max(reduced.shape)
        if placement:
            size = (reduced.shape[0], reduced.shape[1])
            shrink = max(size) / max(look["size"])
            right, up = (round(pixels * shrink) for pixels in placement["offset"])
            where: Place = {"scale": placement["scale"], "offset": (right, up)}
            reduced = place(reduced, size, **where)
            matte = None if matte is None else place(matte, size, **where)
        subject = Subject(reduced, matte, feather=feather)
        keep(name, subject, placement)
    return subject


def _placement(look: Look) -> Place:
    """Return `scale` and `offset` of a look, in pixels of the photograph; empty where it stays in place."""
    given = look.get("placement")
    if not given:
        return {}
    right, up = given["offset"]
    return {"scale": float(given["scale"]), "offset": (int(right), int(up))}


def save(
    name: str,
    mask: str | None,
    look: Look,
    output: str,
    passes: Sequence[str],
    report: Report,
    form: Form = AS_IT_IS,
) -> dict[str, object]:
    """Write a picture, the page, or the mesh.

    `form`: "quality" and "longest_side", as `Output` has them; a picture has full resolution otherwise.
    """
    from relight.pipeline.export import export_person
    from relight.viewer.write_view import write_view

    def then(what: str, share: float) -> Callable[[int, int, str], None]:
        """Return what reports a step once the one before it is done."""
        return lambda done, total, _: report(what, share) if done == total else None

    if (movie := clip.name()) is not None and Path(output).suffix in clip.SUFFIXES:
        written = Output((Path(output),), exposure=exposure_of(look))
        clip.save(movie, _person_of_clip(), lighting_of(look), written, report)
        return {"file": output}
    if mask is not None:
        full_matte(name, mask, report)
    source = Source(name, mask=mask, feather=_feather(mask), **_placement(look))
    lighting = lighting_of(look)
    suffix = Path(output).suffix
    report("Analysing the person", READ)
    if suffix == ".html":
        if lighting.floor is not None:
            warnings.warn("The page does not show the shadow on the floor.", stacklevel=2)
        told = then("Writing the page", RELIT)
        write_view(output, source, lighting, command=command_of(name, mask), progress=told)
    elif suffix == ".glb":
        export_person(output, source, lighting, progress=then("Making the mesh", ANALYSED))
    else:
        written = Output((Path(output),), passes=tuple(passes), exposure=exposure_of(look), **form)
        _save_picture(source, lighting, written, report)
    return {"file": output}


def _save_picture(source: Source, lighting: Lighting, output: Output, report: Report) -> None:
    """Do what `relight.render_shot` does, and tell how far it is."""
    from relight.pipeline.render import Relighting
    from relight.pipeline.run import run
    from relight.pipeline.shot import Shot

    with Shot.open(source, lighting, analyse=_analysing(source, Subject)) as shot:
        shot.person(0)
        report("Relighting", ANALYSED)
        run(Relighting(output), shot, progress=lambda done, total, what: report(what, RELIT))


def _analysing(source: Source, make: Callable[Arguments, Subject]) -> Callable[Arguments, Subject]:
    """Return what analyses a photograph, but not again for the next file of it unless it is large."""
    files = [Path(str(path)).resolve() for path in (source.plate, source.mask) if path is not None]
    key = (source.feather, source.scale, source.offset, *((path, path.stat().st_mtime_ns) for path in files))

    def analyse(*given: Arguments.args, **options: Arguments.kwargs) -> Subject:
        subject = kept_subjects[key] if key in kept_subjects else make(*given, **options)
        kept_subjects.clear()
        if subject.size[0] * subject.size[1] <= KEPT_PIXELS:
            kept_subjects[key] = subject
        return subject

    return analyse


def lighting_of(look: Look) -> Lighting:
    """Return the options of `relight apply` that the settings of the page stand for."""
    light, environment = tuple(map(str, look.get("lights") or ())), look.get("environment")
    if not light and not environment:
        raise ValueError("There is no light: add one, or an environment.")
    gloss, fill = float(look.get("gloss") or 0), float(look.get("fill") or 0)
    amount = look.get("amount")
    floor = Floor.parse(str(look["floor"])) if look.get("floor") else None
    return Lighting(
        light=light,
        environment=(environment,) if environment else (),
        background=_background_of(look),
        gloss=gloss,
        floor=floor,
        amount=float(1 if amount is None else amount),
        fill="background" if fill else None,
        fill_amount=fill,
        background_blur=float(look.get("blur") or 0),
        background_light=float(look.get("backgroundLight") or 0),
    )


def _background_of(look: Look) -> str | tuple[float, ...] | None:
    """Return the background that the page shows, as `relight.Lighting` takes it."""
    given = look.get("background") or NONE
    if given == ORIGINAL:  # an .exr holds it only if it is asked for
        return PLATE if look.get("plate") else None
    if given == NONE:
        return NONE
    return given["file"] if isinstance(given, Mapping) else tuple(map(float, given))


def exposure_of(look: Look) -> float:
    return float(look.get("exposure") or 0)


def command_of(name: str, mask: str | None) -> list[str]:
    """Return the words of the command that relights a photograph, or its movie, without its lights."""
    if (movie := clip.name()) is not None:
        return ["relight", "apply", movie, "--person", "{}/{}".format(*_person_of_clip())]
    feather = _feather(mask)
    return [
        *("relight", "apply", name),
        *(["--mask", mask] if mask else []),
        *(["--feather", f"{feather:g}"] if feather else []),
    ]


def _person_of_clip() -> tuple[int, int]:
    """Return a point on the person whose matte is accepted, in pixels of the movie's frames."""
    return clip.person(np.load(MATTE), int(Path(SIDE).read_text()))


def _feather(mask: str | None) -> float:
    """Return by how many pixels of the photograph the edge of the accepted matte is feathered."""
    if mask is None or not Path(EDGE).exists():
        return 0.0
    return round(json.loads(Path(EDGE).read_text())["feather"] * int(Path(SIDE).read_text()), 2)


def _key(name: str, placement: Place = IN_PLACE) -> str:
    return f"{Path(name).resolve()}{dict(placement) or ''}"


def keep(name: str, subject: Subject, placement: Place = IN_PLACE) -> None:
    """Keep a photograph's subject for stills, and forget the oldest ones; `placement`: see `Source`."""
    subjects[_key(name, placement)] = subject
    subjects.move_to_end(_key(name, placement))
    while len(subjects) > KEPT:
        subjects.popitem(last=False)
