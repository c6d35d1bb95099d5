"""Scores of a network on pictures of scenes that it was not trained on.

The error of an estimate x of a lane is (x − r)(x − r'), where r and r' are the references: they are of
other samples, so that its mean is (x − I)², however noisy they are. Scenes are of all brightnesses, so a
scene's mean error is divided by what S is expected to have there, the variance of a sample over n. The
scores of a branch are means over its scenes: the MSE of S is about 1, and `mse_ratio` is about the mean of
the scenes' ratios. The data BRANCH/relative weigh each lane by 1/(I² + 0.01 u²), u the mean of I.
"""

import torch
from torch import Tensor

from nst_train.model import SampleMlp
from nst_train.scene_renders import Scene

RELATIVE = "/relative"
LEAST = 0.01
"""Of u², added to I²: what is darker than a tenth of u counts as that."""


def transformed(model: SampleMlp, sums: Tensor, n: int) -> tuple[Tensor, Tensor]:
    """S and T `[draw, lane]` of sums `[draw, power, lane]`, each draw a batch of its own, in f64."""
    device = next(model.parameters()).device
    sums = sums.double().transpose(0, 1).to(device)
    count = torch.tensor(float(n), dtype=torch.float64, device=device)
    s = model.form.estimate(sums, count)
    unit = s.abs().mean(dim=-1, keepdim=True)
    with torch.no_grad():
        return s.cpu(), model.transform(sums, count, unit).cpu()


def scene_errors(model: SampleMlp, scene: Scene, n: int, relative: bool) -> dict[str, tuple[float, float]]:
    """MSE and bias² of S and of T, over that which S is expected to have."""
    first, second = scene.reference.double()
    weight = torch.ones_like(first)
    if relative:
        reference = (first + second) / 2
        weight = 1 / (reference.square() + LEAST * reference.mean().square())
    expected = (weight * scene.deviation.double().square()).mean() / n
    s, t = transformed(model, scene.sums[n].sum(dim=1), n)

    def error(x: Tensor) -> float:
        return float((weight * (x - first) * (x - second)).mean() / expected)

    return {method: (error(x), error(x.mean(dim=0))) for method, x in (("S", s), ("T", t))}


def branch_errors(model: SampleMlp, scenes: list[Scene], n: int) -> dict[str, dict[str, tuple[float, float]]]:
    """Means over the scenes of each branch and over all scenes, by name in metrics.csv and method."""
    branches = list(dict.fromkeys(scene.branch for scene in scenes))
    members = {branch: [scene for scene in scenes if scene.branch == branch] for branch in branches}
    if len(branches) > 1:
        members["all"] = scenes
    found = {}
    for relative in (False, True):
        errors = {scene.name: scene_errors(model, scene, n, relative) for scene in scenes}
        for name, group in members.items():
            mean = {
                method: tuple(
                    sum(errors[scene.name][method][i] for scene in group) / len(group) for i in (0, 1)
                )
                for method in ("S", "T")
            }
            found[name + RELATIVE * relative] = mean
    return found
