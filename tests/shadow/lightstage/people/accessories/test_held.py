"""Things in hands, chairs under those who sit, glasses on noses: where they belong, and outside the body."""

import numpy as np
import pytest

pytest.importorskip("embreex")
pytest.importorskip("numba")
trimesh = pytest.importorskip("trimesh")
pytest.importorskip("kornia")
pytestmark = pytest.mark.slow  # bodies are made, dressed and draped

from shadow import directions
from shadow.data.records import REGIONS
from shadow.lightstage import stage
from shadow.lightstage.figure import Figure, vertex_normals
from shadow.lightstage.people.accessories import glasses, held, locks, seats
from shadow.lightstage.people.accessories.hair import Skull
from shadow.lightstage.people.body.anatomy import LEGS
from shadow.lightstage.people.cloth.fabric import Fabric
from shadow.lightstage.people.cloth.garments import Wardrobe
from shadow.lightstage.people.generate import bodies, poses

GREY = Fabric.plain(np.full(3, 0.5))


def wardrobe(gesture, seated=False, seed=0):
    """Somebody undressed, skin as the only part, after a gesture of the poses."""
    rng = np.random.default_rng(seed)
    shape = bodies.Shape.draw(rng)
    pose = poses.stand(shape.skeleton, rng)
    if seated:
        poses.seated_legs(pose)
    gesture(pose)
    person = shape.posed(pose)
    made = Wardrobe(person, rng)
    made.parts.append(bodies.skin_part(person, made, rng))
    return made, rng


def closed(part):
    mesh = trimesh.Trimesh(part.vertices, part.faces)  # merged where corners lie on one another
    return mesh.is_watertight and mesh.volume > 0


@pytest.mark.parametrize("thing", ["binder", "folder", "book", "phone", "stick"])
def test_a_thing_lies_in_the_hand_and_not_in_the_body(thing):
    made, rng = wardrobe(lambda pose: poses.reading(pose, "L"))
    assert held.hold(made, rng, "L", thing, GREY)
    part = made.parts[-1]
    assert closed(part)
    at = held.Grip.of(made, "L").at
    assert np.linalg.norm(part.vertices - at, axis=1).min() < 0.06
    assert held.Surroundings(made, "L").depth(part.vertices) < held.MAX_PENETRATION


def test_binders_are_held_at_many_angles_to_the_body():
    angles = []
    for seed in range(8):
        made, rng = wardrobe(lambda pose: poses.hugging(pose, "R"), seed=seed)
        if held.hold(made, rng, "R", "binder", GREY):
            points = made.parts[-1].vertices
            across = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2]
            angles.append(np.degrees(np.arccos(abs(across[2]))))
    assert len(angles) >= 5
    assert np.ptp(angles) > 20


def test_a_bag_hangs_from_the_fist_and_a_crate_is_between_the_hands():
    made, rng = wardrobe(lambda pose: poses.arms_down(pose, "R"))
    assert held.hold(made, rng, "R", "bag", GREY)
    bag = made.parts[1]
    assert closed(bag)
    assert bag.vertices[:, 1].max() < held.Grip.of(made, "R").at[1]
    made, rng = wardrobe(poses.lifting)
    assert held.hold(made, rng, "both", "crate", GREY)
    left, right = (held.Grip.of(made, side).at for side in "LR")
    assert right[0] < made.parts[-1].vertices[:, 0].mean() < left[0]


def test_a_seat_is_as_high_as_the_thighs_and_stands_on_the_floor():
    for seed in range(3):
        made, rng = wardrobe(lambda pose: None, seated=True, seed=seed)
        skin = made.parts[0].vertices
        seats.sit(made, rng, GREY)
        chair = made.parts[1:]
        assert all(closed(part) for part in chair)
        assert min(part.vertices[:, 1].min() for part in chair) == pytest.approx(skin[:, 1].min(), abs=1e-3)
        person = made.person
        thighs = [person.limb_joints(k)[0] * 0.7 + person.limb_joints(k)[1] * 0.3 for k in LEGS]
        bones = [person.base.names.index(f"upperleg01.{side}") for side in "LR"]
        top = chair[0].vertices[:, 1].max()
        for thigh, bone in zip(thighs, bones, strict=True):
            transform = person.transforms[bone]
            middle = transform[:, :3] @ thigh + transform[:, 3]
            assert 0.02 < middle[1] - top < 0.14  # half a thigh


def test_glasses_sit_before_the_eyes_and_cast_a_shadow():
    made, rng = wardrobe(lambda pose: None)
    skull = Skull(made.person)
    parts = glasses.glasses(made.person, skull, rng)
    eyes = skull.posed(skull.eyes[None])[0]
    rims = parts[0].vertices
    assert abs(rims[:, 1].mean() - eyes[1]) < 0.02
    assert all(part.label == REGIONS.index("face") for part in parts)

    def lit(pieces):
        vertices = np.concatenate([piece.vertices for piece in pieces])
        starts = np.cumsum([0] + [len(piece.vertices) for piece in pieces])
        faces = np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=False)])
        grey = lambda face, barycentric: np.full((len(face), 3), 0.5, np.float32)  # noqa: E731
        normals = vertex_normals(vertices, faces)
        figure = Figure(vertices.astype("f4"), faces.astype("i4"), normals.astype("f4"), grey, "head")
        view = stage.View(distance=2, height=eyes[1], fov=8)
        record = stage.render(figure, view, 160, directions.from_spherical([20], [50]))
        return record.image(record.visibility.astype("f4"))[0].numpy(), record.image(record.normals).numpy()

    (bare, smooth), (with_glasses, rimmed) = lit(made.parts), lit([*made.parts, *parts])
    assert ((bare > with_glasses).sum()) > 100
    assert (np.abs(smooth - rimmed).max(axis=0) > 0.3).sum() > 200


@pytest.mark.parametrize("style", [locks.tousled, locks.fringe])
def test_locks_stand_off_the_head_from_roots_in_its_skin(style):
    made, rng = wardrobe(lambda pose: None)
    skull = Skull(made.person)
    part = style(skull, GREY, rng)
    ring = part.rest.reshape(-1, locks.LOCK_RINGS + 1, locks.RING_CORNERS, 3)
    height = np.linalg.norm(ring - skull.centre, axis=-1)
    near = skull.radius[np.argmax(((ring - skull.centre) / height[..., None]) @ skull.direction.T, axis=-1)]
    above = height - near
    assert above[:, 0].max() < 0.004
    assert np.percentile(above.max(axis=(1, 2)), 20) > 0.004
    eyes = skull.eyes[1]
    assert (part.rest[part.rest[:, 2] > skull.eyes[2] - 0.01, 1] > eyes + 0.005).all()  # eyes are free
    corners = part.vertices[part.faces]
    assert (np.cross(corners[:, 0], corners[:, 1]) * corners[:, 2]).sum() > 0
