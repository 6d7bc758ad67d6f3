"""MakeHuman's assets on generated people, with small assets that the tests make."""

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("embreex")
pytest.importorskip("numba")
pytestmark = pytest.mark.slow  # bodies are made, dressed and draped

from shadow.data import records
from shadow.lightstage.people import makehuman
from shadow.lightstage.people.body.anatomy import Person, base_mesh
from shadow.lightstage.people.generate import bodies
from shadow.lightstage.stage import views

SKINS = (
    "young_lightskinned_{}_diffuse",
    "young_lightskinned_{}_diffuse3",
    "middleage_lightskinned_{}_diffuse2",
)
CARD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"
SCALES = "x_scale 5399 11998 1.0\ny_scale 791 881 1.0\nz_scale 962 5320 1.0\n"
HEAD = 881  # a vertex of the head's top


def write_asset(folder, kind, name, hidden=""):
    """A card of 10 cm whose corners are 0 to 1 units in front of a vertex of the head."""
    path = folder / kind / name / name
    path.parent.mkdir(parents=True)
    path.with_suffix(".obj").write_text(CARD)
    corners = "".join(
        f"{HEAD} {HEAD} {HEAD} 0.5 0.25 0.25 {x} {y} 0.1\n" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))
    )
    path.with_suffix(".mhclo").write_text(f"# a comment\nname {name}\nverts 0\n{SCALES}{corners}{hidden}")


def picture(path, colour, alpha=None):
    texels = np.full((16, 16, 4), (*colour, 255), np.uint8)
    if alpha is not None:
        texels[:, 8:, 3] = alpha
    image = Image.fromarray(texels)
    (image if alpha is not None else image.convert("RGB")).save(path, quality=100)


@pytest.fixture(scope="module")
def assets(tmp_path_factory):
    """A folder with one colour for each kind of asset; the right half of hair is transparent."""
    folder = tmp_path_factory.mktemp("makehuman")
    (folder / "textures").mkdir()
    for sex in ("male", "female"):
        for skin in SKINS:
            picture(folder / f"textures/{skin.format(sex)}.jpg", (200, 40, 40))
        write_asset(folder, "clothes", f"{sex}_casualsuit01", "\ndelete_verts\n0 - 13000 13001\n")
        picture(folder / f"textures/{sex}_casualsuit01_normal.jpg", (200, 128, 220))
    for name in {*makehuman.HAIR["male"], *makehuman.HAIR["female"]}:
        write_asset(folder, "hair", name)
        picture(folder / f"textures/{name}_diffuse.png", (90, 90, 90), alpha=0)
    for number in range(1, 13):
        write_asset(folder, "eyebrows", f"eyebrow{number:03}")
        picture(folder / f"textures/eyebrow{number:03}.png", (0, 0, 0), alpha=255)
    for number in range(1, 5):
        write_asset(folder, "eyelashes", f"eyelashes0{number}")
        picture(folder / f"textures/eyelashes0{number}.png", (0, 0, 0), alpha=255)
    for number in range(1, 7):
        write_asset(folder, "clothes", f"shoes0{number}")
        picture(folder / f"textures/shoes0{number}_diffuse.jpg", (10, 10, 200))
    return folder


@pytest.fixture(scope="module")
def person():
    shape = bodies.Shape.draw(np.random.default_rng(1))
    return Person(base_mesh(), shape.skeleton, shape.rest, {})


def look(assets, split="training", seed=0, **chosen):
    """The first look from a seed that has what is chosen: suit=True, hair=False."""
    for number in range(seed, 200):
        found = makehuman.Look.draw(assets, np.random.default_rng(number), split, woman=False, heel=0.0)
        if all((getattr(found, name) is not None) == wanted for name, wanted in chosen.items()):
            return found
    raise AssertionError(chosen)


def test_a_bound_mesh_follows_the_body(assets, person):
    """Corners are the weighted base vertex and the offset, whose unit is a distance on the body."""
    binding, fabric = look(assets, suit=True).suit
    part = binding.on(person, fabric)
    unit = [
        abs(person.rest[a, k] - person.rest[b, k])
        for k, (a, b) in enumerate(((5399, 11998), (791, 881), (962, 5320)))
    ]
    corners = person.rest[HEAD] + np.array([[0, 0, 0.1], [1, 0, 0.1], [1, 1, 0.1], [0, 1, 0.1]]) * unit
    # Loop subdivision moves the corners of a boundary inwards; their bounding box keeps its middle.
    np.testing.assert_allclose(part.rest.mean(axis=0), corners.mean(axis=0), atol=1e-6)
    assert np.ptp(part.rest, axis=0) == pytest.approx(np.ptp(corners, axis=0), rel=0.3)
    assert part.vertices[:, 2] - part.rest[:, 2] == pytest.approx(makehuman.LIFT, abs=1e-6)


def test_cards_are_cut_along_their_alpha(assets, person):
    binding, fabric = look(assets, hair=True).hair
    part = binding.on(person, fabric)
    corners = part.vertices[part.faces]
    area = (
        np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
        / 2
    )
    unit = np.abs(person.rest[5399, 0] - person.rest[11998, 0]) * np.abs(
        person.rest[791, 1] - person.rest[881, 1]
    )
    assert area == pytest.approx(unit / 2, rel=0.03)
    assert part.uv[..., 0].max() == pytest.approx(0.5, abs=0.03)


def test_a_person_has_the_skin_of_the_picture(assets):
    figure = bodies.body(3, "training", assets=assets)
    face = np.flatnonzero(figure.regions == records.REGIONS.index("face"))
    albedo = figure.albedo(face, np.full((len(face), 3), 1 / 3))
    red = albedo[:, 0] > 4 * albedo[:, 1]
    assert red.mean() > 0.5  # the rest are eyes, brows and lashes
    assert np.isfinite(figure.vertices).all()


def test_the_same_seed_gives_the_same_person(assets):
    first, second = (bodies.body(4, "training", assets=assets) for _ in range(2))
    np.testing.assert_array_equal(first.vertices, second.vertices)
    face = np.arange(0, len(first.faces), 50)
    middle = np.full((len(face), 3), 1 / 3)
    np.testing.assert_array_equal(first.albedo(face, middle), second.albedo(face, middle))


def test_clothes_hide_the_body_and_keep_their_normal_map(assets, person):
    """The suit of the fixture deletes most of the body, and its map tilts the normals."""
    chosen = look(assets, suit=True)
    wardrobe = bodies.Wardrobe(person, np.random.default_rng(0))
    chosen.wear(wardrobe, chosen.suit)
    assert wardrobe.hidden[:13002].all()
    assert not wardrobe.hidden[13002:].any()
    skin = bodies.skin_part(person, wardrobe, np.random.default_rng(0), chosen)
    whole = bodies.skin_part(
        person, bodies.Wardrobe(person, np.random.default_rng(0)), np.random.default_rng(0), chosen
    )
    assert len(skin.faces) < 0.2 * len(whole.faces)
    normal_map, tangents = bodies.joined_normal_map([skin, wardrobe.parts[0]])
    cloth = np.array([len(skin.faces)])
    tilted, flat = (normal_map(face, np.full((1, 3), 1 / 3))[0] for face in (cloth, np.array([0])))
    assert tilted[0] > 0.3
    np.testing.assert_array_equal(flat, [0, 0, 1])
    assert np.abs(tangents[cloth]).sum() > 0


def test_the_splits_share_no_skin(assets):
    """Skins that are reserved for another split are not drawn for training."""
    names = {split: set() for split in bodies.SPLITS}
    for split, drawn in names.items():
        for seed in range(30):
            rng = np.random.default_rng(seed)
            skins = [path.stem for path in assets.glob("textures/*skinned_male_diffuse*")]
            drawn.add(makehuman.choose(rng, split, skins))
    assert not names["training"] & names["validation"]
    assert names["validation"] == {"middleage_lightskinned_male_diffuse2"}


def test_a_folder_without_assets_is_named(tmp_path):
    with pytest.raises(ValueError, match=f"makehuman: expected .*textures.*{tmp_path.name}"):
        bodies.body(0, "training", assets=tmp_path)


def test_views_of_the_head_are_near_and_before_the_face(assets):
    """The camera of a head looks at the face, from at most 2 m, mostly from the front."""
    figure = bodies.body(3, "training", assets=assets)
    found = views(40, figure, np.random.default_rng(0), head=True)
    face = figure.vertices[figure.faces[figure.regions == records.REGIONS.index("face")]].mean(axis=(0, 1))
    for view in found:
        seen = view.rotation() @ (face - view.position())
        assert -2.0 < seen[2] < -0.3
        assert abs(seen[0] / seen[2]) < np.tan(np.radians(view.fov) / 2)
        assert abs(seen[1] / seen[2]) < np.tan(np.radians(view.fov) / 2)
    normals = figure.normals[figure.faces[figure.regions == records.REGIONS.index("face")]].mean(axis=(0, 1))
    before = [normals @ (view.position() - face) > 0 for view in found]
    assert np.mean(before) > 0.75
