"""Lighting by name, the same in Python, on the command line and in files of options."""

import numpy as np
import pytest

import relight
from relight.arguments import about, parameters
from relight.lights import presets
from relight.lights.rig import as_rig
from relight.pipeline.option_fields import from_json, to_json
from relight.pipeline.options import Lighting


def lights_of(lighting):
    return [*lighting.preset_lights, *lighting.rig().lights]


def test_every_preset_has_lights_of_different_names_and_a_title():
    found = relight.presets()
    assert [*found] == [*presets.document()]
    assert {"three-point", "rembrandt", "golden-hour"} <= set(found)
    for name, lights in found.items():
        names = [light.name for light in lights]
        assert len(set(names)) == len(names) > 0
        assert presets.document()[name]["title"]
        assert np.all(np.isfinite([light.power for light in lights]))


def test_a_name_stands_for_its_lights():
    assert as_rig("rembrandt") == relight.presets()["rembrandt"]
    for lighting in (Lighting("split"), Lighting(preset="split")):
        assert lights_of(lighting) == relight.presets()["split"]
        assert lights_of(from_json(Lighting, to_json(lighting))) == relight.presets()["split"]
    added = lights_of(Lighting("split", light=("fill:azimuth=40",)))
    assert [light.name for light in added] == ["key", "bounce", "fill"]
    for refused in (lambda: as_rig("remmbrant"), lambda: lights_of(Lighting(preset="remmbrant"))):
        with pytest.raises(ValueError, match=r"no preset is called 'remmbrant'; did you mean rembrandt"):
            refused()


def test_lamps_near_a_person_keep_their_light_at_any_height():
    """A lamp twice as far and four times as strong lights the same."""
    full, half = (relight.presets(height)["firelight"][0] for height in (1.75, 0.875))
    np.testing.assert_allclose(np.array(half.position) * 2, full.position)
    assert half.radius * 2 == pytest.approx(full.radius)
    np.testing.assert_allclose(half.power * 4, full.power, rtol=1e-6)


def test_the_help_names_every_preset():
    described = about(parameters(Lighting)["preset"].kind)
    assert all(name in described.help for name in relight.presets())
