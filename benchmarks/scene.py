"""Measure the exchange with 3D programs: irradiance of UsdLux lights, time and size of exports, pictures.

python benchmarks/scene.py                     # lights, and exports of the bundled person
python benchmarks/scene.py --pictures OUT.png  # Mitsuba's rendering of the exported mesh beside ours

Irradiance is the mean over a white sphere of 0.3 m radius, in UsdLux's units. "Defined" integrates their
definition numerically (tests/helpers/usdlux.py). Export is processor time of a thread, without the analysis.
The pictures need the extra `stage`: a light from the left, from the right and from above, and the shadow on
the floor; above Mitsuba, below `Subject.relit` and `relight.Floor`.
"""

import argparse
import math
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from checkout import ROOT
from helpers import exported, usdlux

import relight
from relight.lights.near import PointLight

PERSON = ROOT / "examples" / "person.png"
LIGHTS = ((-60, 20), (60, 20), (0, 70))  # from left, right and above: azimuth, elevation
SHADOW = (-50, 45)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--pictures", type=Path)
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        if chosen.pictures is None:
            irradiance(Path(folder))
            exports(Path(folder))
        else:
            relight.write(chosen.pictures, pictures(Path(folder)))


def irradiance(folder: Path) -> None:
    """Print the table of docs/lights.md."""
    normals = usdlux.normals()
    cases = {
        "DistantLight, `angle` 0.53": usdlux.distant(0.53, False),
        "DistantLight, `angle` 40": usdlux.distant(40, False),
        "DistantLight, `angle` 120": usdlux.distant(120, False),
        "SphereLight, radius 0.2 m at 1.7 m": usdlux.sphere(False),
        "RectLight, 0.8 x 0.4 m at 1.8 m": usdlux.flat("RectLight", False),
        "DiskLight, radius 0.3 m at 1.8 m": usdlux.flat("DiskLight", False),
    }
    print("| light | irradiance, defined | measured | RMS difference |")
    print("|---|---|---|---|")
    for name, (text, expected) in cases.items():
        (light,) = relight.read_lights(usdlux.stage(folder, text))
        true, found = expected(normals[:100]), usdlux.ours(light, normals[:100])[:, 0]
        error = np.sqrt(((found - true) ** 2).mean()) / true.max()
        print(
            f"| {name} | {math.pi * true.mean():.5g} | {math.pi * found.mean():.5g} | {100 * error:.3f} % |"
        )
    lamp = usdlux.ours(PointLight((0, 0, 1 + usdlux.RADIUS)), np.array([[0, 0, 1.0]]))[0, 0]
    print(f"| glTF point of π candela at 1 m | {math.pi:.5g} | {math.pi * lamp:.5g} | |")


def exports(folder: Path) -> None:
    """Print processor time and size of each kind of file."""
    small = relight.read(PERSON)
    large = np.repeat(np.repeat(small, 2, axis=0), 2, axis=1)
    square = np.zeros((1024, 1024, 4), np.float32)
    square[: small.shape[0], : small.shape[1]] = small[:1024, :1024]
    print("\n| plate | file | seconds of a core | MB |\n|---|---|---|---|")
    for image in (square, large):
        subject = relight.Subject(image)
        subject.albedo, subject.normals, subject.position  # noqa: B018
        for suffix in ("glb", "usdz", "nk"):
            start = time.process_time()
            path = subject.export(folder / f"person.{suffix}")
            took = time.process_time() - start
            layers = folder / "person_layers.exr"
            size = (layers if suffix == "nk" else path).stat().st_size / 1e6
            print(f"| {image.shape[0]} x {image.shape[1]} | .{suffix} | {took:.2f} | {size:.1f} |")


def pictures(folder: Path) -> np.ndarray:
    """Render both rows, each picture over grey."""
    subject = relight.Subject(np.ascontiguousarray(relight.read(PERSON)[::2, ::2]))
    path, height = subject.export(folder / "person.usda"), subject.size[0]
    above, below = [], []
    for azimuth, elevation in LIGHTS:
        light = relight.DirectionalLight(azimuth=azimuth, elevation=elevation)
        seen = exported.path_traced(path, light.direction, height, samples=16)
        covered = seen[..., 3:].clip(0, 1)
        above.append(np.concatenate([seen[..., :3], covered], axis=-1).astype(np.float32))
        below.append(subject.relit(light))
    backdrop = np.float32([0.18, 0.18, 0.18])
    rows = [np.concatenate([relight.over(each, backdrop) for each in row], axis=1) for row in (above, below)]
    floors = _floors(path, subject)
    return np.concatenate(
        [np.concatenate([row, floor], axis=1) for row, floor in zip(rows, floors, strict=True)]
    )


def _floors(path: Path, subject: relight.Subject) -> tuple[np.ndarray, np.ndarray]:
    """Render the shadow on a grey floor: Mitsuba's, and ours."""
    light = relight.DirectionalLight(azimuth=SHADOW[0], elevation=SHADOW[1])
    height = subject.size[0]
    seen = exported.path_traced(path, light.direction, height, samples=16, floor=True)[..., :3]
    floor = relight.Floor(horizon=0.5)  # the camera looks level
    _, shadow = subject.shadows([light], floor)
    lit = 0.5 * light.direction[1]
    behind = (shadow * np.float32(lit)).astype(np.float32)
    return np.float32(seen), relight.over(subject.relit(light), behind)


if __name__ == "__main__":
    main()
