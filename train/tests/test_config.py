"""Configs: the committed ones are valid, and each mistake is named."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from nst_train import config
from nst_train.errors import UserError

CONFIGS = Path(__file__).parents[1] / "configs"
FAMILIES = (CONFIGS / "families.toml").read_text(encoding="utf-8")
CORNELL = (CONFIGS / "cornell.toml").read_text(encoding="utf-8")


def parse(text: str) -> config.Config:
    return config.parse(tomllib.loads(text), text)


SMALL = "\n[small]\nepochs = 7\n[small.data]\nruns = 3\n"


def with_key(text: str, key: str, value: str | None) -> str:
    """`text` with another value for `key`, or without the key."""
    lines = text.split("\n[small]")[0].splitlines()
    (index,) = [i for i, line in enumerate(lines) if line.startswith(f"{key} =")]
    lines[index] = "" if value is None else f"{key} = {value}"
    return "\n".join(lines)


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_committed_configs_are_valid(path: Path) -> None:
    loaded = config.load(path)
    assert (loaded.name, loaded.setting) == (path.stem, "paper")
    assert loaded.text == path.read_text(encoding="utf-8")
    assert config.load(path, "small").setting == "small"


def test_the_small_setting_replaces_some_keys() -> None:
    text = FAMILIES.split("\n[small]")[0] + SMALL
    paper = config.parse(tomllib.loads(text), text)
    small = config.parse(tomllib.loads(text), text, "small")
    assert (paper.epochs, paper.data.runs) == (1000, 100)
    assert (small.epochs, small.data.runs) == (7, 3)
    assert small == replace(paper, epochs=7, setting="small", data=replace(paper.data, runs=3))


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("epoch = 7", "unknown key 'small.epoch'; did you mean 'small.epochs'"),
        ('name = "x"', "small.name: cannot differ"),
        ("epochs = 0", "in the small setting, epochs = 0: must be 1 or more"),
        ("[small.data]\nrun = 3", "unknown key 'small.data.run'; did you mean 'small.data.runs'"),
        ("[small.data]\nterms = 3", "in the small setting, data.terms = 3"),
        ('[small.data]\nscene = "x.obj"', "unknown key 'small.data.scene'"),
    ],
)
def test_mistakes_of_the_small_setting_are_found_whatever_the_setting(line: str, complaint: str) -> None:
    text = FAMILIES.split("\n[small]")[0] + "\n[small]\n" + line
    for setting in config.SETTINGS:
        with pytest.raises(UserError, match=re.escape(complaint)):
            config.parse(tomllib.loads(text), text, setting)


def test_unknown_keys_are_refused_with_the_nearest_known_one() -> None:
    with pytest.raises(UserError, match="unknown key 'learning_rat'; did you mean 'learning_rate'"):
        parse("learning_rat = 1e-3\n" + FAMILIES)
    with pytest.raises(UserError, match="unknown key 'data.famlies'; did you mean 'data.families'"):
        parse(FAMILIES.replace("families = [", "famlies = []\nfamilies = ["))
    with pytest.raises(UserError, match="unknown key 'data.scene'"):  # belongs to kind = "renders"
        parse(FAMILIES.replace("families = [", 'scene = "x.obj"\nfamilies = ['))


@pytest.mark.parametrize("key", ["name", "seed", "hidden", "epsilon", "runs", "families"])
def test_missing_keys_are_named(key: str) -> None:
    with pytest.raises(UserError, match=rf"missing key '(data\.)?{key}'"):
        parse(with_key(FAMILIES, key, None))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("name", "3"),
        ("name", '"../x"'),
        ("seed", "-1"),
        ("seed", "true"),
        ("window", "1"),
        ("hidden", "[]"),
        ("hidden", "[64, 0]"),
        ("hidden", '["64"]'),
        ("inputs", '"white"'),
        ("start", '"zero"'),
        ("loss", '"L4"'),
        ("epsilon", "0"),
        ("epochs", "1.5"),
        ("learning_rate", "nan"),
        ("terms_per_step", "58"),
        ("terms", "7"),
        ("runs", "0"),
        ("families", '["sine"]'),
        ("families", '["step", "step"]'),
    ],
)
def test_bad_values_are_named(key: str, value: str) -> None:
    with pytest.raises(UserError, match=rf"^(data\.)?{key} = "):
        parse(with_key(FAMILIES, key, value))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("size", "[64]"),
        ("reference_spp", "64"),
        ("evaluation_runs", "0"),
        ("sampler", '"sobol"'),
        ("pixel", '"corner"'),
        ("max_depth", "0"),
    ],
)
def test_bad_values_of_renders_are_named(key: str, value: str) -> None:
    with pytest.raises(UserError, match=rf"^data\.{key} = "):
        parse(with_key(CORNELL, key, value))


def test_kind_of_data_is_required() -> None:
    with pytest.raises(UserError, match=r"data\.kind = 'photos'"):
        parse(with_key(FAMILIES, "kind", '"photos"'))
    with pytest.raises(UserError, match=r"\[data\]"):
        parse(FAMILIES.split("[data]")[0])


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="missing.toml: cannot read"):
        config.load(tmp_path / "missing.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text("seed = ")
    with pytest.raises(UserError, match="broken.toml: not a TOML file"):
        config.load(broken)
