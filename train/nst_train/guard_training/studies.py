"""What decides how good the network is: scenes that it has seen, its inputs, its size, the loss."""

import random
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch

from nst_train import evaluation
from nst_train.guard_training import descent, scores
from nst_train.guard_training.data import Item, scenes_of
from nst_train.guard_training.scores import CLOSED, Score
from nst_train.guard_training.settings import Settings
from nst_train.guard_training.stored import LISTS
from nst_train.model import GuardMlp

CURVE = (10, 30, 60)
"""Numbers of scenes that a network is trained on, beside all of them."""
SUMMARY = [
    *("mse_to_min", "relmse_to_min", "mse_to_s", "relmse_to_s"),
    *("worst_mse_to_s", "worst_relmse_to_s", "worst_mse_to_min", "worst_relmse_to_min"),
]
"""Names of what `scores.summary` says."""


@dataclass(frozen=True)
class Variant:
    """A network that differs from that of the config."""

    name: str
    changes: dict[str, object] = field(default_factory=dict)  # of the settings
    loss: dict[str, float] = field(default_factory=dict)  # of its loss
    without: tuple[int, ...] = ()  # inputs that it does not get

    def settings(self, config: Settings) -> Settings:
        return replace(config, **self.changes, loss=replace(config.loss, **self.loss))


# Inputs as docs/learned-guard.md lists them: three kinds of weights, by expert; the error of S near the cell,
# the brightness, and four other errors; the wider view, by expert.
VARIANTS = [
    Variant("as it is"),
    Variant("seed 2", {"seed": 2}),
    Variant("seed 3", {"seed": 3}),
    Variant("1 × 16", {"hidden": [16]}),
    Variant("2 × 8", {"hidden": [8, 8]}),
    Variant("2 × 32", {"hidden": [32, 32]}),
    Variant("3 × 32", {"hidden": [32, 32, 32]}),
    Variant("without weights by what is near", without=(0, 1, 2)),
    Variant("without weights of the whole picture", without=(3, 4, 5)),
    Variant("without any weights", without=tuple(range(9))),
    Variant("without the error near, and other errors", without=(9, 11, 12, 13, 14)),
    Variant("without the brightness", without=(10,)),
    Variant("without errors at other scales", without=(11, 12, 13, 14)),
    Variant("without the wider view of experts", without=(15, 16, 17)),
    Variant("without the closed form as a prior", {"prior_floor": 1e3}),
    Variant("without the closed form at all", {"prior_floor": 1e3}, without=tuple(range(9))),
    Variant("without penalties in the loss", loss={"harm": 0.0, "regret": 0.0}),
]


def curve(
    config: Settings, items: list[Item], folder: Path, path: Path, say: Callable[[str], None] = print
) -> None:
    """Scores of networks that saw fewer scenes, and of the closed form, which saw none."""
    names = scenes_of(items)
    random.Random(config.seed).shuffle(names)
    models, pictures = {}, {CLOSED: (0, 0)}
    for count in [*(count for count in CURVE if count < len(names)), len(names)]:
        seen = set(names[:count])
        part = [item for item in items if item.scene in seen]
        say(f"{count} scenes, {len(part)} pictures and lists of experts")
        models[f"{count}"], _ = descent.train(config, part, say)
        pictures[f"{count}"] = (count, len(part))
    found = scores.score(models, folder, config)
    rows = [
        [*pictures[method], experts, "closed" if method == CLOSED else "network", *numbers]
        for experts, method, numbers in summaries(found, list(pictures))
    ]
    evaluation.write_csv(path, ["scenes", "pictures", "experts", "method", *SUMMARY], rows)
    say(f"wrote {path}")


def ablations(
    config: Settings, items: list[Item], folder: Path, path: Path, say: Callable[[str], None] = print
) -> None:
    """Scores of `VARIANTS`, each trained on all items, and of the closed form, which has no parameters."""
    models = {}
    for variant in VARIANTS:
        say(variant.name)
        models[variant.name] = trained(variant, config, items)
    parameters = {name: sum(p.numel() for p in model.parameters()) for name, model in models.items()}
    found = scores.score(models, folder, config)
    rows = [
        [method, parameters.get(method, 0), experts, *numbers]
        for experts, method, numbers in summaries(found, [CLOSED, *models])
    ]
    evaluation.write_csv(path, ["network", "parameters", "experts", *SUMMARY], rows)
    say(f"wrote {path}")


def trained(variant: Variant, config: Settings, items: list[Item]) -> GuardMlp:
    """What it does not get is 0 in training, and has no weight afterwards."""
    without = list(variant.without)
    kept = torch.ones(items[0].inputs.shape[-1])
    kept[without] = 0.0
    blind = [replace(item, inputs=item.inputs * kept) for item in items] if without else items
    model, _ = descent.train(variant.settings(config), blind, lambda _: None)
    with torch.no_grad():
        model.layers[0].weight[:, without] = 0.0
    return model


def summaries(found: list[Score], methods: list[str]) -> list[tuple[str, str, list[float]]]:
    """By list of experts and method."""
    return [
        (experts, method, scores.summary(found, experts, method)) for experts in LISTS for method in methods
    ]
