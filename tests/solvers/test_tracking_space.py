"""Paths of arrival times and in three dimensions against scipy's minimizers."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from scipy.optimize import least_squares

import nlosctl
from nlosctl.contract.calibration import Calibration, SensorOffset
from nlosctl.errors import UsageError

FloatArray = np.ndarray

ANCHORS = np.array([[0.0, 0, 2], [60, 0, 9], [60, 50, 3], [0, 50, 8], [30, 60, 1], [25, -8, 12]])
SIZE, Q = 10, 0.2


class World:
    """A source that moves in space, seen by six sensors at times of their own."""

    def __init__(self, seed: int, axes: int) -> None:
        rng = np.random.default_rng(seed)
        second = np.arange(float(SIZE))
        self.axes = axes
        path = np.stack([12 + 3 * second, 20 + np.sin(second), 4 + 0.3 * second], axis=1)
        self.snapshot, self.sensor = (part.ravel() for part in np.mgrid[:SIZE, : len(ANCHORS)])
        self.delay = np.round(rng.uniform(-0.3, 0.3, self.snapshot.size), 6)
        self.time = self.snapshot + self.delay
        place = np.stack([np.interp(self.time, second, axis) for axis in path.T], axis=1)[:, :axes]
        self.away = place - ANCHORS[self.sensor, :axes]
        self.length = np.sqrt(np.sum(self.away**2, axis=1))
        self.rng = rng
        self.mean = np.bincount(self.snapshot, self.time) / len(ANCHORS)
        self.start = np.concatenate([path[:, :axes], np.gradient(path[:, :axes], axis=0)], axis=1)

    def columns(self) -> dict[str, object]:
        """What every kind of measurement has."""
        names = ("sensor_x_m", "sensor_y_m", "sensor_z_m")[: self.axes]
        places = {name: ANCHORS[self.sensor, axis] for axis, name in enumerate(names)}
        ids = {"snapshot": self.snapshot, "time_s": self.time, "sensor": [f"s{k}" for k in self.sensor]}
        return {**ids, **places}

    def vectors(self, states: FloatArray) -> FloatArray:
        """From the sensor of each row to the source."""
        delay = (self.time - self.mean[self.snapshot])[:, None]
        own = states[self.snapshot]
        return own[:, : self.axes] + delay * own[:, self.axes :] - ANCHORS[self.sensor, : self.axes]

    def steps(self, states: FloatArray) -> FloatArray:
        """The whitened deviations of the motion."""
        parts, axes = [], self.axes
        for k, h in enumerate(np.diff(self.mean)):
            root = np.linalg.cholesky(Q * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]]))
            shift = states[k + 1, :axes] - states[k, :axes] - h * states[k, axes:]
            parts.append(np.linalg.solve(root, np.stack([shift, states[k + 1, axes:] - states[k, axes:]])).ravel())
        return np.concatenate(parts)

    def compare(self, table: dict[str, object], residuals: object, further: int = 0, **options: object) -> None:
        """Compare the path with scipy's: states within 1e-2 stds, covariances within 2e-3 of the trace."""
        whole = 2 * self.axes
        found = nlosctl.track(pa.table(table), acceleration_psd=Q, **options).estimates.to_pydict()
        position = np.stack([found[name] for name in ("x_m", "y_m", "z_m")[: self.axes]], axis=1)
        speed = np.stack([found[name] for name in ("vx_m_s", "vy_m_s", "vz_m_s")[: self.axes]], axis=1)

        def cost(flat: FloatArray) -> FloatArray:
            states = flat[: SIZE * whole].reshape(SIZE, whole)
            return np.concatenate([residuals(states, flat[SIZE * whole :]), self.steps(states)])

        first = np.concatenate([self.start.ravel(), np.full(further, 5.0)])
        best = least_squares(cost, first, xtol=1e-14, ftol=1e-14, gtol=1e-12)
        covariance = np.linalg.inv(best.jac.T @ best.jac)
        std = np.sqrt(np.diag(covariance))[: SIZE * whole].reshape(SIZE, whole)
        states = best.x[: SIZE * whole].reshape(SIZE, whole)
        assert np.abs((np.concatenate([position, speed], axis=1) - states) / std).max() < 1e-2
        entries = ("xx", "xy", "yy", "xz", "yz", "zz")[: self.axes * (self.axes + 1) // 2]
        lower = np.tril_indices(self.axes)
        for letter, unit, shift in (("", "m2", 0), ("v", "m2_s2", self.axes)):
            names = [f"cov_{letter}{name[0]}{letter}{name[1]}_{unit}" for name in entries]
            stated = np.stack([found[name] for name in names], axis=1)
            for k in range(SIZE):
                at = slice(k * whole + shift, k * whole + shift + self.axes)
                block = covariance[at, at]
                expected = np.array([block[i, j] for i, j in sorted(zip(*lower, strict=True))])
                assert np.abs(stated[k] - expected).max() < 2e-3 * np.trace(block)


def test_ranges_in_space() -> None:
    """Six ranges a snapshot determine a path in space."""
    world = World(1, 3)
    measured = world.length + 0.3 * world.rng.normal(size=world.length.size)
    table = {**world.columns(), "range_m": measured, "range_std_m": np.full(measured.size, 0.3)}
    world.compare(
        table, lambda states, _: (measured - np.linalg.norm(world.vectors(states), axis=1)) / 0.3, dimensions=3
    )


def test_azimuths_and_elevations_in_space() -> None:
    """Directions with elevations determine a path in space."""
    world, std = World(2, 3), np.radians(1.0)
    azimuth = np.arctan2(world.away[:, 1], world.away[:, 0]) + std * world.rng.normal(size=world.length.size)
    level = np.hypot(world.away[:, 0], world.away[:, 1])
    elevation = np.arctan2(world.away[:, 2], level) + std * world.rng.normal(size=world.length.size)
    stds = np.full(azimuth.size, std)
    table = {**world.columns(), "bearing_rad": azimuth, "bearing_std_rad": stds}
    table |= {"elevation_rad": elevation, "elevation_std_rad": stds}

    def residuals(states: FloatArray, _: FloatArray) -> FloatArray:
        x, y, z = world.vectors(states).T
        turn = (azimuth - np.arctan2(y, x) + np.pi) % (2 * np.pi) - np.pi
        return np.concatenate([turn, elevation - np.arctan2(z, np.hypot(x, y))]) / std

    world.compare(table, residuals)


@pytest.mark.parametrize("axes", [2, 3])
def test_arrivals_share_the_offset_of_their_snapshot(axes: int) -> None:
    """Each snapshot has an offset of its own, which the path does not know."""
    world = World(3, axes)
    offset = world.rng.uniform(0.0, 100.0, SIZE)
    measured = world.length + offset[world.snapshot] + 0.3 * world.rng.normal(size=world.length.size)
    table = {**world.columns(), "arrival_m": measured, "arrival_std_m": np.full(measured.size, 0.3)}

    def residuals(states: FloatArray, offsets: FloatArray) -> FloatArray:
        return (measured - np.linalg.norm(world.vectors(states), axis=1) - offsets[world.snapshot]) / 0.3

    world.compare(table, residuals, further=SIZE, dimensions=axes)


def test_late_arrivals_are_found_along_the_path() -> None:
    """The mixture leaves out late rows: the path is near that of the others, and flags name the late ones."""
    world = World(4, 2)
    late = np.arange(world.length.size) % 11 == 3
    measured = world.length + 50.0 + 0.3 * world.rng.normal(size=late.size) + 20.0 * late
    table = {**world.columns(), "arrival_m": measured, "arrival_std_m": np.full(late.size, 0.3)}
    found = nlosctl.track(pa.table(table), method="mixture-ml", acceleration_psd=Q, flags=True)
    assert (np.array(found.flags.column("los")) == ~late).mean() > 0.97
    states = found.estimates.to_pydict()
    off = np.hypot(states["x_m"] - world.start[:, 0], states["y_m"] - world.start[:, 1])
    assert off.max() < 1.0
    assert np.abs(np.array(found.flags.column("residual_m"))[late] - 20.0).max() < 2.0


def at_one_time(world: World, arrival_m: FloatArray) -> tuple[dict[str, object], dict[str, object]]:
    """Arrivals of each snapshot's one time, and the same as differences to the first sensor, which has no row."""
    arrivals = {**world.columns(), "time_s": world.snapshot.astype(float)}
    arrivals |= {"arrival_m": arrival_m, "arrival_std_m": np.full(arrival_m.size, 0.3)}
    others = world.sensor > 0
    first = arrival_m[world.sensor == 0][world.snapshot]
    kept = {name: np.asarray(values)[others] for name, values in arrivals.items()}
    del kept["arrival_m"]
    reference = {f"reference_{axis}_m": np.full(others.sum(), ANCHORS[0, n]) for n, axis in enumerate("xy")}
    return arrivals, {**kept, "tdoa_m": (arrival_m - first)[others], "reference": ["s0"] * others.sum(), **reference}


@pytest.mark.parametrize("method", ["ml", "mixture-ml"])
def test_differences_to_one_reference_are_arrivals(method: str) -> None:
    """The path, its covariances and the flags of differences to a sensor without a row are those of the arrivals."""
    world = World(5, 2)
    late = 20.0 * ((world.sensor > 0) & (np.arange(world.length.size) % 11 == 3)) * (method == "mixture-ml")
    place = np.hypot(*(world.start[world.snapshot, :2] - ANCHORS[world.sensor, :2]).T)
    arrivals, differences = at_one_time(world, place + 70.0 + 0.3 * world.rng.normal(size=late.size) + late)
    given = {"method": method, "acceleration_psd": Q, "flags": True}
    one = nlosctl.track(pa.table(arrivals), **given)
    other = nlosctl.track(pa.table(differences), **given)
    for name in ("x_m", "y_m", "vx_m_s", "cov_xy_m2", "cov_vyvy_m2_s2"):
        np.testing.assert_allclose(other.estimates[name].to_numpy(), one.estimates[name].to_numpy(), atol=1e-6)
    assert set(other.estimates["n_measurements"].to_pylist()) == {5}
    mine = pa.array(world.sensor > 0)
    for name in ("residual_m", *(["los_probability"] if method == "mixture-ml" else [])):
        expected = one.flags.filter(mine)[name].to_numpy()
        np.testing.assert_allclose(other.flags[name].to_numpy(), expected, atol=1e-6)


def of_pairs(world: World, references: FloatArray) -> tuple[dict[str, object], FloatArray]:
    """Differences of each row's sensor and another one, at the row's own time; the rows that take part."""
    rows = np.flatnonzero(world.sensor != references)
    other = world.away + ANCHORS[world.sensor, :2] - ANCHORS[references, :2]
    measured = (world.length - np.hypot(*other.T) + 0.3 * world.rng.normal(size=references.size))[rows]
    table = {name: np.asarray(values)[rows] for name, values in world.columns().items()}
    table |= {"tdoa_m": measured, "arrival_std_m": np.full(rows.size, 0.3)}
    table |= {"reference": [f"s{k}" for k in references[rows]]}
    table |= {f"reference_{axis}_m": ANCHORS[references[rows], n] for n, axis in enumerate("xy")}
    return table, rows


def test_differences_to_several_references_are_independent_rows() -> None:
    """The path through independent differences is that of scipy, each row at its own time."""
    world = World(6, 2)
    references = (world.sensor + 1 + world.snapshot % 2) % len(ANCHORS)
    table, rows = of_pairs(world, references)

    def residuals(states: FloatArray, _: FloatArray) -> FloatArray:
        away = world.vectors(states)
        back = away + ANCHORS[world.sensor, :2] - ANCHORS[references, :2]
        return (table["tdoa_m"] - (np.hypot(*away.T) - np.hypot(*back.T))[rows]) / 0.3

    world.compare(table, residuals)
    with pytest.raises(UsageError, match="several references, but method 'mixture-ml' needs one"):
        nlosctl.track(pa.table(table), method="mixture-ml", acceleration_psd=Q)


@pytest.mark.parametrize("several", [False, True])
def test_offsets_of_both_sensors_of_a_difference_are_unknowns(several: bool) -> None:
    """A track of one snapshot is the fix of localize with the same calibration, covariance included."""
    world = World(7, 2)
    if several:
        table, _ = of_pairs(world, (world.sensor + 1 + world.sensor % 2) % len(ANCHORS))
    else:
        _, table = at_one_time(world, world.length + 3.0 + 0.3 * world.rng.normal(size=world.length.size))
    table = pa.table(table)
    table = table.filter(pc.equal(table["snapshot"], 4)).set_column(1, "time_s", pa.array([0.0] * 5 + [0.0] * several))
    root = 0.5 * world.rng.normal(size=(6, 6))
    entries = tuple(SensorOffset(name=f"s{k}", offset=0.1 * k, std=1.0) for k in range(6))
    known = Calibration(kind="arrivals", entries=entries, order=tuple(range(6)), covariance=root @ root.T)
    track = nlosctl.track(table, acceleration_psd=Q, calibration=known).estimates
    fix = nlosctl.localize(table, method="ml", calibration=known).estimates
    for name in ("x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2"):
        assert track[name][0].as_py() == pytest.approx(fix[name][0].as_py(), rel=2e-3, abs=1e-3), name
