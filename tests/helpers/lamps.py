"""Files that say how a lamp shines, written by hand."""

import numpy as np


def ies(
    candela,
    vertical,
    horizontal,
    *,
    version="IESNA:LM-63-2002",
    kind=1,
    tilt="TILT=NONE",
    lumens=-1,
    multiplier=1.0,
    ballast=1.0,
    factor=1.0,
):
    """The text of an IES file of candela (H, V)."""

    def row(values):
        return " ".join(f"{value:g}" for value in np.ravel(values))

    head = f"{version}\n[TEST] by hand\n" if version else "a lamp of 1986\n"
    counts = f"1 {lumens:g} {multiplier:g} {len(vertical)} {len(horizontal)} {kind} 2 0.1 0.1 0"
    lines = [counts, f"{ballast:g} {factor:g} 100", row(vertical), row(horizontal), *map(row, candela)]
    return f"{head}{tilt}\n" + "\n".join(lines) + "\n"


def ldt(values, angles, planes, symmetry, *, lumens=2000, lamps=1, conversion=1):
    """The text of a EULUMDAT file of stored values (C, G), candela for 1000 lm."""
    head = [
        "maker", "3", f"{symmetry}", f"{len(planes)}", f"{360 / len(planes):g}", f"{len(angles)}", "0",
        "report", "lamp", "1", "file", "date", *["0"] * 9, "100", "100", f"{conversion:g}", "0", "1",
        f"{lamps}", "LED", f"{lumens:g}", "3000", "90", "20", *["0.5"] * 10,
    ]  # fmt: skip
    numbers = [f"{value:g}" for value in (*planes, *angles, *np.ravel(values))]
    return "\r\n".join([*head, *numbers]) + "\r\n"
