"""Reads the datasets that `nst render --runs` writes: format `nst-dataset-1`.

A safetensors file with one tensor, `sequences` of f32 `[run, term, lane]`; lanes are all pixels of R,
then of G, then of B. It is mapped into memory, not read.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nst_train.errors import UserError

FORMAT = "nst-dataset-1"
MOST_HEADER = 100_000_000  # bytes, as in safetensors' own reader


@dataclass(frozen=True)
class Dataset:
    """An open dataset."""

    path: Path
    scene: str  # fingerprint
    sampler: str
    sample_counts: list[int]  # behind each term
    sequences: np.ndarray  # [run, term, lane], mapped

    def run(self, index: int) -> np.ndarray:
        """One run, `[term, lane]`."""
        run = self.sequences[index]
        if not np.isfinite(run).all():
            raise UserError(f"{self.path}: run {index} contains NaN or infinity; delete the file and rerun")
        return run


def read(path: Path, size: tuple[int, int], runs: int, sample_counts: list[int]) -> Dataset:
    """Opens the file and checks that it is what was asked for; `size` is (width, height)."""

    def refuse(what: str) -> UserError:
        return UserError(f"{path}: {what}; delete the file and rerun")

    header, offset, length = _header(path)
    metadata = header.get("__metadata__")
    tensor = header.get("sequences")
    if not isinstance(metadata, dict) or metadata.get("format") != FORMAT:
        raise UserError(f"{path}: not a dataset of nst (format '{FORMAT}')")
    found = [str(metadata.get(key)) for key in ("width", "height")]
    if found != [str(extent) for extent in size]:
        raise refuse(f"{found[0]}x{found[1]} pixels, expected {size[0]}x{size[1]}")
    if metadata.get("sample_counts") != ",".join(map(str, sample_counts)):
        expected = f"{sample_counts[0]} to {sample_counts[-1]}"
        raise refuse(f"its terms are of other sample counts than {expected}")
    for key in ("scene", "sampler"):
        if not isinstance(metadata.get(key), str):
            raise refuse(f"metadata '{key}' is missing")

    shape = [runs, len(sample_counts), 3 * size[0] * size[1]]
    if not isinstance(tensor, dict):
        raise refuse("no tensor 'sequences'")
    if tensor.get("dtype") != "F32" or tensor.get("shape") != shape:
        found = f"{tensor.get('dtype')} {tensor.get('shape')}"
        raise refuse(f"tensor 'sequences' is {found}, expected F32 {shape}")
    bytes_expected = 4 * shape[0] * shape[1] * shape[2]
    if tensor.get("data_offsets") != [0, bytes_expected] or length - offset != bytes_expected:
        raise refuse(f"damaged: {length - offset} bytes of numbers, expected {bytes_expected}")
    sequences = np.memmap(path, np.dtype("<f4"), "r", offset, tuple(shape))
    return Dataset(path, metadata["scene"], metadata["sampler"], sample_counts, sequences)


def _header(path: Path) -> tuple[dict, int, int]:
    """The JSON header of a safetensors file, where its numbers start, and the file's length."""
    damaged = UserError(f"{path}: not a safetensors file, or a damaged one; delete it and rerun")
    try:
        with path.open("rb") as file:
            size = int.from_bytes(file.read(8), "little")
            length = path.stat().st_size
            if not 0 < size <= min(MOST_HEADER, length - 8):
                raise damaged
            header = json.loads(file.read(size))
    except OSError as error:
        raise UserError(f"{path}: cannot read the dataset: {error.strerror}") from error
    except ValueError as error:
        raise damaged from error
    if not isinstance(header, dict):
        raise damaged
    return header, 8 + size, length
