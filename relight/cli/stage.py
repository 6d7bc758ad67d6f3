"""`relight stage`: records from the virtual light stage.

Heavy modules are imported inside the command, so that `relight --help` answers at once.
"""

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from relight.cli.options import console

if TYPE_CHECKING:
    from shadow.lightstage.stage import Source


def stage(
    records: Annotated[Path, typer.Argument(help="Folder of records, one file a view.")],
    bodies: Annotated[
        str | None, typer.Option(help="Render clothed bodies of these seeds: FIRST:LAST, last exclusive.")
    ] = None,
    pairs: Annotated[
        str | None, typer.Option(help="Render two people in touch, of these seeds: FIRST:LAST.")
    ] = None,
    split: Annotated[
        str, typer.Option(help="The bodies' and pairs' split: training, validation or generalisation.")
    ] = "training",
    scan: Annotated[
        list[Path] | None, typer.Option(help="Render this mesh or scan (OBJ, PLY, GLB). Repeatable.")
    ] = None,
    scan_list: Annotated[
        Path | None, typer.Option(help="Render the meshes that this text file names, one a line, beside it.")
    ] = None,
    variants: Annotated[
        str | None, typer.Option(help="Instead of each scan these of its variants: FIRST:LAST.")
    ] = None,
    folds: Annotated[
        bool,
        typer.Option("--folds", help="With folds raised from the cloth of --variants, which cast shadows."),
    ] = False,
    views: Annotated[int, typer.Option(min=1, help="Views a figure.")] = 9,
    size: Annotated[int, typer.Option(min=16, help="Pixels of the image's side.")] = 512,
    behind: Annotated[bool, typer.Option(help="32 directions behind the subject too.")] = False,
    jitter: Annotated[bool, typer.Option(help="Vary camera height, distance and field of view.")] = False,
    portrait: Annotated[
        bool, typer.Option("--portrait", help="Jitter, and come close: the frame cuts the figure.")
    ] = False,
    shading: Annotated[
        bool, typer.Option(help="Trace the bounce light too, for path-traced shading.")
    ] = False,
    relief: Annotated[
        bool,
        typer.Option("--relief", help="Raise the folds that are only painted on a scan without normal map."),
    ] = False,
    simulate: Annotated[
        bool,
        typer.Option("--simulate", help="Drape the clothes of --bodies by physics: some 15 s a body more."),
    ] = False,
    processes: Annotated[int | None, typer.Option(min=1, help="Default: one a core.")] = None,
    dask: Annotated[
        str | None, typer.Option(help="Render on a Dask cluster: its scheduler, tcp://farm:8786.")
    ] = None,
    pack: Annotated[
        Path | None, typer.Option(help="Then pack the records into shards of at most 60 MiB in this folder.")
    ] = None,
    sheet: Annotated[Path | None, typer.Option(help="Then draw a contact sheet of them (PNG).")] = None,
) -> None:
    """Render training records on the virtual light stage, pack them, or draw them for the eye."""
    from relight.cluster import executor
    from shadow.data import records as record_files
    from shadow.evaluation import pictures
    from shadow.lightstage.stage import render_all

    if relief and (bodies is not None or pairs is not None):
        raise ValueError(
            "--relief: expected scans alone, since folds of --bodies and --pairs are not painted"
        )
    people = _people(bodies, pairs, split, records / "cloth" if simulate else None)
    sources = people + _scans([*(scan or []), *_listed(scan_list)], variants, folds)
    if sources:
        with executor(dask) if dask else nullcontext() as pool:
            written, on_disk, errors = render_all(
                sources, records, views=views, size=size, behind=behind, jitter=jitter,
                portrait=portrait, bounced=shading, raised=relief, processes=processes, pool=pool,
            )  # fmt: skip
        console.print(f"{written} records, {on_disk // max(1, written)} bytes a view")
        for source, error in errors.items():
            console.print(f"{source}: {error}")
        if errors:
            raise typer.Exit(1)
    elif pack is None and sheet is None:
        raise ValueError("nothing to do: expected --bodies, --pairs, --scan, --scan-list, --pack or --sheet")
    if pack is not None:
        for path in record_files.pack(records, pack):
            console.print(f"{path}: {path.stat().st_size} bytes")
    if sheet is not None:
        pictures.contact_sheet([records], sheet)
        console.print(f"{sheet}")


def _people(bodies: str | None, pairs: str | None, split: str, cloth: Path | None) -> list["Source"]:
    """The clothed bodies and pairs of a split. cloth: the folder of simulated garments, None: none are."""
    from shadow.lightstage.stage import Source

    simulate = cloth is not None
    people = [Source.body(seed, split, simulate=simulate, cache=cloth) for seed in _seeds("--bodies", bodies)]
    return people + [Source.pair(seed, split) for seed in _seeds("--pairs", pairs)]


def _scans(meshes: list[Path], variants: str | None, folds: bool) -> list["Source"]:
    """Scans, or variants of each."""
    from shadow.lightstage.stage import Source

    if folds and variants is None:
        raise ValueError("--folds: expected --variants with it, whose cloth is folded")
    if variants is None:
        return [Source.scan(path) for path in meshes]
    if not meshes:
        raise ValueError("--variants: expected --scan or --scan-list with it, to make variants of")
    return [
        Source.variant(path, number, folds) for path in meshes for number in _seeds("--variants", variants)
    ]


def _listed(path: Path | None) -> list[Path]:
    """The meshes that a text file names, one a line, beside the file."""
    if path is None:
        return []
    return [path.parent / name.strip() for name in path.read_text().split("\n") if name.strip()]


def _seeds(option: str, text: str | None) -> range:
    """`0:100` as a range."""
    if text is None:
        return range(0)
    first, _, last = text.partition(":")
    try:
        return range(int(first), int(last))
    except ValueError as error:
        raise ValueError(f"{option}: expected FIRST:LAST, e.g. 0:100, got {text!r}") from error
