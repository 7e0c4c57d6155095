"""No made-up results: regression tests of cases that once had one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from cli_support import Outcome, read_parquet

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]

_BASELINE_PATH = (
    "snapshot,path,tx_x_m,tx_y_m,rx_x_m,rx_y_m,dod_rad,doa_rad,path_length_m,dod_std_rad,doa_std_rad,path_length_std_m\n"
    "0,0,0,0,10,0,0,3.141592653589793,10,0.01,0.01,0.1\n"
)


def test_the_bound_ignores_outliers_and_lost_paths(cli: Cli, tmp_path: Path) -> None:
    """Five resolved paths of a sensor have the information of the direct one; outliers have none."""
    rms = []
    for words in (["-p", "paths=1"], ["-p", "paths=5"], ["-p", "alpha=1"]):
        assert cli("simulate", "madhow-ring", "-n", 1, *words, "-o", "m.parquet", "--overwrite", "-q").code == 0
        assert cli("bound", "m.parquet", "-o", "b.parquet", "--overwrite", "-q").code == 0
        rms.append(read_parquet(tmp_path / "b.parquet").column("rms_m")[0].as_py())
    assert rms[1] == pytest.approx(rms[0], rel=1e-9)
    assert rms[2] is None


def test_a_fix_without_inliers_has_no_covariance(cli: Cli, tmp_path: Path) -> None:
    """If every row is an outlier the status reports it, without covariance."""
    assert cli("simulate", "madhow-ring", "-n", 40, "-o", "m.parquet", "-q").code == 0
    assert cli("localize", "-m", "mixture-ml", "-p", "alpha=0.999", "m.parquet", "-o", "e.parquet", "-q").code == 0
    rows = read_parquet(tmp_path / "e.parquet").to_pylist()
    unanswered = [row for row in rows if row["n_used"] == 0]
    assert unanswered
    assert {row["status"] for row in unanswered} == {"no_candidate"}
    assert all(row["x_m"] is None and row["covariance_kind"] is None for row in unanswered)


def test_a_lone_path_along_its_baseline(cli: Cli, tmp_path: Path) -> None:
    """Without a hypothesis ``joint`` gives a path its own p-value and no probability."""
    (tmp_path / "p.csv").write_text(_BASELINE_PATH)
    assert cli("detect-ip", "-m", "joint", "p.csv", "-o", "f.parquet", "-q").code == 0
    row = read_parquet(tmp_path / "f.parquet").to_pylist()[0]
    assert (row["ip"], row["p_value"], row["direct_probability"]) == (False, 1.0, None)


def test_a_grid_too_fine_is_refused(cli: Cli) -> None:
    """A too small ``step_m`` is reported as such, not as a lack of memory."""
    assert cli("simulate", "song-circle", "-n", 2, "-o", "m.parquet", "-q").code == 0
    outcome = cli("localize", "-m", "ml-grid", "-p", "step_m=1", "m.parquet", "-o", "e.parquet")
    assert outcome.code == 2
    assert "step_m" in outcome.err


def test_only_bad_rows(cli: Cli, tmp_path: Path) -> None:
    """If every row is bad the command exits 1, and the bad rows are written."""
    header = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad\n"
    (tmp_path / "m.csv").write_text(header + "0,a,0,0,nan,0.1\n0,b,1,0,nan,0.1\n")
    outcome = cli("localize", "m.csv", "-o", "e.csv", "--bad-rows", "bad.csv")
    assert outcome.code == 1
    assert "nothing to do" in outcome.err
    assert len((tmp_path / "bad.csv").read_text().splitlines()) == 3
