"""Wide tables, missing values, conditions on rows and declination, against plain Python and polars."""

from __future__ import annotations

import csv
import math
import operator
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pyarrow as pa
import pyarrow.parquet
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from reading_support import Gathered, read, save, whole

from nlosctl.errors import DataError, GatheredError, UsageError
from nlosctl.io.row_steps.conditions import parse_condition

QUICK = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
OPERATORS = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
SCENE = "".join(f'[[sensor]]\nname = "{name}"\nposition = [{x}, 0.0]\n' for x, name in enumerate("abcd"))
CONSTANTS = {"bearing_std_rad": 0.01}


def write_rows(path: Path, header: list[str], rows: list[list[Any]]) -> Path:
    """Write a CSV file and its scene."""
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([header, *rows])
    (path.parent / "scene.toml").write_text(SCENE)
    return path


cells = st.one_of(st.none(), st.just("-999"), st.integers(0, 359), st.floats(0.0, 359.0).map(lambda x: round(x, 3)))
wide_rows = st.lists(st.tuples(cells, cells, cells), min_size=1, max_size=8).filter(
    lambda rows: any(cell not in (None, "-999") for row in rows for cell in row)
)


@QUICK
@given(rows=wide_rows, parquet=st.booleans())
def test_wide_rows_are_those_of_an_unpivot(tmp_path: Path, rows: list[tuple[Any, ...]], parquet: bool) -> None:
    """A wide table gives the rows of polars' unpivot, sorted by row, without empty and missing cells."""
    numbers = [[None if cell is None else float(cell) for cell in row] for row in rows]
    frame = polars.DataFrame(
        {"snapshot": range(len(rows)), **{f"az_{s}": [row[k] for row in numbers] for k, s in enumerate("abc")}},
        schema_overrides=dict.fromkeys(("az_a", "az_b", "az_c"), polars.Float64),
    )
    long = frame.unpivot(index="snapshot", variable_name="sensor", value_name="azimuth_deg")
    long = long.filter(polars.col("azimuth_deg").is_not_null(), polars.col("azimuth_deg") != -999.0)
    expected = long.with_columns(polars.col("sensor").str.slice(3)).sort("snapshot", "sensor")
    path = write_rows(
        tmp_path / "wide.csv", ["snapshot", "az_a", "az_b", "az_c"], [[n, *r] for n, r in enumerate(rows)]
    )
    if parquet:
        path = save(frame.to_arrow(), tmp_path / "wide.parquet")
    found = whole(read([path], wide=["azimuth_deg=az_*"], missing=["-999"], constants=CONSTANTS)).table
    assert found["snapshot"].to_pylist() == expected["snapshot"].to_list()
    assert found["sensor"].to_pylist() == expected["sensor"].to_list()
    assert found["azimuth_deg"].to_pylist() == expected["azimuth_deg"].to_list()


numbers = st.one_of(st.none(), st.integers(-3, 3), st.floats(-3.0, 3.0).map(lambda x: round(x, 1)))


@QUICK
@given(
    values=st.lists(numbers, min_size=1, max_size=12),
    words=st.lists(st.sampled_from(["", "x", "y", "zz"]), min_size=12, max_size=12),
    sign=st.sampled_from(sorted(OPERATORS)),
    limit=st.integers(-3, 3),
    word=st.sampled_from(["x", "y", "m"]),
    blank=st.sampled_from(["", " "]),
)
def test_rows_are_those_that_meet_all_conditions(
    tmp_path: Path, values: list[Any], words: list[str], sign: str, limit: int, word: str, blank: str
) -> None:
    """Conditions select the rows of a loop in Python; an empty cell meets ``!=`` only."""

    def met(value: Any, other: Any) -> bool:
        return sign == "!=" if value in (None, "") else bool(OPERATORS[sign](value, other))

    values = [*values, 1.5]  # the column has numbers
    rows = [[n, "a", 10.0, value, text] for n, (value, text) in enumerate(zip(values, [*words, "zz"], strict=False))]
    expected = [row[0] for row in rows if met(row[3], limit) and met(row[4], word)]
    path = write_rows(tmp_path / "rows.csv", ["snapshot", "sensor", "azimuth_deg", "q", "word"], rows)
    where = [f"q{blank}{sign}{blank}{limit}", f"word{blank}{sign}{blank}{word}"]
    if not expected:
        with pytest.raises(DataError, match="no rows left"):
            read([path], where=where, constants=CONSTANTS)
        return
    assert whole(read([path], where=where, constants=CONSTANTS)).ids == expected


@pytest.mark.parametrize("text", ["q", "q 5", "q = 5", "q => 5", "q >> 5", "> 5", "q >", "q == == 5", ""])
def test_bad_syntax_of_a_condition_is_a_usage_error(text: str) -> None:
    """Anything but COLUMN OP VALUE is a usage error."""
    with pytest.raises(UsageError, match="COLUMN OP VALUE"):
        parse_condition(text)


def test_a_condition_by_the_standard_name_of_a_renamed_column(tmp_path: Path) -> None:
    """COLUMN is the file's header or the standard name; columns that no method needs are read for it."""
    path = write_rows(tmp_path / "rows.csv", ["fix", "sensor", "AZ", "q"], [[1, "a", 10, 5], [2, "b", 20, 7]])
    options: dict[str, Any] = {"columns": {"azimuth_deg": "AZ", "snapshot": "fix"}, "constants": CONSTANTS}
    assert whole(read([path], where=["azimuth_deg > 15"], extra_columns=(), **options)).ids == [2]
    assert whole(read([path], where=["AZ<15"], extra_columns=(), **options)).ids == [1]
    assert whole(read([path], where=["q>=6"], extra_columns=(), **options)).ids == [2]


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ("quality > 5", "no column 'quality'"),
        ("q > high", "got 'high', expected a number"),
        ("q > 99", "no rows left: 2 by `where`"),
    ],
)
def test_conditions_that_do_not_suit_the_file(tmp_path: Path, where: str, message: str) -> None:
    """A missing column, text for a number and a file without a row left are faults of the data."""
    path = write_rows(
        tmp_path / "rows.csv", ["snapshot", "sensor", "azimuth_deg", "q"], [[1, "a", 1, 5], [2, "b", 2, 7]]
    )
    with pytest.raises(DataError, match=message):
        read([path], where=[where], constants=CONSTANTS)


def test_messages_have_rows_lines_and_columns_of_the_file(tmp_path: Path) -> None:
    """A fault in a wide table after rows that are left out has the row, the line and the header of the file."""
    rows = [[1, 10, -999, 1], [2, 20, 30, 0], [3, 40, "north", 1], [4, "1e400", 5, 1]]
    path = write_rows(tmp_path / "wide.csv", ["snapshot", "az_a", "az_b", "q"], rows)
    bad = Gathered()
    options: dict[str, Any] = {"wide": ["azimuth_deg=az_*"], "missing": ["-999"], "where": ["q == 1"]}
    found = whole(read([path], bad, constants=CONSTANTS, **options))
    assert found.ids == [1, 3, 4]
    assert [str(row.problem) for row in bad] == [
        f"{path}, row 3 (line 4), column 'az_b': got 'north', expected a number",
        f"{path}, row 4 (line 5), column 'az_a': got inf, expected a finite number",
    ]
    with pytest.raises(GatheredError, match=r"row 3 \(line 4\), column 'az_b'"):
        read([path], constants=CONSTANTS, **options)


def test_words_for_missing_values_in_a_column_of_nothing_else(tmp_path: Path) -> None:
    """A sensor that never reports is a column of ``NA``: its rows are left out."""
    path = write_rows(tmp_path / "wide.csv", ["snapshot", "az_a", "az_b"], [[n, n, "NA"] for n in range(8)])
    found = whole(read([path], wide=["azimuth_deg=az_*"], missing=["NA"], constants=CONSTANTS))
    assert found.table["sensor"].to_pylist() == ["a"] * 8
    with pytest.raises(DataError, match="az_b"):
        read([path], wide=["azimuth_deg=az_*"], constants=CONSTANTS)


@pytest.mark.parametrize(
    ("value", "kept"), [("nan", [1, 3, 4]), ("''", [1, 2, 4]), ("-999", [1, 2, 3]), ("NA", [1, 2, 3, 4])]
)
def test_missing_numbers_in_parquet(tmp_path: Path, value: str, kept: list[int]) -> None:
    """NaN, null and a number are missing values of their own."""
    table = pa.table(
        {
            "snapshot": [1, 2, 3, 4],
            "sensor": ["a"] * 4,
            "sensor_x_m": [0.0] * 4,
            "sensor_y_m": [-999.0] * 4,
            "range_m": [5.0, math.nan, None, -999.0],
            "range_std_m": [1.0] * 4,
        }
    )
    bad = Gathered()
    read([save(table, tmp_path / "r.parquet")], bad, missing=[value])
    assert [row.problem.row for row in bad] == [row for row in kept if row != 1]


@QUICK
@given(azimuths=st.lists(st.floats(-360.0, 720.0), min_size=1, max_size=6), declination=st.floats(-180.0, 180.0))
def test_declination_is_added(tmp_path: Path, azimuths: list[float], declination: float) -> None:
    """A declination, as a number or as a column, is added to the azimuths and to nothing else."""
    count = len(azimuths)
    table = pa.table(
        {
            "snapshot": list(range(count)),
            "sensor": ["a"] * count,
            "sensor_x_m": [0.0] * count,
            "sensor_y_m": [0.0] * count,
            "azimuth_deg": azimuths,
            "bearing_std_deg": [1.0] * count,
            "mag": [declination] * count,
        }
    )
    path = save(table, tmp_path / "m.parquet")
    expected = np.pi / 2 - np.radians(np.array(azimuths) + declination)
    for option in (declination, "mag"):
        found = whole(read([path], declination_deg=option))
        np.testing.assert_allclose(found.columns["bearing_rad"], expected, rtol=0, atol=1e-12)
        assert found.columns["bearing_std_rad"].tolist() == [math.radians(1.0)] * count


@pytest.mark.parametrize(
    ("header", "option", "error"),
    [
        ("bearing_deg", 3.0, DataError),
        ("azimuth_ccw_deg", 3.0, DataError),
        ("azimuth_deg", "nowhere", DataError),
        ("azimuth_deg", 180.5, UsageError),
        ("azimuth_deg", "nan", UsageError),
    ],
)
def test_declinations_that_can_not_be_added(tmp_path: Path, header: str, option: Any, error: type[Exception]) -> None:
    """Angles in another column, an unknown column and a number beyond 180 degrees are errors."""
    path = write_rows(tmp_path / "m.csv", ["snapshot", "sensor", header], [[1, "a", 10]])
    with pytest.raises(error, match="declination_deg"):
        read([path], declination_deg=option, constants=CONSTANTS)


@pytest.mark.parametrize(
    ("wide", "error", "message"),
    [
        ("azimuth_deg=az", UsageError, "one \\*"),
        ("azimuth_deg=a*_*", UsageError, "one \\*"),
        ("azimut=az_*", UsageError, "did you mean 'azimuth_deg'"),
        ("azimuth_deg=dir_*", DataError, "no column matches"),
        ("azimuth_deg_*", DataError, "no column matches"),
    ],
)
def test_wide_patterns_that_do_not_suit(tmp_path: Path, wide: str, error: type[Exception], message: str) -> None:
    """A pattern without one ``*`` or of an unknown column is a usage error, one without columns a fault of the data."""
    path = write_rows(tmp_path / "w.csv", ["snapshot", "az_a"], [[1, 10]])
    with pytest.raises(error, match=message):
        read([path], wide=[wide], constants=CONSTANTS)


def test_several_wide_columns_and_a_stem_of_the_contract(tmp_path: Path) -> None:
    """Two patterns give two columns; a column belongs to the longer one; a sensor may lack an optional value."""
    header = ["snapshot", "range_m_a", "range_m_b", "range_m_sd_a", "range_m_sd_b"]
    path = write_rows(tmp_path / "w.csv", header, [[1, 10, 20, 0.5, 0.25], [2, 11, None, 0.5, 0.25]])
    found = whole(read([path], wide=["range_m_*", "range_std_m=range_m_sd_*"]))
    assert found.table["sensor"].to_pylist() == ["a", "b", "a"]
    assert found.columns["range_m"].tolist() == [10.0, 20.0, 11.0]
    assert found.columns["range_std_m"].tolist() == [0.5, 0.25, 0.5]
