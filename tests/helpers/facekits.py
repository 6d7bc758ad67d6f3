"""A model of heads as small as tests need it, in the layout of ICT-FaceKit's light model."""

import numpy as np
import trimesh

PARTS = (
    *("face", "head_neck", "mouth_socket", "eye_socket_left", "eye_socket_right", "gums_tongue", "teeth"),
    *("eyeball_left", "eyeball_right"),
)
EYES = {"left": (3.2, 3.6, 8.4), "right": (-3.2, 3.6, 8.4)}
SHAPES = (
    *("jawOpen", "mouthFunnel", "mouthPucker"),
    *(
        f"{name}_{side}"
        for name in (
            *("mouthSmile", "cheekSquint", "mouthUpperUp", "browInnerUp", "browOuterUp", "eyeWide"),
            *("browDown", "noseSneer", "mouthPress", "mouthFrown", "cheekPuff", "eyeSquint", "eyeBlink"),
            *("eyeLookOut", "eyeLookIn"),
        )
        for side in "LR"
    ),
)


def ball(centre, radii):
    mesh = trimesh.creation.icosphere(3)
    return np.asarray(mesh.vertices) * radii + centre, np.asarray(mesh.faces)


def parts():
    """Yield the parts: an egg whose front is the face, with a neck, and balls for what is in it."""
    egg, faces = ball((0, 3, 1), (7.6, 11.4, 9.6))
    front = egg[faces][:, :, 2].mean(axis=1) > 1
    yield "face", egg, faces[front]
    neck = trimesh.creation.cylinder(5.5, 18, sections=48).subdivide().subdivide()
    pillar = np.asarray(neck.vertices)[:, [0, 2, 1]] + [0, -11, -1]
    back = faces[~front]
    yield "head_neck", np.vstack([egg, pillar]), np.vstack([back, np.asarray(neck.faces)[:, ::-1] + len(egg)])
    yield "mouth_socket", *ball((0, -3.5, 8), (1, 0.5, 0.5))
    for side in ("left", "right"):
        yield f"eye_socket_{side}", *ball(EYES[side], (1.3, 1.3, 1.3))
    yield "gums_tongue", *ball((0, -4, 7), (0.8, 0.4, 0.4))
    yield "teeth", *ball((0, -3.5, 7), (0.8, 0.4, 0.4))
    for side in ("left", "right"):
        yield f"eyeball_{side}", *ball(EYES[side], (1.2, 1.2, 1.2))


def write(folder, components=4):
    """Write the model to a folder as `ict.npz`."""
    made = list(parts())
    first = np.cumsum([0, *(len(points) for _, points, _ in made)])
    ends = np.cumsum([0, *(len(faces) for *_, faces in made)])
    vertices = np.concatenate([points for _, points, _ in made]).astype(np.float32)
    faces = np.concatenate([each + start for (*_, each), start in zip(made, first, strict=False)])
    quads = np.concatenate([faces, faces[:, 2:]], axis=1).astype(np.uint16)
    rng = np.random.default_rng(0)
    waves = np.sin(vertices @ rng.normal(0, 0.15, (components, 3)).T + rng.uniform(0, 6, components))
    identity = (0.3 * waves.T[:, :, None] * rng.normal(size=(components, 1, 3))).astype(np.float16)
    expression = np.zeros((len(SHAPES), *vertices.shape), np.float16)
    expression[0, vertices[:, 1] < -2, 1] = -1  # jawOpen
    landmarks = np.zeros(68, np.int32)
    landmarks[8] = np.argmin(np.linalg.norm(vertices - [0, -7.6, 4], axis=1))
    np.savez_compressed(
        folder / "ict.npz", neutral=vertices, identity=identity, expression=expression,
        expression_names=np.array(SHAPES), quads=quads, quads_uv=quads, uv=vertices[:, :2] / 40 + 0.5,
        part_names=np.array([name for name, *_ in made]),
        part_ranges=np.stack([first[:-1], first[1:], ends[:-1], ends[1:]], axis=1), landmarks68=landmarks,
    )  # fmt: skip
    return folder
