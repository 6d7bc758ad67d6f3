"""What is written of a person: the part of `relight.Subject` that exporters read.

`Subject.export` imports them, so they cannot import the class.
"""

from typing import Protocol

import numpy as np
import torch

from relight.analysis.record import AnalysisRecord


class Person(Protocol):
    """A `relight.Subject`, which may be empty."""

    @property
    def is_empty(self) -> bool: ...

    @property
    def record(self) -> AnalysisRecord: ...

    @property
    def size(self) -> tuple[int, int]: ...

    @property
    def matte(self) -> np.ndarray: ...

    @property
    def albedo(self) -> np.ndarray: ...

    def on_plate(self, pixels: torch.Tensor) -> np.ndarray: ...

    def upsampled(self, maps: torch.Tensor) -> np.ndarray: ...

    def photographed(self) -> np.ndarray: ...
