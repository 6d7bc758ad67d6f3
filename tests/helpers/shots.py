"""Shots rendered from keywords, each of which goes to the option object that it is a field of."""

import json
import math
from dataclasses import fields
from pathlib import Path

import relight
from relight.pipeline.analyse import Analysing
from relight.pipeline.options import GROUPS
from relight.pipeline.render import Relighting
from relight.pipeline.run import run
from relight.pipeline.shot import Shot


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


def render(source, lights, outputs, *, analyse=None, **settings):
    """`relight.render_shot` of such keywords; `analyse` stands in for `relight.Subject`."""
    options = options_of(source, lights, outputs, **settings)
    if analyse is None:
        return relight.render_shot(**options)
    source, lighting, output, compute = (options.pop(name) for name in GROUPS)
    is_preview = options.pop("preview", False)
    with Shot.open(source, lighting, compute, analyse, is_preview) as shot:
        how = {name: options.pop(name) for name in ("resume", "phase") if name in options}
        return run(Relighting(output, **how), shot, **options)


def analyse(source, output, *, analyse=None, **settings):
    """`relight.analyse_shot` of such keywords; `analyse` stands in for `relight.Subject`."""
    options = options_of(source, **settings)
    source, _, _, compute = (options.pop(name) for name in GROUPS)
    if analyse is None:
        return relight.analyse_shot(source, output, compute=compute, **options)
    with Shot.open(source, compute=compute, analyse=analyse) as shot:
        return run(Analysing(Path(output)), shot, **options)


def distribute(source, lights, outputs, **settings):
    """`relight.render_distributed` of such keywords."""
    return relight.render_distributed(**options_of(source, lights, outputs, **settings))


def write_scene(path, field_of_view=30):
    """Write a glTF scene: a camera with its vertical field of view in degrees, and a lamp before it."""
    lens = {"yfov": math.radians(field_of_view), "znear": 0.1}
    lamps = [{"type": "point", "name": "lamp", "intensity": 500, "color": [1, 0.7, 0.4]}]
    scene = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [
            {"translation": [-0.8, 0.5, -2], "extensions": {"KHR_lights_punctual": {"light": 0}}},
            {"camera": 0},
        ],
        "cameras": [{"type": "perspective", "perspective": lens}],
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": lamps}},
    }
    path.write_text(json.dumps(scene))
