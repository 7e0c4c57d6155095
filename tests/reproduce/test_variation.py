"""Figures with other parameters than the paper's: typed, checked, and without a verdict."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet
import pytest
from program import run_here

from nlosctl.errors import UsageError
from nlosctl.reproduce.catalogue import experiment_names, find_experiment
from nlosctl.reproduce.variation import parameter_names, varied


@pytest.mark.parametrize("name", experiment_names())
def test_the_papers_own_values_change_nothing(name: str) -> None:
    """Every condition of every experiment is a parameter; with the paper's values it is the same experiment."""
    experiment = find_experiment(name)
    axes = [name for name in parameter_names(experiment) if all(name in item for item in experiment.conditions)]
    for parameter in axes:
        values = dict.fromkeys(condition[parameter] for condition in experiment.conditions)
        rest = {frozenset((k, v) for k, v in item.items() if k != parameter) for item in experiment.conditions}
        if len(rest) * len(values) == len(experiment.conditions) and "," not in "".join(map(str, values)):
            assert varied(experiment, {parameter: ",".join(map(str, values))}) is experiment


def test_other_values_have_no_claims() -> None:
    """The conditions are all combinations of the values given and the paper's others."""
    experiment = varied(find_experiment("song-fig9"), {"bearing_std_deg": "0.7,2", "grid_step_m": "500"})
    assert [dict(condition) for condition in experiment.conditions] == [
        {"parameter_set": name, "bearing_std_deg": std, "grid_step_m": 500.0} for name in "ab" for std in (0.7, 2.0)
    ]
    assert (experiment.claims, experiment.comparisons) == ((), ())


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"bering_std_deg": "1"}, "song-fig9 has no parameter 'bering_std_deg' .did you mean 'bearing_std_deg'"),
        ({"bearing_std_deg": "1,x"}, "must be a number larger than 0. Got 'x' instead"),
        ({"bearing_std_deg": "-1"}, "must be a number larger than 0. Got '-1' instead"),
        ({"parameter_set": "c"}, "must be one of a, b. Got 'c' instead"),
        ({"grid_step_m": "1"}, "grid_step_m"),
        ({"layer_height_m": "high"}, "layer_height_m"),
    ],
)
def test_impossible_parameters(parameters: dict[str, str], message: str) -> None:
    """Unknown names and impossible values are usage errors that name the experiment's parameters."""
    with pytest.raises(UsageError, match=message):
        varied(find_experiment("song-fig9"), parameters)


def test_the_command_writes_and_prints_numbers(tmp_path: Path) -> None:
    """``reproduce song-fig8 -p bearing_std_deg=1,3`` prints and writes a row per value."""
    words = ["reproduce", "song-fig8", "-n", "40", "-p", "bearing_std_deg=0.02,0.2", "-o", "out", "--json", "-q"]
    done = run_here(*words, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)
    assert [row["bearing_std_deg"] for row in rows] == [0.02, 0.2]
    assert all("verdict" not in row for row in rows)
    written = pyarrow.parquet.read_table(tmp_path / "out" / "song-fig8.parquet").to_pylist()
    assert [row["rmse_ml_m"] for row in written] == [row["rmse_ml_m"] for row in rows]
    assert 5.0 < rows[1]["rmse_ml_m"] / rows[0]["rmse_ml_m"] < 20.0
    other = run_here("reproduce", "song-fig8", "-n", "40", "-p", "bearing_std_deg=1", "-o", "out", folder=tmp_path)
    assert (other.returncode, b"--overwrite" in other.stderr) == (1, True)
    page = run_here("reproduce", "song-fig8", "-p", "bearing_std_deg=1", "-o", "out", "--page", "p.md", folder=tmp_path)
    assert page.returncode == 2


def test_the_world_of_song_fig9(tmp_path: Path) -> None:
    """A lower layer, a coarser grid: the samples follow the parameters."""
    words = ["reproduce", "song-fig9", "-n", "8", "-p", "parameter_set=a", "-p", "bearing_std_deg=1", "--json", "-q"]
    paper, lower = (
        json.loads(run_here(*words, "-p", "grid_step_m=5000", *extra, folder=tmp_path).stdout)
        for extra in ([], ["-p", "layer_height_m=200000"])
    )
    assert paper[0]["rmse_crlb_m"] != lower[0]["rmse_crlb_m"]
    assert lower[0]["layer_height_m"] == 200000.0
