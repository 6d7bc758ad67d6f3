"""The angle of view of a scene's camera in a picture of another shape than its film back."""

import json
import math

import numpy as np
import pytest

import relight
from relight.pipeline.options import Lighting
from relight.pipeline.shot import Shot
from relight.scene.lights import read_rig

pytest.importorskip("pxr")

STAGE = """#usda 1.0
(
    metersPerUnit = 1
    renderSettingsPrimPath = "/Render"
)
def Camera "cam" {{
    float focalLength = 50
    float horizontalAperture = 36
    float verticalAperture = 24
    float focusDistance = 3
    {more}
}}
def DistantLight "key" {{
    float inputs:angle = 0
}}
def RenderSettings "Render" {{
    {settings}
}}
"""
POLICY = "uniform token aspectRatioConformPolicy"


def rig_of(folder, more="", settings=""):
    path = folder / "set.usda"
    path.write_text(STAGE.format(more=more, settings=settings))
    return read_rig(path)


def tangent(degrees):
    return math.tan(math.radians(degrees / 2))


@pytest.mark.parametrize(
    ("policy", "aspect", "expected"),
    [  # half the film back is 18 x 12 mm, behind 50 mm
        ("", 1.5, 12),
        ("", 3 / 4, 24),  # an upright picture shows all of the width
        ("", 2.0, 12),
        ("cropAperture", 3 / 4, 12),
        ("cropAperture", 2.0, 9),
        ("adjustApertureHeight", 2.0, 9),
        ("adjustApertureHeight", 0.5, 36),
        ("adjustApertureWidth", 0.5, 12),
        ("adjustPixelAspectRatio", 2.0, 12),
    ],
)
@pytest.mark.states(
    "USD", "a film back of another aspect than the picture, `aspectRatioConformPolicy`", "honoured"
)
def test_a_film_back_is_fitted_as_the_stages_render_settings_say(tmp_path, policy, aspect, expected):
    rig = rig_of(tmp_path, settings=f'{POLICY} = "{policy}"' if policy else "")
    np.testing.assert_allclose(tangent(rig.view.vertical_degrees(aspect)), expected / 50, rtol=1e-6)


@pytest.mark.states("USD", "aperture offsets, orthographic cameras", "warned of")
def test_a_shifted_film_back_is_said_and_an_orthographic_camera_has_no_angle(tmp_path):
    with pytest.warns(UserWarning, match="/cam: has a shifted film back"):
        rig = rig_of(tmp_path, "float horizontalApertureOffset = 4")
    np.testing.assert_allclose(tangent(rig.view.vertical_degrees(1.5)), 12 / 50, rtol=1e-6)
    with pytest.warns(UserWarning, match="/cam: is an orthographic camera"):
        assert rig_of(tmp_path, 'token projection = "orthographic"').view is None
    rig_of(tmp_path)
    path = tmp_path / "set.usda"
    path.write_text(path.read_text().replace("verticalAperture = 24", "verticalAperture = 0"))
    with pytest.warns(UserWarning, match="/cam: has no film back"):
        assert read_rig(path).view is None


@pytest.mark.parametrize(
    ("perspective", "aspect", "expected"),
    [
        ({"yfov": 0.6, "aspectRatio": 1.5}, 1.5, math.tan(0.3)),
        ({"yfov": 0.6, "aspectRatio": 1.5}, 0.75, 2 * math.tan(0.3)),
        ({"yfov": 0.6, "aspectRatio": 1.5}, 2.0, math.tan(0.3)),
        ({"yfov": 0.6}, 0.5, math.tan(0.3)),
    ],
)
@pytest.mark.states("glTF", "`yfov` and `aspectRatio` of the camera", "honoured")
def test_what_a_gltf_camera_sees_is_not_cropped(tmp_path, perspective, aspect, expected):
    """glTF 2.0, 3.10.3.1."""
    tree = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "directional"}]}},
        "cameras": [{"type": "perspective", "perspective": perspective}],
        "nodes": [{"camera": 0}, {"extensions": {"KHR_lights_punctual": {"light": 0}}}],
    }
    path = tmp_path / "set.gltf"
    path.write_text(json.dumps(tree))
    np.testing.assert_allclose(tangent(read_rig(path).view.vertical_degrees(aspect)), expected, rtol=1e-6)
    perspective["yfov"] = -1
    path.write_text(json.dumps(tree))
    with pytest.raises(ValueError, match=r"set\.gltf: its camera has the angle of view -1"):
        read_rig(path)


@pytest.mark.parametrize(("size", "expected"), [((40, 30), 24), ((20, 30), 12), ((20, 60), 12)])
def test_a_shot_sees_what_the_scenes_camera_sees_in_its_picture(tmp_path, size, expected):
    rig_of(tmp_path)
    relight.write(tmp_path / "plate.exr", np.ones((*size, 3), np.float32))
    relight.write_mask(tmp_path / "matte.png", np.ones(size, np.float32))
    with Shot.open(tmp_path / "plate.exr", Lighting(tmp_path / "set.usda")) as shot:
        np.testing.assert_allclose(tangent(shot.frames.field_of_view), expected / 50, rtol=1e-6)
