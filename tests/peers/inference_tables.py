"""The tables of docs/performance.md, from the CSV files beside it alone.

    python tests/peers/inference_tables.py            # rewrites them
    python tests/peers/inference_tables.py --check    # exit code 1 if they would change

`inference.py`, tools/measure-transform and tools/measure-guard write those files.
"""

import argparse
import csv
import re
import statistics
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
Row = dict[str, str]


def read(name: str) -> list[Row]:
    with (DOCS / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def jobs(rows: list[Row]) -> dict[tuple[str, int], dict[str, Row]]:
    """Rows by network and lanes, then by backend; of the GPU, by kernel and precision."""
    table: dict[tuple[str, int], dict[str, Row]] = {}
    for row in rows:
        name = row["backend"]
        if name == "gpu":
            name = ", ".join(row["adapter"].split(", ")[-2:])
        shape = f"{row['layers']}×{row['hidden']}"
        table.setdefault((shape, int(row["lanes"])), {})[name] = row
    return table


def ms(row: Row) -> float:
    return float(row["milliseconds"])


def digits(x: float) -> str:
    """Three of them, or all before the point."""
    return f"{x:.3g}" if x < 100 else f"{x:,.0f}"


def table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def cpu() -> str:
    head = ["network", "lanes", "nst ms", "GFLOP/s", "of gemm", "ONNX Runtime ms", "ratio"]
    head += ["PyTorch ms", "ratio"]
    rows = []
    for (shape, lanes), by in jobs(read("inference.csv")).items():
        ours, cells = by["cpu"], [shape, f"{lanes:,}"]
        share = f"{float(ours['share_of_peak']):.2f}"
        cells += [digits(ms(ours)), f"{float(ours['gflops']):.0f}", share]
        for peer in ("onnxruntime", "pytorch"):
            cells += [digits(ms(by[peer])), f"{ms(by[peer]) / ms(ours):.2f}"]
        rows.append(cells)
    return table(head, rows)


def floors() -> str:
    head = ["network", "lanes", "nst ms", "floor by arithmetic ms", "by bytes ms"]
    rows = [
        [shape, f"{lanes:,}"] + [digits(ms(by[name])) for name in ("cpu", "gemm", "copy")]
        for (shape, lanes), by in jobs(read("inference.csv")).items()
    ]
    return table(head, rows)


def lavapipe() -> str:
    names = ["tiled, f32", "naive, f32", "tiled, f16"]
    head = ["network", "tiled, GFLOP/s", "naive", "ratio", "tiled, weights in f16"]
    head += ["Burn, GFLOP/s", "ratio"]

    def rate(row: Row) -> str:
        return f"{float(row['gflops']):.1f}"

    rows = []
    for (shape, _), by in jobs(read("inference-lavapipe.csv")).items():
        tiled, naive, half = (by[name] for name in names)
        rows.append(
            [
                *(shape, rate(tiled), rate(naive), f"{ms(naive) / ms(tiled):.1f}", rate(half)),
                *(rate(by["burn"]), f"{ms(by['burn']) / ms(tiled):.1f}"),
            ]
        )
    return table(head, rows)


def transform() -> str:
    rows = read("transform.csv")

    def median(asked: str, key: str) -> float:
        return statistics.median(float(row[key]) for row in rows if row["asked"] == asked)

    without = median("none", "wall_seconds")
    shown = [("none", "wall_seconds", "`--transform none`, the whole process")]
    for asked in sorted({row["asked"] for row in rows} - {"none"}):
        shown.append((asked, "wall_seconds", f"`--transform {asked}`, the whole process"))
        shown.append((asked, "transform_seconds", "of it, the transformation"))
    lines = []
    for asked, key, what in shown:
        share = 100 * median(asked, key) / without
        lines.append([what, f"{median(asked, key):.3f}", f"{share:.1f}"])
    return table(["`nst render`, Cornell box, 64 spp", "seconds", "%"], lines)


def guard() -> str:
    """What is not measured yet has no rows."""
    head = ["options", "seconds", "more, %", "tracing", "transformation", "files"]
    head += ["user seconds", "more, %", "peak MiB"]
    rows = read("guard-cost.csv") if (DOCS / "guard-cost.csv").exists() else []
    options = {
        "none": "`--transform none`",
        "auto": "`--transform auto --experts lane`",
        "none, features": "`--transform none --features`",
        "auto, filter": "`--transform auto --experts lane,filter`",
    }

    def median(asked: str, key: str) -> float:
        return statistics.median(float(row[key]) for row in rows if row["asked"] == asked)

    def more(asked: str, key: str, of: str) -> str:
        return f"{100 * (median(asked, key) - median('none', key)) / median('none', of):.1f}"

    lines = []
    for asked, shown in options.items():
        if all(row["asked"] != asked for row in rows):
            continue
        total, user, peak = (
            median(asked, key) for key in ("total_seconds", "user_seconds", "peak_mebibytes")
        )
        parts = [
            more(asked, f"{part}_seconds", "total_seconds") for part in ("total", "render", "transform", "io")
        ]
        cells = [f"{user:.3f}", more(asked, "user_seconds", "user_seconds"), f"{peak:.0f}"]
        lines.append([shown, f"{total:.3f}", *parts, *cells])
    return table(head, lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="change nothing")
    check = parser.parse_args().check
    path = DOCS / "performance.md"
    old = path.read_text(encoding="utf-8")
    new = old
    for make in (cpu, floors, lavapipe, transform, guard):
        begin, end = f"<!-- {make.__name__} -->\n", f"<!-- end of {make.__name__} -->"
        pattern = re.compile(f"(?<={re.escape(begin)}).*?(?={re.escape(end)})", re.DOTALL)
        made = make() + "\n"
        new, count = pattern.subn(lambda _, made=made: made, new)
        if count != 1:
            sys.exit(f"{path}: expected {begin.strip()} … {end} once")
    if not check:
        path.write_text(new, encoding="utf-8")
    elif new != old:
        sys.exit(f"{path} is not what the CSV files say; run {Path(__file__).name}")


if __name__ == "__main__":
    main()
