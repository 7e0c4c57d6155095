"""Groups of columns that are complete or absent, and flags of several methods, which can't be solved together."""

from __future__ import annotations

from pathlib import Path

import pytest

from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import DataError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import expand_inputs

HEADER = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad"
COVARIANCE = "prior_x_m,prior_y_m,prior_cov_xx_m2,prior_cov_xy_m2,prior_cov_yy_m2"
ROWS = ["1,a,0,0,0.5,0.01", "1,b,9,0,2.0,0.01", "2,a,0,0,0.6,0.01", "2,b,9,0,2.1,0.01"]


def read(path: Path, *, chunk_rows: int = 1000) -> int:
    """Return how many good rows a file has; raises DataError."""
    with_all = InputOptions(chunk_rows=chunk_rows)
    return sum(len(chunk.left_out) for chunk in MeasurementReader(expand_inputs([str(path)]), with_all).chunks())


def write(path: Path, extra: str, cells: list[str]) -> Path:
    """Write the four rows with further columns."""
    lines = [f"{HEADER},{extra}", *(f"{row},{cell}" for row, cell in zip(ROWS, cells, strict=True))]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_whole_prior_is_read(tmp_path: Path) -> None:
    """All three columns of a prior, with all or no values in each row, are valid."""
    assert read(write(tmp_path / "m.csv", "prior_x_m,prior_y_m,prior_std_m", ["1,2,3", "1,2,3", ",,", ",,"])) == 4


def test_a_prior_with_a_covariance_is_read(tmp_path: Path) -> None:
    """Position and covariance, with all or no values in each row, are valid."""
    assert read(write(tmp_path / "m.csv", COVARIANCE, ["1,2,4,-1,9", "1,2,4,-1,9", ",,,,", ",,,,"])) == 4


@pytest.mark.parametrize("xy", ["6", "-6.5"])
def test_a_covariance_that_is_not_positive_definite_is_a_bad_row(tmp_path: Path, xy: str) -> None:
    """The square of the mixed entry must be below the product of the others."""
    path = write(tmp_path / "m.csv", COVARIANCE, ["1,2,4,1,9", f"1,2,4,{xy},9", ",,,,", ",,,,"])
    message = rf"row 2 \(line 3\), column 'prior_cov_xy_m2': got {xy}, expected a covariance whose square is below"
    with pytest.raises(DataError, match=message):
        read(path)


def test_two_spreads_of_a_prior_are_an_error(tmp_path: Path) -> None:
    """A prior has a standard deviation or a covariance, not both."""
    with pytest.raises(DataError, match=r"give prior_x_m, prior_y_m, prior_std_m or prior_x_m, .* alone"):
        read(write(tmp_path / "m.csv", f"{COVARIANCE},prior_std_m", ["1,2,4,1,9,2"] * 4))


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ("prior_x_m,prior_y_m,prior_cov_xx_m2", "column 'prior_x_m' needs 'prior_cov_xy_m2' and 'prior_cov_yy_m2'"),
        ("prior_x_m", "column 'prior_x_m' needs 'prior_y_m' and 'prior_std_m'"),
        ("prior_x_m,prior_y_m", "column 'prior_x_m' needs 'prior_std_m'"),
        ("prior_std_m", "column 'prior_std_m' needs 'prior_x_m' and 'prior_y_m'"),
    ],
)
def test_half_a_prior_is_an_error(tmp_path: Path, columns: str, message: str) -> None:
    """An incomplete prior is an error that names the columns to add or drop."""
    cells = [",".join("1" for _ in columns.split(","))] * 4
    with pytest.raises(DataError, match=message):
        read(write(tmp_path / "m.csv", columns, cells))


@pytest.mark.parametrize(("cell", "column"), [("1,,3", "prior_y_m"), (",2,3", "prior_x_m"), (",,3", "prior_x_m")])
def test_a_half_filled_row_is_told(tmp_path: Path, cell: str, column: str) -> None:
    """A row with some of the values is a bad row; the message names the first empty column."""
    path = write(tmp_path / "m.csv", "prior_x_m,prior_y_m,prior_std_m", ["1,2,3", cell, ",,", ",,"])
    message = rf"row 2 \(line 3\), column '{column}': got an empty cell \(null\), expected all of"
    with pytest.raises(DataError, match=message):
        read(path)


@pytest.mark.parametrize("chunk_rows", [1, 3, 1000])
def test_flags_of_several_methods_are_refused(tmp_path: Path, chunk_rows: int) -> None:
    """Flags of two methods within a snapshot are reported as such, not as duplicates, at any chunk size."""
    path = write(tmp_path / "f.csv", "method,used", ["ml,true", "ml,true", "ml,true", "ls,true"])
    with pytest.raises(DataError, match=r"f.csv, column 'method': flags of several methods \((ml, )?ls"):
        read(path, chunk_rows=chunk_rows)


def test_flags_of_one_method_each_are_read(tmp_path: Path) -> None:
    """One method per snapshot is not a repetition; neither is a column 'method' of other files."""
    assert read(write(tmp_path / "f.csv", "method,used", ["ml,true", "ml,true", "ls,true", "ls,true"])) == 4
    assert read(write(tmp_path / "m.csv", "method,room", ["toa,1", "aoa,1", "toa,1", "aoa,1"])) == 4
