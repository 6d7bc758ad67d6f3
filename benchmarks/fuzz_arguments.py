"""Call all public functions with one wrong argument. Prints the refusals that no user can act on.

python benchmarks/fuzz_arguments.py [N] [--first SEED]

A call is right if it is answered, or refused by TypeError, ValueError or OSError in one line that names the
argument.
"""

import argparse
import collections
import contextlib
import tempfile
from pathlib import Path
from random import Random

import checkout  # noqa: F401 (puts the helpers on the path)
import torch
from helpers.argument_fuzz import Calls

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("count", type=int, nargs="?", default=2000)
parser.add_argument("--first", type=int, default=0)
arguments = parser.parse_args()
torch.set_num_threads(1)
# A call that is answered may write a file where it is made.
with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
    calls = Calls(Path(folder))
    wrong = collections.Counter()
    for seed in range(arguments.first, arguments.first + arguments.count):
        if problem := calls.attempt(Random(seed)):
            wrong[problem] += 1
for problem, times in wrong.most_common():
    print(f"{times} x {problem}")
print(f"{wrong.total()} of {arguments.count} calls are wrong")
