"""Geographic coordinates in measurement files."""

from __future__ import annotations

import builtins
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import EarthFrame, Scene, parse_frame
from nlosctl.errors import DataError, UsageError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import expand_inputs
from nlosctl.io.scenes.scene_file import scene_from_toml, scene_to_toml

GEOD = pyproj.Geod(ellps="WGS84")
SOURCE = (47.36, 8.58)
SENSORS = {"a": (47.37, 8.54), "b": (47.40, 8.60), "c": (47.33, 8.62)}
HEADER = "snapshot,sensor,sensor_lat_deg,sensor_lon_deg,azimuth_deg,bearing_std_deg\n"


def lines() -> list[str]:
    """Return rows of exact true azimuths from the sensors to the source."""
    rows = []
    for name, (lat, lon) in SENSORS.items():
        azimuth = GEOD.inv(lon, lat, SOURCE[1], SOURCE[0])[0] % 360.0
        rows.append(f"1,{name},{lat},{lon},{azimuth:.9f},1\n")
    return rows


def write(folder: Path, text: str, name: str = "drive.csv") -> str:
    """Write a file and return its name."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


def read(name: str, **options: Any) -> tuple[MeasurementReader, Mapping[str, Any]]:
    """Return the reader of a file, and the columns of its only chunk."""
    reader = MeasurementReader(expand_inputs([name]), InputOptions(**options))
    (chunk,) = reader.chunks()
    return reader, chunk.columns


@pytest.mark.parametrize("words", [None, "EPSG:32632", "EPSG:2056", "47,8.9", "47.37,8.54,25"])
def test_true_azimuths_meet_in_the_source_in_any_plane(tmp_path: Path, words: str | None) -> None:
    """In any plane, bearings point from the sensors to the source: north is true north at each sensor."""
    reader, columns = read(write(tmp_path, HEADER + "".join(lines())), origin=words)
    from nlosctl.io.scenes.scene_file import plane_of

    assert reader.scene.frame is not None
    source = plane_of(reader.scene.frame).to_plane(*(np.array([degrees]) for degrees in SOURCE))
    expected = np.arctan2(source[1] - columns["sensor_y_m"], source[0] - columns["sensor_x_m"])
    wrapped = np.angle(np.exp(1j * (columns["bearing_rad"] - expected)))
    np.testing.assert_allclose(wrapped, 0.0, atol=2e-5)


def test_without_a_word_the_plane_touches_the_first_place(tmp_path: Path) -> None:
    """The origin is the first row's position, for any later rows and any chunks."""
    name = write(tmp_path, HEADER + "".join(lines()))
    assert read(name)[0].scene.frame == EarthFrame(origin_lat_deg=47.37, origin_lon_deg=8.54)
    reader = MeasurementReader(expand_inputs([name]), InputOptions(chunk_rows=1))
    whole = read(name)[1]["sensor_x_m"]
    cut = np.concatenate([chunk.columns["sensor_x_m"] for chunk in reader.chunks()])
    assert reader.scene.frame == EarthFrame(origin_lat_deg=47.37, origin_lon_deg=8.54)
    np.testing.assert_array_equal(cut, whole)


def test_coordinates_may_be_in_folder_names(tmp_path: Path) -> None:
    """A latitude in a folder name and a longitude in the file give the same x and y as two columns."""
    name = write(tmp_path, HEADER + "1,a,47.37,8.54,10,1\n1,b,47.37,8.6,20,1\n")
    folder = tmp_path / "drive" / "sensor_lat_deg=47.37"
    folder.mkdir(parents=True)
    write(folder, "snapshot,sensor,sensor_lon_deg,azimuth_deg,bearing_std_deg\n1,a,8.54,10,1\n1,b,8.6,20,1\n", "a.csv")
    for column, values in read(name)[1].items():
        np.testing.assert_array_equal(read(str(tmp_path / "drive"))[1][column], values)


def test_parts_of_a_folder_share_the_plane_of_the_first(tmp_path: Path) -> None:
    """Several files are one table in one plane."""
    folder = tmp_path / "drive"
    folder.mkdir()
    for number, row in enumerate(lines()):
        write(folder, HEADER + row, f"{number}.csv")
    reader, columns = read(str(folder))
    assert reader.scene.frame == EarthFrame(origin_lat_deg=47.37, origin_lon_deg=8.54)
    assert columns["sensor_x_m"].shape == (3,)


def test_other_headers_and_true_places_in_degrees(tmp_path: Path) -> None:
    """``--column`` reads a latitude under another name; a true position in degrees gives one in metres."""
    header = HEADER.replace("sensor_lat_deg", "LAT").replace("\n", ",truth_lat_deg,truth_lon_deg\n")
    rows = [row.replace("\n", f",{SOURCE[0]},{SOURCE[1]}\n") for row in lines()]
    name = write(tmp_path, header + "".join(rows))
    reader = MeasurementReader(expand_inputs([name]), InputOptions(columns={"sensor_lat_deg": "LAT"}))
    (chunk,) = reader.chunks()
    azimuth, _, length = GEOD.inv(8.54, 47.37, SOURCE[1], SOURCE[0])
    truth = chunk.table.column("truth_x_m")[0].as_py(), chunk.table.column("truth_y_m")[0].as_py()
    assert math.hypot(*truth) == pytest.approx(length, abs=1e-6)
    assert math.degrees(math.atan2(*truth)) == pytest.approx(azimuth, abs=1e-9)
    assert "sensor_x_m" not in chunk.table.column_names


@pytest.mark.parametrize(
    ("lat", "lon", "says"),
    [
        ("147.2", "8.5", "column 'sensor_lat_deg': got 147.2, expected -90 to 90 degrees"),
        ("47.2", "-181", "column 'sensor_lon_deg': got -181, expected -180 to 360 degrees"),
        ("", "8.5", "column 'sensor_lat_deg': got an empty cell (null), expected -90 to 90 degrees"),
        ("north", "8.5", "column 'sensor_lat_deg': got 'north', expected a number"),
    ],
)
def test_a_bad_place_is_a_bad_row(tmp_path: Path, lat: str, lon: str, says: str) -> None:
    """An invalid latitude or longitude is reported with its row and column."""
    name = write(tmp_path, HEADER + lines()[0] + f"1,b,{lat},{lon},10,1\n")
    with pytest.raises(DataError) as caught:
        read(name)
    assert f"{name}, row 2 (line 3), {says}" in str(caught.value)


def test_no_place_at_all(tmp_path: Path) -> None:
    """A file whose coordinates are all empty has no local plane: an error."""
    with pytest.raises(DataError, match="no row has a location: 'sensor_lat_deg' and 'sensor_lon_deg'"):
        read(write(tmp_path, HEADER + "1,a,,,10,1\n"))


def test_the_scene_carries_the_frame(tmp_path: Path) -> None:
    """A frame is unchanged after writing and reading a scene file; an option replaces it."""
    scene = Scene(frame=EarthFrame(origin_lat_deg=47.0, origin_lon_deg=8.0, rotation_deg=12.5))
    assert scene_from_toml(scene_to_toml(scene), "s.toml") == scene
    utm = Scene(frame=EarthFrame(crs="EPSG:32632"))
    assert scene_from_toml(scene_to_toml(utm), "s.toml") == utm
    write(tmp_path, scene_to_toml(utm), "drive.scene.toml")
    name = write(tmp_path, HEADER + "".join(lines()))
    assert read(name)[0].scene == utm
    assert read(name, origin=scene.frame.words)[0].scene == scene


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[frame]\ncrs = "EPSG:32632"\norigin_lat_deg = 47.0\norigin_lon_deg = 8.0', "either crs, or origin_lat_deg"),
        ("[frame]\norigin_lat_deg = 47.0", "either crs, or origin_lat_deg and origin_lon_deg"),
        ("[frame]\norigin_lat_deg = 97.0\norigin_lon_deg = 8.0", "frame.origin_lat_deg: got 97.0, expected -90 to 90"),
        ('[frame]\ncrs = "+proj=utm +zone=32"', "frame.crs: got '\\+proj=utm \\+zone=32', expected the code"),
        ("[frame]\ncrs = 32632", "frame.crs: got 32632, expected text"),
        ("[[frame]]\nrotation_deg = 3.0", "expected a table headed"),
        ("[frame]\norigin = [47.0, 8.0]", "frame.origin: unknown key"),
    ],
)
def test_a_frame_that_is_none_is_refused(text: str, says: str) -> None:
    """Faults of a frame are reported with their key."""
    with pytest.raises(DataError, match=says):
        scene_from_toml(text, "s.toml")


@pytest.mark.parametrize("words", ["47", "97,8", "47,188", "EPSG:32632,8,9", "", "47,nan"])
def test_words_that_are_no_frame_are_refused(words: str) -> None:
    """Errors of the settings origin and crs state the form that each takes."""
    with pytest.raises(UsageError, match="`origin` takes LAT,LON in degrees"):
        parse_frame(words, "`origin`")
    with pytest.raises(UsageError, match="`crs` takes a CRS, such as EPSG:32632"):
        parse_frame(words, "`crs`")


@pytest.mark.parametrize("words", ["47.0 8.0", "47.0 8.0 12.5", "EPSG:32632", "EPSG:32632 3.0"])
def test_a_frame_is_its_words(words: str) -> None:
    """The text of a frame is parsed to the same frame."""
    assert parse_frame(words, "frame").words == words


def test_without_pyproj_the_install_line_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Geographic coordinates need the extra ``geo``; without it one line states how to install it."""
    real = builtins.__import__

    def refuse(name: str, *arguments: Any, **keywords: Any) -> Any:
        if name == "pyproj":
            raise ImportError(name)
        return real(name, *arguments, **keywords)

    monkeypatch.setattr(builtins, "__import__", refuse)
    name = write(tmp_path, HEADER + "".join(lines()))
    with pytest.raises(UsageError, match=r"pip install 'nlosctl\[geo\]'"):
        read(name, origin="1.25,2.5")
