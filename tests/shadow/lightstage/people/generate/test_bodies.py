"""Figures for the light stage: procedural people and meshes from files."""

import subprocess
import sys

import numpy as np
import pytest
import torch
from helpers import ROOT
from PIL import Image

pytest.importorskip("embreex")
pytest.importorskip("numba")
trimesh = pytest.importorskip("trimesh")
pytestmark = pytest.mark.slow  # bodies are made, dressed and draped

from shadow.lightstage import scans
from shadow.lightstage.mesh import add_lining, boundary_chains, clip, subdivide
from shadow.lightstage.people.generate import bodies

SPLITS = ("training", "validation", "generalisation")


@pytest.fixture(scope="module")
def people():
    return {split: bodies.body(5, split) for split in SPLITS}


def digest(figure):
    return [float(np.abs(x.astype(float)).sum()) for x in (figure.vertices, figure.normals)] + [
        len(figure.faces)
    ]


def surface_points(figure, count=20_000):
    rng = np.random.default_rng(0)
    return rng.integers(0, len(figure.faces), count), rng.dirichlet(np.ones(3), count)


@pytest.mark.parametrize("split", SPLITS)
def test_body_keeps_the_contract_of_a_figure(people, split):
    figure = people[split]
    assert figure.vertices.dtype == np.float32
    assert figure.faces.dtype == np.int32
    assert figure.normals.dtype == np.float32
    assert figure.vertices.shape == figure.normals.shape
    assert np.isfinite(figure.vertices).all()
    assert figure.faces.min() == 0
    assert figure.faces.max() == len(figure.vertices) - 1
    assert np.allclose(np.linalg.norm(figure.normals, axis=1), 1, atol=1e-4)
    assert abs(figure.vertices[:, 1].min()) < 1e-5
    assert 0.8 < figure.vertices[:, 1].max() < 2.6
    assert np.abs(figure.vertices[:, [0, 2]]).max() < 1.6
    assert figure.name == f"{split}-000005"


@pytest.mark.parametrize("split", SPLITS)
def test_body_albedo_is_finite_and_within_the_range_of_real_surfaces(people, split):
    face, barycentric = surface_points(people[split])
    albedo = people[split].albedo(face, barycentric)
    assert albedo.shape == (len(face), 3)
    assert albedo.dtype == np.float32
    assert albedo.min() >= 0.019
    assert albedo.max() <= 0.901
    assert albedo.std() > 0.01


def test_shading_normals_agree_with_the_faces(people):
    """Consistent winding: the faces look where their smooth normals do."""
    figure = people["training"]
    a, b, c = (figure.vertices[figure.faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    mean = figure.normals[figure.faces].mean(axis=1)
    agreeing = (area * mean).sum(axis=1) > 0
    assert np.average(agreeing, weights=np.linalg.norm(area, axis=1)) > 0.99


def test_body_faces_outwards(people):
    figure = people["training"]
    a, b, c = (figure.vertices[figure.faces[:, k]].astype(float) for k in range(3))
    volume = (np.cross(a, b) * c).sum() / 6
    assert 0.02 < volume < 0.5  # cubic metres; inside out it would be negative


def test_same_seed_gives_the_same_body_in_another_process(people, tmp_path):
    """Whatever number of threads the two have."""
    script = (
        "import sys, torch; torch.set_num_threads(1 + int(sys.argv[2]));"
        "from shadow.lightstage.people.generate import bodies; import numpy as np;"
        "f = bodies.body(5, 'validation');"
        "[np.save(sys.argv[1] + name, getattr(f, name)) for name in ('vertices', 'faces', 'normals')]"
    )
    root, threads = ROOT, str(torch.get_num_threads())
    subprocess.run([sys.executable, "-c", script, f"{tmp_path}/", threads], check=True, cwd=root)
    for name in ("vertices", "faces", "normals"):
        assert np.array_equal(np.load(tmp_path / f"{name}.npy"), getattr(people["validation"], name))


def test_seeds_and_splits_give_different_people(people):
    other = bodies.body(6, "training")
    digests = [digest(figure) for figure in (*people.values(), other)]
    assert all(a != b for k, a in enumerate(digests) for b in digests[:k])


@pytest.mark.parametrize(("seed", "split", "message"), [(0, "test", "split"), (-1, "training", "seed")])
def test_body_names_the_bad_argument(seed, split, message):
    with pytest.raises(ValueError, match=message):
        bodies.body(seed, split)


# Cloth -----------------------------------------------------------------------------------------------------


def sheet(size=6):
    """A flat square of cloth in the plane z = 0, side 1, seen from +z."""
    x, y = np.meshgrid(np.linspace(0, 1, size), np.linspace(0, 1, size))
    ids = np.arange(size * size).reshape(size, size)
    a, b, c, d = ids[:-1, :-1].ravel(), ids[:-1, 1:].ravel(), ids[1:, :-1].ravel(), ids[1:, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)])
    return np.stack([x.ravel(), y.ravel(), np.zeros(size * size)], axis=1), faces


def area(vertices, faces):
    return np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2)))[:, 2].sum() / 2


def test_clip_cuts_along_the_line_and_keeps_the_winding():
    vertices, faces = sheet()
    faces, rows = clip(faces, 0.53 - vertices[:, 0])
    kept = rows @ vertices
    assert kept[:, 0].max() == pytest.approx(0.53)
    assert area(kept, faces) == pytest.approx(0.53, rel=1e-6)


def test_subdivide_keeps_a_flat_sheet_flat():
    vertices, faces = sheet()
    fine, rows = subdivide(faces, len(vertices))
    assert len(fine) == 4 * len(faces)
    assert np.allclose(np.asarray(rows.sum(axis=1)), 1)
    smooth = rows @ vertices
    assert area(smooth, fine) == pytest.approx(1, rel=0.02)  # its corners are rounded


def test_line_closes_a_sheet():
    vertices, faces = sheet()
    points, lined, source = add_lining(vertices, faces, thickness=0.01, depth=2.0)
    assert boundary_chains(lined) == []
    assert len(points) == len(source)
    assert trimesh.Trimesh(points, lined, process=False).volume == pytest.approx(0.01, rel=0.01)


# Scans -----------------------------------------------------------------------------------------------------

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0]], float) + [3, 1, 5]
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
SRGB_HALF = 0.21404  # linear value of sRGB 0.5


def textured():
    """A 1 x 2 metre card, its texture black below and mid grey (sRGB 128) above."""
    pixels = np.zeros((8, 8, 3), np.uint8)
    pixels[:4] = 128
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(pixels))
    return trimesh.Trimesh(
        CORNERS, FACES, process=False, visual=trimesh.visual.TextureVisuals(uv=UV, material=material)
    )


def at(figure, x, y):
    """Albedo of the card at fractions x, y of its width and height."""
    if x >= y:
        face, weights = 0, [1 - x, x - y, y]
    else:
        face, weights = 1, [1 - y, x, y - x]
    return figure.albedo(np.array([face]), np.array([weights]))[0]


@pytest.mark.parametrize("suffix", ["glb", "obj"])
def test_load_reads_the_texture_bilinearly_in_linear_light(tmp_path, suffix):
    path = tmp_path / f"card.{suffix}"
    textured().export(path)
    figure = scans.load(path)
    assert figure.name == "card"
    assert at(figure, 0.4, 0.85) == pytest.approx([SRGB_HALF] * 3, abs=0.01)
    assert at(figure, 0.4, 0.1) == pytest.approx([0] * 3, abs=0.01)
    assert at(figure, 0.4, 0.5) == pytest.approx([SRGB_HALF / 2] * 3, abs=0.02)


def test_load_grounds_and_centres(tmp_path):
    path = tmp_path / "card.glb"
    textured().export(path)
    figure = scans.load(str(path))
    assert figure.vertices.min(axis=0) == pytest.approx([-0.5, 0, 0], abs=1e-5)
    assert figure.vertices.max(axis=0) == pytest.approx([0.5, 2, 0], abs=1e-5)
    assert figure.vertices.dtype == figure.normals.dtype == np.float32
    assert figure.faces.dtype == np.int32
    assert figure.normals == pytest.approx(np.tile([0, 0, 1], (4, 1)), abs=1e-5)


def test_load_reads_vertex_colours(tmp_path):
    path = tmp_path / "card.ply"
    colours = np.array([[255, 0, 0, 255], [255, 0, 0, 255], [0, 0, 255, 255], [0, 0, 255, 255]], np.uint8)
    trimesh.Trimesh(CORNERS, FACES, vertex_colors=colours, process=False).export(path)
    figure = scans.load(path)
    assert at(figure, 0.5, 0.01) == pytest.approx([0.99, 0, 0.01], abs=0.02)
    assert at(figure, 0.5, 0.99) == pytest.approx([0.01, 0, 0.99], abs=0.02)


def test_load_is_grey_without_colour_and_keeps_stored_normals(tmp_path):
    path = tmp_path / "card.ply"
    bent = np.tile([0.6, 0.0, 0.8], (4, 1))
    trimesh.Trimesh(CORNERS, FACES, vertex_normals=bent, process=False).export(path, vertex_normal=True)
    figure = scans.load(path)
    assert figure.normals == pytest.approx(bent, abs=1e-5)
    assert at(figure, 0.3, 0.6) == pytest.approx([scans.GREY] * 3)


@pytest.mark.parametrize(
    ("name", "content"), [("broken.glb", b"not a mesh"), ("empty.obj", b"v 0 0 0\n"), ("x.txt", b"")]
)
def test_load_names_the_path_of_a_bad_file(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=name):
        scans.load(path)


def test_load_names_a_missing_file(tmp_path):
    with pytest.raises(ValueError, match=r"nowhere\.glb"):
        scans.load(tmp_path / "nowhere.glb")
