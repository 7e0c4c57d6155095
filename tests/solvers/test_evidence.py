"""The evidence of targets against clutter, and the gates of candidates: closed forms and numerical integration."""

from __future__ import annotations

import numpy as np
import pytest
from batches import range_batch
from scipy.stats import chi2, norm

from nlosctl.contract.fields import BoxField
from nlosctl.methods.ranges_assignment import METHOD
from nlosctl.solvers.echoes.candidates import Candidates, Gates, find_candidates, fit_candidates
from nlosctl.solvers.echoes.echoes import Echoes, read_echoes
from nlosctl.solvers.echoes.evidence import Hypotheses, choose_targets, clutter_density, target_weights

SENSORS = np.array([(-150.0, -120.0), (-130.0, 150.0), (140.0, -150.0), (160.0, 130.0)])
FIELD = BoxField(xmin_m=-200.0, xmax_m=200.0, ymin_m=-200.0, ymax_m=200.0)
HYPOTHESES = Hypotheses(detection_probability=0.9, reward=0.7, least_evidence=3.0, area_m2=160_000.0, bandwidth_m=40.0)
GATES = Gates(min_sensors=4, gate_std=5.0, false_alarm=1e-5, least_evidence=-50.0, most=100)


def echoes_of(ranges: list[list[float]], std_m: float = 1.0) -> Echoes:
    """Return the echoes of sensors, each with a list of ranges."""
    number = np.repeat(np.arange(len(ranges)), [len(row) for row in ranges])
    flat = np.concatenate(ranges)
    return read_echoes(range_batch(SENSORS[number][None], flat[None], std_m, sensor=number[None], field=FIELD), 0, 100)


def ranges_to(x: float, y: float) -> np.ndarray:
    """Return the distances of a point from the sensors."""
    return np.hypot(x - SENSORS[:, 0], y - SENSORS[:, 1])


def candidate_of(echoes: Echoes, echo: list[int], x: float, y: float) -> Candidates:
    """Return the candidate that takes these echoes, fitted from a point about the sensors' mean."""
    center = SENSORS.mean(axis=0)
    return fit_candidates(echoes, (np.array([x - center[0]]), np.array([y - center[1]])), np.array([echo]))


@pytest.mark.parametrize("masked", [False, True])
def test_the_density_is_a_kernel_estimate_over_all_sensors(masked: bool) -> None:
    """Density: Gaussian kernels at all clutter ranges, reflected at zero, and at the echo's own, per sensor."""
    ranges = [[12.0, 300.0], [150.0], [160.0, 170.0, 400.0], [35.0]]
    echoes = echoes_of(ranges)
    clutter = np.isfinite(echoes.range_m)
    if masked:
        clutter[2, 1] = clutter[0, 0] = False
    found = clutter_density(echoes, 40.0, clutter)
    for sensor, row in enumerate(ranges):
        for index, value in enumerate(row):
            others = [
                other
                for n, line in enumerate(ranges)
                for i, other in enumerate(line)
                if clutter[n, i] or (n, i) == (sensor, index)
            ]
            expected = sum(norm.pdf(value, other, 40.0) + norm.pdf(value, -other, 40.0) for other in others) / 4
            assert found[sensor, index] == pytest.approx(expected, rel=1e-12)
    assert np.isnan(found[1, 1:]).all()


@pytest.mark.parametrize("missed", [None, 2])
def test_the_weight_is_the_marginal_likelihood_ratio(missed: int | None) -> None:
    """The weight is the log of the integral of the likelihood over the region, against clutter, plus the reward."""
    measured = ranges_to(30.0, 40.0) + np.array([0.5, -0.3, 0.2, -0.6])
    echoes = echoes_of([[value, value + 90.0] for value in measured])
    echo = [-1 if sensor == missed else 0 for sensor in range(4)]
    candidate = candidate_of(echoes, echo, 30.0, 40.0)
    density = clutter_density(echoes, 40.0)
    grid = np.linspace(-8.0, 8.0, 401)
    x, y = np.meshgrid(30.0 + grid, 40.0 + grid)
    ratio = np.full(x.shape, 1.0 / HYPOTHESES.area_m2)
    for sensor, (sx, sy) in enumerate(SENSORS):
        seen = norm.pdf(measured[sensor], np.hypot(x - sx, y - sy), 1.0) * 0.9 / density[sensor, 0]
        ratio *= 0.1 if sensor == missed else seen
    expected = np.log(ratio.sum() * (grid[1] - grid[0]) ** 2) + 0.7
    assert target_weights(echoes, candidate, density, HYPOTHESES)[0] == pytest.approx(expected, abs=0.02)


def test_the_defaults_of_the_evidence() -> None:
    """A single target's probability by default: reward 1.5, least evidence 6, detection .95, kernel of 40 m in 400 m.

    Of one echo of each sensor, none is left as clutter, so the gain of the clutter is the number of echoes, 4.
    """
    std, measured = 4.0, ranges_to(30.0, 40.0) + np.array([2.0, -1.5, 1.0, -2.0])
    batch = range_batch(SENSORS[None], measured[None], std, field=FIELD)
    estimates = METHOD.solve(batch, METHOD.options()).estimates
    density = [
        sum(norm.pdf(value, other, 40.0) + norm.pdf(value, -other, 40.0) for other in measured) / 4
        for value in measured
    ]
    u = (estimates.position_m[0] - SENSORS) / np.hypot(*(estimates.position_m[0] - SENSORS).T)[:, None]
    evidence = (
        4 * np.log(0.95)
        - np.log(np.array(density) * np.sqrt(2 * np.pi) * std).sum()
        - estimates.cost[0]
        + np.log(2 * np.pi / 160_000.0 / np.sqrt(np.linalg.det(u.T @ u / std**2)))
        + 1.5
    )
    probability = 1.0 / (1.0 + np.exp(-(evidence + 4 - 6.0)))
    assert 0.5 < probability < 0.995
    assert estimates.columns["existence_probability"][0] == pytest.approx(probability, rel=1e-6)


@pytest.mark.parametrize(("least", "count"), [(3.0, 1), (100.0, 0)])
def test_targets_need_evidence_against_clutter_alone(least: float, count: int) -> None:
    """A set of targets with less than the least evidence is empty."""
    echoes = echoes_of([[value] for value in ranges_to(30.0, 40.0)])
    candidate = candidate_of(echoes, [0, 0, 0, 0], 30.0, 40.0)
    hypotheses = Hypotheses(
        detection_probability=0.9, reward=0.7, least_evidence=least, area_m2=160_000.0, bandwidth_m=40.0
    )
    assert choose_targets(echoes, candidate, hypotheses, 100).chosen.size == count


def test_another_target_for_the_same_echoes_lowers_the_probability() -> None:
    """Two candidates of equal weight that share two of four echoes: one is chosen, with a probability near a half.

    If they share three, they are the same target.
    """
    measured = ranges_to(30.0, 40.0)
    echoes = echoes_of([[value, value + 0.05] for value in measured])
    for shared, least, most in ((2, 0.5, 0.6), (3, 0.8, 1.0)):
        other = [0] * shared + [1] * (4 - shared)
        both = Candidates.join([candidate_of(echoes, echo, 30.0, 40.0) for echo in ([0, 0, 0, 0], other)])
        found = choose_targets(echoes, both, HYPOTHESES, 100)
        assert found.chosen.size == 1
        assert least <= found.existence[0] <= most


@pytest.mark.parametrize(("away", "kept"), [(4.8, True), (5.2, False)])
def test_the_gate_is_five_standard_deviations(away: float, kept: bool) -> None:
    """An echo within the gate of a candidate is tried in place of its own, one beyond is not."""
    measured = ranges_to(30.0, 40.0)
    echoes = echoes_of([[measured[0], measured[0] + away], *([value] for value in measured[1:])])
    gates = Gates(min_sensors=4, gate_std=METHOD.options().gate_std, false_alarm=1e-9, least_evidence=-50.0, most=100)
    center = SENSORS.mean(axis=0)
    seed = np.array([30.0 - center[0]]), np.array([40.0 - center[1]])
    found, complete = find_candidates(echoes, seed, gates, lambda candidates: np.zeros(candidates.chi_square.shape))
    assert complete
    assert (found.echo[:, 0] == 1).any() == kept


@pytest.mark.parametrize(("factor", "kept"), [(0.95, True), (1.05, False), (3.0, False)])
def test_the_chi_square_gate(factor: float, kept: bool) -> None:
    """A candidate passes if its chi-square is at most the quantile of ``false_alarm`` for its degrees of freedom."""
    shape = np.array([1.0, -1.0, -1.0, 1.0])
    unit = candidate_of(echoes_of([[value] for value in ranges_to(5.0, 3.0) + shape]), [0, 0, 0, 0], 5.0, 3.0)
    size = np.sqrt(factor * chi2.isf(METHOD.options().false_alarm, 2) / unit.chi_square[0])
    echoes = echoes_of([[value] for value in ranges_to(5.0, 3.0) + size * shape])
    center = SENSORS.mean(axis=0)
    seed = np.array([5.0 - center[0]]), np.array([3.0 - center[1]])
    found, _ = find_candidates(echoes, seed, GATES, lambda candidates: np.zeros(candidates.chi_square.shape))
    assert (found.chi_square.size == 1) == kept


@pytest.mark.parametrize(("outside", "found"), [(15.0, True), (40.0, False)])
def test_targets_beyond_the_margin_of_the_region_are_not_found(outside: float, found: bool) -> None:
    """A target 15 m outside the search region is found, one 40 m outside is not (``field_margin_m`` is 20)."""
    batch = range_batch(SENSORS[None], ranges_to(200.0 + outside, 10.0)[None], 0.5, field=FIELD)
    position = METHOD.solve(batch, METHOD.options()).estimates.position_m[0]
    assert np.isfinite(position).all() == found


def test_candidates_beyond_the_limit_are_those_of_least_evidence() -> None:
    """With at most one candidate, that of most evidence is kept, and the search is not complete."""
    measured = ranges_to(30.0, 40.0)
    echoes = echoes_of([[value, value + 3.0] for value in measured])
    center = SENSORS.mean(axis=0)
    seed = np.array([30.0 - center[0]]), np.array([40.0 - center[1]])
    gates = Gates(min_sensors=4, gate_std=5.0, false_alarm=1e-5, least_evidence=-50.0, most=1)
    found, complete = find_candidates(echoes, seed, gates, lambda candidates: -candidates.chi_square)
    assert not complete
    assert found.echo.tolist() == [[0, 0, 0, 0]]
