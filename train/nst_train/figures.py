"""Charts and tables of docs/paper.md, from the metrics in docs/paper/*.csv.

    python -m nst_train.figures                 # rewrite what docs/paper/*.csv gives
    python -m nst_train.figures --check         # compare instead; exit code 1 on a difference
    python -m nst_train.figures --runs runs     # first copy runs/NAME/metrics.csv to docs/paper/NAME.csv,
                                                # and how long each trained to docs/paper/training.csv

A figure is drawn once the networks that it needs have their CSV.
"""

import argparse
import json
import re
import shutil
import sys
import tempfile
from pathlib import Path

from nst_train.charts import draw
from nst_train.errors import UserError
from nst_train.evaluation import COLUMNS, HISTORY_COLUMNS, write_csv
from nst_train.metrics import Metrics, read_csv
from nst_train.paper_figures import EXPERIMENTS, FIGURES
from nst_train.renders import REPOSITORY

PAPER = REPOSITORY / "docs" / "paper"
PAGE = REPOSITORY / "docs" / "paper.md"
TRAINING = "training.csv"
TRAINING_COLUMNS = ["name", "setting", "device", "threads", "epochs", "seconds"]


def collect(runs: Path, paper: Path) -> list[str]:
    """Copies the metrics of finished runs, and returns their names."""
    names = [name for name in EXPERIMENTS if (runs / name / "metrics.csv").is_file()]
    if not names:
        raise UserError(f"{runs}: no finished run of an experiment in it, such as gaussian/metrics.csv")
    paper.mkdir(parents=True, exist_ok=True)
    for name in names:
        read_csv(runs / name / "metrics.csv", COLUMNS)
        shutil.copyfile(runs / name / "metrics.csv", paper / f"{name}.csv")
    rows = {row["name"]: list(row.values()) for row in known(paper / TRAINING)}
    rows |= {name: training_row(runs / name) for name in names}
    write_csv(paper / TRAINING, TRAINING_COLUMNS, [rows[name] for name in EXPERIMENTS if name in rows])
    return names


def known(table: Path) -> list[dict[str, str]]:
    """The rows of runs that were copied before."""
    return read_csv(table, TRAINING_COLUMNS) if table.is_file() else []


def training_row(run: Path) -> list[object]:
    """How long a run trained, in what setting, and on what."""
    last = read_csv(run / "history.csv", HISTORY_COLUMNS)[-1]
    try:
        versions = json.loads((run / "versions.json").read_text(encoding="utf-8"))
        described = [versions[key] for key in ("setting", "device", "threads")]
    except (OSError, ValueError, KeyError) as error:
        raise UserError(f"{run / 'versions.json'}: cannot read it; train again: {error}") from error
    return [run.name, *described, last["epoch"], round(float(last["seconds"]))]


def replace_block(text: str, name: str, content: str, path: Path) -> str:
    """`text` with other lines between `<!-- NAME -->` and `<!-- end of NAME -->`."""
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    replaced, count = pattern.subn(lambda _: f"{begin}{content}\n{end}", text)
    if count != 1:
        raise UserError(f"{path}: expected one pair of markers {begin.strip()} … {end}")
    return replaced


def make(paper: Path, page: str, svgs: Path) -> tuple[str, list[str], list[str]]:
    """Draws into `svgs`, and returns the page with its tables, the figures drawn, and those that lack
    a CSV."""
    metrics = Metrics(paper)
    drawn, lacking = [], []
    for name, figure in FIGURES.items():
        if missing := [need for need in figure.needs if not (paper / f"{need}.csv").is_file()]:
            lacking.append(f"{name}: not drawn, lacks {', '.join(missing)}")
            page = replace_block(page, name, "Not measured yet.", PAGE)
            continue
        draw(figure.panels(metrics), svgs / f"{name}.svg")
        table = figure.table(metrics)
        page = replace_block(page, name, f"![{name}](paper/{name}.svg)\n\n{table}", PAGE)
        drawn.append(name)
    return page, drawn, lacking


def check(paper: Path, page_path: Path) -> None:
    """Raises an error where an SVG or a table is not the one that the CSV files give."""
    page = page_path.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        made, drawn, _ = make(paper, page, Path(folder))
        stored = sorted(path.stem for path in paper.glob("*.svg"))
        if stored != sorted(drawn):
            raise UserError(f"{paper}: contains {stored}, but its CSV files give {sorted(drawn)}")
        for name in drawn:
            path = paper / f"{name}.svg"
            if path.read_bytes() != (Path(folder) / path.name).read_bytes():
                raise UserError(f"{path}: not what the CSV files give; run nst_train.figures")
    if made != page:
        raise UserError(f"{page_path}: a table is not what the CSV files give; run nst_train.figures")


def main(argv: list[str] | None = None) -> int:
    """`argv` is for tests; without it, the command line. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m nst_train.figures", description=__doc__)
    parser.add_argument("--runs", type=Path, metavar="FOLDER", help="copy metrics from here first")
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    parser.add_argument("--paper", type=Path, default=PAPER, help="[default: docs/paper]")
    parser.add_argument("--page", type=Path, default=PAGE, help="[default: docs/paper.md]")
    a = parser.parse_args(argv)
    try:
        if a.check:
            check(a.paper, a.page)
            return 0
        if a.runs:
            print(f"copied the metrics of {', '.join(collect(a.runs, a.paper))}")
        a.paper.mkdir(parents=True, exist_ok=True)
        page, drawn, lacking = make(a.paper, a.page.read_text(encoding="utf-8"), a.paper)
        a.page.write_text(page, encoding="utf-8")
        print("\n".join([f"drew {', '.join(drawn) or 'nothing'}", *lacking]))
    except (UserError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
