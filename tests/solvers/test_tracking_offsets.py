"""Paths through rows of sensors whose offsets are not exactly known: against scipy, a dense solution, and mean NEES."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from scipy.linalg import block_diag
from scipy.optimize import least_squares

import nlosctl
from nlosctl.contract.calibration import OFFSETS, Calibration, SensorOffset
from nlosctl.errors import UsageError

FloatArray = np.ndarray

SENSORS = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 80.0], [0.0, 80.0]])
STD = {"ranges": 0.5, "arrivals": 0.5, "bearings": np.radians(1.0)}
NAME = {"ranges": ("range_m", "range_std_m"), "arrivals": ("arrival_m", "arrival_std_m")} | {
    "bearings": ("bearing_rad", "bearing_std_rad")
}
Q = 0.05


class World:
    """A walk between four corners, whose sensors are off by offsets of the covariance ``spread`` (4, 4)."""

    def __init__(self, kind: str, seed: int, size: int = 12, outliers: float = 0.0) -> None:
        rng = np.random.default_rng(seed)
        self.kind, self.size, self.std = kind, size, STD[kind]
        root = 1.5 * self.std * (rng.normal(size=(4, 4)) * 0.4 + np.eye(4))
        self.spread = root @ root.T
        noise = np.linalg.cholesky(Q * np.array([[1 / 3, 1 / 2], [1 / 2, 1]]))
        state, path = np.array([rng.uniform(35, 65, 2), rng.normal(size=2)]), []
        for _ in range(size):
            path.append(state)
            state = np.stack([state[0] + state[1], state[1]]) + noise @ rng.normal(size=(2, 2))
        self.path = np.array(path)
        self.snapshot, self.sensor = np.nonzero(rng.uniform(size=(size, 4)) > 0.1)
        self.clock = rng.normal(size=size) * 30.0 * (kind == "arrivals")
        states = np.concatenate([self.path[:, 0], self.path[:, 1]], axis=1)
        values = self.predicted(states, self.clock) + (root @ rng.normal(size=4))[self.sensor]
        late = rng.uniform(5.0, 30.0, values.size) * (rng.uniform(size=values.size) < outliers)
        self.values = values + self.std * rng.normal(size=values.size) + late

    def predicted(self, states: FloatArray, clock: FloatArray) -> FloatArray:
        """The measurement of each row on a path (S, 4), without offsets of sensors."""
        away = states[self.snapshot, :2] - SENSORS[self.sensor]
        if self.kind == "bearings":
            return np.arctan2(away[:, 1], away[:, 0])
        return np.hypot(*away.T) + clock[self.snapshot]

    def table(self, name: str = "") -> pa.Table:
        """The measurements with times."""
        measured, std = NAME[self.kind]
        return pa.table(
            {
                "snapshot": [f"{name}{number}" for number in self.snapshot],
                "walk": [name] * self.snapshot.size,
                "time_s": self.snapshot.astype(float),
                "sensor": [f"s{index}" for index in self.sensor],
                "sensor_x_m": SENSORS[self.sensor, 0],
                "sensor_y_m": SENSORS[self.sensor, 1],
                measured: self.values,
                std: np.full(self.values.size, self.std),
            }
        )

    def calibration(self) -> Calibration:
        """The covariance of the offsets, which are zero by themselves."""
        unit = OFFSETS[self.kind].scale
        stds = np.sqrt(np.diag(self.spread)) / unit
        entries = tuple(SensorOffset(name=f"s{index}", std=float(stds[index])) for index in range(4))
        return Calibration(kind=self.kind, entries=entries, order=(0, 1, 2, 3), covariance=self.spread / unit**2)

    def residuals(self, flat: FloatArray) -> FloatArray:
        """Whitened residuals of everything: rows, motion, and the prior of the offsets."""
        states = flat[: 4 * self.size].reshape(-1, 4)
        offset = flat[4 * self.size : 4 * self.size + 4]
        clock = flat[4 * self.size + 4 :] if self.kind == "arrivals" else self.clock
        off = self.values - self.predicted(states, clock) - offset[self.sensor]
        if self.kind == "bearings":
            off = (off + np.pi) % (2 * np.pi) - np.pi
        step = np.linalg.inv(np.linalg.cholesky(Q * np.array([[1 / 3, 1 / 2], [1 / 2, 1]])))
        ahead = np.stack([states[1:, :2] - states[:-1, :2] - states[:-1, 2:], states[1:, 2:] - states[:-1, 2:]])
        moves = np.einsum("ij,jnd->ind", step, ahead).ravel()
        return np.concatenate([off / self.std, moves, np.linalg.solve(np.linalg.cholesky(self.spread), offset)])

    def best(self) -> tuple[FloatArray, FloatArray]:
        """States (S, 4) of scipy's minimum over path and offsets, and their covariance."""
        states = np.concatenate([self.path[:, 0], self.path[:, 1]], axis=1)
        clock = self.clock if self.kind == "arrivals" else np.zeros(0)
        start = np.concatenate([states.ravel(), np.zeros(4), clock])
        found = least_squares(self.residuals, start, xtol=1e-14, ftol=1e-14, gtol=1e-12)
        return found.x[: 4 * self.size].reshape(-1, 4), np.linalg.inv(found.jac.T @ found.jac)


def numbers(table: pa.Table, *names: str) -> FloatArray:
    """Columns (S, N) in order of time."""
    return values(table.sort_by("time_s"), *names)


def values(rows: pa.Table, *names: str) -> FloatArray:
    """Columns (S, N) as they stand."""
    return np.stack([np.array(rows.column(name).to_pylist(), dtype=float) for name in names], axis=1)


@pytest.mark.parametrize("kind", ["ranges", "bearings", "arrivals"])
def test_offsets_are_unknowns_of_the_track(kind: str) -> None:
    """States within 1e-2 std, covariances within 2e-3 of the trace, of scipy's minimum over path and offsets."""
    world = World(kind, seed=3)
    found = nlosctl.track(world.table(), acceleration_psd=Q, calibration=world.calibration()).estimates
    expected, covariance = world.best()
    std = np.sqrt(np.diag(covariance))[: 4 * world.size].reshape(-1, 4)
    states = numbers(found, "x_m", "y_m", "vx_m_s", "vy_m_s")
    assert np.abs((states - expected) / std).max() < 1e-2
    names = ("cov_xx_m2", "cov_xy_m2", "cov_yy_m2", "cov_vxvx_m2_s2", "cov_vxvy_m2_s2", "cov_vyvy_m2_s2")
    at = 4 * np.arange(world.size)
    entries = [covariance[at + i, at + j] for i, j in ((0, 0), (0, 1), (1, 1), (2, 2), (2, 3), (3, 3))]
    off = np.abs(numbers(found, *names) - np.stack(entries, axis=1))
    assert off[:, :3].max() < 2e-3 * (entries[0] + entries[2]).min()
    assert off[:, 3:].max() < 2e-3 * (entries[3] + entries[5]).min()


@pytest.mark.parametrize(("method", "outliers"), [("ml", 0.0), ("mixture-ml", 0.15)])
def test_covariances_are_the_size_of_the_errors(method: str, outliers: float) -> None:
    """The mean NEES of positions is near 2 where each walk has offsets of its own; as if they were known it is not."""
    worlds = [World("ranges", seed=20 + number, size=20, outliers=outliers) for number in range(12)]
    table = pa.concat_tables([world.table(f"w{number}-") for number, world in enumerate(worlds)])
    parts = [world.calibration() for world in worlds]
    entries = [replace(entry, group=(f"w{number}-",)) for number, part in enumerate(parts) for entry in part.entries]
    both = block_diag(*(part.covariance for part in parts))
    order = tuple(range(len(entries)))
    whole = Calibration(kind="ranges", by=("walk",), entries=tuple(entries), order=order, covariance=both)
    nees = []
    for given in (whole, None):
        found = nlosctl.track(table, calibration=given, method=method, acceleration_psd=Q, by="walk").estimates
        assert set(found.column("status").to_pylist()) == {"ok"}
        error = values(found, "x_m", "y_m") - np.concatenate([world.path[:, 0] for world in worlds])
        xx, xy, yy = values(found, "cov_xx_m2", "cov_xy_m2", "cov_yy_m2").T
        square = yy * error[:, 0] ** 2 - 2 * xy * error[:, 0] * error[:, 1] + xx * error[:, 1] ** 2
        nees.append(float(np.mean(square / (xx * yy - xy * xy))))
    assert 1.3 < nees[0] < 2.8
    assert nees[1] > 5.0


@pytest.mark.parametrize("kind", ["ranges", "bearings", "arrivals"])
def test_a_snapshot_alone_is_the_fix_of_localize(kind: str) -> None:
    """A track of one state has the position and the covariance of localize with the same calibration."""
    world = World(kind, seed=4, size=5)
    full = int(np.flatnonzero(np.bincount(world.snapshot) == 4)[0])
    table = world.table().filter(pa.array(world.snapshot == full))
    given = {"calibration": world.calibration()}
    track = nlosctl.track(table, acceleration_psd=Q, **given).estimates
    fix = nlosctl.localize(table, method="ml", **given).estimates
    for name in ("x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2"):
        assert track[name][0].as_py() == pytest.approx(fix[name][0].as_py(), rel=2e-4, abs=1e-4), name


def test_directions_with_ranges_in_space_have_both_offsets(tmp_path: Path) -> None:
    """Azimuths, elevations and ranges of sensors with two offsets each: the fix of localize, and its covariance."""
    rng = np.random.default_rng(8)
    place = np.array([[0.0, 0.0, 1.0], [60.0, 0.0, 8.0], [30.0, 50.0, 3.0]])
    away = np.array([25.0, 20.0, 12.0]) - place
    flat = np.hypot(away[:, 0], away[:, 1])
    scene = tmp_path / "scene.toml"
    entry = '[[sensor]]\nname = "s{}"\nposition = {}\nheading_std_deg = 1.0\nrange_offset_std_m = 0.7\n'
    scene.write_text("".join(entry.format(number, place[number].tolist()) for number in range(3)))
    table = pa.table(
        {
            "snapshot": [0] * 3,
            "time_s": [0.0] * 3,
            "sensor": ["s0", "s1", "s2"],
            **{f"sensor_{axis}_m": place[:, index] for index, axis in enumerate("xyz")},
            "bearing_rad": np.arctan2(away[:, 1], away[:, 0]) + rng.normal(size=3) * 0.02,
            "bearing_std_rad": [0.01] * 3,
            "elevation_rad": np.arctan2(away[:, 2], flat) + rng.normal(size=3) * 0.01,
            "elevation_std_rad": [0.01] * 3,
            "range_m": np.linalg.norm(away, axis=1) + rng.normal(size=3) * 0.7,
            "range_std_m": [0.3] * 3,
        }
    )
    track = nlosctl.track(table, acceleration_psd=Q, scene=scene, use_ranges=True).estimates
    fix = nlosctl.localize(table, method="ml", scene=scene, use_ranges=True).estimates
    sides = ("xx", "xy", "yy", "xz", "yz", "zz")
    for name in ("x_m", "y_m", "z_m", *(f"cov_{pair}_m2" for pair in sides)):
        assert track[name][0].as_py() == pytest.approx(fix[name][0].as_py(), rel=2e-3, abs=2e-4), name


def test_tracks_do_not_depend_on_each_other() -> None:
    """A track has the same digits alone as beside another one, whose offsets are found from its own rows."""
    worlds = [World("ranges", seed=30 + number, size=9) for number in range(2)]
    given = {"calibration": worlds[0].calibration(), "acceleration_psd": Q, "by": "walk"}
    tables = [world.table(name) for world, name in zip(worlds, "ab", strict=True)]
    both = nlosctl.track(pa.concat_tables(tables), **given).estimates
    alone = [nlosctl.track(table, **given).estimates for table in tables]
    assert both.equals(pa.concat_tables(alone))


def test_filtered_states_need_known_offsets() -> None:
    """The filter has no model of offsets: it refuses those that are not exactly known, and takes those that are."""
    world = World("ranges", seed=5)
    with pytest.raises(UsageError, match="`causal` takes the offsets of sensors as exactly known"):
        nlosctl.track(world.table(), acceleration_psd=Q, causal=True, calibration=world.calibration())
    exact = Calibration(kind="ranges", entries=(SensorOffset(name="s0", offset=0.4, std_scale=2.0),))
    table = world.table()
    shifted = np.where(world.sensor == 0, world.values - 0.4, world.values)
    wider = np.where(world.sensor == 0, 2.0 * world.std, world.std)
    by_hand = table.set_column(6, "range_m", pa.array(shifted)).set_column(7, "range_std_m", pa.array(wider))
    corrected = nlosctl.track(table, acceleration_psd=Q, causal=True, calibration=exact).estimates
    expected = nlosctl.track(by_hand, acceleration_psd=Q, causal=True).estimates
    for name in ("x_m", "vy_m_s", "cov_xx_m2"):
        np.testing.assert_allclose(numbers(corrected, name), numbers(expected, name), rtol=1e-9)


def test_the_density_is_estimated_beside_the_offsets() -> None:
    """The estimated density is where the evidence of the dense Gaussian problem at scipy's path is largest."""
    world = World("ranges", seed=8, size=20)
    result = nlosctl.track(world.table(), estimate_acceleration=True, calibration=world.calibration())
    found = result.report.settings["acceleration_psd"]

    def evidence(density: float) -> float:
        rows, other = world.snapshot.size, 4 * (world.size - 1)

        def scaled(flat: FloatArray) -> FloatArray:
            whole = world.residuals(flat)
            whole[rows : rows + other] *= np.sqrt(Q / density)
            return whole

        states = np.concatenate([world.path[:, 0], world.path[:, 1]], axis=1)
        best = least_squares(scaled, np.concatenate([states.ravel(), np.zeros(4)]), xtol=1e-12, ftol=1e-12)
        return -best.cost - 0.5 * np.linalg.slogdet(best.jac.T @ best.jac)[1] - 0.5 * other * np.log(density)

    assert evidence(found) > max(evidence(0.8 * found), evidence(1.25 * found))
