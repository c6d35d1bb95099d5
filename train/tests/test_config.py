"""Configs: the committed ones are valid, and each mistake is named."""

import tomllib
from pathlib import Path

import pytest

from nst_train import config
from nst_train.errors import UserError

CONFIGS = Path(__file__).parents[1] / "configs"
FAMILIES = (CONFIGS / "families.toml").read_text(encoding="utf-8")
CORNELL = (CONFIGS / "cornell.toml").read_text(encoding="utf-8")


def parse(text: str) -> config.Config:
    return config.parse(tomllib.loads(text), text)


def with_key(text: str, key: str, value: str | None) -> str:
    """`text` with another value for `key`, or without the key."""
    lines = text.splitlines()
    (index,) = [i for i, line in enumerate(lines) if line.startswith(f"{key} =")]
    lines[index] = "" if value is None else f"{key} = {value}"
    return "\n".join(lines)


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_committed_configs_are_valid(path: Path) -> None:
    assert config.load(path).name == path.stem
    assert config.load(path).text == path.read_text(encoding="utf-8")


def test_unknown_keys_are_refused_with_the_nearest_known_one() -> None:
    with pytest.raises(UserError, match="unknown key 'learning_rat'; did you mean 'learning_rate'"):
        parse("learning_rat = 1e-3\n" + FAMILIES)
    with pytest.raises(UserError, match="unknown key 'data.famlies'; did you mean 'data.families'"):
        parse(FAMILIES + "\nfamlies = []")
    with pytest.raises(UserError, match="unknown key 'data.scene'"):  # belongs to kind = "renders"
        parse(FAMILIES + '\nscene = "x.obj"')


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
    ("key", "value"), [("size", "[64]"), ("reference_spp", "64"), ("evaluation_runs", "0")]
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
