"""Try many hostile inputs. Prints how many are refused, how many are answered, and which break something.

python benchmarks/fuzz.py N [--first SEED] [--kind KIND] [--journal FOLDER]

Inputs and invariants are those of tests/helpers/fuzzing.py. Each input is made from its kind and seed alone,
on one thread. Unless one kind is asked for, the kinds take turns, and one input in 13 goes to the networks;
with --cheap, none goes to them or to a browser. A child process tries the inputs, with no more than 8 GiB of
memory. It writes each one to the journal before and after the try, so that the journal names the seed of a
crash in native code or of a hang: a minute of processor time, or ten minutes on the clock. An interrupted run
is resumed. Several processes can share a range through --first.
"""

import argparse
import collections
import contextlib
import os
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path
from random import Random

import checkout  # noqa: F401 (puts the helpers on the path)
import psutil

CHEAP = (
    *("light text", "lights file", "damaged image", "ICC bytes", "Exif bytes", "container tags") * 2,
    *("damaged mask", "containers", "ONNX model", "kept shapes"),
    *("foreign image", "scene", "analysed shot") * 2,
)
PAGES = 41  # one input in so many is a link, which a browser follows
NETWORKS = 13  # one input in so many goes to the networks
REQUESTS = 20  # one input in so many is a few requests to the app
CRATES = 17  # one input in so many is a USD stage of binary layers
MOVIES = 11  # one input in so many is a movie
HANG = 60  # seconds of processor time without a word: on a busy machine, many on the clock
WAIT = 600  # seconds on the clock without a word, of what waits and does nothing
MEMORY = 8 << 30  # bytes of address space, libraries included
STARTED = "started"


def kind_of(seed, cheap=False):
    """What an input is where the kinds take turns."""
    if seed % PAGES == 1 and not cheap:
        return "page fragment"
    if seed % REQUESTS == 2:
        return "app request"
    if seed % CRATES == 4:
        return "USD crate"
    if seed % MOVIES == 3:
        return "damaged movie"
    return "apply" if seed % NETWORKS == 0 and not cheap else CHEAP[seed % len(CHEAP)]


def attempt(kind, seed, folder):
    """What became of an input: refused, answered, or the bug and where it is, on one line."""
    from helpers.fuzzing import Violation, outcome

    try:
        return outcome(kind, Random(f"relight {seed}"), folder)
    except Violation as violation:
        return f"violation\t{violation!r}"
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        return f"traceback\t{error!r} in {Path(frame.filename).name}:{frame.lineno}"


def child(inputs, journal):
    """Try the inputs, (kind, seed) each, in turn, each noted before and after."""
    import resource

    import torch

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    torch.set_num_threads(1)
    memory = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with (
        tempfile.TemporaryDirectory(dir=memory) as folder,
        journal.open("a", buffering=1, errors="backslashreplace") as notes,
    ):
        for kind, seed in inputs:
            notes.write(f"{kind}\t{seed}\t{STARTED}\n")
            found = " ".join(attempt(kind, seed, Path(folder)).splitlines())
            notes.write(f"{kind}\t{seed}\t{found}\n")


def entries(journal):
    """{(kind, seed): what became of it} as the journal says; STARTED where a child ended meanwhile."""
    found = {}
    if journal.exists():
        for line in journal.read_text(errors="replace").splitlines():
            kind, seed, what = line.split("\t", 2)
            found[kind, int(seed)] = what
    return found


def left(inputs, journal):
    """Those that are not done yet."""
    done = entries(journal)
    return [each for each in inputs if done.get(each, STARTED) == STARTED]


def watch(inputs, journal):
    """Children, one after another, until all inputs are done."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    while left(inputs, journal):
        journal.touch()  # or the silence since an earlier run would be taken for a hang
        process = subprocess.Popen([sys.executable, *sys.argv, "--child", str(journal)], env=environment)
        why = f"crash\texit status {_wait(process, journal)}"
        if process.returncode:
            stopped = [each for each, what in entries(journal).items() if what == STARTED]
            if not stopped:
                raise SystemExit(f"no input was tried: {why}")
            with journal.open("a") as notes:
                notes.writelines(f"{kind}\t{seed}\t{why}\n" for kind, seed in stopped)


def _wait(process, journal):
    """The exit status of a child, or "hang": it is killed when the journal stands still."""
    written = spent = None
    while True:
        try:
            return process.wait(timeout=5)
        except subprocess.TimeoutExpired:
            if written != (written := journal.stat().st_mtime):
                spent = _processor_time(process.pid)
            if _processor_time(process.pid) - spent > HANG or time.time() - written > WAIT:
                process.kill()
                process.wait()
                return "hang"


def _processor_time(pid):
    """The seconds for which a process and its children have computed."""
    total = 0
    with contextlib.suppress(psutil.NoSuchProcess):  # one that has just ended
        parent = psutil.Process(pid)
        total = parent.cpu_times().children_user + parent.cpu_times().children_system
        for each in (parent, *parent.children(recursive=True)):
            times = each.cpu_times()
            total += times.user + times.system
    return total


def report(found):
    """The figures, by kind, and each bug by its seed."""
    counts = collections.defaultdict(collections.Counter)
    for (kind, _), what in found.items():
        counts[kind][what.split("\t")[0]] += 1
    columns = ("refused", "answered", "traceback", "violation", "crash")
    print("| kind | inputs |", " | ".join(columns), "|")
    print("|---|---|" + "---|" * len(columns))
    for kind, row in sorted(counts.items()):
        print(f"| {kind} | {row.total()} |", " | ".join(str(row[column]) for column in columns), "|")
    total = sum(counts.values(), collections.Counter())
    print(f"| all | {total.total()} |", " | ".join(str(total[column]) for column in columns), "|")
    print(f"NaN or infinite pictures: {sum('NaN' in what for what in found.values())}")
    for (kind, seed), what in sorted(found.items()):
        if what not in ("refused", "answered", STARTED):
            print(kind, seed, what, sep="\t")


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("count", type=int, metavar="N")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kind", help="this kind alone")
    parser.add_argument("--cheap", action="store_true", help="neither networks nor a browser")
    parser.add_argument("--journal", type=Path, default=Path("fuzz"))
    parser.add_argument("--report", action="store_true", help="print what the journals say and try nothing")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.count)
    inputs = [(given.kind or kind_of(seed, given.cheap), seed) for seed in seeds]
    if given.child:
        return child(left(inputs, given.child), given.child)
    given.journal.mkdir(parents=True, exist_ok=True)
    if not given.report:
        name = f"{given.kind or 'all'}-{seeds.start}-{seeds.stop}.tsv".replace(" ", "-")
        watch(inputs, given.journal / name)
    found = {}
    for journal in sorted(given.journal.glob("*.tsv")):
        found |= entries(journal)
    report(found)


if __name__ == "__main__":
    main()
