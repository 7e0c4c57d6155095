"""Fisher information in space, compared with numerical derivatives of exact paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from space_worlds import ring_world, space_batch, with_height
from test_space_sphere_lines import skywave

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.scene import PlaneReflector, Scene
from nlosctl.evaluation.bounds import bounds_of
from nlosctl.models.information import INFORMATION
from nlosctl.models.space.paths import predict_directions, predict_path_vectors

FLOOR = Scene(reflectors=(PlaneReflector(name="floor", point=(0.0, 0.0, -80.0), normal=(0.1, 0.0, 1.0)),))


def coordinates(batch, size):
    """Return sensors of a batch as three arrays, of the first ``size`` snapshots."""
    return (batch.sensor_xy_m[:size, :, 0], batch.sensor_xy_m[:size, :, 1], batch.sensor_z_m[:size])


def numeric(batch, source, step, *, lengths=False):
    """Return the information (B, 3, 3) by central differences of the predicted angles, or lengths of paths."""

    def predicted(point):
        sensor = coordinates(batch, point.shape[0])
        every = tuple(np.broadcast_to(point[:, None, axis], sensor[0].shape) for axis in range(3))
        if lengths:
            vector = predict_path_vectors(sensor, every, batch.reflector, batch.scene)
            return [(np.linalg.norm(np.stack(vector), axis=0), batch.range_std_m)]
        azimuth, elevation = predict_directions(sensor, every, batch.reflector, batch.scene)
        known = np.isfinite(batch.elevation_rad)
        return [(azimuth, batch.bearing_std_rad), (elevation, np.where(known, batch.elevation_std_rad, np.inf))]

    columns = []
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        pairs = zip(predicted(source + shift), predicted(source - shift), strict=True)
        difference = [np.angle(np.exp(1j * (a - b))) if not lengths else a - b for (a, _), (b, _) in pairs]
        stds = [std for _, std in predicted(source)]
        columns.append(
            np.concatenate([d / (2.0 * step * std) for d, std in zip(difference, stds, strict=True)], axis=1)
        )
    jacobian = np.stack(columns, axis=-1)
    return np.einsum("bmi,bmj->bij", jacobian, jacobian)


def test_directions_by_planes_and_without_elevations() -> None:
    """Direct and mirrored rows, some of azimuth alone, have the information of differences; a height adds 1 / S^2."""
    batch, source = ring_world(np.random.default_rng(1), 30, 1.0, without_elevation=True)
    by = np.asfortranarray(np.where(np.arange(8) % 3 == 0, 0, -1) * np.ones((30, 1), dtype=np.int64))
    batch = replace(batch, reflector=by, scene=FLOOR)
    model = INFORMATION["bearings"]
    information = model.at(batch, *source.T)
    expected = numeric(batch, source, 1e-3)
    np.testing.assert_allclose(information.matrix.dense(), expected, rtol=1e-6, atol=1e-9)
    assert (information.n_used == 8).all()
    measured = model.at(with_height(batch, source[:, 2], 4.0), *source.T).matrix.dense()
    np.testing.assert_allclose(measured[:, 2, 2], expected[:, 2, 2] + 1.0 / 16.0, rtol=1e-6)
    doubled = model.at(with_height(batch, source[:, 2], 4.0), *source.T).with_rows_scaled(2.0).dense()
    np.testing.assert_allclose(doubled - np.diag([0.0, 0.0, 1.0 / 16.0]), 2.0 * expected, rtol=1e-6, atol=1e-9)
    held = model.at(with_height(batch, source[:, 2], 0.0), *source.T).matrix
    np.testing.assert_allclose(held.dense(), expected[:, :2, :2], rtol=1e-6, atol=1e-9)


def test_rows_by_spheres() -> None:
    """Rows by a sphere and past it have the information of differences, those that see no path none."""
    batch, source = skywave(40, 2)
    information = INFORMATION["bearings"].at(batch, *source.T)
    np.testing.assert_allclose(information.matrix.dense(), numeric(batch, source, 20.0), rtol=1e-4, atol=1e-12)
    far = source + np.array([0.0, 0.0, 900e3])
    nothing = INFORMATION["bearings"].at(batch, *far.T)
    assert (nothing.n_used <= 1).all()
    assert np.isfinite(nothing.matrix.dense()).all()


def test_ranges_by_planes() -> None:
    """Ranges, direct and by a plane, have the information of differences."""
    batch, source = ring_world(np.random.default_rng(3), 20, 1.0)
    by = np.asfortranarray(np.where(np.arange(8) % 2 == 0, 0, -1) * np.ones((20, 1), dtype=np.int64))
    shape = by.shape
    ranges = RangeBatch(
        scene=FLOOR,
        seed=batch.seed,
        dimension=3,
        sensor=batch.sensor,
        sensor_xy_m=batch.sensor_xy_m,
        sensor_z_m=batch.sensor_z_m,
        range_m=np.ones(shape, order="F"),
        range_std_m=np.asfortranarray(np.random.default_rng(4).uniform(0.5, 2.0, shape)),
        path=batch.path,
        sensor_height_m=np.zeros(shape, order="F"),
        reflector=by,
    )
    matrix = INFORMATION["ranges"].at(ranges, *source.T).matrix
    np.testing.assert_allclose(matrix.dense(), numeric(ranges, source, 1e-3, lengths=True), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("kind", ["bearings", "spheres"])
def test_a_map_sees_every_point_without_error(kind: str) -> None:
    """The batch of a map repeats the sensors; the information at each point is that of the snapshot there."""
    batch, source = ring_world(np.random.default_rng(5), 1, 1.0) if kind == "bearings" else skywave(1, 6)
    points = source + np.array([[0.0, 0.0, 0.0], [5.0, -3.0, 2.0], [-20.0, 1.0, 0.0]])
    model = INFORMATION["bearings"]
    seen = model.seen_from(batch, *points.T)
    assert seen.bearing_rad.shape == (3, batch.measurements)
    again = model.at(seen, *points.T).matrix.dense()
    for row in range(3):
        alone = model.at(batch, *points[row : row + 1].T).matrix.dense()[0]
        np.testing.assert_allclose(again[row], alone, rtol=1e-9)


def test_bounds_have_the_whole_trace_and_the_horizontal_ellipse() -> None:
    """rms_m is of x, y and z; ellipse and circular error are those of the marginal covariance of x and y."""
    sensor = np.array([[[0.0, 0.0, 0.0], [90.0, 10.0, 5.0], [20.0, 70.0, 30.0]]])
    source = np.array([[30.0, 25.0, 12.0]])
    v = source[:, None] - sensor
    azimuth, elevation = np.arctan2(v[..., 1], v[..., 0]), np.arctan2(v[..., 2], np.hypot(v[..., 0], v[..., 1]))
    batch = space_batch(sensor, azimuth, elevation, 0.02, 0.01)
    information = INFORMATION["bearings"].at(batch, *source.T).matrix
    covariance = np.linalg.inv(information.dense()[0])
    bounds = bounds_of(information)
    parts = (bounds.bound_xx_m2, bounds.bound_xy_m2, bounds.bound_yy_m2)
    np.testing.assert_allclose(np.concatenate(parts), covariance[[0, 0, 1], [0, 1, 1]])
    upright = (bounds.bound_xz_m2, bounds.bound_yz_m2, bounds.bound_zz_m2)
    np.testing.assert_allclose(np.concatenate(upright), covariance[2])
    assert bounds.rms_m[0] == pytest.approx(np.sqrt(np.trace(covariance)))
    axes = np.sqrt(np.linalg.eigvalsh(covariance[:2, :2]))
    np.testing.assert_allclose([bounds.semi_minor_m[0], bounds.semi_major_m[0]], axes)
