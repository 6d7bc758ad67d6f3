"""The help of the commands: groups of options, the order within them, and examples at the end."""

import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

Panels = Mapping[str, str]  # {title: names of parameters}, in the order of the help; rare ones stand last

SHOT: Panels = {  # of all commands that read a photograph or a shot
    "What most people need": "paths output preset light amount intensity environment background mask person "
    "resume",
    "Person": "matte track key refine_matte feather normals axes depth height field_of_view reference",
    "Placement": "size placement scale offset",
    "Lights": "lights match_plate fill fill_amount match match_mask paint paint_count gloss camera "
    "subject_at allow_external",
    "Background and floor": "background_blur background_light floor background_colour_space",
    "Output": "behind triangles texture passes exposure white view quality longest_side save_matte "
    "save_lights report plot exr_type output_colour_space autocrop colour_space alpha open_",
    "Video": "frames frame rate codec hdr temporal_filter temporal_radius preview phase",
    "Machine": "device precision threads workers dask chunk_size analysis options_file",
}
STAGE: Panels = {
    "Figures": "bodies heads facekit pairs split scan scan_list variants",
    "Clothes and surfaces": "simulate fabrics makehuman folds relief no_normal_maps",
    "Views": "views size portrait head jitter",
    "Light": "behind directions shading",
    "Files and machine": "pack cutouts lightings sheet processes dask",
}
TRAIN: Panels = {
    "Run": "records backdrops pose_masks out preset steps duration validation minutes workers seed",
    "Network": "model init normals visibility blocks no_normals no_depth",
    "Recipe": "size batch lights learning_rate warm_up average borders faces angles distil",
}

EXAMPLES = {  # at the beginning of a command's help: three that are complete
    "apply": """A photograph: relight apply photo.jpg --preset golden-hour -o out.jpg

Lights of your own, as layers: relight apply photo.jpg --light key:azimuth=-40,elevation=30,intensity=2,\
colour=1/0.9/0.8 --light lamp:position=-0.6/0.4/0.8,radius=0.1 -o relit.exr

A shot in an environment: relight apply plate.%04d.exr --mask matte.%04d.png --environment \
studio.exr,rotation=90,intensity=2 --background environment -o relit.%04d.exr -o relit.mp4""",
    "job": """A shot: relight job plate.%04d.exr --lights lights.yaml -o relit.%04d.exr -o relit.json

In larger tasks: relight job plate.%04d.exr --preset rim --chunk-size 50 -o relit.%04d.exr -o relit.yaml

Some frames: relight job walk.mp4 --preset window --frames 1-100 -o relit.%04d.exr -o relit.json""",
    "view": """A photograph: relight view photo.jpg -o page.html --open

In a light to begin with: relight view photo.jpg --preset rembrandt -o page.html

A frame of a movie: relight view walk.mp4 --frame 12 -o page.html""",
    "analyse": """A shot: relight analyse plate.%04d.exr --mask matte.%04d.png -o shot.relight

Some frames of a movie: relight analyse walk.mp4 --frames 1-100 -o walk.relight

What follows it: relight apply shot.relight --preset rim -o relit.%04d.exr""",
    "track": """A movie: relight track walk.mp4 -o walk.track.json

Somebody else: relight track walk.mp4 --person 640/300 -o walk.track.json

Corrected where it goes wrong: relight track walk.mp4 --correct 640/300@43 -o walk.track.json""",
    "export": """A mesh: relight export photo.jpg -o person.glb

With lights, for USD: relight export photo.jpg --lights lights.yaml -o person.usdz

Lit in Nuke: relight export photo.jpg -o person.nk""",
    "olat": """A layer for each light: relight olat photo.jpg -o olat.exr

A file for each light: relight olat photo.jpg -o olat.%04d.exr -o olat.nk

From behind as well: relight olat photo.jpg --behind -o olat.exr""",
    "stage": """Dressed bodies: relight stage records --bodies 0:100 --simulate --views 9

Scans: relight stage records --scan person.glb --views 6 --sheet sheet.png

Shards to train on: relight stage records --bodies 0:100 --pack shards""",
    "train": """Visibility: relight train shadow --records shards --out runs/field --steps 20000

Shading, with that field: relight train shading --records shards --visibility runs/field/field.safetensors \
--out runs/shading

The paper's network: relight train shadow --model resb3 --preset paper --records shards --out runs/paper""",
    "evaluate": """The shipped field: relight evaluate visibility --records shards

A network of your own: relight evaluate visibility --records shards --model runs/field/field.safetensors

The paper's tables: relight evaluate tables --records shards --out report""",
}


class PlainCommand(TyperCommand):
    """A command whose help names no type beside a flag, and does not explain --help."""

    def get_params(self, ctx: Any) -> list[Any]:
        return plain(super().get_params(ctx))


class PlainGroup(TyperGroup):
    """The same of a group of commands."""

    def get_params(self, ctx: Any) -> list[Any]:
        return plain(super().get_params(ctx))


def plain(parameters: list[Any]) -> list[Any]:
    """Take what says nothing to a reader out of the help of parameters, and return them."""
    for parameter in parameters:
        if getattr(parameter, "is_bool_flag", False):
            parameter.metavar = ""
        if parameter.name == "help":
            parameter.hidden = True
    return parameters


def described(command: Callable[..., object]) -> str:
    """Return the help of a command: its docstring, then its examples."""
    words = [inspect.getdoc(command) or "", EXAMPLES.get(command.__name__, "")]
    return "\n\n".join(filter(None, words))


def grouped(parameters: Iterable[inspect.Parameter], panels: Panels) -> list[inspect.Parameter]:
    """Return parameters in the order of the help, and put their options in the panels.

    Arguments come first, then the panels, then what is in none.
    """
    order = [(title, name) for title, names in panels.items() for name in names.split()]
    places = {name: (place, title) for place, (title, name) in enumerate(order)}
    for parameter in parameters:
        described = _described(parameter)
        if parameter.name in places and isinstance(described, typer.models.OptionInfo):
            described.rich_help_panel = places[parameter.name][1]

    def place(parameter: inspect.Parameter) -> tuple[bool, int]:
        is_option = isinstance(_described(parameter), typer.models.OptionInfo)
        return is_option, places.get(parameter.name, (len(order), ""))[0]

    return sorted(parameters, key=place)


def _described(parameter: inspect.Parameter) -> object:
    """Return typer's description of a parameter; None for a parameter without one."""
    return next(iter(getattr(parameter.annotation, "__metadata__", ())), None)
