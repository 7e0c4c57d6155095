"""Ranges in three dimensions: exactness, mirror images, heights, mirrors, calibrated covariances."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from range_spheres import distances, sphere_batch
from range_worlds import solve, words
from scipy.optimize import least_squares

from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.result_checks import contract_violation
from nlosctl.contract.scene import LineReflector, PlaneReflector, Scene, SphereReflector
from nlosctl.errors import UsageError
from nlosctl.methods import ranges_r_ls, ranges_sr_ls
from nlosctl.models.ranges.predictions import predict_space_ranges

Array = np.ndarray

BOX = np.array([(0, 0, 0), (30, 0, 12), (0, 25, 9), (30, 25, 1), (15, 12, 14)], dtype=float)
CEILING = np.array([(0, 0, 3), (10, 0, 3), (0, 8, 3)], dtype=float)
SOURCE = np.array([[7.0, 5.0, 1.5]])


@pytest.fixture(params=[ranges_r_ls, ranges_sr_ls], ids=["r-ls", "sr-ls"])
def method(request: pytest.FixtureRequest) -> MethodSpec:
    """Each least-squares method for ranges in turn."""
    spec: MethodSpec = request.param.METHOD
    return spec


@pytest.mark.parametrize("offset", [0.0, 5e6])
def test_exact_ranges_give_the_source(method: MethodSpec, offset: float) -> None:
    """Noise-free ranges give the source in space, for any origin of the frame."""
    solution = solve(method, sphere_batch(BOX + offset, distances(BOX, SOURCE)))
    np.testing.assert_allclose(solution.estimates.position_m[0], SOURCE[0] + offset, atol=1e-6)
    assert contract_violation(solution, (1, 5), 3) == ""


def test_coplanar_sensors_have_two_answers(method: MethodSpec) -> None:
    """Three sensors on a ceiling see the source and its mirror image above the ceiling: ambiguous, both exact."""
    estimates = solve(method, sphere_batch(CEILING, distances(CEILING, SOURCE))).estimates
    assert words(solve(method, sphere_batch(CEILING, distances(CEILING, SOURCE)))) == ["ambiguous", "ambiguous"]
    found = estimates.position_m[np.argsort(estimates.position_m[:, 2])]
    np.testing.assert_allclose(found, [SOURCE[0], [7.0, 5.0, 4.5]], atol=1e-7)


def test_the_lower_image_is_first(method: MethodSpec) -> None:
    """Of mirror images in a ceiling the one under it is the first, whatever the order of the rows."""
    for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0]):
        sensors = CEILING[order]
        estimates = solve(method, sphere_batch(sensors, distances(sensors, SOURCE))).estimates
        np.testing.assert_allclose(estimates.position_m[0], SOURCE[0], atol=1e-7)


def test_unknown_standard_deviations(method: MethodSpec) -> None:
    """Unknown std scale the covariance in space; with a measured height, whose std is stated, they are an error."""
    ranges = distances(BOX, SOURCE) + 0.2 * np.random.default_rng(6).normal(size=(1, 5))
    stated = solve(method, sphere_batch(BOX, ranges, 1.0)).estimates
    unknown = solve(method, sphere_batch(BOX, ranges, 1.0, std="unknown")).estimates
    factor = unknown.columns["std_factor"][0]
    assert unknown.columns["std_dof"][0] == 2
    np.testing.assert_allclose(unknown.position_m[0], stated.position_m[0], atol=1e-6)
    np.testing.assert_allclose(unknown.covariance_m2[0], factor**2 * stated.covariance_m2[0], rtol=1e-6)
    with pytest.raises(UsageError, match="target_z_std_m"):
        solve(method, sphere_batch(BOX, ranges, 1.0, 1.5, 0.3, std="unknown"))


def test_a_tilted_plane_of_sensors_has_the_image_in_it(method: MethodSpec) -> None:
    """Four sensors in a tilted plane see the source and its image in that plane."""
    normal = np.array([0.6, 0.0, 0.8])
    sensors = np.array([(0.0, 0.0), (20.0, 0.0), (0.0, 15.0), (20.0, 15.0)]) @ np.array([[0.8, 0, -0.6], [0, 1.0, 0]])
    estimates = solve(method, sphere_batch(sensors, distances(sensors, SOURCE))).estimates
    image = SOURCE[0] - 2.0 * normal * (normal @ SOURCE[0])
    found = estimates.position_m[np.argsort(np.linalg.norm(estimates.position_m - SOURCE[0], axis=1))]
    np.testing.assert_allclose(found, [SOURCE[0], image], atol=1e-7)


def test_a_source_in_the_plane_of_the_sensors_is_degenerate(method: MethodSpec) -> None:
    """The height of a source in the sensors' plane is not observable: never ok, degenerate without noise."""
    source = np.array([[3.0, 4.0, 3.0]])
    assert words(solve(method, sphere_batch(CEILING, distances(CEILING, source)))) == ["degenerate"]
    noise = 0.05 * np.random.default_rng(3).normal(size=(300, 3))
    found = words(solve(method, sphere_batch(CEILING, distances(CEILING, source) + noise, 0.05)))
    assert "ok" not in found
    assert found.count("degenerate") > 200


def test_sensors_on_a_line_are_degenerate(method: MethodSpec) -> None:
    """Sensors on a line leave a circle of solutions."""
    line = np.outer([0.0, 1.0, 3.0, 9.0], [1.0, 2.0, 0.5])
    assert words(solve(method, sphere_batch(line, distances(line, SOURCE)))) == ["degenerate"]


def test_scalars_are_counted(method: MethodSpec) -> None:
    """Two ranges are too few in space; with a measured height they have two answers at that height."""
    two = CEILING[:2]
    ranges = distances(two, SOURCE)
    assert words(solve(method, sphere_batch(two, ranges))) == ["too_few"]
    assert words(solve(method, sphere_batch(two[:1], ranges[:, :1], z_m=1.5, z_std_m=0.1))) == ["too_few"]
    estimates = solve(method, sphere_batch(two, ranges, z_m=1.5, z_std_m=0.1)).estimates
    np.testing.assert_allclose(np.sort(estimates.position_m[:, 1]), [-5.0, 5.0], atol=1e-6)
    np.testing.assert_allclose(estimates.position_m[:, 2], 1.5, atol=1e-6)
    assert estimates.degrees_of_freedom is not None
    assert estimates.degrees_of_freedom[0] == 0


def test_a_height_decides_between_the_images(method: MethodSpec) -> None:
    """With a measured height the mirror image is gone, and the height is one more degree of freedom."""
    solution = solve(method, sphere_batch(CEILING, distances(CEILING, SOURCE), 0.05, z_m=1.6, z_std_m=0.3))
    assert words(solution) == ["ok"]
    assert solution.estimates.degrees_of_freedom is not None
    assert solution.estimates.degrees_of_freedom.tolist() == [1]
    np.testing.assert_allclose(solution.estimates.position_m[0], SOURCE[0], atol=0.1)


def test_a_missing_height_is_none(method: MethodSpec) -> None:
    """A snapshot whose height is NaN has the bits of one without a height."""
    ranges = distances(BOX, SOURCE) + 0.1 * np.random.default_rng(2).normal(size=(3, 5))
    some = solve(method, sphere_batch(BOX, ranges, z_m=[np.nan, 1.0, np.nan], z_std_m=0.3)).estimates
    none = solve(method, sphere_batch(BOX, ranges)).estimates
    for row in (0, 2):
        first = np.flatnonzero((some.row == row) & (some.alternative == 0))
        other = np.flatnonzero((none.row == row) & (none.alternative == 0))
        np.testing.assert_array_equal(some.position_m[first], none.position_m[other])


def test_a_held_height_is_the_slant_range_of_the_plane(method: MethodSpec) -> None:
    """An exact height gives x, y and their covariance of slant ranges in the plane; z has the covariances 0."""
    from batches import range_batch

    ranges = distances(BOX, SOURCE) + 0.1 * np.random.default_rng(1).normal(size=(20, 5))
    held = solve(method, sphere_batch(BOX, ranges, z_m=1.5, z_std_m=0.0))
    flat = solve(method, range_batch(BOX[:, :2], ranges, height=BOX[:, 2] - 1.5))
    assert contract_violation(held, ranges.shape, 3) == ""
    np.testing.assert_allclose(held.estimates.position_m[:, :2], flat.estimates.position_m, atol=1e-9)
    np.testing.assert_allclose(held.estimates.covariance_m2[:, :3], flat.estimates.covariance_m2, rtol=1e-9)
    assert (held.estimates.position_m[:, 2] == 1.5).all()
    assert (held.estimates.covariance_m2[:, 3:] == 0.0).all()


def _half_chi_square(sensors: Array, ranges: Array, std: Array, height: tuple[float, float] | None) -> Any:
    def residuals(point: Array) -> Array:
        rows = (np.linalg.norm(point - sensors, axis=1) - ranges) / std
        return rows if height is None else np.append(rows, (point[2] - height[0]) / height[1])

    return residuals


def _draw(seed: int, count: int) -> tuple[Array, Array, Array, Array]:
    generator = np.random.default_rng(seed)
    size = np.array([40.0, 30.0, generator.choice([1e-3, 3.0, 20.0])])
    sensors = generator.uniform(-0.5, 0.5, (count, 3)) * size
    source = generator.uniform(-0.7, 0.7, 3) * np.array([40.0, 30.0, 20.0])
    std = generator.uniform(0.05, 0.5, count)
    ranges = np.abs(np.linalg.norm(source - sensors, axis=1) + std * generator.normal(size=count)) + 1e-3
    return sensors, ranges, std, source


@pytest.mark.parametrize(
    "snapshots", [pytest.param(12, id="few"), pytest.param(150, marks=[pytest.mark.slow, pytest.mark.extensive])]
)
@pytest.mark.parametrize("height", [None, 0.5, 20.0])
def test_r_ls_is_the_global_minimum(snapshots: int, height: float | None) -> None:
    """R-LS costs no more than the best of 30 scipy searches, in boxes, flat boxes and under ceilings."""
    worse = 0
    for seed in range(snapshots):
        count = 2 + seed % 5 + (height is None)
        sensors, ranges, std, source = _draw(seed, count)
        measured = None if height is None else (source[2] + 0.3 * height, height)
        heights = {} if measured is None else {"z_m": measured[0], "z_std_m": measured[1]}
        residuals = _half_chi_square(sensors, ranges, std, measured)
        estimates = solve(ranges_r_ls.METHOD, sphere_batch(sensors, ranges[None], std, **heights)).estimates
        starts = np.random.default_rng(seed).uniform(-60.0, 60.0, (30, 3))
        least = min(least_squares(residuals, start, x_scale="jac").cost for start in starts)
        if np.isfinite(estimates.cost[0]):
            worse += estimates.cost[0] > least + 1e-6 * (1.0 + least)
    assert worse <= snapshots // 100


def test_the_covariance_is_the_inverse_information() -> None:
    """The covariance of r-ls is (J'J)^-1 with scipy's Jacobian at the fix, the height's row included."""
    sensors, ranges, std, source = _draw(5, 5)
    estimates = solve(ranges_r_ls.METHOD, sphere_batch(sensors, ranges[None], std, source[2], 0.4)).estimates
    residuals = _half_chi_square(sensors, ranges, std, (float(source[2]), 0.4))
    at = least_squares(residuals, estimates.position_m[0], xtol=1e-15)
    covariance = np.linalg.inv(at.jac.T @ at.jac)
    np.testing.assert_allclose(estimates.position_m[0], at.x, atol=1e-6)
    np.testing.assert_allclose(
        estimates.covariance_m2[0], covariance[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]], rtol=1e-4
    )


def test_the_fit_is_the_same_in_any_frame(method: MethodSpec) -> None:
    """Rotating sensors and source in space rotates the fix, with equal cost."""
    generator = np.random.default_rng(8)
    turn, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    ranges = distances(BOX, SOURCE) + 0.1 * generator.normal(size=(1, 5))
    plain = solve(method, sphere_batch(BOX, ranges)).estimates
    turned = solve(method, sphere_batch(BOX @ turn.T, ranges)).estimates
    np.testing.assert_allclose(turned.position_m, plain.position_m @ turn.T, atol=1e-7)
    np.testing.assert_allclose(turned.cost, plain.cost, atol=1e-9)


SCENE = Scene(
    reflectors=(
        PlaneReflector(name="floor", point=(0.0, 0.0, -1.0), normal=(0.0, 0.0, 2.0)),
        LineReflector(name="wall", point=(-6.0, 0.0), direction=(0.0, 1.0)),
        PlaneReflector(name="roof", point=(0.0, 0.0, 20.0), normal=(0.2, 0.1, -1.0)),
        SphereReflector(name="sky", center=(0.0, 0.0, 0.0), radius=1e3),
    )
)


def _reflected(reflector: Array) -> Array:
    sensors = tuple(np.broadcast_to(part, reflector.shape) for part in BOX.T)
    sources = tuple(np.broadcast_to(part, reflector.shape) for part in SOURCE[0])
    return predict_space_ranges(sensors, sources, reflector, SCENE)


@pytest.mark.parametrize("z_std", [None, 0.3, 0.0])
def test_ranges_by_mirrors_are_unfolded(z_std: float | None) -> None:
    """Rows by a floor, a wall and a slanted roof give the source; the predicted length is the shortest by it."""
    reflector = np.array([[0, 1, 2, -1, 1]])
    heights = {} if z_std is None else {"z_m": 1.5, "z_std_m": z_std}
    batch = sphere_batch(
        BOX, _reflected(reflector), 0.1, **heights, scene=SCENE, reflector=np.asfortranarray(reflector)
    )
    solution = solve(ranges_r_ls.METHOD, batch)
    assert words(solution)[0] in ("ok", "ambiguous")
    np.testing.assert_allclose(solution.estimates.position_m[0], SOURCE[0], atol=1e-6)
    grid = np.stack(np.meshgrid(np.linspace(-40, 60, 2001), np.linspace(-40, 60, 2001)), axis=-1)
    on_floor = np.concatenate([grid, np.full((*grid.shape[:2], 1), -1.0)], axis=-1)
    lengths = np.linalg.norm(on_floor - BOX[0], axis=2) + np.linalg.norm(on_floor - SOURCE[0], axis=2)
    assert _reflected(reflector)[0, 0] == pytest.approx(lengths.min(), abs=1e-4)


@pytest.mark.parametrize("z_std", [None, 0.0])
def test_a_source_beyond_a_mirror_is_infeasible(z_std: float | None) -> None:
    """A fix under the floor that reflects a row is infeasible, with a free and with a held height."""
    source = SOURCE - np.array([0.0, 0.0, 4.0])
    reflector = np.full((1, 5), -1)
    ranges = distances(BOX, source)
    reflector[0, 0] = 0
    ranges[0, 0] = np.linalg.norm(source[0] - (BOX[0] - [0.0, 0.0, 2.0]))
    heights = {} if z_std is None else {"z_m": -2.5, "z_std_m": z_std}
    batch = sphere_batch(BOX, ranges, 0.1, **heights, scene=SCENE, reflector=np.asfortranarray(reflector))
    assert words(solve(ranges_r_ls.METHOD, batch))[0] == "infeasible"


def test_ranges_by_a_sphere_are_rejected() -> None:
    """A row by a sphere is an error that names it."""
    reflector = np.asfortranarray(np.full((1, 5), 3))
    batch = sphere_batch(BOX, distances(BOX, SOURCE), scene=SCENE, reflector=reflector)
    with pytest.raises(UsageError, match="sphere"):
        solve(ranges_r_ls.METHOD, batch)


@pytest.mark.parametrize(
    ("size", "std", "z_std"), [((1000.0, 1000.0, 300.0), 3.0, None), ((20.0, 20.0, 6.0), 0.2, 0.3)], ids=["box", "flat"]
)
def test_errors_are_as_large_as_stated(method: MethodSpec, size: Any, std: float, z_std: float | None) -> None:
    """600 runs: NEES within its 99.9 % interval about 3, RMSE over the stated .93 to 1.07, 95 % hold .93 to .975."""
    generator = np.random.default_rng(11)
    sensors = generator.uniform(0.0, 1.0, (8, 3)) * size
    sources = generator.uniform(0.1, 0.9, (600, 3)) * size
    stds = std * generator.uniform(0.5, 2.0, 8)
    ranges = distances(sensors, sources) + stds * generator.normal(size=(600, 8))
    heights = {} if z_std is None else {"z_m": sources[:, 2] + z_std * generator.normal(size=600), "z_std_m": z_std}
    estimates = solve(method, sphere_batch(sensors, ranges, stds, **heights)).estimates
    best = estimates.alternative == 0
    error, parts = estimates.position_m[best] - sources, estimates.covariance_m2[best]
    covariance = parts[:, [0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape(-1, 3, 3)
    nees = np.einsum("bi,bij,bj->b", error, np.linalg.inv(covariance), error)
    assert 2.68 < nees.mean() < 3.34
    rms = np.sqrt((error**2).sum() / np.trace(covariance, axis1=1, axis2=2).sum())
    assert 0.93 < rms < 1.07
    assert 0.93 < (nees < 7.815).mean() < 0.975
