"""Specular points on a circle, compared with the quartic's roots, Fermat's principle and finite differences."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from circle_worlds import EARTH_M, IONOSPHERE_M, draw_disc, parts, quartic_points, unblocked_points

from nlosctl.geometry import short_arc
from nlosctl.geometry.circular_reflection import all_points, all_reflections, count_reflections, reflect_at, separatrix
from nlosctl.geometry.roots import bracketed_roots
from nlosctl.geometry.short_arc import short_arc_reflection


def draw_visible(count, seed):
    """Return sensors on the earth and sources visible to them by the ionosphere, as complex numbers."""
    generator = np.random.default_rng(seed)
    sensor = EARTH_M * np.exp(2j * np.pi * generator.random(count))
    height = generator.uniform(EARTH_M, 0.999 * IONOSPHERE_M, count)
    reach = 2.0 * np.arccos(EARTH_M / IONOSPHERE_M) - np.arccos(EARTH_M / height)
    angle = generator.uniform(-0.999, 0.999, count) * reach
    return sensor, sensor / EARTH_M * height * np.exp(1j * angle)


def short_path(sensor, source, radius=IONOSPHERE_M):
    """Return the path on the short arc."""
    return short_arc_reflection(*parts(sensor), *parts(source), np.full(sensor.shape, radius))


def test_counts_and_points_agree_with_the_quartic():
    """For 10,000 random pairs the number of paths is that of the quartic, and each point is one of its roots."""
    generator = np.random.default_rng(3)
    sensor, source = draw_disc(generator, 10_000), draw_disc(generator, 10_000)
    one = np.ones(sensor.shape)
    count = count_reflections(*parts(sensor), *parts(source), one)
    x, y = all_points(*parts(sensor), *parts(source), one)
    assert set(np.unique(count)) == {2, 4}
    worst = 0.0
    for row in range(sensor.shape[0]):
        expected = quartic_points(sensor[row], source[row])
        found = (x[:, row] + 1j * y[:, row])[~np.isnan(x[:, row])]
        assert len(expected) == len(found) == count[row]
        worst = max(worst, np.abs(found[np.argsort(np.angle(found))] - expected).max())
    assert worst < 1e-8  # what double roots leave of np.roots; our own residual is tested below


def test_every_path_obeys_the_law_of_reflection():
    """At each point incidence equals reflection (the length is stationary), and equation (33) holds."""
    generator = np.random.default_rng(4)
    sensor, source = draw_disc(generator, 5000), draw_disc(generator, 5000)
    path = all_reflections(*parts(sensor), *parts(source), np.ones(sensor.shape))
    hit = path.hit_x + 1j * path.hit_y
    tangent = 1j * hit
    out, back = sensor - hit, source - hit
    with np.errstate(invalid="ignore"):
        slope = np.real(np.conj(tangent) * (out / np.abs(out) + back / np.abs(back)))
    there = ~np.isnan(slope)
    shorter_leg = np.minimum(path.first_leg_m, path.second_leg_m)
    assert (np.abs(slope) * shorter_leg)[there].max() < 1e-14
    theta = np.angle(hit)
    p, w = sensor * source, sensor + source
    left = w.imag * np.cos(theta) - w.real * np.sin(theta)
    right = p.imag * np.cos(2.0 * theta) - p.real * np.sin(2.0 * theta)
    assert np.abs(left - right)[there].max() < 1e-13
    np.testing.assert_allclose(path.bearing_rad[there], np.angle(hit - sensor)[there], atol=1e-15)


@pytest.mark.parametrize(
    ("sensor", "source", "count"),
    [
        (0.5 + 0.0j, -0.5 + 0.0j, 4),  # Fig. 4
        (0.0 + 0.0j, 0.3 + 0.4j, 2),
        (0.3 + 0.4j, 0.3 + 0.4j, 2),
        (0.9 + 0.0j, 0.9 + 0.0j, 2),
        (0.0 + 0.0j, 0.0 + 0.0j, 0),  # every point of the circle reflects
        (1.2 + 0.0j, 0.3 + 0.0j, 0),
        (0.3 + 0.0j, 0.0 + 1.0j, 0),
        (-1.0 + 0.0j, 0.3 + 0.0j, 0),
    ],
)
def test_special_pairs(sensor, source, count):
    """Symmetric pairs, the centre and points outside have the number of paths known from geometry."""
    pair = (*parts(np.array([sensor])), *parts(np.array([source])), np.ones(1))
    assert count_reflections(*pair)[0] == count
    assert np.count_nonzero(np.isfinite(all_points(*pair)[0])) == count


@pytest.mark.parametrize("place", [0.5, -0.7, 0.5j, 0.3 + 0.4j])
def test_from_the_centre_two_paths_lie_on_one_diameter(place):
    """From the centre, the points are the two ends of the diameter through the other point."""
    for pair in ((0.0, place), (place, 0.0)):
        places = [part for point in pair for part in parts(np.array([point + 0j]))]
        x, y = all_points(*places, np.ones(1))
        ends = (x + 1j * y)[:2, 0] / (place / abs(place))
        np.testing.assert_allclose(sorted(ends, key=np.real), [-1.0, 1.0], atol=1e-12)
        assert count_reflections(*places, np.ones(1)).tolist() == [2]


def test_four_paths_of_figure_4_are_on_the_axes():
    """A source opposite the sensor is seen over the four ends of the axes."""
    x, y = all_points(*parts(np.array([0.5 + 0j])), *parts(np.array([-0.5 + 0j])), np.ones(1))
    found = sorted(zip(np.round(x[:, 0], 9) + 0.0, np.round(y[:, 0], 9) + 0.0, strict=True))
    assert found == [(-1.0, 0.0), (0.0, -1.0), (0.0, 1.0), (1.0, 0.0)]


@pytest.mark.parametrize("sensor", [0.955 + 0.0j, -0.2 + 0.25j, 0.3 - 0.6j])
def test_two_paths_coincide_on_the_separatrix(sensor):
    """On (37)-(38) there are three paths, one of them double with zero spread; beside it there are 2 or 4."""
    radius = 3.0
    theta = np.linspace(0.05, 2.0 * np.pi - 0.05, 400)
    x, y = separatrix(radius * sensor.real, radius * sensor.imag, radius, theta)
    curve = (x + 1j * y) / radius
    speed = np.abs(np.gradient(curve))
    ordinary = (np.abs(curve) < 0.99) & (speed > 1e-3)  # not at the cusps
    curve, theta = curve[ordinary], theta[ordinary]
    assert curve.size > 50
    w, p = sensor + curve, sensor * curve
    # The double root is the point that the parameter names: (33) and its derivative vanish there.
    turn = theta + np.angle(sensor)
    value = w.imag * np.cos(turn) - w.real * np.sin(turn) - p.imag * np.cos(2 * turn) + p.real * np.sin(2 * turn)
    slope = -w.imag * np.sin(turn) - w.real * np.cos(turn)
    slope += 2 * p.imag * np.sin(2 * turn) + 2 * p.real * np.cos(2 * turn)
    assert np.abs(value).max() < 1e-14
    assert np.abs(slope).max() < 1e-13
    pair = [np.full(curve.shape, part) for part in (sensor.real, sensor.imag)]
    normal = 1j * (curve - np.exp(1j * turn))  # the ray touches its caustic
    normal /= np.abs(normal)
    sides = [count_reflections(*pair, *parts(curve + shift * normal), np.ones(curve.shape)) for shift in (-1e-7, 1e-7)]
    assert {tuple(sorted(two)) for two in np.array(sides).T} == {(2, 4)}
    path = all_reflections(*pair, *parts(curve), np.ones(curve.shape))
    assert np.nanmin(np.abs(path.tube_width_m), axis=0).max() < 1e-5


def test_a_source_on_the_separatrix_has_three_paths():
    """Exactly on the caustic two of the four points coincide, and three are returned."""
    sensor, double = 0.8, 2.0
    theta = np.array([double])
    x, y = separatrix(sensor, 0.0, 1.0, theta)
    pair = (np.array([sensor]), np.zeros(1), x, y, np.ones(1))
    assert count_reflections(*pair)[0] == 3
    found_x, found_y = (part[:, 0] for part in all_points(*pair))
    assert np.count_nonzero(np.isfinite(found_x)) == 3
    turned = np.exp(-1j * double) * (found_x + 1j * found_y)
    assert np.nanmin(np.abs(turned - 1.0)) < 1e-6


def test_erratum_parameter_of_the_separatrix():
    """Erratum: t of (37)-(38) is cot(theta / 2); with the tangent the curve has no double roots."""
    sensor, theta = 0.955, np.array([1.9, 2.4])
    right = np.array(separatrix(sensor, 0.0, 1.0, theta))
    wrong = np.array(separatrix(sensor, 0.0, 1.0, np.pi - theta))  # tan(theta/2) = cot((pi - theta)/2)
    assert np.abs(right - wrong).max() > 0.1


def test_the_separatrix_of_the_centre_is_the_centre():
    """From the centre every other point has two paths: the separatrix shrinks to a point."""
    x, y = separatrix(0.0, 0.0, 3.0, np.linspace(0.1, 6.2, 50))
    assert not x.any()
    assert not y.any()


def test_the_separatrix_at_half_the_radius_is_unbounded():
    """At half the radius the cusp on the sensor's side is at infinity."""
    x, _ = separatrix(0.5, 0.0, 1.0, np.array([0.0, 1e-3, 1e-2]))
    assert not np.isfinite(x[0])
    assert x[1] < x[2] < -100.0


def test_singular_gradients_give_no_warning():
    """On a caustic the bearing's gradient is infinite; at the reflection point there is no direction. No warnings."""
    hit = (np.full(2, 0.6), np.full(2, 0.8))
    there, elsewhere = (np.array([0.6, 0.1]), np.array([0.8, 0.2])), (np.zeros(2), np.full(2, 0.5))
    assert np.isfinite(reflect_at(*hit, *there, *elsewhere).tube_width_m).tolist() == [False, True]
    path = reflect_at(*hit, *elsewhere, *there)
    assert np.isfinite(path.cosine).tolist() == [False, True]
    caustic = dataclasses.replace(
        path, tube_width_m=np.zeros(2), cosine=np.array([0.6, 1.0]), sine=np.array([0.8, 0.0])
    )
    by_x, by_y = caustic.bearing_gradient()
    assert np.isposinf(by_x).tolist() == [True, False]
    assert np.isneginf(by_y).all()


def test_singular_points_of_the_separatrix():
    """(39) are cusps of the curve, and (40), the farthest corner of A2 on the ground, is one of them: AD = 2 BC."""
    c = EARTH_M / IONOSPHERE_M
    corner = EARTH_M * np.exp(2j * np.arccos(c))  # Erratum: the arc AD is 2 acos(r/R), twice BC
    cusp = c * (2.0 * c * c - 1.0) + 2j * c * c * np.sqrt(1.0 - c * c)
    np.testing.assert_allclose(corner / IONOSPHERE_M, cusp, atol=1e-15)
    theta = np.arange(0.001, np.pi, 0.0005)
    x, y = separatrix(c, 0.0, 1.0, theta)
    nearest = np.argmin(np.abs(x + 1j * y - cusp))
    assert np.abs(x + 1j * y - cusp)[nearest] < 1e-5
    speed = np.abs(np.gradient(x + 1j * y))
    assert speed[nearest - 2 : nearest + 3].min() < 1e-3 * np.median(speed)


def test_the_short_arc_path_is_unblocked():
    """In A2 exactly one specular point is unblocked (Lemmas 2, 3), and it is the one on the short arc."""
    sensor, source = draw_visible(1500, 5)
    path = short_path(sensor, source)
    for row in range(sensor.shape[0]):
        free = unblocked_points(sensor[row], source[row], IONOSPHERE_M, EARTH_M)
        assert len(free) == 1
        assert abs(np.angle(free[0] / (path.hit_x[row] + 1j * path.hit_y[row]))) < 1e-8
    assert path.tube_width_m.min() > 0.0


def test_newton_steps_solve_nearly_every_short_arc(monkeypatch):
    """Over the horizon fewer than one root in a hundred needs the slow bracketed search."""
    searched = []

    def counted(function, low, high, guess):
        searched.append(low.size)
        return bracketed_roots(function, low, high, guess)

    monkeypatch.setattr(short_arc, "bracketed_roots", counted)
    short_path(*draw_visible(5000, 17))
    assert sum(searched) < 50


def test_the_short_arc_root_is_exact():
    """The bracketed root solves (33) to rounding: 1e-10 rad or better."""
    sensor, source = draw_visible(2000, 6)
    path = short_path(sensor, source)
    hit = path.hit_x + 1j * path.hit_y
    out, back = sensor - hit, source - hit
    slope = np.real(np.conj(1j * hit / IONOSPHERE_M) * (out / np.abs(out) + back / np.abs(back)))
    # The coordinates themselves are good to a nanometre of the shorter leg.
    assert (np.abs(slope) * np.minimum(np.abs(out), np.abs(back))).max() < 1e-8


def test_gradient_agrees_with_finite_differences():
    """The closed-form gradient of the bearing agrees with central differences, 1e-8 relative."""
    sensor, source = draw_visible(400, 7)
    path = short_path(sensor, source)
    step = np.minimum(60.0, 0.005 * (IONOSPHERE_M - np.abs(source)))
    for turn, slope in zip((1.0, 1j), path.bearing_gradient(), strict=True):
        # Fourth order: 8 (f1 - f-1) - (f2 - f-2), so that truncation stays far below 1e-8.
        bearings = [short_path(sensor, source + turn * step * n).bearing_rad for n in (-2, -1, 1, 2)]
        steps = [np.angle(np.exp(1j * (b - path.bearing_rad))) for b in bearings]
        numeric = (8.0 * (steps[2] - steps[1]) - (steps[3] - steps[0])) / (12.0 * step)
        size = 1.0 / np.abs(path.tube_width_m)
        usable = np.abs(source) < IONOSPHERE_M - 2e3
        assert (np.abs(numeric - slope) / size)[usable].max() < 1e-8


def test_gradient_agrees_with_implicit_differentiation():
    """The closed-form gradient of all paths agrees with implicit differentiation of (33), 1e-8 relative."""
    generator = np.random.default_rng(8)
    sensor, source = draw_disc(generator, 4000), draw_disc(generator, 4000)
    path = all_reflections(*parts(sensor), *parts(source), np.ones(sensor.shape))
    theta = np.arctan2(path.hit_y, path.hit_x)
    xs, ys, xt, yt = sensor.real, sensor.imag, source.real, source.imag
    c1, s1, c2, s2 = np.cos(theta), np.sin(theta), np.cos(2 * theta), np.sin(2 * theta)
    by_theta = -(ys + yt) * s1 - (xs + xt) * c1 + 2 * (xs * yt + xt * ys) * s2 + 2 * (xs * xt - ys * yt) * c2
    by_x = -s1 - (ys * c2 - xs * s2)
    by_y = c1 - (xs * c2 + ys * s2)
    dx, dy = path.hit_x - xs, path.hit_y - ys
    bearing_by_theta = (dx * c1 + dy * s1) / (dx * dx + dy * dy)
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = np.stack([-bearing_by_theta * by_x / by_theta, -bearing_by_theta * by_y / by_theta])
    found = np.stack(path.bearing_gradient())
    clear = np.abs(path.tube_width_m) > 1e-3  # nearer to the caustic both lose their digits
    error = np.abs(found - expected) * np.abs(path.tube_width_m)
    assert np.count_nonzero(clear) > 8000
    assert error[:, clear].max() < 1e-8


def test_paths_turn_with_the_frame():
    """Rotating sensor and source rotates the reflection point."""
    sensor, source = draw_visible(200, 9)
    turn = np.exp(0.7j)
    first, second = short_path(sensor, source), short_path(turn * sensor, turn * source)
    hit = turn * (first.hit_x + 1j * first.hit_y)
    np.testing.assert_allclose(second.hit_x + 1j * second.hit_y, hit, atol=1e-7)


def test_paths_do_not_depend_on_the_block():
    """A path has the same bits alone and in a block."""
    sensor, source = draw_visible(50, 10)
    together = short_path(sensor, source)
    alone = [short_path(sensor[[row]], source[[row]]) for row in range(50)]
    assert (np.array([path.bearing_rad[0] for path in alone]) == together.bearing_rad).all()
    one = np.ones(50)
    block = all_points(*parts(sensor / IONOSPHERE_M), *parts(source / IONOSPHERE_M), one)[0]
    single = [
        all_points(*parts(sensor[[row]] / IONOSPHERE_M), *parts(source[[row]] / IONOSPHERE_M), one[:1])[0][:, 0]
        for row in range(50)
    ]
    np.testing.assert_array_equal(np.array(single).T, block)


def test_points_outside_have_no_path():
    """Points outside the circle and at its centre give NaN and leave the other rows unchanged."""
    for row, place in enumerate((1.2, 1.0, 0.0, np.nan)):
        for which in range(2):
            pair = [part / IONOSPHERE_M for part in draw_visible(5, 11)]
            free = short_path(*pair, radius=1.0).bearing_rad
            pair[which][row] = place
            found = short_path(*pair, radius=1.0).bearing_rad
            assert np.isfinite(free).all()
            assert np.isnan(found).tolist() == [number == row for number in range(5)]
            assert np.array_equal(np.delete(found, row), np.delete(free, row))


def test_points_near_the_centre_keep_their_digits():
    """Within a thousandth of the radius of the centre every path found is specular to rounding."""
    generator = np.random.default_rng(16)
    sensor, source = 1e-4 * draw_disc(generator, 300), 1e-3 * draw_disc(generator, 300)
    path = all_reflections(*parts(sensor), *parts(source), np.ones(300))
    hit = path.hit_x + 1j * path.hit_y
    out, back = sensor - hit, source - hit
    with np.errstate(invalid="ignore"):  # paths that are not there
        slope = np.real(np.conj(1j * hit) * (out / np.abs(out) + back / np.abs(back)))
    assert (np.isfinite(slope).sum(axis=0) >= 2).all()
    assert np.nanmax(np.abs(slope)) < 1e-14
