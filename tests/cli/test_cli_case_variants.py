"""Faults that users reported, in another form than the one that was reported."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from cli_support import Outcome

Cli = Callable[..., Outcome]
AZIMUTHS = "snapshot,sensor,sensor_x_m,sensor_y_m,azimuth_deg,bearing_std_deg\n"
MIRRORED = AZIMUTHS + "".join(f"{n},a,0,0,315,1\n{n},b,100,0,45,1\n{n},c,50,-90,0.5,1\n" for n in (1, 2))
BACK = AZIMUTHS + "1,a,0,0,225,1\n1,b,100,0,135,1\n1,c,50,-90,180,1\n2,a,0,0,225,1\n2,b,100,0,135,1\n2,c,50,-90,180,1\n"


@pytest.mark.parametrize(("text", "column"), [(MIRRORED, "azimuth_ccw_deg"), (BACK, "back_azimuth_deg")])
def test_advice_for_all_snapshots_gives_the_source(cli: Cli, tmp_path: Path, text: str, column: str) -> None:
    """Azimuths that turn the other way, or point back, are reported with the column that leads to (50, 50)."""
    (tmp_path / "b.csv").write_text(text)
    assert f"--column {column}=azimuth_deg" in cli("localize", "b.csv", "-o", "wrong.csv").err
    right = cli("localize", "b.csv", "-q", "--column", f"{column}=azimuth_deg").table
    assert right["x_m"].to_pylist() == pytest.approx([50.0] * 2, abs=1.0)
    assert right["y_m"].to_pylist() == pytest.approx([50.0] * 2, abs=1.0)


_RANGES = "snapshot,sensor,sensor_x_m,sensor_y_m,range_m,range_std_m,time_s\n" + "".join(
    f"{n},{name},{x},{y},{math.hypot(30 + n - x, 40 - y) / 1000 + 1e-4 * (-1) ** (n + x)},0.0001,{n}\n"
    for n in range(6)
    for name, x, y in (("a", 0, 0), ("b", 100, 0), ("c", 100, 90), ("d", 0, 90))
)
_TRACK = ("track", "-p", "acceleration_psd=1", "-o", "t.csv")


_KILOMETRES = "range_km=range_m and --column range_std_km=range_std_m"


@pytest.mark.parametrize(
    ("words", "text", "cure"),
    [
        (_TRACK, MIRRORED, "azimuth_ccw_deg=azimuth_deg"),
        (_TRACK, _RANGES, _KILOMETRES),
        (("calibrate", "-o", "c.toml"), BACK, "back_azimuth_deg=azimuth_deg"),
        (("calibrate", "-o", "c.toml"), _RANGES, _KILOMETRES),
        (("posterior", "--snapshot", "1", "-o", "m.csv"), MIRRORED, "azimuth_ccw_deg=azimuth_deg"),
        (("identify-los", "--kind", "bearings", "-o", "i.csv"), MIRRORED, "azimuth_ccw_deg=azimuth_deg"),
    ],
)
def test_each_command_reports_the_likely_cause(
    cli: Cli, tmp_path: Path, words: tuple[str, ...], text: str, cure: str
) -> None:
    """Tracks, calibrations and maps of mirrored, turned or too short measurements name the column to read."""
    if "time_s" not in text:
        head, *rows = text.splitlines()
        text = "\n".join([f"{head},time_s", *(f"{row},{row[0]}" for row in rows)]) + "\n"
    (tmp_path / "m.csv").write_text(text)
    done = cli(words[0], "m.csv", *words[1:-1], f"out-{words[-1]}")
    assert done.code == 0
    assert f"--column {cure}" in done.err


def test_a_track_through_rows_that_contradict_each_other_fits_badly(cli: Cli, tmp_path: Path) -> None:
    """A range that is 30 m too long in each snapshot is reported; ranges within their stds are not."""
    right = _RANGES.replace("0.0001", "0.1")
    rows = [row.split(",") for row in right.splitlines()]
    for row in rows[1:]:
        row[4] = str(1000 * float(row[4]))
    (tmp_path / "right.csv").write_text("\n".join(",".join(row) for row in rows))
    for row in rows[1::4]:
        row[4] = str(30 + float(row[4]))
    (tmp_path / "wrong.csv").write_text("\n".join(",".join(row) for row in rows))
    assert "fits badly" not in cli(_TRACK[0], "right.csv", *_TRACK[1:]).err
    assert "fits badly: in 6 of 6 snapshots" in cli(_TRACK[0], "wrong.csv", *_TRACK[1:], "--overwrite").err


@pytest.mark.parametrize("words", [_TRACK, ("calibrate", "-o", "c.toml"), ("posterior", "--all", "-o", "m.csv")])
def test_each_command_names_ranges_without_a_standard_deviation(
    cli: Cli, tmp_path: Path, words: tuple[str, ...]
) -> None:
    """Ranges beside bearings that no standard deviation weighs are not used, and a note states it."""
    head, *rows = MIRRORED.replace("azimuth_deg", "azimuth_ccw_deg").splitlines()
    text = "\n".join([f"{head},range_m,time_s", *(f"{row},70,{row[0]}" for row in rows)])
    (tmp_path / "b.csv").write_text(text)
    done = cli(words[0], "b.csv", *words[1:])
    assert done.code == 0
    assert "the column 'range_m' is not used" in done.err


def test_a_calibration_by_sensor_is_refused(cli: Cli, tmp_path: Path) -> None:
    """Each sensor has an offset of its own already."""
    (tmp_path / "r.csv").write_text(_RANGES)
    done = cli("calibrate", "r.csv", "--by", "sensor")
    assert (done.code, "--by sensor" in done.err) == (2, True)


def test_a_calibration_of_snapshots_of_one_row_says_so(cli: Cli, tmp_path: Path) -> None:
    """Offsets need several rows a snapshot; ids that are times give one."""
    head, *rows = _RANGES.splitlines()
    (tmp_path / "one.csv").write_text("\n".join([head, *(f"{n}{row[1:]}" for n, row in enumerate(rows))]))
    assert "every snapshot has one row" in cli("calibrate", "one.csv", "-o", "c.toml").err


def test_times_taken_as_snapshots_lead_to_windows(cli: Cli, tmp_path: Path) -> None:
    """Stations that log at times of their own: the advice names --window, which gives the fixes."""
    rows = [f"{10 * n + k},{row[2:]}" for n in range(2) for k, row in enumerate(MIRRORED.splitlines()[1:4])]
    (tmp_path / "t.csv").write_text("\n".join(["Time", *rows]).replace("Time", "Time" + AZIMUTHS[8:].strip(), 1))
    read = ("--column", "azimuth_ccw_deg=azimuth_deg")
    advised = cli("localize", "t.csv", *read, "--column", "snapshot=Time", "-o", "o.csv").err
    assert "read them as 'time_s' (or 'time', ISO 8601) instead of 'snapshot', and set --window" in advised
    fixes = cli("localize", "t.csv", *read, "--column", "time_s=Time", "--window", "5s", "-q").table
    assert fixes["x_m"].to_pylist() == pytest.approx([50.0] * 2, abs=1.0)


def test_sources_of_snapshots_of_one_row_say_so(cli: Cli, tmp_path: Path) -> None:
    """Sources among bearings need several rows a snapshot too."""
    head, *rows = MIRRORED.splitlines()
    (tmp_path / "one.csv").write_text("\n".join([head, *(f"{n}{row[1:]}" for n, row in enumerate(rows))]))
    done = cli("identify-los", "one.csv", "--kind", "bearings", "-o", "f.csv")
    assert "every snapshot has one row" in done.err


def test_radians_in_two_columns_of_degrees(cli: Cli, tmp_path: Path) -> None:
    """Azimuths and stds in radians are both reported, each with its cure; with the cures the fix is (50, 50)."""
    (tmp_path / "r.csv").write_text(
        "sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg\na,0,0,0.7854,0.0175\nb,100,0,2.3562,0.0175\n"
    )
    words = ["--column", "bearing_rad=bearing_deg", "--column", "bearing_std_rad=bearing_std_deg"]
    err = cli("localize", "r.csv", "-o", "wrong.csv").err
    assert all(cure in err for cure in (words[1], words[3]))
    right = cli("localize", "r.csv", "-q", *words).table
    assert (right["x_m"][0].as_py(), right["y_m"][0].as_py()) == pytest.approx((50.0, 50.0), abs=0.01)


def test_paths_of_two_transmitters_have_numbers_of_their_own(cli: Cli, tmp_path: Path) -> None:
    """Path 1 of two transmitters to one receiver is two rows; of one transmitter it is a duplicate."""
    header = "snapshot,path,tx_x_m,tx_y_m,rx_x_m,rx_y_m,toa_ns,dod_deg,doa_deg\n"
    row = "1,1,0.5,{},9.5,1.0,52.1,25.0,200.0\n"
    (tmp_path / "two.csv").write_text(header + row.format("0.5") + row.format("3.5"))
    (tmp_path / "one.csv").write_text(header + row.format("0.5") * 2)
    words = ["--dod-std-deg", "1", "--doa-std-deg", "1", "--toa-std-ns", "1"]
    assert cli("localize", "two.csv", *words, "-q").table.num_rows == 2
    refused = cli("localize", "one.csv", *words, "-q")
    assert (refused.code, "duplicate measurement" in refused.err) == (1, True)


def test_three_arrow_streams_after_each_other_are_one_table(cli: Cli, tmp_path: Path) -> None:
    """The rows of all streams on standard input count, not those of the first alone."""
    streams = b""
    for number in (1, 2, 3):
        (tmp_path / "b.csv").write_text(MIRRORED.split("2,a")[0].replace("\n1,", f"\n{number},"))
        assert cli("convert", "b.csv", "-o", f"{number}.arrows").code == 0
        streams += (tmp_path / f"{number}.arrows").read_bytes()
    assert cli("localize", "-", "-q", stdin=streams).table["snapshot"].to_pylist() == [1, 2, 3]


@pytest.mark.parametrize("blank", [" ", "  ", "\t"])
def test_ids_with_blanks_around_them_are_one_id(cli: Cli, tmp_path: Path, blank: str) -> None:
    """Ids of a text file are trimmed on both sides, whatever the blank."""
    text = f"{AZIMUTHS}{blank}1,a,0,0,45,1\n1{blank},b,100,0,315,1\n1,{blank}c{blank},50,-90,0,1\n"
    (tmp_path / "b.csv").write_text(text)
    fixes = cli("localize", "b.csv", "-q").table
    assert (fixes["snapshot"].to_pylist(), fixes["n_used"].to_pylist()) == ([1], [3])
