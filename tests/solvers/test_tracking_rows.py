"""Paths under the rows' own likelihoods against scipy's minimizers, and mean NEES of simulated walks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from scipy.optimize import least_squares, minimize

import nlosctl
from nlosctl.solvers.tracking.fixes import guarded_inverse

FloatArray = np.ndarray

SENSORS = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 80.0], [0.0, 80.0]])


class Walk:
    """A walk between four corners: rows of each second at times of their own, 10 % of them missing."""

    def __init__(self, kind: str, seed: int, *, size: int = 60, outliers: float = 0.0, q: float = 0.05) -> None:
        rng = np.random.default_rng(seed)
        self.kind, self.q = kind, q
        noise = np.linalg.cholesky(q * np.array([[1 / 3, 1 / 2], [1 / 2, 1]]))
        state, path = np.array([rng.uniform(35, 65, 2), rng.normal(size=2)]), []
        for _ in range(size):
            path.append(state)
            state = np.stack([state[0] + state[1], state[1]]) + noise @ rng.normal(size=(2, 2))
        self.path = np.array(path)
        snapshot, sensor = np.nonzero(rng.uniform(size=(size, 4)) > 0.1)
        delay = np.round(rng.uniform(-0.4, 0.4, snapshot.size), 6)
        self.snapshot, self.sensor, self.time = snapshot, sensor, snapshot + delay
        place = self.path[snapshot, 0] + delay[:, None] * self.path[snapshot, 1]
        away = place - SENSORS[sensor]
        late = rng.uniform(size=snapshot.size) < outliers
        if kind == "ranges":
            self.std = 1.0
            values = np.hypot(*away.T) + rng.normal(size=snapshot.size)
            self.values = np.where(late, values + rng.uniform(5.0, 40.0, snapshot.size), values)
        else:
            self.std = np.radians(2.0)
            self.values = np.arctan2(away[:, 1], away[:, 0]) + self.std * rng.normal(size=snapshot.size)
        self.mean_time = np.bincount(snapshot, self.time, size) / np.bincount(snapshot, minlength=size)

    def table(self) -> pa.Table:
        """The measurements with times, in a mixed order of snapshots."""
        name = "range" if self.kind == "ranges" else "bearing"
        unit = "m" if self.kind == "ranges" else "rad"
        order = np.argsort((self.snapshot * 7) % 61, kind="stable")
        rows = self.snapshot[order]
        return pa.table(
            {
                "snapshot": rows,
                "time_s": self.time[order],
                "sensor": [f"s{index}" for index in self.sensor[order]],
                "sensor_x_m": SENSORS[self.sensor[order], 0],
                "sensor_y_m": SENSORS[self.sensor[order], 1],
                f"{name}_{unit}": self.values[order],
                f"{name}_std_{unit}": np.full(rows.size, self.std),
            }
        )

    def predicted(self, states: FloatArray) -> FloatArray:
        """The measurement of each row on a path (S, 4)."""
        delay = (self.time - self.mean_time[self.snapshot])[:, None]
        place = states[self.snapshot, :2] + delay * states[self.snapshot, 2:]
        away = place - SENSORS[self.sensor]
        return np.hypot(*away.T) if self.kind == "ranges" else np.arctan2(away[:, 1], away[:, 0])

    def scaled(self, states: FloatArray) -> FloatArray:
        """The residual of each row over its std."""
        off = self.values - self.predicted(states)
        return (off if self.kind == "ranges" else (off + np.pi) % (2 * np.pi) - np.pi) / self.std

    def steps(self, states: FloatArray) -> FloatArray:
        """The deviations of the motion, whitened."""
        parts = []
        for k, h in enumerate(np.diff(self.mean_time)):
            root = np.linalg.cholesky(self.q * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]]))
            off = np.stack([states[k + 1, :2] - states[k, :2] - h * states[k, 2:], states[k + 1, 2:] - states[k, 2:]])
            parts.append(np.linalg.solve(root, off).ravel())
        return np.concatenate(parts)

    def start(self) -> FloatArray:
        """The true path."""
        return np.concatenate([self.path[:, 0], self.path[:, 1]], axis=1)


def tracked(walk: Walk, method: str, **options: object) -> tuple[FloatArray, FloatArray]:
    """States (S, 4) in order of time, and position covariances (S, 2, 2)."""
    return states_of(nlosctl.track(walk.table(), method=method, acceleration_psd=walk.q, **options).estimates)


def states_of(found: pa.Table) -> tuple[FloatArray, FloatArray]:
    """The same of the table of one track."""
    rows = found.sort_by("time_s").to_pydict()
    states = np.stack([rows[name] for name in ("x_m", "y_m", "vx_m_s", "vy_m_s")], axis=1)
    entries = (rows["cov_xx_m2"], rows["cov_xy_m2"], rows["cov_yy_m2"])
    xx, xy, yy = (np.array(entry, dtype=float) for entry in entries)
    return states, np.stack([xx, xy, xy, yy], axis=1).reshape(-1, 2, 2)


@pytest.mark.parametrize("kind", ["ranges", "bearings"])
def test_trusted_rows_give_the_least_squares_path_of_scipy(kind: str) -> None:
    """States within 1e-2 standard deviations, covariances within 2e-3 of the trace, rows at their own times."""
    walk = Walk(kind, seed=1, size=12)
    states, spread = tracked(walk, "ml")
    cost: Callable[[FloatArray], FloatArray] = lambda flat: np.concatenate(  # noqa: E731
        [walk.scaled(flat.reshape(-1, 4)), walk.steps(flat.reshape(-1, 4))]
    )
    best = least_squares(cost, walk.start().ravel(), xtol=1e-14, ftol=1e-14, gtol=1e-12)
    covariance = np.linalg.inv(best.jac.T @ best.jac)
    std = np.sqrt(np.diag(covariance)).reshape(-1, 4)
    assert np.abs((states - best.x.reshape(-1, 4)) / std).max() < 1e-3
    expected = np.stack([covariance[4 * k : 4 * k + 2, 4 * k : 4 * k + 2] for k in range(12)])
    off = np.abs(spread - expected).max(axis=(1, 2)) / np.trace(expected, axis1=1, axis2=2)
    assert off.max() < 1e-3


def test_a_mixture_gives_the_likeliest_path_of_scipy() -> None:
    """The path is a minimum of the mixture's cost, as low as scipy finds from the truth."""
    walk = Walk("ranges", seed=2, size=7, outliers=0.15)
    states, _ = tracked(walk, "mixture-ml", nlos_density_per_m=0.01, alpha=0.2)

    def cost(flat: FloatArray) -> float:
        path = flat.reshape(-1, 4)
        direct = 0.8 * np.exp(-0.5 * walk.scaled(path) ** 2) / np.sqrt(2 * np.pi)
        return float(0.5 * np.sum(walk.steps(path) ** 2) - np.sum(np.log(direct + 0.2 * 0.01)))

    best = minimize(cost, walk.start().ravel(), method="BFGS", options={"gtol": 1e-5})
    assert cost(states.ravel()) <= best.fun + 1e-4


@pytest.mark.parametrize(
    ("kind", "method", "outliers", "most"),
    [("ranges", "ml", 0.0, 2.4), ("bearings", "ml", 0.0, 2.4), ("ranges", "mixture-ml", 0.15, 2.9)],
)
def test_covariances_are_the_size_of_the_errors(kind: str, method: str, outliers: float, most: float) -> None:
    """The mean NEES of positions is near 2 in walks with rows of their own times; the note has 1.93 to 2.34."""
    walks = [Walk(kind, seed=10 + seed, outliers=outliers) for seed in range(8)]
    tables = [walk.table() for walk in walks]
    names = [f"w{number}-" for number, table in enumerate(tables) for _ in range(table.num_rows)]
    table = pa.concat_tables(tables)
    ids = [f"{name}{snapshot}" for name, snapshot in zip(names, table.column("snapshot").to_pylist(), strict=True)]
    table = table.set_column(0, "snapshot", pa.array(ids)).append_column("walk", pa.array(names))
    found = nlosctl.track(table, method=method, acceleration_psd=0.05, by="walk").estimates
    assert set(found.column("status").to_pylist()) == {"ok"}
    total = []
    for walk, name in zip(walks, dict.fromkeys(names), strict=True):
        states, spread = states_of(found.filter(pc.equal(found.column("walk"), name)))
        delay = walk.mean_time - np.arange(60)
        error = states[:, :2] - walk.path[:, 0] - delay[:, None] * walk.path[:, 1]
        total.append(np.einsum("si,sij,sj->s", error, guarded_inverse(spread)[0], error))
    assert 1.6 < float(np.mean(total)) < most


def test_flags_are_those_of_the_path() -> None:
    """Residuals are measured minus predicted on the path at each row's time; late rows have a low probability."""
    walk = Walk("ranges", seed=3, size=30, outliers=0.2)
    result = nlosctl.track(walk.table(), method="mixture-ml", acceleration_psd=walk.q, flags=True)
    states = tracked(walk, "mixture-ml")[0]
    flags = result.flags.to_pydict()
    order = np.argsort((walk.snapshot * 7) % 61, kind="stable")
    np.testing.assert_allclose(flags["residual_m"], (walk.values - walk.predicted(states))[order], atol=1e-9)
    los, probability = np.array(flags["los"]), np.array(flags["los_probability"])
    assert (los == (probability > 0.5)).all()
    off = np.abs(flags["residual_m"])
    assert probability[off > 5.0].max() < 0.05
    assert probability[off < 2.0].min() > 0.5
    assert (np.array(flags["used"]) == los).all()


@pytest.mark.parametrize(("kind", "method", "outliers"), [("bearings", "ml", 0.0), ("ranges", "mixture-ml", 0.1)])
def test_a_filtered_state_is_the_last_of_the_path_through_the_rows_until_then(
    kind: str, method: str, outliers: float
) -> None:
    """Later rows change a filtered state by less than 1e-2 of its std; the last one is the smoothed one."""
    walk = Walk(kind, seed=4, size=36, outliers=outliers)
    table = walk.table()
    filtered, spread = states_of(nlosctl.track(table, method=method, acceleration_psd=walk.q, causal=True).estimates)
    assert np.isnan(filtered[0, 2:].astype(float)).all()
    for last in (5, 35):
        shorter = table.filter(pc.less_equal(table.column("snapshot"), last))
        states, until = states_of(nlosctl.track(shorter, method=method, acceleration_psd=walk.q).estimates)
        std = np.sqrt(np.diagonal(until[-1]))
        assert np.abs((filtered[last, :2] - states[-1, :2]) / std).max() < 1e-2
        assert np.abs(spread[last] - until[-1]).max() < 2e-3 * np.trace(until[-1])


def test_rows_one_by_one_find_a_path_from_several_snapshots_together() -> None:
    """Snapshots of a single range have no fix; the search starts from fixes of several of them."""
    walk = Walk("ranges", seed=6, size=40)
    table = walk.table().sort_by("time_s")
    table = table.set_column(0, "snapshot", pa.array(np.arange(table.num_rows)))
    states, _ = states_of(nlosctl.track(table, acceleration_psd=walk.q).estimates)
    time = np.array(table.column("time_s"))
    truth = walk.path[np.rint(time).astype(int)]
    place = truth[:, 0] + (time - np.rint(time))[:, None] * truth[:, 1]
    assert np.sqrt(np.mean(np.sum((states[:, :2] - place) ** 2, axis=1))) < 1.2


def test_a_track_that_starts_nowhere_is_degenerate() -> None:
    """A single range, and two ranges to one anchor, are no path: no number is made up."""
    table = pa.table(
        {
            "snapshot": [0, 1, 2],
            "tag": ["a", "b", "b"],
            "time_s": [0.0, 0.0, 1.0],
            "sensor": ["s", "s", "s"],
            "sensor_x_m": [0.0] * 3,
            "sensor_y_m": [0.0] * 3,
            "range_m": [5.0] * 3,
            "range_std_m": [1.0] * 3,
        }
    )
    found = nlosctl.track(table, acceleration_psd=1.0, by="tag").estimates
    assert found.column("status").to_pylist() == ["degenerate"] * 3
    assert found.column("x_m").null_count == found.column("cov_xx_m2").null_count == 3
