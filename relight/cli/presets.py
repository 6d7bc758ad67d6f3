"""`relight presets`: the names of lighting presets."""

import typer


def presets() -> None:
    """List the lighting presets: what `--preset` of the other commands takes."""
    from relight.lights.preset_table import document

    table = document()
    width = max(map(len, table))
    for name, preset in table.items():
        typer.echo(f"{name:{width}}  {preset['about']}")
