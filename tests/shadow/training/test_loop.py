import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from helpers.sphere import sphere
from torch.utils.data import default_collate

pytest.importorskip("kornia")

import shadow
from shading import diffuse
from shading.tasks import SHADING, per_light_task
from shadow import normals, visibility
from shadow.data import photographs, records
from shadow.directions import from_spherical
from shadow.evaluation import depth
from shadow.networks import checkpoints
from shadow.networks.backbone import Backbone, encode_image, take_blocks
from shadow.networks.field import VisibilityField
from shadow.networks.precision import using
from shadow.networks.unet import PerLight
from shadow.training import loop, optimiser, tasks
from shadow.training.loop import fit
from shadow.training.recipes import Recipe, learning_rate, preset
from shadow.training.start import load_start
from shadow.training.tasks import SHADOW, per_light

NARROW = {"widths": (8,) * 5, "encoder": (1,) * 5, "decoder": (1,) * 4}
TINY = {"depth": True, **NARROW}
SMALL = replace(SHADOW, config=TINY)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("records")
    for number in range(4):
        records.write(path / f"{number}.npz", sphere(radius=0.6 + 0.1 * number))
    return path


@pytest.fixture(autouse=True)
def one_thread():
    """Networks as small as these gain nothing from a second thread, and lose much where cores are shared."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def run(task, folder, out, steps, distil=0.0, **options):
    torch.manual_seed(0)
    recipe = Recipe(steps=steps, size=128, batch=2, learning_rate=3e-3, warm_up=2, distil=distil)
    return fit(task, recipe, [folder], out, workers=0, **options)


def test_learning_rate_warms_up_and_falls_to_zero():
    recipe = Recipe(steps=1000, warm_up=100, learning_rate=1)
    rates = np.array([learning_rate(recipe, step) for step in range(1001)])
    assert rates[0] == pytest.approx(0.01)
    assert rates.argmax() == pytest.approx(99, abs=2)
    assert rates[-1] == pytest.approx(0, abs=1e-9)


def test_distillation_learns_the_mean_of_two_passes(folder, tmp_path):
    """A teacher that prefers one side: its mean of a photograph and the mirror image does not."""
    torch.manual_seed(0)
    biased = VisibilityField(size=128, **TINY)
    with torch.no_grad():
        biased.backbone.head.bias[:4] = 0.6  # of the normals' first component, at the four pixels of a block
        biased.backbone.head.bias[-8:-4] = 0.5  # of the sharpness
    teacher = tmp_path / "teacher.safetensors"
    checkpoints.save(teacher, biased, "field", {"size": 128, **TINY}, {})
    batch = default_collate(
        [photographs.sample(sphere(), np.random.default_rng(i), (128, 96), 20) for i in range(2)]
    )
    cpu, recipe = torch.device("cpu"), Recipe(steps=1, size=128, distil=1.0)
    auxiliary = loop.auxiliary_networks(SHADOW, recipe, None, teacher, cpu)
    prepared = loop.prepare(batch, cpu, auxiliary, recipe)
    mean = VisibilityField(size=128, **TINY)  # faces the camera, as the mean does
    with torch.no_grad():
        mean.backbone.head.bias[-8:-4] = 0.5
    assert SHADOW.loss(mean, prepared) < SHADOW.loss(biased, prepared) - 0.4
    path = run(
        replace(SHADOW, config=TINY), folder, tmp_path / "run", steps=1, visibility=teacher, distil=0.5
    )
    recipe = checkpoints.load(path, {"field": VisibilityField}, package="shadow").origin.recipe
    assert (recipe["distil"], recipe["visibility"]) == (0.5, "teacher")


def test_a_stacked_and_compiled_run_learns_what_a_plain_one_does(tmp_path, monkeypatch):
    """The pictures are made in batches, and the network's forward is one graph."""
    still = lambda _rng, shape=None: None if shape is None else lambda rgb, mask: (rgb, mask)  # noqa: E731
    monkeypatch.setattr(photographs.Flaws, "draw", still)
    pool = tmp_path / "pool"
    pool.mkdir()
    for number in range(4):
        records.write(pool / f"{number}.npz", sphere(radius=0.6 + 0.1 * number))
    losses = []
    for options in ({}, {"stacked": True, "compiled": "eager"}):
        out = tmp_path / f"run-{len(options)}"
        run(replace(SHADOW, config=TINY), pool, out, steps=2, **options)
        losses.append(json.loads((out / "log.jsonl").read_text().splitlines()[-1])["loss"])
    assert losses[1] == pytest.approx(losses[0], abs=2e-3)
    assert not torch._dynamo.utils.counters["graph_break"]


@pytest.fixture
def clock(monkeypatch):
    """Lets every look at the clock take so many seconds."""

    def advance(seconds):
        times = itertools.count(step=seconds)
        monkeypatch.setattr(loop.time, "monotonic", lambda: next(times))

    return advance


def test_a_run_with_a_duration_follows_the_clock(folder, tmp_path, clock, monkeypatch):
    clock(10.0)
    rates = []
    step = optimiser.Optimiser.step
    monkeypatch.setattr(
        optimiser.Optimiser, "step", lambda self, rate: rates.append(rate) or step(self, rate)
    )
    recipe = preset("fast", SHADOW, [], duration=1.0, size=128, batch=1, learning_rate=1e-3, warm_up=0)
    fit(replace(SHADOW, config=TINY), recipe, [folder], tmp_path, workers=0)
    assert rates[0] == 1e-3
    assert rates == sorted(rates, reverse=True)
    assert 2 <= len(rates) <= 6  # the clock advances 10 s at each look, several times a step
    saved = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    assert (saved["step"], saved["seconds"] >= 60) == (len(rates), True)


@pytest.mark.parametrize("photographs", [1, 2, 4, 8])
def test_a_mini_batch_is_its_photographs_however_many_are_taken_at_a_time(photographs, monkeypatch):
    """Five of them, so that one is left over; of the same width are taken together."""
    monkeypatch.setattr(loop, "CPU_BATCH", photographs)
    widths, seen = [9, 3, 7, 3, 5], []
    columns = torch.arange(16)
    matte = torch.stack([(columns < width).float().expand(1, 16, 16) for width in widths])
    torch.manual_seed(0)
    batch = {"rgb": torch.rand(5, 3, 16, 16) * matte, "matte": matte, "mask": matte}
    network = torch.nn.Conv2d(4, 1, 3)

    def loss(network, part):
        seen.append(part["matte"].amax(dim=(1, 2)).sum(dim=1).tolist())
        return network(part["image"]).square().mean()

    task, recipe = replace(SHADOW, loss=loss), Recipe(steps=1, batch=5, bfloat16=False)
    cpu = torch.device("cpu")
    total = loop.gradient(task, network, batch, recipe, cpu, loop.Auxiliary(None, None))
    assert seen == [sorted(widths)[start : start + photographs] for start in range(0, 5, photographs)]
    whole = network(encode_image(batch["rgb"], matte)).square().mean()
    torch.testing.assert_close(total, whole.detach())
    (expected,) = torch.autograd.grad(whole, [network.weight])
    torch.testing.assert_close(network.weight.grad, expected)


@pytest.mark.slow
def test_normals_and_depth_of_a_sphere_are_learned_where_records_have_it(folder, tmp_path):
    """By the field as wide as it is shipped: one of few channels learns no depth in so few steps."""
    path = run(SHADOW, folder, tmp_path / "with", 20, validation=[folder])
    rows = [json.loads(line) for line in (tmp_path / "with" / "log.jsonl").read_text().splitlines()]
    assert rows[-1]["images"] == 40
    untrained = 45  # degrees: a visible hemisphere against normals that all face the camera is 45 on average
    assert rows[-1]["angle"] < untrained
    assert (tmp_path / "with" / "samples-000020.png").stat().st_size > 0
    assert normals.load(path).size == 128
    found = depth.evaluate([folder], model=path)
    assert found.views == 4
    assert rows[-1]["depth"] < 0.9 * found.flat
    assert found.error == pytest.approx(rows[-1]["depth"], rel=0.1)
    (tmp_path / "old").mkdir()
    for file in folder.iterdir():
        records.write(tmp_path / "old" / file.name, replace(records.Records([file])[0], depth_float16=None))
    path = run(SMALL, tmp_path / "old", tmp_path / "without", 2, validation=[folder])
    head = checkpoints.read(path)[0]["backbone.head.weight"]
    assert not head[-4:].any()
    assert head[:-4].any()
    with pytest.raises(ValueError, match="records: expected some with depth"):
        depth.evaluate([tmp_path / "old"], model=path)


def test_the_loss_of_depth_falls_and_sees_neither_offset_nor_scale(folder):
    sample = photographs.sample(records.Records([folder])[0], np.random.default_rng(0), (128, 96), 1)
    blocks = tasks.random_blocks(sample["mask"][None])
    truth, mask = (take_blocks(sample[key][None], blocks) for key in ("depth", "mask"))
    inside = mask > 0.5
    error = lambda estimate: float(tasks.depth_error(estimate, truth, inside, 128))  # noqa: E731
    noise = 0.05 * torch.randn(truth.shape, generator=torch.Generator().manual_seed(0))
    assert error(truth) < error(1.5 * truth) < 0.2 * error(0 * truth)
    assert error(truth + 3) == pytest.approx(error(truth), abs=1e-5)
    assert error(truth + noise) > error(truth) + 0.02
    shifted = 2 * (truth + noise) + 1
    assert error(shifted) == pytest.approx(error(truth + noise), rel=0.25)
    estimate = torch.zeros_like(truth, requires_grad=True)
    losses = []
    for _ in range(40):
        loss = tasks.depth_error(estimate, truth, inside, 128)
        losses.append(loss.item())
        (gradient,) = torch.autograd.grad(loss, estimate)
        estimate = (estimate - 20 * gradient).detach().requires_grad_()
    assert np.isfinite(losses).all()
    assert losses[-1] < 0.7 * losses[0]


def test_a_photograph_that_shows_nothing_teaches_nothing(folder):
    """A random cut may miss the subject; the run goes on."""
    sample = photographs.sample(records.Records([folder])[0], np.random.default_rng(0), (128, 96), 4)
    empty = torch.zeros_like(sample["mask"])
    sample |= {"rgb": photographs.photograph(sample["rgb"], empty, np.random.default_rng(0)), "mask": empty}
    batch = {key: value[None] for key, value in sample.items()}
    batch["image"] = encode_image(batch["rgb"], batch["mask"])
    batch |= {"attention": batch["mask"], "angles": 0.0}
    network = VisibilityField(size=128)
    loss = SHADOW.loss(network, batch)
    loss.backward()
    assert loss.item() == 0
    assert all(not parameter.grad.any() for parameter in network.parameters())


def test_blocks_of_the_empty_canvas_are_zero_as_in_the_whole_maps():
    """Where an attention map is empty, blocks are drawn anywhere; the window holds few of them."""
    torch.manual_seed(0)
    network = Backbone(4, 3, widths=(8, 8, 8, 8, 8))
    torch.nn.init.normal_(network.head.weight)
    torch.nn.init.normal_(network.head.bias)
    image = torch.zeros(2, 4, 256, 192)
    image[:1, :, 130:150, 90:100] = 1  # the other photograph shows nothing
    blocks = torch.arange(128 * 96).expand(2, -1)
    with torch.no_grad():
        found, whole = network(image, blocks), network(image)
    torch.testing.assert_close(found, take_blocks(whole, blocks), rtol=1e-4, atol=1e-4)
    assert found.any()


def test_checkpoints_follow_the_clock_and_not_the_log(folder, tmp_path, clock, monkeypatch):
    """Steps of two minutes each: of five, the third and the last are due."""
    clock(120.0)
    saved = []
    monkeypatch.setattr(loop.State, "save", lambda state, facts: saved.append(state.step))
    monkeypatch.setattr(loop, "gradient", lambda *given: torch.zeros(()))
    monkeypatch.setattr(loop.State, "update", lambda state: setattr(state, "step", state.step + 1))
    run(SHADOW, folder, tmp_path, 5, checkpoint_minutes=5)
    assert saved == [3, 5]
    rows = [json.loads(line)["step"] for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert rows == saved


@pytest.mark.slow
def test_an_interrupted_run_ends_where_an_uninterrupted_one_does(folder, tmp_path):
    whole = run(SMALL, folder, tmp_path / "whole", 4)
    recipe = Recipe(steps=4, size=128, batch=2, learning_rate=3e-3, warm_up=2)

    class Interrupt(Exception):
        pass

    calls = 0

    def interrupted(network, batch):
        nonlocal calls
        calls += 1
        if calls == 4:
            raise Interrupt
        return SHADOW.loss(network, batch)

    with pytest.raises(Interrupt):
        fit(replace(SMALL, loss=interrupted), recipe, [folder], tmp_path / "cut", workers=0,
            checkpoint_minutes=0)  # fmt: skip
    resumed = fit(SMALL, recipe, [folder], tmp_path / "cut", workers=0)
    for (key, a), b in zip(
        checkpoints.read(whole)[0].items(), checkpoints.read(resumed)[0].values(), strict=True
    ):
        torch.testing.assert_close(a, b, msg=key)


@pytest.mark.slow
def test_a_field_may_take_other_normals_in_its_gate_and_records_them(folder, tmp_path):
    first = run(SMALL, folder, tmp_path / "first", 2)
    assert isinstance(visibility.load(first), VisibilityField)
    assert "normals" not in json.loads(checkpoints.read(first)[1]["recipe"])
    other, turned = first.rename(tmp_path / "other.safetensors"), tmp_path / "turned.safetensors"
    upward = visibility.load(other).float()
    with torch.no_grad():
        upward.backbone.head.bias[4:8] = 0.6  # of the normals' y, at the four pixels of a block
    checkpoints.save(turned, upward, "field", {"size": 128, **TINY}, {})
    path = run(SMALL, folder, tmp_path / "field", 2, init=other, estimator=str(turned), validation=[folder])
    recipe = json.loads(checkpoints.read(path)[1]["recipe"])
    assert recipe["init"] == "other"
    assert recipe["normals"] == "turned"
    assert recipe["normals_sha256"] == checkpoints.sha256(turned)
    row = json.loads((tmp_path / "field" / "log.jsonl").read_text())
    given, own = (_angle(weights, folder, tmp_path / weights.stem) for weights in (turned, path))
    assert row["angle"] == pytest.approx(given, abs=0.05)
    assert abs(own - given) > 1


def _angle(path, folder, out):
    """The validation angle of a field's own normals."""
    still = replace(SMALL, loss=lambda network, batch: 0 * SHADOW.loss(network, batch))
    run(still, folder, out / "still", 1, init=path, validation=[folder])
    return json.loads((out / "still" / "log.jsonl").read_text())["angle"]


def few_channels(task):
    """A per-light task with a U-Net of few channels."""
    return replace(task, config={**task.config, "widths": [8, 8, 16, 16, 32]})


@pytest.mark.parametrize(
    ("task", "kind"),
    [
        (SHADING, diffuse.ShadingField),
        pytest.param(few_channels(per_light_task("resb3")), diffuse.PerLightShading, marks=pytest.mark.slow),
        pytest.param(
            few_channels(per_light_task("resb3", normals=False, visibility=None)),
            diffuse.PerLightShading,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_shading_networks_are_trained_on_a_field_and_record_it(folder, tmp_path, task, kind):
    field = run(replace(SHADOW, config=TINY), folder, tmp_path / "field", 1)
    options = {"visibility": str(field), "validation": [folder]}
    if kind is diffuse.ShadingField:
        task = replace(task, config=task.config | NARROW)
    recipe = Recipe(steps=2, size=128, batch=2, lights=3, warm_up=2)
    path = fit(task, recipe, [folder], tmp_path / "shading", workers=0, **options)
    network = diffuse.load(path)
    assert isinstance(network, kind)
    assert json.loads(checkpoints.read(path)[1]["recipe"])["visibility"] == "field"
    assert getattr(network, "visibility", "inferred") == task.config.get("visibility", "inferred")
    row = json.loads((tmp_path / "shading" / "log.jsonl").read_text().splitlines()[-1])
    assert 0 < row["rmse"] < 1
    assert (tmp_path / "shading" / "samples-000002.png").exists()


def test_warm_start_keeps_the_features(tmp_path):
    torch.manual_seed(0)
    config = {"size": 128}
    source, target = VisibilityField(**config), diffuse.ShadingField(**config)
    checkpoints.save(tmp_path / "field.safetensors", source, "field", config, {})
    load_start(target, tmp_path / "field.safetensors", "another")
    image = torch.rand(1, 4, 32, 32)
    stem, wider = source.backbone.half().float().stem, target.backbone.stem
    unshuffled = torch.nn.functional.pixel_unshuffle(image, 2)
    with_normals = torch.nn.functional.pixel_unshuffle(torch.cat([image, torch.rand(1, 3, 32, 32)], dim=1), 2)
    seen = torch.cat([with_normals, torch.rand(1, 96, 16, 16)], dim=1)  # and the visibility of the anchors
    torch.testing.assert_close(wider(seen), stem(unshuffled))
    assert target.backbone.head.weight.abs().max() == 0


def test_outputs_added_to_a_head_start_at_zero(tmp_path):
    torch.manual_seed(0)
    source = VisibilityField(128)
    torch.nn.init.normal_(source.backbone.head.weight)
    checkpoints.save(tmp_path / "field.safetensors", source, "field", {"size": 128}, {})
    target, image = VisibilityField(128, depth=True), torch.rand(1, 4, 64, 64)
    load_start(target, tmp_path / "field.safetensors", "field")
    with torch.no_grad():
        before, after = (network.backbone(image) for network in (source.half().float(), target))
    torch.testing.assert_close(after[:, :-1], before)
    assert not after[:, -1].any()


def test_where_bfloat16_is_slow_training_runs_in_float32(folder, tmp_path, monkeypatch):
    seen = []
    convolve = torch.nn.Conv2d.forward
    monkeypatch.setattr(
        torch.nn.Conv2d, "forward", lambda self, x: seen.append(convolve(self, x).dtype) or convolve(self, x)
    )
    with using("float32"):
        run(replace(SHADOW, config=TINY), folder, tmp_path / "float", 2)
    assert set(seen) == {torch.float32}


SHALLOW = {"encoder": (1, 1, 1, 1, 1), "decoder": (1, 1, 1, 1)}


def test_a_deeper_network_starts_where_a_shallower_one_came_to(folder, tmp_path):
    shallow = run(replace(SHADOW, config=SHADOW.config | SHALLOW), folder, tmp_path / "shallow", 4)
    still = replace(SHADOW, loss=lambda network, batch: 0 * SHADOW.loss(network, batch))
    deep = run(still, folder, tmp_path / "deep", 1, init=shallow)
    image = torch.rand(1, 4, 128, 96)
    with torch.no_grad():
        before, after = visibility.load(shallow)(image), visibility.load(deep)(image)
    assert before.cast.std() > 0
    for was, now in zip(before, after, strict=True):
        torch.testing.assert_close(now, was, rtol=0.01, atol=0.01 * float(was.abs().max()))


def test_a_deeper_network_of_another_kind_starts_with_the_same_features(tmp_path):
    torch.manual_seed(0)
    source = VisibilityField(size=128, **SHALLOW)
    checkpoints.save(tmp_path / "field.safetensors", source, "field", {"size": 128, **SHALLOW}, {})
    target = diffuse.ShadingField(size=128)
    load_start(target, tmp_path / "field.safetensors", "another")
    image = torch.rand(1, 4, 128, 96)
    features = []
    for backbone in (source.half().float().backbone, target.backbone):
        backbone.norm.register_forward_hook(lambda module, given, result: features.append(result))
    source.backbone(image)
    target.backbone(torch.cat([image, torch.rand(1, 3, 128, 96)], dim=1), guides=torch.rand(1, 96, 64, 48))
    torch.testing.assert_close(features[1], features[0], rtol=1e-3, atol=1e-3)


def test_another_architecture_is_refused(tmp_path):
    narrow = VisibilityField(size=128, widths=(8, 8, 8, 8, 8))
    checkpoints.save(tmp_path / "narrow.safetensors", narrow, "field", {"size": 128}, {})
    with pytest.raises(ValueError, match="another architecture"):
        load_start(VisibilityField(), tmp_path / "narrow.safetensors", "another")
    checkpoints.save(tmp_path / "deep.safetensors", VisibilityField(size=128), "field", {"size": 128}, {})
    with pytest.raises(ValueError, match="another architecture"):
        load_start(VisibilityField(size=128, **SHALLOW), tmp_path / "deep.safetensors", "another")


def test_a_loss_that_is_not_finite_stops_the_run(folder, tmp_path):
    broken = replace(SHADOW, loss=lambda network, batch: SHADOW.loss(network, batch) * float("nan"))
    with pytest.raises(ValueError, match=r"loss at step .* is not finite"):
        run(broken, folder, tmp_path, 2)
    assert not (tmp_path / "field.safetensors").exists()


def test_weights_that_are_not_finite_are_not_saved(folder, tmp_path):
    """As in a process whose own loss is finite, while another's is not: they share the gradient."""

    def poisoned(network, batch):
        loss = SHADOW.loss(network, batch)
        loss.register_hook(lambda gradient: gradient * float("nan"))
        return loss

    with pytest.raises(ValueError, match="training: the network at step 1 is damaged"):
        run(replace(SHADOW, loss=poisoned), folder, tmp_path, 1)
    assert not list(tmp_path.glob("*.safetensors"))
    assert not (tmp_path / "checkpoint.pt").exists()


def test_a_checkpoint_that_cannot_go_on_is_named(folder, tmp_path):
    (tmp_path / "checkpoint.pt").write_bytes(b"cut")
    with pytest.raises(ValueError, match=r"checkpoint\.pt: does not continue this run"):
        run(SHADOW, folder, tmp_path, 1)


def test_records_to_score_on_are_looked_for_at_once(folder, tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        run(SHADOW, folder, tmp_path / "out", 1, validation=[tmp_path / "nowhere"])
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_where_the_disk_fills_up_in_the_last_step_the_weights_are_made_again(folder, tmp_path, monkeypatch):
    keep = checkpoints.save

    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoints, "save", full)
    with pytest.raises(OSError, match="No space"):
        run(SMALL, folder, tmp_path, 1)
    monkeypatch.setattr(checkpoints, "save", keep)
    assert run(SMALL, folder, tmp_path, 1).exists()
    with pytest.raises(ValueError, match=r"steps: .* has made 1, expected at least as many"):
        run(SMALL, folder, tmp_path, 0)


@pytest.mark.slow
def test_validation_scores_are_means_over_photographs(folder, tmp_path):
    files = sorted(folder.iterdir())
    five = tmp_path / "five"
    five.mkdir()
    for number, file in enumerate([*files, files[0]]):
        (five / f"{number}.npz").write_bytes(file.read_bytes())
    seen = []

    def scored(network, batch):
        seen.append(len(batch["rgb"]))
        return {"first": float(len(seen) == 1)}

    run(replace(SMALL, score=scored), folder, tmp_path / "out", 1, validation=[five])
    assert seen == [1] * 5
    row = json.loads((tmp_path / "out" / "log.jsonl").read_text().splitlines()[-1])
    assert row["first"] == pytest.approx(0.2)


@pytest.mark.slow
def test_per_light_network_learns_which_side_is_lit(folder, tmp_path):
    recipe = Recipe(steps=90, size=128, batch=2, lights=3, learning_rate=3e-3, warm_up=10)
    path = fit(few_channels(per_light("resb3")), recipe, [folder], tmp_path, estimator="true", workers=0)
    network = visibility.load(path)
    assert isinstance(network, PerLight)
    assert network.normals
    assert json.loads(checkpoints.read(path)[1]["recipe"])["normals"] == "true"
    ball = sphere()
    rgb, surface = (ball.image(values).permute(1, 2, 0).numpy() for values in (ball.albedo, ball.normals))
    lights = from_spherical([-70, 70], [0, 0])
    left, right = shadow.infer(rgb, ball.mask, lights, normals=surface, model=path)
    half = rgb.shape[1] // 2
    assert left[:, :half].sum() > 1.2 * left[:, half:].sum()
    assert right[:, half:].sum() > 1.2 * right[:, :half].sum()


def test_per_light_network_without_normals(folder, tmp_path):
    path = run(
        few_channels(per_light("attention", with_normals=False)), folder, tmp_path, 1, validation=[folder]
    )
    network, recipe = visibility.load(path), json.loads(checkpoints.read(path)[1]["recipe"])
    assert not network.normals
    assert "normals" not in recipe
    row = json.loads((tmp_path / "log.jsonl").read_text())
    assert "dice" in row
    assert "dice_baseline" not in row


def test_the_papers_recipe(folder, tmp_path):
    recipe = preset("paper", per_light("resb7"), [folder])
    assert (recipe.batch, recipe.lights, recipe.learning_rate, recipe.size) == (1, 1, 5e-6, 512)
    assert recipe.steps == 31 * 4 * 96  # epochs, records, maps each
    assert learning_rate(recipe, 0) == learning_rate(recipe, recipe.steps - 1) == 5e-6
    recipe = replace(recipe, steps=2, size=128)
    path = fit(few_channels(per_light("resb7")), recipe, [folder], tmp_path, estimator="true", workers=0)
    last = torch.load(tmp_path / "checkpoint.pt", weights_only=True)["network"]
    for key, value in checkpoints.read(path)[0].items():
        torch.testing.assert_close(value, last[key].half(), msg=key)


def test_presets_take_changes_and_name_what_is_missing(folder):
    assert preset("fast", SHADOW, [folder], steps=5, batch=None) == Recipe(steps=5)
    assert preset("fast", per_light("resb3"), [folder], steps=5, lights=7).lights == 7
    with pytest.raises(ValueError, match="steps: expected a number"):
        preset("fast", SHADOW, [folder])
    with pytest.raises(ValueError, match="preset: expected paper or fast"):
        preset("slow", SHADOW, [folder])


def test_a_network_without_that_backbone_is_refused(tmp_path):
    checkpoints.save(tmp_path / "field.safetensors", VisibilityField(size=128), "field", {"size": 128}, {})
    with pytest.raises(ValueError, match=r"init: .* is a 'field' network"):
        load_start(PerLight(widths=(8, 8, 8, 8, 8)), tmp_path / "field.safetensors", "another")
    config = {"latent": "resb3", "normals": False, "widths": [8, 8, 16, 16, 32]}
    checkpoints.save(tmp_path / "resb3.safetensors", PerLight(**config), "resb3", config, {})
    with pytest.raises(ValueError, match=r"init: .* is a 'resb3' network"):
        load_start(VisibilityField(size=128), tmp_path / "resb3.safetensors", "another")


def test_weights_for_another_input_are_refused(folder, tmp_path):
    task = few_channels(per_light("resb3"))
    config = {"latent": "resb3", "normals": False, "widths": [8, 8, 16, 16, 32]}
    checkpoints.save(tmp_path / "colour.safetensors", PerLight(**config), "resb3", config, {})
    with pytest.raises(ValueError, match=r"init: .* has another architecture"):
        run(task, folder, tmp_path / "run", 1, init=tmp_path / "colour.safetensors", estimator="true")
