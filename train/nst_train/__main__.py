"""`python -m nst_train CONFIG … --out FOLDER`: trains, scores and exports networks.

`python -m nst_train guard-data --folder DIR` makes the pictures for one that weighs the guard's experts,
`guard-tables --folder DIR` what is learnt from them, and `guard --folder DIR …` trains it.
"""

import argparse
import sys
from pathlib import Path

import torch

from nst_train import config as configs
from nst_train import runs
from nst_train.errors import UserError, exit_code
from nst_train.guard_data import command as guard_data
from nst_train.guard_training import command as guard
from nst_train.guard_training import make as guard_tables

COMMANDS = {"guard-data": guard_data.main, "guard-tables": guard_tables.main, "guard": guard.main}
"""All but training by a config alone."""


def main(argv: list[str] | None = None) -> int:
    """`argv` is for tests; without it, the command line. Returns the exit code."""
    words = sys.argv[1:] if argv is None else argv
    if words and words[0] in COMMANDS:
        return COMMANDS[words[0]](words[1:])
    parser = argparse.ArgumentParser(prog="python -m nst_train", description=__doc__)
    parser.add_argument("config", type=Path, nargs="+", help="TOML files, for instance configs/gaussian.toml")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FOLDER",
        help="where results go; with several configs, each into FOLDER/NAME. "
        "What is there of an interrupted run is continued",
    )
    parser.add_argument("--small", action="store_true", help="the setting for two CPU cores, not the paper's")
    parser.add_argument("--device", choices=["auto", "cpu", "cuda"], default="auto", help="[default: auto]")
    arguments = parser.parse_args(words)
    setting = "small" if arguments.small else "paper"

    def work() -> None:
        device = choose_device(arguments.device)
        chosen = [configs.load(path, setting) for path in arguments.config]
        several = len(chosen) > 1
        names = [config.name for config in chosen]
        if len(set(names)) < len(names):
            raise UserError("two of the configs have the same name")
        for config in chosen:
            runs.run(config, arguments.out / config.name if several else arguments.out, device)

    return exit_code(work)


def choose_device(wanted: str) -> str:
    """`cpu` or `cuda`."""
    available = torch.cuda.is_available()
    if wanted == "cuda" and not available:
        raise UserError(
            "--device cuda: PyTorch finds no CUDA device here; use --device cpu, or install a "
            "driver and a build of PyTorch for it"
        )
    return "cuda" if wanted != "cpu" and available else "cpu"


if __name__ == "__main__":
    sys.exit(main())
