"""Convention 6: JSON reports; typed parameters; flag > environment > config > default."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from cli_support import GOOD, Outcome, listing, provenance

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]


@pytest.mark.parametrize(
    "words",
    [
        ["methods"],
        ["methods", "--check"],
        ["methods", "show", "ml"],
        ["schema"],
        ["schema", "bearings"],
        ["simulate"],
        ["simulate", "ring", "--show"],
        ["validate", GOOD],
        ["evaluate", "e.csv"],
    ],
    ids=lambda words: " ".join(map(str, words)).replace(str(GOOD), "FILE"),
)
def test_reports_as_json(cli: Cli, words: list[Any]) -> None:
    """``--json`` prints only strict JSON on stdout; without it there is a table."""
    if words[-1] == "e.csv":
        cli("localize", GOOD, "-o", "e.csv")
    outcome, plain = cli(*words, "--json"), cli(*words)
    assert outcome.code == plain.code == 0
    assert outcome.err == ""
    assert outcome.json
    with pytest.raises(ValueError, match="Expecting value"):
        _ = plain.json


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["-p", "max_iterations=7"], {"max_iterations": 7, "min_range_m": 0.0}),
        (["-p", "min_range_m=2"], {"max_iterations": 30, "min_range_m": 2.0}),
        (["-p", "min_range_m=1e-3", "-p", "max_iterations=1"], {"max_iterations": 1, "min_range_m": 0.001}),
    ],
)
def test_parameters_are_typed(cli: Cli, tmp_path: Path, words: list[str], expected: dict[str, Any]) -> None:
    """A parameter has its type, the others keep their defaults; the provenance records all."""
    assert cli("localize", GOOD, *words, "-o", "e.parquet").code == 0
    (recorded,) = parameters(tmp_path / "e.parquet").values()
    assert expected.items() <= recorded.items()


def parameters(path: Path) -> dict[str, Any]:
    """Return the parameters of each method from a file's provenance."""
    return {method["name"]: method["parameters"] for method in provenance(path)["methods"]}


def test_parameters_of_several_methods(cli: Cli, tmp_path: Path) -> None:
    """Plain keys apply to all methods that have them; ``METHOD:key`` applies to one and takes precedence."""
    methods = ["--method", "ml", "--method", "ls", "--method", "stansfield"]
    given = [
        "-p",
        "ls:min_range_m=3",
        "-p",
        "min_range_m=1",
        "-p",
        "stansfield:min_range_m=2",
        "-p",
        "max_iterations=9",
    ]
    assert cli("localize", GOOD, *methods, *given, "-o", "e.parquet").code == 0
    recorded = parameters(tmp_path / "e.parquet")
    assert list(recorded) == ["bearings.ml", "bearings.ls", "bearings.stansfield"]
    assert {"max_iterations": 9, "min_range_m": 1.0}.items() <= recorded["bearings.ml"].items()
    assert (recorded["bearings.ls"]["min_range_m"], recorded["bearings.stansfield"]["min_range_m"]) == (3.0, 2.0)
    assert "max_iterations" not in recorded["bearings.ls"]


def test_a_parameter_that_the_named_method_lacks(cli: Cli) -> None:
    """``METHOD:key`` is checked against the options of that method."""
    outcome = cli("localize", GOOD, "--method", "ml", "--method", "ls", "-p", "ls:max_iterations=3")
    assert outcome.code == 2
    assert "'ls'" in outcome.err
    assert "'max_iterations'" in outcome.err


def test_parameters_change_the_result(cli: Cli) -> None:
    """A parameter reaches the method."""
    table = cli("localize", GOOD, "-p", "max_iterations=1", "-q").table
    assert "not_converged" in table.column("status").to_pylist()


@pytest.mark.parametrize(("flag", "environment", "config"), list(product([False, True], repeat=3)))
def test_flag_beats_environment_beats_config_beats_default(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flag: bool, environment: bool, config: bool
) -> None:
    """Flag > ``NLOSCTL_*`` > config > default for a number, a list and a parameter, in every combination."""
    words: list[Any] = ["localize", GOOD, "-o", "e.parquet", "-q"]
    expected: tuple[int, list[str], float] = (0, ["ml"], 0.0)
    if config:
        text = '[localize]\nseed = 1\nmethod = ["ls"]\nparam = { min_range_m = 1.0 }\n[simulate]\nseed = 9\n'
        (tmp_path / "c.toml").write_text(text)
        words += ["--config", "c.toml"]
        expected = (1, ["ls"], 1.0)
    if environment:
        monkeypatch.setenv("NLOSCTL_LOCALIZE_SEED", "2")
        monkeypatch.setenv("NLOSCTL_LOCALIZE_METHOD", "stansfield ml")
        monkeypatch.setenv("NLOSCTL_LOCALIZE_PARAM", "min_range_m=2")
        expected = (2, ["stansfield", "ml"], 2.0)
    if flag:
        words += ["--seed", "3", "--method", "ml", "--method", "ls", "-p", "min_range_m=3"]
        expected = (3, ["ml", "ls"], 3.0)
    assert cli(*words).code == 0
    recorded = provenance(tmp_path / "e.parquet")
    names = [method["name"].removeprefix("bearings.") for method in recorded["methods"]]
    ranges = {method["parameters"]["min_range_m"] for method in recorded["methods"]}
    assert (recorded["seed"], names, ranges) == (expected[0], expected[1], {expected[2]})


def test_the_config_file_can_be_named_by_the_environment(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``NLOSCTL_CONFIG`` names the file for every command; each reads its own table."""
    (tmp_path / "c.toml").write_text("[simulate]\ntrials = 4\nquiet = true\n[localize]\nstrict = true\n")
    monkeypatch.setenv("NLOSCTL_CONFIG", "c.toml")
    outcome = cli("simulate", "ring", "-p", "sensors=1")
    assert outcome.err == ""
    assert outcome.table.num_rows == 4
    assert cli("localize", "-", stdin=outcome.out).code == 3


def test_options_with_dashes_in_the_config(cli: Cli, tmp_path: Path) -> None:
    """Keys are the long options as written, with dashes, ``json`` too."""
    (tmp_path / "c.toml").write_text('[localize]\n"flags-out" = "f.csv"\nblock-size = 3\n[evaluate]\njson = true\n')
    assert cli("localize", GOOD, "-o", "e.csv", "--config", "c.toml").code == 0
    assert listing(tmp_path) == ["c.toml", "e.csv", "f.csv"]
    evaluated = cli("evaluate", "e.csv", "--config", "c.toml")
    assert evaluated.code == 0, evaluated.err
    assert evaluated.json["of"] == "estimates"


def test_json_can_be_asked_for_by_the_environment(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """The variable of an option is ``NLOSCTL_<COMMAND>_<OPTION>``, also for ``--json``."""
    cli("localize", GOOD, "-o", "e.csv")
    monkeypatch.setenv("NLOSCTL_EVALUATE_JSON", "1")
    assert cli("evaluate", "e.csv").json["of"] == "estimates"


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ('[localize]\nmetod = ["ls"]\n', 2, ["'metod'", "did you mean 'method'"]),
        ('[localise]\nmethod = ["ls"]\n', 2, ["localise", "did you mean 'localize'"]),
        ("localize = 3\n", 2, ["localize"]),
        ('[localize]\nseed = "one"\n', 2, ["seed", "integer"]),
        ('[localize]\nparam = { min_range = 1.0 }\n', 2, ["'min_range'", "did you mean 'min_range_m'"]),
        ("[localize\n", 1, ["c.toml", "TOML", "line 1"]),
    ],
    ids=["key", "table", "no-table", "type", "parameter", "syntax"],
)  # fmt: skip
def test_config_errors(cli: Cli, tmp_path: Path, text: str, code: int, message: list[str]) -> None:
    """A misspelt table or key, a wrong type and invalid TOML are one line each."""
    (tmp_path / "c.toml").write_text(text)
    outcome = cli("localize", GOOD, "-o", "e.csv", "--config", "c.toml")
    assert outcome.code == code, outcome.err
    assert len(outcome.err.splitlines()) == 1
    assert [word for word in message if word not in outcome.err] == []
    assert listing(tmp_path) == ["c.toml"]


def test_a_missing_config(cli: Cli) -> None:
    """A missing config file exits 1 with one line."""
    outcome = cli("localize", GOOD, "--config", "absent.toml")
    assert outcome.code == 1
    assert outcome.err == "nlosctl: --config absent.toml: No such file or directory\n"
