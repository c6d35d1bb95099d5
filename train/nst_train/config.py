"""The TOML file that describes one experiment.

Every key is required, so that a config tells the whole story of the weights that it produced. The keys
at the top level are the paper's setting; the table [small] replaces some of them by what two CPU cores
can do.
"""

import difflib
import math
import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, get_args, get_origin

from nst_train.errors import UserError
from nst_train.families import FAMILIES
from nst_train.losses import LOSSES
from nst_train.power_means import PowerMeans
from nst_train.random_scenes.branches import BRANCHES


@dataclass(frozen=True)
class FamiliesData:
    """One-dimensional integrands with known integrals (section 4.1)."""

    kind: str
    families: list[str]
    runs: int
    terms: int


@dataclass(frozen=True)
class FreshFamiliesData(FamiliesData):
    """The same families with new parameters for every lane of a batch; `runs` are of held-out integrands."""

    batches: int  # per epoch


@dataclass(frozen=True)
class RendersData:
    """Pixels of a scene, rendered by `nst` (section 4.3)."""

    kind: str
    scene: str  # OBJ file, relative to the root of the repository
    size: list[int]  # width, height
    runs: int
    evaluation_runs: int
    terms: int  # samples per pixel of each run
    reference_spp: int
    first_seed: int  # training runs take the seeds from here, then evaluation runs, then the reference
    sampler: str  # one of SAMPLERS
    max_depth: int  # path vertices after the camera that may scatter or emit; 2 = direct light
    pixel: str  # one of PIXELS: samples all over a pixel, or at its centre (no anti-aliasing)


@dataclass(frozen=True)
class RandomScenesData:
    """Pictures of random scenes, and the 1D families beside them."""

    kind: str
    branches: list[str]  # of `random_scenes`, trained on
    scenes: int  # of each
    held_out: list[str]  # other branches, scored on
    held_out_scenes: int
    families: list[str]
    family_share: float  # of the batches
    size: list[int]  # width, height
    runs: int  # pictures of `terms` samples in each scene
    terms: int  # samples per pixel: a power of two
    reference_spp: int  # of each of the two halves
    first_seed: int  # of scenes, and of their renders
    batches: int  # per epoch


@dataclass(frozen=True)
class Config:
    """One training run: an experiment in one of its settings."""

    name: str
    seed: int
    window: int  # M, terms that the network sees; the least n, where it sees the samples
    hidden: list[int]
    inputs: str  # one of INPUTS: windows as they are, or uncorrelated and of variance 1 while training;
    # or the samples' power means
    start: str  # one of STARTS: random weights, or T = S
    loss: str
    epsilon: float  # ε of equations 5 and 9
    epochs: int
    batch_size: int  # integrands per batch
    learning_rate: float
    terms_per_step: int  # how many n of window..terms are drawn for each batch; 0 = all
    data: FamiliesData | RendersData | RandomScenesData
    samples: PowerMeans | None  # the table [samples], for inputs = "samples"
    setting: str  # one of SETTINGS
    text: str  # the file itself


SETTINGS = ("paper", "small")
SAMPLERS = ("random", "halton")
INPUTS = ("raw", "whitened", "samples")
STARTS = ("random", "input")
PIXELS = ("box", "center")
GIVEN = ("setting", "text")  # fields of Config that are no keys
DATA_KINDS = {
    "families": FamiliesData,
    "fresh-families": FreshFamiliesData,
    "renders": RendersData,
    "random-scenes": RandomScenesData,
}
SEEN = (FreshFamiliesData, RandomScenesData)
"""Data whose samples a network can see."""


def load(path: Path, setting: str = "paper") -> Config:
    """Reads and checks a config, both of its settings, and returns one of them."""
    try:
        text = path.read_text(encoding="utf-8")
        table = tomllib.loads(text)
    except OSError as error:
        raise UserError(f"{path}: cannot read the config: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: not a TOML file: {error}") from error
    try:
        return parse(table, text, setting)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error


def parse(table: dict[str, Any], text: str, setting: str = "paper") -> Config:
    """Checks a parsed TOML table; `text` is the file that it came from."""
    table = dict(table)
    small = table.pop("small", {})
    if not isinstance(small, dict) or not isinstance(small.get("data", {}), dict):
        raise UserError("small: expected a table of keys that differ in the small setting")
    settings = {"paper": _parse(table, text, "paper")}
    for key in small.keys() & {"name", "small"}:
        raise UserError(f"small.{key}: cannot differ in the small setting")
    _refuse_unknown(small, Config, "small.")
    data = table["data"]
    _refuse_unknown(small.get("data", {}), DATA_KINDS[data["kind"]], "small.data.")
    merged = table | small | {"data": data | small.get("data", {})}
    try:
        settings["small"] = _parse(merged, text, "small")
    except UserError as error:
        raise UserError(f"in the small setting, {error}") from error
    return settings[setting]


def _parse(table: dict[str, Any], text: str, setting: str) -> Config:
    data = table.get("data")
    if not isinstance(data, dict):
        raise UserError("missing table [data]")
    kind = data.get("kind")
    if kind not in DATA_KINDS:
        raise UserError(f"data.kind = {kind!r}: expected one of {', '.join(DATA_KINDS)}")
    parsed = read_table(DATA_KINDS[kind], data, "data.")
    form = table.get("samples")
    if form is not None:
        if not isinstance(form, dict):
            raise UserError("samples: expected a table")
        form = read_table(PowerMeans, form, "samples.")
    config = read_table(Config, table, "", data=parsed, samples=form, setting=setting, text=text)
    _check_ranges(config)
    return config


def _keys(cls: type) -> dict[str, Any]:
    """The keys of a table and their types."""
    return {field.name: field.type for field in fields(cls) if field.name not in GIVEN}


def _refuse_unknown(table: dict[str, Any], cls: type, prefix: str) -> None:
    for key in table:
        if key not in _keys(cls):
            nearest = difflib.get_close_matches(key, _keys(cls), n=1, cutoff=0.0)[0]
            raise UserError(f"unknown key '{prefix}{key}'; did you mean '{prefix}{nearest}'?")


def read_table(cls: type, table: dict[str, Any], prefix: str, **given: Any) -> Any:
    """Makes a `cls` of `table`, which has all its fields but those in `given`, and no other."""
    _refuse_unknown(table, cls, prefix)
    for key, expected in _keys(cls).items():
        if key in given:
            continue
        if key not in table:
            raise UserError(f"missing key '{prefix}{key}'")
        if not _has_type(table[key], expected):
            name = expected if get_args(expected) else expected.__name__
            raise UserError(f"{prefix}{key} = {table[key]!r}: expected {name}")
    return cls(**(table | given))


def _has_type(value: Any, expected: Any) -> bool:
    if isinstance(value, bool):  # an int to Python, but not to TOML
        return False
    if get_origin(expected) is list:
        (item,) = get_args(expected)
        return isinstance(value, list) and all(_has_type(v, item) for v in value)
    if expected is float:
        return isinstance(value, (int, float))
    return isinstance(value, expected)


def _check_ranges(config: Config) -> None:
    data = config.data

    def require(holds: bool, key: str, requirement: str) -> None:
        if not holds:
            owner, _, name = key.rpartition(".")
            value = getattr(getattr(config, owner) if owner else config, name)
            raise UserError(f"{key} = {value!r}: must be {requirement}")

    require(re.fullmatch(r"[\w-]+", config.name) is not None, "name", "letters, digits, '-' or '_'")
    require(0 <= config.seed < 2**63, "seed", "0 or more, below 2^63")
    require(config.window >= 2, "window", "2 or more")
    require(bool(config.hidden) and min(config.hidden) >= 1, "hidden", "a list of widths, each 1 or more")
    require(config.inputs in INPUTS, "inputs", f"one of {', '.join(INPUTS)}")
    require(config.start in STARTS, "start", f"one of {', '.join(STARTS)}")
    require(config.loss in LOSSES, "loss", f"one of {', '.join(LOSSES)}")
    require(0 < config.epsilon < math.inf, "epsilon", "a positive number")
    require(config.epochs >= 1, "epochs", "1 or more")
    require(config.batch_size >= 1, "batch_size", "1 or more")
    require(0 < config.learning_rate < math.inf, "learning_rate", "a positive number")
    require(data.runs >= 1, "data.runs", "1 or more")
    require(data.terms >= config.window, "data.terms", f"at least the window, {config.window}")
    points = data.terms - config.window + 1
    require(0 <= config.terms_per_step <= points, "terms_per_step", f"0 (all) to {points}")

    _check_samples(config, require)
    if isinstance(data, FamiliesData | RandomScenesData):
        known = bool(data.families) and set(data.families) <= set(FAMILIES)
        require(known, "data.families", f"a list of {', '.join(FAMILIES)}")
        require(len(set(data.families)) == len(data.families), "data.families", "without repeats")
    if isinstance(data, RandomScenesData):
        _check_random_scenes(data, require)
    if isinstance(data, RendersData | RandomScenesData):
        require(len(data.size) == 2 and min(data.size) >= 1, "data.size", "[width, height]")
        require(data.first_seed >= 0, "data.first_seed", "0 or more")
    if isinstance(data, RendersData):
        require(data.evaluation_runs >= 1, "data.evaluation_runs", "1 or more")
        require(data.reference_spp > data.terms, "data.reference_spp", f"more than {data.terms}")
        require(data.sampler in SAMPLERS, "data.sampler", f"one of {', '.join(SAMPLERS)}")
        require(data.pixel in PIXELS, "data.pixel", f"one of {', '.join(PIXELS)}")
        require(data.max_depth >= 1, "data.max_depth", "1 or more")


Require = Callable[[bool, str, str], None]


def _check_random_scenes(data: RandomScenesData, require: Require) -> None:
    """Branches that are there, none of them both trained on and held out."""
    for key in ("branches", "held_out"):
        names = getattr(data, key)
        known = bool(names) and set(names) <= set(BRANCHES) and len(set(names)) == len(names)
        require(known, f"data.{key}", f"a list, without repeats, of {', '.join(BRANCHES)}")
    require(not set(data.branches) & set(data.held_out), "data.held_out", "none of data.branches")
    for key in ("scenes", "held_out_scenes", "reference_spp"):
        require(getattr(data, key) >= 1, f"data.{key}", "1 or more")
    power = data.terms >= 16 and data.terms & (data.terms - 1) == 0
    require(power, "data.terms", "a power of two, 16 or more")
    require(0 <= data.family_share < 1, "data.family_share", "0 or more, below 1")


def _check_samples(config: Config, require: Require) -> None:
    """What belongs to networks that see the samples, and to no others."""
    form, seen = config.samples, isinstance(config.data, SEEN)
    if (config.inputs == "samples") != (form is not None):
        raise UserError('inputs = "samples" and a table [samples] need each other')
    if (config.inputs == "samples") != seen:
        raise UserError(
            'inputs = "samples" and data.kind = "fresh-families" or "random-scenes" need each other'
        )
    if form is None or not isinstance(config.data, SEEN):
        return
    require(config.loss in ("L0", "L1"), "loss", "L0 or L1: of one run, only means of squares say anything")
    require(config.terms_per_step >= 1, "terms_per_step", "1 or more")
    require(config.data.batches >= 1, "data.batches", "1 or more")
    if mistake := form.mistake():
        require(False, f"samples.{mistake[0]}", mistake[1])
