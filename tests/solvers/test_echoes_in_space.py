"""Unlabelled echoes in space: crossings of spheres, and targets with heights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import nlosctl.methods.ranges_assignment as assignment
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.fields import BoxField
from nlosctl.contract.statuses import Status
from nlosctl.geometry.regions import BoxRegion
from nlosctl.solvers.echoes.echoes import read_echoes
from nlosctl.solvers.echoes.sphere_crossings import cross_spheres
from nlosctl.solvers.echoes.type_sets import Gate

SENSORS = np.array([[0, 0, 3], [60, 0, 25], [60, 50, 4], [0, 50, 28], [30, -10, 15], [30, 60, 9], [-10, 25, 20.0]])
STD_M = 0.1
FIELD = BoxField(xmin_m=0.0, xmax_m=60.0, ymin_m=0.0, ymax_m=50.0, zmin_m=0.0, zmax_m=30.0)


def echo_batch(generator, snapshots, targets, clutter, sensors=SENSORS, std_m=STD_M):
    """Return a batch of an echo per sensor and target, and clutter, in random order; the targets; each echo's one."""
    count = len(sensors)
    truth = generator.uniform([5.0, 5.0, 2.0], [55.0, 45.0, 28.0], (snapshots, targets, 3))
    ranges = np.linalg.norm(truth[:, :, None] - sensors, axis=-1) + std_m * generator.normal(
        size=(snapshots, targets, count)
    )
    extra = generator.uniform(5.0, 80.0, (snapshots, clutter, count))
    values = np.concatenate([ranges, extra], axis=1).reshape(snapshots, -1)
    sensor = np.tile(np.arange(count), targets + clutter)
    label = np.repeat([*range(targets), *[-1] * clutter], count)
    order = np.array([generator.permutation(sensor.size) for _ in range(snapshots)])
    place = sensors[sensor[order]]
    shape = order.shape
    return (
        RangeBatch(
            dimension=3,
            field=FIELD,
            seed=np.zeros(snapshots, dtype=np.uint64),
            sensor=np.asfortranarray(sensor[order]),
            sensor_xy_m=np.asfortranarray(place[..., :2]),
            sensor_z_m=np.asfortranarray(place[..., 2]),
            range_m=np.asfortranarray(np.take_along_axis(values, order, axis=1)),
            range_std_m=np.full(shape, std_m, order="F"),
            path=np.zeros(shape, dtype=np.int64, order="F"),
            sensor_height_m=np.zeros(shape, order="F"),
        ),
        truth,
        label[order],
    )


def test_crossings_of_spheres_hold_the_target():
    """Among the crossings of noise-free spheres of every three sensors is the target, and each is on its spheres."""
    batch, truth, _ = echo_batch(np.random.default_rng(1), 1, 1, 0, std_m=1e-9)
    echoes = read_echoes(batch, 0, 10)
    box = BoxRegion(tuple(np.full(1, -100.0) for _ in range(3)), tuple(np.full(1, 100.0) for _ in range(3)))
    points = np.stack(cross_spheres(echoes, 7, Gate(box, 0.0)), axis=1) + echoes.center
    distance = np.linalg.norm(points - truth[0, 0], axis=1)
    assert (distance < 1e-5).sum() >= 4
    on_spheres = np.abs(
        np.linalg.norm(points[:, None] - SENSORS, axis=2) - np.linalg.norm(truth[0, 0] - SENSORS, axis=1)
    )
    assert ((on_spheres < 1e-5).sum(axis=1) >= 3).all()


@pytest.mark.parametrize(("targets", "clutter"), [(1, 0), (2, 2), (3, 2)])
def test_targets_in_space_are_found_among_clutter(targets, clutter):
    """Nearly all targets are found with their own echoes, their covariances are true, and nothing else is flagged."""
    generator = np.random.default_rng(2)
    batch, truth, label = echo_batch(generator, 25, targets, clutter)
    solution = assignment.solve(batch, assignment.AssignmentOptions())
    estimates = solution.estimates
    best = estimates.alternative == 0
    found = best & np.isin(estimates.status, [Status.OK])
    assert found.sum() >= 0.95 * 25 * targets
    errors = []
    for row, position, packed in zip(
        estimates.row[found], estimates.position_m[found], estimates.covariance_m2[found], strict=True
    ):
        error = position - truth[row][np.argmin(np.linalg.norm(truth[row] - position, axis=1))]
        xx, xy, yy, xz, yz, zz = packed
        errors.append(error @ np.linalg.solve([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], error))
    assert np.mean(np.array(errors) < 7.815) > 0.88
    los = solution.flags.columns["los"]
    assert (los == (label >= 0)).mean() > 0.95


def test_coplanar_sensors_leave_mirror_images_to_the_search_region():
    """Sensors on a ceiling see a target and its image above; the search region's heights exclude the image."""
    sensors = np.column_stack([SENSORS[:, :2], np.full(7, 30.0)])
    batch, truth, _ = echo_batch(np.random.default_rng(3), 10, 1, 0, sensors)
    estimates = assignment.solve(batch, assignment.AssignmentOptions(field_margin_m=0.0)).estimates
    first = estimates.alternative == 0
    assert np.quantile(np.linalg.norm(estimates.position_m[first] - truth[estimates.row[first], 0], axis=1), 0.8) < 1.0


def test_three_sensors_are_too_few_in_space():
    """Three ranges fit any three echoes: too_few."""
    batch, _, _ = echo_batch(np.random.default_rng(4), 2, 1, 1, SENSORS[:3])
    estimates = assignment.solve(batch, assignment.AssignmentOptions()).estimates
    assert estimates.status.tolist() == [Status.TOO_FEW, Status.TOO_FEW]
    assert estimates.position_m.shape == (2, 3)


def at_one_height(batch, truth, std_m, seed=5):
    """Return the batch of targets that are all at 10 m, with that height measured."""
    height = 10.0 + std_m * np.random.default_rng(seed).standard_normal(batch.size)
    return replace(batch, target_z_m=height, target_z_std_m=np.full(batch.size, std_m))


def level_echoes(snapshots, targets, clutter, sensors, seed=11):
    """Return a batch and its targets, all at a height of 10 m."""
    generator = np.random.default_rng(seed)
    truth = generator.uniform([5.0, 5.0, 10.0], [55.0, 45.0, 10.0], (snapshots, targets, 3))
    count = len(sensors)
    ranges = np.linalg.norm(truth[:, :, None] - sensors, axis=-1) + STD_M * generator.normal(
        size=(snapshots, targets, count)
    )
    extra = generator.uniform(5.0, 80.0, (snapshots, clutter, count))
    values = np.concatenate([ranges, extra], axis=1).reshape(snapshots, -1)
    batch, _, _ = echo_batch(generator, snapshots, targets, clutter, sensors)
    sensor = np.broadcast_to(np.tile(np.arange(count), targets + clutter), values.shape)
    place = sensors[sensor]
    moved = replace(
        batch,
        sensor=np.asfortranarray(sensor),
        sensor_xy_m=np.asfortranarray(place[..., :2]),
        sensor_z_m=np.asfortranarray(place[..., 2]),
        range_m=np.asfortranarray(values),
    )
    return moved, truth


@pytest.mark.parametrize("std_m", [0.0, 0.3])
@pytest.mark.parametrize(("sensors", "clutter"), [(SENSORS, 2), (SENSORS[:4], 0)])
def test_targets_have_their_measured_height(std_m, sensors, clutter):
    """Two targets at a measured height are found among clutter, with true covariances and the height's own spread."""
    batch, truth = level_echoes(25, 2, clutter, sensors)
    solution = assignment.solve(at_one_height(batch, truth, std_m), assignment.AssignmentOptions())
    estimates = solution.estimates
    found = (estimates.alternative == 0) & (estimates.status == Status.OK)
    assert found.sum() >= 0.9 * 50
    errors = []
    for row, position, packed in zip(
        estimates.row[found], estimates.position_m[found], estimates.covariance_m2[found], strict=True
    ):
        error = position - truth[row][np.argmin(np.linalg.norm(truth[row] - position, axis=1))]
        xx, xy, yy, xz, yz, zz = packed
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        size = 3 if std_m else 2
        errors.append(error[:size] @ np.linalg.solve(matrix[:size, :size], error[:size]))
    assert np.mean(np.array(errors) < (7.815 if std_m else 5.991)) > 0.88
    z, variance = estimates.position_m[found, 2], estimates.covariance_m2[found, 5]
    if std_m:
        assert variance.max() < std_m**2
        assert np.sqrt(np.mean((z - 10.0) ** 2)) < std_m
    else:
        np.testing.assert_array_equal(z, 10.0)
        np.testing.assert_array_equal(variance, 0.0)


def test_a_height_takes_the_place_of_a_fourth_sensor():
    """Three sensors and a height determine a target, three sensors alone are too few."""
    batch, truth = level_echoes(20, 1, 0, SENSORS[:3])
    alone = assignment.solve(batch, assignment.AssignmentOptions()).estimates
    assert set(alone.status) == {Status.TOO_FEW}
    options = assignment.AssignmentOptions(least_evidence=0.0)
    with_height = assignment.solve(at_one_height(batch, truth, 0.3), options).estimates
    found = (with_height.alternative == 0) & np.isin(with_height.status, [Status.OK, Status.AMBIGUOUS])
    assert found.mean() > 0.5
    away = with_height.position_m[found] - truth[with_height.row[found], 0]
    assert np.median(np.linalg.norm(away, axis=1)) < 0.5
