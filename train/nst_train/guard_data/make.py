"""Makes the set: a scene is written, rendered and deleted; files that are there are not made again.

A folder per scene: `SPP-0.exr`, a sequence; `reference-0.exr` and `reference-1.exr`, independent means of
`samplesPerPixel` samples; `scene.json`, which says all else.
"""

import hashlib
import json
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from nst_train import random_scenes
from nst_train.binary import run
from nst_train.errors import UserError
from nst_train.guard_data import files
from nst_train.guard_data.plan import SEED, SIZE, STAGES, STRATA, Plan, order

PIECE = 128
"""Samples per pixel that are rendered at a time for a reference. It is stored after each of them."""
BUDGET = 160.0
"""Seconds of processor time that a scene may take: of those that need more, there are fewer samples."""
PROBE = 16
"""Samples per pixel of a rendering that says how long they take."""


def make(
    folder: Path,
    names: list[str],
    size: tuple[int, int] = SIZE,
    budget: float = BUDGET,
    say: Callable[[str], None] = print,
) -> None:
    """All scenes, or those of `names`, which are families or scenes."""
    wanted = [(plan, stage) for plan, stage in order() if not names or {plan.name, plan.family} & set(names)]
    failed = []
    for i, (plan, stage) in enumerate(wanted):
        began = time.monotonic()
        try:
            made = make_stage(plan, stage, folder, size, budget)
        except UserError as error:
            failed.append(plan.name)
            say(f"{i + 1} of {len(wanted)}: {plan.name}, stage {stage}: {error}")
            continue
        if made:
            took = time.monotonic() - began
            say(f"{i + 1} of {len(wanted)}: {plan.name}, stage {stage}, {took:.0f} s")
    if failed:
        raise UserError(f"{len(failed)} stages failed, of {', '.join(sorted(set(failed)))}")


def make_stage(plan: Plan, stage: int, folder: Path, size: tuple[int, int], budget: float) -> bool:
    """Whether anything was to be done."""
    place = folder / plan.name
    place.mkdir(parents=True, exist_ok=True)
    told = place / "scene.json"
    facts = json.loads(told.read_text()) if told.is_file() else None
    if facts and facts["stages"] > stage:
        return False
    with tempfile.TemporaryDirectory() as temporary:
        scene = random_scenes.random_scene(plan.family, plan.index, SEED)
        digest = _digest(scene)
        if facts and facts["digest"] != digest:
            raise UserError(f"{told}: made of another scene than {plan.name} is now; delete the folder")
        work = Work(plan, random_scenes.write(scene, Path(temporary)), Path(temporary), size)
        seconds = facts["seconds_per_spp"] if facts else work.probe()
        counts, reference_spp = affordable(plan, stage, budget / seconds)
        for spp in counts:
            work.sequence(spp, place / f"{spp}-0.exr")
        for half in (0, 1):
            work.reference(half, reference_spp, place / f"reference-{half}.exr")
    _describe(plan, stage, digest, seconds, size, place)
    return True


def affordable(plan: Plan, stage: int, spp: float) -> tuple[list[int], int]:
    """Counts of the sequences, and samples of each half of the reference, for about `spp` samples in all.

    The reference has at least as many in each half as the longest sequence. What takes too long is halved;
    but for the first stage's three sequences, which are few samples.
    """
    strata, reference = STAGES[stage]
    counts, spent = list(plan.counts[:strata]), sum(plan.counts[:strata])
    while spent + 2 * reference > spp and reference > max(counts):
        reference //= 2
    if strata == len(STRATA) and spent + 2 * reference > spp:
        before = affordable(plan, stage - 1, spp)[1]
        while counts[-1] > counts[-2] and sum(counts) + 2 * max(counts[-1], before) > spp:
            counts[-1] //= 2
        if counts[-1] <= counts[-2]:
            counts.pop()
        reference = max(counts[-1], before)
    return counts, max(reference, PIECE)


class Work:
    """Renders one scene."""

    def __init__(self, plan: Plan, scene: Path, temporary: Path, size: tuple[int, int]) -> None:
        self.plan, self.scene, self.temporary = plan, scene, temporary
        self.size = f"{size[0]}x{size[1]}"

    def render(self, spp: int, seed: int, sampler: str, *options: object) -> Path:
        picture = self.temporary / "picture.exr"
        run(
            *("render", "--scene", self.scene, "--size", self.size, "--spp", spp, "--seed", seed),
            *("--sampler", sampler, "--pixel", self.plan.pixel, "--transform", "none"),
            *(*options, "-o", picture),
        )
        return picture

    def probe(self) -> float:
        """Seconds of processor time per sample per pixel."""

        def spent() -> float:
            usage = resource.getrusage(resource.RUSAGE_CHILDREN)
            return usage.ru_utime + usage.ru_stime

        times = []
        for spp in (1, 1 + PROBE):
            began = spent()
            self.render(spp, 0, "random")
            times.append(spent() - began)
        return max(times[1] - times[0], 1e-4) / PROBE

    def sequence(self, spp: int, path: Path) -> None:
        if path.is_file():
            return
        whole = self.temporary / "sequence.exr"
        self.render(
            spp, self.plan.seed_of_sequence(spp), self.plan.sampler, "--features", "--sequence", whole
        )
        files.shorten(whole, path)
        whole.unlink()

    def reference(self, half: int, spp: int, path: Path) -> None:
        """Random samples: Halton's take twice the time, which their lower noise is not always worth."""
        done, mean = 0, 0.0
        if path.is_file():
            done, mean = files.samples(path), files.read(path)
        while done < spp:
            piece = self.render(PIECE, self.plan.seed_of_piece(half, done // PIECE), "random")
            done += PIECE
            mean = mean + (files.read(piece) - mean) * (PIECE / done)
            files.write_reference(path, mean, done)


def _digest(scene: random_scenes.RandomScene) -> str:
    digest = hashlib.sha256()
    for name, content in sorted(scene.files().items()):
        digest.update(name.encode() + b"\0" + hashlib.sha256(content).digest())
    return digest.hexdigest()[:12]


def _describe(
    plan: Plan, stage: int, digest: str, seconds: float, size: tuple[int, int], place: Path
) -> None:
    """Writes `scene.json`; what it lists is there."""
    halves = [place / f"reference-{half}.exr" for half in (0, 1)]
    pictures = [files.read(path) for path in halves]
    mean = (pictures[0] + pictures[1]) / 2
    error = ((pictures[0] - pictures[1]) ** 2).mean() / 4
    facts = {
        "name": plan.name,
        "family": plan.family,
        "held_out": plan.held_out,
        "sampler": plan.sampler,
        "pixel": plan.pixel,
        "size": size,
        "digest": digest,
        "stages": stage + 1,
        "counts": [spp for spp in plan.possible() if (place / f"{spp}-0.exr").is_file()],
        "reference_spp": files.samples(halves[0]),
        "seconds_per_spp": seconds,
        "mean": float(mean.mean()),
        "black": float((mean.max(axis=-1) <= 1e-4 * np.median(mean.max(axis=-1))).mean()),
        "relative_error_of_reference": float(np.sqrt(error) / max(mean.mean(), 1e-12)),
    }
    unfinished = place / "unfinished-scene.json"
    unfinished.write_text(json.dumps(facts, indent=1) + "\n")
    unfinished.replace(place / "scene.json")
