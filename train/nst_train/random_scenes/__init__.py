"""Random scenes for our own renderer, to train and test what must work on scenes that nobody trained on.

    python -m nst_train.random_scenes FOLDER --scenes 5 --seed 1
    python -m nst_train.random_scenes FOLDER --branches glass maze

writes FOLDER/glass-000/glass-000.obj with its MTL file, TOML file and images, and so on. A *branch* is a
function that makes one kind of scene: of `branches.py`, `indoors.py`, `outside.py` or `bodies.py`. What must
hold on unseen scenes is tested on branches that nothing was trained on. Scene i of a branch depends on the
seed, the branch's name and i alone. Nothing is taken from the scenes of this repository, which are for tests.
"""

import zlib
from pathlib import Path

import numpy as np

from nst_train.random_scenes.branches import BRANCHES
from nst_train.random_scenes.files import RandomScene

__all__ = ["BRANCHES", "RandomScene", "random_scene", "write"]


def random_scene(branch: str, index: int, seed: int) -> RandomScene:
    """Scene `index` of a branch."""
    rng = np.random.default_rng((seed, zlib.crc32(branch.encode()), index))
    scene = RandomScene(f"{branch}-{index:03}")
    BRANCHES[branch](scene, rng)
    return scene


def write(scene: RandomScene, folder: Path) -> Path:
    """Writes a scene into a folder of its own below `folder`, and returns the path of its OBJ file."""
    place = folder / scene.name
    place.mkdir(parents=True, exist_ok=True)
    for name, content in scene.files().items():
        (place / name).write_bytes(content)
    return place / f"{scene.name}.obj"
