"""Mean residuals of sensors in the report and the summary."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet
import pytest
from program import run_here

import nlosctl

Localize = Callable[..., tuple[dict[str, Any], str]]


@pytest.fixture
def localize(tmp_path: Path) -> Localize:
    """Localize files into ``tmp_path``; return the report and the summary."""

    def run(*words: object, output: str = "fixes.parquet", report: str = "report.json") -> tuple[dict[str, Any], str]:
        given = [str(word) for word in words]
        again = [] if "--resume" in given else ["--overwrite"]
        done = run_here("localize", *given, "-o", f"{tmp_path}/{output}", *again, "--report", str(tmp_path / report))
        assert done.returncode == 0, done.stderr
        return json.loads((tmp_path / report).read_text()), done.stderr.decode()

    return run


def with_clock(offset_m: float, trials: int = 200, **parameters: Any) -> pa.Table:
    """Return arrivals at 8 sensors; the clock of s3 is late by ``offset_m``."""
    rows = nlosctl.simulate("arrivals", trials=trials, **parameters)
    late = np.where(np.array(rows["sensor"].to_pylist()) == "s3", offset_m, 0.0)
    index = rows.column_names.index("arrival_m")
    return rows.set_column(index, "arrival_m", pa.array(np.array(rows["arrival_m"]) + late))


def mean_by_sensor(rows: pa.Table, flags: pa.Table, estimates: pa.Table, column: str) -> dict[str, float]:
    """Return numpy's means of a flag column over the used rows of fixes that are ok, by sensor."""
    usual = estimates.filter(pc.equal(estimates["status"], "ok"))["snapshot"]
    chosen = pc.and_(pc.is_in(flags["snapshot"], usual), flags["used"])
    kept = flags.filter(pc.and_(chosen, pc.is_valid(flags[column])))
    names, values = np.array(kept["sensor"].to_pylist()), np.array(kept[column])
    return {str(name): float(values[names == name].mean()) for name in np.unique(names)}


CASES = [
    ("arrivals", {}, "ml", [], "residual_m"),
    ("arrivals", {}, "srd-ls", [], "residual_m"),
    ("ring", {}, "stansfield", [], "residual_rad"),
    ("ring", {}, "mixture-ml", [], "residual_rad"),
    ("space-ring", {"azimuth_only": 0.3}, "ml", [], "residual_elevation_rad"),
    ("box", {}, "ml", ["--dimensions", 3], "residual_m"),
]


@pytest.mark.parametrize(("scenario", "parameters", "method", "words", "column"), CASES)
def test_means_are_those_of_the_flags(
    localize: Localize,
    tmp_path: Path,
    scenario: str,
    parameters: dict[str, Any],
    method: str,
    words: list[Any],
    column: str,
) -> None:
    """For every kind: numpy's mean of the flags that the same run writes; number of rows and scatter too."""
    rows = nlosctl.simulate(scenario, trials=60, **parameters)
    pyarrow.parquet.write_table(rows, tmp_path / "rows.parquet")
    report, _ = localize(tmp_path / "rows.parquet", "-m", method, *words, "--flags-out", tmp_path / "flags.parquet")
    estimates, flags = (pyarrow.parquet.read_table(tmp_path / name) for name in ("fixes.parquet", "flags.parquet"))
    expected = mean_by_sensor(rows, flags, estimates, column)
    stem, _, unit = column.rpartition("_")
    found = {entry["name"]: entry for entry in report["sensors"]}
    assert list(found) == sorted(found)
    assert len(found) == len(set(rows["sensor"].to_pylist()))
    assert {name: entry[f"{stem}_mean_{unit}"] for name, entry in found.items()} == pytest.approx(expected, rel=1e-9)
    assert {entry["method"] for entry in report["sensors"]} == {method}


def test_snapshots_without_spare_rows_do_not_count(localize: Localize, tmp_path: Path) -> None:
    """Three arrivals in the plane fit exactly: their residuals are not those of a clock."""
    rows = with_clock(30.0, trials=40, sensors=4)
    few = rows.filter(pc.or_(pc.less(rows["snapshot"], 20), pc.not_equal(rows["sensor"], "s1")))
    pyarrow.parquet.write_table(few, tmp_path / "few.parquet")
    report, _ = localize(tmp_path / "few.parquet")
    estimates = pyarrow.parquet.read_table(tmp_path / "fixes.parquet").to_pylist()
    usual = sum(row["status"] == "ok" and row["snapshot"] < 20 for row in estimates)
    assert usual > 0
    assert [entry["rows"] for entry in report["sensors"]] == [usual] * 4


def test_the_summary_names_the_sensor_with_a_late_clock(localize: Localize, tmp_path: Path) -> None:
    """One clock of eight is 30 m late: its mean is the largest, positive, and named; without it no sensor is."""
    for offset, named in ((30.0, True), (-30.0, True), (0.0, False)):
        pyarrow.parquet.write_table(with_clock(offset), tmp_path / "rows.parquet")
        report, summary = localize(tmp_path / "rows.parquet")
        assert ("the residuals of sensor 's3' are" in summary) == named
        assert ("the residuals of sensor" in summary) == named
        means = {entry["name"]: entry["residual_mean_m"] for entry in report["sensors"]}
        if named:
            assert max(means, key=lambda name: abs(means[name])) == "s3"
            assert 0.4 < means["s3"] / offset < 1.0


def test_the_summary_names_it_without_a_report(tmp_path: Path) -> None:
    """Of arrival times residuals are always counted."""
    pyarrow.parquet.write_table(with_clock(30.0), tmp_path / "rows.parquet")
    done = run_here("localize", str(tmp_path / "rows.parquet"), "-o", str(tmp_path / "fixes.parquet"))
    assert "the residuals of sensor 's3' are" in done.stderr.decode()


def test_a_wrong_heading_is_named(localize: Localize, tmp_path: Path) -> None:
    """Bearings of one sensor that are turned by 8 degrees: named with its mean in degrees."""
    rows = nlosctl.simulate("ring", trials=200)
    turned = np.where(np.array(rows["sensor"].to_pylist()) == "s2", np.radians(8.0), 0.0)
    index = rows.column_names.index("bearing_rad")
    rows = rows.set_column(index, "bearing_rad", pa.array(np.array(rows["bearing_rad"]) + turned))
    pyarrow.parquet.write_table(rows, tmp_path / "rows.parquet")
    _, summary = localize(tmp_path / "rows.parquet")
    assert "the residuals of sensor 's2' are" in summary
    assert "its heading or its position may be wrong" in summary


def test_means_depend_on_no_cut(localize: Localize, tmp_path: Path) -> None:
    """The same entries, to the bit, by several processes, blocks, row groups, formats, parts and engines."""
    rows = with_clock(3.0, trials=500)
    pyarrow.parquet.write_table(rows, tmp_path / "whole.parquet")
    pyarrow.parquet.write_table(rows, tmp_path / "cut.parquet", row_group_size=997)
    pyarrow.csv.write_csv(rows, tmp_path / "rows.csv")
    (tmp_path / "parts").mkdir()
    for number, first in enumerate(range(0, rows.num_rows, 1501)):
        pyarrow.parquet.write_table(rows.slice(first, 1501), tmp_path / "parts" / f"{number}.parquet")
    expected = localize(tmp_path / "whole.parquet")[0]["sensors"]
    assert len(expected) == 8
    for words in (
        ("whole.parquet", "--block-size", 7),
        ("whole.parquet", "--jobs", 2),
        ("cut.parquet", "--jobs", 2),
        ("rows.csv", "--jobs", 2),
        ("parts", "--jobs", 2),
    ):
        assert localize(tmp_path / words[0], *words[1:])[0]["sensors"] == expected
    assert localize(tmp_path / "parts", "--jobs", 2, output="out/")[0]["sensors"] == expected
    part = next((tmp_path / "out").glob("*1.parquet"))
    part.unlink()
    again = localize(tmp_path / "parts", "--resume", output="out/", report="again.json")[0]
    assert again["sensors"] == expected


def test_parts_without_residuals_are_noted(tmp_path: Path, localize: Localize) -> None:
    """A run with a report that resumes one without: no means of some of the parts, but a note."""
    rows = nlosctl.simulate("ring", trials=40)
    (tmp_path / "parts").mkdir()
    for number in range(2):
        pyarrow.parquet.write_table(rows.slice(number * 160, 160), tmp_path / "parts" / f"{number}.parquet")
    begun = run_here("localize", str(tmp_path / "parts"), "-o", f"{tmp_path}/out/", "-q")
    assert begun.returncode == 0
    next((tmp_path / "out").glob("*1.parquet")).unlink()
    report, summary = localize(tmp_path / "parts", "--resume", output="out/")
    assert "sensors" not in report
    assert "no mean residuals of sensors: a part of the results is of an earlier run that did not count them" in summary


@pytest.mark.parametrize("pairs", [[(2, 1), (2, 3), (2, 5)], [(1, 2), (3, 2), (5, 2)], [(1, 2), (2, 3), (5, 2)]])
def test_pairs_count_for_both_their_sensors(localize: Localize, tmp_path: Path, pairs: list[tuple[int, int]]) -> None:
    """The late sensor is named whether it is the sensor of its pairs, their reference, or both."""
    draw, angle = np.random.default_rng(0), np.arange(8) * np.pi / 4.0
    sensors = 500.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rows = []
    for snapshot, source in enumerate(draw.uniform(-250.0, 250.0, (100, 2))):
        arrival = np.linalg.norm(sensors - source, axis=1) + 30.0 * (np.arange(8) == 2)
        for own, other in (*pairs, (0, 4), (6, 4), (7, 4), (0, 6), (1, 7), (3, 5)):
            row = {"snapshot": snapshot, "sensor": f"s{own}", "reference": f"s{other}", "arrival_std_m": 1.0}
            row |= {"tdoa_m": arrival[own] - arrival[other] + draw.normal()}
            for axis, letter in enumerate("xy"):
                row |= {f"sensor_{letter}_m": sensors[own, axis], f"reference_{letter}_m": sensors[other, axis]}
            rows.append(row)
    pyarrow.parquet.write_table(pa.Table.from_pylist(rows), tmp_path / "rows.parquet")
    report, summary = localize(tmp_path / "rows.parquet")
    assert "the residuals of sensor 's2' are" in summary
    means = {entry["name"]: entry["residual_mean_m"] for entry in report["sensors"]}
    assert means["s2"] == max(means.values(), key=abs) > 10.0
    assert {entry["name"]: entry["rows"] for entry in report["sensors"]}["s2"] == 300
