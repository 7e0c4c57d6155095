"""The robust methods on the command line: search regions, traces, alternatives, priors, ranges, walls."""

from __future__ import annotations

import csv
import io
import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from program import run_here

import nlosctl

pytestmark = pytest.mark.extensive


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run ``nlosctl`` in a folder."""
    done = run_here(*words, folder=folder)
    return subprocess.CompletedProcess(words, done.returncode, done.stdout.decode(), done.stderr.decode())


def rows(text: str) -> list[dict[str, str]]:
    """Return the rows of CSV text."""
    return list(csv.DictReader(io.StringIO(text)))


@pytest.fixture(scope="module")
def ring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``ring.csv``: 60 snapshots, two of eight bearings outliers, and ranges."""
    folder = tmp_path_factory.mktemp("ring")
    words = ("-p", "nlos_receivers=2", "-p", "range_std_share=0.05", "-p", "sources=disc", "-o", "ring.csv")
    done = run(folder, "simulate", "madhow-ring", "--trials", "60", "--seed", "3", *words)
    assert done.returncode == 0, done.stderr
    return folder


def test_flags_make_maximum_likelihood_robust(ring: Path) -> None:
    """With the robust method's flags ``ml`` is as good; without them far worse."""
    done = run(ring, "localize", "-m", "mixture-ml", "ring.csv", "--field", "circle:0,0,1", "--flags-out", "flags.csv")
    assert done.returncode == 0, done.stderr
    assert "estimates are at its edge" in done.stderr
    flags = rows((ring / "flags.csv").read_text())
    assert {"used", "los", "los_probability", "residual_rad", "residual_m"} <= set(flags[0])
    wrong = sum(row["los"] != row["truth_los"] for row in flags)
    assert wrong < 0.06 * len(flags)
    medians = []
    for source in ("ring.csv", "flags.csv"):
        fixes = run(ring, "localize", "-m", "ml", source)
        errors = [
            np.hypot(float(row["x_m"]) - float(row["truth_x_m"]), float(row["y_m"]) - float(row["truth_y_m"]))
            for row in rows(fixes.stdout)
            if row["x_m"]
        ]
        medians.append(np.median(errors))
    assert medians[1] < 0.3 * medians[0]


@pytest.mark.process
def test_results_do_not_depend_on_blocks_or_jobs(ring: Path) -> None:
    """The same bytes for any block size and jobs, with random pairs too; another seed gives others."""
    words = ("localize", "-m", "suppress", "-m", "mixture-ml", "-m", "sequential", "ring.csv", "-q")
    one = run(ring, *words, "--block-size", "7", "--jobs", "1")
    other = run(ring, *words, "--jobs", "2")
    assert one.returncode == 0, one.stderr
    assert one.stdout == other.stdout
    assert run(ring, *words, "--seed", "5").stdout != one.stdout


def test_trace_writes_the_state_after_each_sensor(ring: Path) -> None:
    """A row for each state, ending at the estimate; methods without steps refuse it."""
    done = run(ring, "localize", "-m", "sequential", "ring.csv", "--trace-out", "trace.csv", "-q")
    assert done.returncode == 0, done.stderr
    estimates = {row["snapshot"]: row for row in rows(done.stdout)}
    trace = rows((ring / "trace.csv").read_text())
    assert [row["step"] for row in trace if row["snapshot"] == "0"] == [str(step) for step in range(1, 9)]
    for row in trace:
        if row["step"] == "8":
            assert (row["x_m"], row["cov_yy_m2"]) == tuple(
                estimates[row["snapshot"]][name] for name in ("x_m", "cov_yy_m2")
            )
    refused = run(ring, "localize", "-m", "ml", "ring.csv", "--trace-out", "none.csv")
    assert refused.returncode == 2
    assert "sequential" in refused.stderr
    assert not (ring / "none.csv").exists()


def test_the_kind_of_covariance(ring: Path) -> None:
    """The column is inliers or posterior; it is empty for ml, which has only one kind."""
    words = ("-m", "mixture-ml", "-m", "ml", "-p", "covariance=posterior")
    found = rows(run(ring, "localize", *words, "ring.csv", "-q").stdout)
    kinds = {(row["method"], row["covariance_kind"]) for row in found}
    assert kinds == {("mixture-ml", "posterior"), ("ml", "")}


def test_a_field_without_crossings_gives_no_candidate(ring: Path) -> None:
    """Every status is no_candidate, and --strict exits 3; an invalid region is a usage error."""
    words = ("--field", "10,11,10,11", "--strict", "-p", "use_ranges=false")
    done = run(ring, "localize", "-m", "mixture-ml", "ring.csv", *words, "-p", "search_outside=false")
    assert done.returncode == 3
    found = [row["status"] for row in rows(done.stdout)]
    assert set(found) == {"no_candidate"}
    assert (
        f"note: no snapshot has a fix ({len(found)} of {len(found)} are no_candidate): no two rows agree within the "
        "search region; enlarge it by --field\n" in done.stderr
    )
    done = run(ring, "localize", "-m", "mixture-ml", "ring.csv", *words)
    found = [row["status"] for row in rows(done.stdout)]
    assert done.returncode == 3
    assert set(found) <= {"no_candidate", "outside_field"}
    count = found.count("outside_field")
    assert count > 0.5 * len(found)
    assert (
        f"note: mixture-ml: in {count} of {len(found)} snapshots a point outside the search region is more likely than "
        "any inside; enlarge it by --field\n" in done.stderr
    )
    refused = run(ring, "localize", "-m", "mixture-ml", "ring.csv", "--field", "disc")
    assert refused.returncode == 2
    assert "circle:x,y,r" in refused.stderr


def test_prior_columns_replace_the_pair(tmp_path: Path) -> None:
    """One bearing with a prior in the file has an estimate; without it is too_few."""
    head = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg,prior_x_m,prior_y_m,prior_std_m\n"
    (tmp_path / "one.csv").write_text(f"{head}1,a,0,0,90,1,1,50,5\n2,a,0,0,90,1,,,\n")
    done = run(tmp_path, "localize", "-m", "sequential", "one.csv", "-q")
    assert [row["status"] for row in rows(done.stdout)] == ["ok", "too_few"]


def test_virtual_source_behind_the_wall(tmp_path: Path) -> None:
    """Figure 11: the virtual source is an alternative until points behind the wall are excluded."""
    words = ("-p", "figure=11", "-p", "band=wide", "--trials", "20", "-o", "w.csv", "--scene-out", "w.scene.toml")
    assert run(tmp_path, "simulate", "madhow-walls", *words).returncode == 0
    assert 'kind = "segment"' in (tmp_path / "w.scene.toml").read_text()
    field = ("--field=-500,1000,-500,1000", "--alternatives", "2", "-q")
    both = rows(run(tmp_path, "localize", "-m", "mixture-ml", "w.csv", *field).stdout)
    assert len(both) == 40
    positions = np.array([[float(row["x_m"]), float(row["y_m"])] for row in both]).reshape(20, 2, 2)
    assert np.array_equal(np.sort(np.sign(positions[..., 1]), axis=1), np.tile([-1.0, 1.0], (20, 1)))
    kept = rows(
        run(tmp_path, "localize", "-m", "mixture-ml", "-p", "exclude_behind_walls=true", "w.csv", *field).stdout
    )
    assert all(float(row["y_m"]) > 0.0 for row in kept)


def test_joint_and_laplacian_bounds(ring: Path) -> None:
    """Ranges lower the bound; Laplacian errors of equal std have half the variance bound."""
    plain, joint, laplace = (
        np.array([float(row["bound_xx_m2"]) for row in rows(run(ring, "bound", "ring.csv", "-q", *words).stdout)])
        for words in (("--no-ranges",), (), ("--no-ranges", "--noise", "laplace"))
    )
    assert np.all(joint < plain)
    np.testing.assert_allclose(laplace, 0.5 * plain, rtol=1e-12)
    assert run(ring, "bound", "ring.csv", "--noise", "cauchy").returncode == 2


def test_the_function_equals_the_command(ring: Path) -> None:
    """``nlosctl.localize`` takes the search region and gives the estimates of the command."""
    table = nlosctl.simulate("madhow-ring", trials=20, seed=3, nlos_receivers=2, sources="disc")
    result = nlosctl.localize(table, method="mixture-ml", field="circle:0,0,1", alternatives=3)
    assert set(result.estimates.column("covariance_kind").to_pylist()) <= {"inliers", None}
    done = run(
        ring,
        "simulate",
        "madhow-ring",
        "--trials",
        "20",
        "--seed",
        "3",
        "-p",
        "nlos_receivers=2",
        "-p",
        "sources=disc",
        "-o",
        "same.csv",
    )
    assert done.returncode == 0, done.stderr
    words = ("--field", "circle:0,0,1", "--alternatives", "3", "-q", "--report", "report.json")
    found = rows(run(ring, "localize", "-m", "mixture-ml", "same.csv", *words).stdout)
    assert [float(row["x_m"]) for row in found] == result.estimates.column("x_m").to_pylist()
    assert json.loads((ring / "report.json").read_text())["methods"]["mixture-ml"]["answered"] == 20


def test_estimates_at_the_top_of_a_region_in_space_are_at_its_edge(tmp_path: Path) -> None:
    """Of sources up to 200 m high in a region up to 100 m, many fixes are at its top; in one up to 300 m none is."""
    assert run(tmp_path, "simulate", "space-ring", "-n", "60", "-q", "-o", "ring.csv").returncode == 0
    for top, many in ((100, True), (300, False)):
        words = (f"--field=-1000,1000,-1000,1000,-100,{top}", "-p", "search_outside=false", "-o", f"{top}.csv")
        done = run(tmp_path, "localize", "-m", "mixture-ml", "ring.csv", *words)
        match = re.search(r"; (\d+) of \d+ estimates are at its edge", done.stderr)
        assert match is not None
        assert int(match[1]) > 6 if many else int(match[1]) == 0
