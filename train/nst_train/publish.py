"""Copies the weights of finished runs to crates/nst-core/weights, and rewrites the table in
weights/README.md.

    python -m nst_train.publish runs gaussian step plane-lambert …
    python -m nst_train.publish            # copies none: only the table
    python -m nst_train.publish --check    # compares the table instead; exit code 1 on a difference

The table's numbers are those of docs/paper/NAME.csv, which `nst_train.figures --runs` copies.
"""

import argparse
import re
import shutil
import sys
from pathlib import Path

from nst_train import weights
from nst_train.errors import UserError
from nst_train.figures import PAPER, replace_block
from nst_train.metrics import Metrics
from nst_train.renders import REPOSITORY

WEIGHTS = REPOSITORY / "crates" / "nst-core" / "weights"
PAGE = REPOSITORY / "weights" / "README.md"
TABLE = "networks"
NS = (8, 16, 32, 64)
SETTING = re.compile(r"^# The (\w+) setting was used\.$", re.MULTILINE)


def copy(runs: Path, names: list[str], folder: Path) -> None:
    """All of them or, if one is missing or damaged, none."""
    for name in names:
        weights.load(runs / name / f"{name}.safetensors")
    for name in names:
        shutil.copyfile(runs / name / f"{name}.safetensors", folder / f"{name}.safetensors")


def table(folder: Path, paper: Path) -> str:
    """One row per network and held-out set."""
    metrics = Metrics(paper)
    lines = [
        "| name | trained on | widths | loss | epochs | setting | scored on | "
        + " | ".join(f"n = {n}" for n in NS)
        + " |",
        "|---" * (7 + len(NS)) + "|",
    ]
    for path in sorted(folder.glob("*.safetensors")):
        model, metadata = weights.load(path)
        widths = "-".join(str(layer.in_features) for layer in model.layers)
        widths += f"-{model.layers[-1].out_features}"
        setting = SETTING.search(metadata["config"])
        trained_on = metadata["trained_on"].replace(",", ", ")
        if "sampler" in metadata:
            trained_on += f", {metadata['sampler']}"
        network = f"| `{path.stem}` | {trained_on} | {widths} | {metadata['loss']} | "
        network += f"{metadata['epochs']} | {setting[1] if setting else '–'} | "
        scored = [None]
        if (paper / f"{path.stem}.csv").is_file():
            scored = list(dict.fromkeys(row["data"] for row in metrics.rows(path.stem)))
        for data in scored:
            cells = ["–"] * len(NS)
            if data is not None:
                cells = [metrics.ratio(path.stem, data, "T", n) for n in NS]
            lines.append(f"{network}{data or '–'} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> int:
    """`argv` is for tests; without it, the command line. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m nst_train.publish", description=__doc__)
    parser.add_argument("runs", type=Path, nargs="?", help="folder of run folders")
    parser.add_argument("names", nargs="*", help="networks to copy; without any, only the table")
    parser.add_argument("--check", action="store_true", help="copy and write nothing, compare the table")
    parser.add_argument("--weights", type=Path, default=WEIGHTS, help="[default: crates/nst-core/weights]")
    parser.add_argument("--page", type=Path, default=PAGE, help="[default: weights/README.md]")
    parser.add_argument("--paper", type=Path, default=PAPER, help="[default: docs/paper]")
    a = parser.parse_args(argv)
    try:
        if not a.check:
            copy(a.runs, a.names, a.weights)
        text = a.page.read_text(encoding="utf-8")
        made = replace_block(text, TABLE, table(a.weights, a.paper), a.page)
        if a.check:
            if made != text:
                raise UserError(f"{a.page}: not what the networks and {a.paper} give; run nst_train.publish")
            return 0
        a.page.write_text(made, encoding="utf-8")
    except (UserError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(f"{len(a.names)} networks copied; add new ones to crates/nst-core/src/network/builtin.rs")
    return 0


if __name__ == "__main__":
    sys.exit(main())
