"""The table that `nst bench stability` reads is what training holds out, and a change is noticed."""

from pathlib import Path

import pytest

from nst_train import families, held_out


def test_the_committed_table_is_what_training_holds_out() -> None:
    assert held_out.main(["--check"]) == 0


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("step,,,0.15,", "step,,,0.150001,"),  # a parameter
        ("0.13125,", "0.1312501,"),  # an integral
        ("0.875 0.875 0.0", "0.875 0.875 0.875"),  # a value
        ("0.875 0.875 0.0", "0.875 0.0"),
        ("family,mean", "family,mu"),
    ],
)
def test_another_table_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str
) -> None:
    path = tmp_path / "integrands.csv"
    path.write_text(held_out.table())
    check = ["--table", str(path), "--check"]
    assert held_out.main(check) == 0
    changed = held_out.table().replace(old, new, 1)
    assert changed != held_out.table()
    path.write_text(changed)
    assert held_out.main(check) == 1
    assert "integrands.csv: " in capsys.readouterr().err
    assert held_out.main(["--table", str(path)]) == 0  # rewrites it
    assert path.read_text() == held_out.table()


def test_the_table_follows_the_families(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(families, "EDGE_RANGE", (0.1, 0.9))
    assert held_out.main(["--check"]) == 1


def test_the_last_bits_of_exp_may_differ() -> None:
    table = held_out.table()
    value = table.splitlines()[1].split(",")[-1].split()[0]
    for change, differs in ((1e-15, False), (1e-13, True)):
        other = table.replace(value, repr(float(value) * (1.0 + change)), 1)
        assert bool(held_out.differences(other, table)) == differs
