"""Measure the start-up cost of commands and of their errors: processor time of whole processes.

Each row is the quickest of five new processes, in seconds and as a multiple of `import torch` in the same
run; an error's is a multiple of `relight --help`.

    OMP_NUM_THREADS=1 python benchmarks/start.py

`relight apply` takes 2.1 times as long as `import torch`, or 2.4 in float32 (ATEN_CPU_CAPABILITY=avx2
ONEDNN_MAX_CPU_ISA=AVX2); the aim is 2.0.
`relight --help` takes 0.19 s, and no mistake below more than 2.3 times as long.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

REPEATS = 5
PERSON = Path(__file__).parents[1] / "examples" / "person.png"
LIGHT = "azimuth=-40,elevation=30"
MISTAKES = (
    ("apply", "gone.jpg", "--preset", "rim", "-o", "out.png"),
    ("apply", str(PERSON), "--preset", "rimm", "-o", "out.png"),
    ("apply", str(PERSON), "--preset", "rim", "-o", "out.xyz"),
    ("apply", str(PERSON), "--light", "azimut=left", "-o", "out.png"),
    ("apply", str(PERSON), "-o", "out.png"),
    ("gui",),
)


def seconds(command):
    """Processor time of a process, user and system."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}  # as installed packages, which are compiled
    subprocess.run(command, check=False, capture_output=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main():
    with tempfile.TemporaryDirectory() as folder:
        apply = ["-m", "relight.cli", "apply", str(PERSON), "-o", f"{folder}/relit.png", "--light", LIGHT]
        commands = {
            "import torch": ["-c", "import torch"],
            "import relight; relight.Subject": ["-c", "import relight; relight.Subject"],
            "relight --help": ["-m", "relight.cli", "--help"],
            "relight apply, the bundled person": apply,
        }
        commands |= {" ".join(("relight", *words)): ["-m", "relight.cli", *words] for words in MISTAKES}
        times = dict.fromkeys(commands, float("inf"))
        for _ in range(REPEATS):  # in turn, so that whatever else the machine does disturbs all of them
            for name, words in commands.items():
                times[name] = min(times[name], seconds([sys.executable, *words]))
    for name, spent in times.items():
        unit = "relight --help" if name.split()[1:] in map(list, MISTAKES) else "import torch"
        print(f"{name}: {spent:.2f} s, {spent / times[unit]:.2f} times {unit}")


if __name__ == "__main__":
    main()
