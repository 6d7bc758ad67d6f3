"""Compare choices of training: train the field from the same weights for the same time, and change one choice
in each run. Prints the scores of each run on each validation set.

python benchmarks/ablations.py OUT --records FOLDER ... --validation NAME=FOLDER ... [--photographs 4000]
    [--only NAME ...] [--processes 2]

A run on the canvas of 384 rows sees `--photographs` photographs. A run whose photographs cost more sees
fewer, so that all runs take the same time. The learning rate of each run falls as one cosine. An interrupted
run is resumed. The averaged weights are scored, with one photograph of each validation record. Scores that
exist already are only printed.

A choice is worth making where its run scores better than the unchanged one on every set; figures of
earlier choices are in docs/history.md.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

from shadow.data.records import Records
from shadow.evaluation import regions, scores

BATCH = 4  # photographs a mini-batch, of each process
# What a run changes: the options of `relight train`, and the time of a photograph over that of the first.
CHOICES: dict[str, tuple[list[str], float]] = {
    "as it is": ([], 1.0),
    "without depth": (["--no-depth"], 1.0),
    "angle of the normals": (["--angles", "1"], 1.0),
    "borders four times": (["--borders", "4"], 1.0),
    "faces and hands four times": (["--faces", "4"], 1.0),
    "half the rate": (["--learning-rate", "3.5e-4"], 1.0),
    "shorter average": (["--average", "0.99"], 1.0),
    "canvas of 512": (["--size", "512"], 1.8),
    "twice the blocks below a quarter": (["--blocks", "1,1,4,8,12"], 1.5),
}


def train(name: str, given: argparse.Namespace) -> Path:
    """The averaged weights of a choice's run."""
    options, cost = CHOICES[name]
    out = given.out / name.replace(" ", "-")
    defaults = {"--size": "384", "--learning-rate": "7e-4", "--average": "0.995"}
    for key, value in defaults.items():
        if key not in options:
            options = [*options, key, value]
    steps = round(given.photographs / cost / BATCH / given.processes)
    for folder in given.records:
        options = [*options, "--records", str(folder)]
    launcher = ["-m", "torch.distributed.run", "--nproc-per-node", str(given.processes)]
    options = [*options, "--out", str(out), "--init", str(given.init), "--batch", str(BATCH)]
    options = [*options, "--steps", str(steps), "--seed", "11"]
    program = [sys.executable, *(launcher if given.processes > 1 else []), "-m", "relight.cli"]
    subprocess.run([*program, "train", "shadow", *options], check=True)
    return out / "field.safetensors"


def scored(weights: Path, folder: Path) -> dict[str, float]:
    """Normals' angle, RMSE and Dice on a folder of records, and the angle on faces and hands if it says."""
    found, angle = scores.evaluate([folder], model=weights)
    row = {"angle": angle, "rmse": found["field"].rmse[0], "dice": found["field"].dice[0]}
    if Records([folder])[0].regions is None:
        return row
    parts = regions.evaluate([folder], model=weights)
    return row | {part: score.angle for part, score in parts.items() if part != regions.WHOLE}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--records", type=Path, action="append", required=True)
    parser.add_argument("--validation", action="append", required=True, metavar="NAME=FOLDER")
    parser.add_argument("--init", type=Path, default=Path("shadow/weights/field.safetensors"))
    parser.add_argument("--photographs", type=int, default=4000)
    parser.add_argument("--only", action="append", choices=CHOICES)
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    lists = dict(text.split("=", 1) for text in given.validation)
    for name in ("before", *(given.only or CHOICES)):
        weights = given.init if name == "before" else train(name, given)
        journal = given.out / f"{name.replace(' ', '-')}.json"
        if not journal.exists():
            journal.parent.mkdir(parents=True, exist_ok=True)
            journal.write_text(
                json.dumps({label: scored(weights, Path(path)) for label, path in lists.items()})
            )
        for label, row in json.loads(journal.read_text()).items():
            print(
                f"| {name} | {label} | "
                + " | ".join(f"{key} {value:.4f}" for key, value in row.items())
                + " |"
            )


if __name__ == "__main__":
    main()
