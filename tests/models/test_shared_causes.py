"""Errors that rows share, against central differences of predictions whose geometry is moved."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from arrival_batches import arrival_batch
from batches import bearing_batch, range_batch
from uncertain_worlds import IN_SPACE, WORLDS, World, differences, sample

from nlosctl.contract.scene import CircleReflector, Scene
from nlosctl.models.bearing_predictions import predict_bearings
from nlosctl.models.shared_causes.causes import SensorCauses, SharedCauses
from nlosctl.models.shared_causes.joint_rows import joint_rows


def causes_of(world: World, sensor: np.ndarray) -> SharedCauses:
    """Return the causes of a world for rows of the sensors (B, K)."""
    full = np.ones(sensor.shape)
    entry = np.full(sensor.shape, -1, dtype=np.int64)
    sensors = SensorCauses(sensor, world.position_std_m * full, world.offset_std * full, 0.0 * full, entry)
    return SharedCauses(sensors, np.zeros((0, 0)), mirrors=bool(world.mirrors))


def batch_of(world: World, sources: np.ndarray, values: np.ndarray):
    """Return the batch of the scalars (B, M) of a world."""
    sensor = np.asfortranarray(np.broadcast_to([number for number, _ in world.paths], (len(sources), len(world.paths))))
    reflector = np.asfortranarray(np.broadcast_to([mirror for _, mirror in world.paths], sensor.shape))
    place = world.sensors[sensor]
    if world.kind == "arrivals":
        return dataclasses.replace(arrival_batch(place, values, world.std), sensor=sensor)
    more = {"dimension": world.dimension, "sensor": sensor, "reflector": reflector, "scene": world.scene()}
    if world.dimension == 3:
        more["sensor_z_m"] = np.asfortranarray(place[..., 2])
    if world.kind == "ranges":
        return dataclasses.replace(range_batch(place[..., :2], values, world.std), **more)
    if world.dimension == 3:
        more |= {"elevation_rad": values[:, 1::2], "elevation_std_rad": np.full(sensor.shape, world.std)}
        values = values[:, 0::2]
    return dataclasses.replace(bearing_batch(place[..., :2], values, world.std), **more)


@pytest.mark.parametrize("name", [*WORLDS, *IN_SPACE])
def test_shared_covariances_are_those_of_moved_geometry(name: str) -> None:
    """Places, offsets and mirrors, moved by central differences, give the covariance of the rows' errors."""
    world = {**WORLDS, **IN_SPACE}[name]
    _, sources, values = sample(world, 4, seed=3)
    batch = batch_of(world, sources, values)
    rows = joint_rows(world.kind, batch, causes_of(world, batch.sensor), sources, with_ranges=False)
    stds = world.causes()
    for number, source in enumerate(sources):
        effect = differences(lambda c, at=source: world.predict(at, c), np.zeros(stds.size)) * stds / world.std
        expected = effect @ effect.T
        if world.kind == "bearings" and world.dimension == 3:
            order = [*range(0, 2 * len(world.paths), 2), *range(1, 2 * len(world.paths), 2)]
            expected = expected[np.ix_(order, order)]
        if world.kind == "bearings":
            mirrored = np.array([mirror >= 0 and world.dimension == 2 for _, mirror in world.paths])
            turned = np.where(np.resize(mirrored, len(expected)), -1.0, 1.0)  # an unfolded row turns the other way
            expected = expected * turned[:, None] * turned
        np.testing.assert_allclose(rows.shared[number], expected, rtol=1e-5, atol=1e-6 * expected.max())


def test_rows_by_a_circle_by_central_differences() -> None:
    """A row by a circle changes with its sensor and the radius as the prediction of its bearing does."""
    scene = Scene(reflectors=(CircleReflector(name="c", center=(0.0, 0.0), radius=1000.0, radius_std_m=20.0),))
    sensor, source = np.array([[-350.0, -250.0], [380.0, -200.0]]), np.array([[20.0, 300.0]])

    def predicted(place, of_scene):
        return predict_bearings(place, np.zeros(2, dtype=np.int64), of_scene, np.broadcast_to(source, (2, 2)))

    measured = predicted(sensor, scene) + np.array([0.01, -0.02])
    batch = bearing_batch(sensor, measured[None], 0.01, reflector=0, scene=scene)
    full = np.ones((1, 2))
    sensors = SensorCauses(batch.sensor, 5.0 * full, 0.0 * full, 0.0 * full, np.full((1, 2), -1))
    rows = joint_rows(
        "bearings", batch, SharedCauses(sensors, np.zeros((0, 0)), mirrors=True), source, with_ranges=False
    )
    effect = np.zeros((2, 5))
    for axis in range(2):
        by = np.zeros((2, 2))
        by[:, axis] = 1e-3
        change = (predicted(sensor + by, scene) - predicted(sensor - by, scene)) / 2e-3 * 5.0
        effect[0, axis], effect[1, 2 + axis] = change
    grown = [Scene(reflectors=(dataclasses.replace(scene.reflectors[0], radius=1000.0 + by),)) for by in (1e-3, -1e-3)]
    effect[:, 4] = (predicted(sensor, grown[0]) - predicted(sensor, grown[1])) / 2e-3 * 20.0
    expected = effect @ effect.T / 0.01**2
    np.testing.assert_allclose(rows.shared[0], expected, rtol=1e-3, atol=1e-4 * expected.max())


def test_only_some_rows() -> None:
    """Rows that do not count have no residual, no derivatives and no errors in common with others."""
    world = WORLDS["headings"]
    _, sources, values = sample(world, 2, seed=5)
    batch = batch_of(world, sources, values)
    rows = joint_rows("bearings", batch, causes_of(world, batch.sensor), sources, with_ranges=False)
    kept = np.ones(rows.residual.shape, dtype=bool)
    kept[:, 0] = False
    fewer = rows.only(kept)
    assert (fewer.residual[:, 0], fewer.slopes[0][:, 0], fewer.shared[:, 0]) == pytest.approx((0.0, 0.0, 0.0))
    np.testing.assert_array_equal(fewer.shared[:, 1:, 1:], rows.shared[:, 1:, 1:])
