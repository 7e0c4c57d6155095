"""Rows by spheres and past them, and exact paths in space, compared with closed forms and searches."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.optimize import minimize

from nlosctl.contract.scene import LineReflector, PlaneReflector, Scene, SphereReflector
from nlosctl.geometry.circular_reflection import all_points
from nlosctl.geometry.directions import direction_frame, dot
from nlosctl.geometry.spheres import central_plane
from nlosctl.models.space.paths import predict_directions, predict_path_vectors
from nlosctl.models.space.sphere_rows import locate_opaque_spheres, locate_sphere_rows

FloatArray = npt.NDArray[np.float64]

CENTER = (3e5, -2e5, 1e5)
EARTH_M, LAYER_M = 6371e3, 6671e3
OPAQUE = SphereReflector(name="F", center=CENTER, radius=LAYER_M, blocker_radius=EARTH_M)
OPEN = SphereReflector(name="open", center=CENTER, radius=LAYER_M)
FLOOR = PlaneReflector(name="floor", point=(0.0, 0.0, -5.0), normal=(0.3, 0.1, 2.0))
WALL = LineReflector(name="wall", point=(0.0, 80.0), direction=(1.0, 0.2))


def draw_globe(shape: tuple[int, ...], seed: int, span: float, heights: tuple[float, float]) -> FloatArray:
    """Return points (3, *shape) about `CENTER`, within ``span`` radians of a place and between two heights."""
    generator = np.random.default_rng(seed)
    away, turn = generator.uniform(0.0, span, shape), generator.uniform(-np.pi, np.pi, shape)
    radius = EARTH_M + generator.uniform(*heights, shape)
    ahead, side, up = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    rows = [np.sin(away) * np.cos(turn), np.sin(away) * np.sin(turn), np.cos(away)]
    return np.tensordot(np.stack([ahead, side, up], axis=1), np.stack(rows), axes=1) * radius


def about(point: FloatArray) -> tuple[FloatArray, ...]:
    """Return points in the coordinates of the scene."""
    return tuple(part + middle for part, middle in zip(point, CENTER, strict=True))


def rows_of(scene: Scene, sensor: FloatArray, source: FloatArray, by: int = 0):
    """Return the rows of noise-free directions to one source (3, B) from sensors (3, B, K) by one reflector."""
    reflector = np.full(sensor.shape[1:], by)
    everywhere = tuple(np.broadcast_to(part[:, None], reflector.shape) for part in about(source))
    azimuth, elevation = predict_directions(about(sensor), everywhere, reflector, scene)
    ray, along, _ = direction_frame(azimuth, elevation)
    level = direction_frame(azimuth, np.zeros_like(azimuth))[0]
    return locate_sphere_rows(scene, reflector, about(sensor), ray, level, along, np.cos(elevation))


def test_the_path_of_a_noise_free_row_is_its_ray() -> None:
    """Predicted directions and the path of the rows agree to 1e-10 rad, before and after a change of origin."""
    sensor, source = draw_globe((60, 4), 2, 0.15, (0.0, 0.0)), draw_globe((60,), 3, 0.1, (0.0, 200e3))
    rows = rows_of(Scene(reflectors=(OPAQUE,)), sensor, source)
    origin = tuple(part.mean(axis=1) for part in about(sensor))
    for moved, point in (
        (rows, about(source)),
        (rows.about(*origin), tuple(a - b for a, b in zip(about(source), origin, strict=True))),
    ):
        path = moved.paths_from(*point)
        seen = ~moved.outside(path, *point)
        assert seen.mean() > 0.7
        apart = np.linalg.norm(np.stack(path.direction) - np.stack(moved.ray), axis=0)
        assert apart[seen].max() < 1e-10
    some = rows.take(np.array([5, 5, 2]))
    np.testing.assert_array_equal(some.ray_z[some.snapshot == 2], rows.ray_z[rows.snapshot == 2])


def test_the_region_by_reflection_has_the_great_circle_angle() -> None:
    """A2 from the ground: the angle between sensor and source is at most 2 acos(r/R) - acos(r/rho)."""
    sensor, source = draw_globe((400, 3), 4, 0.3, (0.0, 0.0)), draw_globe((400,), 5, 0.3, (1e3, 299e3))
    rows = rows_of(Scene(reflectors=(OPAQUE,)), sensor, source)
    outside = rows.outside(rows.paths_from(*about(source)), *about(source)).reshape(3, 400).T
    rho = np.linalg.norm(source, axis=0)
    apart = np.arccos(np.sum(sensor * source[:, :, None], axis=0) / EARTH_M / rho[:, None])
    edge = 2.0 * np.arccos(EARTH_M / LAYER_M) - np.arccos(EARTH_M / rho)
    decided = np.abs(apart - edge[:, None]) > 1e-6
    assert 0.05 < outside.mean() < 0.9
    assert (outside == (apart > edge[:, None]))[decided].all()


def test_the_region_of_direct_rows_has_the_great_circle_angle() -> None:
    """A3 from the ground: rho cos(d) >= r, and two layers about one blocker count once."""
    sensor, source = draw_globe((400, 3), 6, 0.1, (0.0, 0.0)), draw_globe((400,), 7, 0.1, (0.0, 50e3))
    scene = Scene(reflectors=(OPAQUE, SphereReflector(name="E", center=CENTER, radius=6481e3, blocker_radius=EARTH_M)))
    (rows,) = locate_opaque_spheres(scene, np.full((400, 3), -1), about(sensor))
    outside = rows.outside(*about(source)).reshape(3, 400).T
    above = np.sum(sensor * source[:, :, None], axis=0) / EARTH_M - EARTH_M
    assert 0.1 < outside.mean() < 0.9
    assert (outside == (above < 0.0))[np.abs(above) > 1e-2].all()
    assert locate_opaque_spheres(Scene(reflectors=(OPEN,)), np.full((400, 3), -1), about(sensor)) == ()


def test_without_a_blocker_the_path_seen_nearest_is_taken() -> None:
    """Each of the up to four paths is found from its own direction."""
    generator = np.random.default_rng(8)
    ends = generator.normal(size=(2, 3, 200))
    ends *= 0.95 * LAYER_M * np.cbrt(generator.random((2, 1, 200))) / np.linalg.norm(ends, axis=1, keepdims=True)
    sensor, source = ends[0][:, :, None], ends[1]
    plane = central_plane(tuple(sensor[:, :, 0]), tuple(source))
    paths = plane.path_by(*all_points(*plane.points, np.full(200, LAYER_M)))
    directions = np.stack(paths.direction)
    found = 0
    for number in range(4):
        wanted = directions[:, number]
        there = np.isfinite(wanted[0])
        ray = tuple(part[there][:, None] for part in wanted)
        scene = Scene(reflectors=(OPEN,))
        here = about(sensor[:, there])
        share = np.hypot(ray[0], ray[1])
        level = (ray[0] / share, ray[1] / share, 0.0 * share)
        along = (-level[1], level[0], level[2])
        by = np.zeros(share.shape, dtype=np.int64)
        rows = locate_sphere_rows(scene, by, here, ray, level, along, share)
        path = rows.paths_from(*about(source[:, there]))
        assert np.linalg.norm(np.stack(path.direction) - wanted[:, there], axis=0).max() < 1e-9
        assert not rows.outside(path, *about(source[:, there])).any()
        found += there.sum()
    assert found > 440


def test_directions_under_the_horizon() -> None:
    """A direction under the tangent plane at the sensor is under the horizon, one above it is not."""
    sensor, source = draw_globe((50, 2), 9, 0.1, (0.0, 0.0)), draw_globe((50,), 10, 0.1, (1e3, 50e3))
    rows = rows_of(Scene(reflectors=(OPAQUE,)), sensor, source)
    assert not rows.under_horizon().any()
    up = dot(rows.sensor, rows.ray) / EARTH_M
    flat = tuple(part - (up + 0.01) * middle / EARTH_M for part, middle in zip(rows.ray, rows.sensor, strict=True))
    sunk = {f"ray_{axis}": part for axis, part in zip("xyz", flat, strict=True)}
    assert type(rows)(**{**vars(rows), **sunk}).under_horizon().all()


@pytest.mark.parametrize("by", [0, 1])
def test_a_plane_gives_the_shortest_path(by: int) -> None:
    """By a floor or wall, length and direction are those of the shortest way over a point of it, by a search."""
    scene = Scene(reflectors=(FLOOR, WALL))
    normal = np.array([[0.3, 0.1, 2.0], [-0.2, 1.0, 0.0]][by])
    normal /= np.linalg.norm(normal)
    on_plane = np.array([[0.0, 0.0, -5.0], [0.0, 80.0, 0.0]][by])
    basis = np.linalg.svd(normal[None])[2][1:]
    generator = np.random.default_rng(11)
    for _ in range(5):
        ends = generator.uniform(0.0, 30.0, (2, 3))
        vector = np.array(predict_path_vectors(*(tuple(end[:, None]) for end in ends), np.array([by]), scene))[:, 0]

        def way(at: FloatArray, ends: FloatArray = ends) -> float:
            point = on_plane + at @ basis
            return float(np.linalg.norm(point - ends[0]) + np.linalg.norm(point - ends[1]))

        best = minimize(way, np.zeros(2), tol=1e-12)
        hit = on_plane + best.x @ basis
        assert np.linalg.norm(vector) == pytest.approx(best.fun, rel=1e-9)
        np.testing.assert_allclose(vector / best.fun, (hit - ends[0]) / np.linalg.norm(hit - ends[0]), atol=1e-4)


def test_without_a_reflector_the_path_is_straight() -> None:
    """Direct rows, alone or beside reflected ones, look at the source; a sensor outside its sphere sees nothing."""
    sensor, source = np.random.default_rng(12).normal(scale=20.0, size=(2, 3, 6))
    scene = Scene(reflectors=(FLOOR, OPEN))
    for by in (np.full(6, -1), np.array([-1, 0, -1, 0, 0, -1])):
        vector = np.stack(predict_path_vectors(tuple(sensor), tuple(source), by, scene))
        np.testing.assert_allclose(vector[:, by < 0], (source - sensor)[:, by < 0])
    far = tuple(part + 2.0 * LAYER_M for part in sensor)
    assert np.isnan(np.stack(predict_directions(far, tuple(source), np.ones(6, dtype=np.int64), scene))).all()
