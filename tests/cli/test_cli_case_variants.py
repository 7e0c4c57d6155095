"""Faults that users reported, in another form than the one that was reported."""

from __future__ import annotations

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
