"""The mixture likelihood and its modes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from outlier_worlds import mixture_cost, ring_batch, without_flags

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import SensorsField
from nlosctl.methods import bearings_mixture_ml
from nlosctl.methods.bearings_mixture_ml import MixtureOptions
from nlosctl.solvers.mixture.outlier_model import OutlierModel, grouped_batch, outlier_model
from nlosctl.solvers.mixture.path_groups import group_paths


def _model(batch: BearingBatch, *, lognormal: bool = False, path_prior: str = "uniform") -> OutlierModel:
    noise = "lognormal" if lognormal else "gaussian"
    return outlier_model(*grouped_batch(batch), MixtureOptions(range_noise=noise, path_prior=path_prior))  # type: ignore[arg-type]


@pytest.mark.parametrize("paths", [1, 2])
def test_cost_is_equation_23_and_its_wideband_form(paths: int) -> None:
    """The cost is minus (23); with several paths it is the form with the direct one summed out, (5)."""
    _, batch, _ = ring_batch(1, 40, paths=paths, alpha=0.3, sources="disc")
    model = _model(batch)
    xy = np.random.default_rng(2).uniform(-0.6, 0.6, (40, 2))
    x, y = xy[:, 0] - model.lines.center_x, xy[:, 1] - model.lines.center_y
    expected = mixture_cost(batch, xy, 0.25)
    at = model.mixture.evaluate(x, y)
    np.testing.assert_allclose(at.cost + model.mixture.least_cost, expected, rtol=1e-9)
    scored = model.mixture.score(x[:, None], y[:, None])[:, 0]
    np.testing.assert_allclose(scored, expected, atol=0.05)


@pytest.mark.parametrize("paths", [1, 3])
@pytest.mark.parametrize("noise", ["none", "gaussian", "lognormal"])
def test_derivatives_agree_with_finite_differences(paths: int, noise: str) -> None:
    """Gradient and second derivatives agree with finite differences, with or without ranges and groups."""
    share = 0.0 if noise == "none" else 0.05
    truth, batch, _ = ring_batch(3, 30, paths=paths, alpha=0.2, sources="disc", range_std_share=share)
    model = _model(batch, lognormal=noise == "lognormal")
    generator = np.random.default_rng(4)
    x = truth[:, 0] - model.lines.center_x + generator.normal(scale=0.02, size=30)
    y = truth[:, 1] - model.lines.center_y + generator.normal(scale=0.02, size=30)
    step = 1e-6
    at = model.mixture.evaluate(x, y)
    right, left = model.mixture.evaluate(x + step, y), model.mixture.evaluate(x - step, y)
    up, down = model.mixture.evaluate(x, y + step), model.mixture.evaluate(x, y - step)
    scale = np.abs(at.gradient_x) + np.abs(at.gradient_y) + 1.0
    assert np.max(np.abs((right.cost - left.cost) / (2.0 * step) - at.gradient_x) / scale) < 1e-5
    assert np.max(np.abs((up.cost - down.cost) / (2.0 * step) - at.gradient_y) / scale) < 1e-5
    numeric = {
        "xx": (right.gradient_x - left.gradient_x) / (2.0 * step),
        "xy": (right.gradient_y - left.gradient_y) / (2.0 * step),
        "yy": (up.gradient_y - down.gradient_y) / (2.0 * step),
    }
    positive = (numeric["xx"] > 0.0) & (
        numeric["xx"] * numeric["yy"] - numeric["xy"] ** 2 > 0.5 * at.hessian.determinant
    )
    assert positive.sum() > 10
    for name, values in numeric.items():
        error = np.abs(values - getattr(at.hessian, name)) / at.hessian.trace
        assert np.max(error[positive]) < 1e-4, name


def test_responsibilities_and_the_outlier_sum_to_one() -> None:
    """At most one path of a sensor is direct: probabilities sum to less than one, and to one with "none"."""
    truth, batch, _ = ring_batch(5, 50, paths=3, alpha=0.3, sources="disc")
    model = _model(batch)
    probability, _ = model.mixture.responsibilities(
        truth[:, 0] - model.lines.center_x, truth[:, 1] - model.lines.center_y
    )
    groups = probability.reshape(50, 8, 3).sum(axis=2)
    assert np.all(groups < 1.0)
    assert np.median(groups.max(axis=1)) > 0.9


@pytest.mark.parametrize(("options", "share"), [({"nlos_receivers": 2}, 0.99), ({"paths": 2, "alpha": 0.1}, 0.98)])
def test_modes_reach_the_global_optimum(options: dict[str, float], share: float) -> None:
    """The cost is within 0.05 nats of the best point of a fine grid with local descent."""
    _, batch, _ = ring_batch(6, 60, bearing_std_deg=4.0, sources="disc", **options)
    estimates = bearings_mixture_ml.solve(without_flags(batch), MixtureOptions()).estimates
    cost = estimates.cost[estimates.alternative == 0]
    axis = np.linspace(-1.0, 1.0, 101)
    grid = np.stack([part.ravel() for part in np.meshgrid(axis, axis)], axis=1)
    grid = grid[np.hypot(*grid.T) < 0.99]
    model = _model(batch)
    x = grid[None, :, 0] - model.lines.center_x[:, None]
    y = grid[None, :, 1] - model.lines.center_y[:, None]
    for spacing in (0.02, 0.0025, 0.0003, 0.00004):  # from the best few points, by ever finer steps
        scored = model.mixture.score(x, y)
        place = np.argsort(scored, axis=1)[:, :8]
        best_x, best_y = np.take_along_axis(x, place, axis=1), np.take_along_axis(y, place, axis=1)
        offset = np.linspace(-spacing, spacing, 17)
        dx, dy = (part.ravel() for part in np.meshgrid(offset, offset))
        x = (best_x[:, :, None] + dx).reshape(batch.size, -1)
        y = (best_y[:, :, None] + dy).reshape(batch.size, -1)
    reference = model.mixture.score(x, y).min(axis=1)
    assert np.mean(cost - reference < 0.05) >= share


def test_first_arrival_prior_ignores_later_paths() -> None:
    """With ``path_prior=first`` only the lowest path number of a sensor may be direct, in any order of the rows."""
    _, batch, _ = ring_batch(7, 30, paths=2, sources="disc")
    flipped = dataclasses.replace(
        batch,
        **{
            name: np.asfortranarray(getattr(batch, name)[:, ::-1])
            for name in ("sensor", "sensor_xy_m", "bearing_rad", "bearing_std_rad", "path", "reflector")
        },
    )
    one, other = (bearings_mixture_ml.solve(b, MixtureOptions(path_prior="first")) for b in (batch, flipped))
    assert one.flags is not None
    assert not np.asarray(one.flags.used)[batch.path > 0].any()
    assert np.asarray(one.flags.used)[batch.path == 0].any()
    assert other.flags is not None
    assert np.array_equal(one.flags.used, np.asarray(other.flags.used)[:, ::-1])


def test_groups_agree_with_a_comparison_of_all_pairs() -> None:
    """Leader, rank and size of each row follow from comparing it with every other row of its snapshot."""
    generator = np.random.default_rng(8)
    for _ in range(200):
        shape = (int(generator.integers(1, 5)), int(generator.integers(1, 10)))
        keys = [
            generator.integers(0, 3, shape),
            np.where(generator.random(shape) < 0.5, -0.0, 1.5),
            np.where(generator.random(shape) < 0.5, 0.0, -0.0),
        ]
        path = generator.integers(-1, 3, shape)
        groups = group_paths(keys, path)
        for b, k in np.ndindex(shape):
            rivals = [j for j in range(shape[1]) if all(key[b, j] == key[b, k] for key in keys)]
            assert groups.leader[b, k] == min(rivals)
            assert groups.size[b, k] == len(rivals)
            assert groups.rank[b, k] == sum((path[b, j], j) < (path[b, k], k) for j in rivals)
        ordered = [groups.leader[b, groups.order[b]] for b in range(shape[0])] if groups.order is not None else []
        assert all(np.all(np.diff(leaders) >= 0) for leaders in ordered)
        assert (groups.order is None) == bool((groups.size == 1).all())


def drive(rows: int, seed: int) -> BearingBatch:
    """Return one snapshot of a moving sensor at ``rows`` points of a circle of 500 m, 5 deg, 30 % outliers."""
    generator = np.random.default_rng(seed)
    around = np.linspace(0.0, 2.0 * np.pi, rows, endpoint=False)
    sensor_xy = 500.0 * np.stack([np.cos(around), np.sin(around)], axis=-1)
    bearing = np.arctan2(170.0 - sensor_xy[:, 1], -60.0 - sensor_xy[:, 0])
    bearing += np.radians(5.0) * generator.normal(size=rows)
    bearing = np.where(generator.random(rows) < 0.3, generator.uniform(-np.pi, np.pi, rows), bearing)
    number = np.zeros((1, rows), dtype=np.int64)
    return BearingBatch(
        seed=np.zeros(1, dtype=np.uint64),
        field=SensorsField(factor=1.0),
        sensor=number,
        sensor_xy_m=sensor_xy[None],
        bearing_rad=bearing[None],
        bearing_std_rad=np.full((1, rows), np.radians(5.0)),
        path=number - 1,
        reflector=number - 1,
    )


def test_a_drive_has_one_fix_in_any_order_of_its_rows() -> None:
    """Of 2400 rows of one sensor the same are used in any order, and the fix moves by less than .01 std."""
    batch = drive(2400, 3)
    one = bearings_mixture_ml.solve(batch, MixtureOptions())
    covariance, position = one.estimates.covariance_m2[0], one.estimates.position_m[0]
    assert np.hypot(*(position - (-60.0, 170.0))) < 5.0
    for seed in (1, 2):
        order = np.random.default_rng(seed).permutation(2400)
        names = ("sensor", "sensor_xy_m", "bearing_rad", "bearing_std_rad", "path", "reflector")
        shuffled = dataclasses.replace(batch, **{name: getattr(batch, name)[:, order] for name in names})
        other = bearings_mixture_ml.solve(shuffled, MixtureOptions())
        offset = other.estimates.position_m[0] - position
        matrix = np.array([[covariance[0], covariance[1]], [covariance[1], covariance[2]]])
        assert offset @ np.linalg.solve(matrix, offset) < 0.01**2
        assert one.flags is not None
        assert other.flags is not None
        np.testing.assert_array_equal(np.asarray(other.flags.used)[0], np.asarray(one.flags.used)[0, order])
