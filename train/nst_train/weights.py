"""Weights files: safetensors with metadata, format `nst-weights-1`."""

import copy
import json
import math
import os
from dataclasses import asdict, dataclass
from pathlib import Path

import safetensors
import safetensors.torch
import torch

from nst_train.errors import UserError
from nst_train.model import NEGATIVE_SLOPE, GuardMlp, Mlp, SampleMlp
from nst_train.power_means import PowerMeans

FORMAT = "nst-weights-1"


@dataclass(frozen=True)
class Provenance:
    """Where a network comes from; every field becomes a string in the metadata."""

    trained_on: str  # comma-separated, "family:step" or "scene:<fingerprint>"
    samples: str  # the n it was trained on, "8..64"
    loss: str
    epochs: int
    seed: int
    config: str  # the whole TOML file, and which of its settings
    sampler: str | None = None  # "random" or "halton", of rendered sequences only


def rounded(model: Mlp, dtype: torch.dtype) -> Mlp:
    """The network as a file with weights of that type would contain it; it computes in f32."""
    model = copy.deepcopy(model)
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.copy_(parameter.to(dtype))
    return model


def save(path: Path, model: Mlp, provenance: Provenance, dtype: torch.dtype = torch.float32) -> None:
    """Writes f32 or f16 weights; the same network and provenance give the same bytes."""
    if isinstance(model, SampleMlp):
        assert provenance.samples == "{}..{}".format(*model.trained)
    architecture = {
        "format": FORMAT,
        "kind": "mlp",
        "activation": "leaky_relu",
        "negative_slope": NEGATIVE_SLOPE,
        **inputs(model),
    }
    known = {key: value for key, value in asdict(provenance).items() if value is not None}
    metadata = {key: str(value) for key, value in (architecture | known).items()}
    tensors = {name: tensor.cpu().to(dtype) for name, tensor in model.state_dict().items()}
    save_tensors(path, tensors, metadata)


def inputs(model: Mlp) -> dict[str, object]:
    """The metadata that say what the network reads."""
    if isinstance(model, GuardMlp):
        return {"inputs": "guard", "experts": ",".join(model.experts), "prior_floor": model.floor}
    if not isinstance(model, SampleMlp):
        return {"inputs": "window", "window": model.window}
    form = asdict(model.form) | {"powers": ",".join(f"{p:g}" for p in model.form.powers)}
    return {"inputs": "samples", **form}


def save_tensors(path: Path, tensors: dict[str, torch.Tensor], metadata: dict[str, str]) -> None:
    """Writes a safetensors file with a sorted header; the old file stays until the new one is whole."""
    tensors = {name: tensor.detach().contiguous() for name, tensor in tensors.items()}
    unfinished = path.with_name(path.name + ".part")
    unfinished.write_bytes(_sort_header(safetensors.torch.save(tensors, metadata)))
    os.replace(unfinished, path)


def _sort_header(blob: bytes) -> bytes:
    """The library writes metadata in an order that changes from run to run."""
    size = int.from_bytes(blob[:8], "little")
    header = json.dumps(json.loads(blob[8 : 8 + size]), sort_keys=True, separators=(",", ":"))
    encoded = header.encode()
    encoded += b" " * (-len(encoded) % 8)  # the tensors stay aligned to 8 bytes
    return len(encoded).to_bytes(8, "little") + encoded + blob[8 + size :]


def load_tensors(path: Path) -> tuple[dict[str, torch.Tensor], dict[str, str]]:
    """The tensors and the metadata of a safetensors file."""
    if not path.is_file():
        raise UserError(f"{path}: no such file")
    try:
        with safetensors.safe_open(path, framework="pt") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no dictionary)
            return tensors, file.metadata() or {}
    except safetensors.SafetensorError as error:
        raise UserError(f"{path}: not a safetensors file: {error}") from error


def load(path: Path) -> tuple[Mlp, dict[str, str]]:
    """The network in a weights file, and the file's metadata."""
    tensors, metadata = load_tensors(path)
    if metadata.get("format") != FORMAT:
        raise UserError(f"{path}: format is {metadata.get('format')!r}, expected {FORMAT!r}")
    biases = [tensors.get(f"layers.{i}.bias") for i in range(len(tensors) // 2)]
    if not biases or any(bias is None for bias in biases):
        raise UserError(f"{path}: expected tensors layers.0.weight, layers.0.bias, …")
    if not all(tensor.isfinite().all() for tensor in tensors.values()):
        raise UserError(f"{path}: a weight is NaN or infinite")
    try:
        first = tensors["layers.0.weight"].shape[-1]
        model = empty(metadata, first, [len(bias) for bias in biases[:-1]])
        model.load_state_dict(tensors)
    except (KeyError, ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise UserError(f"{path}: the tensors do not fit the metadata: {reason}") from error
    return model, metadata


def empty(metadata: dict[str, str], width: int, hidden: list[int]) -> Mlp:
    """A network with the inputs that the metadata say, and weights that mean nothing.

    `width` is that of the first layer, where the metadata do not say it.
    """
    if metadata.get("inputs") == "guard":
        floor = float(metadata["prior_floor"])
        if not 0 < floor < math.inf:
            raise ValueError(f"prior_floor = {floor}: must be a positive number")
        return GuardMlp(width, hidden, tuple(metadata["experts"].split(",")), floor)
    if metadata.get("inputs") != "samples":
        return Mlp(int(metadata["window"]), hidden)
    powers = [float(p) for p in metadata["powers"].split(",")]
    rest = {key: float(metadata[key]) for key in ("floor", "scale_estimate", "scale_unit")}
    form = PowerMeans(powers, **rest)
    if mistake := form.mistake():
        raise ValueError(f"{mistake[0]} must be {mistake[1]}")
    least, most = map(int, metadata["samples"].split(".."))
    if not 1 <= least <= most:
        raise ValueError(f"samples = {metadata['samples']!r}: must be the least and the largest n")
    return SampleMlp(form, hidden, (least, most))
