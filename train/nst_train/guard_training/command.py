"""The command `guard`: trains, scores and exports the network that corrects the guard's weights."""

import argparse
from pathlib import Path

import torch

from nst_train import evaluation, weights
from nst_train.errors import UserError, exit_code
from nst_train.guard_training import data, descent, scores, settings, studies
from nst_train.guard_training.data import Item, scenes_of
from nst_train.guard_training.settings import Settings
from nst_train.random_scenes import BRANCHES


def say(line: str) -> None:
    print(line, flush=True)


def run(config: Settings, items: list[Item], folder: Path, out: Path) -> None:
    """Writes the weights, scores and losses to `out`."""
    say(f"{config.name}: {len(scenes_of(items))} scenes, {len(items)} pictures and lists of experts")
    model, losses = descent.train(config, items, say)
    evaluation.write_csv(out / "history.csv", ["step", "loss"], enumerate(losses, 1))
    path = out / f"{config.name}.safetensors"
    weights.save(path, model, provenance(config, items))
    say(f"wrote {path}")
    found = scores.score({"network": model}, folder, config)
    evaluation.write_csv(out / "metrics.csv", scores.COLUMNS, (score.row() for score in found))
    say("\n".join(scores.lines(found)))


def claim(out: Path, config: Settings) -> None:
    """Makes the folder, or refuses one with a run of another config."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / "config.toml"
    if path.is_file() and path.read_text(encoding="utf-8") != config.text:
        raise UserError(
            f"{path}: {out} contains a run of another config; give another --out, or delete that folder"
        )
    path.write_text(config.text, encoding="utf-8")


def provenance(config: Settings, items: list[Item]) -> weights.Provenance:
    counts = [item.spp for item in items]
    families = sorted({item.family for item in items})
    return weights.Provenance(
        trained_on=",".join(f"random:{name}" if name in BRANCHES else f"other:{name}" for name in families),
        samples=f"{min(counts)}..{max(counts)}",
        loss="guard",
        epochs=max(1, round(config.steps * config.batch_size / len(items))),
        seed=config.seed,
        config=config.text,
    )


def main(argv: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m nst_train guard", description="Trains the network that corrects the guard's weights."
    )
    parser.add_argument(
        "--folder", type=Path, required=True, metavar="DIR", help="that of guard-data and guard-tables"
    )
    parser.add_argument("--config", type=Path, required=True, help="a TOML file, configs/guard/guard.toml")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="where the weights and scores go")
    parser.add_argument(
        "--curve",
        type=Path,
        metavar="FILE.csv",
        help=f"instead or as well: scores after {', '.join(map(str, studies.CURVE))} and all scenes",
    )
    parser.add_argument(
        "--ablations",
        type=Path,
        metavar="FILE.csv",
        help="the same: scores of networks of other sizes, losses and seeds, and without some inputs",
    )
    arguments = parser.parse_args(argv)
    if not (arguments.out or arguments.curve or arguments.ablations):
        parser.error("give --out, --curve, --ablations, or several of them")

    def work() -> None:
        config = settings.load(arguments.config)
        if arguments.out:
            claim(arguments.out, config)
        torch.set_num_threads(1)  # it is small
        items = data.load(arguments.folder, config)
        if arguments.out:
            run(config, items, arguments.folder, arguments.out)
        if arguments.curve:
            studies.curve(config, items, arguments.folder, arguments.curve, say)
        if arguments.ablations:
            studies.ablations(config, items, arguments.folder, arguments.ablations, say)

    return exit_code(work)
