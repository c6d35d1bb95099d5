"""Writes datasets as `nst render --runs` does."""

from pathlib import Path

import numpy as np
from safetensors.numpy import save_file


def write_dataset(path: Path, sequences: np.ndarray, size: tuple[int, int], **changed: str) -> None:
    """`sequences` are f32 `[run, term, lane]`; `changed` replaces metadata."""
    terms = sequences.shape[1]
    metadata = {
        "format": "nst-dataset-1",
        "width": str(size[0]),
        "height": str(size[1]),
        "sample_counts": ",".join(map(str, range(1, terms + 1))),
        "scene": "box:v2:0123456789abcdef",
        "sampler": "random",
        "first_seed": "1",
    }
    save_file({"sequences": sequences}, path, metadata | changed)
