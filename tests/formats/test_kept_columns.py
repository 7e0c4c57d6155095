"""Importers keep columns of the log, and group by several."""

from __future__ import annotations

from pathlib import Path

import pytest
from program import run_here

import nlosctl

BEARS = """Observer,Easting,Northing,Azimuth,Date,Time,AnimalID
Ann,0,0,45,2024-06-10,08:00,F013
Bob,100,0,315,2024-06-10,,F013
Ann,0,0,30,2024-06-11,08:00,F013
Bob,100,0,330,2024-06-11,08:05,F013
Ann,0,0,40,2024-06-10,09:00,M7
Bob,100,0,320,2024-06-10,09:05,M7
"""


def test_several_columns_group_and_others_are_kept(tmp_path: Path) -> None:
    """Days and animals have snapshots of their own; who and when are kept, and carried to the estimates."""
    (tmp_path / "b.csv").write_text(BEARS)
    words = ["--from", "wildlife", "-p", "group=AnimalID,Date", "-p", "keep=Observer,Date,Time,AnimalID"]
    done = run_here("convert", "b.csv", *words, "-o", "b.parquet", "-q", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    table = nlosctl.read(tmp_path / "b.parquet")
    assert table["snapshot"].to_pylist()[::2] == ["F013/2024-06-10", "F013/2024-06-11", "M7/2024-06-10"]
    assert table["Observer"].to_pylist() == ["Ann", "Bob"] * 3
    assert table["Time"].to_pylist() == ["08:00", None, "08:00", "08:05", "09:00", "09:05"]
    words = ["localize", "b.parquet", "--bearing-std-deg", "3", "--carry", "AnimalID", "--carry", "Date", "-q"]
    done = run_here(*words, "-o", "e.parquet", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    fixes = nlosctl.read(tmp_path / "e.parquet")
    assert fixes["AnimalID"].to_pylist() == ["F013", "F013", "M7"]
    assert fixes["y_m"].to_pylist()[0] == pytest.approx(50.0)


@pytest.mark.parametrize(
    ("importer", "log", "words"),
    [
        ("uwb", "time,anchor,range,nlos\n0,A1,5,yes\n0.01,A2,6,no\n", ["-p", "range_std_m=0.1"]),
        ("anchor-azimuths", "time_s,sensor,azimuth_deg,nlos\n0,A1,5,yes\n0.01,A2,6,no\n", []),
    ],
)
def test_other_importers_keep_columns(tmp_path: Path, importer: str, log: str, words: list[str]) -> None:
    """Columns are kept as text, row by row; unknown ones, and those of measurements, are errors."""
    (tmp_path / "log.csv").write_text(log)
    anchors = "".join(f'[[sensor]]\nname = "A{n}"\nposition = [{n}, 0]\nheading_deg = 0\n' for n in (1, 2))
    (tmp_path / "scene.toml").write_text(anchors)
    words = ["convert", "log.csv", "--from", importer, *words, "-q", "-o"]
    done = run_here(*words, "t.parquet", "-p", "keep=nlos", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert nlosctl.read(tmp_path / "t.parquet")["nlos"].to_pylist() == ["yes", "no"]
    missing = run_here(*words, "u.parquet", "-p", "keep=los", folder=tmp_path)
    assert (missing.returncode, b"no column 'los'" in missing.stderr) == (1, True)
    first = log.partition(",")[0]
    if first == "time_s":
        taken = run_here(*words, "u.parquet", "-p", "keep=time_s", folder=tmp_path)
        assert (taken.returncode, b"is the name of a column of measurements" in taken.stderr) == (2, True)
