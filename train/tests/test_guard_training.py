"""The network that corrects the guard's weights: tables, forms of errors, training, files."""

import csv
import json
import sys
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import safetensors.numpy
import torch

from nst_train import guard_fixtures, weights
from nst_train.__main__ import main
from nst_train.errors import UserError
from nst_train.guard_data import files
from nst_train.guard_data.read import Picture
from nst_train.guard_training import data, descent, forms, make, scores, settings, stored, studies, table
from nst_train.guard_training.forms import METRICS
from nst_train.guard_training.stored import LISTS
from nst_train.guard_training.table import EXPERTS, INPUTS, Table
from nst_train.model import GuardMlp

CONFIG = Path(__file__).parents[1] / "configs" / "guard" / "guard.toml"
HEIGHT, WIDTH, CELL, KNOTS = 21, 14, 4, 5  # no multiples of the cell
CELLS = (6, 4)


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """As in the command: more only get into each other's way."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def config(**changes: object) -> settings.Settings:
    return replace(settings.load(CONFIG), **changes)


def random_table(experts: str, rng: np.random.Generator, told: float = 0.5) -> tuple[Table, np.ndarray]:
    """A picture whose best weights are `told` for all experts but the first, everywhere, and its references.

    Input 3 tells of it; the closed form has all weight on S and the first expert, which makes errors larger.
    """
    names = tuple(experts.split(","))
    truth = rng.uniform(0.5, 1.5, (3, HEIGHT, WIDTH))
    noise = 0.3 * rng.standard_normal((len(names), *truth.shape))
    noise[0] *= 3.0
    rest = truth - told * noise[1:].sum(axis=0)
    inputs = rng.standard_normal((*CELLS, KNOTS, 2, INPUTS))
    inputs[..., 3] = told + 0.02 * rng.standard_normal(inputs.shape[:-1])
    closed = np.full((*CELLS, KNOTS, 2, len(names)), 0.02)
    closed[..., 0] = 0.4
    made = Table(
        names,
        CELL,
        inputs.astype(np.float32),
        closed.astype(np.float32),
        rng.uniform(0.0, KNOTS - 1, (HEIGHT, WIDTH)).astype(np.float32),
        noise.astype(np.float32),
        rest.astype(np.float32),
    )
    halves = truth + 0.003 * rng.standard_normal((2, *truth.shape))
    return made, halves


def write_set(folder: Path, pictures: int, shuffled: bool = False, held_out: int = 4) -> None:
    """Pictures to train on, and others. Of shuffled ones, what input 3 tells is of another picture."""
    rng = np.random.default_rng(1)
    for index in range(pictures + held_out):
        told = rng.uniform(0.05, 0.45)
        is_held_out = index >= pictures
        made = []
        for experts in LISTS:
            of_list, halves = random_table(experts, np.random.default_rng(100 + index), told)
            if shuffled and not is_held_out:
                of_list.inputs[..., 3] += rng.uniform(0.05, 0.45) - told
            made.append(of_list)
        family = "maze" if is_held_out else "room"
        scene = f"{family}-{index:03}"
        picture = Picture(scene, family, is_held_out, 8, folder / scene / "8-0.exr", (folder,) * 2, 512)
        plain = made[0].rest + 0.1
        stored.write(stored.path_of(folder, picture), picture, plain, made, halves)


@pytest.mark.parametrize("experts", LISTS)
def test_forms_are_the_errors_of_weights_that_are_the_same_everywhere(experts: str) -> None:
    rng = np.random.default_rng(3)
    made, halves = random_table(experts, rng)
    constant, found = forms.errors(made.rest, halves), forms.forms(made, halves)
    for _ in range(3):
        w = np.zeros(len(EXPERTS))
        w[made.slots] = rng.random(len(made.slots))
        t = made.rest + np.tensordot(w[made.slots], made.changes, 1)
        monomials = descent.monomials(torch.from_numpy(w)[None])[0].numpy()
        change = (found.sum(axis=(0, 1, 2)) * monomials).sum(axis=-1)
        np.testing.assert_allclose(constant + change, forms.errors(t, halves), rtol=1e-6)
        same = np.broadcast_to(w[made.slots], (*made.grid, len(made.slots)))
        np.testing.assert_allclose(forms.blended(same, made), t, rtol=1e-6)


def test_forms_are_those_of_the_pixels_of_a_row() -> None:
    """A pixel at a time, from the definition."""
    made, halves = random_table("lane,filter,oidn", np.random.default_rng(4))
    expected = np.zeros((*made.grid, len(METRICS), forms.FORM))
    mean = halves.mean(axis=0)
    for y in range(HEIGHT):
        for x in range(WIDTH):
            below = min(int(made.places[y, x]), KNOTS - 2)
            for knot, share in (
                (below, below + 1 - made.places[y, x]),
                (below + 1, made.places[y, x] - below),
            ):
                for metric, floor in ((0, None), (1, 0.01)):
                    u = 1.0 if floor is None else 1.0 / (mean[:, y, x] ** 2 + floor)
                    d = made.changes[:, :, y, x].astype(np.float64)
                    a, g = (u * d) @ d.T, (u * d) @ (mean - made.rest)[:, y, x]
                    form = [a[0, 0], a[1, 0], a[1, 1], a[2, 0], a[2, 1], a[2, 2], *g]
                    row = expected[y // CELL, x // CELL, knot, metric]
                    row += share * np.array(form) / (3 * HEIGHT * WIDTH)
    found = forms.forms(made, halves)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-9)
    assert not expected[~forms.reached(made)].any()


def test_weights_between_cells_and_knots() -> None:
    """Linear in the cells' coordinates and the knot: such weights are those of the pixel's coordinates."""
    made, _ = random_table("lane,filter", np.random.default_rng(5))
    row, column, knot = np.indices(made.grid)
    cells = np.stack([row + 10.0 * column + 100.0 * knot, np.ones(made.grid)], axis=-1)
    y, x = np.indices(made.places.shape)
    down, across = ((at + 0.5) / CELL - 0.5 for at in (y, x))
    down, across = down.clip(0, CELLS[0] - 1), across.clip(0, CELLS[1] - 1)
    found = forms.interpolate(cells, made)
    np.testing.assert_allclose(found[0], down + 10.0 * across + 100.0 * made.places, rtol=1e-6)
    np.testing.assert_allclose(found[1], 1.0, rtol=1e-12)
    # Rows that no pixel reaches change nothing.
    spoilt = np.where(forms.reached(made)[..., None], cells, np.nan)
    at = np.isfinite(forms.interpolate(np.nan_to_num(spoilt, nan=1e9), made))
    assert at.all() and np.abs(forms.interpolate(np.nan_to_num(spoilt, nan=1e9), made) - found).max() < 1e-3


def test_training_finds_what_the_inputs_tell_and_nothing_where_they_tell_nothing(tmp_path: Path) -> None:
    """The closed form leaves the errors of S or makes them larger; the best weights leave next to none."""
    wanted = config(steps=250, batch_size=4)
    ratios = {}
    for shuffled in (False, True):
        folder = tmp_path / str(shuffled)
        write_set(folder, pictures=16, shuffled=shuffled)
        model, losses = descent.train(wanted, data.load(folder, wanted), say=lambda line: None)
        assert len(losses) == wanted.steps
        found = scores.score({"network": model}, folder, wanted)
        for experts in LISTS:
            for method in (scores.CLOSED, "network"):
                ratios[shuffled, experts, method] = np.array(scores.summary(found, experts, method)[2:4])
    for experts in LISTS:
        told, not_told = ratios[False, experts, "network"], ratios[True, experts, "network"]
        closed = ratios[False, experts, scores.CLOSED]
        assert (told < 0.003 * closed).all(), (experts, told, closed)
        assert (not_told > 8 * told).all(), (experts, not_told, told)


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(tmp_path: Path) -> None:
    write_set(tmp_path, pictures=3, held_out=1)
    text = CONFIG.read_text(encoding="utf-8").replace("steps = 1500", "steps = 12")
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        (tmp_path / f"{name}.toml").write_text(text.replace("seed = 1", f"seed = {seed}"))
        words = ["guard", "--folder", str(tmp_path), "--config", str(tmp_path / f"{name}.toml")]
        assert main([*words, "--out", str(tmp_path / name)]) == 0
    read = {name: (tmp_path / name / "guard.safetensors").read_bytes() for name in "abc"}
    assert read["a"] == read["b"] != read["c"]
    rows = (tmp_path / "a" / "metrics.csv").read_text().splitlines()
    assert rows[0].split(",") == scores.COLUMNS and len(rows) == 1 + 2 * len(LISTS)
    model, metadata = weights.load(tmp_path / "a" / "guard.safetensors")
    assert isinstance(model, GuardMlp)
    told = {"inputs": "guard", "experts": "lane,filter,oidn", "prior_floor": "0.02", "samples": "8..8"}
    assert told.items() <= metadata.items() and metadata["trained_on"] == "random:room"
    assert metadata["config"] == (tmp_path / "a.toml").read_text() and "window" not in metadata
    # Another config in the same folder is refused.
    words[4] = str(tmp_path / "c.toml")
    assert main([*words, "--out", str(tmp_path / "a")]) == 1


def test_a_curve_has_a_row_for_each_number_of_scenes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(studies, "CURVE", (1, 3, 40))
    write_set(tmp_path, pictures=4, held_out=1)
    items = data.load(tmp_path, config())
    studies.curve(config(steps=4), items, tmp_path, tmp_path / "curve.csv")
    rows = read_rows(tmp_path / "curve.csv")
    assert [row["scenes"] for row in rows] == ["0", "1", "3", "4"] * len(LISTS)
    assert all(float(row[name]) > 0 for row in rows for name in studies.SUMMARY)


def read_rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_ablations_have_a_row_for_each_variant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    variants = [studies.VARIANTS[0], studies.Variant("1 × 4", {"hidden": [4]})]
    monkeypatch.setattr(studies, "VARIANTS", variants)
    write_set(tmp_path, pictures=2, held_out=1)
    items = data.load(tmp_path, config())
    studies.ablations(config(steps=4), items, tmp_path, tmp_path / "ablations.csv")
    rows = read_rows(tmp_path / "ablations.csv")
    assert [row["network"] for row in rows] == ["closed", "as it is", "1 × 4"] * len(LISTS)
    assert [row["parameters"] for row in rows[:3]] == ["0", "627", f"{18 * 4 + 4 + 4 * 3 + 3}"]
    assert len({row["mse_to_min"] for row in rows[:3]}) == 3


def test_a_network_is_blind_to_inputs_that_it_does_not_get(tmp_path: Path) -> None:
    write_set(tmp_path, pictures=2)
    items = data.load(tmp_path, config(steps=40))
    # Input 3 tells of the best weights.
    seeing, blind = (
        studies.trained(studies.Variant("", without=without), config(steps=40), items)
        for without in ((), (3,))
    )
    item = items[0]
    other = item.inputs.clone()
    other[..., 3] += 1.0
    with torch.no_grad():
        changed = [
            bool(
                (
                    model.weights(item.inputs, item.closed, item.part)
                    != model.weights(other, item.closed, item.part)
                ).any()
            )
            for model in (seeing, blind)
        ]
    assert changed == [True, False]
    shifted = [replace(it, inputs=it.inputs + torch.eye(INPUTS)[3]) for it in items]
    again = studies.trained(studies.Variant("", without=(3,)), config(steps=40), shifted)
    assert all(torch.equal(a, b) for a, b in zip(blind.parameters(), again.parameters(), strict=True))


def test_held_out_families_are_not_read_in_training(tmp_path: Path) -> None:
    write_set(tmp_path, pictures=2, held_out=2)
    held_out = stored.files(tmp_path, held_out=True)
    assert {path.name for path in held_out} == {"maze-002-8-0.npz", "maze-003-8-0.npz"}
    for path in held_out:
        path.write_bytes(b"must not be read")
    items = data.load(tmp_path, config())
    assert {item.family for item in items} == {"room"} and len(items) == 2 * len(LISTS)
    with pytest.raises(UserError, match=r"maze-002-8-0.npz: damaged"):
        scores.score({}, tmp_path, config())


def test_pictures_whose_reference_has_much_noise_teach_nothing(tmp_path: Path) -> None:
    write_set(tmp_path, pictures=2)
    picture = stored.read(stored.files(tmp_path, held_out=False)[0])
    assert len(data.items_of(picture, config())) == len(LISTS)
    most = config().most_noise
    for noise, lists in (([most, most], len(LISTS)), ([1.01 * most, 0.0], 0), ([0.0, 1.01 * most], 0)):
        assert len(data.items_of(replace(picture, noise=picture.plain * noise), config())) == lists


def test_units_are_the_best_errors_but_not_less_than_a_share_of_those_of_S(tmp_path: Path) -> None:
    write_set(tmp_path, pictures=1)
    picture = stored.read(stored.files(tmp_path, held_out=False)[0])
    for denoiser, expected in ((3.0, 1.0), (0.5, 0.5), (0.001, 0.02), (-0.1, 0.02)):
        changed = replace(picture, denoiser=denoiser * picture.plain)
        assert data.best(changed, config()) == pytest.approx(expected * picture.plain)
        for item in data.items_of(changed, config()):
            assert item.plain.tolist() == pytest.approx([1 / expected] * 2)


def test_the_loss_is_that_of_its_definition(tmp_path: Path) -> None:
    write_set(tmp_path, pictures=1)
    (item, _) = data.load(tmp_path, config())
    item = replace(item, plain=torch.tensor([2.0, 1.0]), closed_errors=torch.tensor([0.5, 4.0]))
    log = np.log
    for ratio, expected in (
        ([0.4, 0.9], [log(0.42), log(0.92)]),
        ([1.0, 3.0], [log(1.02) + log(1.001 / 0.501), log(3.02) + 0.5 * log(3) + log(3.001 / 1.001)]),
        ([3.0, -1.0], [log(3.02) + 0.5 * log(1.5) + log(3.001 / 0.501), log(0.02)]),
    ):
        found = descent.picture_losses(torch.tensor([ratio]), [item], config().loss)
        np.testing.assert_allclose(found[0], expected, rtol=1e-5)


def test_folded_normalisation_is_the_same_network(tmp_path: Path) -> None:
    write_set(tmp_path, pictures=2)
    items = data.load(tmp_path, config())
    model = descent.make_model(config(), items)
    inputs, closed, part = items[1].inputs, items[1].closed, items[1].part
    plain = model.folded()
    assert [name for name, _ in plain.named_buffers()] == []
    everything = torch.cat([item.inputs for item in items]).flatten(0, 1)
    normal = (everything - model.center) @ model.basis.T
    # The network looks at one row in seven, about 40 pairs of these: their mean is within half a deviation.
    assert normal.mean(dim=0).abs().max() < 0.5 and (normal.std(dim=0) - 1).abs().max() < 0.5
    normal = (inputs - model.center) @ model.basis.T
    # f32 at values of some units.
    torch.testing.assert_close(
        plain.weights(inputs, closed, part), model.weights(inputs, closed, part), rtol=0.0, atol=1e-5
    )
    assert (plain(inputs) - GuardMlp.forward(plain, normal)).abs().max() > 1e-3


def test_weights_start_near_the_closed_form_and_absent_experts_get_none() -> None:
    model = guard_fixtures.random_network([16, 16], 0.02, seed=1)
    inputs, closed = guard_fixtures.random_rows(seed=2)
    part = torch.tensor([True, True, False])
    closed = closed * part
    found = model.weights(inputs, closed, part)
    assert (found[:, 2] == 0).all() and (found >= 0).all() and (found.sum(dim=1) <= 1 + 1e-6).all()
    model.start_from_closed(0.0)
    expected = (closed + 0.02) / (1 + 3 * 0.02) * part  # S and two experts
    torch.testing.assert_close(model.weights(inputs, closed, part), expected)
    # By hand: o = ln 3 for all experts.
    with torch.no_grad():
        model.layers[-1].bias.fill_(np.log(3))
    one = model.weights(inputs[:1], torch.tensor([[0.2, 0.3, 0.0]]), torch.tensor([True] * 3))
    unit = 0.52 + 3 * (0.22 + 0.32 + 0.02)
    torch.testing.assert_close(one[0], torch.tensor([0.66, 0.96, 0.06]) / unit)


def test_round_trip(tmp_path: Path) -> None:
    guard_fixtures.write(tmp_path)
    path = tmp_path / "guard-5.safetensors"
    loaded, metadata = weights.load(path)
    made = guard_fixtures.random_network([5], 0.1, seed=2)
    assert isinstance(loaded, GuardMlp) and (loaded.experts, loaded.floor) == (EXPERTS, 0.1)
    inputs, closed = guard_fixtures.random_rows(seed=2)
    part = torch.tensor([True] * 3)
    assert torch.equal(loaded.weights(inputs, closed, part), made.weights(inputs, closed, part))
    tensors, _ = weights.load_tensors(path)
    for key, value in (("experts", "lane,oidn"), ("prior_floor", "0"), ("prior_floor", "x")):
        weights.save_tensors(path, tensors, metadata | {key: value})
        with pytest.raises(UserError, match="do not fit"):
            weights.load(path)


def test_fixtures_agree_with_pytorch_and_a_change_is_noticed(tmp_path: Path) -> None:
    guard_fixtures.write(tmp_path)
    guard_fixtures.check(tmp_path)
    path = tmp_path / "guard-16-16.io.safetensors"
    kept, _ = weights.load_tensors(path)
    for key in ("weights-lane-filter-oidn", "weights_f64-oidn"):
        tensors = {name: tensor.clone() for name, tensor in kept.items()}
        tensors[key][7, 0] += 3 * guard_fixtures.TOLERANCE
        weights.save_tensors(path, tensors, {})
        with pytest.raises(UserError, match=f"guard-16-16.io.safetensors: {key} is"):
            guard_fixtures.check(tmp_path)


def write_table(path: Path, made: Table, **metadata: str) -> None:
    """As `nst` writes it."""
    told = {"format": table.FORMAT, "experts": ",".join(made.experts), "cell": str(made.cell), "samples": "8"}
    names = ("inputs", "closed", "places", "changes", "rest")
    safetensors.numpy.save_file({name: getattr(made, name) for name in names}, path, told | metadata)


def test_a_table_of_nst_is_read_and_a_damaged_one_is_named(tmp_path: Path) -> None:
    path = tmp_path / "x.safetensors"
    made, _ = random_table("lane,oidn", np.random.default_rng(6))
    write_table(path, made)
    found = table.read(path)
    assert (found.experts, found.cell, found.slots) == (("lane", "oidn"), CELL, [0, 2])
    np.testing.assert_array_equal(found.inputs, made.inputs)
    np.testing.assert_array_equal(found.changes, made.changes)

    with pytest.raises(UserError, match="no such file"):
        table.read(tmp_path / "none")
    for metadata, complaint in (
        ({"format": "x"}, "format is 'x'"),
        ({"experts": "lane,teapot"}, "expected some of lane,filter,oidn"),
        ({"cell": "0"}, "cell = 0"),
        ({"cell": "wide"}, "not what a table"),
        ({"cell": "8"}, "inputs has the shape"),
    ):
        write_table(path, made, **metadata)
        with pytest.raises(UserError, match=complaint):
            table.read(path)
    far = made.places.copy()
    far[0, 0] = KNOTS
    for name, array, complaint in (
        ("places", far, "a place is not within"),
        ("rest", np.full_like(made.rest, np.nan), "a number of rest is NaN"),
        ("closed", made.closed[..., :1].copy(), "closed has the shape"),
    ):
        write_table(path, replace(made, **{name: array}))
        with pytest.raises(UserError, match=complaint):
            table.read(path)
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(UserError, match="not a safetensors file"):
        table.read(path)


def test_a_damaged_stored_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no tables; make them with"):
        data.load(tmp_path, config())
    write_set(tmp_path, pictures=1)
    (path,) = stored.files(tmp_path, held_out=False)
    whole = path.read_bytes()
    with np.load(path) as file:
        arrays = dict(file)

    def damages() -> list[Callable[[], object]]:
        name = f"{LISTS[0]} forms"
        return [
            lambda: path.write_bytes(whole[: len(whole) // 2]),
            lambda: path.write_bytes(b""),
            lambda: np.savez(path, **{key: value for key, value in arrays.items() if key != name}),
            lambda: np.savez(path, **arrays | {name: arrays[name][:-1]}),
            lambda: np.savez(path, **arrays | {name: np.full_like(arrays[name], np.nan)}),
            lambda: np.savez(path, **arrays | {"format": "x"}),
        ]

    for damage in damages():
        damage()
        with pytest.raises(UserError, match=r"room-000-8-0.npz: (damaged|format)"):
            data.load(tmp_path, config())


FAKE = """\
import shutil, sys
words = sys.argv[1:]
told = dict(zip(words, words[1:]))
scene = words[1].split("/")[-2]
if scene == "room-001":
    sys.exit("error: no folds")
assert words[0] == "guard-table" and told["-o"].endswith(".safetensors")
shutil.copy(f"{TABLES}/{told['--experts']}", told["-o"])
open(f"{TABLES}/asked", "a").write(f"{scene} {told['--experts']}\\n")
"""


def test_features_are_left_out_of_some_pictures_that_are_trained_on(tmp_path: Path) -> None:
    def picture(number: int, held_out: bool) -> Picture:
        sequence = Path("8-0.exr")
        return Picture(f"room-{number:03}", "room", held_out, 8, sequence, (sequence, sequence), 512)

    lacking = [make.features_left_out(picture(number, held_out=False)) for number in range(200)]
    shares = [lacking.count(features) / 200 for features in ((), ("emission",), make.FEATURES)]
    assert all(abs(share - told) < 0.12 for share, told in zip(shares, (0.6, 0.2, 0.2), strict=True))
    assert not any(make.features_left_out(picture(number, held_out=True)) for number in range(50))
    content = {name: np.ones((2, 3), np.float32) for name in ("R", "G", "B", "albedo0.R", "emission.G")}
    OpenEXR.File({"samplesPerPixel": 8}, content).write(str(tmp_path / "a.exr"))
    files.without(tmp_path / "a.exr", tmp_path / "b.exr", ("emission",))
    with OpenEXR.File(str(tmp_path / "b.exr"), separate_channels=True) as left:
        assert sorted(left.channels()) == ["B", "G", "R", "albedo0.R"]
    assert files.samples(tmp_path / "b.exr") == 8


def test_tables_are_made_once_and_a_failure_does_not_end_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tables, pictures = tmp_path / "tables-of-nst", tmp_path / "set"
    tables.mkdir()
    rng = np.random.default_rng(7)
    for experts in LISTS:
        made, halves = random_table(experts, np.random.default_rng(8))
        write_table(tables / experts, made)
    binary, script = tmp_path / "nst", tmp_path / "fake.py"
    script.write_text(f"TABLES = {str(tables)!r}\n{FAKE}")
    binary.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{script}" "$@"\n')
    binary.chmod(0o755)
    monkeypatch.setenv("NST", str(binary))
    monkeypatch.setattr(make, "features_left_out", lambda _: ())
    plain = halves[0] + 0.1 * rng.standard_normal(halves[0].shape)
    for scene, held_out in (("room-000", False), ("room-001", False), ("maze-000", True)):
        place = pictures / scene
        place.mkdir(parents=True)
        facts = {"family": scene[:4], "held_out": held_out, "counts": [8]}
        (place / "scene.json").write_text(json.dumps(facts))
        for name, picture, spp in (
            ("8-0", plain, 8),
            ("reference-0", halves[0], 512),
            ("reference-1", halves[1], 512),
        ):
            files.write_reference(place / f"{name}.exr", np.moveaxis(picture, 0, -1), spp)
    words = ["guard-tables", "--folder", str(pictures)]
    assert main(words) == 1
    told = capsys.readouterr()
    assert "room-001/8-0.exr: nst guard-table" in told.out and "no folds" in told.out
    assert "1 pictures failed" in told.err
    asked = (tables / "asked").read_text()
    assert sorted(asked.splitlines()) == sorted(f"{s} {e}" for s in ("room-000", "maze-000") for e in LISTS)
    assert main([*words, "--only", "room-000", "maze"]) == 0
    assert (tables / "asked").read_text() == asked
    assert sorted(path.name for path in (pictures / "tables").rglob("*.*")) == [
        "maze-000-8-0.npz",
        "room-000-8-0.npz",
    ]

    picture = stored.read(stored.files(pictures, held_out=False)[0])
    as_read = np.stack([plain, *halves]).astype(np.float32).astype(np.float64)
    np.testing.assert_allclose(picture.plain, forms.errors(as_read[0], as_read[1:]), rtol=1e-9)
    denoised = forms.errors(as_read[0] + made.changes[2], as_read[1:])
    np.testing.assert_allclose(picture.denoiser, denoised, rtol=1e-9)
    held_out, pixels, _ = stored.read_with_pixels(stored.files(pictures, held_out=True)[0])
    for rows, of_list in zip(held_out.lists, pixels, strict=True):
        w = np.full((*of_list.grid, len(of_list.experts)), 0.02)
        w[..., 0] = 0.4
        found = forms.errors(forms.blended(w, of_list), as_read[1:])
        np.testing.assert_allclose(rows.closed_errors, found, rtol=1e-5)


def test_the_committed_config_is_valid_and_mistakes_are_named() -> None:
    text = CONFIG.read_text(encoding="utf-8")
    assert (config().name, config().hidden, config().text) == (CONFIG.stem, [16, 16], text)
    for old, new, complaint in (
        ("steps = 1500", "step = 1500", "unknown key 'step'; did you mean 'steps'"),
        ("steps = 1500", "", "missing key 'steps'"),
        ("steps = 1500", "steps = 1", "steps = 1: must be 2 or more"),
        ("regret = 1\n", "regret = -1\n", "loss.regret = -1: must be 0 or more"),
        ("regret_floor = 1e-3", "regret_floor = 0", "loss.regret_floor = 0: must be a positive number"),
        ("[loss]", "[lost]", "missing table"),
        ("hidden = [16, 16]", "hidden = []", "hidden"),
        ("batch_size = 8", 'batch_size = "8"', "batch_size"),
    ):
        assert text.count(old) == 1
        changed = text.replace(old, new)
        with pytest.raises(UserError) as caught:
            settings.parse(tomllib.loads(changed), changed)
        assert complaint in str(caught.value)
