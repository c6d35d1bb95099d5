"""`python -m nst_train CONFIG --out FOLDER`: trains, scores and exports one network."""

import argparse
import sys
import time
from pathlib import Path

from nst_train import config as configs
from nst_train import families, renders, weights
from nst_train.errors import UserError
from nst_train.evaluation import Score, evaluate, write_metrics
from nst_train.sequences import Data
from nst_train.training import make_model, train


def main(argv: list[str] | None = None) -> int:
    """`argv` is for tests; without it, the command line. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m nst_train", description=__doc__)
    parser.add_argument("config", type=Path, help="TOML file, for instance configs/families.toml")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="where results go")
    arguments = parser.parse_args(argv)
    try:
        run(configs.load(arguments.config), arguments.out)
    except (UserError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def run(config: configs.Config, out: Path) -> None:
    """Leaves NAME.safetensors, metrics.csv and config.toml in `out`."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "config.toml").write_text(config.text, encoding="utf-8")

    data = load_data(config, out)
    count, runs, terms = data.training.estimates.shape
    print(f"{config.name}: {count} integrands, {runs} runs, {terms} terms")

    model = make_model(config)
    start = time.perf_counter()
    loss = 0.0
    for epoch, loss in enumerate(train(model, data.training, config), start=1):
        if epoch % max(1, config.epochs // 20) == 0 or epoch in (1, config.epochs):
            seconds = time.perf_counter() - start
            print(f"epoch {epoch}/{config.epochs}  loss {loss:.5g}  {seconds:.1f} s", flush=True)

    scores = evaluate(model, data)
    print_scores(scores)
    write_metrics(out / "metrics.csv", config.name, scores, loss)
    provenance = weights.Provenance(
        trained_on=data.trained_on,
        samples=f"{config.window}..{terms}",
        loss=config.loss,
        epochs=config.epochs,
        seed=config.seed,
        config=config.text,
    )
    path = out / f"{config.name}.safetensors"
    weights.save(path, model, provenance)
    print(f"wrote {path}")


def load_data(config: configs.Config, out: Path) -> Data:
    """Rendered runs are kept in `out` and used again."""
    if isinstance(config.data, configs.FamiliesData):
        return families.make_data(
            config.data.families, config.data.runs, config.data.terms, config.seed
        )
    return renders.make_data(config.data, cache=out / "renders")


def print_scores(scores: list[Score]) -> None:
    print("MSE of T and of a constant, as multiples of the MSE of S, on held-out data:")
    print(f"{'data':>24} {'n':>4} {'T/S':>9} {'constant/S':>11}")
    for score in scores:
        ratios = f"{score.mse_ratio:9.4f} {score.constant_mse_ratio:11.4f}"
        print(f"{score.data:>24} {score.n:>4} {ratios}")


if __name__ == "__main__":
    sys.exit(main())
