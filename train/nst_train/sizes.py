"""Error against the size of the network: trains a ladder of sizes for each of the paper's scenes, in the
small setting of its config, with the same data and the same seed.

    python -m nst_train.sizes --out runs/sizes                     # all sizes of all scenes: about 5 hours
    python -m nst_train.sizes plane-ggx --out runs/sizes --hidden 16x2 32x2
    python -m nst_train.sizes --out runs/sizes --epochs 10         # at most so many epochs
    python -m nst_train.sizes --out runs/sizes --hidden 16x2 --seed 2    # how much the seed matters

Appends to docs/sizes.csv; what is there is not trained again, and a network that was interrupted is
continued from its checkpoint in `--out`. The built-in network of a scene is scored too: it is its size's
entry for the config's epochs and seed. Two of these commands may run at the same time, for other scenes.
"""

import argparse
import csv
import io
import re
import sys
import time
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import torch

from nst_train import checkpoint, evaluation, renders, results, runs, weights
from nst_train import config as configs
from nst_train.errors import UserError, exit_code
from nst_train.metrics import read_csv
from nst_train.model import Mlp
from nst_train.paper_figures import PLANES, SCENES
from nst_train.publish import WEIGHTS
from nst_train.sequences import Data
from nst_train.training import Training

LADDER = ([16] * 2, [32] * 2, [64] * 2, [64] * 4, [128] * 4, [256] * 4)
"""Hidden widths, from a third of the smallest built-in network to the paper's."""

NS = (8, 16, 32)
"""The n of the table in weights/README.md."""

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
TABLE = renders.REPOSITORY / "docs" / "sizes.csv"


@dataclass(frozen=True)
class Row:
    """The score of one network at one n, on the held-out runs of its scene."""

    scene: str  # name of the config
    network: str  # widths of all layers, "8-16-16-1"
    parameters: int  # weights and biases
    multiply_adds: int  # for one lane
    built_in: str  # "yes" for the weights in crates/nst-core/weights
    seed: int
    epochs: int
    cpu_seconds: str  # processor time of training, all threads together; empty for built-in networks
    n: int
    mse_ratio: float  # E[(T − I)²]/E[(S − I)²]
    standard_error: float  # of mse_ratio, over the runs
    run_ratios: str  # mse_ratio as each run gives it: `run_ratios`, separated by spaces


COLUMNS = [field.name for field in fields(Row)]


def widths(model: Mlp) -> str:
    """The widths of all layers, as in "8-16-16-1"."""
    return "-".join(str(layer.in_features) for layer in model.layers) + "-1"


def run_ratios(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The ratio R = mean(t)/mean(s) of the errors of all runs, as each run gives it, `[run]`.

    R + (t − R s)/mean(s): the mean is R, and the standard error of that mean is R's, to first order
    (Cochran, Sampling Techniques, section 2.11). The difference of two networks' values, run by run,
    gives that of the difference of their ratios.
    """
    ratio = t.mean() / s.mean()
    return ratio + (t - ratio * s) / s.mean()


def standard_error(values: np.ndarray) -> float:
    """Of the mean of independent values, at least two."""
    return float(values.std(ddof=1) / np.sqrt(len(values)))


def score(name: str, config: configs.Config, model: Mlp, data: Data, seconds: float | None) -> list[Row]:
    """One row for each n; without seconds, as a built-in network."""
    (held_out,) = data.held_out.values()
    scores = []
    for n in NS:
        ratios = run_ratios(*evaluation.run_errors(model, held_out, n))
        scores.append(
            Row(
                scene=name,
                network=widths(model),
                parameters=sum(parameter.numel() for parameter in model.parameters()),
                multiply_adds=sum(layer.weight.numel() for layer in model.layers),
                built_in="yes" if seconds is None else "no",
                seed=config.seed,
                epochs=config.epochs,
                cpu_seconds="" if seconds is None else f"{seconds:.1f}",
                n=n,
                mse_ratio=float(ratios.mean()),
                standard_error=standard_error(ratios),
                run_ratios=" ".join(f"{ratio:.6g}" for ratio in ratios),
            )
        )
    return scores


def sized(
    config: configs.Config, hidden: list[int], epochs: int | None = None, seed: int | None = None
) -> configs.Config:
    """The config with another network, at most these epochs and this seed, which its text then says, too."""
    epochs, seed = min(config.epochs, epochs or config.epochs), seed or config.seed
    text = f"{config.text}\n# In the ladder of sizes: hidden = {hidden}, epochs = {epochs}, seed = {seed}\n"
    return replace(config, hidden=hidden, epochs=epochs, seed=seed, text=text)


def train(name: str, config: configs.Config, data: Data, out: Path) -> list[Row]:
    """Trains a network, or continues, and scores it as it would be stored."""
    layers = "-".join(map(str, config.hidden))
    folder = out / name / f"{layers}-epochs-{config.epochs}-seed-{config.seed}"
    runs.claim(folder, config)
    training = Training(config, data.training)
    seconds_at = checkpoint.resume(folder, training, data.trained_on)
    print(f"{name}, {layers}, {config.epochs} epochs", flush=True)
    runs.train(folder, training, data, seconds_at, time.process_time)
    model, _ = results.rounded(config, training.model.folded(), data)
    return score(name, config, model, data, seconds_at[-1])


def built_in(name: str, config: configs.Config, data: Data, folder: Path) -> list[Row]:
    """Scores the scene's committed network, which must come from this config."""
    path = folder / f"{name}.safetensors"
    model, metadata = weights.load(path)
    if metadata["trained_on"] != data.trained_on:
        raise UserError(f"{path}: trained on {metadata['trained_on']}, but the scene is {data.trained_on}")
    if metadata["epochs"] != str(config.epochs) or metadata["seed"] != str(config.seed):
        raise UserError(f"{path}: its epochs or its seed are not those of the config; train it again")
    return score(name, config, model, data, None)


def known(table: Path) -> set[tuple[str, str, int, int]]:
    """Scene, network, seed and epochs of what the table contains."""
    if not table.is_file():
        return set()
    rows = read_csv(table, COLUMNS)
    return {(row["scene"], row["network"], int(row["seed"]), int(row["epochs"])) for row in rows}


def append(table: Path, rows: list[Row]) -> None:
    """Adds rows in one piece, after a head if the file is new."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if not table.is_file():
        writer.writerow(COLUMNS)
    for row in rows:
        writer.writerow(f"{x:.6g}" if isinstance(x, float) else x for x in vars(row).values())
    with table.open("a", encoding="utf-8") as file:
        file.write(text.getvalue())


def climb(name: str, a: argparse.Namespace) -> None:
    """Trains what the table lacks of one scene's ladder, and scores its built-in network."""
    config = configs.load(a.configs / f"{name}.toml", "small")
    if not isinstance(config.data, configs.RendersData):
        raise UserError(f"{name}: not a scene; expected one of {', '.join(PLANES + SCENES)}")
    if config.data.evaluation_runs < 2:
        raise UserError(f"{name}: a standard error needs data.evaluation_runs = 2 or more")
    data = renders.make_data(config.data, cache=a.out / "renders")

    def lacks(network: configs.Config) -> bool:
        layers = "-".join(map(str, [network.window, *network.hidden, 1]))
        return (name, layers, network.seed, network.epochs) not in known(a.table)

    if lacks(config):
        append(a.table, built_in(name, config, data, a.weights))
    for hidden in a.hidden:
        network = sized(config, hidden, a.epochs, a.seed)
        if lacks(network):
            append(a.table, train(name, network, data, a.out))


def hidden_widths(text: str) -> list[int]:
    """Of "16x2": two layers of 16."""
    match = re.fullmatch(r"([1-9]\d{0,3})x([1-9]\d?)", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"'{text}': expected WIDTHxLAYERS, such as 16x2")
    return [int(match[1])] * int(match[2])


def positive(text: str) -> int:
    """A count of 1 or more."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}': expected a number of 1 or more")
    return int(text)


def main(argv: list[str] | None = None) -> int:
    """`argv` is for tests; without it, the command line. Returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m nst_train.sizes",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    everything = [*PLANES, *SCENES]
    parser.add_argument("scenes", nargs="*", help="names of configs [default: all six, random samples]")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="renderings, checkpoints")
    parser.add_argument("--hidden", type=hidden_widths, nargs="+", default=LADDER, metavar="WIDTHxLAYERS")
    parser.add_argument("--epochs", type=positive, help="at most so many [default: as the config says]")
    parser.add_argument("--threads", type=positive, default=1, help="of PyTorch [default: 1]")
    parser.add_argument("--seed", type=positive, help="another one than the config's")
    parser.add_argument("--table", type=Path, default=TABLE, help="[default: docs/sizes.csv]")
    parser.add_argument("--configs", type=Path, default=CONFIGS, help="[default: train/configs]")
    parser.add_argument("--weights", type=Path, default=WEIGHTS, help="[default: crates/nst-core/weights]")
    a = parser.parse_args(argv)
    torch.set_num_threads(a.threads)

    def work() -> None:
        for name in a.scenes or everything:
            climb(name, a)

    return exit_code(work)


if __name__ == "__main__":
    sys.exit(main())
