"""Reads the set, and sets of other renderers with the same files (docs/neighbours_make.py)."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nst_train.guard_data import files

OTHERS = "tuning-"
"""Names of scenes of another renderer begin so. Each is a family of its own, and is trained on."""


@dataclass(frozen=True)
class Picture:
    """A sequence, and what is true."""

    scene: str
    family: str
    held_out: bool
    spp: int
    sequence: Path
    references: tuple[Path, Path]
    reference_spp: int  # of each half

    def halves(self) -> np.ndarray:
        """R₁ and R₂, `[half, y, x, colour]`: (T − R₁)(T − R₂) is the squared error of T without bias."""
        return np.stack([files.read(path) for path in self.references])


def pictures(folder: Path) -> Iterator[Picture]:
    """All that is complete, scene by scene, also while the set is being made."""
    for place in sorted(path for path in folder.iterdir() if path.is_dir()):
        told = place / "scene.json"
        facts = json.loads(told.read_text()) if told.is_file() else None
        if facts is None and not place.name.startswith(OTHERS):
            continue
        references = (place / "reference-0.exr", place / "reference-1.exr")
        if not all(path.is_file() for path in references):
            continue
        family = facts["family"] if facts else place.name
        spp = min(files.samples(path) for path in references)
        found = [(int(path.stem.split("-")[0]), path) for path in place.glob("[0-9]*-*.exr")]
        for count, path in sorted(found):
            if facts is None or count in facts["counts"]:
                held_out = bool(facts and facts["held_out"])
                yield Picture(place.name, family, held_out, count, path, references, spp)
