"""Charts, tables and published weights follow from CSV files, and a change of either is noticed."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from fake_nst import DEVIATION
from nst_train import charts, evaluation, figures, paper_figures, pictures, publish, runs, weights
from nst_train import config as configs
from nst_train.config import RendersData
from nst_train.errors import UserError
from nst_train.evaluation import Score
from nst_train.metrics import Metrics
from nst_train.model import Mlp
from nst_train.weights import Provenance

METHODS = ("S", "T", "constant", "bayes", "aitken", "levin-u", "an-gn")


def scores(name: str, data: str) -> list[Score]:
    return [
        Score(name, data, method, n, (i + 1) / n, 0.0, (i + 1) / n, i + 1 + n / 100)
        for i, method in enumerate(METHODS)
        for n in (8, 16, 32, 64)
    ]


@pytest.fixture
def runs_folder(tmp_path: Path) -> Path:
    """Finished runs of figure 5 and of one family, with made-up scores."""
    folder = tmp_path / "runs"
    for name in ("step", *paper_figures.with_halton(paper_figures.PLANES)):
        (folder / name).mkdir(parents=True)
        rows = scores(name, name.removesuffix(paper_figures.HALTON))
        evaluation.write_metrics(folder / name / "metrics.csv", rows)
        history = [(1, 0.5, 10.4), (2, 0.25, 20.6)]
        evaluation.write_csv(folder / name / "history.csv", evaluation.HISTORY_COLUMNS, history)
        versions = {"setting": "small", "device": "x86_64", "threads": 1}
        (folder / name / "versions.json").write_text(json.dumps(versions))
    return folder


@pytest.fixture
def metrics(tmp_path: Path) -> Metrics:
    """All that the 1D figures need, with made-up scores."""
    for name in (*paper_figures.FAMILIES, *paper_figures.LOSSES.values(), *paper_figures.WINDOWS.values()):
        datas = paper_figures.FAMILIES if name.startswith("families") else (name,)
        if name in paper_figures.WINDOWS.values():
            datas = ("gaussian",)
        rows = [score for data in datas for score in scores(name, data)]
        evaluation.write_metrics(tmp_path / f"{name}.csv", rows)
    return Metrics(tmp_path)


@pytest.fixture
def page(tmp_path: Path) -> Path:
    page = tmp_path / "paper.md"
    shutil.copyfile(figures.PAGE, page)
    return page


def test_other_runs_keep_their_training_times(runs_folder: Path, tmp_path: Path) -> None:
    paper = tmp_path / "paper"
    figures.collect(runs_folder, paper)
    before = (paper / figures.TRAINING).read_text()
    for run in runs_folder.iterdir():
        if run.name != "step":
            shutil.rmtree(run)
    history = [(1, 0.5, 33.0)]
    evaluation.write_csv(runs_folder / "step" / "history.csv", evaluation.HISTORY_COLUMNS, history)
    assert figures.collect(runs_folder, paper) == ["step"]
    after = (paper / figures.TRAINING).read_text()
    assert after == before.replace("step,small,x86_64,1,2,21", "step,small,x86_64,1,1,33")
    assert after.count("\n") == 6


def test_one_command_draws_what_there_are_numbers_for(
    runs_folder: Path, page: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paper = tmp_path / "paper"
    options = ["--paper", str(paper), "--page", str(page)]
    assert figures.main([*options, "--runs", str(runs_folder)]) == 0
    said = capsys.readouterr().out
    assert "drew figure-5\n" in said
    assert "figure-6: not drawn, lacks teapot-diffuse" in said
    assert [path.stem for path in paper.glob("*.svg")] == ["figure-5"]
    assert "| plane-ggx: T, Halton | 2.08 | 2.16 | 2.32 |" in page.read_text()
    training = (paper / figures.TRAINING).read_text().splitlines()
    assert training[1] == "step,small,x86_64,1,2,21"
    assert "![figure-5](paper/figure-5.svg)" in page.read_text()
    assert figures.main([*options, "--check"]) == 0

    chart, table, csv = paper / "figure-5.svg", page.read_text(), paper / "plane-ggx.csv"
    drawn, numbers = chart.read_text(), csv.read_text()
    chart.write_text(drawn.replace("Halton", "Sobol", 1))
    assert figures.main([*options, "--check"]) == 1
    chart.write_text(drawn)
    page.write_text(table.replace("| 2.08 |", "| 0.08 |", 1))
    assert figures.main([*options, "--check"]) == 1
    page.write_text(table)
    csv.write_text(numbers.replace("T,8,0.25", "T,8,0.35"))
    assert csv.read_text() != numbers
    assert figures.main([*options, "--check"]) == 1
    csv.write_text(numbers)
    (paper / "windows.svg").write_text("<svg/>")
    assert figures.main([*options, "--check"]) == 1
    (paper / "windows.svg").unlink()
    assert figures.main([*options, "--check"]) == 0


def test_1d_figures_show_every_method(metrics: Metrics) -> None:
    families = paper_figures.figure_3(metrics)
    assert [panel.title for panel in families] == list(paper_figures.FAMILIES)
    assert all(len(panel.curves) == len(METHODS) + 1 for panel in families)  # T twice
    assert len(paper_figures.figure_4(metrics)[0].curves) == 5
    assert len(paper_figures.table_4(metrics).splitlines()) == 6
    assert len(paper_figures.figure_windows(metrics)[0].curves) == 5
    assert "| step: T′, trained on all three | 2.08 | 2.16 | 2.32 | 2.64 |" in paper_figures.table_3(metrics)
    assert "| M = 16 | 2.08 |" in paper_figures.table_windows(metrics)


def test_the_committed_page_is_what_its_tables_give() -> None:
    assert figures.main(["--check"]) == 0


def test_bad_tables_are_named(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(UserError, match="x.csv: expected the columns name,data,method"):
        Metrics(tmp_path).rows("x")
    evaluation.write_metrics(path, [])
    with pytest.raises(UserError, match="x.csv: no rows of method 'T' on 'step'"):
        Metrics(tmp_path).points("x", "step", "T")
    with pytest.raises(UserError, match="no finished run"):
        figures.collect(tmp_path, tmp_path)
    with pytest.raises(UserError, match="expected one pair of markers <!-- a -->"):
        figures.replace_block("<!-- a -->", "a", "", path)


def test_charts_are_the_same_bytes(tmp_path: Path) -> None:
    panels = [charts.Panel("x", [charts.Curve("S", paper_figures.S, [8, 16], [0.2, 0.1])])]
    for name in ("a.svg", "b.svg"):
        charts.draw(panels, tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_every_figure_has_configs() -> None:
    known = {path.stem for path in (Path(__file__).parents[1] / "configs").glob("*.toml")}
    assert set(paper_figures.EXPERIMENTS) <= known


def test_publishing_copies_weights_and_says_how_they_score(runs_folder: Path, tmp_path: Path) -> None:
    folder, paper = tmp_path / "weights", tmp_path / "paper"
    folder.mkdir()
    page = tmp_path / "README.md"
    page.write_text("a\n<!-- networks -->\n<!-- end of networks -->\nb\n")
    figures.collect(runs_folder, paper)
    config = 'name = "step"\n\n# The small setting was used.\n'
    provenance = Provenance("family:step", "8..64", "L2", 3, 1, config)
    weights.save(runs_folder / "step" / "step.safetensors", Mlp(8, [5, 4]), provenance)
    options = ["--weights", str(folder), "--page", str(page), "--paper", str(paper)]
    assert publish.main([str(runs_folder), "step", *options]) == 0
    readme = page.read_text()
    row = "| `step` | family:step | 8-5-4-1 | L2 | 3 | small | step | 2.08 | 2.16 | 2.32 |"
    assert row in readme and readme.startswith("a\n") and readme.endswith("\nb\n")
    assert publish.main([str(runs_folder), "step", "gaussian", *options]) == 1  # has no weights

    assert publish.main(["--check", *options]) == 0
    for old, new in (("| 2.16 |", "| 2.17 |"), ("| small |", "| paper |")):
        page.write_text(readme.replace(old, new))
        assert publish.main(["--check", *options]) == 1
        assert publish.main(options) == 0 and page.read_text() == readme


def test_the_committed_table_of_networks_is_what_their_files_give() -> None:
    assert publish.main(["--check"]) == 0


def test_pictures_of_a_run(
    fake_nst: Path, settings: RendersData, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run on the stand-in's renderings, from training to error maps."""
    out, npz = tmp_path / "run", tmp_path / "p.npz"
    lines = ['name = "box"', "seed = 1", "window = 8", "hidden = [4]", 'inputs = "whitened"']
    lines += ['start = "input"', 'loss = "L1"', "epsilon = 1e-2", "epochs = 2", "batch_size = 9"]
    lines += ["learning_rate = 1e-3", "terms_per_step = 2", "[data]"]
    data = vars(settings) | {"terms": 33}
    lines += [f"{key} = {json.dumps(value)}" for key, value in data.items()]
    (tmp_path / "box.toml").write_text("\n".join(lines))
    runs.run(configs.load(tmp_path / "box.toml"), out)
    _, metadata = weights.load(out / "box.safetensors")
    assert metadata["sampler"] == "random"
    assert json.loads((out / "versions.json").read_text())["nst"] == "nst 9.9.9"

    assert pictures.main([str(out), "--maps", str(tmp_path), "--npz", str(npz)]) == 0
    for name in ("box-S.png", "box-T.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    found = np.load(npz)
    assert found["n"].tolist() == [8, 16, 32]
    assert found["S"].shape == found["T"].shape == (3, 1, 3, 5, 3)
    assert found["I"].shape == (3, 5, 3)
    # Column x is x + 1; row 0 has no noise, so it keeps S.
    np.testing.assert_allclose(found["I"][:, :, 1], np.tile(np.arange(1.0, 6.0), (3, 1)), atol=0.05)
    np.testing.assert_array_equal(found["T"][:, :, 0], found["S"][:, :, 0])
    assert np.abs(found["S"][0] - found["I"]).max() < 6 * DEVIATION / np.sqrt(8)
    assert pictures.main([str(tmp_path), "--maps", str(tmp_path)]) == 1
    assert "not the folder of a run" in capsys.readouterr().err
