"""``methods``: list, details and check."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cli_support import GOOD, ROOT, Outcome, listing

from nlosctl import __version__

Cli = Callable[..., Outcome]
BUILT_IN = ["ls", "ml", "stansfield"]
SHOWN = ["ls", "bearings.ml", "stansfield", "tdaj", "chi2", "joint", "triplets.ml"]


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the broken plugin of tests/plugin is installed."""
    spec = importlib.util.spec_from_file_location("plugin_support", ROOT / "tests" / "plugin" / "test_plugin.py")
    assert spec is not None
    assert spec.loader is not None
    support = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(support)
    folder: Path = support.install("nlosctl_broken", tmp_path_factory.mktemp("broken"))
    return folder


@pytest.fixture
def with_broken(broken: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli) -> Cli:
    """Run the command line where the broken plugin is installed."""
    monkeypatch.syspath_prepend(str(broken))
    return cli


def test_the_list_names_every_method_by_kind(cli: Cli) -> None:
    """``methods`` lists kind, name, distribution and version; ``--json`` the same."""
    output = cli("methods", "--json").json
    built_in = [row for row in output if row["distribution"] == "nlosctl"]
    assert {"kind": "bearings", "name": "ml", "distribution": "nlosctl", "version": __version__} in built_in
    assert {row["name"] for row in built_in if row["kind"] == "bearings"} >= set(BUILT_IN)
    shown = cli("methods").text
    assert all(f"{row['kind']}  " in shown and f"  {row['name']} " in shown for row in output)


def test_show_lists_all_details(cli: Cli) -> None:
    """Kind, required columns, reference, distribution, cost; type, unit, default, meaning of parameters."""
    output = cli("methods", "show", "bearings.ml", "--json").json
    assert (output["name"], output["kind"], output["job"]) == ("ml", "bearings", "localize")
    assert {"sensor", "bearing_rad", "bearing_std_rad"} <= set(output["required_columns"])
    assert output["distribution"] == f"nlosctl {__version__}"
    assert output["minimum_measurements"] == 1  # one row with bearing and range
    parameters = {item["name"]: item for item in output["parameters"]}
    assert parameters["max_iterations"]["type"] == "int"
    assert parameters["max_iterations"]["default"] == 30
    assert parameters["min_range_m"]["unit"] == "m"


@pytest.mark.parametrize("name", SHOWN)
def test_every_built_in_method_is_described(cli: Cli, name: str) -> None:
    """Reference, summary, cost, and the meaning of every parameter are not empty, in text too."""
    output, shown = cli("methods", "show", name, "--json").json, cli("methods", "show", name).text
    for key in ("summary", "reference", "cost"):
        assert output[key]
        assert output[key] in shown
    for item in output["parameters"]:
        assert item["meaning"]
        assert item["meaning"] in shown
        assert item["name"].endswith("_m") == (item["unit"] == "m")


def test_a_method_can_be_shown_by_its_full_name(cli: Cli) -> None:
    """``KIND.NAME`` shows the same as the bare name."""
    assert cli("methods", "show", "bearings.ls", "--json").json == cli("methods", "show", "ls", "--json").json
    both = cli("methods", "show", "ml", "--json").json
    assert [entry["kind"] for entry in both] == ["arrivals", "bearings", "ranges", "triplets"]


def test_check_loads_all(cli: Cli) -> None:
    """``--check`` reports ok for every method and exits 0."""
    outcome = cli("methods", "--check", "--json")
    assert outcome.code == 0
    assert [row["check"] for row in outcome.json] == ["ok"] * len(outcome.json)


@pytest.mark.process
def test_check_reports_broken_plugins(with_broken: Cli, tmp_path: Path) -> None:
    """With a broken plugin ``--check`` exits 1 with method, distribution and reason."""
    outcome = with_broken("methods", "--check", "--json")
    assert outcome.code == 1
    output: dict[str, Any] = {f"{row['name']} of {row['distribution']}": row["check"] for row in outcome.json}
    assert "ImportError: libfoo.so.3" in output["broken of nlosctl-broken"]
    assert "nlosctl-broken 0.0.1" in output["broken of nlosctl-broken"]
    assert [output[f"{name} of nlosctl"] for name in BUILT_IN] == ["ok"] * 3
    assert len(outcome.err.splitlines()) == 1
    plain = with_broken("methods", "--check")
    assert "ImportError: libfoo.so.3" in plain.text
    assert listing(tmp_path) == []


@pytest.mark.process
def test_broken_plugins_affect_no_other_method(with_broken: Cli) -> None:
    """With a broken plugin the list and every other method work."""
    assert "broken" in [row["name"] for row in with_broken("methods", "--json").json]
    assert with_broken("localize", GOOD, "-m", "ml", "-q").code == 0


@pytest.mark.process
def test_using_a_broken_method_is_reported(with_broken: Cli) -> None:
    """Using or showing the broken method is exit 1 and one line with its fault."""
    for words in (["localize", GOOD, "-m", "broken"], ["methods", "show", "broken"]):
        outcome = with_broken(*words)
        assert outcome.code == 1
        assert len(outcome.err.splitlines()) == 1
        assert "ImportError: libfoo.so.3" in outcome.err


@pytest.mark.process
def test_a_name_that_is_there_twice_is_an_error_when_used(with_broken: Cli) -> None:
    """A duplicate name is exit 2 and names both distributions."""
    outcome = with_broken("localize", GOOD, "-m", "ls")
    assert outcome.code == 2
    assert "nlosctl and nlosctl-broken" in outcome.err


@pytest.mark.process
def test_plugins_can_be_left_out(with_broken: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """``NLOSCTL_NO_PLUGINS=1`` leaves only built-in methods: the check passes, the taken name is free again."""
    monkeypatch.setenv("NLOSCTL_NO_PLUGINS", "1")
    outcome = with_broken("methods", "--check", "--json")
    assert outcome.code == 0
    assert {row["distribution"] for row in outcome.json} == {"nlosctl"}
    assert with_broken("localize", GOOD, "-m", "ls", "-q").code == 0
