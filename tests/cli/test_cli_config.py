"""``config show``: effective settings and their sources."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from cli_support import GOOD, Outcome, provenance

Cli = Callable[..., Outcome]


def shown(outcome: Outcome) -> dict[str, tuple[Any, str]]:
    """Return value and source of each setting in the output."""
    assert outcome.code == 0, outcome.err
    return {row["setting"]: (row["value"], row["source"]) for row in outcome.json}


@pytest.mark.extensive
@pytest.mark.parametrize(("flag", "environment", "config"), list(product([False, True], repeat=3)))
def test_shown_settings_are_effective(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flag: bool, environment: bool, config: bool
) -> None:
    """The values shown, for a number and a list, are those that the same arguments use, from any source."""
    sources, words = ["default"], ["localize"]
    if config:
        (tmp_path / "c.toml").write_text('[localize]\nseed = 1\nmethod = ["ls"]\n')
        monkeypatch.setenv("NLOSCTL_CONFIG", "c.toml")
        sources.append("config c.toml")
    if environment:
        monkeypatch.setenv("NLOSCTL_LOCALIZE_SEED", "2")
        monkeypatch.setenv("NLOSCTL_LOCALIZE_METHOD", "stansfield ml")
        sources.append("environment NLOSCTL_LOCALIZE_")
    if flag:
        words += ["--seed", "3", "-m", "ml", "-m", "ls"]
        sources.append("flag")
    output = shown(cli("config", "show", *words, "--json"))
    assert cli(*words, GOOD, "-o", "e.parquet").code == 0
    used = provenance(tmp_path / "e.parquet")
    assert output["seed"][0] == used["seed"]
    assert output["method"][0] == [method["name"].removeprefix("bearings.") for method in used["methods"]]
    for name in ("seed", "method"):
        assert output[name][1].startswith(sources[-1])
    assert output["block-size"] == (8192, "default")


def test_all_settings_that_are_not_defaults(cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a command every setting that is not a default is shown, of any command."""
    (tmp_path / "c.toml").write_text("[simulate]\ntrials = 7\n[bound]\nuse-ranges = false\n")
    monkeypatch.setenv("NLOSCTL_DETECT_IP_DETAILS", "1")
    rows = cli("config", "show", "--config", "c.toml", "--json").json
    output = {
        (row["command"], row["setting"]): (row["value"], row["source"]) for row in rows if row["setting"] != "config"
    }
    assert output == {
        ("simulate", "trials"): (7, "config c.toml"),
        ("bound", "use-ranges"): (False, "config c.toml"),
        ("detect-ip", "details"): (True, "environment NLOSCTL_DETECT_IP_DETAILS"),
    }


def test_no_settings(cli: Cli) -> None:
    """Without settings the table is empty, and standard error states it."""
    outcome = cli("config", "show")
    assert (outcome.code, outcome.out, outcome.err) == (0, b"", "every setting is its default\n")


def test_flags_after_two_dashes_belong_to_the_command(cli: Cli) -> None:
    """``--json`` belongs to ``config show``; after ``--`` to the command."""
    output = shown(cli("config", "show", "evaluate", "--json", "--", "--json", "--fail-if", "rmse_m>5"))
    assert output["json"] == (True, "flag")
    assert output["fail-if"] == (["rmse_m>5"], "flag")


def test_unknown_variables_are_reported(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """A variable without effect is reported on standard error, with the nearest valid one."""
    monkeypatch.setenv("NLOSCTL_LOCALIZE_SEEED", "4")
    outcome = cli("config", "show", "--json")
    assert outcome.err == "nlosctl: NLOSCTL_LOCALIZE_SEEED sets nothing (did you mean 'NLOSCTL_LOCALIZE_SEED'?)\n"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["localise"], "no command 'localise' (did you mean 'localize'?)"),
        (["localize", "--sead", "3"], "--sead"),
        (["localize", "--seed", "x"], "'--seed'"),
    ],
)
def test_usage_errors(cli: Cli, words: list[str], message: str) -> None:
    """An unknown command or flag, and an invalid value, exit 2 with one line, as in the command."""
    outcome = cli("config", "show", *words)
    assert (outcome.code, outcome.out) == (2, b"")
    assert message in outcome.err
    assert len(outcome.err.splitlines()) == 1


@pytest.mark.parametrize("words", [["localize", GOOD], ["config", "show", "localize"]], ids=["run", "show"])
def test_invalid_values_are_reported_with_their_source(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[Any]
) -> None:
    """The message names the variable or file of an invalid value, and only then."""
    (tmp_path / "c.toml").write_text('[localize]\nseed = "x"\n')
    assert "(config c.toml)" in cli(*words, "--config", "c.toml").err
    monkeypatch.setenv("NLOSCTL_LOCALIZE_SEED", "one")
    outcome = cli(*words, "--config", "c.toml")
    assert outcome.code == 2
    assert "(environment NLOSCTL_LOCALIZE_SEED)" in outcome.err
    assert "NLOSCTL" not in cli(*words, "--seed", "two").err


def test_quoted_words_in_the_environment(cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The variable of a repeatable option is split as by a shell: quoted words keep blanks."""
    header = "snapshot,Station name,sensor_x_m,sensor_y_m,bearing_rad,Std dev"
    (tmp_path / "m.csv").write_text(f"{header}\n1,a,0,0,0.8,0.01\n1,b,9,0,2.4,0.01\n")
    monkeypatch.setenv("NLOSCTL_LOCALIZE_COLUMN", "'sensor=Station name' bearing_std_rad='Std dev'")
    outcome = cli("localize", "m.csv", "-q")
    assert outcome.code == 0, outcome.err
    assert outcome.table.column("status").to_pylist() == ["ok"]


def test_open_quotes_in_the_environment(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """An open quote exits 2 with the variable's name."""
    monkeypatch.setenv("NLOSCTL_LOCALIZE_COLUMN", "'sensor=Station name")
    outcome = cli("localize", GOOD)
    assert outcome.code == 2
    assert outcome.err.startswith("nlosctl: NLOSCTL_LOCALIZE_COLUMN: no closing quotation in ")


def test_every_command_reads_the_config(cli: Cli, tmp_path: Path) -> None:
    """A table of any command is accepted."""
    (tmp_path / "c.toml").write_text('[bound]\nmap = "0,1,0,1,1"\n[identify-los]\nseed = 2\n')
    assert shown(cli("config", "show", "bound", "--config", "c.toml", "--json"))["map"] == (
        "0,1,0,1,1",
        "config c.toml",
    )


@pytest.mark.parametrize("words", [[], ["config"]], ids=["nlosctl", "nlosctl config"])
def test_a_group_without_a_command_prints_its_help(cli: Cli, words: list[str]) -> None:
    """A command group alone prints its help and nothing else, and exits 2."""
    outcome = cli(*words)
    assert outcome.code == 2
    assert "Usage: nlosctl" in outcome.text + outcome.err
    assert "nlosctl:" not in outcome.err
