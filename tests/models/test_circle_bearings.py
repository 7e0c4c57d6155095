"""Sight lines, paths and margins of circle rows, compared with traced rays and finite differences."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
import pytest
from batches import bearing_batch

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.scene import CircleReflector, Scene
from nlosctl.geometry.circular_reflection import all_reflections
from nlosctl.models.bearing_predictions import predict_bearings
from nlosctl.models.bearings import sight_lines
from nlosctl.models.scene_margins import scene_margins
from nlosctl.testing import CIRCLES

FloatArray = npt.NDArray[np.float64]

CENTER = np.array([3e5, -2e5])
LAYERS = Scene(
    reflectors=(
        CircleReflector(name="E", center=(CENTER[0], CENTER[1]), radius=6481e3, blocker_radius=6371e3),
        CircleReflector(name="F", center=(CENTER[0], CENTER[1]), radius=6671e3, blocker_radius=6371e3),
        CircleReflector(name="open", center=(CENTER[0], CENTER[1]), radius=6700e3),
    )
)


def exact_batch(snapshots: int, seed: int, *, measurements: int = 4) -> tuple[FloatArray, BearingBatch]:
    """Return sources (B, 2) and their noise-free bearings, direct or by the layers, all physical."""
    generator = np.random.default_rng(seed)
    angle = generator.uniform(-0.12, 0.12, (snapshots, measurements))
    sensor_xy = CENTER + 6371e3 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    source_angle = generator.uniform(-0.05, 0.05, snapshots)
    source_radius = 6371e3 + generator.uniform(5e3, 90e3, snapshots)
    source = CENTER + source_radius[:, None] * np.stack([np.cos(source_angle), np.sin(source_angle)], axis=1)
    reflector = generator.integers(0, 2, (snapshots, measurements))
    bearing = predict_bearings(sensor_xy, reflector, LAYERS, np.broadcast_to(source[:, None], sensor_xy.shape))
    return source, bearing_batch(sensor_xy, bearing, reflector=reflector, scene=LAYERS)


def local(batch: BearingBatch, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points (B, 2) relative to the local origins."""
    lines = sight_lines(batch)
    return xy[:, 0] - lines.center_x, xy[:, 1] - lines.center_y


def test_rays_go_through_the_source() -> None:
    """Noise-free unfolded rays pass within a millimetre of the source, at the length of the true path."""
    source, batch = exact_batch(300, 1)
    lines = sight_lines(batch)
    x, y = local(batch, source)
    across = lines.sine * (x[:, None] - lines.origin_x) - lines.cosine * (y[:, None] - lines.origin_y)
    assert np.abs(across).max() < 1e-3
    assert lines.circles is not None
    path = lines.circles.paths_from(x, y)
    length = lines.circles.pick_from(lines.range_m(x, y))
    np.testing.assert_allclose(length, path.length_m, rtol=1e-12)
    np.testing.assert_allclose(lines.circles.pick_from(lines.tube_width_m(x, y)), path.tube_width_m, rtol=1e-9)
    assert np.abs(lines.bearing_residual_rad(x, y)).max() < 1e-10


def test_the_spread_is_the_derivative_of_the_ray() -> None:
    """Changing a bearing by a small angle moves the ray at the source by the angle times the spread."""
    source, batch = exact_batch(200, 2)
    x, y = local(batch, source)
    turn = 1e-6
    turned = sight_lines(dataclasses.replace(batch, bearing_rad=batch.bearing_rad + turn))
    moved_x = source[:, 0] - turned.center_x
    moved_y = source[:, 1] - turned.center_y
    across = turned.sine * (moved_x[:, None] - turned.origin_x) - turned.cosine * (moved_y[:, None] - turned.origin_y)
    spread = sight_lines(batch).tube_width_m(x, y)
    np.testing.assert_allclose(np.abs(across) / turn, spread, rtol=2e-4)


@pytest.mark.parametrize("seed", range(3))
def test_information_agrees_with_finite_differences(seed: int) -> None:
    """On mixed rows the Fisher information agrees with numerical derivatives of the predicted bearings."""
    trial = CIRCLES.trial(np.random.default_rng(seed), 40, 5, None)
    batch = trial.batch
    lines = sight_lines(batch)
    generator = np.random.default_rng(seed)
    inside = batch.sensor_xy_m.mean(axis=1)
    up = batch.scene.reflectors[1].center - inside
    inside = inside - 0.03 * trial.size_m * up / np.hypot(*up.T)[:, None] * generator.uniform(0.5, 1.0, (40, 1))
    x, y = inside[:, 0] - lines.center_x, inside[:, 1] - lines.center_y
    step = 1e-6 * trial.size_m
    steps = [
        (lines.bearing_residual_rad(x + dx, y + dy) - lines.bearing_residual_rad(x - dx, y - dy)) / (2.0 * step)
        for dx, dy in ((step, 0.0), (0.0, step))
    ]
    slopes = [np.asarray(part) / batch.bearing_std_rad for part in steps]
    found = lines.information(x, y)
    smooth = (np.abs(np.array(steps)) * trial.size_m < 1e3).all(axis=(0, 2))  # no jump to another path between
    assert smooth.sum() > 20
    for part, (i, j) in zip((found.xx, found.xy, found.yy), ((0, 0), (0, 1), (1, 1)), strict=True):
        expected = (slopes[i] * slopes[j]).sum(axis=1)
        scale = found.trace
        np.testing.assert_allclose((part / scale)[smooth], (expected / scale)[smooth], atol=2e-5)


def test_an_open_circle_uses_the_path_nearest_to_the_bearing() -> None:
    """Of all paths, the one with the bearing nearest to the measured one is used."""
    generator = np.random.default_rng(4)
    points = CENTER + 6000e3 * generator.uniform(-0.7, 0.7, (2, 500, 2))
    sensor, source = points
    paths = all_reflections(*(sensor - CENTER).T.copy(), *(source - CENTER).T.copy(), np.full(500, 6700e3))
    bearing = generator.uniform(-np.pi, np.pi, 500)
    lines = sight_lines(bearing_batch(sensor[:, None], bearing[:, None], reflector=2, scene=LAYERS))
    off = np.nanmin(np.abs(np.angle(np.exp(1j * (bearing - paths.bearing_rad)))), axis=0)
    residual = lines.bearing_residual_rad(source[:, 0] - lines.center_x, source[:, 1] - lines.center_y)
    np.testing.assert_allclose(np.abs(residual[:, 0]), off, atol=1e-11)


def test_taking_snapshots_keeps_their_rows() -> None:
    """Rays of selected snapshots, repeated and in any order, give the same values to the bit."""
    trial = CIRCLES.trial(np.random.default_rng(5), 12, 4, None)
    lines = sight_lines(trial.batch)
    rows = np.array([3, 3, 11, 0, 7, 3])
    taken = lines.take(rows)
    x, y = lines.center_x * 0.0 + 0.01 * trial.size_m, lines.center_y * 0.0
    for name in ("residual_rad", "tube_width_m", "unseen", "outside_scene"):
        np.testing.assert_array_equal(getattr(taken, name)(x[rows], y[rows]), getattr(lines, name)(x, y)[rows])


def test_misplaced_sensors_give_nan() -> None:
    """A sensor outside its circle or under the ground gives NaN in its snapshot only."""
    _, batch = exact_batch(3, 6)
    sensor_xy = batch.sensor_xy_m.copy(order="F")
    sensor_xy[0, 0] = CENTER + np.array([7000e3, 0.0])
    sensor_xy[1, 2] = CENTER + np.array([6300e3, 0.0])
    broken = sight_lines(dataclasses.replace(batch, sensor_xy_m=sensor_xy))
    assert np.isnan(broken.center_x).tolist() == [True, True, False]
    assert broken.center_x[2] == sight_lines(batch).center_x[2]


def test_under_the_horizon() -> None:
    """A bearing is under the horizon if it points below the tangent to the ground; a snapshot reports if all are."""
    _, batch = exact_batch(2, 7)
    down = np.arctan2(*(CENTER - batch.sensor_xy_m).T[::-1]).T
    lines = sight_lines(
        dataclasses.replace(batch, bearing_rad=np.asfortranarray(np.where([[1], [0]], down, batch.bearing_rad)))
    )
    assert lines.circles is not None
    under = np.zeros((2, 4), dtype=bool)
    lines.circles.place_in(under, lines.circles.under_horizon())
    assert under.tolist() == [[True] * 4, [False] * 4]
    assert lines.all_under_horizon().tolist() == [True, False]


@pytest.mark.parametrize("seed", range(4))
def test_gradients_of_margins_agree_with_finite_differences(seed: int) -> None:
    """The derivatives of every margin agree with finite differences."""
    trial = CIRCLES.trial(np.random.default_rng(seed), 30, 5, None)
    lines = sight_lines(trial.batch)
    circle = trial.batch.scene.reflectors[1]
    place = np.random.default_rng(seed).uniform(6.2, 7.2, 30) / 6.0 * circle.blocker_radius
    turn = np.arctan2(*(trial.batch.sensor_xy_m.mean(axis=1) - circle.center).T[::-1])
    x = circle.center[0] + place * np.cos(turn) - lines.center_x
    y = circle.center[1] + place * np.sin(turn) - lines.center_y
    step = 1e-6 * trial.size_m
    here = scene_margins(lines, x, y)
    for dx, dy, axis in ((step, 0.0, 0), (0.0, step, 1)):
        ahead, behind = scene_margins(lines, x + dx, y + dy), scene_margins(lines, x - dx, y - dy)
        for margin, after, before in zip(here, ahead, behind, strict=True):
            finite = np.isfinite(margin.value_m) & np.isfinite(after.value_m) & np.isfinite(before.value_m)
            numeric = (after.value_m[finite] - before.value_m[finite]) / (2.0 * step)
            exact = margin.slopes[axis][finite]
            smooth = np.abs(numeric) < 50.0
            np.testing.assert_allclose(exact[smooth], numeric[smooth], atol=2e-5 * (1.0 + np.abs(exact[smooth]).max()))


def test_margins_are_zero_on_the_edge_of_the_scene() -> None:
    """Points inside the scene have positive margins, points outside a negative one, for sensors on the ground."""
    _, batch = exact_batch(400, 8)
    generator = np.random.default_rng(8)
    lines = sight_lines(batch)
    radius = generator.uniform(6350e3, 6475e3, 400)
    angle = generator.uniform(-0.45, 0.45, 400)
    x = CENTER[0] + radius * np.cos(angle) - lines.center_x
    y = CENTER[1] + radius * np.sin(angle) - lines.center_y
    least = np.full(400, np.inf)
    for margin in scene_margins(lines, x, y):
        np.minimum.at(least, margin.snapshot, np.where(np.isfinite(margin.value_m), margin.value_m, np.inf))
    outside = lines.outside_scene(x, y)
    assert 0.2 < outside.mean() < 0.8
    decided = np.abs(least) > 1.0
    near = np.abs(angle) < 0.2  # farther away a path below the ground may rise again: `outside_scene` knows
    assert (outside == (least < 0.0))[decided & near].all()
