"""What Dask workers preload in tests: a slow stand-in for the networks, which a bright frame kills.

What else is wrong with a worker is said by the environment variable WRONG.
"""

import errno
import os
import signal
import time
from pathlib import Path

from helpers.standins import FlatSubject
from relight.distributed import dask_cluster
from relight.pipeline import shot


class Slow(FlatSubject):
    def relit(self, light):
        if self.image.max() > 2:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.05)
        return super().relit(light)


def without_weights():
    raise FileNotFoundError("field.safetensors: no such file")


def full(descriptor):
    """A disk that holds five frames."""
    folder = Path(os.readlink(f"/proc/self/fd/{descriptor}")).parent
    if len(list(folder.glob("r.*.exr"))) >= 5:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    full.flush(descriptor)


full.flush = getattr(os.fsync, "flush", os.fsync)  # Dask loads this module twice
shot.Subject = Slow
wrong = os.environ.get("WRONG")
if wrong == "no weights":
    dask_cluster.weights = without_weights
elif wrong == "other weights":
    dask_cluster.weights = lambda: ("other", "weights")
elif wrong == "full disk":
    os.fsync = full
