"""Tests of bearings in space as rays: residuals, derivatives, mirrors, heights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from space_worlds import angles_of, ring_world, space_batch, with_height

from nlosctl.contract.scene import LineReflector, PlaneReflector, Scene
from nlosctl.models.scene_margins import scene_margins
from nlosctl.models.sight import bearing_lines
from nlosctl.models.space.rays import space_lines
from nlosctl.solvers.optimization.problem import LeastSquaresProblem

WALL = LineReflector(name="wall", point=(0.0, 600.0), direction=(1.0, 0.1))
FLOOR = PlaneReflector(name="floor", point=(0.0, 0.0, -20.0), normal=(0.1, -0.2, 3.0))
SCENE = Scene(reflectors=(WALL, FLOOR))


def mirror(points: np.ndarray, point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return points (..., 3) reflected by a plane."""
    unit = normal / np.linalg.norm(normal)
    return points - 2.0 * ((points - point) @ unit)[..., None] * unit


def mixed_batch(size: int, seed: int):
    """Return noise-free rows, direct, by a wall and by a sloping floor, some without elevation, and the sources."""
    batch, source = ring_world(np.random.default_rng(seed), size, 1.0, without_elevation=True)
    reflector = np.broadcast_to(np.array([-1, 0, 1, -1, 0, 1, 1, -1]), batch.bearing_rad.shape)
    sensor = np.concatenate([batch.sensor_xy_m, batch.sensor_z_m[..., None]], axis=-1)
    images = {
        -1: source,
        0: mirror(source, np.array([0.0, 600.0, 0.0]), np.array([-0.1, 1.0, 0.0])),
        1: mirror(source, np.array(FLOOR.point), np.array(FLOOR.normal)),
    }
    seen = np.stack([images[int(reflector[0, k])] for k in range(8)], axis=1)
    azimuth, elevation = angles_of(seen - sensor)
    elevation[:, 1::3] = np.nan
    return replace(batch, scene=SCENE, reflector=reflector, bearing_rad=azimuth, elevation_rad=elevation), source


def about_center(lines, source: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return points (B, 3) about the local origins."""
    return tuple(source[:, axis] - lines.center[axis] for axis in range(3))


def test_sensors_look_at_images():
    """Residuals of direct and mirrored rows at the true source are 0 to 1e-12 rad."""
    batch, source = mixed_batch(40, 1)
    lines = space_lines(batch)
    assert np.abs(lines.residual(*about_center(lines, source))).max() < 1e-12


@pytest.mark.parametrize("tangent", [False, True])
@pytest.mark.parametrize("held", [False, True])
def test_slopes_agree_with_finite_differences(tangent: bool, held: bool):
    """The derivatives of the scaled residuals, mirrored rows and heights included, agree with central differences."""
    batch, source = mixed_batch(30, 2)
    batch = with_height(batch, source[:, 2] + 3.0, 0.0 if held else 2.0)
    if tangent:
        batch = replace(batch, direction_std_rad=batch.bearing_std_rad)
    lines = space_lines(batch)
    offset = np.random.default_rng(3).uniform(-30.0, 30.0, (3, 30))
    point = tuple(part + shift for part, shift in zip(about_center(lines, source), offset, strict=True))[
        : lines.unknowns
    ]
    slopes, step = lines.slopes(*point), 1e-4
    for axis in range(len(point)):
        ahead = tuple(part + step * (i == axis) for i, part in enumerate(point))
        back = tuple(part - step * (i == axis) for i, part in enumerate(point))
        numeric = (lines.residual(*ahead) - lines.residual(*back)) / (2.0 * step * lines.std)
        np.testing.assert_allclose(slopes[axis], numeric, atol=2e-9)


def test_the_problem_has_the_chi_square_and_its_gradient():
    """The cost is half the sum of squared residuals over stds, the gradient and matrix those of the slopes."""
    batch, source = mixed_batch(20, 4)
    lines = space_lines(with_height(batch, source[:, 2] - 5.0, 1.5))
    point = tuple(part + 8.0 for part in about_center(lines, source))
    at = LeastSquaresProblem(lines).evaluate(*point)
    scaled, slopes = lines.residual(*point) / lines.std, lines.slopes(*point)
    np.testing.assert_allclose(at.cost, 0.5 * (scaled**2).sum(axis=1), rtol=1e-12)
    for part, slope in zip(at.gradient, slopes, strict=True):
        np.testing.assert_allclose(part, (scaled * slope).sum(axis=1), rtol=1e-9, atol=1e-9)
    dense = np.einsum("ibm,jbm->bij", np.stack(slopes), np.stack(slopes))
    np.testing.assert_allclose(lines.information(*point).dense(), dense, rtol=1e-9)
    np.testing.assert_allclose(lines.ray_residuals(*point).chi_square, 2.0 * at.cost, rtol=1e-12)


@pytest.mark.parametrize("tangent", [False, True])
@pytest.mark.parametrize("ranges", ["none", "gaussian", "lognormal"])
def test_second_derivatives_agree_with_finite_differences(tangent: bool, ranges: str):
    """The exact matrix of the problem is the derivative of its gradient, with mirrors, ranges and a height."""
    batch, source = mixed_batch(30, 8)
    batch = with_height(batch, source[:, 2] + 3.0, 2.0)
    if tangent:
        batch = replace(batch, direction_std_rad=batch.bearing_std_rad)
    lines = space_lines(batch)
    if ranges != "none":
        measured = lines.range_m(*about_center(lines, source)) * 1.02
        measured[:, 2] = np.nan
        lines = lines.with_ranges(measured, np.full(measured.shape, 4.0), lognormal=ranges == "lognormal")
    offset = np.random.default_rng(9).uniform(-6.0, 6.0, (3, 30))
    point = tuple(part + shift for part, shift in zip(about_center(lines, source), offset, strict=True))
    problem, step = LeastSquaresProblem(lines), 1e-3
    at = problem.evaluate(*point)
    assert at.exact.mean() > 0.8
    dense = at.hessian.dense()[at.exact]
    for axis in range(3):
        ahead = problem.evaluate(*(part + step * (i == axis) for i, part in enumerate(point)))
        back = problem.evaluate(*(part - step * (i == axis) for i, part in enumerate(point)))
        numeric = (np.stack(ahead.gradient) - np.stack(back.gradient))[:, at.exact] / (2.0 * step)
        np.testing.assert_allclose(dense[:, axis], numeric.T, rtol=1e-4, atol=1e-6 * np.abs(dense).max())


def test_planes_of_exact_angles_meet_at_the_source():
    """The planes of normals and offsets contain the true source, unfolded rows and a height included."""
    batch, source = mixed_batch(20, 5)
    for std in (0.0, 1.0):
        lines = space_lines(with_height(batch, source[:, 2], std))
        (normals, offsets), point = lines.planes(slice(None), None), about_center(lines, source)
        reach = sum(normal * part[:, None] for normal, part in zip(normals, point, strict=True))
        if lines.is_held:
            reach = reach - lines.held_m[:, None] * normals[2]
        np.testing.assert_allclose(reach, offsets, atol=1e-9)


def test_scalars_are_counted_not_rows():
    """A row with elevation counts two scalars, one without it one, a height with a std one, an exact height none."""
    batch, source = mixed_batch(5, 6)
    assert (space_lines(batch).scalars() == 8 + 5).all()
    assert (space_lines(with_height(batch, source[:, 2], 1.0)).scalars() == 8 + 5 + 1).all()
    assert (space_lines(with_height(batch, source[:, 2], 0.0)).scalars() == 8 + 5).all()


def test_the_zenith_of_a_row_is_marked():
    """Points within three stds of the elevation of a sensor's zenith are marked, unless residuals are tangential."""
    sensor = np.array([[[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]]])
    for height, steep in ((15.0, False), (25.0, True)):
        source = np.array([[1.0, 0.0, height]])
        angles = angles_of(source[:, None] - sensor)
        batch = space_batch(sensor, *angles, np.radians(1.0), np.radians(1.0))
        lines = bearing_lines(batch)
        assert lines.ray_residuals(*about_center(lines, source)).at_zenith.tolist() == [steep]
        lines = bearing_lines(replace(batch, direction_std_rad=batch.bearing_std_rad))
        assert not lines.ray_residuals(*about_center(lines, source)).at_zenith.any()


def test_margins_are_distances_from_mirrors():
    """The margin of a mirrored row is the distance of the point from its mirror, negative beyond it."""
    batch, source = mixed_batch(10, 7)
    lines = space_lines(batch)
    (margins,) = scene_margins(lines, *about_center(lines, source))
    unit = np.array(FLOOR.normal) / np.linalg.norm(FLOOR.normal)
    floor = np.nonzero(np.isfinite(lines.mirrors.sensor_side_m).T)[0] >= 2
    expected = (source - np.array(FLOOR.point)) @ unit
    measurement = np.nonzero(np.isfinite(lines.mirrors.sensor_side_m).T)[0]
    third = floor & (measurement == 2)
    np.testing.assert_allclose(margins.value_m[third], expected[margins.snapshot[third]], rtol=1e-6)
    below = source.copy()
    below[:, 2] -= 400.0
    point = about_center(lines, below)
    assert (scene_margins(lines, *point)[0].value_m[third] < 0.0).all()
    assert lines.outside_scene(*point).all()
    assert not lines.outside_scene(*about_center(lines, source)).any()
