"""Time calls on a busy machine. Used by other benchmarks; it has no command."""

import time
from collections.abc import Callable
from typing import Any


def quickest(
    function: Callable[[], Any], repeats: int, clock: Callable[[], float] = time.process_time
) -> float:
    """Seconds of the quickest of several calls, the one that the machine disturbed least: of processor time,
    unless another clock of `time` is given."""
    times = []
    for _ in range(repeats):
        start = clock()
        function()
        times.append(clock() - start)
    return min(times)
