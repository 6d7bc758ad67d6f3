"""What must hold of an answer, and of an error, whatever comes: shared by the kinds of hostile inputs."""

from pathlib import Path
from typing import Any

import numpy as np

ALLOWED = (ValueError, TypeError, OSError)
LONGEST = 2000  # characters of an error: a line that a person reads


class Violation(AssertionError):
    """An answer that breaks an invariant, or an error that no person could use."""


def require(holds: Any, what: str) -> None:
    if not holds:
        raise Violation(what)


def require_finite(name: str, array: np.ndarray) -> None:
    require(np.isfinite(array).all(), f"{name}: NaN or infinite")


def require_same(what: str, one: np.ndarray, other: np.ndarray, tolerance: float = 1e-5) -> None:
    """Equal to `tolerance`, relative to the largest value of the other."""
    require(one.shape == other.shape, f"{what}: {one.shape} and {other.shape}")
    scale = np.abs(other).max(initial=1e-30).astype(np.float64)
    worst = np.abs(one.astype(np.float64) - other).max(initial=0) / scale
    require(worst <= tolerance, f"{what}: {worst:.3g} of the largest value apart")


def require_named(path: Path, error: Exception) -> None:
    require(str(path) in str(error), f"an error that doesn't name the file: {error}")


def require_usable(text: str) -> None:
    """An error in one line, not too long."""
    require(text.strip() and "\n" not in text and len(text) < LONGEST, f"error of no use: {text!r}")
