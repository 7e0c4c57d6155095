"""Outlier suppression: several paths per sensor, rivals beyond the random pairs, covariances."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from outlier_worlds import mixture_cost, ring_batch, without_flags

import nlosctl
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import BoxField
from nlosctl.contract.statuses import Status
from nlosctl.methods import bearings_suppress
from nlosctl.methods.bearings_suppress import SuppressOptions

FloatArray = npt.NDArray[np.float64]


def paths_batch(
    snapshots: int, sensors: int, paths: int, alpha: float, std_deg: float
) -> tuple[FloatArray, BearingBatch]:
    """Return true positions and a batch in a 2 km square: sensors and source anywhere, at most one path direct.

    A sensor's direct path is blocked with probability ``alpha``; the other paths point anywhere.
    """
    generator = np.random.default_rng(sensors)
    sensor_xy = generator.uniform(-1000.0, 1000.0, (snapshots, sensors, 2))
    source = generator.uniform(-1000.0, 1000.0, (snapshots, 2))
    offset = source[:, None] - sensor_xy
    shape = (snapshots, sensors, paths)
    direct = (generator.random(shape[:2]) >= alpha)[..., None]
    direct = direct & (generator.integers(0, paths, shape[:2])[..., None] == np.arange(paths))
    true_bearing = np.arctan2(offset[..., 1], offset[..., 0])[..., None]
    error = np.radians(std_deg) * generator.standard_normal(shape)
    bearing = np.where(direct, true_bearing + error, generator.uniform(-np.pi, np.pi, shape))
    rows = sensors * paths
    batch = BearingBatch(
        seed=np.arange(snapshots, dtype=np.uint64),
        field=BoxField(xmin_m=-1000.0, xmax_m=1000.0, ymin_m=-1000.0, ymax_m=1000.0),
        sensor=np.asfortranarray(np.tile(np.repeat(np.arange(sensors), paths), (snapshots, 1))),
        sensor_xy_m=np.asfortranarray(np.repeat(sensor_xy, paths, axis=1)),
        bearing_rad=np.asfortranarray(bearing.reshape(snapshots, rows)),
        bearing_std_rad=np.full((snapshots, rows), np.radians(std_deg), order="F"),
        path=np.asfortranarray(np.tile(np.tile(np.arange(paths), sensors), (snapshots, 1))),
        reflector=np.full((snapshots, rows), -1, order="F"),
        want_flags=False,
    )
    return source, batch


@pytest.mark.parametrize(
    ("sensors", "paths", "alpha", "snapshots", "limit"),
    [
        (4, 2, 0.1, 2000, 0.035),
        (6, 3, 0.1, 500, 0.012),
        pytest.param(10, 4, 0.25, 400, 0.005, marks=pytest.mark.extensive),
    ],
)
def test_fixes_that_are_ok_are_right_with_several_paths(
    sensors: int, paths: int, alpha: float, snapshots: int, limit: float
) -> None:
    """Few fixes that are `ok` are off by more than 200 m in a field of 2 km, and most best fixes are right."""
    source, batch = paths_batch(snapshots, sensors, paths, alpha, 1.0)
    estimates = bearings_suppress.solve(batch, SuppressOptions(alpha=alpha, field_of_view_deg=360.0)).estimates
    first = estimates.alternative == 0
    error = np.hypot(*(estimates.position_m[first] - source).T)
    ok = estimates.status[first] == Status.OK
    assert np.mean(error[ok] > 200.0) <= limit
    assert np.mean(error < 200.0) > 0.88
    assert np.mean(ok) > 0.05


def test_likeliest_crossings_make_up_for_few_random_pairs() -> None:
    """With a single random pair the best fix is at most a nat costlier than the source, if rivals are tried."""
    truth, batch, _ = ring_batch(12, 300, bearing_std_deg=2.0, nlos_receivers=2, sources="disc")
    at_truth = mixture_cost(batch, truth, 0.25)
    worse = {}
    for rivals in (0, 10):
        options = SuppressOptions(bootstraps=1, rivals=rivals, acceptance="likelihood")
        estimates = bearings_suppress.solve(without_flags(batch), options).estimates
        worse[rivals] = np.mean(estimates.cost[estimates.alternative == 0] > at_truth + 1.0)
    assert worse[10] < 0.01
    assert worse[0] > 0.15


def test_results_do_not_depend_on_the_block() -> None:
    """A snapshot has the same bytes alone, in another order and among snapshots with other numbers of pairs."""
    _, batch = paths_batch(12, 4, 2, 0.1, 1.0)
    path, sensor = (np.asfortranarray(part.copy()) for part in (batch.path, batch.sensor))
    sensor[::2], path[::2] = np.arange(8), 0  # one path per sensor: other groups, other bootstraps
    batch = dataclasses.replace(batch, path=path, sensor=sensor)
    whole = bearings_suppress.solve(batch, SuppressOptions(alpha=0.1)).estimates
    for row in range(12):
        alone = bearings_suppress.solve(_take(batch, np.array([row])), SuppressOptions(alpha=0.1)).estimates
        mine = whole.row == row
        for name in ("position_m", "covariance_m2", "cost", "status"):
            np.testing.assert_array_equal(getattr(alone, name), getattr(whole, name)[mine])


def _take(batch: BearingBatch, rows: npt.NDArray[np.int64]) -> BearingBatch:
    names = ("seed", "sensor", "sensor_xy_m", "bearing_rad", "bearing_std_rad", "path", "reflector")
    return dataclasses.replace(batch, **{name: np.asfortranarray(getattr(batch, name)[rows]) for name in names})


def _nees(scenario: str, method: str, trials: int, **parameters: Any) -> FloatArray:
    """Return the NEES of the fixes of a simulated scenario that are `ok`."""
    table = nlosctl.simulate(scenario, trials=trials, seed=3, **parameters)
    options = {"alpha": 0.05, "rivals": 0} if method == "suppress" else {}
    field = "sensors:3" if method == "suppress" else "sensors:1"
    found = nlosctl.localize(table, method=method, field=field, **options).estimates

    def values(name: str) -> FloatArray:
        return np.asarray(found.column(name).to_numpy(zero_copy_only=False), dtype=float)

    ok = np.array(found.column("status").to_pylist()) == "ok"
    dx, dy = values("x_m") - values("truth_x_m"), values("y_m") - values("truth_y_m")
    xx, xy, yy = values("cov_xx_m2"), values("cov_xy_m2"), values("cov_yy_m2")
    return np.asarray(((yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy))[ok])


@pytest.mark.parametrize("method", ["suppress", "sequential"])
def test_covariances_on_circles_know_the_focusing(method: str) -> None:
    """The NEES of rows by a circle is 2 within 10 %: 0.93 if the width of a ray tube is taken to be its range."""
    nees = _nees("song-circle", method, 3000)
    assert nees.size > 2900
    assert nees.mean() == pytest.approx(2.0, rel=0.1)
    assert 0.93 < np.mean(nees < 5.991) < 0.97


def test_covariance_is_wider_near_a_sensor() -> None:
    """Among random sensors at 10 deg few `ok` fixes have a NEES over 100, though some are next to a sensor."""
    parameters = {"sensors": 8, "mirrors": 0, "bearing_std_deg": (10.0, 10.0)}
    nees = _nees("random", "suppress", 1500, **parameters)
    assert nees.size > 1200
    assert np.mean(nees > 100.0) < 0.003
    assert np.mean(nees < 5.991) > 0.87


@pytest.mark.parametrize(
    ("parameters", "probability"),
    [({"alpha": 0.1}, "0.0037"), ({"alpha": 0.01, "bootstraps": 12}, "0.011"), ({"alpha": 0.01}, None)],
)
def test_the_summary_states_the_probability_of_no_right_pair(
    parameters: dict[str, float], probability: str | None
) -> None:
    """4 sensors: under two have a direct path with .1^4 + 4 x .9 x .1^3; 12 of 24 pairs may miss every right one."""
    table = nlosctl.simulate("madhow-ring", trials=3, seed=1, sensors=4, paths=2)
    notes = nlosctl.localize(table, method="suppress", field="circle:0,0,1", **parameters).report.notes  # type: ignore[arg-type]
    stated = [note for note in notes if "two direct paths" in note]
    assert len(stated) == (probability is not None)
    if probability is not None:
        assert "in 3 of 3 snapshots the probability" in stated[0]
        assert f"is {probability} on average" in stated[0]


def test_one_sensor_with_several_paths_has_no_pair() -> None:
    """Paths of a single sensor are never two direct ones: no candidate, not an error."""
    _, batch = paths_batch(3, 1, 4, 0.1, 1.0)
    estimates = bearings_suppress.solve(batch, SuppressOptions()).estimates
    assert (estimates.status >= Status.DEGENERATE).all()
    assert np.isnan(estimates.position_m).all()
