"""Sight lines by spheres in space, compared with finite differences, traced rays and Monte-Carlo errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from space_worlds import space_batch, with_height
from test_space_spheres import CENTER, EARTH_M, OPAQUE, about, draw_globe

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.scene import PlaneReflector, Scene
from nlosctl.contract.statuses import Status
from nlosctl.methods.bearings_ml import METHOD
from nlosctl.models.scene_margins import scene_margins
from nlosctl.models.sight import bearing_lines
from nlosctl.models.space.paths import predict_directions
from nlosctl.solvers.bearings.line_fits import fit_focused, fit_least_squares, with_independent_errors

SCENE = Scene(
    reflectors=(
        OPAQUE,
        PlaneReflector(name="cliff", point=(CENTER[0], CENTER[1], CENTER[2] - 900e3), normal=(0.1, 0.2, 1.0)),
    )
)


def skywave(
    size: int, seed: int, std_deg: float = 0.5, *, with_frames: bool = False
) -> tuple[BearingBatch, np.ndarray]:
    """Return noise-free rows of four sensors on the ground by the layer, one direct, and sources (B, 3) up to 90 km."""
    sensor = draw_globe((size, 5), seed, 0.1, (0.0, 0.0))
    sensor[:, :, 4] = draw_globe((size,), seed, 0.01, (120e3, 150e3))
    source = draw_globe((size,), seed + 1, 0.05, (5e3, 90e3))
    by = np.zeros((size, 5), dtype=np.int64)
    by[:, 4] = -1
    everywhere = tuple(np.broadcast_to(part[:, None], by.shape) for part in about(source))
    azimuth, elevation = predict_directions(about(sensor), everywhere, by, SCENE)
    std, rise = np.random.default_rng(seed + 2).uniform(0.5, 2.0, (2, size, 5)) * np.radians(std_deg)
    more = {}
    if with_frames:
        frames = np.linalg.qr(np.random.default_rng(seed + 3).normal(size=(size, 5, 3, 3)))[0]
        u = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
        seen = np.einsum("bkij,bkj->bki", frames, u)
        azimuth, elevation = np.arctan2(seen[..., 1], seen[..., 0]), np.arcsin(seen[..., 2])
        more = {"sensor_frame": np.asfortranarray(frames)}
    places = np.stack(about(sensor), axis=-1)
    batch = space_batch(places, azimuth, elevation, std, rise, scene=SCENE, reflector=np.asfortranarray(by), **more)
    return batch, np.stack(about(source), axis=-1)


def local(lines, source):
    """Return sources (B, 3) about the local origins."""
    return tuple(source[:, axis] - lines.center[axis] for axis in range(3))[: lines.unknowns]


@pytest.mark.parametrize("with_frames", [False, True])
def test_noise_free_rows_meet_at_the_source(with_frames: bool) -> None:
    """Residuals vanish to 1e-10 rad, planes pass within a centimetre, and ls finds the source to a centimetre."""
    batch, source = skywave(60, 1, with_frames=with_frames)
    lines = bearing_lines(batch)
    point = local(lines, source)
    seen = ~lines.outside_scene(*point)
    assert seen.mean() > 0.5
    assert np.abs(lines.residual(*point)[seen]).max() < 1e-10
    normals, offsets = lines.planes(slice(None), None)
    missed = sum(part[:, None] * normal for part, normal in zip(point, normals, strict=True)) - offsets
    assert np.abs(missed[seen]).max() < 1e-2
    fit = fit_least_squares(lines)
    apart = np.linalg.norm(np.stack(fit.point) - np.stack(point), axis=0)
    assert apart[seen].max() < 1e-2
    assert not lines.all_under_horizon()[seen].any()


@pytest.mark.parametrize("mode", ["angles", "frames", "tangent", "held"])
def test_slopes_agree_with_finite_differences(mode: str) -> None:
    """The derivatives of the scaled residuals along bent paths agree with central differences."""
    batch, source = skywave(40, 2, with_frames=mode == "frames")
    if mode == "tangent":
        batch = replace(batch, direction_std_rad=batch.bearing_std_rad)
    if mode == "held":
        batch = with_height(batch, source[:, 2] + 500.0, 0.0)
    lines = bearing_lines(batch)
    offset = np.random.default_rng(3).uniform(-5e3, 5e3, (3, 40))
    point = tuple(part + shift for part, shift in zip(local(lines, source), offset, strict=False))
    slopes, step = lines.slopes(*point), 20.0
    far = np.isfinite(np.stack(slopes)).all(axis=0)
    assert far.mean() > 0.9
    for axis in range(len(point)):
        ahead = tuple(part + step * (i == axis) for i, part in enumerate(point))
        back = tuple(part - step * (i == axis) for i, part in enumerate(point))
        numeric = (lines.residual(*ahead) - lines.residual(*back)) / (2.0 * step * lines.std)
        np.testing.assert_allclose(slopes[axis][far], numeric[far], rtol=2e-4, atol=2e-8)
    taken = lines.take(np.array([3, 3, 7]))
    again = taken.slopes(*(part[[3, 3, 7]] for part in point))
    np.testing.assert_array_equal(np.stack(again)[:, 1], np.stack(slopes)[:, 3])


@pytest.mark.parametrize("tangent", [False, True])
def test_errors_of_the_planes_are_independent_and_as_large_as_predicted(tangent: bool) -> None:
    """Noisy directions move the two planes of a row by std times width at the source, without correlation."""
    one, source = skywave(4, 6, std_deg=0.01)
    rows, draws = np.repeat(np.arange(4), 5000), 20_000
    generator = np.random.default_rng(5)

    def spread(array):
        return np.asfortranarray(array[rows])

    fields = {name: spread(getattr(one, name)) for name in vars(one) if isinstance(getattr(one, name), np.ndarray)}
    noise = generator.standard_normal((2, draws, 5))
    azimuth_std = fields["bearing_std_rad"]
    rise_std = fields["elevation_std_rad"]
    if tangent:
        fields["direction_std_rad"] = rise_std = azimuth_std
    turned = azimuth_std * noise[0] / (np.cos(fields["elevation_rad"]) if tangent else 1.0)
    exact, base = bearing_lines(replace(one, direction_std_rad=one.bearing_std_rad) if tangent else one), {}
    point = local(exact, source)
    based = exact.based_at(*point)
    normals, widths = based.normals(slice(None)), based.tube_width_m(*point)
    base = {
        "bearing_rad": fields["bearing_rad"] + turned,
        "elevation_rad": fields["elevation_rad"] + rise_std * noise[1],
    }
    lines = bearing_lines(replace(one, **{**fields, **base}))
    away = [source[rows, axis] - lines.center[axis] for axis in range(3)]
    # Where the noisy ray passes the source: the vector from its nearest point, along the exact planes' normals.
    origin, ray = lines.origin, lines._from_sensor(lines.angles.directions())
    from_origin = [part[:, None] - start for part, start in zip(away, origin, strict=True)]
    along = sum(a * b for a, b in zip(from_origin, ray, strict=True))
    across = [a - along * b for a, b in zip(from_origin, ray, strict=True)]
    moved = np.stack(
        [
            sum(part * normal[rows][:, first : first + 5] for part, normal in zip(across, normals, strict=True))
            for first in (0, 5)
        ]
    )
    for snapshot in range(4):
        for k in range(4):
            mine = moved[:, rows == snapshot, k]
            predicted = [based.std[snapshot, first + k] * widths[snapshot, first + k] for first in (0, 5)]
            np.testing.assert_allclose(mine.std(axis=1), predicted, rtol=0.05)
            assert abs(np.corrcoef(mine)[0, 1]) < 0.05


def test_stansfield_is_the_weighted_pass_of_dimensions() -> None:
    """The fit is that of 2 x 2 blocks: covariances of angle errors projected on (k x u, k), scaled by both widths."""
    batch, _ = skywave(30, 7, std_deg=0.3)
    generator = np.random.default_rng(8)
    noise = generator.standard_normal((2, *batch.bearing_rad.shape))
    batch = replace(
        batch,
        bearing_rad=batch.bearing_rad + batch.bearing_std_rad * noise[0],
        elevation_rad=batch.elevation_rad + batch.elevation_std_rad * noise[1],
    )
    lines = bearing_lines(batch)
    first = fit_least_squares(lines)
    fit = fit_focused(with_independent_errors(lines, first), first)
    for row in range(30):
        matrix, right = np.zeros((3, 3)), np.zeros(3)
        start = np.array(first.point)[:, row]
        for k in range(5):
            z, e = batch.bearing_rad[row, k], batch.elevation_rad[row, k]
            u = np.array([np.cos(e) * np.cos(z), np.cos(e) * np.sin(z), np.sin(e)])
            a, t = (
                np.array([-np.sin(z), np.cos(z), 0.0]),
                np.array([-np.sin(e) * np.cos(z), -np.sin(e) * np.sin(z), np.cos(e)]),
            )
            noise_matrix = (batch.bearing_std_rad[row, k] * np.cos(e)) ** 2 * np.outer(a, a)
            noise_matrix += batch.elevation_std_rad[row, k] ** 2 * np.outer(t, t)
            place = np.array([*batch.sensor_xy_m[row, k], batch.sensor_z_m[row, k]]) - np.array(lines.center)[:, row]
            turn = np.eye(3)
            basis, widths = np.stack([a, t]), np.full(2, np.linalg.norm(start - place))
            if batch.reflector[row, k] == 0:
                s = place + np.array(lines.center)[:, row] - np.array(CENTER)
                way = -(s @ u) + np.sqrt((s @ u) ** 2 - s @ s + OPAQUE.radius**2)
                hit = s + way * u
                normal = hit / OPAQUE.radius
                turn = np.eye(3) - 2.0 * np.outer(normal, normal)
                side = np.cross(s, u)
                side /= np.linalg.norm(side)
                place = place - 2.0 * normal * (normal @ (s - hit))
                left, incidence = np.linalg.norm(start - place) - way, u @ normal
                tangential = way + left - 2.0 * way * left / (OPAQUE.radius * incidence)
                sagittal = way + left - 2.0 * way * left * incidence / OPAQUE.radius
                basis, widths = np.stack([np.cross(side, u), side]), np.array([tangential, sagittal])
            block = np.diag(widths) @ basis @ noise_matrix @ basis.T @ np.diag(widths)
            if batch.reflector[row, k] < 0:  # f and r at the fit of ls
                level = batch.bearing_std_rad[row, k] * np.hypot(*(start - place)[:2])
                block = np.diag([level, batch.elevation_std_rad[row, k] * widths[1]]) ** 2
            rows = basis @ turn
            matrix += rows.T @ np.linalg.solve(block, rows)
            right += rows.T @ np.linalg.solve(block, rows @ place)
        np.testing.assert_allclose(np.array(fit.point)[:, row], np.linalg.solve(matrix, right), atol=1e-3)


@pytest.mark.parametrize("held", [False, True])
def test_margins_are_positive_where_the_scene_allows_a_point(held: bool) -> None:
    """All margins of a snapshot are positive exactly where the scene allows the point; slopes are differences."""
    scene = Scene(reflectors=(replace(OPAQUE, min_elevation_deg=None if held else 4.0), SCENE.reflectors[1]))
    batch, source = skywave(300, 10)
    batch = replace(batch, scene=scene)
    if held:
        batch = with_height(batch, source[:, 2], 0.0)
    lines = bearing_lines(batch)
    reach = 80e3 if held else 150e3
    offset = np.random.default_rng(11).uniform(-reach, reach, (3, 300))
    point = tuple(part + shift for part, shift in zip(local(lines, source), offset, strict=False))
    margins = scene_margins(lines, *point)
    least = np.full(300, np.inf)
    for margin in margins:
        np.minimum.at(least, margin.snapshot, np.where(np.isnan(margin.value_m), -np.inf, margin.value_m))
    allowed = ~lines.outside_scene(*point)
    assert 0.1 < allowed.mean() < 0.97
    assert ((least > 0.0) == allowed)[np.abs(least) > 1.0].all()
    for axis in range(len(point)):
        ahead, back = (
            scene_margins(lines, *(part + sign * 5.0 * (i == axis) for i, part in enumerate(point)))
            for sign in (1.0, -1.0)
        )
        for before, margin, after in zip(back, margins, ahead, strict=True):
            with np.errstate(invalid="ignore"):
                numeric = (after.value_m - before.value_m) / 10.0
            there = np.isfinite(numeric) & np.isfinite(margin.slopes[axis])
            np.testing.assert_allclose(margin.slopes[axis][there], numeric[there], rtol=2e-3, atol=2e-4)


def test_feasible_estimates_are_within_the_scene() -> None:
    """ml with feasible=true moves infeasible estimates onto an edge of what the scene allows."""
    batch, _ = skywave(300, 12, std_deg=4.0)
    generator = np.random.default_rng(13)
    noise = generator.standard_normal((2, *batch.bearing_rad.shape))
    batch = replace(
        batch,
        bearing_rad=batch.bearing_rad + batch.bearing_std_rad * noise[0],
        elevation_rad=batch.elevation_rad + batch.elevation_std_rad * noise[1],
    )
    free = METHOD.solve(batch, METHOD.options()).estimates
    fixed = METHOD.solve(batch, METHOD.options(feasible=True)).estimates
    lines = bearing_lines(batch)
    outside = np.flatnonzero(free.status[free.alternative == 0] == Status.INFEASIBLE)
    assert outside.size > 10
    best = np.flatnonzero(fixed.alternative == 0)
    boundary = fixed.status[best] == Status.BOUNDARY
    assert boundary[outside].mean() > 0.9
    allowed = ~lines.outside_scene(*local(lines, fixed.position_m[best]))
    assert allowed[boundary].all()


def test_points_above_the_sphere_are_moved_into_it() -> None:
    """An initial estimate beyond a row's sphere is moved to the middle height; others stay; the cost there is NaN."""
    batch, source = skywave(10, 9)
    lines = bearing_lines(batch)
    point = local(lines, source)
    away = tuple(
        1.2 * (part - middle) + middle - c for part, middle, c in zip(source.T, CENTER, lines.center, strict=True)
    )
    moved = lines.inside_circles(*away)
    height = np.linalg.norm(np.stack(lines.absolute(*moved)) - np.array(CENTER)[:, None], axis=0)
    np.testing.assert_allclose(height, 0.5 * (EARTH_M + OPAQUE.radius), rtol=1e-9)
    np.testing.assert_array_equal(np.stack(lines.inside_circles(*point)), np.stack(point))
    assert np.isnan(np.stack(lines.slopes(*away))).any(axis=(0, 2)).all()
    assert np.isfinite(lines.residual(*away)).all()
