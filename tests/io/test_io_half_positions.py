"""Positions, and ranges with their stds, come from one source each: never half from file and half from scene."""

from __future__ import annotations

from pathlib import Path

import pytest
from reading_support import read

from nlosctl.errors import DataError

SCENE = "".join(
    f'[[sensor]]\nname = "{name}"\nposition = [{x}, {y}]\n'
    for name, x, y in (("a", 0, 0), ("b", 100, 0), ("c", 50, -100))
)


def save(folder: Path, header: str, *rows: str) -> Path:
    """Write a CSV of bearings beside a scene that has all of its sensors."""
    (folder / "scene.toml").write_text(SCENE)
    path = folder / "in.csv"
    path.write_text("\n".join([f"snapshot,sensor,bearing_deg,bearing_std_deg,{header}", *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    ("header", "rows", "says"),
    [
        ("sensor_x_m", ["1,a,45,1,5000"], "column 'sensor_x_m' needs 'sensor_y_m'"),
        ("sensor_x_m,sensor_y_m", ["1,a,45,1,5000,"], "row 1 .*column 'sensor_y_m': got an empty cell"),
        ("sensor_x_m,sensor_y_m", ["1,a,45,1,,", "1,b,45,1,,7"], "row 2 .*column 'sensor_x_m': got an empty cell"),
        ("sensor_lat_deg,sensor_long_deg", ["1,a,45,1,47,8"], "'sensor_lat_deg' needs 'sensor_lon_deg' .did you mean"),
        ("sensor_lon_deg", ["1,a,45,1,8"], "'sensor_lon_deg' needs 'sensor_lat_deg'"),
        ("sensor_x_m,sensor_y_m,sensor_lat_deg,sensor_lon_deg", ["1,a,45,1,,,47,8"], "the row has sensor_lat_deg"),
        ("range_m,range_std_m", ["1,a,45,1,140,"], "expected the standard deviation of the row's range"),
    ],
)
def test_half_a_position_is_a_fault(tmp_path: Path, header: str, rows: list[str], says: str) -> None:
    """The file, or the row, is refused with the column, although the scene could fill the rest."""
    with pytest.raises(DataError, match=says):
        read([save(tmp_path, header, *rows)])


def test_whole_positions_from_either_source_are_read(tmp_path: Path) -> None:
    """A row has its own position, or that of the scene; a range needs its std, a std no range."""
    header = "sensor_x_m,sensor_y_m,sensor_lat_deg,sensor_lon_deg,range_m,range_std_m"
    (chunk,) = read([save(tmp_path, header, "1,a,45,1,5,6,47,8,,1", "1,b,45,1,,,,,3,1")])
    assert chunk.columns["sensor_x_m"].tolist() == [5.0, 100.0]
    assert chunk.columns["sensor_y_m"].tolist() == [6.0, 0.0]
