"""The metrics of finished runs for charts and tables: one CSV file for each network."""

import csv
from pathlib import Path

from nst_train.charts import Curve, Style
from nst_train.errors import UserError
from nst_train.evaluation import COLUMNS


class Metrics:
    """The CSV files of a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.read: dict[str, list[dict[str, str]]] = {}

    def rows(self, name: str, columns: list[str] = COLUMNS) -> list[dict[str, str]]:
        """All rows of NAME.csv."""
        if name not in self.read:
            self.read[name] = read_csv(self.folder / f"{name}.csv", columns)
        return self.read[name]

    def points(self, name: str, data: str, method: str) -> dict[int, dict[str, str]]:
        """Rows by n."""
        rows = self.rows(name)
        found = [row for row in rows if row["data"] == data and row["method"] == method]
        if not found:
            path = self.folder / f"{name}.csv"
            raise UserError(f"{path}: no rows of method '{method}' on '{data}'; evaluate it again")
        return {int(row["n"]): row for row in found}

    def curve(self, label: str, style: Style, name: str, data: str, method: str) -> Curve:
        """MSE against n."""
        points = self.points(name, data, method)
        return Curve(label, style, list(points), [float(row["mse"]) for row in points.values()])

    def ratio(self, name: str, data: str, method: str, n: int) -> str:
        """A cell of a table; a dash where this n is missing."""
        row = self.points(name, data, method).get(n)
        return digits(float(row["mse_ratio"])) if row else "–"


def read_csv(path: Path, columns: list[str]) -> list[dict[str, str]]:
    """The rows of a CSV file, whose header is checked."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            if reader.fieldnames != columns:
                raise UserError(f"{path}: expected the columns {','.join(columns)}")
            return list(reader)
    except OSError as error:
        raise UserError(f"{path}: cannot read the metrics: {error.strerror}") from error


def digits(x: float) -> str:
    """A number with three digits."""
    return f"{x:.3f}" if 0.1 <= x < 1 else f"{x:.3g}" if x < 1000 else f"{x:.0f}"
