"""Mix the weights of a training run with those that it began with, and score each mix. Prints a table.

python benchmarks/mixes.py OUT --run RUN.safetensors --validation NAME=FOLDER ... [--init INIT.safetensors]
    [--share 0.35 ...] [--depth]

Each parameter of a mix is share × run + (1 - share) × init. Means of weights that were trained from one
start can be more accurate than each of them ("Model soups", Wortsman et al. 2022). OUT/mix-35.safetensors is
35 % of the run and 65 % of the initial weights, in 8 bits. The depth output of a run from weights without
depth is left out, unless --depth is given: it is then the run's own.

A mix is worth shipping where it scores better than the initial weights on every list; figures of earlier runs
are in docs/history.md.
"""

import argparse
import json
from pathlib import Path

from ablations import scored

from shadow.networks import checkpoints
from shadow.networks.field import VisibilityField


def mix(run: Path, init: Path, share: float, depth: bool, out: Path) -> Path:
    """Write the mix in 8 bits to the folder `out`, and return its path."""
    (ours, about), (theirs, _) = map(checkpoints.read, (run, init))
    config, recipe = (json.loads(about[key]) for key in ("config", "recipe"))
    config["depth"], recipe["mixed"] = depth, {"init": round(1 - share, 4)}
    network = VisibilityField(**config)
    state = {}
    for key, own in network.state_dict().items():
        trained, start = ours[key].float()[: len(own)], theirs[key].float()
        state[key] = trained.clone()  # outputs that the initial weights lack stay those of the run
        state[key][: len(start)] = trained[: len(start)].lerp(start, 1 - share)
    network.load_state_dict(state)
    small = out / f"mix-{100 * share:.0f}.safetensors"
    whole = small.with_suffix(".float.safetensors")
    checkpoints.save(whole, network, "field", config, recipe)
    checkpoints.shrink(whole, small)
    return small


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("--init", type=Path, default=Path("shadow/weights/field.safetensors"))
    parser.add_argument("--validation", action="append", required=True, metavar="NAME=FOLDER")
    parser.add_argument("--share", type=float, nargs="+", default=[0.2, 0.35, 0.6, 1.0])
    parser.add_argument("--depth", action="store_true")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    lists = dict(text.split("=", 1) for text in given.validation)
    weights = {"init": given.init}
    weights |= {
        f"{share:.0%}": mix(given.run, given.init, share, given.depth, given.out) for share in given.share
    }
    for name, path in weights.items():
        for label, folder in lists.items():
            row = " | ".join(
                f"{key} {value:.5g}" if key != "angle" else f"{value:.3f}°"
                for key, value in scored(path, Path(folder)).items()
            )
            print(f"| {name} | {label} | {row} |", flush=True)


if __name__ == "__main__":
    main()
