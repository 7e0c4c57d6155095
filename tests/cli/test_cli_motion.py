"""``localize -p motion=velocity``: columns, times, truth at the mean time, the same bytes, refusals in one line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
from cli_support import Outcome

Cli = Callable[..., Outcome]

MOTION = ("-m", "ml", "-p", "motion=velocity")
VELOCITY = ("vx_m_s", "vy_m_s", "cov_vxvx_m2_s2", "cov_vxvy_m2_s2", "cov_vyvy_m2_s2")


@pytest.fixture
def ships(cli: Cli, tmp_path: Path) -> Path:
    """Twelve snapshots of a ship that turns once, as a CSV file."""
    drawn = ("simulate", "ship", "-n", 12, "-p", "bearings=21", "-p", "bearing_std_deg=0.2", "--seed", 2, "-q")
    assert cli(*drawn, "-o", "ships.csv").code == 0
    return tmp_path / "ships.csv"


def test_estimates_have_times_velocities_and_the_mean_truth(cli: Cli, ships: Path) -> None:
    """A row per snapshot with its mean time; the true positions, which move, are those at that time."""
    outcome = cli("localize", "ships.csv", *MOTION, "--add", "nees", "-q", "-o", "e.parquet", "--flags-out", "f.csv")
    assert outcome.code == 0, outcome.err
    found, given = pq.read_table(ships.parent / "e.parquet"), pc.read_csv(ships)
    assert {"time_s", *VELOCITY} <= set(found.column_names)
    assert "vz_m_s" not in found.column_names
    assert found.column("time_s").to_pylist() == [600.0] * 12
    true = given.column("truth_x_m").to_numpy().reshape(12, 21).mean(axis=1)
    np.testing.assert_allclose(found.column("truth_x_m").to_numpy(), true, rtol=1e-12)
    status = np.array(found.column("status").to_pylist())
    assert np.count_nonzero(status == "ok") >= 10
    nees = np.array(found.column("nees").to_pylist(), dtype=float)
    assert np.nanmean(nees) < 6.0
    flags = pc.read_csv(ships.parent / "f.csv")
    assert flags.column("truth_x_m").equals(given.column("truth_x_m"))
    residual = flags.column("residual_rad").to_numpy(zero_copy_only=False)
    assert np.nanstd(residual) == pytest.approx(np.radians(0.2), rel=0.2)
    assert cli("evaluate", "e.parquet", "--json").json["overall"]["rows"] == 12
    assert cli("plot", "e.parquet", "--view", "estimates", "-o", "e.svg", "-q").code == 0


def test_every_way_of_reading_gives_the_same_bytes(cli: Cli, ships: Path) -> None:
    """Processes, small blocks, standard input, and an order of rows that is mixed within snapshots change nothing."""
    expected = cli("localize", "ships.csv", *MOTION, "-q").out
    assert cli("localize", "ships.csv", *MOTION, "-q", "--jobs", 2, "--block-size", 5).out == expected
    assert cli("localize", "-", *MOTION, "-q", stdin=ships.read_bytes()).out == expected
    table = pc.read_csv(ships)
    order = np.lexsort((np.random.default_rng(1).permutation(table.num_rows), table.column("snapshot").to_numpy()))
    pc.write_csv(table.take(pa.array(order)), ships.parent / "mixed.csv")
    mixed, whole = cli("localize", "mixed.csv", *MOTION, "-q").table, cli("localize", "ships.csv", *MOTION, "-q").table
    for name in ("x_m", "vx_m_s", "cov_vyvy_m2_s2"):
        np.testing.assert_allclose(
            np.array(mixed.column(name).to_pylist(), float), np.array(whole.column(name).to_pylist(), float), rtol=1e-6
        )


def test_windows_and_date_times_are_times(cli: Cli, ships: Path) -> None:
    """A window of ISO times is a snapshot like another, and its mean time counts seconds since 1970."""
    rows = [row for row in pc.read_csv(ships).to_pylist() if row["snapshot"] == 3]
    for row in rows:
        second = int(row.pop("time_s"))
        row["time"] = f"2026-01-01T00:{second // 60:02d}:{second % 60:02d}Z"
    pc.write_csv(pa.Table.from_pylist(rows).drop_columns("snapshot"), ships.parent / "iso.csv")
    windows = cli("localize", "iso.csv", *MOTION, "--window", "1h", "-q").table.to_pylist()
    plain = cli("localize", "ships.csv", *MOTION, "--where", "snapshot == 3", "-q").table.to_pylist()
    assert len(windows) == len(plain) == 1
    assert windows[0]["time_s"] == pytest.approx(1767225600.0 + 600.0)
    assert windows[0]["vx_m_s"] == pytest.approx(plain[0]["vx_m_s"], rel=1e-6)


def test_a_straight_course_has_a_status_and_advice(cli: Cli) -> None:
    """Without a turn every snapshot is degenerate, and the summary states what is missing."""
    drawn = cli("simulate", "ship", "-n", 5, "-p", "turns=0", "--seed", 1, "-q", "--format", "csv").out
    outcome = cli("localize", "-", *MOTION, stdin=drawn)
    assert outcome.code == 0
    assert set(outcome.table.column("status").to_pylist()) == {"degenerate"}
    assert "5 degenerate" in outcome.err
    assert "need a turn" in outcome.err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("-m", "stansfield", "-p", "motion=velocity"), "method 'stansfield' has no parameter 'motion'"),
        (("-m", "mixture-ml", "-p", "motion=velocity"), "method 'mixture-ml' has no parameter 'motion'"),
        ((*MOTION, "--estimate-std", "snapshot"), "needs stated standard deviations"),
        ((*MOTION, "--add", "gdop"), "is of a source at rest"),
        ((*MOTION, "-p", "law=vonmises"), "can't be combined with law=vonmises"),
    ],
)
def test_what_has_no_motion_is_refused_in_one_line(cli: Cli, ships: Path, words: Sequence[str], expected: str) -> None:
    """Methods without the parameter, and options without a model of motion, are usage errors."""
    outcome = cli("localize", "ships.csv", *words)
    assert outcome.code == 2
    assert expected in outcome.err
    assert len(outcome.err.strip().splitlines()) == 1


def test_a_file_without_times_is_a_usage_error(cli: Cli, ships: Path) -> None:
    """The message names the columns of times and how to rename one."""
    outcome = cli("localize", "ships.csv", *MOTION, "--column", "when=time_s")
    assert outcome.code == 2
    table = pc.read_csv(ships)
    pc.write_csv(table.drop_columns("time_s"), ships.parent / "timeless.csv")
    outcome = cli("localize", "timeless.csv", *MOTION)
    assert outcome.code == 2
    assert "no column 'time_s' or 'time', which velocities (motion=velocity) need" in outcome.err
    assert "--column time_s=HEADER" in outcome.err


def test_other_commands_refuse_motion(cli: Cli, ships: Path) -> None:
    """Tracks have a motion of their own, and posteriors none."""
    track = cli("track", "ships.csv", *MOTION, "-p", "acceleration_psd=0.1")
    posterior = cli("posterior", "ships.csv", *MOTION, "--snapshot", 0, "--cell", 500)
    assert (track.code, posterior.code) == (2, 2)
    assert "motion=velocity is for localize" in track.err
    assert "leave out motion=velocity" in posterior.err


def test_the_bound_is_the_inverse_information_of_all_rows(cli: Cli, ships: Path) -> None:
    """Bounds of position and velocity are those of finite differences of the exact bearings; null without a turn."""
    assert cli("bound", "ships.csv", "-p", "motion=velocity", "-q", "-o", "b.parquet").code == 0
    found, given = pq.read_table(ships.parent / "b.parquet").to_pydict(), pc.read_csv(ships)
    block = {name: given.column(name).to_numpy().reshape(12, 21) for name in given.column_names if name[-1] in "ms"}
    for snapshot in (0, 5):
        own = {name: values[snapshot] for name, values in block.items()}
        elapsed = own["time_s"] - own["time_s"].mean()

        def bearings(state: np.ndarray, own: dict[str, np.ndarray] = own, elapsed: np.ndarray = elapsed) -> np.ndarray:
            x, y = (state[axis] + elapsed * state[2 + axis] for axis in (0, 1))
            return np.arctan2(y - own["sensor_y_m"], x - own["sensor_x_m"])

        truth = [own["truth_x_m"].mean(), own["truth_y_m"].mean(), own["truth_vx_m_s"][0], own["truth_vy_m_s"][0]]
        state, steps = np.array(truth), np.diag([0.1, 0.1, 1e-4, 1e-4])
        slopes = np.stack([(bearings(state + h) - bearings(state - h)) / (2.0 * h.sum()) for h in steps], axis=1)
        wanted = np.linalg.inv(slopes.T @ slopes) * np.radians(0.2) ** 2
        for name, (one, other) in {
            "xx_m2": (0, 0),
            "xy_m2": (0, 1),
            "vxvx_m2_s2": (2, 2),
            "vyvy_m2_s2": (3, 3),
        }.items():
            assert found[f"bound_{name}"][snapshot] == pytest.approx(wanted[one, other], rel=1e-3)
        assert found["time_s"][snapshot] == 600.0
    straight = cli("simulate", "ship", "-n", 3, "-p", "turns=0", "-q", "--format", "csv").out
    none = cli("bound", "-", "-p", "motion=velocity", "-q", stdin=straight).table
    assert none.column("rms_m").null_count == none.column("bound_vxvx_m2_s2").null_count == 3
    assert cli("bound", "ships.csv", "-p", "motion=velocity", "--map", "0,1,0,1,1").code == 2


@pytest.mark.parametrize("kind", ["bearings", "ranges"])
def test_three_dimensions_have_a_third_velocity(cli: Cli, tmp_path: Path, kind: str) -> None:
    """With heights of sensors the state has six unknowns; velocities and covariances in the order of the contract."""
    rng, rows = np.random.default_rng(4), []
    corners = [(0.0, 0.0, 3.0), (100.0, 0.0, 30.0), (100.0, 80.0, 2.0), (0.0, 80.0, 20.0)]
    for number in range(24):
        x, y, z = np.array([40.0, 30.0, 12.0]) + (number - 11.5) * np.array([0.5, -0.3, 0.2]) - corners[number % 4]
        row = {"time_s": float(number), "sensor": f"s{number % 4}"}
        row |= dict(zip(("sensor_x_m", "sensor_y_m", "sensor_z_m"), corners[number % 4], strict=True))
        noise = rng.normal(size=2)
        if kind == "ranges":
            row |= {"range_m": float(np.hypot(np.hypot(x, y), z) + 0.1 * noise[0]), "range_std_m": 0.1}
        else:
            row |= {"bearing_rad": float(np.arctan2(y, x) + 0.01 * noise[0]), "bearing_std_rad": 0.01}
            row |= {"elevation_rad": float(np.arctan2(z, np.hypot(x, y)) + 0.01 * noise[1]), "elevation_std_rad": 0.01}
        rows.append(row)
    pc.write_csv(pa.Table.from_pylist(rows), tmp_path / "space.csv")
    outcome = cli("localize", "space.csv", *MOTION, "--dimensions", 3, "-q")
    (found,) = outcome.table.to_pylist()
    names = list(found)
    assert names[names.index("vx_m_s") :][:9] == [
        *("vx_m_s", "vy_m_s", "vz_m_s", "cov_vxvx_m2_s2", "cov_vxvy_m2_s2", "cov_vyvy_m2_s2"),
        *("cov_vxvz_m2_s2", "cov_vyvz_m2_s2", "cov_vzvz_m2_s2"),
    ]
    assert (found["status"], found["time_s"]) == ("ok", 11.5)
    for axis, true in zip("xyz", (0.5, -0.3, 0.2), strict=True):
        assert abs(found[f"v{axis}_m_s"] - true) < 4.0 * found[f"cov_v{axis}v{axis}_m2_s2"] ** 0.5
    held = cli("localize", "space.csv", *MOTION, "--dimensions", 3, "--target-z-m", 12)
    assert held.code == 2
    assert "leave out --target-z-m" in held.err or "target_z_m" in held.err
