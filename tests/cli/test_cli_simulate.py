"""``simulate``: scenarios drawn to files of measurements."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from cli_support import Outcome, read_parquet

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]
SCENARIOS = ["bearings", "mixed", "over-the-horizon", "random", "ring", "song-circle", "song-flat"]
OTHER_KINDS = [
    "arrivals",
    "bearing-field",
    "box",
    "echo-field",
    "liang",
    "madhow-ring",
    "madhow-walls",
    "mixed-ranges",
    "ranges",
    "room",
    "shen",
    "ship",
    "single-station",
    "skywave",
    "space-ring",
    "street",
    "triplets",
    "walk",
]
"""Scenarios that have tests of their own."""


def test_the_list_and_a_scenarios_parameters(cli: Cli) -> None:
    """Without a name scenarios are listed; ``--show`` lists the parameters with unit and meaning."""
    output = cli("simulate", "--json").json
    assert [row["scenario"] for row in output] == sorted([*SCENARIOS, *OTHER_KINDS])
    shown = cli("simulate", "ring", "--show", "--json").json
    parameters = {item["name"]: item for item in shown["parameters"]}
    assert parameters["bearing_std_deg"]["unit"] == "deg"
    assert all(item["meaning"] for item in shown["parameters"])


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_simulations_are_valid_and_solvable(cli: Cli, tmp_path: Path, scenario: str) -> None:
    """A simulation passes ``validate``, has its truth, and is solved with NEES near 2."""
    assert cli("simulate", scenario, "-n", 200, "-o", "m.parquet", "-q").code == 0
    output = cli("validate", "m.parquet", "--json").json
    assert (output["snapshots"], output["bad_rows"]) == (200, 0)
    assert {"truth_x_m", "truth_y_m", "truth_los"} <= set(output["columns"])
    assert cli("localize", "m.parquet", "-o", "e.parquet", "-q").code == 0
    figures = cli("evaluate", "e.parquet", "--json").json["overall"]
    assert figures["rows"] == 200
    assert figures["fix_rate"] > 0.95
    assert 1.5 < figures["nees"] < 2.6


def test_longer_simulations_begin_with_shorter_ones(cli: Cli, tmp_path: Path) -> None:
    """More trials append snapshots; the first ones keep their bits."""
    for count in (30, 1100):
        assert cli("simulate", "random", "-n", count, "-o", f"{count}.parquet", "-q").code == 0
    short, long = read_parquet(tmp_path / "30.parquet"), read_parquet(tmp_path / "1100.parquet")
    assert long.slice(0, short.num_rows).equals(short)
    assert len(set(long.column("snapshot").to_pylist())) == 1100


def test_the_scene_is_written_and_read_back(cli: Cli, tmp_path: Path) -> None:
    """``--scene-out`` writes the scene for solving a CSV file of the same simulation."""
    words = ["simulate", "song-flat", "-n", 20, "-q"]
    assert cli(*words, "-o", "m.csv", "--scene-out", "m.scene.toml").code == 0
    assert cli(*words, "-o", "n.parquet").code == 0
    assert "[[reflector]]" in (tmp_path / "m.scene.toml").read_text()
    assert cli("localize", "m.csv", "-q").out == cli("localize", "n.parquet", "-q").out


def test_parameters_of_a_scenario(cli: Cli) -> None:
    """``--param`` sets a parameter of the scenario."""
    assert cli("simulate", "ring", "-n", 3, "-p", "sensors=5", "-p", "bearing_std_deg=0", "-q").code == 2
    table = cli("simulate", "ring", "-n", 3, "-p", "sensors=5", "-p", "bearing_std_deg=0.5", "-q").table
    assert table.num_rows == 15
    assert table.column("bearing_std_rad").to_pylist() == [pytest.approx(math.radians(0.5))] * 15


def test_options_without_a_scenario_are_refused(cli: Cli) -> None:
    """Parameters, ``--show`` and ``-o`` without a scenario exit 2."""
    for words in (["--show"], ["-p", "sensors=3"], ["--scene-out", "s.toml"], ["-o", "m.csv"]):
        outcome = cli("simulate", *words)
        assert outcome.code == 2, words
        assert "scenario" in outcome.err
