"""Use a quarter of an hour of a GPU: make records, measure the product, train the field on them.

python benchmarks/gpu/session.py OUT --begin
python benchmarks/gpu/session.py OUT [--limit 560] [--total 760] [--records DIR ...] [--distil 0.5] [--tiny]

`--begin` unpacks what .gpu has (`pack.py` makes it), starts to render records on all cores, and returns at
once. It can be given several times, with another part of .gpu each time: packages.tar.xz and people.tar.xz
first; makehuman.tar.xz, facekit.tar.xz, *.npz (records) and *.glb (scans to render; four parts at most) when
they are there.

Without it, the work is done by a process of its own in --work, which goes on if this command is stopped. The
command starts it where there is none, and follows it: it prints its log and the errors of rendering, and
copies weights in 8 bits, the state in parts of 16 MiB, the log and every exception to OUT as soon as they are
there, each minute. So a stop loses a minute at most. Given again, it follows the same work, or starts it
again after an error; what is done is not done twice.

1. While the first records are rendered, until --records-seconds after the first start, the GPU measures the
   product (`measure.py`, at most 60 s) and trains a throw-away network, which compiles the code and predicts
   the number of steps.
2. Training until --total seconds after the first start. Rendering goes on at a lower priority, and training
   takes in what is added. The records stay on the GPU, where processes make photographs in batches. The
   cosine follows the clock; rate and warm-up follow the predicted steps.

OUT holds at most eight files. `--restore OUT RUN` makes RUN/checkpoint.pt of them, from which `relight train`
goes on.
"""

import argparse
import faulthandler
import hashlib
import io
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tarfile
import time
import traceback
from pathlib import Path

PART_BYTES = 16 * 2**20 - 1024
FOLLOW_SECONDS, PUBLISH_SECONDS = 2.0, 10.0
RESTARTS = 2  # after errors of the worker
HERE = Path(__file__).resolve()
ROOT = HERE.parents[2]
PEAK_STEPS = 2000  # a run of fewer steps has a lower rate
WARM_UP = 0.03  # of the steps
STEPS_A_SECOND = 5.0  # of an H100, in mini-batches of 32 photographs of 512 x 512
WORKERS = 4  # that make photographs on the GPU
PROBE_SECONDS = 120.0  # the compiler took 90 s while 16 processes rendered
POOL = {  # folder: options of `relight stage`, share of the cores
    "face-shapes": ("--heads 140000:149000 --facekit FACEKIT --makehuman MAKEHUMAN --views 3 --head", 0.28),
    "heads": ("--bodies 140000:149000 --views 3 --head --makehuman MAKEHUMAN", 0.08),
    "looks": ("--bodies 160000:169000 --views 3 --jitter --makehuman MAKEHUMAN", 0.08),
    "close": ("--bodies 170000:179000 --views 2 --portrait --makehuman MAKEHUMAN", 0.08),
    "draped": ("--bodies 63000:64000 --simulate --views 8 --jitter --fabrics", 0.2),
    # Each part of the scans starts these again.
    "scans": ("SCANS --views 4 --jitter --no-normal-maps", 0.08),
    "scan-maps": ("SCANS --views 4 --jitter", 0.06),
    "scan-heads": ("SCANS --views 4 --head", 0.08),
    "variants": ("SCANS --variants 910:918 --folds --no-normal-maps --views 1 --jitter", 0.08),
}
SCAN_PARTS = 4  # at most, of one --begin each
TINY = {"bodies": ("--bodies 0:1 --views 2 --jitter", 0.0)}
STAGE = "--size 576 --behind --directions 44"


def small(state):
    """Return a state with its matrices in 8 bits, and other floats in 16: see `whole`."""
    import torch

    if isinstance(state, dict):
        return {key: small(value) for key, value in state.items()}
    if isinstance(state, list):
        return [small(value) for value in state]
    if not isinstance(state, torch.Tensor) or not state.is_floating_point() or state.ndim < 2:
        return state
    rows = state.float().flatten(1)
    scale = rows.abs().amax(dim=1, keepdim=True).clamp_min(1e-12) / 127
    return {"int8": (rows / scale).round().to(torch.int8), "scale": scale, "shape": list(state.shape)}


def whole(state):
    """Return the state of which `small` made this one, to 1/127 of each row's largest value."""
    if isinstance(state, dict) and state.keys() == {"int8", "scale", "shape"}:
        return (state["int8"].float() * state["scale"]).view(state["shape"])
    if isinstance(state, dict):
        return {key: whole(value) for key, value in state.items()}
    return [whole(value) for value in state] if isinstance(state, list) else state


def publish(work: Path, out: Path) -> None:
    """Copy what the worker has written to OUT."""
    out.mkdir(parents=True, exist_ok=True)
    logs = {"worker.log": work, "log.jsonl": work / "run", "report.jsonl": work}
    for name, folder in logs.items():
        if (folder / name).exists():
            data = (folder / name).read_bytes()
            (out / name).write_bytes(data[-PART_BYTES:])
    weights, checkpoint = work / "run/field.safetensors", work / "run/checkpoint.pt"
    if not checkpoint.exists():
        return
    import torch

    from shadow.networks.checkpoints import shrink

    packed = work / "state.pt"
    if packed.exists() and packed.stat().st_mtime >= checkpoint.stat().st_mtime:
        return
    shrink(weights, out / weights.name)
    saved = torch.load(checkpoint, map_location="cpu", weights_only=True)
    network = {key: value.half() for key, value in saved.pop("network").items()}
    saved.pop("average")  # it is in the weights
    torch.save({**saved, "network": network, "optimiser": small(saved["optimiser"])}, packed)
    data = packed.read_bytes()
    data = hashlib.sha256(data).digest() + data
    for number, start in enumerate(range(0, len(data), PART_BYTES)):
        (out / f"state-{number}.part").write_bytes(data[start : start + PART_BYTES])


def restore(out: Path, run: Path) -> None:
    """Make RUN/checkpoint.pt of the published files, for `relight train ... --out RUN`."""
    import torch

    from shadow.networks import checkpoints

    data = b"".join(part.read_bytes() for part in sorted(out.glob("state-*.part")))
    if hashlib.sha256(data[32:]).digest() != data[:32]:
        raise ValueError(f"{out}: the parts of the state are incomplete, or of two times")
    saved = torch.load(io.BytesIO(data[32:]), weights_only=True)
    state, _ = checkpoints.read(out / "field.safetensors")
    run.mkdir(parents=True, exist_ok=True)
    average = {key: value.float() for key, value in state.items()}
    network = {key: value.float() for key, value in saved["network"].items()}
    whole_state = {**saved, "network": network, "optimiser": whole(saved["optimiser"]), "average": average}
    torch.save(whole_state, run / "checkpoint.pt")


def install(packs: Path, work: Path) -> None:
    """Unpack the archives that are there, and copy the code, which the next command may replace here."""
    site = work / "site"
    for package in ("relight", "shadow", "shading", "benchmarks"):
        shutil.copytree(
            ROOT / package, work / "code" / package, dirs_exist_ok=True,
            ignore=shutil.ignore_patterns("__pycache__"),
        )  # fmt: skip
    for pack in sorted(packs.glob("*.tar.xz")):
        if not (done := work / f"{pack.name}.done").exists():
            with tarfile.open(pack) as archive:
                archive.extractall(site, filter="data")
            done.touch()
    for kind, folder in (("glb", "scans"), ("npz", "records/made")):
        (work / folder).mkdir(parents=True, exist_ok=True)
        for file in packs.glob(f"*.{kind}"):
            shutil.copy(file, work / folder)
    model = site / "anny-model.safetensors"
    if not model.exists():
        return
    from safetensors import safe_open
    from safetensors.torch import save_file

    with safe_open(model, framework="pt") as stored:
        about = stored.metadata()
        values = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
    values["blendshapes"] = values["blendshapes"].double().movedim(1, -1).contiguous()
    target = site / "anny-cache" / about.pop("place")
    target.parent.mkdir(parents=True, exist_ok=True)
    save_file(values, target, about)
    model.unlink()


def note(work: Path, **facts) -> None:
    """Add a line to the report at once."""
    with open(work / "report.jsonl", "a") as file:
        file.write(json.dumps(facts) + "\n")
    print(facts, flush=True)


def kinds(tiny: bool) -> dict[str, tuple[str, float]]:
    """Return the options and the share of the cores of each folder of records.

    Kinds that need scans have a folder for each part of the scans.
    """
    found = {}
    for name, given in (TINY if tiny else POOL).items():
        parts = SCAN_PARTS if "SCANS" in given[0] else 1
        found |= {f"{name}-{part}" if parts > 1 else name: given for part in range(parts)}
    return found


def render(work: Path, tiny: bool) -> None:
    """Start the processes that make records, one for each kind that has what it needs and has not begun."""
    begun = work / "scans-begun"
    parts = begun.read_text().splitlines() if begun.exists() else []
    new = sorted(set(map(str, (work / "scans").glob("*.glb"))) - set(" ".join(parts).split()))
    scans = " ".join(f"--scan {path}" for path in new)
    if new:
        begun.write_text("".join(f"{line}\n" for line in [*parts, " ".join(new)]))
    assets = {"MAKEHUMAN": work / "site/makehuman", "FACEKIT": work / "site/facekit"}
    stage = STAGE if not tiny else "--size 96 --behind --directions 44"
    for name, (options, share) in kinds(tiny).items():
        pid, out = work / f"{name}.pid", work / "records" / name
        if "SCANS" in options:
            lacking = not scans or not name.endswith(f"-{len(parts)}")
        else:
            lacking = any(word in options and not folder.exists() for word, folder in assets.items())
        if pid.exists() or lacking:
            continue
        words = options.replace("SCANS", scans)
        for word, folder in assets.items():
            words = words.replace(word, str(folder))
        words = words.split()
        processes = max(1, round(share * (os.cpu_count() or 1)))
        # Training is not to wait for a core.
        command = ["nice", sys.executable, "-m", "relight.cli", "stage", str(out), *words, *stage.split()]
        with open(work / "render.log", "ab") as log:
            renderer = subprocess.Popen(
                [*command, "--processes", str(processes)], stdout=log, stderr=log, stdin=subprocess.DEVNULL,
                start_new_session=True, env=environment(work), cwd=work,
            )  # fmt: skip
        pid.write_text(str(renderer.pid))


def renderers(work: Path) -> list[int]:
    """Return the processes that make records and still run."""
    return [int(pid.read_text()) for pid in work.glob("*.pid") if alive(pid)]


def stop_rendering(work: Path) -> None:
    for process in renderers(work):
        os.killpg(process, signal.SIGKILL)


def work_through(given: argparse.Namespace) -> None:
    """Do what is left of the work; the worker's output is its log."""
    faulthandler.enable()
    work, began = given.work, float((given.work / "began").read_text())
    ends = began + given.total
    found = prepare(work, given, began + given.records_seconds)
    train(work, given, ends, found)
    stop_rendering(work)
    note(work, views_at_the_end=counts(work))
    (work / "done").touch()


def measure(work: Path, given: argparse.Namespace) -> None:
    """Add the times of the product to the report. An error in it must not cost the training."""
    command = [sys.executable, str(HERE.with_name("measure.py")), *(["--tiny"] if given.tiny else [])]
    try:
        measured = subprocess.run(command, timeout=60 if not given.tiny else 600, capture_output=True)
        print(measured.stderr.decode(), flush=True)
        for line in measured.stdout.decode().splitlines():
            note(work, measured=line)
    except subprocess.TimeoutExpired as error:
        note(work, measured=(error.stdout or b"").decode(), stopped="after its time")


def prepare(work: Path, given: argparse.Namespace, until: float) -> dict:
    """Render until a time, and return what a throw-away run found meanwhile; see `probe`."""
    if (work / "probe.json").exists():
        return json.loads((work / "probe.json").read_text())
    render(work, given.tiny)
    pool = work / "records"
    enough = 64 if not given.tiny else 1
    rendering = lambda: time.time() < until and renderers(work)  # noqa: E731
    if given.measure:
        measure(work, given)
    while rendering() and not given.records and len(list(pool.glob("*/*.npz"))) < enough:
        time.sleep(0.5)
    found = probe(work, given, until)
    while rendering():
        time.sleep(0.5)
    note(work, views=counts(work), seconds=given.records_seconds, **found)
    (work / "probe.json").write_text(json.dumps(found))
    return found


def counts(work: Path) -> dict[str, int]:
    """Return the number of records of each kind."""
    folders = sorted((work / "records").glob("*"))
    return {folder.name: len(list(folder.glob("*.npz"))) for folder in folders}


def probe(work: Path, given: argparse.Namespace, until: float) -> dict:
    """Return the mini-batch that fits, whether the network compiles, and the steps a second."""
    import torch

    found = {"batch": given.batch, "compiled": True, "stacked": True, "workers": WORKERS}
    found["steps_a_second"] = STEPS_A_SECOND
    for attempt in range(7):
        seconds = min(PROBE_SECONDS if not given.tiny else 1.0, max(1.0, until - time.time()))
        run = work / f"probe-{attempt}"
        try:
            files = sorted((work / "records").glob("*/*.npz"))
            random.Random(given.seed).shuffle(files)
            recipe = recipe_for(given, found, seconds, 1000)
            fit_field(given, found, recipe, [*given.records, *files][:256], run)
        except torch.OutOfMemoryError:
            traceback.print_exc()
            found["batch"] //= 2
        except Exception:
            traceback.print_exc()
            # What fails is left out: processes that make photographs on the GPU, the compiler, both.
            failing = next((name for name in ("workers", "compiled", "stacked") if found[name]), None)
            if failing is None:
                break
            found[failing] = 0 if failing == "workers" else False
        else:
            rows = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
            # The first line has the time of compilation, so it alone tells nothing.
            if len(rows) > 1:
                steps, seconds = (rows[-1][key] - rows[0][key] for key in ("step", "seconds"))
                found["steps_a_second"] = steps / max(1e-3, seconds)
            return found
    return found


def recipe_for(given: argparse.Namespace, found: dict, seconds: float, steps: float):
    """Return the recipe of a run of so many seconds, of which so many steps are expected."""
    from shadow.training.recipes import preset
    from shadow.training.tasks import SHADOW

    rate = given.rate * min(1.0, steps / PEAK_STEPS) ** 0.5
    sizes = {"size": 512, "batch": found["batch"], "lights": 12}
    if given.tiny:
        sizes = {"size": 128, "batch": 2, "lights": 4}
    return preset(
        "fast", SHADOW, [], duration=seconds / 60, learning_rate=rate, warm_up=max(1, int(WARM_UP * steps)),
        average=0.998, distil=given.distil, seed=given.seed, **sizes,
    )  # fmt: skip


def fit_field(given: argparse.Namespace, found: dict, recipe, paths: list[Path], out: Path) -> None:
    from shadow.training.loop import fit
    from shadow.training.tasks import SHADOW

    compiled = found["compiled"] and ("eager" if given.tiny else True)
    fit(
        SHADOW, recipe, paths, out, init=given.init, visibility=given.init,
        workers=found["workers"] if found["stacked"] else None, checkpoint_minutes=given.minutes,
        stacked=found["stacked"], compiled=compiled,
    )  # fmt: skip


def train(work: Path, given: argparse.Namespace, ends: float, found: dict) -> None:
    """Train until a time. A run that an error stopped goes on with its rate and its end."""
    plan = work / "plan.json"
    if not plan.exists():
        seconds = max(5.0, ends - time.time())
        plan.write_text(json.dumps({"seconds": seconds, "steps": found["steps_a_second"] * seconds}))
    planned = json.loads(plan.read_text())
    recipe = recipe_for(given, found, **planned)
    note(work, plan=planned, learning_rate=recipe.learning_rate, warm_up=recipe.warm_up)
    # All folders of the pool: some kinds may have no record yet.
    folders = [work / "records" / name for name in (*kinds(given.tiny), "made")]
    for folder in folders:
        folder.mkdir(parents=True, exist_ok=True)
    fit_field(given, found, recipe, [*given.records, *folders], work / "run")


def environment(work: Path) -> dict[str, str]:
    """Return the environment of the worker: the packages, and one thread for each process."""
    site = work / "site"
    paths = [str(work / "code"), str(site), os.environ.get("PYTHONPATH", "")]
    # Threads of BLAS and OpenMP in 16 processes each would wait for one another.
    found = {"OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(path for path in paths if path)}
    if (site / "anny-cache").exists():
        found["ANNY_CACHE_DIR"] = str(site / "anny-cache")
    return os.environ | found


def alive(pid: Path) -> bool:
    """Return whether the process runs whose number a file holds."""
    try:
        state = Path(f"/proc/{int(pid.read_text())}/stat").read_text()
    except (OSError, ValueError):
        return False
    return state.rsplit(")", 1)[1].split()[0] != "Z"


def start(work: Path) -> subprocess.Popen:
    """Start the worker in a session of its own, with its output and errors in a file."""
    with open(work / "worker.log", "ab") as log:
        worker = subprocess.Popen(
            [sys.executable, "-u", str(work / "code" / HERE.relative_to(ROOT)), *sys.argv[1:], "--worker"],
            stdout=log, stderr=log, stdin=subprocess.DEVNULL, start_new_session=True, env=environment(work),
        )  # fmt: skip
    (work / "worker").write_text(str(worker.pid))
    return worker


def failures(work: Path) -> set[str]:
    """Return the error lines of the processes that render."""
    log = work / "render.log"
    lines = log.read_text(errors="replace").splitlines() if log.exists() else []
    return {line for line in lines if line.startswith("relight: ") or "Error: " in line}


def follow(given: argparse.Namespace) -> int:
    """Follow the worker for `limit` seconds, and return an exit status: 0 if all is done."""
    until, published, shown, work = time.time() + given.limit, 0.0, 0, given.work
    sys.path[1:1] = [str(work / "code"), str(work / "site")]
    worker, starts = None, 0
    told: set[str] = set()
    while True:
        finished, running = (work / "done").exists(), alive(work / "worker")
        if worker is not None:
            worker.poll()
        failed = not finished and not running and starts > RESTARTS
        if not finished and not running and not failed:
            worker, starts = start(work), starts + 1
        new = failures(work) - told
        for line in sorted(new):
            print(f"rendering: {line}", flush=True)
        told |= new
        text = (work / "worker.log").read_bytes()
        sys.stdout.write(text[shown:].decode(errors="replace"))
        sys.stdout.flush()
        shown, over = len(text), finished or failed or time.time() > until
        if over or time.time() - published > PUBLISH_SECONDS:
            try:
                publish(work, given.out)
            except Exception as error:  # the worker may be writing; the next minute tries again
                print(f"publishing: {error!r}", flush=True)
            published = time.time()
        if failed:
            stop_rendering(work)
        if over:
            return 0 if finished else 1
        time.sleep(FOLLOW_SECONDS if not given.tiny else 0.2)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("run", type=Path, nargs="?", help="with --restore")
    parser.add_argument("--work", type=Path, default=Path("/tmp/relight-gpu"))
    parser.add_argument("--packs", type=Path, default=ROOT / ".gpu")
    parser.add_argument("--limit", type=float, default=560, help="seconds until this command returns")
    parser.add_argument("--total", type=float, default=760, help="seconds from the first start to the end")
    parser.add_argument("--records-seconds", type=float, default=170, help="from the first start")
    parser.add_argument("--records", type=Path, nargs="*", default=[], help="records made before")
    parser.add_argument("--init", type=Path, default=ROOT / "shadow/weights/field.safetensors")
    parser.add_argument("--distil", type=float, default=0.0, help="of `relight train`; --init is the teacher")
    parser.add_argument("--batch", type=int, default=32)
    parser.add_argument("--rate", type=float, default=4e-4, help="highest, of a run of 2,000 steps or more")
    parser.add_argument("--no-measure", action="store_false", dest="measure")
    parser.add_argument("--minutes", type=float, default=1.0, help="between checkpoints")
    parser.add_argument("--seed", type=int, default=223)
    parser.add_argument("--tiny", action="store_true", help="a rehearsal on a CPU")
    parser.add_argument("--begin", action="store_true", help="unpack what .gpu has, and start to render")
    parser.add_argument("--restore", action="store_true")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.restore:
        restore(given.out, given.run)
        return 0
    if given.worker:
        work_through(given)
        return 0
    given.work.mkdir(parents=True, exist_ok=True)
    if not (given.work / "began").exists():
        (given.work / "began").write_text(str(time.time()))
    if given.work / "code" != ROOT:
        install(given.packs, given.work)
    if given.begin:
        render(given.work, given.tiny)
        return 0
    return follow(given)


if __name__ == "__main__":
    sys.exit(main())
