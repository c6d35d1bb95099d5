"""The check of the tables of docs/performance.md refuses another page and other measurements."""

import shutil
from pathlib import Path

import pytest

import inference_tables


@pytest.fixture
def docs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the page and its CSV files, which the script takes for its own."""
    for path in inference_tables.DOCS.glob("*.csv"):
        shutil.copy(path, tmp_path)
    shutil.copy(inference_tables.DOCS / "performance.md", tmp_path)
    monkeypatch.setattr(inference_tables, "DOCS", tmp_path)
    return tmp_path


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.setattr("sys.argv", ["inference_tables.py", *arguments])
    inference_tables.main()


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("performance.md", "| 2×32 | 1,024 | ", "| 2×32 | 1,025 | "),
        ("inference.csv", "cpu,avx2,2,32,1024,", "cpu,avx2,2,32,1024,1"),
        ("inference-lavapipe.csv", 'naive, f32",2,32,2048,', 'naive, f32",2,32,2048,1'),
        ("transform.csv", "0,none,none,cpu,", "0,none,none,cpu,9"),
    ],
)
def test_a_change_is_noticed(
    docs: Path, monkeypatch: pytest.MonkeyPatch, name: str, old: str, new: str
) -> None:
    run(monkeypatch, "--check")
    text = (docs / name).read_text(encoding="utf-8")
    assert old in text
    (docs / name).write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(SystemExit, match=r"performance\.md is not what the CSV files say"):
        run(monkeypatch, "--check")
    run(monkeypatch)  # rewrites the tables
    run(monkeypatch, "--check")


def test_a_page_without_its_markers_is_refused(docs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = docs / "performance.md"
    text = page.read_text(encoding="utf-8")
    page.write_text(text.replace("<!-- end of cpu -->", ""), encoding="utf-8")
    with pytest.raises(SystemExit, match="expected <!-- cpu -->"):
        run(monkeypatch)


def test_the_cost_of_the_guard(docs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = ["asked", "render", "transform", "io", "total", "user", "peak_mebibytes"]
    head = ",".join(name if name in (names[0], names[-1]) else f"{name}_seconds" for name in names)
    rows = ["none,4,0,1,5,8,100", "auto,4.2,0.1,1.05,5.35,8.8,123.4", '"none, features",4,0,2,6,8,90']
    rows += ["none,9,9,9,9,9,900", "none,1,0,1,1,1,1"]
    measured = docs / "guard-cost.csv"
    measured.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    run(monkeypatch)
    page = (docs / "performance.md").read_text(encoding="utf-8")
    for cells in (
        "`--transform none` | 5.000 | 0.0 | 0.0 | 0.0 | 0.0 | 8.000 | 0.0 | 100",
        "`--transform auto --experts lane` | 5.350 | 7.0 | 4.0 | 2.0 | 1.0 | 8.800 | 10.0 | 123",
        "`--transform none --features` | 6.000 | 20.0 | 0.0 | 0.0 | 20.0 | 8.000 | 0.0 | 90",
    ):
        assert f"| {cells} |" in page
    run(monkeypatch, "--check")
    measured.write_text(measured.read_text(encoding="utf-8").replace("5.35", "5.36"), encoding="utf-8")
    with pytest.raises(SystemExit, match=r"performance\.md is not what the CSV files say"):
        run(monkeypatch, "--check")
