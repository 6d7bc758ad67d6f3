"""Shots rendered from keywords, each of which goes to the option object that it is a field of."""

from dataclasses import fields

import relight
from relight.pipeline.options import GROUPS


def options_of(source, lights=(), outputs=("none.png",), **settings):
    """The keyword arguments of `relight.render_shot`."""
    chosen = {
        name: {each.name: settings.pop(each.name) for each in fields(kind) if each.name in settings}
        for name, kind in GROUPS.items()
    }
    return {
        "source": relight.Source(source, **chosen["source"]),
        "lighting": relight.Lighting(lights, **chosen["lighting"]),
        "output": relight.Output(outputs, **chosen["output"]),
        "compute": relight.Compute(**chosen["compute"]),
        **settings,
    }


def render(source, lights, outputs, **settings):
    """`relight.render_shot` of such keywords."""
    return relight.render_shot(**options_of(source, lights, outputs, **settings))


def analyse(source, output, **settings):
    """`relight.analyse_shot` of such keywords."""
    options = options_of(source, **settings)
    further = {name: value for name, value in options.items() if name not in ("source", "lighting", "output")}
    return relight.analyse_shot(options["source"], output, **further)


def distribute(source, lights, outputs, **settings):
    """`relight.render_distributed` of such keywords."""
    return relight.render_distributed(**options_of(source, lights, outputs, **settings))
