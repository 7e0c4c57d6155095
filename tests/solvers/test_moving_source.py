"""Position and velocity of sources that move within a snapshot, against scipy's minimizer, counts and closed cases."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from nlosctl.contract.batches import BearingBatch, RangeBatch
from nlosctl.contract.results import Solution
from nlosctl.contract.statuses import Status
from nlosctl.contract.tables import VELOCITY
from nlosctl.errors import UsageError
from nlosctl.methods import bearings_ml, ranges_r_ls
from nlosctl.models.sight import bearing_lines
from nlosctl.scenarios.ship import ShipOptions, generate
from nlosctl.solvers.tracking.moving_rows import MovingRows
from nlosctl.solvers.tracking.moving_starts import ray_origins
from nlosctl.solvers.tracking.trusted_rows import trusted_bearings

FloatArray = np.ndarray

CORNERS = np.array([[0.0, 0.0, 3.0], [100.0, 0.0, 8.0], [100.0, 80.0, 2.0], [0.0, 80.0, 20.0]])
BEARING_STD, RANGE_STD = np.radians(2.0), 1.0


class World:
    """Snapshots (B) of K rows, one sensor after the other; ``sensors`` (K, 3), sources move at some metres a second."""

    def __init__(self, kind: str, dimension: int, sensors: FloatArray | None = None, *, size: int = 60, rows: int = 24):
        rng = np.random.default_rng(8)
        sensors = CORNERS[np.arange(rows) % 4] if sensors is None else sensors
        rows = sensors.shape[0]
        self.kind, self.dimension = kind, dimension
        self.sensors = np.broadcast_to(sensors, (size, rows, 3))[..., :dimension]
        time = np.sort(rng.uniform(0.0, 8.0, (size, rows)), axis=1)
        self.elapsed = time - time.mean(axis=1, keepdims=True)
        low, high = np.array([10.0, 10.0, 5.0]), np.array([90.0, 70.0, 40.0])
        self.place = rng.uniform(low, high, (size, 3))[:, :dimension]
        self.velocity = rng.normal(0.0, 2.0, (size, dimension))
        self.noise = rng.standard_normal((2, size, rows))
        exact = self.predicted(self.place, self.velocity)
        std = self.std
        self.measured = [value + one * noise for value, one, noise in zip(exact, std, self.noise, strict=False)]

    @property
    def std(self) -> tuple[float, ...]:
        """The standard deviations of the measured scalars of a row."""
        return (RANGE_STD,) if self.kind == "ranges" else (BEARING_STD, BEARING_STD)[: self.dimension - 1]

    def predicted(self, place: FloatArray, velocity: FloatArray) -> list[FloatArray]:
        """The ranges, or azimuths and elevations (B, K), of sources at places (B, D)."""
        away = place[:, None] + self.elapsed[..., None] * velocity[:, None] - self.sensors
        if self.kind == "ranges":
            return [np.linalg.norm(away, axis=-1)]
        angles = [np.arctan2(away[..., 1], away[..., 0])]
        if self.dimension == 3:
            angles.append(np.arctan2(away[..., 2], np.hypot(away[..., 0], away[..., 1])))
        return angles

    def batch(self, **changes: Any) -> Any:
        """The measurements as a batch, with other fields."""
        size, rows = self.elapsed.shape
        number = np.tile(np.arange(rows), (size, 1))
        fields: dict[str, Any] = {
            "seed": np.zeros(size, dtype=np.uint64),
            "sensor": number,
            "sensor_xy_m": np.asfortranarray(self.sensors[..., :2]),
            "path": np.full((size, rows), -1),
            "reflector": np.full((size, rows), -1),
            "dimension": self.dimension,
            "elapsed_s": np.asfortranarray(self.elapsed),
        }
        if self.dimension == 3:
            fields["sensor_z_m"] = np.asfortranarray(self.sensors[..., 2])
        if self.kind == "ranges":
            fields |= {"range_m": self.measured[0], "range_std_m": np.full((size, rows), RANGE_STD)}
            return RangeBatch(**{**fields, "sensor_height_m": np.zeros((size, rows)), **changes})
        azimuth = np.angle(np.exp(1j * self.measured[0]))
        fields |= {"bearing_rad": azimuth, "bearing_std_rad": np.full((size, rows), BEARING_STD)}
        if self.dimension == 3:
            fields |= {"elevation_rad": self.measured[1], "elevation_std_rad": np.full((size, rows), BEARING_STD)}
        return BearingBatch(**{**fields, **changes})

    def by_scipy(self, snapshot: int) -> tuple[FloatArray, FloatArray]:
        """The state that minimizes the chi-square near the truth, and its covariance."""
        one, d = slice(snapshot, snapshot + 1), self.dimension

        def residuals(state: FloatArray) -> FloatArray:
            alone = World.__new__(World)
            alone.kind, alone.dimension = self.kind, d
            alone.elapsed, alone.sensors = self.elapsed[one], self.sensors[one]
            values = alone.predicted(state[None, :d], state[None, d:])
            parts = zip(self.measured, values, self.std, strict=True)
            return np.concatenate([(own[snapshot] - other[0]) / std for own, other, std in parts])

        truth = np.concatenate([self.place[snapshot], self.velocity[snapshot]])
        found = least_squares(residuals, truth, xtol=1e-12, ftol=1e-12, gtol=1e-12)
        return found.x, np.linalg.inv(found.jac.T @ found.jac)


def solve(batch: Any, **options: Any) -> Solution:
    """The solution of sources that move."""
    if isinstance(batch, RangeBatch):
        return ranges_r_ls.solve(batch, ranges_r_ls.RangeLeastSquaresOptions(motion="velocity", **options))
    return bearings_ml.solve(batch, bearings_ml.MaximumLikelihoodOptions(motion="velocity", **options))


def velocities(solution: Solution, dimension: int) -> tuple[FloatArray, FloatArray]:
    """Velocities (E, D) and the columns of their covariances (E, D (D + 1) / 2)."""
    names = [column.name for column in VELOCITY if dimension == 3 or not column.of_space]
    columns = [solution.estimates.columns[name] for name in names]
    return np.stack(columns[:dimension], axis=1), np.stack(columns[dimension:], axis=1)


def dense(columns: FloatArray) -> FloatArray:
    """Covariances (E, D, D) of their columns."""
    size = {3: 2, 6: 3}[columns.shape[1]]
    matrix = np.empty((columns.shape[0], size, size))
    for number, (one, other) in enumerate((i, j) for i in range(size) for j in range(i + 1)):
        matrix[:, one, other] = matrix[:, other, one] = columns[:, number]
    return matrix


def ships(turns: int, size: int = 120) -> tuple[BearingBatch, FloatArray, FloatArray]:
    """Snapshots of ships with so many turns, positions of the targets at the mean time, and velocities."""
    columns = generate(ShipOptions(turns=turns, bearings=31), np.random.default_rng(3), size)
    block = {name: values.reshape(size, 31) for name, values in columns.items()}
    none = np.full((size, 31), -1)
    batch = BearingBatch(
        seed=np.zeros(size, dtype=np.uint64),
        sensor=np.zeros((size, 31), dtype=np.int64),
        sensor_xy_m=np.asfortranarray(np.stack([block["sensor_x_m"], block["sensor_y_m"]], axis=2)),
        bearing_rad=np.asfortranarray(block["bearing_rad"]),
        bearing_std_rad=np.asfortranarray(block["bearing_std_rad"]),
        path=none,
        reflector=none,
        elapsed_s=np.asfortranarray(block["time_s"] - block["time_s"].mean(axis=1, keepdims=True)),
    )
    place = np.stack([block["truth_x_m"].mean(axis=1), block["truth_y_m"].mean(axis=1)], axis=1)
    return batch, place, np.stack([block["truth_vx_m_s"][:, 0], block["truth_vy_m_s"][:, 0]], axis=1)


@pytest.mark.parametrize(("kind", "dimension"), [("bearings", 2), ("bearings", 3), ("ranges", 2), ("ranges", 3)])
def test_states_and_covariances_are_those_of_scipy(kind: str, dimension: int) -> None:
    """Positions, velocities and both covariances agree with a minimizer that starts at the truth."""
    world = World(kind, dimension, size=6)
    solution = solve(world.batch())
    first = solution.estimates.alternative == 0
    speed, spread = velocities(solution, dimension)
    position, covariance = solution.estimates.position_m[first], dense(solution.estimates.covariance_m2[first])
    assert (solution.estimates.status[first] == Status.OK).all()
    for snapshot in range(6):
        state, wanted = world.by_scipy(snapshot)
        found = np.concatenate([position[snapshot], speed[first][snapshot]])
        assert np.abs((found - state) / np.sqrt(np.diag(wanted))).max() < 1e-3
        d = dimension
        np.testing.assert_allclose(covariance[snapshot], wanted[:d, :d], rtol=1e-2, atol=1e-3 * wanted[0, 0])
        np.testing.assert_allclose(dense(spread)[first][snapshot], wanted[d:, d:], rtol=1e-2, atol=1e-3 * wanted[d, d])


@pytest.mark.parametrize("dimension", [2, 3])
def test_derivatives_are_those_of_finite_differences(dimension: int) -> None:
    """The gradient by position and movement is the difference quotient of the cost."""
    world = World("bearings", dimension, size=5)
    batch = world.batch()
    lines: Any = bearing_lines(batch)
    rows = trusted_bearings(batch, use_ranges=True, lognormal=False).rows
    moving = MovingRows.of(rows, ray_origins(lines), batch.elapsed_s)
    place = (world.place + 1.0 - np.stack(lines.center, axis=1)).T
    state = [*place, *(world.velocity * moving.duration_s[:, None]).T]
    found = moving.evaluate(*state)
    for axis, slope in enumerate(found.gradient):
        ends = []
        for step in (-1e-4, 1e-4):
            moved = [part + step if number == axis else part for number, part in enumerate(state)]
            ends.append(moving.evaluate(*moved).cost)
        np.testing.assert_allclose(slope, (ends[1] - ends[0]) / 2e-4, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("turns", [1, 2])
def test_a_ship_that_turns_knows_what_it_knows(turns: int) -> None:
    """After turns mean NEES of position and velocity are 2, and 95 % of the positions inside their ellipses."""
    batch, place, velocity = ships(turns)
    solution = solve(batch)
    estimates, (speed, spread) = solution.estimates, velocities(solution, 2)
    chosen = (estimates.alternative == 0) & (estimates.status == Status.OK)
    assert chosen.sum() >= 114
    rows = estimates.row[chosen]
    away, faster = estimates.position_m[chosen] - place[rows], speed[chosen] - velocity[rows]
    nees = np.einsum("bi,bij,bj->b", away, np.linalg.inv(dense(estimates.covariance_m2[chosen])), away)
    nees_of_velocity = np.einsum("bi,bij,bj->b", faster, np.linalg.inv(dense(spread[chosen])), faster)
    error = 4.0 * 2.0 / np.sqrt(chosen.sum())  # four standard errors of the mean
    assert nees.mean() == pytest.approx(2.0, abs=error)
    assert nees_of_velocity.mean() == pytest.approx(2.0, abs=error)
    assert 0.89 <= (nees < 5.991).mean() <= 1.0


def test_a_straight_course_is_degenerate() -> None:
    """A ship that does not turn knows neither range nor speed: every snapshot is degenerate, without a number."""
    solution = solve(ships(0)[0])
    assert (solution.estimates.status == Status.DEGENERATE).all()
    assert np.isnan(solution.estimates.position_m).all()
    assert all(np.isnan(column).all() for column in solution.estimates.columns.values())
    assert solution.flags is not None
    assert not solution.flags.used.any()


@pytest.mark.parametrize("kind", ["bearings", "ranges"])
def test_one_place_and_one_time_are_degenerate(kind: str) -> None:
    """Rows from one place do not determine a velocity, nor do rows of one time."""
    one_place = World(kind, 2, np.zeros((12, 3)), size=20)
    assert np.isin(solve(one_place.batch()).estimates.status, (Status.DEGENERATE, Status.NOT_CONVERGED)).all()
    one_time = World(kind, 2, size=20)
    batch = one_time.batch(elapsed_s=np.zeros(one_time.elapsed.shape))
    assert (solve(batch).estimates.status == Status.DEGENERATE).all()


def test_bearings_of_the_opposite_sense_are_behind() -> None:
    """Bearings that are all turned by 180 degrees have no answer in front of the sensors."""
    world = World("bearings", 2, size=20)
    world.measured[0] = world.measured[0] + np.pi
    assert (solve(world.batch()).estimates.status == Status.BEHIND).all()


def test_a_straight_receiver_has_two_mirror_images() -> None:
    """Ranges from a straight line do not distinguish its sides: both images are given, and ambiguous."""
    line = np.stack([np.linspace(0.0, 100.0, 24), np.zeros(24), np.zeros(24)], axis=1)
    world = World("ranges", 2, line, size=20)
    estimates = solve(world.batch()).estimates
    assert (estimates.status == Status.AMBIGUOUS).all()
    one, other = (estimates.position_m[estimates.alternative == rank] for rank in (0, 1))
    np.testing.assert_allclose(one * [1.0, -1.0], other, atol=0.05)


def test_fewer_scalars_than_unknowns_are_too_few() -> None:
    """Three bearings do not make four unknowns; four do."""
    for rows, word in ((3, Status.TOO_FEW), (4, Status.OK)):
        estimates = solve(World("bearings", 2, size=10, rows=rows).batch()).estimates
        assert np.count_nonzero(estimates.status == word) >= 9


def test_a_radar_at_one_place_finds_a_moving_source() -> None:
    """Bearings with ranges from a single place determine position and velocity."""
    world = World("bearings", 2, np.zeros((16, 3)), size=30)
    ranges = World("ranges", 2, np.zeros((16, 3)), size=30)
    batch = world.batch(range_m=ranges.measured[0], range_std_m=np.full((30, 16), RANGE_STD))
    solution = solve(batch)
    estimates, (speed, spread) = solution.estimates, velocities(solution, 2)
    assert (estimates.status == Status.OK).all()
    faster = speed - world.velocity
    nees = np.einsum("bi,bij,bj->b", faster, np.linalg.inv(dense(spread)), faster)
    assert nees.mean() == pytest.approx(2.0, abs=4.0 * 2.0 / np.sqrt(30))


def test_a_snapshot_is_solved_alike_alone_and_in_a_block() -> None:
    """The bits of a snapshot do not depend on the others of its block."""
    batch, _, _ = ships(1, size=12)
    whole = solve(batch).estimates
    for snapshot in (0, 7):
        alone = solve(type(batch)(**{**vars(batch), **_rows(batch, snapshot)})).estimates
        mine = (whole.row == snapshot) & (whole.alternative == 0)
        assert (whole.position_m[mine] == alone.position_m[:1]).all()
        assert (whole.columns["cov_vxvy_m2_s2"][mine] == alone.columns["cov_vxvy_m2_s2"][:1]).all()


def _rows(batch: Any, snapshot: int) -> dict[str, Any]:
    arrays = {name: value for name, value in vars(batch).items() if isinstance(value, np.ndarray)}
    return {name: np.asfortranarray(value[snapshot : snapshot + 1]) for name, value in arrays.items()}


@pytest.mark.parametrize(
    ("changes", "options"),
    [({"elapsed_s": None}, {}), ({"std": "unknown"}, {}), ({}, {"law": "vonmises"}), ({}, {"feasible": True})],
)
def test_what_has_no_model_of_motion_is_refused(changes: dict[str, Any], options: dict[str, Any]) -> None:
    """Rows without times, unknown standard deviations, and other laws and constraints are usage errors."""
    with pytest.raises(UsageError, match="motion=velocity"):
        solve(World("bearings", 2, size=2).batch(**changes), **options)
