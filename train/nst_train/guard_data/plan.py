"""What is rendered of each scene. All of it follows from the scene's name."""

import zlib
from dataclasses import dataclass

import numpy as np

from nst_train.random_scenes import BRANCHES

SCENES = 5
"""Of each family."""
SEED = 19
"""Of the scenes; other networks were trained on scenes of other seeds."""
SIZE = (128, 128)
"""Width and height."""

HELD_OUT = ("maze", "window", "landscape", "blinds", "vases", "city", "backlight")
"""Families for validation alone. The test scenes are of no family: other programs make them."""

STRATA = ((8, 16), (32, 64), (128, 256), (1024, 512))
"""Samples per pixel of a scene's sequences: one of each pair, mostly the first."""
FIRST_SHARE = 0.65
STAGES = ((3, 512), (4, 1024), (4, 2048))
"""Of each stage: of how many strata there are sequences, and samples per pixel of a reference's half."""

SEEDS_PER_SCENE = 10_000_000


@dataclass(frozen=True)
class Plan:
    """A scene and how it is rendered."""

    family: str
    index: int
    sampler: str
    pixel: str
    counts: tuple[int, ...]  # samples per pixel, one for each of `STRATA`

    @property
    def name(self) -> str:
        return f"{self.family}-{self.index:03}"

    @property
    def held_out(self) -> bool:
        return self.family in HELD_OUT

    def possible(self) -> list[int]:
        """Samples per pixel of all sequences that the scene may have, if rendering takes long."""
        return sorted({spp >> k for spp in self.counts[-1:] for k in range(4)} | set(self.counts))

    def _first_seed(self) -> int:
        return zlib.crc32(self.name.encode()) % 400 * SEEDS_PER_SCENE

    def seed_of_sequence(self, spp: int) -> int:
        return self._first_seed() + spp

    def seed_of_piece(self, half: int, piece: int) -> int:
        """Of a piece of a reference's half; no sequence has it."""
        return self._first_seed() + 1_000_000 * (half + 1) + piece


def plan(family: str, index: int) -> Plan:
    rng = np.random.default_rng((SEED, 1, zlib.crc32(family.encode()), index))
    sampler = "random" if rng.random() < 0.7 else "halton-folds"
    pixel = "box" if rng.random() < 0.7 else "center"
    counts = tuple(pair[int(rng.random() > FIRST_SHARE)] for pair in STRATA)
    return Plan(family, index, sampler, pixel, counts)


def order(scenes: int = SCENES) -> list[tuple[Plan, int]]:
    """Scenes and stages, so that what is there at any time is of all families alike.

    A scene's second stage comes after the first one of the scenes two indices on, all third stages last.
    """
    waves = [(index, stage) for index in range(scenes) for stage in range(len(STAGES))]
    waves.sort(key=lambda wave: (wave[1] == 2, wave[0] + 2 * wave[1], wave[1]))
    return [(plan(family, index), stage) for index, stage in waves for family in BRANCHES]
