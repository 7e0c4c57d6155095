"""Bad input: one clear error, or bad rows set aside and the rest read."""

from __future__ import annotations

from contextlib import nullcontext
from itertools import pairwise
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reading_support import FIXTURES, Gathered, bearings, pa, read, save, scene_of

from nlosctl.errors import DataError
from nlosctl.io.measurements.duplicates import find_duplicates
from nlosctl.io.measurements.snapshot_ids import SnapshotIndex
from nlosctl.io.paths.inputs import expand_inputs

BAD = {
    "bad_missing_column.csv": ["'bearing_rad'", "bearing_deg"],
    "bad_misspelt_column.csv": ["did you mean 'bearings_rad'"],
    "bad_wrong_type.csv": ["row 5 (line 6)", "'bearing_rad'", "'north-east'", "a number"],
    "bad_wrong_type.parquet": ["'bearing_rad'", "wrong type", "string"],
    "bad_null_value.csv": ["row 5", "'bearing_rad'", "empty"],
    "bad_nan_value.csv": ["row 5", "'bearing_rad'", "NaN"],
    "bad_infinite_value.csv": ["row 5", "'sensor_x_m'", "inf"],
    "bad_zero_std.csv": ["row 5", "'bearing_std_rad'", "got 0", "larger than 0"],
    "bad_negative_std.csv": ["row 5", "'bearing_std_rad'", "-0.01"],
    "bad_degrees_as_radians.csv": ["'bearing_rad'", "12 of 12", "bearing_deg"],
    "bad_duplicate_bearing.csv": ["row 5", "row 4", "duplicate"],
    "bad_unknown_reflector.csv": ["row 5", "'reflector'", "did you mean 'wall'"],
    "bad_unknown_sensor.csv": ["row 5", "did you mean 'north'"],
    "bad_malformed_scene.csv": ["reflector[1].direction", "'north'", "[x, y]"],
    "bad_empty.csv": ["no rows", "0 bytes"],
    "bad_header_only.csv": ["no rows", "columns only"],
    "bad_truncated.parquet": ["Parquet"],
    "bad_ragged_line.csv": ["row 5 (line 6)", "12 fields", "expected 11"],
    "bad_encoding.csv": ["row 5", "'sensor'", "0xfc", "UTF-8"],
    "bad_sensor_outside_circle.csv": ["row 5", "'sensor_x_m'", "7070593.979 m from the centre", "6671000 m"],
    "bad_blocker_outside_circle.csv": ["reflector[0].blocker_radius", "got 6.5e+06", "(0, 6.481e+06)"],
    "bad_snapshot_comes_back.csv": ["row 13", "row 1)", "ORDER BY"],
    "bad_triplets_degrees_as_radians.csv": ["'dod_rad'", "17 of 18", "dod_deg"],
    "bad_triplets_negative_length.csv": ["(line 6)", "'path_length_m'", "got -3", "larger than 0"],
    "bad_triplets_zero_std.csv": ["row 8", "'doa_std_rad'", "got 0", "larger than 0"],
    "bad_triplets_duplicate_path.csv": ["(line 7)", "duplicate"],
    "bad_triplets_missing_doa.csv": ["'doa_rad'", "doa_deg"],
}
ROW_FAULTS = [name for name, words in BAD.items() if any(word.startswith("row 5") for word in words)]


def test_every_bad_fixture_is_tested() -> None:
    """Every bad fixture has a test."""
    there = {path.name for path in FIXTURES.glob("bad_*") if not path.name.endswith(".scene.toml")}
    assert there == set(BAD)


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_gives_one_clear_line(name: str) -> None:
    """The error is one line with the file, position, value and expectation."""
    with pytest.raises(DataError) as caught:
        read([FIXTURES / name], scene=scene_of(FIXTURES / name))
    text = str(caught.value)
    assert "\n" not in text
    assert name.split(".")[0] in text
    assert [word for word in BAD[name] if word not in text] == []


@pytest.mark.parametrize("name", ROW_FAULTS)
def test_bad_rows_are_set_aside(name: str) -> None:
    """With a sink the bad row is written to it and the others are read."""
    aside = Gathered()
    chunks = read([FIXTURES / name], aside, scene=scene_of(FIXTURES / name), chunk_rows=3)
    expected = 12 if "duplicate" in name else 11
    assert sum(chunk.table.num_rows for chunk in chunks) == expected
    assert [row.problem.row for row in aside] == [5]
    assert aside[0].raw_line or aside[0].values["bearing_std_rad"] is not None


def test_what_could_not_be_converted_is_set_aside_as_it_came() -> None:
    """The bad row's cells keep the text of the file."""
    aside = Gathered()
    read([FIXTURES / "bad_wrong_type.csv"], aside)
    assert aside[0].values["bearing_rad"] == "north-east"


def test_problems_are_gathered_and_counted(tmp_path: Path) -> None:
    """The first 20 are reported, then the total; no chunk follows a bad row."""
    path = save(bearings([1] * 50, bearing_std_rad=[0.0] * 30 + [0.1] * 20), tmp_path / "a.parquet")
    with pytest.raises(DataError) as caught:
        read([path], chunk_rows=7)
    lines = str(caught.value).splitlines()
    assert len(lines) == 21
    assert "row 20," in lines[19]
    assert lines[20].startswith("... and 10 more; 30 bad rows in all")


def test_rows_after_ragged_lines_keep_their_numbers(tmp_path: Path) -> None:
    """A skipped line counts as a row, for any batches."""
    good = "1,a{},0,0,1,0.1\n"
    lines = [good.format(place) for place in range(9)]
    lines[2] = lines[6] = "1,2\n"
    lines[7] = "1,x,0,0,one,0.1\n"
    path = tmp_path / "a.csv"
    path.write_text("snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad\n" + "".join(lines))
    for chunk_rows in (1, 3, 100):
        aside = Gathered()
        chunks = read([path], aside, chunk_rows=chunk_rows)
        assert sorted(row.problem.row for row in aside) == [3, 7, 8]
        assert sum(chunk.table.num_rows for chunk in chunks) == 6


@pytest.mark.parametrize("extension", ["csv.gz", "arrow", "arrows", "parquet"])
def test_a_file_cut_short_is_told(tmp_path: Path, extension: str) -> None:
    """A truncated file is an error of one line, never a partial result."""
    content = (FIXTURES / f"good_bearings.{extension}").read_bytes()
    path = tmp_path / f"cut.{extension}"
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(DataError, match=r"cut short") as caught:
        read([path], scene=scene_of(FIXTURES / "good_bearings.csv"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("extension", ["parquet", "csv"])
def test_a_column_that_is_there_twice_is_told(tmp_path: Path, extension: str) -> None:
    """Two columns of one name are refused in every format."""
    path = save(bearings([1]).append_column("sensor", pa.array(["a"])), tmp_path / "a.parquet")
    if extension == "csv":
        path = tmp_path / "a.csv"
        path.write_text("snapshot,sensor,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad\n1,a,b,0,0,1,1\n")
    with pytest.raises(DataError, match="duplicate column 'sensor'"):
        read([path])


def test_malformed_json_lines_are_row_problems(tmp_path: Path) -> None:
    """A line that is not JSON, text for a number and an array are reported with their line."""
    lines = (FIXTURES / "good_bearings.jsonl").read_text().splitlines()[:6]
    lines[1] = lines[1][:-5]
    lines[3] = lines[3].replace('"bearing_std_rad": 0', '"bearing_std_rad": "x", "was": 0')
    lines[4] = "[1, 2]"
    path = tmp_path / "a.jsonl"
    path.write_text("\n".join(lines) + "\n")
    aside = Gathered()
    read([path], aside, scene=scene_of(FIXTURES / "good_bearings.csv"))
    assert [(row.problem.row, row.problem.column) for row in aside] == [(2, None), (4, "bearing_std_rad"), (5, None)]


@pytest.mark.parametrize(
    ("word", "message"),
    [("good_bearing.csv", "did you mean"), ("builders", "no table file"), ("*.nope", "no file matches")],
)
def test_inputs_that_are_not_there(word: str, message: str) -> None:
    """A missing file, an empty folder and an unmatched pattern are errors with a cure."""
    with pytest.raises(DataError, match=message):
        expand_inputs([str(FIXTURES / word)])


@pytest.mark.parametrize("ids", [[1, 2, 3, 1], [3, 2, 1, 3], [5, 1, 9, 1], ["a", "b", "a"], ["b", "a", "c", "a"]])
@pytest.mark.parametrize("chunk_rows", [1, 2, 100])
def test_a_snapshot_that_comes_back_is_found(tmp_path: Path, ids: list[object], chunk_rows: int) -> None:
    """Repeated ids are detected among rising, falling and unsorted numbers or texts, across batches too."""
    path = save(bearings(ids), tmp_path / "a.parquet")
    with pytest.raises(DataError, match=f"row {len(ids)}, column 'snapshot'.*comes back"):
        read([path], chunk_rows=chunk_rows)


def test_unsorted_ids_are_fine(tmp_path: Path) -> None:
    """Ids need no order if the rows of each snapshot are adjacent."""
    path = save(bearings([5, 5, 1, 9, 9, 2]), tmp_path / "a.parquet")
    assert [value for chunk in read([path], chunk_rows=2) for value in chunk.snapshot.to_pylist()] == [5, 1, 9, 2]


def test_unsorted_ids_are_remembered_for_a_while() -> None:
    """At least the given number of last snapshots is remembered, and memory is bounded."""
    index = SnapshotIndex(remembered=4)
    for identity in [9, 1, 8, 2, 7, 3, 6, 4]:
        assert index.add("f", pa.array([identity]), np.array([1])) is None
    assert index.add("f", pa.array([3]), np.array([2])) == (0, "f", 1)


def returned(index: SnapshotIndex, batches: list[list[object]]) -> tuple[int, int] | None:
    """Return the rows (the first is 1) of an id that returns and of its earlier occurrence, or None."""
    row = 1
    for ids in batches:
        seen = index.add("f", pa.array(ids), np.arange(row, row + len(ids)))
        if seen is not None:
            return row + seen.at, seen.row
        row += len(ids)
    return None


IDS = st.one_of(
    st.lists(st.integers(0, 40), max_size=20),
    st.lists(st.sampled_from([0, 1, 2**63 - 1, -(2**63), 5, -1]), max_size=8),
    st.lists(st.integers(0, 40).map("s{}".format), max_size=20),
)


@settings(max_examples=300, deadline=None)
@given(ids=IDS, cuts=st.lists(st.integers(0, 20), max_size=5), one_hash=st.booleans())
def test_what_comes_back_is_what_a_plain_search_finds(ids: list[object], cuts: list[int], one_hash: bool) -> None:
    """For any batches, and with equal hashes of all texts, the first repeated id and its row are reported."""
    ends = sorted({0, len(ids), *(cut for cut in cuts if cut < len(ids))})
    batches = [ids[first:behind] for first, behind in pairwise(ends)]
    expected = next(((place + 1, ids.index(each) + 1) for place, each in enumerate(ids) if each in ids[:place]), None)
    with patch("nlosctl.io.measurements.snapshot_ids.hash", lambda text: 0, create=True) if one_hash else nullcontext():
        assert returned(SnapshotIndex(), batches) == expected


@pytest.mark.parametrize("name", ["{}", "s{:04d}"])
def test_an_id_of_long_ago_is_found_with_its_row(name: str) -> None:
    """In rising ids that become unordered late, the last ones are remembered; earlier ones may be forgotten."""
    ids = [name.format(place) if name != "{}" else place for place in range(1000)]
    for place, expected in ((995, (1001, 996)), (901, (1001, 902)), (400, None)):
        index = SnapshotIndex(remembered=100)
        cuts = [*range(0, 1000, 50), 1000]
        batches = [ids[first:behind] for first, behind in pairwise(cuts)]
        assert returned(index, [*batches, [ids[place]]]) == expected


@settings(max_examples=60, deadline=None)
@given(
    rows=st.lists(st.tuples(st.integers(0, 2), st.integers(0, 2), st.sampled_from([0.0, -0.0, 1.5])), max_size=30),
    cuts=st.lists(st.integers(0, 30), max_size=3),
)
def test_duplicates_are_those_of_a_plain_search(rows: list[tuple[int, int, float]], cuts: list[int]) -> None:
    """The vectorized search agrees with a set of seen keys, and reports the first of each."""
    offsets = np.array(sorted({0, len(rows), *(cut for cut in cuts if cut < len(rows))}), dtype=np.int64)
    if len(rows) == 0:
        return
    columns = [np.array([row[place] for row in rows]) for place in range(3)]
    seen: dict[tuple[object, ...], int] = {}
    expected = []
    for place, row in enumerate(rows):
        key = (int(np.searchsorted(offsets, place, side="right")), *row)
        if key in seen:
            expected.append((place, seen[key]))
        else:
            seen[key] = place
    repeated, first = find_duplicates(offsets, columns)
    assert list(zip(repeated.tolist(), first.tolist(), strict=True)) == expected
