"""The content of the page: rays, arcs, ellipses and statistics against closed forms; sizes, thinning, faults."""

from __future__ import annotations

import base64
import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from program import run_here

import nlosctl
from nlosctl.contract.scene import LineReflector, SegmentReflector
from nlosctl.models.traced_rays import points_at_range
from nlosctl.pipeline.report.numbers import decimals_of, places_for, rounded, significant
from nlosctl.pipeline.report.page import json_for_html
from nlosctl.pipeline.report.range_arcs import range_arcs


def content(page: nlosctl.Report) -> Any:
    """The data in a page."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page.html, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


@pytest.fixture(scope="module")
def table() -> Any:
    """Bearings of 60 snapshots with outliers."""
    return nlosctl.simulate("ring", trials=60, seed=5, outlier_fraction=0.2)


@pytest.fixture(scope="module")
def solved(table: Any) -> Any:
    """Fixes and flags of the bearings."""
    return nlosctl.localize(table, method="mixture-ml")


def test_rays_lead_along_their_bearings(table: Any) -> None:
    """The end of every ray is in the direction of its bearing from its sensor, outside the box of the map."""
    page = content(nlosctl.report(table))
    rows, plane = page["measured"][0], page["map"]
    sensor = np.array([[plane["sensors"][axis][k] for k in rows["sensor"]] for axis in "xy"])
    end = np.array([rows["end_x"], rows["end_y"]])
    direction = np.arctan2(*(end - sensor)[::-1])
    wrong = np.angle(np.exp(1j * (direction - table["bearing_rad"].to_numpy())))
    assert np.abs(wrong).max() < 2e-3
    assert rows["size"] == [8] * 60
    np.testing.assert_allclose(np.radians(rows["value"]), table["bearing_rad"].to_numpy(), atol=1e-4)
    names = [plane["sensors"]["names"][plane["sensors"]["name"][k]] for k in rows["sensor"]]
    assert names == table["sensor"].to_pylist()


def test_estimates_are_those_of_the_table(solved: Any) -> None:
    """Positions, errors and ellipses are those of the table, to the decimals of the page; outliers are flagged rows."""
    page = content(nlosctl.report(solved.flags, solved.estimates))
    rows, origin = page["estimates"][0], page["map"]["origin"]
    x = np.array([np.nan if value is None else value for value in rows["x"]]) + origin[0]
    expected = solved.estimates["x_m"].to_numpy(zero_copy_only=False)
    np.testing.assert_allclose(x, expected, atol=0.51 * 10.0 ** -rows["decimals"])
    xx, xy, yy = (solved.estimates[f"cov_{pair}_m2"].to_numpy(zero_copy_only=False) for pair in ("xx", "xy", "yy"))
    known = np.flatnonzero(np.isfinite(xx))
    largest = [np.linalg.eigvalsh([[xx[k], xy[k]], [xy[k], yy[k]]])[1] for k in known]
    major = np.array([rows["major"][k] for k in known], dtype=np.float64)
    np.testing.assert_allclose(major, np.sqrt(-2.0 * np.log(0.05) * np.array(largest)), rtol=0.01)
    columns = {name: solved.estimates[name].to_numpy(zero_copy_only=False) for name in solved.estimates.column_names}
    error = np.hypot(*(columns[f"{axis}_m"] - columns[f"truth_{axis}_m"] for axis in "xy"))
    shown = np.array([np.nan if value is None else value for value in rows["error"]])
    np.testing.assert_allclose(shown, error, atol=0.51 * 10.0 ** -rows["decimals"])
    look = np.array(page["measured"][0]["look"])
    np.testing.assert_array_equal(look == 2, ~np.array(solved.flags["los"].fill_null(True).to_pylist()))


def test_statistics_are_those_of_evaluate(solved: Any) -> None:
    """Counts of statuses, RMSE and coverage, and residuals by sensor are those of `evaluate`."""
    found = content(nlosctl.report(solved.flags, solved.estimates))["tables"]
    tables = {table["title"].partition(":")[0]: table for table in found}
    statuses = solved.estimates["status"].to_pylist()
    counted = {row[1]: row[2] for row in tables["Statuses"]["rows"]}
    assert counted == {word: statuses.count(word) for word in set(statuses)}
    group = nlosctl.evaluate(solved.estimates).groups[0]
    shown = dict(zip(tables["Errors"]["head"], tables["Errors"]["rows"][0], strict=True))
    assert shown["RMSE, m"] == pytest.approx(group["rmse_m"], rel=1e-3)
    assert shown["coverage of 95 % ellipses"] == pytest.approx(group["coverage_95"], rel=1e-3)
    residuals = nlosctl.evaluate(solved.flags, by=("sensor",)).groups
    own = tables["Residuals by sensor"]
    for row, group in zip(own["rows"], residuals, strict=True):
        cells = dict(zip(own["head"], row, strict=True))
        assert cells["sensor"] == group["sensor"]
        assert cells["residual: std"] == pytest.approx(group["residual_std"], rel=1e-3)
        assert cells["share of outliers"] == pytest.approx(group["outlier_share"], rel=1e-3)


@pytest.mark.parametrize(
    "mirror",
    [
        LineReflector(name="m", point=(3.0, 10.0), direction=(2.0, 1.0)),
        SegmentReflector(name="m", start=(-4.0, 8.0), end=(9.0, 12.0)),
        SegmentReflector(name="m", start=(9.0, -12.0), end=(-4.0, -8.0)),
    ],
)
def test_arcs_are_the_points_at_the_range(mirror: LineReflector | SegmentReflector) -> None:
    """Arcs agree with rays traced over the mirror: the same circle, the same extent; none where the range is short."""
    sensor, length = np.array([[1.0, -2.0], [1.0, -2.0], [5.0, 3.0]]), np.array([40.0, 0.5, 25.0])
    arcs = range_arcs(sensor, length, mirror)
    for row in range(3):
        points = points_at_range(sensor[row], float(length[row]), mirror)
        points = points[np.isfinite(points).all(axis=1)]
        first, last = arcs[row, 2:]
        if not points.size:
            assert first == last
            continue
        offset = points - arcs[row, :2]
        np.testing.assert_allclose(np.hypot(*offset.T), length[row], rtol=1e-9)
        turn = (np.arctan2(offset[:, 1], offset[:, 0]) - first) % (2.0 * np.pi)
        assert turn.max() <= last - first + 1e-9
        assert np.ptp(np.sort(turn)) > 0.9 * (last - first)


def test_regions_of_a_posterior_hold_their_cells(table: Any) -> None:
    """The levels of a map, row by row from the north, are those of its cells; its box is that of the cells."""
    cells = nlosctl.posterior(table, snapshot=3, cell=20.0, field="-500,500,-400,400")
    page = content(nlosctl.report(cells, table))
    (found,) = page["posterior"]
    assert found["shape"] == [40, 50]
    levels = np.frombuffer(base64.b64decode(found["levels"]), dtype=np.uint8).reshape(found["shape"])[::-1].ravel()
    hpd = cells["hpd"].to_numpy()
    np.testing.assert_array_equal(levels, np.select([hpd <= 0.5, hpd <= 0.9, hpd <= 0.95], [1, 2, 3], 0))
    assert np.add(found["low"], page["map"]["origin"]).tolist() == [-500.0, -400.0]
    assert np.add(found["high"], page["map"]["origin"]).tolist() == [500.0, 400.0]
    assert found["snapshot"] == (page["snapshots"].index("3") if "snapshot" in cells.column_names else -1)


def test_flags_of_several_methods_show_one(table: Any) -> None:
    """The rays are those of the first method, or of the one that a condition names."""
    solved = nlosctl.localize(table, method=("mixture-ml", "ml"))
    first = nlosctl.report(solved.flags)
    assert any("mixture-ml" in note for note in first.notes)
    assert content(first)["measured"][0]["size"] == [8] * 60
    other = nlosctl.report(solved.flags, where="method == ml")
    assert other.notes == ()
    assert content(other)["measured"][0]["size"] == [8] * 60
    assert content(other)["measured"][0]["look"] != content(first)["measured"][0]["look"]


def test_triplets_have_their_angles_and_lengths() -> None:
    """The page has nodes, angles in degrees and path lengths of triplets; 10^4 snapshots stay below 5 MB."""
    table = nlosctl.simulate("triplets", trials=10_000, seed=1)
    page = nlosctl.report(table, nlosctl.localize(table, method="ml").estimates)
    assert len(page.html) < 5_000_000
    found = content(page)
    rows, sensors, origin = found["measured"][0], found["map"]["sensors"], found["map"]["origin"]
    np.testing.assert_allclose(np.radians(rows["departing"]), table["dod_rad"].to_numpy(), atol=1e-4)
    np.testing.assert_allclose(np.radians(rows["arriving"]), table["doa_rad"].to_numpy(), atol=1e-4)
    np.testing.assert_allclose(rows["value"], table["path_length_m"].to_numpy(), rtol=1e-4)
    places = np.array(sensors["x"])[rows["reference"]] + origin[0]
    np.testing.assert_allclose(places, table["rx_x_m"].to_numpy(), atol=0.01)


def test_the_same_bytes_every_time(tmp_path: Path, table: Any, solved: Any) -> None:
    """Two runs write the same page; it has no path of a folder, and its head names nothing to load."""
    pa.parquet.write_table(solved.estimates, tmp_path / "e.parquet")
    pa.parquet.write_table(solved.flags, tmp_path / "f.parquet")
    words = ("report", "f.parquet", "e.parquet", "-q", "-o")
    assert run_here(*words, "a.html", folder=tmp_path).returncode == 0
    assert run_here(*words, "b.html", folder=tmp_path).returncode == 0
    page = (tmp_path / "a.html").read_bytes()
    assert page == (tmp_path / "b.html").read_bytes()
    assert os.fspath(tmp_path).encode() not in page
    assert b"http-equiv" in page
    assert not re.search(rb'(?:src|href)="(?!#)', page.partition(b"<script")[0])


def test_large_files_are_thinned_with_their_total(table: Any, solved: Any) -> None:
    """Beyond ``max_rows`` whole snapshots are left out, evenly, and the page names the totals."""
    page = nlosctl.report(solved.flags, solved.estimates, max_rows=40)
    found = content(page)
    assert len(found["estimates"][0]["x"]) <= 40
    assert sum(found["measured"][0]["size"]) <= 40
    assert set(found["measured"][0]["size"]) == {8}
    assert any("of 60 snapshots" in note for note in page.notes)
    assert any("of 60 estimates" in note for note in page.notes)
    assert found["notes"] == list(page.notes)
    counted = {row[1]: row[2] for row in found["tables"][0]["rows"]}
    assert sum(counted.values()) == 60


def test_a_page_of_ten_thousand_snapshots_is_small(table: Any) -> None:
    """10^4 snapshots of 8 bearings with their fixes are below 5 MB."""
    large = nlosctl.simulate("ring", trials=10_000, seed=1)
    solved = nlosctl.localize(large, method="stansfield")
    page = nlosctl.report(solved.flags, solved.estimates)
    assert len(page.html) < 5_000_000
    assert len(content(page)["snapshots"]) == 10_000
    assert len(content(page)["measured"][0]["look"]) == 80_000
    assert page.notes == ()


def test_faults_are_one_line(tmp_path: Path, table: Any, solved: Any) -> None:
    """Files without a place, of other planes, or without rows, and outputs that exist: one line, nothing written."""
    pa.parquet.write_table(solved.estimates.replace_schema_metadata({}), tmp_path / "e.parquet")
    pa.parquet.write_table(solved.estimates.slice(0, 0), tmp_path / "none.parquet")
    places = solved.estimates.append_column("frame", pa.array(["48.0 11.0"] * 60))
    pa.parquet.write_table(places, tmp_path / "p.parquet")
    (tmp_path / "taken.html").write_text("mine")
    cases = (
        ("e.parquet p.parquet -o r.html", 1, "places in different planes"),
        ("none.parquet -o r.html", 1, "no rows"),
        ("absent.parquet -o r.html", 1, "there is no such file"),
        ("e.parquet -o taken.html", 1, "exists"),
        ("e.parquet -o no/folder/r.html", 1, "no/folder"),
        ("e.parquet", 2, "name the page"),
        ("e.parquet --by method -o r.html", 2, "--window"),
    )
    for words, code, message in cases:
        done = run_here("report", *words.split(), folder=tmp_path)
        assert done.returncode == code, (words, done.stderr)
        lines = done.stderr.decode().splitlines()
        assert len(lines) == 1, lines
        assert message in lines[0], (words, lines)
    assert not (tmp_path / "r.html").exists()
    assert (tmp_path / "taken.html").read_text() == "mine"


def test_data_cannot_end_its_element() -> None:
    """No text of the data has a character that HTML could read as markup, and it is still the same data."""
    given = {"name": "</script><!--&\u2028\u2029\ud800", "number": [1.5, None]}
    text = json_for_html(given)
    assert not set("<>&\u2028\u2029") & set(text)
    assert text.isascii()
    assert json.loads(text) == given


def test_numbers_keep_what_matters() -> None:
    """Rounded numbers are whole where they can be, None where they are not finite, and as fine as their stds need."""
    assert rounded(np.array([1.0, 2.26, np.nan, np.inf, -0.04]), 1) == [1, 2.3, None, None, 0]
    assert [decimals_of(size, 4) for size in (1000.0, 1.0, 0.02, 1e9)] == [0, 3, 5, 0]
    assert places_for(np.array([0.5, np.nan]), 1e5) == 3
    assert significant(1234.56) == 1235
    assert significant(float("nan")) is None
