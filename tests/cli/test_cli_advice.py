"""The advice of a summary where snapshots do not fit: followed word for word, it gives the known source."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli_support import Outcome, table_csv

Cli = Callable[..., Outcome]

SENSORS = np.array([(0.0, 0.0), (900.0, 100.0), (300.0, 1100.0), (800.0, 700.0)])
SOURCES = np.array([(400.0, 300.0), (150.0, 650.0), (620.0, 810.0)])
FAR = np.array([(0.0, 0.0), (2000.0, 150.0), (300.0, 1900.0), (2100.0, 2000.0)])


def rows_of(sources: np.ndarray, sensors: np.ndarray) -> dict[str, list[object]]:
    """The columns of one row per source and sensor."""
    count, number = len(sources), len(sensors)
    return {
        "snapshot": np.repeat(np.arange(count), number).tolist(),
        "sensor": [f"s{k}" for k in range(number)] * count,
        "sensor_x_m": np.tile(sensors[:, 0], count).tolist(),
        "sensor_y_m": np.tile(sensors[:, 1], count).tolist(),
    }


def directions_deg(sources: np.ndarray, sensors: np.ndarray) -> np.ndarray:
    """Directions from sensors to sources, counter-clockwise from +x."""
    apart = (sources[:, None] - sensors).reshape(-1, 2)
    return np.asarray(np.degrees(np.arctan2(apart[:, 1], apart[:, 0])))


def advised(outcome: Outcome) -> list[str]:
    """The ``--column`` options of the summary's advice."""
    found = re.findall(r"--column [a-z_]+=\S+", outcome.err)
    return [word for option in found for word in shlex.split(option)]


def fixes(folder: Path) -> np.ndarray:
    """The positions in e.csv, NaN without one."""
    header, *lines = (folder / "e.csv").read_text().splitlines()
    index = [header.split(",").index(name) for name in ("x_m", "y_m")]
    return np.array([[float(line.split(",")[k] or "nan") for k in index] for line in lines])


READ_AS = {
    "bearing_deg": lambda angle: angle,
    "bearing_cw_deg": lambda angle: -angle,
    "azimuth_deg": lambda angle: 90.0 - angle,
    "azimuth_ccw_deg": lambda angle: angle - 90.0,
    "back_bearing_deg": lambda angle: angle + 180.0,
    "back_bearing_cw_deg": lambda angle: -angle - 180.0,
    "back_azimuth_deg": lambda angle: 270.0 - angle,
    "back_azimuth_ccw_deg": lambda angle: angle - 270.0,
}
"""What an instrument of each kind records for a direction counter-clockwise from +x, written down by hand."""


@pytest.mark.parametrize("true", READ_AS)
def test_every_direction_has_a_column(cli: Cli, tmp_path: Path, true: str) -> None:
    """The eight combinations of zero, sense and end of the line are read as what they are."""
    angles = READ_AS[true](directions_deg(SOURCES, SENSORS)) % 360.0
    (tmp_path / "m.csv").write_text(table_csv({**rows_of(SOURCES, SENSORS), "AZ": angles.tolist()}))
    assert cli("localize", "m.csv", "-q", "--column", f"{true}=AZ", "--bearing-std-deg", 1, "-o", "e.csv").code == 0
    np.testing.assert_allclose(fixes(tmp_path), SOURCES, atol=1e-5)


@pytest.mark.parametrize("given", ["bearing_deg", "azimuth_deg", "back_azimuth_ccw_deg"])
@pytest.mark.parametrize("true", READ_AS)
def test_the_advice_gives_the_source(cli: Cli, tmp_path: Path, given: str, true: str) -> None:
    """Angles read with the wrong zero, sense or end: the summary names the option, which gives the source."""
    angles = READ_AS[true](directions_deg(SOURCES, SENSORS)) % 360.0
    (tmp_path / "m.csv").write_text(table_csv({**rows_of(SOURCES, SENSORS), "AZ": angles.tolist()}))
    common = ("localize", "m.csv", "--bearing-std-deg", 1, "--overwrite", "-o", "e.csv")
    outcome = cli(*common, "--column", f"{given}=AZ")
    if true == given:
        assert "as given" not in outcome.err
        return
    assert "3 of 3 snapshots fit (0 as given)" in outcome.err
    assert advised(outcome) == ["--column", f"{true}=AZ"]
    assert cli(*common, *advised(outcome)).code == 0
    np.testing.assert_allclose(fixes(tmp_path), SOURCES, atol=1e-5)


@pytest.mark.parametrize(("unit", "metres"), [("km", 1000.0), ("cm", 0.01), ("mm", 0.001)])
def test_ranges_in_another_unit(cli: Cli, tmp_path: Path, unit: str, metres: float) -> None:
    """Ranges and their standard deviations in another unit: the advice names both columns."""
    ranges = np.hypot(*np.moveaxis(SOURCES[:, None] - SENSORS, -1, 0)).ravel()
    columns = rows_of(SOURCES, SENSORS) | {"d": (ranges / metres).tolist(), "range_std_m": [0.5 / metres] * len(ranges)}
    (tmp_path / "m.csv").write_text(table_csv(columns))
    outcome = cli("localize", "m.csv", "--column", "range_m=d", "-o", "e.csv")
    assert advised(outcome) == ["--column", f"range_{unit}=d", "--column", f"range_std_{unit}=range_std_m"]
    assert cli("localize", "m.csv", *advised(outcome), "-q", "--overwrite", "-o", "e.csv").code == 0
    np.testing.assert_allclose(fixes(tmp_path), SOURCES, atol=1e-4)


def test_ranges_in_another_unit_than_their_standard_deviations(cli: Cli, tmp_path: Path) -> None:
    """Ranges in kilometres beside standard deviations in metres: the advice names the column of ranges alone."""
    ranges = np.hypot(*np.moveaxis(SOURCES[:, None] - SENSORS, -1, 0)).ravel() + 0.3 * (-1) ** np.arange(
        SOURCES.shape[0] * len(SENSORS)
    )
    columns = rows_of(SOURCES, SENSORS) | {"range_m": (ranges / 1000.0).tolist(), "range_std_m": [0.5] * len(ranges)}
    (tmp_path / "m.csv").write_text(table_csv(columns))
    assert advised(cli("localize", "m.csv", "-o", "e.csv")) == ["--column", "range_km=range_m"]


@pytest.mark.parametrize("change", ["turned", "exchanged", "relative"])
def test_triplets(cli: Cli, tmp_path: Path, change: str) -> None:
    """Arrivals in the direction of travel, exchanged directions, relative delays: the cause is named."""
    tx, rx, target = np.array([0.0, 0.0]), np.array([40.0, 10.0]), np.array([(25.0, 30.0), (10.0, -18.0), (18.0, 40.0)])
    out, back = np.degrees(np.arctan2(*(target - tx).T[::-1])), np.degrees(np.arctan2(*(target - rx).T[::-1]))
    length = np.hypot(*(target - tx).T) + np.hypot(*(target - rx).T)
    dod, doa = (back, out) if change == "exchanged" else (out, back + 180.0 if change == "turned" else back)
    header = "snapshot,path,tx_x_m,tx_y_m,rx_x_m,rx_y_m,dod_deg,doa_deg,path_length_m"
    if change == "relative":
        length = length - length.min() + 1.0
    lines = [f"1,{k},0,0,40,10,{dod[k]},{doa[k]},{length[k]}" for k in range(3)]
    (tmp_path / "m.csv").write_text("\n".join([header, *lines]) + "\n")
    stds = ("--dod-std-deg", 1, "--doa-std-deg", 1, "--path-length-std-m", 0.3)
    outcome = cli("localize", "m.csv", *stds, "-o", "e.csv")
    if change == "relative":
        assert (
            "3 of 3 paths are shorter than the way from transmitter to receiver: are the delays relative" in outcome.err
        )
        return
    assert "3 of 3 paths fit (0 as given)" in outcome.err
    assert cli("localize", "m.csv", *stds, *advised(outcome), "--overwrite", "-o", "e.csv").code == 0
    np.testing.assert_allclose(fixes(tmp_path), target, atol=1e-3)


def test_longitudes_as_metres(cli: Cli, tmp_path: Path) -> None:
    """Metres that look like longitudes and latitudes: the remark names the options that read them so."""
    header = "snapshot,sensor,Lon,Lat,azimuth_deg,bearing_std_deg"
    rows = ["1,hill,8.540,47.370,110.187,1", "1,tower,8.600,47.400,198.754,1", "1,van,8.620,47.330,317.755,1"]
    (tmp_path / "m.csv").write_text("\n".join([header, *rows]) + "\n")
    outcome = cli("localize", "m.csv", "--column", "sensor_x_m=Lon", "--column", "sensor_y_m=Lat", "-o", "e.csv")
    assert "look like longitudes and latitudes" in outcome.err
    assert cli("localize", "m.csv", *advised(outcome), "--overwrite", "-o", "e.csv").code == 0
    text = (tmp_path / "e.csv").read_text().splitlines()
    fix = dict(zip(text[0].split(","), text[1].split(","), strict=True))
    assert (float(fix["lat_deg"]), float(fix["lon_deg"])) == pytest.approx((47.36, 8.58), abs=2e-4)


@pytest.mark.parametrize(
    ("rows", "words", "advice"),
    [
        (["a,s,0,0,10,1", "b,t,9,0,20,1"], (), "every snapshot has one row, because no two rows have the same"),
        (["a,s,0,0,10,1"], (), "the largest snapshot has 1 row that take part, and a fix needs"),
        (["a,s,0,0,10,1", "a,t,0,9,10,1"], (), "the lines are nearly parallel"),
        (["a,s,0,0,0,1", "a,t,9,9,180,1", "a,u,5,90,90,1", "a,v,50,9,20,1"], ("-m", "ls"), "try --method mixture-ml"),
        (["a,s,0,0,200,1", "a,t,100,0,340,1", "a,u,40,80,90,1"], (), "are the rows of a snapshot of one source"),
        (["a,s,0,0,38.66,1", "a,t,100,0,141.34,1", "a,u,40,80,74,1"], ("-m", "mixture-ml"), "in 3 rows may agree"),
        (["a,s,0,0,45,1", "a,t,9,0,135,1"], ("-m", "mixture-ml", "--field", "90,99,90,99"), "enlarge it by --field"),
    ],
)  # fmt: skip
def test_advice_by_status(cli: Cli, tmp_path: Path, rows: list[str], words: tuple[str, ...], advice: str) -> None:
    """Without any fix the advice follows from the status; it never ends in an empty list."""
    header = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg"
    (tmp_path / "m.csv").write_text("\n".join([header, *rows]) + "\n")
    outcome = cli("localize", "m.csv", *words, "-o", "e.csv")
    assert advice in outcome.err
    assert "there are also" not in outcome.err
    assert len(rows) > 3 or "try --method mixture-ml" not in outcome.err


@pytest.mark.parametrize(
    ("rows", "words", "advice"),
    [
        (["s,0,0,50", "t,0,0,51", "u,0,0,49"], (), "too few of them are of sensors at different positions"),
        (
            ["s,0,0,10", "t,100,0,10", "u,40,80,10"],
            ("-m", "mixture-ml"),
            "no two circles meet within the search region",
        ),
        (["s,0,0,64", "t,100,0,64", "u,40,80,141"], ("-m", "mixture-ml"), "in 3 rows may agree by chance"),
        (["s,0,0,64", "t,100,0,64", "u,40,80,141"], (), "ml fits badly"),
    ],
)
def test_advice_on_three_ranges(cli: Cli, tmp_path: Path, rows: list[str], words: tuple[str, ...], advice: str) -> None:
    """Three ranges are not sent to mixture-ml, which can't find an outlier among them."""
    (tmp_path / "m.csv").write_text("\n".join(["sensor,sensor_x_m,sensor_y_m,range_m", *rows]) + "\n")
    outcome = cli("localize", "m.csv", "--range-std-m", 1, *words, "-o", "e.csv")
    assert advice in outcome.err
    assert "try --method mixture-ml" not in outcome.err


def test_random_bearings_get_no_advice_to_turn_them(cli: Cli, tmp_path: Path) -> None:
    """Bearings without a source, and good ones with outliers, do not fit after any change of all."""
    generator = np.random.default_rng(5)
    sources = generator.uniform(100.0, 800.0, (40, 2))
    for outliers in (4, 1):
        angles = directions_deg(sources, SENSORS).reshape(40, 4)
        angles[:, :outliers] = generator.uniform(-180.0, 180.0, (40, outliers))
        columns = rows_of(sources, SENSORS) | {"bearing_deg": angles.ravel().tolist()}
        (tmp_path / "m.csv").write_text(table_csv(columns))
        outcome = cli("localize", "m.csv", "--bearing-std-deg", 1, "--overwrite", "-o", "e.csv")
        assert "as given" not in outcome.err
