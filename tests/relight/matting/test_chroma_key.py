import os
import subprocess
import sys

import numpy as np
import pytest
import torch
from scipy.ndimage import binary_dilation

import relight

SIZE, SUPERSAMPLED = 200, 3
GREEN, BLUE = (0.05, 0.45, 0.08), (0.04, 0.1, 0.5)
BACKGROUNDS = np.float32([(0.8, 0.3, 0.1), (0.02, 0.02, 0.02), (1, 1, 1)])


def hairy_person(seed=0, hair=(0.10, 0.06, 0.04)):
    """A head with 90 hairs of a pixel's width and less, the right side in motion: (H, W, 4) linear."""
    random, fine = np.random.default_rng(seed), SIZE * SUPERSAMPLED
    y, x = np.mgrid[:fine, :fine] / fine
    head = ((x - 0.5) / 0.22) ** 2 + ((y - 0.45) / 0.28) ** 2 < 1
    body = ((x - 0.5) / 0.34) ** 2 + ((y - 1.05) / 0.38) ** 2 < 1
    cover = head | body
    colour = np.where(head[..., None], (0.55, 0.36, 0.27), (0.25, 0.1, 0.12))
    colour[head & (y < 0.38)] = hair
    along = np.linspace(0, 1, 400)
    for _ in range(90):
        start, length = random.uniform(-np.pi, 0), random.uniform(0.05, 0.22) / 400
        bend = start + random.normal() * 0.4 + random.uniform(-2, 2) * along
        column = (fine * (0.5 + 0.2 * np.cos(start) + np.cumsum(np.cos(bend)) * length)).astype(int)
        row = (fine * (0.42 + 0.26 * np.sin(start) + np.cumsum(np.sin(bend)) * length)).astype(int)
        inside = (row >= 0) & (row < fine - 1) & (column >= 0) & (column < fine - 1)
        for wide in range(random.integers(1, 3)):
            at = row[inside] + wide, column[inside] + wide
            cover[at], colour[at] = True, np.array(hair) * random.uniform(0.7, 1.4)
    fine_person = np.concatenate([colour * cover[..., None], cover[..., None]], axis=-1)
    person = fine_person.reshape(SIZE, SUPERSAMPLED, SIZE, SUPERSAMPLED, 4).mean(axis=(1, 3))
    moved = np.mean([np.roll(person, shift, axis=1) for shift in range(-4, 5)], axis=0)
    blurred = np.clip((np.arange(SIZE) / SIZE - 0.6) * 8, 0, 1)[None, :, None]
    return (person * (1 - blurred) + moved * blurred).astype(np.float32)


def before(person, screen, uneven=0.15, noise=0.01, seed=1):
    """The photograph of a person before an unevenly lit screen."""
    y, x = np.mgrid[:SIZE, :SIZE] / SIZE
    lit = 1 + uneven * (np.sin(3 * x + 1) + np.cos(2.5 * y)) / 2
    photograph = person[..., :3] + (1 - person[..., 3:]) * np.array(screen) * lit[..., None]
    grain = np.random.default_rng(seed).normal(size=photograph.shape) * np.sqrt(photograph + 0.01)
    return (photograph + noise * grain).clip(0).astype(np.float32)


def edge_of(person):
    """Soft pixels of the matte and two around them."""
    return binary_dilation((person[..., 3] > 0) & (person[..., 3] < 1), iterations=2)


def edge_error(keyed, person):
    """RMS over edge pixels and three backgrounds, in linear light."""
    over = [
        [p[..., :3] + (1 - p[..., 3:]) * background for background in BACKGROUNDS] for p in (keyed, person)
    ]
    return np.sqrt(np.mean((np.array(over[0]) - np.array(over[1]))[:, edge_of(person)] ** 2))


def cast(keyed, person, channel):
    """How much of the screen's channel exceeds the others' on edges over grey, against the truth: a halo."""
    others = [c for c in range(3) if c != channel]
    shown = [(p[..., :3] + (1 - p[..., 3:]) * 0.18)[edge_of(person)] for p in (keyed, person)]
    return np.mean(shown[0][:, channel] - shown[0][:, others].max(axis=1)) - np.mean(
        shown[1][:, channel] - shown[1][:, others].max(axis=1)
    )


@pytest.mark.parametrize("hair", [(0.10, 0.06, 0.04), (0.5, 0.38, 0.2), (0.4, 0.4, 0.4)])
@pytest.mark.parametrize(("screen", "colour"), [("green", GREEN), ("blue", BLUE)])
def test_hair_and_motion_blur_composite_without_halos(screen, colour, hair):
    person = hairy_person(hair=hair)
    photograph = before(person, colour)
    keyed = relight.key(photograph, screen)
    assert keyed.shape == (SIZE, SIZE, 4)
    assert keyed.dtype == np.float32
    assert edge_error(keyed, person) < 0.037
    channel = {"green": 1, "blue": 2}[screen]
    uncut = np.concatenate([photograph * person[..., 3:], person[..., 3:]], axis=-1)
    assert cast(uncut, person, channel) > 0.02  # with the true matte, but the screen's colour left in
    assert abs(cast(keyed, person, channel)) < 0.012
    assert np.abs(keyed[..., 3] - person[..., 3]).mean() < 0.01


def test_the_empty_screen_is_empty_and_the_person_solid():
    person = hairy_person()
    keyed = relight.key(before(person, GREEN, uneven=0.5, noise=0.02))
    far = ~binary_dilation(person[..., 3] > 0, iterations=12)
    assert keyed[far].max() == 0
    near = ~binary_dilation(person[..., 3] > 0, iterations=2) & ~far
    assert (keyed[near][:, 3] > 0).mean() < 0.02  # nor does grain stand around the person
    solid = ~binary_dilation(person[..., 3] < 1, iterations=6)
    assert keyed[solid][:, 3].min() == 1
    np.testing.assert_allclose(keyed[solid][:, :3], person[solid][:, :3], atol=0.08)  # but for the grain
    assert keyed.min() >= 0


def test_keying_leaves_the_threads_of_torch_alone():
    """numba's threads set the number for the whole process, and so for every later analysis."""
    person = hairy_person()
    picture = person[..., :3] + (1 - person[..., 3:]) * np.float32(GREEN)
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(1)
        relight.key(picture.astype(np.float32))
        assert torch.get_num_threads() == 1
    finally:
        torch.set_num_threads(before)


def test_spill_is_taken_out():
    person = hairy_person(hair=(0.3, 0.28, 0.25))
    photograph = before(person, GREEN, noise=0)
    photograph[..., 1] += 0.06 * person[..., 3]  # the screen's light on the person
    keyed = relight.key(photograph)
    assert (keyed[..., 1] <= keyed[..., [0, 2]].max(axis=-1) + 1e-6).all()
    assert (photograph[..., 1] > photograph[..., [0, 2]].max(axis=-1))[keyed[..., 3] == 1].any()


def test_a_garbage_matte_removes_the_studio():
    person = hairy_person()
    photograph = before(person, GREEN)
    photograph[:, :16] = (0.3, 0.25, 0.2)  # a wall beyond the screen
    garbage = np.ones((SIZE, SIZE), np.float32)
    garbage[:, :20] = 0
    keyed = relight.key(photograph, mask=garbage)
    assert keyed[:, :20].max() == 0
    assert edge_error(keyed, person) < 0.05
    assert relight.key(photograph)[100, 5, 3] > 0.9


def test_soft_alpha_is_kept_through_every_step(tmp_path):
    keyed = relight.key(before(hairy_person(), GREEN))
    picture = relight.apply(keyed, relight.DirectionalLight(azimuth=30))
    np.testing.assert_allclose(picture[..., 3], keyed[..., 3], atol=1e-6)
    relight.write(tmp_path / "a.exr", picture)
    relight.write(tmp_path / "a.png", picture, depth="uint16")
    for name, tolerance in (("a.exr", 1e-3), ("a.png", 1e-5)):
        np.testing.assert_allclose(relight.read(tmp_path / name)[..., 3], keyed[..., 3], atol=tolerance)
    soft = (keyed[..., 3] > 0.02) & (keyed[..., 3] < 0.98)
    assert soft.sum() > 1000
    assert picture[soft][:, :3].max() > 0


@pytest.mark.parametrize(
    ("image", "arguments", "error", "message"),
    [
        (np.zeros((40, 40, 3)), {}, ValueError, "image: shows no green screen"),
        (np.full((40, 40, 3), 0.5), {"screen": "blue"}, ValueError, "image: shows no blue screen"),
        (np.full((40, 40, 3), GREEN), {}, ValueError, "image: shows no person in front of the green screen"),
        (np.full((40, 40, 3), GREEN), {"screen": "red"}, ValueError, "screen: expected green or blue"),
        (np.full((40, 40, 4), 0.5), {}, ValueError, "image: has transparency; expected the opaque"),
        (np.zeros((40, 40)), {}, ValueError, r"image: expected shape \(H, W, 3\)"),
        (np.zeros((40, 40, 3), int), {}, TypeError, "image: expected uint8"),
        (np.full((40, 40, 3), GREEN), {"mask": np.ones((3, 3))}, ValueError, r"mask: expected .*\(40, 40\)"),
    ],
)
def test_key_refuses_images_without_the_screen_and_invalid_arguments(image, arguments, error, message):
    with pytest.raises(error, match=message):
        relight.key(image, **arguments)


def test_without_pymatting_it_says_what_to_install(missing):
    missing("pymatting.foreground.estimate_foreground_ml")
    with pytest.raises(ImportError, match=r"key: needs PyMatting; install it with: .*\[key\]'"):
        relight.key(np.full((40, 40, 3), GREEN))


FIRST_USE = """
import sys
import numpy as np
import relight
plate = np.full((64, 48, 3), (0.05, 0.6, 0.05), np.float32)
plate[12:60, 14:34] = (0.5, 0.4, 0.3)
assert relight.key(plate)[30, 20, 3] == 1
assert [each for each in sys.modules if each.startswith("pymatting")] == [
    "pymatting.foreground.estimate_foreground_ml"
]
"""


@pytest.mark.slow
def test_the_first_use_on_a_machine_compiles_what_is_used_alone(tmp_path):
    subprocess.run(
        [sys.executable, "-c", FIRST_USE], check=True, env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    )
    compiled = {path.name.partition(".")[0] for path in tmp_path.rglob("*.nbi")}
    assert compiled == {"estimate_foreground_ml"}
