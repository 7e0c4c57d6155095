"""Ranges by mirrors and circles, compared with the shortest path by brute force and with finite differences."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from batches import range_batch
from scipy.optimize import minimize_scalar

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.scene import CircleReflector, LineReflector, Scene, SegmentReflector
from nlosctl.models.information import INFORMATION
from nlosctl.models.ranges.circles import range_circles
from nlosctl.models.ranges.predictions import predict_ranges

FloatArray = npt.NDArray[np.float64]

CENTER = np.array([300.0, -200.0])
WORLD = Scene(
    reflectors=(
        LineReflector(name="wall", point=(0.0, 900.0), direction=(1.0, 0.2)),
        SegmentReflector(name="segment", start=(-900.0, -900.0), end=(-900.0, 900.0)),
        CircleReflector(name="dome", center=(CENTER[0], CENTER[1]), radius=1500.0),
        CircleReflector(name="layer", center=(0.0, -4000.0), radius=6000.0, blocker_radius=2500.0),
    )
)
WALL, SEGMENT, DOME, LAYER = range(4)


def shortest(sensor: FloatArray, source: FloatArray, point: Any, low: float, high: float) -> float:
    """Return the least length over reflection points ``point(t)``, t in an interval: a grid, then scipy."""

    def length(t: Any) -> Any:
        hit = point(np.asarray(t))
        return np.hypot(*(hit - sensor).T) + np.hypot(*(source - hit).T)

    grid = np.linspace(low, high, 4001)
    best, step = grid[np.argmin(length(grid))], grid[1] - grid[0]
    found = minimize_scalar(length, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-9})
    return float(found.fun)


def on_line(t: FloatArray) -> FloatArray:
    """Return points (..., 2) of the wall."""
    return np.array([0.0, 900.0]) + t[..., None] * np.array([1.0, 0.2])


def on_dome(t: FloatArray) -> FloatArray:
    """Return points (..., 2) of the dome."""
    return CENTER + 1500.0 * np.stack([np.cos(t), np.sin(t)], axis=-1)


def points(seed: int, count: int) -> tuple[FloatArray, FloatArray]:
    """Return sensors and sources (count, 2) on one side of the walls and inside of the circles."""
    generator = np.random.default_rng(seed)
    return generator.uniform(-600.0, 600.0, (count, 2)), generator.uniform(-600.0, 600.0, (count, 2))


def batch_of(seed: int, snapshots: int, reflector: list[int]) -> tuple[RangeBatch, FloatArray]:
    """Return exact ranges of sources (B, 2) by ``reflector`` (K,), each row from a sensor of its own."""
    path = np.broadcast_to(np.asarray(reflector), (snapshots, len(reflector)))
    sensors = np.stack([points(seed + 10 * k, snapshots)[0] for k in range(path.shape[1])], axis=1)
    source = points(seed + 1000, snapshots)[1]
    everywhere = np.broadcast_to(source[:, None], sensors.shape)
    ranges = predict_ranges(sensors, np.zeros(path.shape), everywhere, path, WORLD)
    batch = range_batch(sensors, ranges, 2.0)
    return dataclasses.replace(batch, scene=WORLD, reflector=np.asfortranarray(path)), source


@pytest.mark.parametrize(("reflector", "point", "low", "high"), [(WALL, on_line, -3e3, 3e3), (DOME, on_dome, 0.0, 7.0)])
def test_the_range_is_the_shortest_path_by_the_reflector(reflector: int, point: Any, low: float, high: float) -> None:
    """The predicted range is the least sum of both legs over all points of the mirror or circle."""
    sensors, sources = points(3, 40)
    found = predict_ranges(sensors, np.zeros(40), sources, np.full(40, reflector), WORLD)
    expected = [shortest(*ends, point, low, high) for ends in zip(sensors, sources, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6)


def test_a_path_over_a_blocker_passes_above_it() -> None:
    """By a layer over opaque ground the range is the least of the paths whose legs both clear the ground."""
    generator = np.random.default_rng(5)
    ground, layer, center = 2500.0, 6000.0, np.array([0.0, -4000.0])
    angle, turn = generator.uniform(0.2, 0.6, 30), generator.uniform(0.1, 0.9, 30)
    sensor = center + ground * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    source = center + (ground + 100.0) * np.stack([np.cos(angle + turn), np.sin(angle + turn)], axis=1)
    found = predict_ranges(sensor, np.zeros(30), source, np.full(30, LAYER), WORLD)
    at = np.linspace(-np.pi, np.pi, 100_001)
    hits = center + layer * np.stack([np.cos(at), np.sin(at)], axis=1)
    for row in range(30):
        legs = [np.hypot(*(hits - end).T) for end in (sensor[row], source[row])]
        clear = [
            np.abs((end - center)[0] * (hits - end)[:, 1] - (end - center)[1] * (hits - end)[:, 0])
            >= ground * leg * (1.0 - 1e-9)
            for end, leg in zip((sensor[row], source[row]), legs, strict=True)
        ]
        up = [np.einsum("ij,j->i", hits - end, end - center) >= -1e-6 for end in (sensor[row], source[row])]
        free = (clear[0] | up[0]) & (clear[1] | up[1])
        assert abs(found[row] - np.where(free, sum(legs), np.inf).min()) < 1e-3


@pytest.mark.parametrize("seed", range(3))
def test_gradient_and_curvature_agree_with_finite_differences(seed: int) -> None:
    """The gradient of a range is the unit vector from the reflection point; its second derivatives follow the front."""
    batch, source = batch_of(seed, 60, [-1, WALL, DOME, DOME])
    circles = range_circles(batch)
    x, y = (source - np.stack([circles.center_x, circles.center_y], axis=1)).T + 5.0
    step = 1e-3
    for k in range(4):
        at = circles.path(k, x, y)
        right, left, above, below = (
            circles.path(k, x + dx, y + dy) for dx, dy in ((step, 0.0), (-step, 0.0), (0.0, step), (0.0, -step))
        )
        np.testing.assert_allclose(at.length_m, circles.length_m(k, x[:, None], y[:, None])[:, 0], rtol=1e-13)
        smooth = np.abs(right.length_m - 2.0 * at.length_m + left.length_m) < 1e-6  # the same path on both sides
        assert smooth.sum() > 50
        slope = np.stack([right.length_m - left.length_m, above.length_m - below.length_m]) / (2.0 * step)
        np.testing.assert_allclose(np.hypot(at.along_x, at.along_y), 1.0, rtol=1e-12)
        np.testing.assert_allclose(slope[:, smooth], np.stack([at.along_x, at.along_y])[:, smooth], atol=1e-6)
        bend = np.stack([right.along_x - left.along_x, right.along_y - left.along_y]) / (2.0 * step)
        u, v = at.along_x, at.along_y
        expected = np.stack([1.0 - u * u, -u * v]) / at.radius_m
        np.testing.assert_allclose(bend[:, smooth], expected[:, smooth], atol=2e-6)


def test_the_bound_agrees_with_finite_differences() -> None:
    """The Fisher information is that of numerical slopes of the exact ranges, rows that can't be received left out."""
    batch, source = batch_of(7, 50, [-1, WALL, DOME, WALL, DOME])
    x, y = source.T
    model = INFORMATION["ranges"]
    step = 1e-3

    def ranges(dx: float, dy: float) -> FloatArray:
        moved = np.broadcast_to((source + np.array([dx, dy]))[:, None], batch.sensor_xy_m.shape)
        assert batch.reflector is not None
        return predict_ranges(batch.sensor_xy_m, batch.sensor_height_m, moved, batch.reflector, WORLD)

    slope_x, slope_y = ((ranges(*d) - ranges(-d[0], -d[1])) / (2.0 * step) for d in ((step, 0.0), (0.0, step)))
    found = model.at(batch, x, y)
    scale = found.matrix.trace
    for part, product in (
        (found.matrix.xx, slope_x * slope_x),
        (found.matrix.xy, slope_x * slope_y),
        (found.matrix.yy, slope_y * slope_y),
    ):
        np.testing.assert_allclose(part / scale, product.sum(axis=1) / 4.0 / scale, atol=1e-5)
    assert (found.n_used == 5).all()


def test_points_that_the_scene_hides_from_a_row() -> None:
    """No row sees beyond its mirror, past the end of its wall or outside of its circle; no direct row across a wall."""
    batch, _ = batch_of(8, 1, [-1, WALL, SEGMENT, DOME])
    circles = range_circles(batch)

    def unseen(x: float, y: float) -> list[bool]:
        hidden = circles.unseen(np.array([x]) - circles.center_x, np.array([y]) - circles.center_y)
        return hidden[0].tolist()

    assert unseen(0.0, 0.0) == [False] * 4
    assert unseen(0.0, 1000.0) == [False, True, False, False]
    assert unseen(-1000.0, 0.0)[:3] == [True, False, True]
    assert unseen(300.0, 1400.0) == [False, True, True, True]


def test_taking_snapshots_keeps_their_rows() -> None:
    """Selected snapshots, repeated and in any order, give the same values to the bit."""
    batch, source = batch_of(9, 12, [-1, WALL, DOME, SEGMENT])
    circles = range_circles(batch)
    rows = np.array([3, 3, 11, 0, 7, 3])
    taken = circles.take(rows)
    x, y = (source - np.stack([circles.center_x, circles.center_y], axis=1)).T + 3.0
    for name in ("distance_m", "residual_m", "unseen"):
        np.testing.assert_array_equal(getattr(taken, name)(x[rows], y[rows]), getattr(circles, name)(x, y)[rows])
