"""The command `guard-data`: see the package."""

import argparse
from pathlib import Path

from nst_train.errors import UserError, exit_code
from nst_train.guard_data.make import BUDGET, make
from nst_train.guard_data.plan import order


def main(argv: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m nst_train guard-data",
        description="Pictures to train a network on that weighs the guard's experts. "
        "What is there is kept: the same command continues.",
    )
    parser.add_argument(
        "--folder", type=Path, required=True, metavar="DIR", help="a folder per scene goes here"
    )
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="families, or scenes")
    parser.add_argument(
        "--budget",
        type=float,
        default=BUDGET,
        metavar="SECONDS",
        help=f"of processor time that a scene may take [default: {BUDGET:.0f}]",
    )
    arguments = parser.parse_args(argv)

    def work() -> None:
        plans = [plan for plan, _ in order()]
        unknown = set(arguments.only) - {name for plan in plans for name in (plan.family, plan.name)}
        if unknown:
            raise UserError(f"--only: no family or scene is called {', '.join(sorted(unknown))}")
        make(
            arguments.folder,
            arguments.only,
            budget=arguments.budget,
            say=lambda line: print(line, flush=True),
        )

    return exit_code(work)
