"""Flags: columns, excluded rows, and their use as measurements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from cli_support import GOOD, SCENE, Outcome, crossing_rows, good_table, plain_csv, read_parquet, write_parquet

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]
MIRRORS = {"wall": ((0.0, 2000.0), (2.0, 0.5)), "fence": ((-1800.0, 0.0), (0.0, 1.0))}
ANSWER = ["x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2", "n_used", "cost", "status"]


def localize(cli: Cli, folder: Path, *words: Any) -> tuple[Any, Any]:
    """Run and return estimates and flags."""
    outcome = cli("localize", *words, "-o", "e.parquet", "--flags-out", "f.parquet", "--overwrite")
    assert outcome.code == 0, outcome.err
    return read_parquet(folder / "e.parquet"), read_parquet(folder / "f.parquet")


def measured(folder: Path, **columns: Sequence[Any]) -> Path:
    """Write the good rows with further columns and return the path."""
    table = good_table()
    for name, values in columns.items():
        table = table.append_column(name, pa.array(values))
    (folder / "m.scene.toml").write_text(SCENE.read_text())
    return write_parquet(table, folder / "m.parquet")


def some_false() -> list[bool | None]:
    """Return a mark for each of the good rows: mostly true, some false, some unknown."""
    return [None if index % 9 == 0 else index % 7 != 3 for index in range(240)]


@pytest.mark.process
@pytest.mark.usefixtures("small_chunks")
def test_a_row_for_every_row_in_input_order(cli: Cli, tmp_path: Path) -> None:
    """Flags are the input's rows, order and columns to the bit, plus the method's columns."""
    _, flags = localize(cli, tmp_path, GOOD, "--block-size", 7)
    table = good_table()
    assert flags.column_names == [*table.column_names, "used", "residual_rad"]
    assert flags.select(table.column_names).equals(table)
    assert flags.column("used").to_pylist() == [True] * 240


def test_foreign_columns_are_carried(cli: Cli, tmp_path: Path) -> None:
    """Unknown columns of any type are carried along."""
    path = measured(tmp_path, note=[f"n{k}" for k in range(240)], when=np.arange(240).astype("M8[us]"))
    _, flags = localize(cli, tmp_path, path)
    assert flags.select(["note", "when"]).equals(read_parquet(path).select(["note", "when"]))


def seen(position: np.ndarray, reflector: str | None) -> np.ndarray:
    """Return the position, or its image in a mirror."""
    if reflector is None:
        return position
    point, direction = (np.array(pair) for pair in MIRRORS[reflector])
    along = direction / np.hypot(*direction)
    offset = position - point
    return point + 2.0 * (offset @ along) * along - offset


def test_the_residual_is_measured_minus_predicted(cli: Cli, tmp_path: Path) -> None:
    """``residual_rad`` is the bearing minus the one from the estimate (or its mirror image), wrapped."""
    estimates, flags = localize(cli, tmp_path, GOOD)
    position = {row["snapshot"]: np.array([row["x_m"], row["y_m"]]) for row in estimates.to_pylist()}
    for row in flags.to_pylist():
        source = seen(position[row["snapshot"]], row["reflector"])
        predicted = np.arctan2(source[1] - row["sensor_y_m"], source[0] - row["sensor_x_m"])
        expected = (row["bearing_rad"] - predicted + np.pi) % (2 * np.pi) - np.pi
        assert row["residual_rad"] == pytest.approx(expected, abs=1e-12)


@pytest.mark.process
@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize("column", ["los", "ip"])
def test_flagged_rows_are_excluded(cli: Cli, tmp_path: Path, column: str) -> None:
    """Rows with ``los`` false or ``ip`` true keep their flag and change nothing."""
    marks = some_false()
    given = marks if column == "los" else [None if mark is None else not mark for mark in marks]
    path = measured(tmp_path, **{column: given})
    estimates, flags = localize(cli, tmp_path, path)
    assert flags.column(column).to_pylist() == given
    assert flags.column("used").to_pylist() == [mark is not False for mark in marks]
    left_out = pc.invert(flags.column("used"))
    assert flags.filter(left_out).column("residual_rad").null_count == sum(mark is False for mark in marks)
    assert estimates.column("n_measurements").to_pylist() == counts(good_table())
    kept = pa.array([mark is not False for mark in marks])
    write_parquet(read_parquet(path).filter(kept), path)
    alone, flags_alone = localize(cli, tmp_path, path)
    assert estimates.select(ANSWER).equals(alone.select(ANSWER))
    assert flags.filter(kept).equals(flags_alone)


def counts(table: Any) -> list[int]:
    """Return the number of rows of each snapshot."""
    return np.unique(table.column("snapshot").to_numpy(), return_counts=True)[1].tolist()


def test_all_rows_takes_all(cli: Cli, tmp_path: Path) -> None:
    """With ``--all-rows`` an earlier flag has no effect and is carried along."""
    path = measured(tmp_path, los=some_false())
    estimates, flags = localize(cli, tmp_path, path, "--all-rows")
    plain, _ = localize(cli, tmp_path, GOOD)
    assert estimates.equals(plain)
    assert flags.column("used").to_pylist() == [True] * 240
    assert flags.column("los").to_pylist() == some_false()


def test_the_summary_counts_excluded_rows(cli: Cli, tmp_path: Path) -> None:
    """Excluded rows are in the summary."""
    path = measured(tmp_path, los=some_false())
    left = sum(mark is False for mark in some_false())
    assert f"({left} left out: flagged by an earlier step)" in cli("localize", path).err


@pytest.mark.parametrize("extension", ["parquet", "csv", "jsonl"])
def test_flags_are_measurements_again(cli: Cli, tmp_path: Path, extension: str) -> None:
    """Flags as input give the estimates of the first run; method columns are replaced, not duplicated."""
    scene = ["--scene", SCENE]
    assert cli("localize", GOOD, *scene, "-m", "ls", "-o", "e.csv", "--flags-out", f"f.{extension}").code == 0
    again = ["localize", f"f.{extension}", *scene, "-m", "stansfield", "-o", "e2.csv", "--flags-out", "f2.parquet"]
    assert cli(*again).code == 0
    direct = ["localize", GOOD, "-m", "stansfield", "-o", "e3.csv", "--flags-out", "f3.parquet"]
    assert cli(*direct).code == 0
    assert (tmp_path / "e2.csv").read_bytes() == (tmp_path / "e3.csv").read_bytes()
    second, expected = read_parquet(tmp_path / "f2.parquet"), read_parquet(tmp_path / "f3.parquet")
    assert second.column_names == expected.column_names
    assert second.column("residual_rad").equals(expected.column("residual_rad"))


def test_several_methods_repeat_the_rows(cli: Cli, tmp_path: Path) -> None:
    """With several methods every row is repeated under ``method``, with the values of a single run."""
    methods = ["ml", "ls", "stansfield"]
    _, flags = localize(cli, tmp_path, GOOD, *(word for name in methods for word in ("-m", name)))
    assert flags.num_rows == 3 * 240
    for name in methods:
        _, alone = localize(cli, tmp_path, GOOD, "-m", name)
        mine = flags.filter(pc.equal(flags.column("method"), name))
        assert mine.select(alone.column_names).equals(alone)
    first = flags.slice(0, 24).column("method").to_pylist()
    assert first == [name for name in methods for _ in range(8)]


def test_estimates_of_several_methods_follow_each_other(cli: Cli, tmp_path: Path) -> None:
    """Within a snapshot estimates are in the order of the methods given."""
    methods = ["stansfield", "ml", "ls"]
    estimates, _ = localize(cli, tmp_path, GOOD, *(word for name in methods for word in ("-m", name)))
    assert estimates.column("method").to_pylist() == methods * 40
    assert estimates.column("snapshot").to_pylist() == [index for index in range(40) for _ in range(3)]
    for name in methods:
        alone, _ = localize(cli, tmp_path, GOOD, "-m", name)
        assert estimates.filter(pc.equal(estimates.column("method"), name)).equals(alone)


def test_a_snapshot_without_answer_has_flags_too(cli: Cli, tmp_path: Path) -> None:
    """A snapshot without an estimate keeps its rows: not used, no residual."""
    (tmp_path / "m.csv").write_text(plain_csv([*crossing_rows(1, 1), *crossing_rows(2)]))
    estimates, flags = localize(cli, tmp_path, "m.csv")
    assert estimates.column("status").to_pylist() == ["too_few", "ok"]
    assert estimates.slice(0, 1).select(["x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2"]).to_pylist() == [
        dict.fromkeys(["x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2"])
    ]
    assert flags.column("used").to_pylist() == [False, True, True, True]
    assert flags.column("residual_rad").is_null().to_pylist() == [True, False, False, False]


def test_a_snapshot_of_excluded_rows_has_a_row(cli: Cli, tmp_path: Path) -> None:
    """A snapshot whose rows are all excluded is too_few."""
    rows = [(*row, "false") for row in crossing_rows(1)] + [(*row, "true") for row in crossing_rows(2)]
    header = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad,los"
    (tmp_path / "m.csv").write_text(plain_csv(rows, header))
    estimates, _ = localize(cli, tmp_path, "m.csv")
    rows = estimates.select(["status", "n_measurements", "n_used"]).to_pylist()
    assert rows[0] == {"status": "too_few", "n_measurements": 3, "n_used": 0}
    assert rows[1] == {"status": "ok", "n_measurements": 3, "n_used": 3}


def test_flags_on_stdout(cli: Cli) -> None:
    """``--flags-out -`` prints the flags; two tables on one stdout are refused."""
    outcome = cli("localize", GOOD, "-o", "e.csv", "--flags-out", "-")
    assert outcome.table.column_names[-2:] == ["used", "residual_rad"]
    refused = cli("localize", GOOD, "--flags-out", "-")
    assert (refused.code, refused.out) == (2, b"")


def test_flags_in_a_pipe_can_carry_the_scene(cli: Cli) -> None:
    """``--format`` applies to the table without an extension: flags on stdout as Arrow have types and scene."""
    outcome = cli("localize", GOOD, "-q", "-o", "e.parquet", "--flags-out", "-", "--format", "arrow")
    assert outcome.code == 0
    again = cli("localize", "-", "-q", stdin=outcome.out)
    assert again.code == 0, again.err
    assert again.out == cli("localize", GOOD, "-q").out


def test_carried_columns_reach_the_estimates(cli: Cli, tmp_path: Path) -> None:
    """Truth, ``sweep_*``, ``scene`` and ``--carry`` columns have the first row's value; others are dropped."""
    path = measured(
        tmp_path,
        sweep_sigma_deg=[float(index) for index in range(240)],
        scene=["yard"] * 240,
        site=[f"site {index}" for index in range(240)],
        other=[1] * 240,
    )
    estimates, _ = localize(cli, tmp_path, path, "--carry", "site")
    assert estimates.column_names[-5:] == ["truth_x_m", "truth_y_m", "sweep_sigma_deg", "scene", "site"]
    first = np.concatenate([[0], np.cumsum(counts(good_table()))[:-1]])
    assert estimates.column("sweep_sigma_deg").to_pylist() == first.astype(float).tolist()
    assert estimates.column("site").to_pylist() == [f"site {index}" for index in first]
