"""Open a USD file and read all of it: run as a program of its own, which a damaged binary layer may end.

USD trusts its binary layers (.usdc, and those in a .usdz): a changed byte aborts the process or asks for any
amount of memory. `relight.scene.usd.stage` runs this file first, with limits, and reads the file itself only
if all of it could be read here. It imports nothing but USD, so that it starts at once.

    python probe.py FILE BYTES SECONDS
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from pxr import Sdf

STARTED = "started"  # printed once USD is loaded: what ends the program from then on is in the file
REFUSED = 2  # exit status for errors that USD raises; what it says follows on the standard output


def main(path: str, memory: int, seconds: int) -> None:
    """Read a USD file within so many bytes of memory, libraries included, and seconds of a processor."""
    from pxr import Sdf, Tf, Usd, UsdGeom, UsdLux  # noqa: F401 (the schemas of lights and cameras)

    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, OSError, ValueError):  # of another system, or a stricter limit of its own
        pass
    print(STARTED, flush=True)
    try:
        layer = Sdf.Layer.FindOrOpen(path)
        if layer is None:
            _refuse("is not a USD stage")
        if not _reads(layer, set()):
            _refuse("is damaged: it lists what it does not hold")
        stage = Usd.Stage.Open(layer)
        for prim in stage.TraverseAll():
            for attribute in prim.GetAttributes():
                times = attribute.GetTimeSamples()
                attribute.Get()
                for time in {*times[:1], *times[-1:]}:
                    attribute.Get(time)
            for relationship in prim.GetRelationships():
                relationship.GetTargets()
            if imageable := UsdGeom.Xformable(prim):
                imageable.GetLocalTransformation()
    except (Tf.ErrorException, RuntimeError, UnicodeDecodeError, MemoryError):
        _refuse("is damaged: USD cannot read it")


def _refuse(problem: str) -> NoReturn:
    print(problem)
    sys.exit(REFUSED)


def _reads(layer: Sdf.Layer, done: set[str]) -> bool:
    """Read every field of a layer and of those it draws in; return whether they hold what they list."""
    from pxr import Sdf

    done.add(layer.identifier)
    listed: list = []
    layer.Traverse(Sdf.Path.absoluteRootPath, listed.append)
    for path in listed:
        spec = layer.GetObjectAtPath(path)
        if spec is None:
            if path.IsPrimPath() or path.IsPrimPropertyPath():
                return False
            continue
        for key in spec.ListInfoKeys():
            spec.GetInfo(key)
    for asset in filter(None, layer.GetCompositionAssetDependencies()):  # "" refers within the layer
        below = Sdf.Layer.FindOrOpen(layer.ComputeAbsolutePath(asset))
        if below is not None and below.identifier not in done and not _reads(below, done):
            return False
    return True


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
