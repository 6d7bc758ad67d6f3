"""Constants of Python that the page's program and its shaders use, in their languages."""

from collections.abc import Mapping

from relight import quantities
from relight.analysis import gloss, upsampling
from relight.analysis.storage import HALF_MAX
from relight.arguments import limits, members
from relight.compositing.composite import MAX_BACKGROUND_FACTOR
from relight.lights import near
from relight.lights.directional import SOFT_SAMPLE_COUNT, DirectionalLight
from relight.lights.environment import EnvironmentLight
from relight.lights.light import Light
from relight.lights.near import PointLight
from relight.media.colour import KNEE, LOCI, LUMINANCE
from relight.viewer.packing import CAST_RANK, RESIDUAL_RANK

MAX_LIGHTS = 8  # directional and point lights, beside one environment
MAX_INTENSITY = 1e6  # of a light on the page


def of_the_program() -> dict[str, object]:
    """Return {name: value} for JSON: defaults and ranges of lights' parameters, and other constants."""
    kinds = (DirectionalLight, PointLight, EnvironmentLight)
    ranges = {}
    for kind in kinds:
        for name, parameter in kind.parameters().items():
            if next(each for each, _ in members(parameter.kind)) is float and name != "temperature":
                ranges[name] = [_finite(limit) for limit in limits(parameter.kind)]
    ranges["intensity"][1] = MAX_INTENSITY
    shared = {name: each.default for name, each in Light.parameters().items() if name != "name"}
    return {
        "SHARED": shared,
        "RANGES": ranges,  # null where there is no limit
        "LOCI": LOCI,
        "LIGHTS": MAX_LIGHTS,
        "SOFT_SAMPLES": SOFT_SAMPLE_COUNT,
        "LUMINANCE": LUMINANCE.tolist(),
    }


def of_the_shaders() -> str:
    """Return declarations in GLSL."""
    red, green, blue = LUMINANCE.tolist()
    floats: Mapping[str, float] = {
        "GOLDEN": near.GOLDEN,
        "MIN_SQUARED": quantities.MIN_METRES**2,  # of the distance to a lamp
        "FORWARD": gloss.FORWARD,
        "DEPTH": gloss.DEPTH,
        "BEND": gloss.BEND,
        "MIN_COSINE": gloss.MIN_COSINE,
        "MOST": HALF_MAX,  # that half floats hold
        "SIGMA": upsampling.RANGE_SIGMA,
        "LEAST": upsampling.MIN_RANGE_WEIGHT,
        "UNKNOWN": upsampling.UNKNOWN_WEIGHT,
        "BRIGHTEST": upsampling.GUIDE_MAX,
        "KNEE": KNEE,
        "MAX_BACKGROUND_FACTOR": MAX_BACKGROUND_FACTOR,
    }
    # Of the vec4 that hold the components of the cast shadow's logit and of the residual.
    counts = {"CAST": CAST_RANK // 4, "RESIDUAL": RESIDUAL_RANK // 4}
    return "".join(
        [
            *(f"const float {name} = {float(value)!r};\n" for name, value in floats.items()),
            *(f"const int {name} = {value};\n" for name, value in counts.items()),
            f"const vec3 LUMINANCE = vec3({red!r}, {green!r}, {blue!r});\n",
        ]
    )


def _finite(limit: float) -> float | None:
    return limit if abs(limit) < float("inf") else None
