"""Snapshots from times, compared with a slow implementation in exact arithmetic."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from program import run_here
from reading_support import read

import nlosctl
from nlosctl.contract.windows import parse_window
from nlosctl.errors import DataError, NlosctlError, UsageError
from nlosctl.io.measurements.reader import Chunk

Row = dict[str, Any]

UNITS = {"us": 1, "ms": 1000, "s": 10**6, "min": 60 * 10**6, "h": 3600 * 10**6, "d": 86400 * 10**6}
PLACES = {"A": (0.0, 0.0), "B": (90.0, 5.0), "C": (40.0, 80.0)}

rows_of_logs = st.lists(
    st.builds(
        lambda ticks, sensor, tag, length: {"ticks": ticks, "sensor": sensor, "tag": tag, "range_m": length},
        st.integers(-3_000_000, 9_000_000) | st.integers(0, 40).map(lambda tenth: tenth * 100_000),
        st.sampled_from(sorted(PLACES)),
        st.sampled_from(["t1", "t2", "7"]),
        st.integers(1, 90).map(float),
    ),
    min_size=1,
    max_size=25,
)
origins = st.sampled_from([0, 1_717_999_999, -5])


def seconds(ticks: int) -> str:
    """Return microseconds as exact decimal text."""
    sign, ticks = "-" if ticks < 0 else "", abs(ticks)
    return f"{sign}{ticks // 10**6}.{ticks % 10**6:06d}"


def iso(ticks: int) -> str:
    """Return microseconds since 1970 as ISO 8601 with an offset of two hours."""
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=ticks) + timedelta(hours=2)
    return moment.strftime("%Y-%m-%d %H:%M:%S.%f") + "+02:00"


def save(rows: Sequence[Row], path: Path, column: str = "time_s", extra: Sequence[str] = ()) -> Path:
    """Write rows as a CSV of ranges."""
    lines = [f"{column},tag,sensor,sensor_x_m,sensor_y_m,range_m,range_std_m,number" + "".join(f",{n}" for n in extra)]
    for number, row in enumerate(rows):
        x, y = PLACES[row["sensor"]]
        time = seconds(row["ticks"]) if column == "time_s" else iso(row["ticks"])
        cells = [time, row["tag"], row["sensor"], x, y, row["range_m"], row.get("std", 0.5), row.get("number", number)]
        lines.append(",".join(map(str, [*cells, *(row[name] for name in extra)])))
    path.write_text("\n".join(lines) + "\n")
    return path


def slow_windows(rows: Sequence[Row], width: Fraction, by: Sequence[str]) -> list[tuple[tuple[str, ...], Fraction]]:
    """Return the part and the start of the window of each row, in microseconds, by exact arithmetic."""
    parts = [tuple(row[name] for name in by) for row in rows]
    start = {
        part: min(Fraction(row["ticks"]) for row, other in zip(rows, parts, strict=True) if other == part)
        for part in parts
    }
    return [
        (part, start[part] + math.floor((Fraction(row["ticks"]) - start[part]) / width) * width)
        for row, part in zip(rows, parts, strict=True)
    ]


def slow_id(part: Sequence[str], start: Fraction, by: Sequence[str], column: str) -> str:
    """Return the name of a window as the contract states it."""
    prefix = "".join(f"{name}-{value}/" for name, value in zip(by, part, strict=True))
    if column == "time_s":
        text = seconds(int(start)).rstrip("0").rstrip(".")
        return prefix + text
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=int(start))
    text = moment.strftime("%Y-%m-%dT%H:%M:%S.%f").rstrip("0").rstrip(".")
    return f"{prefix}{text}Z"


def table_rows(chunks: Sequence[Chunk]) -> dict[int, str]:
    """Return the snapshot of each row by its number in the file."""
    found: dict[int, str] = {}
    for chunk in chunks:
        numbers = chunk.table.column("number").to_pylist()
        found |= dict(zip(numbers, chunk.table.column("snapshot").to_pylist(), strict=True))
    return found


@settings(max_examples=60, deadline=None)
@given(
    rows=rows_of_logs,
    origin=origins,
    width=st.sampled_from(["100ms", ".4s", "1s", "7us", "1.5min", "250000us", "2e-1s", "1d"]),
    by=st.sampled_from([(), ("tag",), ("tag", "sensor")]),
    column=st.sampled_from(["time_s", "time"]),
)
def test_windows_are_those_of_exact_arithmetic(
    tmp_path_factory: pytest.TempPathFactory, rows: list[Row], origin: int, width: str, by: tuple[str, ...], column: str
) -> None:
    """Every row is in the window of exact arithmetic, which has the name of the contract, in either kind of time."""
    rows = [{**row, "ticks": row["ticks"] + origin * 10**6} for row in rows]
    path = save(rows, tmp_path_factory.mktemp("windows") / "in.csv", column)
    unit = width.lstrip("0123456789.e-")
    exact = Fraction(width.removesuffix(unit)) * UNITS[unit]
    expected = [slow_id(part, start, by, column) for part, start in slow_windows(rows, exact, by)]
    chunks = read([path], window=width, by=by)
    assert table_rows(chunks) == dict(enumerate(expected))
    for chunk in chunks:
        assert chunk.windows is not None
        ids = chunk.snapshot.to_pylist()
        assert len(set(ids)) == len(ids)
        numbers = chunk.table.column("number").to_pylist()
        for index, mean in enumerate(chunk.windows.time_s):
            mine = [rows[number]["ticks"] for number in numbers[chunk.offsets[index] : chunk.offsets[index + 1]]]
            assert abs(Fraction(float(mean)) - Fraction(sum(mine), len(mine) * 10**6)) < Fraction(1, 10**6)


@settings(max_examples=25, deadline=None)
@given(
    rows=rows_of_logs,
    order=st.randoms(use_true_random=False),
    window=st.sampled_from(["300ms", "auto", "all"]),
    keep=st.sampled_from(["all", "mean"]),
    cut=st.integers(1, 4),
)
def test_order_and_cut_of_the_rows_do_not_matter(
    tmp_path_factory: pytest.TempPathFactory, rows: list[Row], order: Any, window: str, keep: str, cut: int
) -> None:
    """The estimates have the same bits for any order of the lines, and any cut into parts of a folder."""
    folder = tmp_path_factory.mktemp("order")
    rows = [{**row, "number": number} for number, row in enumerate(rows)]
    options: dict[str, Any] = {
        "window": window,
        "by": "tag",
        "window_keep": keep,
        "method": "mixture-ml",
        "carry": "tag",
    }
    one = nlosctl.localize(save(rows, folder / "one.csv"), **options)
    shuffled = order.sample(rows, len(rows))
    (folder / "parts").mkdir()
    size = -(-len(rows) // cut)
    for number in range(0, len(rows), size):
        save(shuffled[number : number + size], folder / "parts" / f"{number:03d}.csv")
    other = nlosctl.localize(folder / "parts", **options)
    assert one.estimates.equals(other.estimates)
    assert other.flags.column("number").to_pylist() == [row["number"] for row in shuffled]
    by_number = {
        name: dict(zip(flags["number"].to_pylist(), flags["snapshot"].to_pylist(), strict=True))
        for name, flags in (("one", one.flags), ("other", other.flags))
    }
    assert by_number["one"] == by_number["other"]


def slow_kept(rows: Sequence[Row], windows: Sequence[tuple[Any, Fraction]], width: Fraction) -> set[int]:
    """Return the numbers of the rows nearest to the centre of their window, of each sensor."""
    best: dict[Any, tuple[Fraction, int, int]] = {}
    for number, (row, window) in enumerate(zip(rows, windows, strict=True)):
        key = (*window, row["sensor"])
        rank = (abs(row["ticks"] - (window[1] + width / 2)), row["ticks"], number)
        best[key] = min(best.get(key, rank), rank)
    return {number for _, _, number in best.values()}


@settings(max_examples=60, deadline=None)
@given(rows=rows_of_logs, width=st.sampled_from(["300ms", "1s", "3s", "7us"]))
def test_the_nearest_row_of_a_sensor(tmp_path_factory: pytest.TempPathFactory, rows: list[Row], width: str) -> None:
    """Of each sensor the row nearest to the centre is kept, of two as near the earlier, of two at once the first."""
    unit = width.lstrip("0123456789.")
    exact = Fraction(width.removesuffix(unit)) * UNITS[unit]
    path = save(rows, tmp_path_factory.mktemp("nearest") / "in.csv")
    expected = slow_kept(rows, slow_windows(rows, exact, ("tag",)), exact)
    kept = set()
    for chunk in read([path], window=width, by=("tag",), window_keep="nearest"):
        assert chunk.windows is not None
        numbers = np.array(chunk.table.column("number").to_pylist())
        kept |= set(numbers[~chunk.left_out].tolist())
        assert (chunk.left_out == (chunk.windows.leader < 0)).all()
    assert kept == expected


def test_the_mean_of_ranges_and_bearings(tmp_path: Path) -> None:
    """Merged rows have the weights 1/std^2: mean of lengths, times and places, direction of the summed unit vectors."""
    lines = "time_s,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg,range_m,range_std_m\n"
    lines += "0.0,A,0,0,350,1,10,1\n0.3,B,5,5,90,2,,\n0.5,A,2,0,20,2,14,0.5\n0.9,A,8,0,21,2,,\n"
    (tmp_path / "in.csv").write_text(lines)
    (chunk,) = read([tmp_path / "in.csv"], window="1s", window_keep="mean")
    angles, stds = np.radians([350.0, 20.0, 21.0]), np.radians([1.0, 2.0, 2.0])
    weight = 1.0 / stds**2
    expected = math.atan2(float(weight @ np.sin(angles)), float(weight @ np.cos(angles)))
    first = int(np.flatnonzero(~chunk.left_out)[0])
    assert chunk.columns["bearing_rad"][first] == pytest.approx(expected, abs=1e-14)
    assert chunk.columns["bearing_std_rad"][first] == pytest.approx(float(weight.sum() ** -0.5), rel=1e-14)
    assert chunk.columns["range_m"][first] == pytest.approx((10.0 + 4.0 * 14.0) / 5.0, rel=1e-14)
    assert chunk.columns["range_std_m"][first] == pytest.approx(5.0**-0.5, rel=1e-14)
    assert chunk.columns["sensor_x_m"][first] == pytest.approx(
        float(weight @ [0.0, 2.0, 8.0] / weight.sum()), rel=1e-14
    )
    time = float(weight @ [0.0, 0.5, 0.9] / weight.sum())
    assert chunk.windows is not None
    assert chunk.windows.time_s[0] == pytest.approx((time + 0.3) / 2.0, abs=1e-9)
    assert chunk.windows.measurements(chunk.offsets).tolist() == [2]


def test_flags_of_merged_rows(tmp_path: Path) -> None:
    """With ``mean`` each row's flag has ``used`` and the residual of its merged measurement."""
    rows = [
        {"ticks": 1000 * k, "sensor": sensor, "tag": "t", "range_m": length}
        for k, (sensor, length) in enumerate([("A", 50.0), ("B", 55.0), ("C", 48.0), ("A", 52.0), ("B", 56.0)])
    ]
    done = nlosctl.localize(save(rows, tmp_path / "in.csv"), window="1s", window_keep="mean")
    alone = [
        rows[0] | {"range_m": 51.0, "std": 0.5 / math.sqrt(2.0)},
        rows[1] | {"range_m": 55.5, "std": 0.5 / math.sqrt(2.0)},
    ]
    merged = nlosctl.localize(save([*alone, rows[2]], tmp_path / "merged.csv"), window="1s")
    residual = merged.flags["residual_m"].to_pylist()
    assert done.flags["residual_m"].to_pylist() == pytest.approx([*residual, *residual[:2]], abs=1e-6)
    assert done.flags["used"].to_pylist() == [True] * 5
    assert done.flags["range_m"].to_pylist() == [50.0, 55.0, 48.0, 52.0, 56.0]
    assert done.estimates["n_used"].to_pylist() == done.estimates["n_measurements"].to_pylist() == [3]


def test_opposite_bearings_have_no_mean(tmp_path: Path) -> None:
    """Two opposite bearings of a sensor in a window are bad rows with ``mean``."""
    head = "time_s,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg\n"
    (tmp_path / "in.csv").write_text(f"{head}0.0,A,0,0,10,1\n0.1,B,9,0,80,1\n0.2,A,0,0,190,1\n")
    with pytest.raises(DataError, match=r"row 1 \(line 2\): the directions of this sensor in the window cancel"):
        read([tmp_path / "in.csv"], window="1s", window_keep="mean")


@pytest.mark.parametrize("by", [(), ("tag",)])
@pytest.mark.parametrize("keep", ["all", "nearest"])
def test_a_sorted_file_beyond_the_limit_streams(
    tmp_path: Path, small_chunks: None, by: tuple[str, ...], keep: str
) -> None:
    """Sorted rows beyond ``max_sort_rows`` give the tables of rows sorted in memory; unsorted ones are an error."""
    generator = np.random.default_rng(3)
    rows = []
    for number, ticks in enumerate(np.sort(generator.integers(0, 60_000_000, 400)).tolist()):
        sensor = "ABC"[number % 3]
        true_m = math.dist(PLACES[sensor], (50.0, 30.0))
        rows.append({"ticks": ticks, "sensor": sensor, "tag": f"t{generator.integers(3)}", "range_m": true_m})
    path = save(rows, tmp_path / "in.csv")
    options: dict[str, Any] = {"window": "2s", "by": by, "window_keep": keep}
    one = nlosctl.localize(path, **options)
    other = nlosctl.localize(path, **options, max_sort_rows=50)
    assert one.estimates.equals(other.estimates)
    assert one.flags.equals(other.flags)
    rows[300], rows[350] = rows[350], rows[300]
    with pytest.raises(
        DataError, match=r"row 302, column 'time_s': the time is before that of the row above, and more than 50"
    ):
        nlosctl.localize(save(rows, tmp_path / "unsorted.csv"), **options, max_sort_rows=50)


def test_rows_of_a_sensor_at_other_times_are_no_duplicates(tmp_path: Path) -> None:
    """Bearings of a sensor differ by their times; at one time, or with equal path numbers, they are duplicates."""
    head = "time_s,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg,path\n"
    (tmp_path / "in.csv").write_text(f"{head}0.0,A,0,0,10,1,\n0.1,A,0,0,11,1,\n0.2,A,0,0,12,1,0\n0.3,A,0,0,12,1,1\n")
    (chunk,) = read([tmp_path / "in.csv"], window="1s")
    assert chunk.offsets.tolist() == [0, 4]
    (tmp_path / "same.csv").write_text(f"{head}0.1,A,0,0,10,1,\n0.1,A,0,0,11,1,\n")
    with pytest.raises(DataError, match=r"row 2 \(line 3\): duplicate measurement: same window, time, .* as row 1"):
        read([tmp_path / "same.csv"], window="1s")
    (tmp_path / "path.csv").write_text(f"{head}0.1,A,0,0,10,1,0\n0.2,A,0,0,11,1,0\n")
    with pytest.raises(DataError, match="duplicate measurement"):
        read([tmp_path / "path.csv"], window="1s")


@pytest.mark.parametrize("text", ["0s", "2", "1.5ns", "1.5us", "-2s", "s", "", "2 weeks", "nan s", "2S"])
def test_widths_that_are_refused(text: str) -> None:
    """A width is a number with its unit, a whole number of microseconds above 0."""
    with pytest.raises(UsageError, match=r"`window` must be a width larger than 0 with its unit"):
        parse_window(text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [("2s", 2_000_000), ("500 ms", 500_000), (".5us", None), ("1.5min", 90_000_000), ("1d", 86_400_000_000)],
)
def test_widths_in_microseconds(text: str, expected: int | None) -> None:
    """Widths are whole microseconds, whatever their unit."""
    if expected is None:
        with pytest.raises(UsageError):
            parse_window(text)
    else:
        assert parse_window(text) == expected


HEAD = "time,sensor,sensor_x_m,sensor_y_m,range_m,range_std_m\n"


ISO = "2024-06-10T06:13:19"
IN_S = HEAD.replace("time", "time_s")
BERLIN = {"timezone": "Europe/Berlin"}
REFUSED = [
    (
        HEAD,
        [f"{ISO}Z", "2024-06-10T06:13:20"],
        {},
        r"row 2, column 'time': got .* without an offset, but row 1 .* has one",
    ),
    (HEAD, [ISO, f"{ISO}Z"], {}, f"row 1, column 'time': got '{ISO}', expected an offset or Z; .*`timezone`"),
    (HEAD, ["2024-03-31T02:30:00"], BERLIN, r"row 1 \(line 2\), .*: this local time does not exist in Europe/Berlin"),
    (HEAD, ["2024-10-27T02:30:00"], BERLIN, "this local time is twice in Europe/Berlin"),
    (HEAD, ["2024-06-10T06:13:60Z"], {}, "expected a date and time that exist: second must be"),
    (HEAD, ["", f"{ISO}Z"], {}, r"row 1 \(line 2\), column 'time': got an empty cell"),
    (HEAD, ["yesterday"], {}, "got 'yesterday', expected ISO 8601, such as"),
    (IN_S, ["nan"], {}, r"row 1 \(line 2\), column 'time_s': got"),
    (IN_S, ["1e15"], {}, r"row 1 \(line 2\), column 'time_s': got 1e\+15, expected seconds within"),
    (HEAD.replace("time", "stamp"), ["1"], {}, r"no column 'time_s' or 'time' \(is 'stamp' one\?\)"),
    (HEAD, [f"{ISO}Z"], {"by": "tga"}, "`by` tga: no column 'tga'. The file has: time, sensor"),
]


@pytest.mark.parametrize(("head", "cells", "options", "message"), REFUSED)
def test_times_that_are_refused(tmp_path: Path, head: str, cells: list[str], options: Any, message: str) -> None:
    """A time that can't be read, or is not unique, is a bad row; times of unknown zone are an error of the file."""
    (tmp_path / "in.csv").write_text(head + "".join(f"{cell},A,0,0,5,1\n" for cell in cells))
    with pytest.raises(DataError, match=message):
        nlosctl.validate(tmp_path / "in.csv", window="1s", **options)


def test_a_file_with_snapshots_or_two_times_is_refused(tmp_path: Path) -> None:
    """``window`` with a column ``snapshot``, and both columns of times, are errors; ``by`` alone a usage error."""
    (tmp_path / "in.csv").write_text(
        "snapshot,time_s,sensor,sensor_x_m,sensor_y_m,range_m,range_std_m\n0,1,A,0,0,5,1\n"
    )
    with pytest.raises(DataError, match="has a column 'snapshot', so that `window` cannot make snapshots"):
        nlosctl.localize(tmp_path / "in.csv", window="1s")
    (tmp_path / "two.csv").write_text(f"time_s,{HEAD}1,2024-06-10T06:13:19Z,A,0,0,5,1\n")
    with pytest.raises(DataError, match="columns 'time_s' and 'time' are both times"):
        nlosctl.localize(tmp_path / "two.csv", window="1s")
    with pytest.raises(UsageError, match="`by` sensor separates windows of time; set `window` too"):
        nlosctl.localize(tmp_path / "in.csv", by="sensor")
    (tmp_path / "zone.csv").write_text(f"{HEAD}2024-06-10T06:13:19,A,0,0,5,1\n")
    with pytest.raises(UsageError, match="`timezone` must be a name of the IANA database"):
        nlosctl.localize(tmp_path / "zone.csv", window="1s", timezone="Berlin")


def test_times_of_other_types(tmp_path: Path) -> None:
    """Timestamps of Arrow, text with nanoseconds, and local times give the same windows."""
    shared = {"sensor": ["A", "B", "C"], "sensor_x_m": [0.0, 9.0, 4.0], "sensor_y_m": [0.0, 0.0, 8.0]}
    shared |= {"range_m": [5.0, 5.0, 5.0], "range_std_m": [1.0] * 3}
    texts = ["2024-06-10T06:13:19.985Z", "2024-06-10T06:13:20Z", "2024-06-10T06:13:20.5000005Z"]
    stamps = pa.array([t.removesuffix("Z") for t in texts]).cast(pa.timestamp("ns")).cast(pa.timestamp("ns", "UTC"))
    local = ["2024-06-10 08:13:19.985", "2024-06-10 08:13:20", "2024-06-10T08:13:20,5000005"]
    results = [
        nlosctl.localize({"time": time, **shared}, window="10s", **options).estimates
        for time, options in ((texts, {}), (stamps, {}), (local, {"timezone": "Europe/Berlin"}))
    ]
    assert results[0]["snapshot"].to_pylist() == ["2024-06-10T06:13:19.985Z"]
    assert results[0]["time_s"][0].as_py() == pytest.approx(1718000000.1616668, abs=1e-6)
    assert all(result.equals(results[0]) for result in results)
    with pytest.raises(NlosctlError, match="expected an offset or Z"):
        nlosctl.localize({"time": stamps.cast(pa.timestamp("ns")), **shared}, window="10s")


def test_bearings_at_other_times_are_no_rivals(tmp_path: Path) -> None:
    """``mixture-ml`` takes bearings of a sensor at other times as those of two sensors; numbered paths are rivals."""
    true = (40.0, 30.0)
    places = {"A": (0.0, 0.0), "B": (90.0, 5.0), "C": (40.0, 80.0), "D": (0.0, 70.0)}
    rows = [
        (0.1 * number, name, *places[name], math.atan2(true[1] - places[name][1], true[0] - places[name][0]) + error)
        for number, (name, error) in enumerate([("A", 0.01), ("B", -0.01), ("C", 0.02), ("D", 0.0), ("A", -0.02)])
    ]

    def fix(names: Sequence[str], paths: Sequence[str]) -> Any:
        lines = ["time_s,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad,path"]
        for (time, _, x, y, bearing), name, path in zip(rows, names, paths, strict=True):
            lines.append(f"{time},{name},{x},{y},{bearing!r},0.02,{path}")
        (tmp_path / "in.csv").write_text("\n".join(lines) + "\n")
        done = nlosctl.localize(tmp_path / "in.csv", window="all", method="mixture-ml")
        return [done.estimates[name][0].as_py() for name in ("x_m", "y_m", "cov_xx_m2")]

    repeated = fix("ABCDA", [""] * 5)
    assert repeated == pytest.approx(fix("ABCDE", [""] * 5), rel=1e-12)
    rivals = fix("ABCDA", ["0", "0", "0", "0", "1"])
    assert rivals != pytest.approx(repeated, rel=1e-6)


def test_a_window_is_plotted(tmp_path: Path) -> None:
    """``plot`` draws a window by its name, without a note that ``by`` has no effect."""
    rows = [{"ticks": 1000 * k, "sensor": name, "tag": "t1", "range_m": 50.0} for k, name in enumerate("ABC")]
    plot = nlosctl.plot(save(rows, tmp_path / "in.csv"), window="1s", by="tag", snapshot="tag-t1/0")
    assert plot.view == "scene"
    assert not any("by" in note for note in plot.notes)


def test_bounds_of_windows_have_their_time_and_tags(tmp_path: Path) -> None:
    """The bound of each window has the mean time of its rows and the columns ``--by``, as its estimate does."""
    lines = ["time_s,tag,sensor,sensor_x_m,sensor_y_m,range_m,range_std_m,truth_x_m,truth_y_m"]
    for tag, start in (("a", 0.0), ("b", 3.0)):
        for step, (x, y) in enumerate([(0, 0), (10, 0), (0, 10)]):
            lines.append(f"{start + 0.1 * step:.1f},{tag},s{step},{x},{y},{math.hypot(3 - x, 4 - y)},0.1,3,4")
    (tmp_path / "r.csv").write_text("\n".join(lines) + "\n")
    words = ["r.csv", "--window", "1s", "--by", "tag", "-q", "-o"]
    for command in ("bound", "localize"):
        done = run_here(command, *words, f"{command}.parquet", folder=tmp_path)
        assert done.returncode == 0, done.stderr
    bound, fixes = (nlosctl.read(tmp_path / f"{name}.parquet") for name in ("bound", "localize"))
    assert bound.column_names[-2:] == ["time_s", "tag"]
    for name in ("snapshot", "time_s", "tag"):
        assert bound[name].to_pylist() == fixes[name].to_pylist()
    assert bound["time_s"].to_pylist() == pytest.approx([0.1, 3.1])
