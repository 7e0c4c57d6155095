"""``nlosctl describe``: what is in a file, what is suspicious, and commands that run as they stand."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from cli_support import FIXTURES
from conftest import Cli

import nlosctl

KEYS = ["kind", "importer", "rows", "snapshots", "sensors", "time", "columns", "suspicions", "commands"]
GOOD = sorted(path.name for path in FIXTURES.glob("good_*") if not path.name.endswith(".toml"))


def described(cli: Cli, *words: Any, stdin: bytes = b"") -> dict[str, Any]:
    """Return the JSON of a description."""
    done = cli("describe", *words, "--json", stdin=stdin)
    assert done.code == 0, done.err
    found: dict[str, Any] = json.loads(done.out)
    assert list(found) == KEYS
    return found


def kinds_of(found: dict[str, Any]) -> list[str]:
    """Return what is suspicious."""
    return [suspicion["what"] for suspicion in found["suspicions"]]


def run_all(cli: Cli, found: dict[str, Any]) -> None:
    """Run the commands of a description in their order; each succeeds."""
    assert found["commands"]
    for command in found["commands"]:
        program, *words = shlex.split(command)
        assert program == "nlosctl"
        done = cli(*words)
        assert done.code == 0, (command, done.err)


@pytest.mark.parametrize("name", GOOD)
def test_fixtures_are_described_and_their_commands_run(cli: Cli, name: str) -> None:
    """Every good fixture has the counts of ``validate``, nothing suspicious but repeats, and commands that run."""
    found = described(cli, FIXTURES / name)
    checked = json.loads(cli(*shlex.split(found["commands"][0])[1:], "--json").out)
    for key in ("kind", "rows", "snapshots"):
        assert found[key] == checked[key]
    assert not {"misfit", "bad_rows", "beyond_360", "all_zeros", "sensor_jumps"} & set(kinds_of(found))
    run_all(cli, found)


def test_ranges_of_values_are_those_of_the_file(cli: Cli) -> None:
    """The ranges are those of the columns as numpy finds them."""
    table = pyarrow.parquet.read_table(FIXTURES / "good_bearings.parquet")
    found = described(cli, FIXTURES / "good_bearings.parquet")["columns"]
    for name in ("bearing_rad", "sensor_x_m", "truth_y_m", "snapshot"):
        values = np.array(table[name].to_pylist(), dtype=float)
        assert found[name] == {"min": values.min(), "max": values.max()}


def bearings(rows: int = 30, **columns: Any) -> Any:
    """Return a table of bearings of three sensors to one source, one snapshot for three rows."""
    place = {"a": (0.0, 0.0), "b": (1000.0, 0.0), "c": (0.0, 1000.0)}
    sensors = ["abc"[row % 3] for row in range(rows)]
    azimuth = [math.degrees(math.atan2(300.0 - place[s][0], 400.0 - place[s][1])) % 360.0 for s in sensors]
    standard = {
        "snapshot": [row // 3 for row in range(rows)],
        "sensor": sensors,
        "sensor_x_m": [place[sensor][0] for sensor in sensors],
        "sensor_y_m": [place[sensor][1] for sensor in sensors],
        "azimuth_deg": azimuth,
    }
    return pa.table({**standard, **columns})


def write(table: Any, name: str) -> None:
    """Write a CSV file in the folder of the test."""
    pyarrow.csv.write_csv(table, name)


def test_a_file_without_standard_deviations_has_commands_that_estimate_one(cli: Cli) -> None:
    """Spare rows give the standard deviation; ``validate`` assumes one, and the description names the column."""
    cli("--version")
    write(bearings(), "b.csv")
    found = described(cli, "b.csv")
    assert (found["kind"], found["rows"], found["snapshots"], found["sensors"]) == ("bearings", 30, 10, 3)
    assert kinds_of(found) == ["no_std"]
    assert "--estimate-std estimates it from the residuals" in found["suspicions"][0]["text"]
    assert found["commands"] == [
        "nlosctl validate b.csv --bearing-std-deg 2",
        "nlosctl localize -m ml b.csv --estimate-std file",
    ]
    run_all(cli, found)


def test_standard_input_is_described_like_the_file(cli: Cli) -> None:
    """Standard input without standard deviations and snapshots, which takes several readings."""
    cli("--version")
    write(bearings(time_s=[10 * (row // 3) + row % 3 for row in range(30)]).drop_columns(["snapshot"]), "b.csv")
    found = described(cli, "-", stdin=Path("b.csv").read_bytes())
    assert {**found, "commands": []} == {**described(cli, "b.csv"), "commands": []}
    assert found["snapshots"] == 10


def test_without_spare_rows_a_standard_deviation_is_assumed(cli: Cli) -> None:
    """Two bearings a snapshot determine a position and nothing else: the commands assume 2 degrees."""
    cli("--version")
    write(bearings().filter([row % 3 < 2 for row in range(30)]), "pairs.csv")
    found = described(cli, "pairs.csv")
    assert found["commands"][-1] == "nlosctl localize -m ml pairs.csv --bearing-std-deg 2"
    assert "put yours in their place" in found["suspicions"][0]["text"]
    run_all(cli, found)


@pytest.mark.parametrize("column", ["time_s", "time"])
def test_times_without_snapshots_are_cut_into_epochs(cli: Cli, column: str) -> None:
    """The snapshots are those of ``--window auto``, which the commands state; one station's drive stays whole."""
    cli("--version")
    seconds = [10 * (row // 3) + row % 3 for row in range(30)]
    values = {"time_s": seconds, "time": [f"2024-06-10T06:{s // 60:02d}:{s % 60:02d}Z" for s in seconds]}[column]
    table = bearings(**{column: values}).drop_columns(["snapshot"])
    write(table, "log.csv")
    found = described(cli, "log.csv")
    assert (found["rows"], found["snapshots"], found["sensors"]) == (30, 10, 3)
    assert found["time"]["largest_gap_s"] == 8.0
    assert all("--window auto" in command for command in found["commands"])
    run_all(cli, found)
    write(table.take(list(range(29, -1, -1))), "backwards.csv")
    found = described(cli, "backwards.csv")
    assert found["snapshots"] == 10
    assert [known["rows"] for known in found["suspicions"] if known["what"] == "times_go_back"] == [29]
    write(table.set_column(0, "sensor", pa.array(["car"] * 30)), "drive.csv")
    found = described(cli, "drive.csv")
    assert found["snapshots"] == 1
    assert not any("--window" in command for command in found["commands"])


def test_times_and_their_gaps(cli: Cli) -> None:
    """Times as ISO 8601 and as seconds give the first, the last and the largest gap; repeats and leaps are counted."""
    cli("--version")
    seconds = [float(row // 3) for row in range(30)]
    seconds[27:] = [60.0, 60.0, 60.0]
    seconds[3] = 0.0
    write(bearings(time_s=seconds), "s.csv")
    found = described(cli, "s.csv")
    assert found["time"] == {"first": 0.0, "last": 60.0, "largest_gap_s": 52.0}
    assert {"duplicated_stamps"} <= set(kinds_of(found))
    texts = [f"2024-06-10T06:00:{int(value) % 60:02d}+02:00" for value in seconds]
    write(bearings(time=texts), "t.csv")
    found = described(cli, "t.csv")
    assert found["time"]["first"] == "2024-06-10T04:00:00Z"
    assert "times_go_back" in kinds_of(found)


@pytest.mark.parametrize(
    ("columns", "what", "column"),
    [
        ({"azimuth_deg": [0.0] * 30}, "all_zeros", "azimuth_deg"),
        ({"azimuth_deg": [45.0] * 30}, "constant", "azimuth_deg"),
        ({"azimuth_deg": [400.0 + row for row in range(30)]}, "beyond_360", "azimuth_deg"),
        ({"sensor_x_m": [0.0] * 30, "sensor_y_m": [0.0] * 30}, "all_zeros", "sensor_x_m"),
        ({"azimuth_deg": [0.1 * row + 0.01 for row in range(30)]}, "radians_as_degrees", "azimuth_deg"),
    ],
)
def test_suspicious_values(cli: Cli, columns: dict[str, Any], what: str, column: str) -> None:
    """Zeros, constants, angles beyond a turn and radians in degrees are found, with their column."""
    cli("--version")
    write(bearings(**columns), "b.csv")
    found = described(cli, "b.csv")
    assert (what, column) in [(known["what"], known["column"]) for known in found["suspicions"]]


def test_degrees_in_a_column_of_radians(cli: Cli) -> None:
    """Degrees called radians are read as degrees, and the commands do so too."""
    found = described(cli, FIXTURES / "bad_degrees_as_radians.csv")
    assert "degrees_as_radians" in kinds_of(found)
    assert all("--column bearing_deg=bearing_rad" in command for command in found["commands"])
    run_all(cli, found)


def test_a_sensor_that_jumps(cli: Cli) -> None:
    """A sensor that is elsewhere for one row and back is named; one that drives is not."""
    cli("--version")
    x = bearings()["sensor_x_m"].to_pylist()
    x[12] = 77_000.0
    write(bearings(sensor_x_m=x), "jump.csv")
    assert [known["text"] for known in described(cli, "jump.csv")["suspicions"] if known["what"] == "sensor_jumps"] == [
        "sensor 'a' is elsewhere for 1 single rows and then back: are its positions right?"
    ]
    write(bearings(sensor_x_m=[10.0 * row for row in range(30)]), "drive.csv")
    assert "sensor_jumps" not in kinds_of(described(cli, "drive.csv"))


def test_counter_clockwise_azimuths(cli: Cli) -> None:
    """Azimuths of the other sense are found by their intersections, with the option that reads them."""
    cli("--version")
    azimuth = [360.0 - value for value in bearings()["azimuth_deg"].to_pylist()]
    write(bearings(azimuth_deg=azimuth), "ccw.csv")
    found = described(cli, "ccw.csv")
    texts = [known["text"] for known in found["suspicions"] if known["what"] == "misfit"]
    assert len(texts) == 1
    assert "--column azimuth_ccw_deg=azimuth_deg" in texts[0]


@pytest.mark.parametrize(
    ("changed", "name"),
    [
        (lambda azimuth: (360.0 - azimuth) % 360.0, "azimuth_ccw_deg"),
        (lambda azimuth: (90.0 - azimuth) % 360.0, "bearing_deg"),
        (lambda azimuth: (azimuth + 180.0) % 360.0, "back_azimuth_deg"),
    ],
)
def test_bearings_that_do_not_lead_to_the_truth(cli: Cli, changed: Callable[[float], float], name: str) -> None:
    """A single row a snapshot is enough where the truth is there; one outlier of 30 bearings does not matter."""
    cli("--version")
    azimuth = [changed(value) for value in bearings()["azimuth_deg"].to_pylist()]
    azimuth[7] = (azimuth[7] + 77.0) % 360.0
    truth = {"truth_x_m": [300.0] * 30, "truth_y_m": [400.0] * 30}
    write(bearings(snapshot=list(range(30)), azimuth_deg=azimuth, **truth), "turned.csv")
    (known,) = [known for known in described(cli, "turned.csv")["suspicions"] if known["what"] == "misfit"]
    assert (known["column"], known["rows"]) == ("azimuth_deg", 30)
    assert known["text"].startswith("29 of 30 bearings lead to the true positions (0 as given) if 'azimuth_deg' is")
    assert f"--column {name}=azimuth_deg" in known["text"]
    write(bearings(snapshot=list(range(30)), **truth), "right.csv")
    assert "misfit" not in kinds_of(described(cli, "right.csv"))


def test_bad_rows_are_counted_and_set_aside_by_the_command(cli: Cli) -> None:
    """A file with bad rows is described; its command sets them aside."""
    cli("--version")
    azimuth: list[Any] = bearings()["azimuth_deg"].to_pylist()
    azimuth[4] = None
    write(bearings(azimuth_deg=azimuth), "b.csv")
    found = described(cli, "b.csv")
    assert "bad_rows" in kinds_of(found)
    run_all(cli, found)


@pytest.mark.parametrize("text", [b"", b"hello\n", b"a,b\n1,2\n", b"\x00\x01\x02", b"{}\n"])
def test_a_file_that_fits_nothing_is_one_line(cli: Cli, tmp_path: Path, text: bytes) -> None:
    """A file that is neither a table of measurements nor a known log exits 1 with one line."""
    for name in ("x.csv", "x.log", "x.parquet"):
        (tmp_path / name).write_bytes(text)
        done = cli("describe", name)
        assert done.code == 1
        assert len(done.err.splitlines()) == 1
    assert cli("describe", "nowhere.csv").code == 1


def test_estimates_are_not_measurements(cli: Cli) -> None:
    """A table of results is refused in one line."""
    done = cli("localize", "-m", "ml", FIXTURES / "good_bearings.csv", "-o", "e.csv", "-q")
    assert done.code == 0
    done = cli("describe", "e.csv")
    assert done.code == 1
    assert "contains estimates" in done.err


def test_a_log_of_another_program(cli: Cli, tmp_path: Path) -> None:
    """A log is recognized, converted by the first command and solved by the next."""
    rows = []
    for name, lat, lon, doa in (("N", 47.40, 8.55, 180), ("W", 47.37, 8.50, 90), ("E", 47.37, 8.60, 270)):
        spectrum = ", ".join("1.0" if angle == doa else "0.0" for angle in range(360))
        place = f"{name}, {lat}, {lon}, 0.0, 0.0, GPS, R, R, R, R"
        rows.append(f"1718000000000, {doa}, 9.5, -35.2, 433920000, UCA, 100, {place}, {spectrum}")
    (tmp_path / "kraken.csv").write_text("\n".join(rows) + "\n")
    found = described(cli, "kraken.csv")
    assert found["importer"] == "kraken-csv"
    assert found["commands"][0].startswith("nlosctl convert kraken.csv --from kraken-csv")
    run_all(cli, found)


def test_the_function_gives_the_same(cli: Cli) -> None:
    """``nlosctl.describe`` returns what the command prints as JSON."""
    cli("--version")
    write(bearings(bearing_std_deg=[2.0] * 30), "b.csv")
    assert nlosctl.describe("b.csv") == described(cli, "b.csv")


ARRIVALS = {"a": (0.0, 0.0, 3.2785), "b": (40.0, 0.0, 3.3012), "c": (40.0, 40.0, 3.29057), "d": (0.0, 40.0, 3.26421)}
"""Position in metres, and time in seconds at the speed of sound, of four microphones."""


def arrivals(name: str, factor: float = 1.0, shift: float = 0.0) -> Any:
    """Return three snapshots of the microphones' times in a unit of 1 / factor seconds, in a column of this name."""
    rows = [(number, *row) for number in range(3) for row in ((key, *place) for key, place in ARRIVALS.items())]
    names = ("snapshot", "sensor", "sensor_x_m", "sensor_y_m")
    columns = {key: [row[index] for row in rows] for index, key in enumerate(names)}
    return pa.table({**columns, name: [row[4] * factor + shift + row[0] for row in rows]})


def test_arrivals_of_sound_are_not_those_of_light(cli: Cli) -> None:
    """Differences longer than their baselines at the speed of light, not at that of sound: the commands set it."""
    cli("--version")
    write(arrivals("arrival_s"), "a.csv")
    found = described(cli, "a.csv")
    assert (found["kind"], found["snapshots"], found["sensors"]) == ("arrivals", 3, 4)
    assert kinds_of(found) == ["no_std", "sound_as_light"]
    assert all("--speed-m-s 343" in command for command in found["commands"])
    run_all(cli, found)
    assert kinds_of(described(cli, "a.csv", "--speed-m-s", "sound")) == ["no_std"]


def test_arrivals_in_another_unit(cli: Cli) -> None:
    """Gateways' nanoseconds in a column of microseconds: the description names the column that fits."""
    cli("--version")
    stamps = {
        "a": (0, 0, 12510210),
        "b": (6200, 400, 12513627),
        "c": (5100, 5600, 12515278),
        "d": (-900, 4800, 12514654),
    }
    rows = [(key, *row) for key, row in stamps.items()]
    names = ("sensor", "sensor_x_m", "sensor_y_m", "arrival_us")
    write(pa.table({name: [row[index] for row in rows] for index, name in enumerate(names)}), "u.csv")
    (known,) = [known for known in described(cli, "u.csv")["suspicions"] if known["what"] == "longer_than_baseline"]
    assert known["column"] == "arrival_us"
    assert known["text"].startswith("in 1 of 1 snapshots arrivals differ by more than the distance of their sensors")
    assert "--column arrival_ns=arrival_us" in known["text"]


def test_a_receiver_without_a_clock_is_not_sound(cli: Cli) -> None:
    """One late receiver of seven makes all differences with it too long; no speed and no unit is proposed for that."""
    found = described(cli, FIXTURES / "formats" / "opensky.csv")
    (known,) = [known for known in found["suspicions"] if known["what"] == "longer_than_baseline"]
    assert "are positions in metres" in known["text"]
    assert found["importer"] == "opensky"
    assert "--dimensions 3" in found["commands"][-1]
    assert "--speed-m-s" not in found["commands"][-1]


def test_nanoseconds_as_floats_are_named(cli: Cli) -> None:
    """Times that are rounded as floating-point numbers are bad rows, and the description has the cure."""
    cli("--version")
    table = arrivals("arrival_ns", 1e9, 1.7e18)
    write(table.set_column(4, "arrival_ns", pa.array([f"{x:.6e}" for x in table["arrival_ns"].to_pylist()])), "n.csv")
    (known,) = [known for known in described(cli, "n.csv")["suspicions"] if known["what"] == "bad_rows"]
    assert "give whole nanoseconds in a column of integers" in known["text"]


def test_windows_of_tables_and_logs(cli: Cli, tmp_path: Path) -> None:
    """``--window`` and ``--by`` are those of other commands: for tables, and for logs as in ``convert``."""
    cli("--version")
    seconds = [10 * (row // 3) + row % 3 for row in range(30)]
    write(bearings(time_s=seconds, tag=["xy"[row // 3 % 2] for row in range(30)]).drop_columns(["snapshot"]), "w.csv")
    found = described(cli, "w.csv", "--window", "20s", "--by", "tag", "--bearing-std-deg", "2")
    assert found["snapshots"] == 10
    assert all("--window 20s --by tag" in command for command in found["commands"])
    run_all(cli, found)
    log = FIXTURES / "formats" / "uwb_ranges.csv"
    assert [described(cli, log, *words)["snapshots"] for words in ((), ("--window", "2s"))] == [2, 1]
    (tmp_path / "l.csv").write_bytes(log.read_bytes())
    (tmp_path / "l.scene.toml").write_bytes(log.with_name("uwb_ranges.scene.toml").read_bytes())
    found = described(cli, "l.csv", "--window", "2s", "--by", "sensor")
    assert "--from uwb --window 2s --by sensor" in found["commands"][0]
    assert found["snapshots"] == 3
    run_all(cli, found)
    for words in (("--by", "sensor"), ("--window", "2s")):
        done = cli("describe", FIXTURES / "good_bearings.csv", *words)
        assert done.code in (1, 2)
        assert len(done.err.splitlines()) == 1
