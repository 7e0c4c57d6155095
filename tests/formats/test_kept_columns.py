"""Importers keep columns of the log, and group by several."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet
import pytest
from program import run_here

import nlosctl
from nlosctl.errors import DataError, UsageError
from nlosctl.pipeline.convert.importer import Import

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


FORMATS = Path(__file__).parents[2] / "fixtures" / "formats"


@pytest.mark.parametrize(
    ("importer", "log", "array"),
    [
        ("sionna", "sionna_paths.npz", "tau"),
        ("deepmimo", "deepmimo_paths.npz", "delay"),
        ("deepmimo", "deepmimo_scenario", "delay"),
    ],
)
def test_traced_paths_keep_arrays_with_a_value_for_each_path(importer: str, log: str, array: str) -> None:
    """The kept array, as text, is that of the row's own path: the delays are those of the lengths."""
    table = Import(importer, {"keep": array, "kind": "bearings"}).read(str(FORMATS / log)).table
    delays = [float(text) for text in table[array].to_pylist()]
    assert delays == pytest.approx([length / 299_792_458.0 for length in table["range_m"].to_pylist()], rel=1e-6)
    with pytest.raises(DataError, match="no array 'tau_s'"):
        Import(importer, {"keep": "tau_s"}).read(str(FORMATS / log))


def test_a_kept_array_has_a_value_for_each_path() -> None:
    """Arrays of receivers or of interactions are refused with their shape."""
    with pytest.raises(DataError, match=r"array 'targets': got shape \(3, 3\), expected a value for each path"):
        Import("sionna", {"keep": "targets"}).read(str(FORMATS / "sionna_paths.npz"))
    with pytest.raises(UsageError, match="'rx_pos' is not one"):
        Import("deepmimo", {"keep": "rx_pos"}).read(str(FORMATS / "deepmimo_paths.npz"))


def test_rows_of_traced_paths_keep_columns(tmp_path: Path) -> None:
    """A table of paths keeps columns of any type, row by row, where the order of the paths is another; null stays."""
    paths = {"rx": [0, 0, 1], "tx": [0, 0, 0], "tau": [2e-7, 1e-7, 3e-7], "material": ["wall", None, "glass"]}
    angles = {name: [0.0] * 3 for name in ("phi_r", "phi_t", "rx_x", "rx_y", "tx_x", "tx_y")}
    pyarrow.parquet.write_table(pa.table({**paths, **angles}), tmp_path / "p.parquet")
    table = Import("sionna", {"keep": "material"}).read(str(tmp_path / "p.parquet")).table
    assert table["material"].to_pylist() == [None, "wall", "glass"]
    with pytest.raises(DataError, match="no column 'matter'"):
        Import("sionna", {"keep": "matter"}).read(str(tmp_path / "p.parquet"))
