"""``--sweep``: a parameter at several values, recorded in a column of all results."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet
import pytest
from cli_support import GOOD, Outcome

import nlosctl

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]


def rows(outcome: Outcome) -> pa.Table:
    """Return a CSV output as a table; raises where the command failed."""
    assert outcome.code == 0, outcome.err
    return outcome.table


def only(table: pa.Table, **values: object) -> pa.Table:
    """Return the rows of those values, without the columns of the sweep."""
    for name, value in values.items():
        table = table.filter(pc.is_null(table.column(name)) if value is None else pc.equal(table.column(name), value))
    return table.drop_columns(list(values))


def test_a_swept_simulation_is_its_points_one_after_the_other(cli: Cli) -> None:
    """A grid point is the simulation with its values; snapshots are numbered through, the last key fastest."""
    swept = rows(cli("simulate", "ring", "-n", 3, "--sweep", "bearing_std_deg=0.5,4", "--sweep", "sensors=3,5"))
    points = [(std, sensors) for std in (0.5, 4.0) for sensors in (3, 5)]
    assert swept.column("snapshot").unique().to_pylist() == list(range(12))
    for index, (std, sensors) in enumerate(points):
        alone = rows(cli("simulate", "ring", "-n", 3, "-p", f"bearing_std_deg={std}", "-p", f"sensors={sensors}"))
        mine = only(swept, sweep_bearing_std_deg=std, sweep_sensors=sensors)
        shifted = pc.add(alone.column("snapshot"), 3 * index)
        assert mine.equals(alone.set_column(0, "snapshot", shifted))


def test_a_swept_method_is_its_runs(cli: Cli) -> None:
    """Estimates at each value are those of ``--param``; a method without the parameter runs once, with null."""
    words = ("localize", GOOD, "-m", "ls", "-m", "mixture-ml")
    swept = rows(cli(*words, "--sweep", "alpha=0.1,0.3"))
    assert swept.num_rows == 3 * len(swept.column("snapshot").unique())
    for value in ("0.1", "0.3"):
        alone = rows(cli(*words, "-p", f"alpha={value}"))
        mine = only(swept, sweep_alpha=float(value), method="mixture-ml")
        assert mine.equals(only(alone, method="mixture-ml"))
    alone = only(rows(cli(*words)), method="ls")
    assert only(swept, sweep_alpha=None, method="ls").equals(alone)


def test_a_sweep_of_one_method_alone(cli: Cli) -> None:
    """``METHOD:KEY`` sweeps a parameter of one method that several have."""
    swept = rows(cli("localize", GOOD, "-m", "ls", "-m", "ml", "--sweep", "ml:min_range_m=0,5"))
    groups = swept.group_by(["method", "sweep_min_range_m"], use_threads=False).aggregate([("snapshot", "count")])
    assert groups.select(["method", "sweep_min_range_m"]).to_pylist() == [
        {"method": "ls", "sweep_min_range_m": None},
        {"method": "ml", "sweep_min_range_m": 0},
        {"method": "ml", "sweep_min_range_m": 5},
    ]


def test_from_simulate_to_evaluate_in_pipes(cli: Cli) -> None:
    """A pipe of simulate, localize and evaluate gives a row per method and swept value."""
    drawn = cli("simulate", "ring", "-n", 50, "--sweep", "bearing_std_deg=0.1,1,5", "--format", "arrow")
    fixes = cli("localize", "-", "-m", "ls", "-m", "ml", stdin=drawn.out)
    scores = rows(cli("evaluate", "-", stdin=fixes.out))
    output = cli("evaluate", "-", "--json", stdin=fixes.out).json["groups"]
    assert scores.num_rows == len(output) == 6
    assert set(scores.column("of").to_pylist()) == {"estimates"}
    for name in ("method", "sweep_bearing_std_deg", "rows", "rmse_m", "rmse_std_error_m", "nees", "p95_m"):
        assert scores.column(name).to_pylist() == [group[name] for group in output]
    assert scores.column("status_ok").to_pylist() == [group["statuses"]["ok"] for group in output]
    rmse = [group["rmse_m"] for group in output if group["method"] == "ml"]
    assert rmse == sorted(rmse)


def test_the_bound_carries_swept_values(cli: Cli) -> None:
    """A bound at the truth has the ``sweep_*`` columns of its measurements."""
    drawn = cli("simulate", "ring", "-n", 2, "--sweep", "bearing_std_deg=1,2")
    bounds = rows(cli("bound", "-", stdin=drawn.out))
    assert bounds.column("sweep_bearing_std_deg").to_pylist() == [1, 1, 2, 2]
    small, large = bounds.column("rms_m").to_pylist()[0], bounds.column("rms_m").to_pylist()[2]
    assert large == pytest.approx(2.0 * small)


def test_swept_flags_are_evaluated_apart(cli: Cli) -> None:
    """Flags of a swept detector repeat the rows per value; evaluate separates them."""
    drawn = cli("simulate", "shen", "-n", 40).out
    flags = cli("detect-ip", "-", "-m", "tdaj", "--sweep", "eta_m=1,4", stdin=drawn)
    groups = cli("evaluate", "-", "--json", stdin=flags.out).json["groups"]
    assert [group["sweep_eta_m"] for group in groups] == [1, 4]
    for group in groups:
        alone = cli("detect-ip", "-", "-m", "tdaj", "-p", f"eta_m={group['sweep_eta_m']}", stdin=drawn)
        assert cli("evaluate", "-", "--json", stdin=alone.out).json["overall"].items() <= group.items()


def test_swept_echo_flags_are_evaluated_apart(cli: Cli, tmp_path: Path) -> None:
    """Flags and estimates of a swept ``identify-los`` are matched by value."""
    drawn = cli("simulate", "echo-field", "-n", 4).out
    (tmp_path / "m.csv").write_bytes(drawn)
    words = ("identify-los", "m.csv", "-m", "tca", "--overwrite", "-o", "f.csv", "--estimates-out", "e.csv")
    assert cli(*words, "--sweep", "targets=1,2").code == 0
    groups = cli("evaluate", "f.csv", "--estimates", "e.csv", "--json").json["groups"]
    assert [group["sweep_targets"] for group in groups] == [1, 2]
    for group in groups:
        assert cli(*words, "-p", f"targets={group['sweep_targets']}").code == 0
        alone = cli("evaluate", "f.csv", "--estimates", "e.csv", "--json").json["overall"]
        assert alone.items() <= group.items()


def test_swept_flags_are_refused_as_input(cli: Cli) -> None:
    """Flags with several swept values of a snapshot are refused, with the name of the column."""
    assert cli("localize", GOOD, "-m", "ml", "--sweep", "min_range_m=0,5", "--flags-out", "f.csv").code == 0
    outcome = cli("localize", "f.csv")
    assert outcome.code == 1
    assert "f.csv, column 'sweep_min_range_m'" in outcome.err


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["bearing_std=1"], "no parameter 'bearing_std' (did you mean 'bearing_std_deg'?)"),
        (["bearing_std_deg=1,two"], "must be a float in the range (0, 180). Got 'two'"),
        (["sensors=3,4.5"], "must be an int"),
        (["bearing_std_deg"], "--sweep takes KEY=VALUE"),
        (["bearing_std_deg="], "--sweep takes KEY=VALUE,VALUE"),
        (["bearing_std_deg=1,,2"], "--sweep takes KEY=VALUE,VALUE"),
        (["bearing_std_deg=1,1.0"], "bearing_std_deg=1.0 occurs twice"),
        (["sensors=3", "sensors=4"], "--sweep sensors is given twice"),
        (
            ["sensors=" + ",".join(map(str, range(3, 200))), "radius_m=" + ",".join(map(str, range(1, 100)))],
            "19503 points",
        ),
    ],
)
def test_invalid_sweeps(cli: Cli, words: list[str], text: str) -> None:
    """An unknown key, an invalid, missing or repeated value exit 2 with the cure."""
    outcome = cli("simulate", "ring", *(part for word in words for part in ("--sweep", word)))
    assert outcome.code == 2
    assert text in outcome.err
    assert outcome.out == b""


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["ring", "-p", "sensors=4", "--sweep", "sensors=3,4"], "'sensors' is given by --param and by --sweep"),
        (["over-the-horizon", "--sweep", "ground_radius_m=6e6,7e6"], "moves the reflectors"),
        (["--sweep", "sensors=3,4"], "name a scenario"),
    ],
)
def test_contradicting_sweeps(cli: Cli, words: list[str], text: str) -> None:
    """A parameter set twice, moving reflectors, and an empty sweep exit 2."""
    outcome = cli("simulate", *words)
    assert outcome.code == 2
    assert text in outcome.err


def test_the_column_of_an_earlier_sweep_is_kept(cli: Cli) -> None:
    """A sweep over a key that the input already has exits 2."""
    drawn = rows(cli("simulate", "ring", "-n", 2))
    content = io.BytesIO()
    pyarrow.csv.write_csv(drawn.append_column("sweep_min_range_m", pa.array([1] * drawn.num_rows)), content)
    outcome = cli("localize", "-", "--sweep", "min_range_m=0,5", stdin=content.getvalue())
    assert outcome.code == 2
    assert "the input has a column 'sweep_min_range_m'" in outcome.err


def test_functions_sweep_as_the_command_does(cli: Cli, tmp_path: Path) -> None:
    """``nlosctl.simulate`` and ``localize`` take ``sweep`` and give the tables of the command line."""
    assert cli("simulate", "ring", "-n", 5, "--sweep", "bearing_std_deg=1,2", "-o", "m.parquet").code == 0
    written = pyarrow.parquet.read_table(tmp_path / "m.parquet")
    drawn = nlosctl.simulate("ring", trials=5, sweep={"bearing_std_deg": [1.0, 2.0]})
    assert drawn.equals(written.replace_schema_metadata(None))
    assert drawn.schema.metadata[b"nlosctl"] == written.schema.metadata[b"nlosctl"]
    assert cli("localize", "m.parquet", "--sweep", "min_range_m=0,5", "-o", "e.parquet").code == 0
    estimates = nlosctl.localize(drawn, sweep={"min_range_m": [0.0, 5.0]}).estimates
    assert estimates.equals(pyarrow.parquet.read_table(tmp_path / "e.parquet").replace_schema_metadata(None))


def test_a_sweep_does_not_depend_on_blocks_or_jobs(cli: Cli) -> None:
    """A swept run has the same bytes for any block size and number of jobs."""
    words = ("localize", GOOD, "-m", "ls", "-m", "mixture-ml", "--sweep", "alpha=0.1,0.3")
    assert cli(*words, "--block-size", 7, "--jobs", 2).out == cli(*words, "--jobs", 1).out
