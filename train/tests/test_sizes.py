"""The ladder of sizes: what is measured, what is measured again, and what docs/sizes.py says of it."""

import csv
import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import fake_nst
from nst_train import config as configs
from nst_train import evaluation, renders, sizes, weights
from nst_train.config import RendersData
from nst_train.errors import UserError
from nst_train.model import Mlp
from nst_train.training import Training
from nst_train.weights import Provenance

DOCS = renders.REPOSITORY / "docs"


@pytest.fixture
def box(tmp_path: Path, settings: RendersData, fake_nst: Path) -> list[str]:
    """The options for a ladder of a scene of the stand-in's, with a built-in network; two epochs."""
    lines = ['name = "box"', "seed = 1", "window = 8", "hidden = [9]", 'inputs = "raw"']
    lines += ['start = "input"', 'loss = "L0"', "epsilon = 1e-2", "epochs = 3", "batch_size = 9"]
    lines += ["learning_rate = 1e-3", "terms_per_step = 2", "[data]"]
    data = vars(settings) | {"terms": 33, "evaluation_runs": 3}
    lines += [f"{key} = {json.dumps(value)}" for key, value in data.items()]
    lines += ["[small]", "hidden = [4]", "epochs = 2"]
    (tmp_path / "box.toml").write_text("\n".join(lines))
    save_built_in(tmp_path)
    options = ["--out", str(tmp_path / "out"), "--table", str(tmp_path / "sizes.csv")]
    return ["box", *options, "--configs", str(tmp_path), "--weights", str(tmp_path)]


def save_built_in(folder: Path, **changed: object) -> None:
    known = {"trained_on": f"scene:{fake_nst.SCENE}", "samples": "8..33", "loss": "L0", "epochs": 2}
    known |= {"seed": 1, "config": "", "sampler": "random"}
    weights.save(folder / "box.safetensors", Mlp(8, [4]), Provenance(**(known | changed)))


def rows_of(table: Path) -> list[dict[str, str]]:
    with table.open() as file:
        return list(csv.DictReader(file))


def test_a_ladder_is_measured_once(box: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    box += ["--hidden", "3x1", "5x2"]
    assert sizes.main(box) == 0
    rows = rows_of(tmp_path / "sizes.csv")
    assert list(rows[0]) == sizes.COLUMNS
    found = [(row["network"], row["built_in"], row["epochs"], row["n"]) for row in rows]
    ladder = [("8-4-1", "yes"), ("8-3-1", "no"), ("8-5-5-1", "no")]
    assert found == [(*network, "2", n) for network in ladder for n in ("8", "16", "32")]
    assert [row["cpu_seconds"] == "" for row in rows] == [True] * 3 + [False] * 6
    assert (rows[6]["parameters"], rows[6]["multiply_adds"]) == ("81", "70")  # 8·5 + 5·5 + 5, 11 biases
    for row in rows:
        ratios = [float(ratio) for ratio in row["run_ratios"].split()]
        # Numbers of the table have six digits.
        assert np.mean(ratios) == pytest.approx(float(row["mse_ratio"]), rel=2e-5)
        assert np.std(ratios, ddof=1) / np.sqrt(3) == pytest.approx(float(row["standard_error"]), rel=1e-2)

    def refuse(*_: object) -> None:
        raise AssertionError("trains what is in the table")

    before = (tmp_path / "sizes.csv").read_bytes()
    monkeypatch.setattr(Training, "run_epoch", refuse)
    assert sizes.main(box) == 0
    assert (tmp_path / "sizes.csv").read_bytes() == before
    for other in (["--epochs", "1"], ["--seed", "2"], ["--hidden", "3x2"]):
        with pytest.raises(AssertionError, match="trains what is in the table"):
            sizes.main(box + other)


def test_an_interrupted_ladder_ends_with_the_same_scores(
    box: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    box += ["--hidden", "3x1", "5x2", "--seed", "2"]
    assert sizes.main([*box, "--table", str(tmp_path / "whole.csv"), "--out", str(tmp_path / "whole")]) == 0
    monkeypatch.setattr(sizes.runs, "CHECKPOINT_SECONDS", 0.0)
    run_epoch = Training.run_epoch

    def interrupt(training: Training) -> float:
        if training.epoch == 1 and len(training.config.hidden) == 2:
            raise KeyboardInterrupt
        return run_epoch(training)

    monkeypatch.setattr(Training, "run_epoch", interrupt)
    assert sizes.main(box) == 130
    assert len(rows_of(tmp_path / "sizes.csv")) == 2 * len(sizes.NS)
    epochs = []

    def count(training: Training) -> float:
        epochs.append(training.epoch)
        return run_epoch(training)

    monkeypatch.setattr(Training, "run_epoch", count)
    assert sizes.main(box) == 0
    assert epochs == [1]  # the second of the interrupted network, and no other

    def scores(table: str) -> list[dict[str, str]]:
        return [{**row, "cpu_seconds": ""} for row in rows_of(tmp_path / table)]

    assert scores("sizes.csv") == scores("whole.csv")


def test_scores_are_those_of_the_table_of_networks(box: list[str], tmp_path: Path) -> None:
    config = configs.load(tmp_path / "box.toml", "small")
    data = renders.make_data(config.data, tmp_path)
    model = Mlp(8, [4])
    found = {row.n: row.mse_ratio for row in sizes.score("box", config, model, data, 1.0)}
    expected = evaluation.network_scores(config, model, data, sizes.NS)
    # Sums in another order, in f64.
    assert found == pytest.approx({s.n: s.mse_ratio for s in expected if s.method == "T"}, rel=1e-12)
    assert found != pytest.approx({s.n: s.mse_ratio for s in expected if s.method == "S"}, rel=1e-12)


def test_standard_errors_are_those_of_repeated_experiments() -> None:
    """Errors of T that follow those of S: the ratio varies far less than T alone."""
    rng = np.random.default_rng(1)
    experiments, runs = 4000, 10
    s = rng.normal(1.0, 0.1, (experiments, runs))
    t = 0.6 * s + rng.normal(0.0, 0.02, (experiments, runs))
    ratios = [sizes.run_ratios(*pair) for pair in zip(s, t, strict=True)]
    means = np.array([ratio.mean() for ratio in ratios])
    np.testing.assert_allclose(means, t.mean(axis=1) / s.mean(axis=1), rtol=1e-12)
    estimated = np.sqrt(np.mean([sizes.standard_error(ratio) ** 2 for ratio in ratios]))
    # The standard deviation of 4000 numbers is known to 1/sqrt(2 · 4000) = 1.1 %; four times that.
    assert estimated == pytest.approx(means.std(), rel=0.045)
    naive = np.sqrt(np.mean([sizes.standard_error(x) ** 2 for x in t]))
    assert naive > 2.0 * means.std()


def test_the_ladder_goes_up_to_the_papers_network() -> None:
    counts = []
    for hidden in sizes.LADDER:
        layers = Mlp(8, hidden).layers
        counts.append(sum(layer.weight.numel() + layer.bias.numel() for layer in layers))
    assert counts == sorted(counts) and (counts[0], counts[-1]) == (433, 199_937)
    config = configs.load(sizes.CONFIGS / "plane-lambert.toml", "paper")
    assert sizes.LADDER[-1] == config.hidden
    changed = sizes.sized(config, [16, 16], 10, 2)
    assert (changed.hidden, changed.epochs, changed.seed) == ([16, 16], 10, 2)
    assert changed.text.startswith(config.text) and "epochs = 10, seed = 2" in changed.text
    assert sizes.sized(config, [16, 16], 2000).epochs == config.epochs == 1000


def test_mistakes_are_named(box: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def complaint() -> str:
        assert sizes.main(box) == 1
        return capsys.readouterr().err

    save_built_in(tmp_path, trained_on="scene:other:v2:0")
    assert "trained on scene:other:v2:0, but the scene is scene:box" in complaint()
    save_built_in(tmp_path, epochs=7)
    assert "its epochs or its seed are not those of the config" in complaint()
    save_built_in(tmp_path)
    (tmp_path / "sizes.csv").write_text("a,b\n")
    assert "sizes.csv: expected the columns scene,network" in complaint()
    text = (tmp_path / "box.toml").read_text()
    (tmp_path / "box.toml").write_text(text.replace("evaluation_runs = 3", "evaluation_runs = 1"))
    assert "a standard error needs data.evaluation_runs = 2" in complaint()
    for options in (["--hidden", "16"], ["--hidden", "0x2"], ["--epochs", "0"], ["--seed", "x"]):
        with pytest.raises(SystemExit):
            sizes.main(box + options)
    configs_of_1d = ["gaussian", *box[1:], "--configs", str(sizes.CONFIGS)]
    assert sizes.main(configs_of_1d) == 1
    assert "gaussian: not a scene; expected one of plane-lambert" in capsys.readouterr().err
    with pytest.raises(UserError, match="no such file"):
        sizes.built_in("absent", configs.load(tmp_path / "box.toml"), None, tmp_path)


# docs/sizes.py


@pytest.fixture(scope="module")
def page() -> ModuleType:
    """docs/sizes.py, which is no part of a package."""
    spec = importlib.util.spec_from_file_location("docs_sizes", DOCS / "sizes.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["docs_sizes"] = module
    spec.loader.exec_module(module)
    return module


def row(hidden: int, mean: float, *, noise: float = 0.0, **changed: object) -> list[object]:
    """Of a network whose ten runs differ from those of another one by `noise`, by turns up and down."""
    everyones = 0.1 * np.arange(-4.5, 5.0)
    ratios = mean + everyones + noise * np.array([1, -1] * 5)
    cells = {"scene": "box", "network": f"8-{hidden}-{hidden}-1", "parameters": hidden, "multiply_adds": 1}
    cells |= {"built_in": "no", "seed": 1, "epochs": 40, "cpu_seconds": 8.0, "n": 8, "mse_ratio": mean}
    cells |= {"standard_error": 0.1, "run_ratios": " ".join(f"{x:.6g}" for x in ratios)}
    assert list(cells) == sizes.COLUMNS
    return list((cells | changed).values())


def verdict(page: ModuleType, tmp_path: Path, *rows: list[object]) -> str:
    evaluation.write_csv(tmp_path / "table.csv", sizes.COLUMNS, rows)
    return page.verdicts(page.ladders(page.read(tmp_path / "table.csv")))


def test_the_smallest_within_noise_is_enough(page: ModuleType, tmp_path: Path) -> None:
    best = row(64, 0.6, built_in="yes")
    # Of ten differences ± 0.03 the mean has the standard error 0.03/sqrt(9) = 0.01.
    near, far = row(32, 0.619, noise=0.03), row(32, 0.621, noise=0.03)
    said = verdict(page, tmp_path, best, near, row(16, 0.7))
    assert "32 is the smallest within noise of the best, 2×64 (+0.0190 ± 0.0200)" in said
    assert "the built-in network, 2×64, is **larger than it needs to be**" in said
    said = verdict(page, tmp_path, best, far, row(16, 0.7))
    assert "2×64 is the best, and no smaller one is within noise of it, but that is the largest one" in said
    assert "the built-in network, 2×64, is that one" in said
    said = verdict(page, tmp_path, row(64, 0.6), row(16, 0.7, built_in="yes"))
    assert "the built-in network, 2×16, is **smaller than that** (+0.1000 ± 0.0000 to the best)" in said
    said = verdict(page, tmp_path, best, row(128, 0.61))
    assert "2×64, the smallest, is the best" in said and "largest one" not in said


def test_trainings_from_other_seeds_are_part_of_the_noise(page: ModuleType, tmp_path: Path) -> None:
    best, near = row(64, 0.6, built_in="yes"), row(32, 0.619)
    said = verdict(page, tmp_path, best, near)
    assert "no smaller one is within noise" in said and said.endswith(". No other seed was tried.")
    # Two seeds that differ by 0.01 have the standard deviation 0.01/sqrt(2); two such trainings, 0.01.
    others = [row(32, 0.629, seed=2)]
    said = verdict(page, tmp_path, best, near, *others)
    assert "2×32 is the smallest within noise" in said and "No other seed" not in said
    assert "(+0.0190 ± 0.0200)" in verdict(page, tmp_path, best, near, *others)
    others = [row(32, 0.624, seed=2)]
    assert "no smaller one is within noise" in verdict(page, tmp_path, best, near, *others)


def test_chart_and_page_are_those_of_the_table(page: ModuleType, tmp_path: Path) -> None:
    table, chart, text = tmp_path / "t.csv", tmp_path / "c.svg", tmp_path / "p.md"
    rows = [row(64, 0.6, built_in="yes"), row(16, 0.7, noise=0.02), row(16, 0.71, seed=2)]
    evaluation.write_csv(table, sizes.COLUMNS, [*rows, row(16, 0.8, epochs=10), row(64, 0.85, epochs=10)])
    text.write_text("a\n" + "".join(f"<!-- {x} -->\n<!-- end of {x} -->\n" for x in page.BLOCKS) + "b\n")
    line = [str(path) for path in (table, chart, text)]
    page.main(line)
    page.main([*line, "--check"])
    written = text.read_text()
    assert "| scene | epochs | 2×16 | 2×64 |" in written
    assert "| `box` | 40 | 0.700 | **0.600**† |\n| `box` | 10 | **0.800** | 0.850 |" in written
    assert "| 2×16 | 8-16-16-1 | 16 | 1 | 0.2 |" in written
    drawn = chart.read_text()
    for label in ("40 epochs", "10 epochs", "other seeds", "built in", "box", "prefers-color-scheme: dark"):
        assert label in drawn

    def refused(path: Path, old: str, new: str) -> None:
        whole = path.read_text()
        assert old in whole
        path.write_text(whole.replace(old, new, 1))
        with pytest.raises(SystemExit, match="not what .* gives; run docs/sizes.py"):
            page.main([*line, "--check"])
        path.write_text(whole)

    refused(text, "0.850", "0.849")
    refused(text, "that one", "no such one")
    refused(chart, "40 epochs", "41 epochs")
    refused(table, ",16,1,no,1,40,8,8,0.7,0.1,0.27", ",16,1,no,1,40,8,8,0.7,0.1,0.28")
    page.main([*line, "--check"])


def test_tables_that_cannot_be_drawn_are_refused(page: ModuleType, tmp_path: Path) -> None:
    built_in = row(64, 0.6, built_in="yes")
    for rows, complaint in (
        ([], "has no rows"),
        ([row(64, 0.6)], "box: the table lacks its built-in network"),
        ([built_in, row(16, 0.7, n=16)], "not all networks have the same n"),
        ([built_in, row(16, 0.7), row(16, 0.7)], "not all networks have the same n"),
        ([built_in, row(16, 0.7, epochs=1), row(16, 0.7, epochs=2)], r"trained for \[40, 2, 1\] epochs"),
    ):
        with pytest.raises(SystemExit, match=complaint):
            verdict(page, tmp_path, *rows)
