"""Train the networks of the paper's Tables 3, 4 and 6 alike, from scratch, and score them beside our own.

python benchmarks/paper_tables.py OUT --records FOLDER ... --test FOLDER ... --shaded FOLDER ...
    --shaded-test FOLDER ... [--photographs 1000] [--size 128] [--limit 40] [--only NAME ...]

All networks see the same photographs and lights in the same order, with Adam (Section 3) and one cosine. The
paper's networks take the normals of the shipped field, in training (except "mixed", which learns from true
normals) and in the test; those of shading take its visibility too. "Ours" is a field that is trained in the
same way, and "one pass" a shading field.

--shaded and --shaded-test are records with bounce light, made with `relight stage --shading`. The size is a
multiple of 128, since the paper's network has five strides on a canvas of 4:3.

An interrupted run is resumed. With --only, these networks are trained and nothing is scored, so that several
processes can share the work. OUT/report.md is the report that `relight evaluate tables` writes, with the
sha256 of each network. OUT/shading.md is Table 6. The figures are in docs/paper.md.
"""

import argparse
from pathlib import Path

from shading import evaluation
from shading.tasks import SHADING as ONE_PASS
from shading.tasks import per_light_task
from shadow.evaluation import report
from shadow.files import replacing
from shadow.networks.checkpoints import sha256
from shadow.training.loop import TRUE_NORMALS, fit
from shadow.training.recipes import Recipe
from shadow.training.tasks import SHADOW, per_light

VISIBILITY = {  # rows of Tables 3 and 4
    "ours": SHADOW,
    "resb3": per_light("resb3"),
    "resb7": per_light("resb7"),
    "resb11": per_light("resb11"),
    "attention": per_light("attention"),
    "without-normals": per_light("resb7", with_normals=False),
    "mixed": per_light("resb7"),
}
FOLDERS = {  # of the rows of Table 6
    row: "shading-" + row.replace("/", "").replace(" ", "-") for row in (*evaluation.ROWS, "one pass")
}
SHADING = {FOLDERS[row]: per_light_task("resb7", *inputs) for row, (inputs, *_) in evaluation.ROWS.items()}
SHADING[FOLDERS["one pass"]] = ONE_PASS
BATCH, LIGHTS = 4, 4  # photographs in a mini-batch, lights for each photograph


def train(name: str, given: argparse.Namespace) -> Path:
    """Train a network of VISIBILITY or SHADING, or continue its training, and return its weights."""
    recipe = Recipe(
        steps=given.photographs // BATCH, size=given.size, batch=BATCH, lights=LIGHTS, learning_rate=3e-4,
        warm_up=given.photographs // BATCH // 10, optimiser="adam", betas=(0.9, 0.999), weight_decay=0,
        average=0.99, seed=5,
    )  # fmt: skip
    if name in SHADING:
        return fit(SHADING[name], recipe, given.shaded, given.out / name, estimator="field", workers=1)
    normals = {"ours": None, "without-normals": None, "mixed": TRUE_NORMALS}.get(name, "field")
    return fit(VISIBILITY[name], recipe, given.records, given.out / name, estimator=normals, workers=1)


def checksums(weights: dict[str, Path], photographs: int) -> str:
    """Return a section of Markdown that lists the networks."""
    lines = [f"- {name}: {sha256(file)}" for name, file in weights.items()]
    return "\n".join(["", "## Networks", "", f"{photographs} photographs each. sha256:", "", *lines, ""])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--records", type=Path, action="append", required=True, help="to train on")
    parser.add_argument("--test", type=Path, action="append", required=True, help="to score on")
    parser.add_argument("--shaded", type=Path, action="append", required=True, help="to train shading on")
    parser.add_argument("--shaded-test", type=Path, action="append", required=True, help="to score it on")
    parser.add_argument("--photographs", type=int, default=1000)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--limit", type=int, default=40, help="views to score")
    parser.add_argument("--only", action="append", choices=[*VISIBILITY, *SHADING])
    given = parser.parse_args()
    weights = {name: train(name, given) for name in given.only or [*VISIBILITY, *SHADING]}
    if given.only:
        return
    visibility = {name: weights[name] for name in VISIBILITY}
    path = report.write(given.test, given.out, models=visibility, normals_model="field", limit=given.limit)
    with replacing(path) as beside:
        beside.write_text(path.read_text() + checksums(visibility, given.photographs))
    shading = {row: weights[folder] for row, folder in FOLDERS.items()}
    scores = evaluation.evaluate(given.shaded_test, models=shading, limit=given.limit)
    views = f"At most {given.limit} views of {', '.join(map(str, given.shaded_test))}."
    text = f"# Table 6\n\n{views}\n\n{evaluation.report(*scores)}\n{checksums(shading, given.photographs)}"
    with replacing(given.out / "shading.md") as beside:
        beside.write_text(text)


if __name__ == "__main__":
    main()
