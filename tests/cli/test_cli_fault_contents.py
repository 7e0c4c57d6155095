"""The content of the message of each bad fixture, independent of its wording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import pytest
from cli_support import FIXTURES, Outcome

Cli = Callable[..., Outcome]


@dataclass(frozen=True, kw_only=True)
class Content:
    """Parts that a message must have, where they apply: positions, and texts for value, expectation and cure."""

    row: int | None = None
    column: str | None = None
    key: str | None = None
    got: tuple[str, ...] = ()
    expected: tuple[str, ...] = ()
    cure: tuple[str, ...] = ()


ASIDE = "--bad-rows"
CONTENTS = {
    "bad_blocker_outside_circle.csv": Content(
        key="reflector[0].blocker_radius", got=("6.5e+06",), expected=("(0, 6.481e+06)",)
    ),
    "bad_degrees_as_radians.csv": Content(
        column="bearing_rad", got=("12 of 12",), expected=("6.283",), cure=("bearing_deg", "azimuth_deg")
    ),
    "bad_duplicate_bearing.csv": Content(row=5, got=("duplicate", "sensor"), expected=("row 4",), cure=("path", ASIDE)),
    "bad_empty.csv": Content(got=("0 bytes",), expected=("rows",)),
    "bad_encoding.csv": Content(
        row=5, column="sensor", got=(r"b's\xfcd'", "0xfc"), expected=("UTF-8",), cure=("UTF-8", ASIDE)
    ),
    "bad_header_only.csv": Content(got=("columns",), expected=("rows",)),
    "bad_infinite_value.csv": Content(row=5, column="sensor_x_m", got=("inf",), expected=("finite",), cure=(ASIDE,)),
    "bad_malformed_scene.csv": Content(key="reflector[1].direction", got=("'north'",), expected=("two", "[x, y]")),
    "bad_missing_column.csv": Content(
        column="bearing_rad",
        got=("bearing_std_rad", "truth_los"),
        expected=("azimuth_deg",),
        cure=("--column", "--kind"),
    ),
    "bad_misspelt_column.csv": Content(
        column="bearing_rad", got=("bearings_rad",), cure=("'bearings_rad'?", "--column")
    ),
    "bad_nan_value.csv": Content(row=5, column="bearing_rad", got=("NaN",), expected=("finite",), cure=(ASIDE,)),
    "bad_negative_std.csv": Content(
        row=5, column="bearing_std_rad", got=("-0.01",), expected=("larger than 0", "1e-15 rad"), cure=(ASIDE,)
    ),
    "bad_null_value.csv": Content(row=5, column="bearing_rad", got=("null",), expected=("finite",), cure=(ASIDE,)),
    "bad_ragged_line.csv": Content(row=5, got=("12",), expected=("11", "header"), cure=(ASIDE,)),
    "bad_sensor_outside_circle.csv": Content(
        row=5, column="sensor_x_m", got=("7070593.979 m",), expected=("6671000 m",), cure=(ASIDE,)
    ),
    "bad_snapshot_comes_back.csv": Content(
        row=13, column="snapshot", got=("0 ", "row 1)"), expected=("together",), cure=("ORDER BY", "duckdb")
    ),
    "bad_triplets_degrees_as_radians.csv": Content(
        column="dod_rad", got=("17 of 18",), expected=("6.283",), cure=("dod_deg",)
    ),
    "bad_triplets_duplicate_path.csv": Content(
        row=6, got=("duplicate", "path"), expected=("row 5",), cure=("'path'", ASIDE)
    ),
    "bad_triplets_missing_doa.csv": Content(
        column="doa_rad", got=("dod_rad", "truth_ip"), expected=("doa_deg",), cure=("--column", "--kind")
    ),
    "bad_triplets_negative_length.csv": Content(
        row=5, column="path_length_m", got=("-3",), expected=("larger than 0", "1e-15 m"), cure=(ASIDE,)
    ),
    "bad_triplets_zero_std.csv": Content(
        row=8, column="doa_std_rad", got=(" 0",), expected=("larger than 0",), cure=(ASIDE,)
    ),
    "bad_truncated.parquet": Content(got=("magic bytes",), expected=("Parquet",), cure=("cut short",)),
    "bad_unknown_reflector.csv": Content(
        row=5, column="reflector", got=("'wal'",), expected=("wall, fence",), cure=("'wall'?", ASIDE)
    ),
    "bad_unknown_sensor.csv": Content(
        row=5, column="sensor_x_m", got=("'nort'",), expected=("position",), cure=("'north'?", ASIDE)
    ),
    "bad_wrong_type.csv": Content(
        row=5, column="bearing_rad", got=("'north-east'",), expected=("number",), cure=(ASIDE,)
    ),
    "bad_wrong_type.parquet": Content(
        column="bearing_rad", got=("string",), expected=("numbers",), cure=("convert", "--column")
    ),
    "bad_zero_std.csv": Content(
        row=5, column="bearing_std_rad", got=(" 0",), expected=("larger than 0",), cure=(ASIDE,)
    ),
}


def test_every_bad_fixture_has_its_content() -> None:
    """The table above lists every bad fixture."""
    assert set(CONTENTS) == {path.name for path in FIXTURES.glob("bad_*") if not path.name.endswith(".scene.toml")}


@pytest.mark.parametrize("name", CONTENTS)
def test_messages_keep_their_content(cli: Cli, name: str) -> None:
    """A message names file, row, line and column, and states value, expectation and cure, in one line."""
    content, message = CONTENTS[name], cli("validate", FIXTURES / name).err
    stem = str(FIXTURES / name).partition(".")[0]
    parts = [stem, *content.got, *content.expected, *content.cure]
    if content.row is not None:
        parts.append(f"row {content.row}")
    if content.row is not None and name != "bad_snapshot_comes_back.csv":
        parts.append(f"line {content.row + 1}")  # the header is line 1
    if content.column is not None:
        parts.append(f"'{content.column}'")
    if content.key is not None:
        parts.append(content.key)
    assert [part for part in parts if part not in message] == []
    assert message.count("\n") == 1
