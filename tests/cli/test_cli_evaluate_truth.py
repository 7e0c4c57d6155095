"""``evaluate --truth`` and ``--estimates``: several files, sources, latitudes; the right truth for every estimate."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from cli_support import Outcome, table_csv

Cli = Callable[..., Outcome]

ESTIMATES = {
    "method": ["ml"] * 4,
    "target": [0] * 4,
    "alternative": [0] * 4,
    **{name: [1.0] * 4 for name in ("cov_xx_m2", "cov_yy_m2")},
    "cov_xy_m2": [0.0] * 4,
    **{name: [3] * 4 for name in ("n_measurements", "n_used", "cost")},
    "status": ["ok"] * 4,
}


def write(folder: Path, name: str, **columns: list[object]) -> None:
    """Write a table as CSV."""
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_text(table_csv(columns))


def two_sources(folder: Path) -> None:
    """Estimates e.csv of the inputs a.csv and b.csv, ids 0 and 1 in both, at x = 0, 10 and 100, 110."""
    columns = {"snapshot": [0, 1, 0, 1], "x_m": [0.0, 10.0, 100.0, 110.0], "y_m": [0.0] * 4, **ESTIMATES}
    write(folder, "e.csv", **columns, source=["a.csv", "a.csv", "b.csv", "b.csv"])


@pytest.mark.parametrize("truth", ["t_*.csv", "parts"])
def test_all_files_of_the_truth_count(cli: Cli, tmp_path: Path, truth: str) -> None:
    """A pattern and a folder of truths are read to their end: the errors of both files are known by hand."""
    columns = {"snapshot": [0, 1, 2, 3], "x_m": [0.0, 10.0, 20.0, 30.0], "y_m": [0.0] * 4, **ESTIMATES}
    write(tmp_path, "e.csv", **columns)
    for name, ids, x in (("1.csv", [0, 1], [3.0, 13.0]), ("2.csv", [3, 2], [34.0, 24.0])):
        for place in (f"t_{name}", f"parts/{name}"):
            write(tmp_path, place, snapshot=ids, truth_x_m=x, truth_y_m=[0.0, 0.0])
    overall = cli("evaluate", "e.csv", "--truth", truth, "--json").json["overall"]
    assert (overall["rows"], overall["without_truth"]) == (4, 0)
    assert overall["rmse_m"] == pytest.approx(((9 + 9 + 16 + 16) / 4) ** 0.5)


def test_the_source_is_part_of_the_key(cli: Cli, tmp_path: Path) -> None:
    """Ids that several inputs share are distinguished by the column ``source`` of truth and estimates."""
    two_sources(tmp_path)
    truth = {"snapshot": [1, 0, 1, 0], "truth_x_m": [111.0, 101.0, 11.0, 1.0], "truth_y_m": [0.0] * 4}
    write(tmp_path, "t.csv", **truth, source=["b.csv", "b.csv", "a.csv", "a.csv"])
    groups = cli("evaluate", "e.csv", "--truth", "t.csv", "--json").json["groups"]
    assert [group["rmse_m"] for group in groups] == pytest.approx([1.0, 1.0])


def test_a_truth_without_source_cannot_serve_two_sources(cli: Cli, tmp_path: Path) -> None:
    """Without a source the truth of one input is not used for another; unique ids are joined."""
    two_sources(tmp_path)
    write(tmp_path, "t.csv", snapshot=[0, 1], truth_x_m=[1.0, 11.0], truth_y_m=[0.0, 0.0])
    outcome = cli("evaluate", "e.csv", "--truth", "t.csv")
    assert (outcome.code, outcome.out) == (1, b"")
    assert "snapshot '0' is in several inputs (a.csv, b.csv), but t.csv has no column 'source'" in outcome.err
    columns = {"snapshot": [0, 1, 2, 3], "x_m": [0.0, 10.0, 100.0, 110.0], "y_m": [0.0] * 4, **ESTIMATES}
    write(tmp_path, "u.csv", **columns, source=["a.csv", "a.csv", "b.csv", "b.csv"])
    write(tmp_path, "t.csv", snapshot=[0, 1, 2, 3], truth_x_m=[1.0, 11.0, 101.0, 111.0], truth_y_m=[0.0] * 4)
    assert cli("evaluate", "u.csv", "--truth", "t.csv", "--json").json["groups"][1]["rmse_m"] == pytest.approx(1.0)


def test_contradicting_files_are_an_error(cli: Cli, tmp_path: Path) -> None:
    """Two files with different positions of one snapshot: both files, both rows, and the cure."""
    two_sources(tmp_path)
    write(tmp_path, "t_1.csv", snapshot=[5, 0], truth_x_m=[1.0, 2.0], truth_y_m=[0.0, 0.0])
    write(tmp_path, "t_2.csv", snapshot=[0], truth_x_m=[3.0], truth_y_m=[0.0])
    outcome = cli("evaluate", "e.csv", "--truth", "t_*.csv")
    assert outcome.code == 1
    assert "t_2.csv, row 1: got truth_x_m, truth_y_m 3, 0 for snapshot '0', which has 2, 0 in t_1.csv, row 2" in (
        outcome.err
    )
    assert "add a column 'source'" in outcome.err


def test_true_latitudes(cli: Cli, tmp_path: Path) -> None:
    """Latitudes and longitudes are compared in the plane of each estimate; without one the cure is named."""
    rows = ["1,hill,47.370,8.540,110.187,1", "1,tower,47.400,8.600,198.754,1", "1,van,47.330,8.620,317.755,1"]
    header = "snapshot,sensor,sensor_lat_deg,sensor_lon_deg,azimuth_deg,bearing_std_deg"
    (tmp_path / "m.csv").write_text("\n".join([header, *rows]) + "\n")
    write(tmp_path, "t.csv", snapshot=[1], truth_lat_deg=[47.36], truth_lon_deg=[8.58])
    for words in ((), ("--crs", "EPSG:32632")):
        assert cli("localize", "m.csv", "-q", *words, "--overwrite", "-o", "e.csv").code == 0
        overall = cli("evaluate", "e.csv", "--truth", "t.csv", "--json").json["overall"]
        assert overall["rows"] == 1
        assert overall["rmse_m"] < 15.0  # the azimuths are those of this source to 0.001 degrees and a flat plane
    write(tmp_path, "plane.csv", **{"snapshot": [1] * 4, "x_m": [0.0] * 4, "y_m": [0.0] * 4, **ESTIMATES})
    outcome = cli("evaluate", "plane.csv", "--truth", "t.csv")
    assert outcome.code == 1
    assert "no plane on earth (column 'frame')" in outcome.err
    assert "--crs" in outcome.err
    write(tmp_path, "half.csv", snapshot=[1], truth_lat_deg=[47.36])
    outcome = cli("evaluate", "e.csv", "--truth", "half.csv")
    assert "truth_x_m and truth_y_m, or truth_lat_deg and truth_lon_deg" in outcome.err


def test_estimates_of_several_files(cli: Cli, tmp_path: Path) -> None:
    """The estimates of targets may be in several files; the figures are those of one file, and ids are unique."""
    drawn = cli("simulate", "echo-field", "-n", 6, "-q")
    assert cli("identify-los", "-", "-q", "-o", "f.csv", "--estimates-out", "e.csv", stdin=drawn.out).code == 0
    header, *rows = (tmp_path / "e.csv").read_text().splitlines()
    for name, wanted in (("e_1.csv", "012"), ("e_2.csv", "345")):
        lines = [row for row in rows if row.split(",")[0] in wanted]
        (tmp_path / name).write_text("\n".join([header, *lines]) + "\n")
    one = cli("evaluate", "f.csv", "--estimates", "e.csv", "--json")
    assert one.code == 0
    assert cli("evaluate", "f.csv", "--estimates", "e_*.csv", "--json").json == one.json
    (tmp_path / "e_3.csv").write_text((tmp_path / "e_1.csv").read_text())
    outcome = cli("evaluate", "f.csv", "--estimates", "e_*.csv")
    assert outcome.code == 1
    assert "e_3.csv: snapshot '0' has estimates in e_1.csv too" in outcome.err


def test_estimates_without_source_cannot_serve_two_sources(cli: Cli, tmp_path: Path) -> None:
    """Flags of two inputs with equal ids need estimates with the column ``source``."""
    for seed, name in ((1, "a.csv"), (2, "b.csv")):
        assert cli("simulate", "echo-field", "-n", 2, "--seed", seed, "-q", "-o", name).code == 0
    assert cli("identify-los", "a.csv", "b.csv", "-q", "-o", "f.csv", "--estimates-out", "e.csv").code == 0
    assert cli("evaluate", "f.csv", "--estimates", "e.csv", "--json").code == 0
    assert cli("identify-los", "a.csv", "-q", "-o", "g.csv", "--estimates-out", "one.csv").code == 0
    outcome = cli("evaluate", "f.csv", "--estimates", "one.csv")
    assert outcome.code == 1
    assert "the estimates have no column 'source'" in outcome.err
