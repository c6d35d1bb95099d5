"""Pictures of a rendered experiment: error maps (figure 5), and the input of a denoiser (figure 7).

    python -m nst_train.pictures runs/plane-lambert --maps ../docs/paper
    python -m nst_train.pictures runs/cornell-depth-8 --npz runs/cornell-depth-8/pictures.npz

The maps are |S − I| and |T − I| at n = 32 of the first evaluation run, in false colour, both on one
scale that ends at the 99th percentile of |S − I|: NAME-S.png and NAME-T.png. The npz contains `n` [n], `S`
and `T` [n, run, y, x, color], and `I` [y, x, color], all f32.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib.image
import numpy as np
import torch

from nst_train import config as configs
from nst_train import evaluation, renders, weights
from nst_train.errors import UserError
from nst_train.sequences import Sequences

MAP_N = 32
"""The n of error maps: the last one of the rendered experiments, as in the paper's figure 5."""

DENOISED_N = (8, 16, 32)
"""The n in figure 7."""

COLOR_MAP = "magma"


@dataclass(frozen=True)
class Pictures:
    """The evaluation runs of an experiment, before and after its network."""

    name: str
    n: list[int]
    s: np.ndarray  # [n, run, y, x, color]
    t: np.ndarray
    reference: np.ndarray  # [y, x, color]


def load(folder: Path, ns: tuple[int, ...]) -> Pictures:
    """Reads a finished run's folder; lanes that are the same constant in all runs keep S."""
    setting_file = folder / "setting"
    if not setting_file.is_file():
        raise UserError(f"{folder}: not the folder of a run")
    config = configs.load(folder / "config.toml", setting_file.read_text(encoding="utf-8").strip())
    if not isinstance(config.data, configs.RendersData):
        raise UserError(f"{folder}: '{config.name}' was not trained on renderings")
    model, _ = weights.load(folder / f"{config.name}.safetensors")
    rendered = renders.load(config.data, folder / "renders")
    kept = rendered.varying()
    estimates = rendered.estimates[:, config.data.runs :]
    sequences = Sequences(torch.from_numpy(estimates), torch.from_numpy(rendered.reference))

    def picture(lanes: np.ndarray) -> np.ndarray:
        """`[lane]` to `[y, x, color]`."""
        width, height = rendered.size
        planes = np.broadcast_to(
            lanes.reshape(-1, height, width), (renders.COLORS, height, width)
        )  # a grey scene has one
        return np.moveaxis(planes, 0, -1)

    ns = tuple(n for n in ns if config.window <= n <= config.data.terms)
    s, t = [], []
    for n in ns:
        before = estimates[..., n - 1]
        after = evaluation.transformed(model, sequences, n).numpy()
        after = np.where(kept[:, None], after, before)
        s.append([picture(run) for run in before.T])
        t.append([picture(run) for run in after.T])
    return Pictures(config.name, list(ns), np.array(s), np.array(t), picture(rendered.reference))


def error_maps(pictures: Pictures, folder: Path) -> list[Path]:
    """Writes NAME-S.png and NAME-T.png."""
    index = pictures.n.index(MAP_N)
    maps = {
        "S": np.abs(pictures.s[index, 0] - pictures.reference).mean(axis=-1),
        "T": np.abs(pictures.t[index, 0] - pictures.reference).mean(axis=-1),
    }
    brightest = max(float(np.quantile(maps["S"], 0.99)), np.finfo(np.float32).tiny)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, error in maps.items():
        path = folder / f"{pictures.name}-{name}.png"
        matplotlib.image.imsave(
            path, error, vmin=0.0, vmax=brightest, cmap=COLOR_MAP, metadata={"Software": None}
        )
        paths.append(path)
    return paths


def main(argv: list[str] | None = None) -> int:
    """`argv` is for tests; without it, the command line. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m nst_train.pictures", description=__doc__)
    parser.add_argument("run", type=Path, help="folder of a finished run")
    parser.add_argument("--maps", type=Path, metavar="FOLDER", help="where error maps go")
    parser.add_argument("--npz", type=Path, metavar="FILE", help="pictures for a denoiser")
    arguments = parser.parse_args(argv)
    try:
        pictures = load(arguments.run, DENOISED_N)
        if arguments.maps:
            for path in error_maps(pictures, arguments.maps):
                print(f"wrote {path}")
        if arguments.npz:
            np.savez(
                arguments.npz,
                n=np.array(pictures.n),
                S=pictures.s,
                T=pictures.t,
                I=pictures.reference,
            )
            print(f"wrote {arguments.npz}")
    except (UserError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
