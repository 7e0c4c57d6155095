"""Rows by circles on the command line."""

from __future__ import annotations

import csv
import io
import itertools
import subprocess
from pathlib import Path

import numpy as np
import pytest
from program import run_here

from nlosctl.geometry.circular_reflection import all_reflections

pytestmark = pytest.mark.extensive

FIXTURES = Path(__file__).parents[2] / "fixtures"
MEASUREMENTS = str(FIXTURES / "good_over_the_horizon.csv")
RING = '[[reflector]]\nname = "ring"\nkind = "circle"\ncenter = [20.0, -10.0]\nradius = 100.0\n'


def run(*words: str, standard_input: bytes | None = None) -> subprocess.CompletedProcess[bytes]:
    """Run ``nlosctl`` with arguments."""
    return run_here(*words, stdin=standard_input or b"")


def rows(done: subprocess.CompletedProcess[bytes]) -> list[dict[str, str]]:
    """Return the CSV rows of stdout."""
    assert done.returncode == 0, done.stderr.decode()
    return list(csv.DictReader(io.StringIO(done.stdout.decode())))


def ring_file(folder: Path) -> Path:
    """Write 60 snapshots of four sensors in an open circle, each row along any of its paths, 0.2 rad of noise."""
    generator = np.random.default_rng(2)
    sensor = generator.uniform(-60.0, 60.0, (240, 2))
    source = np.repeat(generator.uniform(-60.0, 60.0, (60, 2)), 4, axis=0)
    ends = [part.copy() for end in (sensor, source) for part in end.T]
    paths = all_reflections(*ends, np.full(240, 100.0)).bearing_rad
    chosen = np.argmax(np.where(np.isnan(paths), -1.0, generator.random(paths.shape)), axis=0)
    bearing = paths[chosen, np.arange(240)] + 0.2 * generator.normal(size=240)
    lines = ["snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad,reflector"]
    lines += [
        f"{n // 4},s{n % 4},{sensor[n, 0] + 20.0},{sensor[n, 1] - 10.0},{bearing[n]},0.2,ring" for n in range(240)
    ]
    (folder / "ring.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "ring.scene.toml").write_text(RING, encoding="utf-8")
    return folder / "ring.csv"


@pytest.mark.parametrize("method", ["ls", "stansfield", "stansfield-focused", "ml"])
def test_traced_rays_give_their_source(method: str) -> None:
    """On the fixture of traced rays every method agrees with the truth within its covariance."""
    found = rows(run("localize", "-m", method, MEASUREMENTS))
    assert {row["status"] for row in found} == {"ok"}
    squared = []
    for row in found:
        dx, dy = float(row["x_m"]) - float(row["truth_x_m"]), float(row["y_m"]) - float(row["truth_y_m"])
        covariance = np.array([[row["cov_xx_m2"], row["cov_xy_m2"]], [row["cov_xy_m2"], row["cov_yy_m2"]]], float)
        squared.append(np.array([dx, dy]) @ np.linalg.solve(covariance, [dx, dy]))
    assert 1.0 < np.mean(squared) < 3.2


def test_flags_have_the_horizon(tmp_path: Path) -> None:
    """Flags have a row per measurement with its residual on the true path and ``under_horizon``."""
    flags = tmp_path / "flags.csv"
    assert run("localize", MEASUREMENTS, "-o", str(tmp_path / "e.csv"), "--flags-out", str(flags)).returncode == 0
    with flags.open(encoding="utf-8") as file:
        found = list(csv.DictReader(file))
    assert len(found) == 100
    assert {row["under_horizon"] for row in found} == {"false"}
    assert 0.0005 < np.std([float(row["residual_rad"]) for row in found]) < 0.003


def test_alternatives_are_ranked_and_limited(tmp_path: Path) -> None:
    """``--alternatives 3`` gives up to three rows per snapshot, best first; by default one."""
    path = ring_file(tmp_path)
    single, several = rows(run("localize", str(path))), rows(run("localize", "--alternatives", "3", str(path)))
    assert len(single) == 60 < len(several)
    assert [row for row in several if row["alternative"] == "0"] == single
    for earlier, later in itertools.pairwise(several):
        if earlier["snapshot"] == later["snapshot"]:
            assert int(later["alternative"]) == int(earlier["alternative"]) + 1
            assert float(later["cost"]) >= float(earlier["cost"])


@pytest.mark.process
def test_results_do_not_depend_on_blocks_or_jobs(tmp_path: Path) -> None:
    """Mixed and ambiguous paths give the same bytes for any ``--block-size`` and ``--jobs``."""
    mixed = run("simulate", "mixed", "--trials", "40", "-q", "--format", "arrow").stdout
    for words, data in ((("-",), mixed), ((str(ring_file(tmp_path)),), None)):
        outputs = {
            run(
                "localize", "-m", "ml", "-m", "ls", *words, "--block-size", size, "--jobs", jobs, standard_input=data
            ).stdout
            for size, jobs in (("4096", "1"), ("7", "2"))
        }
        assert len(outputs) == 1
        assert outputs != {b""}


def test_feasible_is_a_parameter() -> None:
    """With ``--param feasible=true`` no estimate is infeasible."""
    drawn = run(
        "simulate",
        "song-circle",
        "-p",
        "parameter_set=b",
        "-p",
        "bearing_std_deg=5",
        "-n",
        "200",
        "-q",
        "--format",
        "arrow",
    )
    free = rows(run("localize", "-", standard_input=drawn.stdout))
    held = rows(run("localize", "-p", "feasible=true", "-", standard_input=drawn.stdout))
    assert sum(row["status"] == "infeasible" for row in free) > 20
    assert {row["status"] for row in held} <= {"ok", "boundary", "not_converged", "no_candidate", "infeasible"}
    assert sum(row["status"] == "boundary" for row in held) > 20
    assert all(row["cov_xx_m2"] == "" for row in held if row["status"] == "boundary")


def test_bad_rows_are_set_aside(tmp_path: Path) -> None:
    """A sensor outside its circle stops the run, or goes to the bad rows."""
    bad = str(FIXTURES / "bad_sensor_outside_circle.csv")
    assert run("localize", bad).returncode == 1
    aside = tmp_path / "bad.csv"
    found = rows(run("localize", bad, "--bad-rows", str(aside)))
    assert len(found) == 3
    assert "7000000.0" in aside.read_text(encoding="utf-8")
