"""Song, Willett, Zhou 2013, flat mirrors (Section 5.1, Fig. 8): its errata, its figure and its claims.

The truth is `flat_reference`, the paper's formulas one problem at a time; thresholds are those of numerics/song.md.
"""

from __future__ import annotations

import math

import flat_reference as paper
import numpy as np
import pytest
from flat_solving import bearings_batch, dense_batch, solve, solved_rows, summaries

from nlosctl.contract.scene import LineReflector, Scene
from nlosctl.geometry.lines import reflect_points
from nlosctl.models.bearing_predictions import predict_bearings
from nlosctl.models.bearings import sight_lines
from nlosctl.scenarios.catalogue import find_scenario
from nlosctl.scenarios.spec import draw_snapshots

pytestmark = pytest.mark.extensive

SIGMAS_DEG = (0.1, 0.5, 1.0, 2.0, 3.0, 5.0)
PATHS = tuple(zip(paper.SENSORS, paper.MIRRORS, strict=True))
RUNS = 1000
SEED = 20130701


def mirror_scene(mirrors):
    """Return the scene of mirrors y = a x + b."""
    return Scene(
        reflectors=tuple(
            LineReflector(name=f"m{i}", point=(0.0, b), direction=(1.0, a)) for i, (a, b) in enumerate(mirrors)
        )
    )


def random_geometries(count, seed=7):
    """Yield target, sensor and mirror, the first two on one side of the third."""
    generator = np.random.default_rng(seed)
    found = 0
    while found < count:
        target, sensor = generator.uniform(-10.0, 10.0, (2, 2))
        a, b = math.tan(generator.uniform(-1.5, 1.5)), generator.uniform(-10.0, 10.0)
        if (target[1] - a * target[0] - b) * (sensor[1] - a * sensor[0] - b) > 0.0:
            found += 1
            yield target, sensor, (a, b)


def paper_draw(sigma_deg, runs):
    """Return the batch of the paper's geometry."""
    spec = find_scenario("song-flat")
    options = spec.options(bearing_std_deg=sigma_deg)
    (columns,) = draw_snapshots(spec, options, SEED, runs)
    return dense_batch(spec.scene(options), columns)


def predicted(target, sensor, mirror):
    """Return nlosctl's noise-free bearing of one geometry."""
    return float(predict_bearings(sensor[None], np.zeros(1, dtype=int), mirror_scene([mirror]), target[None])[0])


# --- the forward model and its errata -----------------------------------------------------------------------------


def test_target_image_and_sensor_image_agree():
    """Appendix 6.2: both images give the bearing that nlosctl predicts, to 1e-12 rad."""
    for target, sensor, mirror in random_geometries(500):
        ours = predicted(target, sensor, mirror)
        by_target = paper.bearing_by_target_image(target, sensor, mirror)
        by_sensor = paper.bearing_by_sensor_image(target, sensor, mirror)
        assert abs(paper.wrap(ours - by_target)) < 1e-12
        assert abs(paper.wrap(ours - by_sensor)) < 1e-12


def test_bearing_points_at_the_specular_hit():
    """The bearing points from the sensor to where the shortest path by the mirror touches it (Fermat)."""
    for target, sensor, mirror in random_geometries(500, seed=8):
        hit = paper.hit_by_fermat(target, sensor, mirror)
        bearing = math.atan2(hit[1] - sensor[1], hit[0] - sensor[0])
        slack = 1e-12 + 1e-13 / math.hypot(*(hit - sensor))
        assert abs(paper.wrap(predicted(target, sensor, mirror) - bearing)) < slack


def test_erratum_arctan_must_be_atan2():
    """(3) with arctan as printed is wrong by exactly pi about every second time, and right otherwise."""
    off_by_pi = 0
    for target, sensor, mirror in random_geometries(2000, seed=9):
        difference = abs(
            paper.wrap(paper.bearing_as_printed(target, sensor, mirror) - predicted(target, sensor, mirror))
        )
        assert min(difference, abs(difference - math.pi)) < 1e-9
        off_by_pi += difference > 1.0
    assert 0.46 < off_by_pi / 2000 < 0.54


def test_erratum_slope_of_the_mirrored_reference_line():
    """The image of the horizontal line has slope tan(2 arctan a), not the printed tan(2 a)."""
    for a in (-3.0, -0.7, 0.3, 0.5, 4.0):
        x, y = reflect_points(*np.array([[0.0, 1.0], [0.0, 0.0]]), np.array(0.0), np.array(2.0), np.array(math.atan(a)))
        slope = (y[1] - y[0]) / (x[1] - x[0])
        assert slope == pytest.approx(math.tan(2 * math.atan(a)), rel=1e-12)
        assert abs(slope - math.tan(2 * a)) > 0.01


def test_equations_4_and_47_are_right_as_printed():
    """The printed image is the one by the foot of the perpendicular, and nlosctl's, to 1e-12 of the scene."""
    for point, _, (a, b) in random_geometries(300, seed=10):
        printed = paper.image(point, (a, b))
        ours = reflect_points(*point, np.array(0.0), np.array(b), np.array(math.atan(a)))
        np.testing.assert_allclose(printed, paper.image_by_foot(point, (a, b)), atol=1e-11)
        np.testing.assert_allclose(ours, printed, atol=1e-11)


def test_vertical_mirror_has_the_image_of_the_appendix():
    """The surface x = c, which y = a x + b can't say, sends (x, y) to (2 c - x, y)."""
    x, y = reflect_points(np.array([3.0]), np.array([-4.0]), np.array([5.0]), np.array([99.0]), np.array([math.pi / 2]))
    np.testing.assert_allclose([x[0], y[0]], [7.0, -4.0], atol=1e-12)


def test_equation_9_is_the_sine_of_our_residual():
    """(9) as printed is sin(measured - predicted bearing) at any point: the residual that the methods report."""
    generator = np.random.default_rng(11)
    for target, sensor, mirror in random_geometries(200, seed=11):
        bearing = paper.bearing_by_target_image(target, sensor, mirror) + generator.normal() * 0.1
        (sine, cosine), offset, origin = (part[0] for part in paper.lines([bearing], [sensor], [mirror]))
        printed = (target[0] * sine + target[1] * cosine - offset) / math.hypot(*(target - origin))
        rays = sight_lines(bearings_batch(mirror_scene([mirror]), [sensor], [[bearing]], 0.1, [0]))
        residual = rays.bearing_residual_rad(target[:1] - rays.center_x, target[1:] - rays.center_y)
        assert math.sin(residual[0, 0]) == pytest.approx(printed, abs=1e-12)


def test_equation_23_is_right_and_opposite_to_the_direct_path():
    """The printed derivatives are those of the bearing by a mirror; a direct path has the opposite sign."""
    step = 1e-5
    for target, sensor, mirror in random_geometries(200, seed=12):
        x, y = target - np.array(paper.image(sensor, mirror))
        printed = np.array([y, -x]) / (x * x + y * y)
        shifts = step * np.eye(2)
        reflected = [
            paper.wrap(predicted(target + s, sensor, mirror) - predicted(target - s, sensor, mirror)) / (2 * step)
            for s in shifts
        ]
        np.testing.assert_allclose(reflected, printed, rtol=1e-6, atol=1e-7 * np.abs(printed).max())
        direct = [
            paper.wrap(math.atan2(*(target + s - sensor)[::-1]) - math.atan2(*(target - s - sensor)[::-1])) / (2 * step)
            for s in shifts
        ]
        x, y = target - sensor
        np.testing.assert_allclose(direct, np.array([-y, x]) / (x * x + y * y), rtol=1e-5, atol=1e-6)


# --- the estimators, snapshot by snapshot -------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["ls", "stansfield", "ml"])
def test_noise_free_bearings_return_the_target(name):
    """Without noise every method finds the target within 1e-9 of the scene's size."""
    bearings = [paper.bearing_by_target_image(paper.TARGET, s, m) for s, m in PATHS]
    batch = bearings_batch(mirror_scene(paper.MIRRORS), paper.SENSORS, [bearings], math.radians(1.0), [0, 1, 2])
    error = solve(name, batch).estimates.position_m[0] - paper.TARGET
    assert math.hypot(*error) < 1e-9 * 1e4


def test_least_squares_and_stansfield_are_the_printed_solutions():
    """(19) and (15) by an orthogonal decomposition, one problem at a time: within 1e-6 m, sigmas unequal too."""
    sigmas = np.radians([0.3, 1.0, 2.0])
    batch = paper_draw(1.0, 100)
    uneven = bearings_batch(batch.scene, paper.SENSORS, batch.bearing_rad, sigmas, [0, 1, 2])
    ls, stansfield = (solve(name, uneven).estimates.position_m for name in ("ls", "stansfield"))
    for place, bearings in enumerate(batch.bearing_rad):
        np.testing.assert_allclose(
            ls[place], paper.least_squares_fix(bearings, paper.SENSORS, paper.MIRRORS), atol=1e-6
        )
        np.testing.assert_allclose(
            stansfield[place], paper.stansfield_fix(bearings, paper.SENSORS, paper.MIRRORS, sigmas), atol=1e-6
        )


@pytest.mark.parametrize("sigma_deg", [0.1, 1.0, 5.0])
def test_maximum_likelihood_is_the_minimum_that_scipy_finds(sigma_deg):
    """(6) by scipy's least_squares, tight: within 1e-6 of a standard deviation."""
    batch = paper_draw(sigma_deg, 30)
    found = solve("ml", batch).estimates
    sigmas = np.full(3, math.radians(sigma_deg))
    for place, bearings in enumerate(batch.bearing_rad):
        expected = paper.maximum_likelihood_fix(bearings, paper.SENSORS, paper.MIRRORS, sigmas, paper.TARGET)
        spread = math.sqrt(found.covariance_m2[place, 0] + found.covariance_m2[place, 2])
        assert math.hypot(*(found.position_m[place] - expected)) < 1e-6 * spread


def test_covariance_of_maximum_likelihood_is_the_inverse_of_27_to_29():
    """At the estimate, against derivatives taken numerically from the target-image model."""
    batch = paper_draw(2.0, 20)
    found = solve("ml", batch).estimates
    for position, (xx, xy, yy) in zip(found.position_m, found.covariance_m2, strict=True):
        information = paper.information(position, paper.SENSORS, paper.MIRRORS, np.full(3, math.radians(2.0)))
        np.testing.assert_allclose(information @ [[xx, xy], [xy, yy]], np.eye(2), atol=1e-6)


# --- Fig. 8 and what the paper says of it -------------------------------------------------------------------------


def bound_m(sigma_deg):
    """Return the root of the trace of the Cramer-Rao bound at the target."""
    sigmas = np.full(3, math.radians(sigma_deg))
    bound = np.linalg.inv(paper.information(np.array(paper.TARGET), paper.SENSORS, paper.MIRRORS, sigmas))
    return math.sqrt(np.trace(bound))


@pytest.fixture(scope="module")
def figure_8():
    """Summaries by sigma and method, the paper's 1000 runs, the same noise for all."""
    return {sigma: summaries(solved_rows("song-flat", RUNS, SEED, bearing_std_deg=sigma)) for sigma in SIGMAS_DEG}


@pytest.mark.parametrize("sigma_deg", SIGMAS_DEG)
def test_cramer_rao_bound_is_that_of_the_reference_run(sigma_deg):
    """The bound is 311 m per degree."""
    assert bound_m(sigma_deg) == pytest.approx(311.0 * sigma_deg, rel=2e-3)


@pytest.mark.parametrize("sigma_deg", SIGMAS_DEG)
@pytest.mark.parametrize("name", ["ls", "stansfield", "ml"])
def test_every_run_has_a_fix(figure_8, sigma_deg, name):
    """No run of the paper's geometry fails, at any of its sigmas."""
    summary = figure_8[sigma_deg][name]
    assert (summary.rows, summary.answered, summary.nees_rows) == (RUNS, RUNS, RUNS), summary.statuses


@pytest.mark.parametrize("sigma_deg", [1e-6, 1e-4, 1e-2])
def test_precise_bearings_converge_too(sigma_deg):
    """Where rounding is no longer small beside the noise, every run still settles, and at the bound."""
    summary = summaries(solved_rows("song-flat", RUNS, SEED, bearing_std_deg=sigma_deg))["ml"]
    assert summary.statuses == {"ok": RUNS}
    assert 0.93 < summary.rmse_m / bound_m(sigma_deg) < 1.07


@pytest.mark.parametrize("sigma_deg", SIGMAS_DEG)
def test_maximum_likelihood_reaches_the_bound(figure_8, sigma_deg):
    """RMSE / bound in 0.93 .. 1.07, NEES in 1.75 .. 2.25, the 95 % ellipse covers 93 to 97.5 %."""
    summary = figure_8[sigma_deg]["ml"]
    assert 0.93 < summary.rmse_m / bound_m(sigma_deg) < 1.07
    assert 1.75 < summary.nees < 2.25
    assert 0.93 < summary.coverage_95 < 0.975


@pytest.mark.parametrize("sigma_deg", SIGMAS_DEG)
@pytest.mark.parametrize("name", ["ls", "stansfield"])
def test_covariances_of_the_linear_fits_match_their_errors(figure_8, sigma_deg, name):
    """Least squares by its sandwich and Stansfield by its normal matrix are as consistent as maximum likelihood."""
    summary = figure_8[sigma_deg][name]
    assert 1.75 < summary.nees < 2.25
    assert 0.925 < summary.coverage_95 < 0.975


@pytest.mark.parametrize(
    ("sigma_deg", "ls", "stansfield", "ml"),
    [
        (0.1, 31.9, 30.9, 30.9),
        (0.5, 159.7, 155.3, 155.4),
        (1.0, 319, 313, 313),
        (2.0, 647, 620, 623),
        (3.0, 945, 927, 930),
        (5.0, 1522, 1482, 1507),
    ],
)
def test_rmse_is_that_of_the_reference_run(figure_8, sigma_deg, ls, stansfield, ml):
    """Another 1000 runs, by another implementation: equal within the Monte-Carlo error of both, 3 sigma."""
    found = figure_8[sigma_deg]
    for name, expected in (("ls", ls), ("stansfield", stansfield), ("ml", ml)):
        assert found[name].rmse_m == pytest.approx(expected, rel=0.09)


def test_claim_rmse_is_linear_in_sigma(figure_8):
    """RMSE per degree is the same at 0.1 and 3 deg within 6 %, for each estimator, on the same noise."""
    for name in ("ls", "stansfield", "ml"):
        per_degree = [figure_8[sigma][name].rmse_m / sigma for sigma in (0.1, 0.5, 1.0, 2.0, 3.0)]
        assert max(per_degree) / min(per_degree) < 1.06


def test_claim_least_squares_is_worst_and_stansfield_close(figure_8):
    """On the same noise least squares is worse by 1 to 5 % only (the distances are alike), Stansfield within 2 %."""
    for sigma in (0.1, 0.5, 1.0, 2.0, 3.0):
        found = figure_8[sigma]
        assert 1.01 < found["ls"].rmse_m / found["ml"].rmse_m < 1.05
        assert found["stansfield"].rmse_m == pytest.approx(found["ml"].rmse_m, rel=0.02)


@pytest.fixture(scope="module")
def mixed():
    """Random mixed scenes, direct and reflected rows, unequal sigmas: the rows that all three methods solve."""
    rows = solved_rows("random", 4000, SEED)
    answered = np.flatnonzero(np.logical_and.reduce([part.answered for part in rows.values()]))
    assert answered.size > 3900
    return {name: part.take(answered) for name, part in rows.items()}


def test_claim_least_squares_is_far_worse_in_heterogeneous_scenes(mixed):
    """Where distances and sigmas differ, least squares has about twice the error of Stansfield."""
    found = summaries(mixed)
    assert found["ls"].rmse_m > 1.6 * found["stansfield"].rmse_m
    assert found["ls"].median_m > 1.6 * found["stansfield"].median_m
    assert found["stansfield"].rmse_m == pytest.approx(found["ml"].rmse_m, rel=0.05)


def test_covariances_hold_in_random_mixed_scenes(mixed):
    """Maximum likelihood covers 93 to 97.5 % by its 95 % ellipses, the linear fits hardly less."""
    found = summaries(mixed)
    assert 0.93 < found["ml"].coverage_95 < 0.975
    assert 0.93 < found["ls"].coverage_95 < 0.975
    assert 0.92 < found["stansfield"].coverage_95 < 0.975


@pytest.mark.slow
def test_bias_grows_as_sigma_squared_and_is_small():
    """200,000 runs at 5 deg: least squares falls short of the target, maximum likelihood beyond it, under 5 %."""
    found = summaries(solved_rows("song-flat", 200_000, SEED, bearing_std_deg=5.0))
    expected = {"ls": (-42.0, -37.0), "stansfield": (-28.0, -49.0), "ml": (44.0, 46.0)}
    for name, bias in expected.items():
        summary = found[name]
        assert (summary.bias_x_m, summary.bias_y_m) == pytest.approx(bias, abs=12.0)
        assert math.hypot(summary.bias_x_m, summary.bias_y_m) < 0.05 * summary.rmse_m


def test_bias_of_least_squares_and_maximum_likelihood_have_opposite_signs():
    """On the same 8000 runs at 5 deg their means differ by the sum of both biases: it is not why one is worse."""
    found = summaries(solved_rows("song-flat", 8000, SEED, bearing_std_deg=5.0))
    assert found["ml"].bias_x_m - found["ls"].bias_x_m == pytest.approx(86.0, abs=15.0)
    assert found["ml"].bias_y_m - found["ls"].bias_y_m == pytest.approx(83.0, abs=15.0)
