"""Train the networks of the paper's Tables 3 and 4 alike, from scratch, and score them beside our field.

python benchmarks/paper_tables.py OUT --records FOLDER ... --test FOLDER ... [--photographs 2000] [--size 128]
    [--limit 40] [--only NAME ...]

All networks see the same photographs and lights in the same order, with Adam (Section 3) and one cosine. The
paper's networks take the normals of the shipped field, in training (except "mixed", which learns from true
normals) and in the test. "Ours" is a field that is trained in the same way.

An interrupted run is resumed. With --only, these networks are trained and nothing is scored, so that several
processes can share the work. The report is OUT/report.md, as `relight evaluate tables` writes it, with the
sha256 of each network. The figures are in docs/paper.md.
"""

import argparse
from pathlib import Path

from shadow.evaluation import report
from shadow.networks.checkpoints import sha256
from shadow.training.loop import TRUE_NORMALS, fit
from shadow.training.recipes import Recipe
from shadow.training.tasks import SHADOW, per_light

TASKS = {
    "ours": SHADOW,
    "resb3": per_light("resb3"),
    "resb7": per_light("resb7"),
    "resb11": per_light("resb11"),
    "attention": per_light("attention"),
    "without-normals": per_light("resb7", with_normals=False),
    "mixed": per_light("resb7"),
}
BATCH, LIGHTS = 8, 4  # photographs in a mini-batch, lights for each photograph


def train(name: str, given: argparse.Namespace) -> Path:
    """Train one of TASKS, or continue its training, and return its weights."""
    recipe = Recipe(
        steps=given.photographs // BATCH, size=given.size, batch=BATCH, lights=LIGHTS, learning_rate=3e-4,
        warm_up=given.photographs // BATCH // 10, optimiser="adam", betas=(0.9, 0.999), weight_decay=0,
        average=0.99, seed=5,
    )  # fmt: skip
    normals = {"ours": None, "without-normals": None, "mixed": TRUE_NORMALS}.get(name, "field")
    return fit(TASKS[name], recipe, given.records, given.out / name, estimator=normals, workers=1)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--records", type=Path, action="append", required=True, help="to train on")
    parser.add_argument("--test", type=Path, action="append", required=True, help="to score on")
    parser.add_argument("--photographs", type=int, default=2000)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--limit", type=int, default=40, help="views to score")
    parser.add_argument("--only", action="append", choices=TASKS)
    given = parser.parse_args()
    weights = {name: train(name, given) for name in given.only or TASKS}
    if given.only:
        return
    path = report.write(given.test, given.out, models=weights, normals_model="field", limit=given.limit)
    sums = "\n".join(f"- {name}: {sha256(file)}" for name, file in weights.items())
    text = path.read_text() + f"\n## Networks\n\n{given.photographs} photographs each. sha256:\n\n{sums}\n"
    path.write_text(text)


if __name__ == "__main__":
    main()
