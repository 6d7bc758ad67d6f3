"""Normal maps: on a sphere whose true normals are known, the map says what the smooth surface does not."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("embreex")
pytest.importorskip("kornia")
trimesh = pytest.importorskip("trimesh")

from shadow import directions
from shadow.data import records
from shadow.lightstage import scans, stage, variants
from shadow.lightstage.figure import vertex_normals
from shadow.lightstage.normalmaps import tangents

RADIUS, HEIGHT = 0.5, 0.9
WAVES, SLOPE = 6, 0.35  # bumps around the sphere, and how steep their banks are
LIGHTS = directions.olat(behind=True)


def globe(mirrored=False, u_turn=False):
    """A sphere with longitude and latitude as texture coordinates: u grows to the east, which is the right as
    seen from outside, and v to the north. `mirrored`: the texture lies on it the other way round. `u_turn`:
    its eastern half mirrors the western. Returns vertices (V, 3), faces, unit normals and uv (v up)."""
    east, north = 96, 48
    u, v = np.meshgrid(np.linspace(0, 1, east + 1), np.linspace(0.02, 0.98, north + 1))
    longitude, latitude = (u * 2 * np.pi - np.pi).ravel(), (v * np.pi - np.pi / 2).ravel()
    normals = np.stack(
        [np.cos(latitude) * np.sin(longitude), np.sin(latitude), np.cos(latitude) * np.cos(longitude)], axis=1
    )
    corner = (np.arange(north)[:, None] * (east + 1) + np.arange(east)).ravel()
    quads = corner[:, None] + [0, 1, east + 2, east + 1]
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    uv = np.stack([1 - u if mirrored else np.minimum(u, 1 - u) if u_turn else u, v], axis=-1).reshape(-1, 2)
    return RADIUS * normals + [0, HEIGHT, 0], faces, normals, uv


def bumps(uv):
    """The map: tangent-space directions (..., 3) at uv: banks that look along u, and others along v."""
    phase = 2 * np.pi * WAVES * uv
    slope = SLOPE * np.concatenate([np.sin(phase[..., :1]), np.cos(2 * phase[..., 1:])], axis=-1)
    directions = np.concatenate([slope, np.ones_like(slope[..., :1])], axis=-1)
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def image(size=512):
    """The map as a picture, v up from its bottom row."""
    steps = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(steps, steps[::-1])
    return Image.fromarray(np.round((bumps(np.stack([u, v], axis=-1)) + 1) * 127.5).astype(np.uint8))


def write(path, shape, tangent=None, scale=None):
    """The globe as a .glb with its map; trimesh writes neither tangents nor a scale, so they are added."""
    vertices, faces, normals, uv = shape
    material = trimesh.visual.material.PBRMaterial(normalTexture=image())
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    mesh = trimesh.Trimesh(vertices, faces, vertex_normals=normals, visual=visual, process=False)
    if tangent is not None:
        mesh.vertex_attributes["_TANGENT"] = tangent.astype(np.float32)
    data = mesh.export(file_type="glb", include_normals=True)
    length = struct.unpack_from("<I", data, 12)[0]
    header, rest = json.loads(data[20 : 20 + length]), data[20 + length :]
    for primitive in header["meshes"][0]["primitives"]:
        if tangent is not None:
            primitive["attributes"]["TANGENT"] = primitive["attributes"].pop("_TANGENT")
    if scale is not None:
        header["materials"][0]["normalTexture"]["scale"] = scale
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    sizes = struct.pack("<II", 20 + len(text) + len(rest), len(text))
    path.write_bytes(data[:8] + sizes + b"JSON" + text + rest)
    return path


def truth(shape, normals):
    """What the map means at smooth unit normals (N, 3) of the globe in the world's frame."""
    longitude, latitude = np.arctan2(normals[:, 0], normals[:, 2]), np.arcsin(normals[:, 1].clip(-1, 1))
    along = np.stack([np.cos(longitude), 0 * longitude, -np.sin(longitude)], axis=1)  # to the east
    north = np.cross(normals, along)
    u, v = (longitude + np.pi) / (2 * np.pi), (latitude + np.pi / 2) / np.pi
    other = {"plain": 0 * u, "mirrored": 1 + 0 * u, "u_turn": u > 0.5}[shape].astype(bool)
    detail = bumps(np.stack([np.where(other, 1 - u, u), v], axis=1))
    along = np.where(other[:, None], -along, along)  # in which the texture's u grows
    return detail[:, :1] * along + detail[:, 1:2] * north + detail[:, 2:] * normals


def off(record, view, shape):
    """Degrees (N,) between a record's normals and what the map means, away from rim and poles; and the same
    of the smooth normals."""
    _, rays = stage.camera_rays(view, len(record.mask))
    rays = rays[record.mask.ravel()] @ view.rotation()
    eye = view.position() - [0, HEIGHT, 0]
    a, b, c = (rays**2).sum(axis=1), rays @ eye, eye @ eye - RADIUS**2
    distance = (-b - np.sqrt(np.maximum(b * b - a * c, 0))) / a
    smooth = (eye + distance[:, None] * rays) / RADIUS
    smooth /= np.linalg.norm(smooth, axis=1, keepdims=True)
    found = record.normals @ view.rotation()
    clear = ((smooth * rays).sum(axis=1) < -0.4 * np.sqrt(a)) & (np.abs(smooth[:, 1]) < 0.9)
    clear &= np.abs(np.arctan2(smooth[:, 0], smooth[:, 2])) > 0.05  # where the halves meet
    wanted = truth(shape, smooth)
    return (
        np.degrees(np.arccos((normals * wanted).sum(axis=1).clip(-1, 1)))[clear]
        for normals in (found, smooth)
    )


def lifted(path):
    """The globe as a figure, its middle where the camera looks."""
    figure = scans.load(path)
    return replace(figure, vertices=figure.vertices + np.float32([0, HEIGHT - RADIUS, 0]))


OPTIONS = {"plain": {}, "mirrored": {"mirrored": True}, "u_turn": {"u_turn": True}}


@pytest.mark.parametrize("azimuth", [20, 130, 250])
@pytest.mark.parametrize("shape", OPTIONS)
def test_a_sphere_with_a_map_has_the_normals_that_the_map_means(tmp_path, shape, azimuth):
    figure = lifted(write(tmp_path / "globe.glb", globe(**OPTIONS[shape])))
    view = stage.View(azimuth=azimuth)
    record = stage.render(figure, view, 256, LIGHTS)
    error, without = off(record, view, shape)
    assert without.mean() > 12
    assert error.mean() < 1
    assert np.quantile(error, 0.99) < 3


def test_what_the_map_turns_away_is_dark_and_lit_by_the_same_normals(tmp_path):
    figure = lifted(write(tmp_path / "globe.glb", globe()))
    record = stage.render(figure, stage.View(), 192, LIGHTS)
    plain = stage.render(replace(figure, normal_map=None), stage.View(), 192, LIGHTS)
    cosines = record.normals @ LIGHTS.T
    assert not record.visibility[cosines < -0.02].any()
    behind = plain.normals @ LIGHTS.T < -0.08
    assert (cosines > 0.02)[behind].any()
    assert not record.visibility[behind].any()  # the geometric normal still counts
    banks = plain.visibility[cosines < -0.02].sum()
    assert banks > 1000  # lit on the smooth sphere


def test_without_its_map_a_mesh_has_its_own_normals(tmp_path):
    path = write(tmp_path / "globe.glb", globe())
    mapped, plain = (scans.load(path, normal_map) for normal_map in (True, False))
    np.testing.assert_array_equal(plain.normals, mapped.normals)
    assert mapped.normal_map is not None
    assert plain.normal_map is plain.tangents is None


def test_stored_tangents_and_the_scale_of_the_map_count(tmp_path):
    """A quarter turn of the tangents turns the banks; half the scale makes them half as steep."""
    shape = globe()
    faces, normals = shape[1], shape[2]
    east = np.zeros((len(normals), 3))
    east[faces] = tangents(*shape)[..., :3]
    north = np.concatenate([np.cross(normals, east), np.ones((len(normals), 1))], axis=1)
    figures = [
        scans.load(write(tmp_path / f"{name}.glb", shape, **options))
        for name, options in (("made", {}), ("turned", {"tangent": north}), ("half", {"scale": 0.5}))
    ]
    made, turned, half = (stage.render(each, stage.View(height=RADIUS), 96, LIGHTS[:1]).normals
                          for each in figures)  # fmt: skip
    smooth = stage.render(
        replace(figures[0], normal_map=None), stage.View(height=RADIUS), 96, LIGHTS[:1]
    ).normals
    facing = smooth[:, 2] > 0.9
    a, b, c = (
        (each / (each * smooth).sum(axis=1, keepdims=True) - smooth)[facing] for each in (made, turned, half)
    )
    np.testing.assert_allclose(c, a / 2, atol=0.03)
    quarter = np.cross(smooth[facing], a)
    assert np.linalg.norm(b - quarter, axis=1).mean() < 0.02 < np.linalg.norm(b - a, axis=1).mean()


def test_a_variant_keeps_the_map_on_its_bent_surface(tmp_path):
    """The tangents of the bent surface are those that its own texture coordinates give."""
    vertices, faces, normals, uv = globe()
    figure = scans.load(write(tmp_path / "globe.glb", (vertices * [0.5, 2, 0.5], faces, normals, uv)))
    bent = variants.vary(figure, np.random.default_rng(3))
    wanted = tangents(bent.vertices, bent.faces, vertex_normals(bent.vertices, bent.faces), uv)
    belt = np.abs(normals[faces][..., 1]).max(axis=1) < 0.8
    found = bent.tangents[belt] / np.linalg.norm(bent.tangents[belt][..., :3], axis=-1, keepdims=True)
    cosine = (found[..., :3] * wanted[belt][..., :3]).sum(axis=-1)
    assert np.degrees(np.arccos(cosine.clip(-1, 1))).mean() < 3
    np.testing.assert_array_equal(np.sign(bent.tangents[..., 3]), wanted[..., 3])


def test_painted_folds_are_not_raised_where_there_is_a_map(tmp_path):
    sources = [stage.FigureSource.scan(write(tmp_path / "globe.glb", globe()))]
    stage.render_all(sources, tmp_path / "out", stage.Settings(raised=True, views=1, size=48), processes=1)
    assert "relief" not in records.Records([tmp_path / "out"])[0].about
