"""Sensors of the scene that are valid for a time, with `from` and `to`."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from program import run_here
from reading_support import read, whole

import nlosctl
from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene, Sensor
from nlosctl.errors import DataError, UsageError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.measurements.windows.sensor_times import SensorTimes
from nlosctl.io.paths.inputs import expand_inputs
from nlosctl.io.scenes.scene_file import scene_from_toml, scene_to_toml
from nlosctl.pipeline.convert.importer import Import

HEAD = '[[sensor]]\nname = "A"\nposition = [0, 0]\n'
HOUR = datetime(2024, 6, 1, 12, tzinfo=UTC)


def entry(name: str, x: float, **times: str) -> str:
    """Return a table of a scene; ``start`` and ``end`` are TOML values."""
    keys = {"start": "from", "end": "to"}
    return "\n".join(
        [
            f'[[sensor]]\nname = "{name}"\nposition = [{x}, 0.0]\nheading_deg = {x}',
            *(f"{keys[key]} = {value}" for key, value in times.items()),
            "",
        ]
    )


def ranges(folder: Path, column: str, rows: list[tuple[str, str]], **scene: str) -> Path:
    """Write a file of ranges, a row per time and sensor, and its scene beside it; return its path."""
    path = folder / "rows.csv"
    lines = [f"s{index},{time},{sensor},50,1" for index, (time, sensor) in enumerate(rows)]
    path.write_text("\n".join([f"snapshot,{column},sensor,range_m,range_std_m", *lines, ""]))
    (folder / "scene.toml").write_text("".join(scene.values()))
    return path


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("from = 2024-06-01T00:00:00", "sensor[0].from: sensor 'A': got 2024-06-01T00:00:00, expected an offset"),
        ("to = 2024-06-01", "sensor[0].to: got datetime.date(2024, 6, 1), expected a date-time with an offset"),
        ("to = [1]", "sensor[0].to: got [1], expected a date-time with an offset, or a number"),
        ("from = 5\nto = 5", "sensor[0].to: sensor 'A': got 5.0, expected a time after 5.0"),
        (
            "from = 2024-06-01T02:00:00+02:00\nto = 2024-06-01T00:00:00Z",
            "sensor[0].to: sensor 'A': got 2024-06-01T00:00:00+00:00, expected a time after 2024-06-01T02:00:00+02:00",
        ),
        ("from = 5\nto = 2024-06-01T00:00:00Z", "sensor[0].to: sensor 'A': expected a date-time or a number"),
        (f"to = 5\n{HEAD}from = 2024-06-01T00:00:00Z", "sensor[1]: sensor 'A' has other times than sensor[0], 'A'"),
        (f"from = 0\nto = 5\n{HEAD}from = 4.5", "sensor[1]: sensor 'A' from 4.5 overlaps sensor[0] up to 5.0"),
        (f"from = 4\nto = 6\n{HEAD}to = 5", "sensor[0]: sensor 'A' from 4.0 overlaps sensor[1] up to 5.0"),
        (f"from = 4\n{HEAD}", "sensor[0]: sensor 'A' from 4.0 overlaps sensor[1] without 'to'"),
        (HEAD, "sensor[1].name: 'A' is taken by sensor[0]"),
    ],
)
def test_wrong_times_of_a_sensor_name_it(text: str, message: str) -> None:
    """Each fault of `from` and `to` is an error of the scene that names the entry and its sensor."""
    with pytest.raises(DataError) as caught:
        scene_from_toml(HEAD + text, "my.scene.toml")
    assert str(caught.value).startswith(f"my.scene.toml: {message}")


@pytest.mark.parametrize(
    ("start", "end"),
    [(HOUR, None), (None, HOUR.astimezone(timezone(timedelta(hours=-3, minutes=-30)))), (-2.5, 1717999999.000001)],
)
def test_times_of_a_sensor_read_back_equal(start: datetime | float | None, end: datetime | float | None) -> None:
    """`from` and `to` are unchanged after writing and reading a scene."""
    scene = Scene(sensors=(Sensor(name="A", position=(1.0, 2.0), start=start, end=end),))
    assert scene_from_toml(scene_to_toml(scene), "scene.toml") == scene


def test_the_entry_at_a_time_equals_a_search_of_all() -> None:
    """The entry of each sensor at each time is the one whose half-open interval contains it, in any order."""
    random = np.random.default_rng(7)
    sensors = []
    for name in "ABCD":
        edges = np.sort(random.choice(60, 10, replace=False)).astype(float)
        sensors += [
            Sensor(name=name, position=(0.0, 0.0), start=start, end=end)
            for start, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
        ]
    sensors += [Sensor(name="E", position=(0.0, 0.0)), Sensor(name="A", position=(0.0, 0.0), start=70.0)]
    scene = Scene(sensors=tuple(sensors[index] for index in random.permutation(len(sensors))))
    times = SensorTimes(scene)
    names = scene.sensor_names
    for number, second in np.ndindex(len(names), 75):
        holding = [
            index
            for index, known in enumerate(scene.sensors)
            if known.name == names[number]
            and (known.start is None or known.start <= second)
            and (known.end is None or second < known.end)
        ]
        (found,) = times.entries(np.array([number]), np.array([second * 10**6]))
        assert [found] == (holding or [-1])
        assert (names[number] in times.valid(np.array([second * 10**6]))) == bool(holding)
    assert times.entries(np.array([-1]), np.array([0])).tolist() == [-1]


@pytest.mark.parametrize(
    ("column", "edge", "rows"),
    [
        ("time_s", "100.5", ["-7", "100.499999", "100.5", "1e6"]),
        (
            "time",
            "2024-06-01T14:00:00.25+02:00",
            [
                "1999-01-01T00:00Z",
                "2024-06-01T12:00:00.249999999Z",
                "2024-06-01T12:00:00.25Z",
                "2024-06-01T12:00:00.250000001Z",
            ],
        ),
    ],
)
@pytest.mark.parametrize("window", [None, "1us"])
def test_a_sensor_moves_at_a_time(tmp_path: Path, column: str, edge: str, rows: list[str], window: str | None) -> None:
    """Rows before the edge have the earlier position, and rows at the edge and after it the later one."""
    scene = {"late": entry("A", 10.0, start=edge), "early": entry("A", -10.0, end=edge), "b": entry("B", 5.0)}
    path = ranges(tmp_path, column, [(time, sensor) for time in rows for sensor in "AB"], **scene)
    if window is not None:
        path.write_text("\n".join(line.split(",", 1)[1] for line in path.read_text().splitlines()))
    columns = whole(read([path], window=window)).columns
    assert columns["sensor_x_m"].tolist() == [-10.0, 5.0, -10.0, 5.0, 10.0, 5.0, 10.0, 5.0]
    assert "ticks" not in columns


def test_headings_and_nodes_hold_at_a_time(tmp_path: Path) -> None:
    """Relative directions take the heading, and triplets the positions, of the entry at the time of the row."""
    (tmp_path / "scene.toml").write_text(entry("A", 0.0, end="5") + entry("A", 90.0, start="5"))
    path = tmp_path / "rows.csv"
    path.write_text("time_s,sensor,relative_bearing_deg,bearing_std_deg\n4,A,0,1\n5,A,0,1\n")
    assert whole(read([path])).columns["bearing_rad"] == pytest.approx([0.5 * np.pi, 0.0])
    (tmp_path / "scene.toml").write_text(entry("tx", 0.0, end="5") + entry("tx", 90.0, start="5") + entry("rx", 7.0))
    stds = "dod_std_rad,doa_std_rad,path_length_std_m"
    path.write_text(f"time_s,path,dod_rad,doa_rad,path_length_m,{stds}\n4,0,1,2,99,.1,.1,1\n5,1,1,2,99,.1,.1,1\n")
    columns = whole(read([path])).columns
    assert columns["tx_x_m"].tolist() == [0.0, 90.0]
    assert columns["rx_x_m"].tolist() == [7.0, 7.0]
    (tmp_path / "scene.toml").write_text(entry("tx", 0.0, end="5") + entry("rx", 7.0))
    with pytest.raises(
        DataError, match=r"row 2 \(line 3\), column 'time_s': the scene has no entry of sensor 'tx' at 5"
    ):
        read([path])


def test_a_row_without_an_entry_at_its_time_is_bad(tmp_path: Path) -> None:
    """The message names row, sensor and time, even where the row has a position of its own."""
    times = [("2024-06-01T12:00:00Z", "A"), ("2024-06-01T13:00:00Z", "A")]
    path = ranges(tmp_path, "time", times, a=entry("A", 1.0, end="2024-06-01T13:00:00Z"))
    expected = (
        f"{path}, row 2 (line 3), column 'time': the scene has no entry of sensor 'A' at 2024-06-01T13:00:00Z; "
        "add one whose 'from' and 'to' include that time"
    )
    with pytest.raises(DataError) as caught:
        read([path])
    assert expected in str(caught.value)
    bad: list[int | None] = []
    chunks = read([path], bad_rows=lambda rows: bad.extend(row.problem.row for row in rows))
    assert (bad, whole(chunks).ids) == ([2], ["s0"])
    lines = path.read_text().splitlines()
    own = [f"{lines[0]},sensor_x_m,sensor_y_m", *(f"{line},3,4" for line in lines[1:])]
    path.write_text("\n".join(own))
    with pytest.raises(DataError, match="no entry of sensor 'A'"):
        read([path])


def test_times_of_the_scene_need_those_of_the_file(tmp_path: Path) -> None:
    """A file without times, or with times of the other kind, is an error that names the cause."""
    path = ranges(tmp_path, "clock", [("4", "A")], a=entry("A", 1.0, end="5"))
    with pytest.raises(
        DataError, match=r"no column 'time_s' or 'time'.*, which 'from' and 'to' of the scene's sensors"
    ):
        read([path])
    assert whole(read([path], columns={"time_s": "clock"})).columns["sensor_x_m"].tolist() == [1.0]
    with pytest.raises(DataError, match="column 'time', but 'from' and 'to' of the scene's sensors are numbers"):
        read([path], columns={"time": "clock"})


def test_a_sensor_valid_for_no_time_is_a_remark(tmp_path: Path) -> None:
    """A sensor with no entry at the time of any row is named, not one with an entry that holds at some time."""
    scene = {
        "a": entry("A", 1.0, end="5") + entry("A", 2.0, start="5", end="6"),
        "b": entry("B", 3.0, start="4.5", end="5"),
        "c": entry("C", 4.0),
    }
    path = ranges(tmp_path, "time_s", [("4", "A"), ("5", "A")], **scene)
    remark = "sensors of the scene that are valid for no time of the input: B"
    reader = MeasurementReader(expand_inputs([str(path)]), InputOptions())
    list(reader.chunks())
    assert [text for text in reader.report.remarks if "valid" in text] == [remark]


def test_flags_keep_the_times_of_sensors(tmp_path: Path) -> None:
    """Flags are solved again to the same fixes: they carry the times, and their scene has `from` and `to`."""
    scene = {"a": entry("A", 0.0, end="5") + entry("A", 40.0, start="5"), "b": entry("B", 90.0), "c": entry("C", 50.0)}
    path = ranges(tmp_path, "time_s", [(time, name) for time in "45" for name in "ABC"], **scene)
    snapshots = {"s0": "s2", "s1": "s2", "s3": "s5", "s4": "s5"}
    lines = path.read_text().splitlines()
    path.write_text("\n".join(snapshots.get(line[:2], line[:2]) + line[2:] for line in lines))
    for words in (["rows.csv", "-o", "once.csv", "--flags-out", "flags.parquet"], ["flags.parquet", "-o", "again.csv"]):
        assert run_here("localize", *words, folder=tmp_path).returncode == 0
    once, again = ((tmp_path / name).read_text() for name in ("once.csv", "again.csv"))
    assert once == again
    first, second = (float(line.split(",")[4]) for line in once.splitlines()[1:])
    assert abs(first - second) > 1.0


def test_parts_of_a_folder_agree_on_the_sensors_that_are_valid(tmp_path: Path) -> None:
    """A sensor valid in one part of a folder is not named, when parts are solved one by one; one valid in none is."""
    entries = entry("A", 0.0, end="5") + entry("B", 40.0, start="5") + entry("C", 50.0) + entry("D", 50.0, start="9")
    ranges(tmp_path, "time_s", [], a=entries)
    (tmp_path / "scene.toml").rename(tmp_path / "moved.toml")
    (tmp_path / "parts").mkdir()
    for time, name in (("4", "A"), ("5", "B")):
        path = ranges(tmp_path, "time_s", [(time, name), (time, "C")])
        text = path.read_text().replace("s0", f"s{time}").replace("s1", f"s{time}")
        (tmp_path / "parts" / f"{name}.csv").write_text(text)
    done = run_here("localize", "parts", "--scene", "moved.toml", "-o", "fixes/", folder=tmp_path)
    assert done.returncode == 0
    assert b"valid for no time of the input: D\n" in done.stderr


def test_a_simulation_refuses_sensors_with_times() -> None:
    """Simulated rows have no times, so that sensors with times are a usage error."""
    scene = scene_from_toml(entry("A", 0.0, end="5") + entry("B", 50.0), "s.toml")
    with pytest.raises(UsageError, match=r"without 'from' and 'to'\. Got sensor 'A'"):
        nlosctl.simulate("bearings", trials=3, scene=scene)


@pytest.mark.parametrize(
    ("importer", "log", "parameters"),
    [
        ("uwb", "time,anchor,range\n{early},A,5\n{late},A,6\n", {}),
        ("anchor-azimuths", "time_s,sensor,azimuth_deg\n{early},A,5\n{late},A,6\n", {}),
    ],
)
@pytest.mark.parametrize("iso", [False, True])
def test_importers_take_the_entry_of_the_time(
    tmp_path: Path, importer: str, log: str, parameters: dict[str, str], iso: bool
) -> None:
    """Each row of a log has the position that holds at its time; a time without an entry is a bad line."""
    early, late = ("2024-06-01T11:59:59Z", "2024-06-01T14:00:00+02:00") if iso else ("4.5", "5")
    (tmp_path / "log.csv").write_text(log.format(early=early, late=late))
    limit = "2024-06-01T12:00:00Z" if iso else "5"
    scene = tmp_path / "moved.toml"
    scene.write_text(entry("A", 10.0, end=limit) + entry("A", 20.0, start=limit))
    found = Import(importer, parameters, scene_file=str(scene)).read(str(tmp_path / "log.csv")).table
    assert found["sensor_x_m"].to_pylist() == [10.0, 20.0]
    scene.write_text(entry("A", 10.0, end=limit))
    with pytest.raises(DataError, match=r"line 3.*sensor 'A' is not valid at .*; extend its 'from' or 'to'"):
        Import(importer, parameters, scene_file=str(scene)).read(str(tmp_path / "log.csv"))
    scene.write_text(entry("A", 10.0, end="5" if iso else "2024-06-01T12:00:00Z"))
    with pytest.raises(DataError, match=r"the scene limits sensor 'A' by (numbers|date-times)"):
        Import(importer, parameters, scene_file=str(scene)).read(str(tmp_path / "log.csv"))


def test_local_times_of_a_log_and_sensors_with_times(tmp_path: Path) -> None:
    """A log whose times have no offset can't be compared with the date-times of a scene."""
    (tmp_path / "log.csv").write_text("time,anchor,range\n2024-06-01T11:00:00,A,5\n")
    (tmp_path / "scene.toml").write_text(entry("A", 10.0, end="2024-06-01T12:00:00Z"))
    with pytest.raises(DataError, match=r"without an offset, and the scene limits sensor 'A'"):
        Import("uwb", {}).read(str(tmp_path / "log.csv"))
