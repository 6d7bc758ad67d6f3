"""`relight stage`: records from the virtual light stage."""

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from relight.cli.help import STAGE
from relight.cli.options import console, with_options

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from shadow.lightstage.stage import FigureSource


@with_options(STAGE)
def stage(
    records: Annotated[Path, typer.Argument(help="Folder of the records, with a file for each view.")],
    bodies: Annotated[
        str | None, typer.Option(help="Render clothed bodies of these seeds: FIRST:LAST, last exclusive.")
    ] = None,
    heads: Annotated[
        str | None,
        typer.Option(
            help="Render people of these seeds with heads of --facekit, half of them as busts: FIRST:LAST."
        ),
    ] = None,
    facekit: Annotated[
        Path | None, typer.Option(help="Folder of ICT-FaceKit's light model, ict.npz, for --heads.")
    ] = None,
    pairs: Annotated[
        str | None, typer.Option(help="Render two people who touch, of these seeds: FIRST:LAST.")
    ] = None,
    split: Annotated[
        str,
        typer.Option(help="Split of the bodies, heads and pairs: training, validation or generalisation."),
    ] = "training",
    scan: Annotated[
        list[Path] | None, typer.Option(help="Render this mesh or scan (OBJ, PLY, GLB). Repeatable.")
    ] = None,
    scan_list: Annotated[
        Path | None,
        typer.Option(help="Render the meshes that this text file lists, one on each line, relative to it."),
    ] = None,
    variants: Annotated[
        str | None, typer.Option(help="Render these variants of each scan instead of it: FIRST:LAST.")
    ] = None,
    folds: Annotated[
        bool,
        typer.Option("--folds", help="Add geometric folds, which cast shadows, to the cloth of --variants."),
    ] = False,
    views: Annotated[int, typer.Option(min=1, help="Views of each figure.")] = 9,
    size: Annotated[int, typer.Option(min=16, help="Side of the image in pixels.")] = 512,
    behind: Annotated[bool, typer.Option("--behind", help="Add 32 directions behind the subject.")] = False,
    directions: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Light directions of a view, drawn at random for each view; with --behind a third of them "
            "are behind. Default: the same 64 for every view, 96 with --behind.",
        ),
    ] = None,
    jitter: Annotated[
        bool, typer.Option("--jitter", help="Vary camera height, distance and field of view.")
    ] = False,
    portrait: Annotated[
        bool, typer.Option("--portrait", help="Close-up views with jitter: the frame cuts the figure.")
    ] = False,
    head: Annotated[
        bool, typer.Option("--head", help="Views of the head, down to the waist at most, with jitter.")
    ] = False,
    shading: Annotated[
        bool, typer.Option("--shading", help="Also trace indirect light, for path-traced shading.")
    ] = False,
    relief: Annotated[
        bool,
        typer.Option("--relief", help="Convert painted folds of scans without a normal map to relief."),
    ] = False,
    simulate: Annotated[
        bool,
        typer.Option(
            "--simulate", help="Simulate the cloth of --bodies, which takes about 17 s more for each body."
        ),
    ] = False,
    makehuman: Annotated[
        Path | None,
        typer.Option(
            help="Folder of MakeHuman's assets (clothes, hair, eyebrows, eyelashes, textures), from which "
            "--bodies get skins and brows, and often hair or a suit, and --heads hair."
        ),
    ] = None,
    fabrics: Annotated[
        bool,
        typer.Option("--fabrics", help="Draw other fabrics and colours for each view of a body."),
    ] = False,
    no_normal_maps: Annotated[
        bool, typer.Option("--no-normal-maps", help="Ignore the normal maps of scans.")
    ] = False,
    processes: Annotated[
        int | None, typer.Option(min=1, help="Number of processes. Default: one for each core.")
    ] = None,
    dask: Annotated[
        str | None, typer.Option(help="Render on a Dask cluster: its scheduler, tcp://farm:8786.")
    ] = None,
    pack: Annotated[
        Path | None, typer.Option(help="Then pack the records into shards of at most 60 MiB in this folder.")
    ] = None,
    cutouts: Annotated[
        Path | None,
        typer.Option(help="Then light the people of the records, and write them as PNG files with alpha."),
    ] = None,
    lightings: Annotated[int, typer.Option(min=1, help="Lightings of each record for --cutouts.")] = 2,
    sheet: Annotated[
        Path | None, typer.Option(help="Then draw a contact sheet of the records (PNG).")
    ] = None,
) -> None:
    """Render training records on the virtual light stage, pack them, or draw a contact sheet."""
    from shadow.data import records as record_files
    from shadow.evaluation import pictures
    from shadow.lightstage.stage import Settings, render_all

    if relief and not bodies is heads is pairs is None:
        raise ValueError("--relief: expected scans only, since generated people have no painted folds")
    people = _people(bodies, pairs, split, records / "cloth" if simulate else None, makehuman)
    people += _heads(heads, split, facekit, makehuman)
    sources = people + _scans([*(scan or []), *_listed(scan_list)], variants, folds, not no_normal_maps)
    if sources:
        with _executor(dask) if dask is not None else nullcontext() as pool:
            settings = Settings(
                views=views, size=size, behind=behind, lights=directions, jitter=jitter, portrait=portrait,
                head=head, bounced=shading, raised=relief, fabrics=fabrics,
            )  # fmt: skip
            written, on_disk, errors = render_all(sources, records, settings, processes=processes, pool=pool)
        console.print(f"{written} records, {on_disk // max(1, written)} bytes a view")
        for source, error in errors.items():
            console.print(f"{source}: {error}")
        if errors:
            raise typer.Exit(1)
    elif pack is None and sheet is None and cutouts is None:
        raise ValueError(
            "nothing to do: expected --bodies, --heads, --pairs, --scan, --scan-list, --pack, --cutouts or "
            "--sheet"
        )
    if pack is not None:
        for path in record_files.pack(records, pack):
            console.print(f"{path}: {path.stat().st_size} bytes")
    if cutouts is not None:
        from shadow.data import cutouts as cutout_files

        console.print(f"{cutouts}: {cutout_files.write_all([records], cutouts, lightings)} cutouts")
    if sheet is not None:
        pictures.contact_sheet([records], sheet)
        console.print(f"{sheet}")


def _executor(scheduler: str) -> AbstractContextManager["Executor"]:
    from relight.distributed.dask_cluster import executor  # needs what reads movies, which the stage does not

    return executor(scheduler)


def _people(
    bodies: str | None, pairs: str | None, split: str, cloth: Path | None, assets: Path | None
) -> list["FigureSource"]:
    """Return the sources of bodies and pairs of a split.

    `cloth`: folder of simulated garments, or None. `assets`: folder of MakeHuman's assets, or None.
    """
    from shadow.lightstage.stage import FigureSource

    simulate = cloth is not None
    people = [
        FigureSource.body(seed, split, simulate=simulate, cache=cloth, assets=assets)
        for seed in _seeds("--bodies", bodies)
    ]
    return people + [FigureSource.pair(seed, split) for seed in _seeds("--pairs", pairs)]


def _heads(seeds: str | None, split: str, folder: Path | None, assets: Path | None) -> list["FigureSource"]:
    """Return the sources of people with heads of the model in a folder."""
    from shadow.lightstage.stage import FigureSource

    if (seeds is None) != (folder is None):
        raise ValueError("--heads: expected --facekit as well, the folder of ict.npz, and the reverse")
    if folder is None:
        return []
    return [FigureSource.head(seed, split, folder, assets) for seed in _seeds("--heads", seeds)]


def _scans(meshes: list[Path], variants: str | None, folds: bool, normal_maps: bool) -> list["FigureSource"]:
    """Return the sources of scans, or of variants of each."""
    from shadow.lightstage.stage import FigureSource

    if folds and variants is None:
        raise ValueError("--folds: expected --variants as well, to whose cloth folds are added")
    if variants is None:
        return [FigureSource.scan(path, normal_maps) for path in meshes]
    if not meshes:
        raise ValueError("--variants: expected --scan or --scan-list as well")
    return [
        FigureSource.variant(path, number, folds, normal_maps)
        for path in meshes
        for number in _seeds("--variants", variants)
    ]


def _listed(path: Path | None) -> list[Path]:
    """Return the mesh files that a text file lists, one on each line, relative to it."""
    if path is None:
        return []
    return [path.parent / name.strip() for name in path.read_text().split("\n") if name.strip()]


def _seeds(option: str, text: str | None) -> range:
    """Parse `0:100` as a range."""
    if text is None:
        return range(0)
    first, _, last = text.partition(":")
    try:
        return range(int(first), int(last))
    except ValueError as error:
        raise ValueError(f"{option}: expected FIRST:LAST, e.g. 0:100, got {text!r}") from error
