"""The columns that ``--add`` asks for: each declared once, computed once."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import nlosctl
from nlosctl.contract.tables import ADDED_COLUMNS, ESTIMATES
from nlosctl.errors import UsageError
from nlosctl.pipeline.solve.added_columns import ADDED

FIXTURES = Path(__file__).parents[2] / "fixtures"


def simulated(trials: int, **parameters: Any) -> pa.Table:
    """Return bearings with their truth."""
    return nlosctl.simulate("ring", trials=trials, seed=5, **parameters)


def column(table: pa.Table, name: str) -> np.ndarray:
    """Return a column of numbers, null as NaN."""
    return table.column(name).to_numpy(zero_copy_only=False).astype(float)


def independent_nees(table: pa.Table) -> np.ndarray:
    """Return e' C^-1 e of every row by numpy.linalg.solve, NaN without a covariance or truth."""
    values = np.full(table.num_rows, np.nan)
    names = ("x_m", "y_m", "truth_x_m", "truth_y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2")
    for index, (x, y, truth_x, truth_y, xx, xy, yy) in enumerate(
        zip(*(column(table, name) for name in names), strict=True)
    ):
        error = np.array([x - truth_x, y - truth_y])
        if np.isfinite([*error, xx]).all():
            values[index] = error @ np.linalg.solve([[xx, xy], [xy, yy]], error)
    return values


def test_every_declared_column_is_computed() -> None:
    """The words of ``--add`` are those of the declarations, and each column is in the schema of estimates."""
    assert list(ADDED) == list(ADDED_COLUMNS)
    assert {column.name for column in ADDED_COLUMNS.values()} <= set(ESTIMATES.names)


@pytest.mark.parametrize("method", ["ls", "stansfield", "ml"])
def test_nees_is_the_quadratic_form(method: str) -> None:
    """Each value is e' C^-1 e as numpy.linalg.solve computes it; the other columns do not change."""
    given = simulated(200)
    estimates = nlosctl.localize(given, method=method, add=["nees"]).estimates
    np.testing.assert_allclose(column(estimates, "nees"), independent_nees(estimates), rtol=1e-9)
    assert estimates.drop_columns(["nees"]).equals(nlosctl.localize(given, method=method).estimates)


def test_nees_of_single_measurements() -> None:
    """Estimates of single triplets have the truth of their own row; without a covariance the value is null."""
    triplets = pq.read_table(FIXTURES / "good_triplets.parquet")
    estimates = nlosctl.localize(triplets, method="ml", add=["nees", "cep50"]).estimates
    expected = independent_nees(estimates)
    np.testing.assert_allclose(column(estimates, "nees"), expected, rtol=1e-9)
    assert estimates.column("nees").null_count == int(np.isnan(expected).sum())


def test_nees_has_mean_2() -> None:
    """With correct covariances the mean is 2: within four standard errors, sqrt(4 / n) each, for 4000 snapshots."""
    nees = column(nlosctl.localize(simulated(4000, bearing_std_deg=0.5), method="ml", add=["nees"]).estimates, "nees")
    assert np.isfinite(nees).all()
    assert nees.mean() == pytest.approx(2.0, abs=4.0 * np.sqrt(4.0 / nees.size))


def test_nees_without_truth_or_covariance_is_null() -> None:
    """A row without truth, and an estimate without covariance, have no value."""
    given = simulated(4)
    index = given.column_names.index("truth_x_m")
    truth = given.column("truth_x_m").to_pylist()
    per_snapshot = given.num_rows // 4
    truth[:per_snapshot] = [None] * per_snapshot
    given = given.set_column(index, "truth_x_m", pa.array(truth, pa.float64()))
    kept = [*range(given.num_rows - per_snapshot + 1)]  # one bearing is left of the last snapshot
    nees = nlosctl.localize(given.take(kept), method="ls", add=["nees"]).estimates.column("nees").to_pylist()
    assert [value is None for value in nees] == [True, False, False, True]


def test_nees_needs_one_true_position() -> None:
    """An input without truth, or with several targets in a snapshot, is a usage error that says so."""
    given = simulated(2)
    with pytest.raises(UsageError, match=r"nees: needs the true position, but the input has no column 'truth_x_m'"):
        nlosctl.localize(given.drop_columns(["truth_x_m"]), method="ls", add=["nees"])
    targets = given.append_column("truth_target", pa.array(np.zeros(given.num_rows, dtype=np.int64)))
    with pytest.raises(UsageError, match=r"nees: needs one true position per snapshot"):
        nlosctl.localize(targets, method="ls", add=["nees"])


@pytest.mark.process
def test_the_command_line_gives_the_same_column(tmp_path: Path) -> None:
    """``localize --add nees`` writes what ``import nlosctl`` returns, and ``schema`` documents the column."""
    given = simulated(20)
    pq.write_table(given, tmp_path / "in.parquet")
    program = str(Path(sys.executable).with_name("nlosctl"))
    words = [program, "localize", "-m", "ls", "in.parquet", "--add", "nees", "-o", "out.parquet", "-q"]
    subprocess.run(words, cwd=tmp_path, check=True)
    written = pq.read_table(tmp_path / "out.parquet").column("nees")
    assert written.equals(nlosctl.localize(given, method="ls", add=["nees"]).estimates.column("nees"))
    shown = subprocess.run([program, "schema", "estimates"], check=True, capture_output=True, text=True).stdout
    assert re.search(r"\bnees\b.*normalized estimation error squared.*\(--add nees\)", shown)
