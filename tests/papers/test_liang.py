"""Results of Liang, Zeng, Li, and limits from an independent implementation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.fields import BoxField, Field
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.statuses import Status
from nlosctl.methods import ranges_assignment, ranges_extended_tca
from nlosctl.scenarios import echo_field, liang
from nlosctl.scenarios.spec import Columns, ScenarioSpec

pytestmark = pytest.mark.extensive

PAPER_FIELD = BoxField(xmin_m=-200.0, xmax_m=200.0, ymin_m=-200.0, ymax_m=200.0)

REPRODUCED = {
    (15, 4, 0): 0.718,
    (15, 5, -10): 0.976,
    (15, 5, 0): 0.793,
    (15, 5, 5): 0.369,
    (15, 6, 0): 0.769,
    (35, 5, 0): 0.783,
    (35, 5, 5): 0.481,
    (35, 6, -10): 0.976,
    (35, 6, 0): 0.801,
    (35, 6, 5): 0.473,
}
"""Exact identification by (eta, N, noise in dB) that an independent implementation reached, 5000 trials each."""


@dataclass(frozen=True)
class Shares:
    """Fractions of the trials: all sets right, number of targets right; LOS flags: precision and recall."""

    exact: float
    number: float
    precision: float
    recall: float


def batch_of(columns: Columns, snapshots: int, field: Field) -> RangeBatch:
    """Return the columns of snapshots that all have the same number of rows as a batch."""

    def dense(values: Any) -> Any:
        return np.asfortranarray(np.asarray(values).reshape(snapshots, -1))

    sensor = np.unique(columns["sensor"].astype(str), return_inverse=True)[1]
    return RangeBatch(
        seed=np.zeros(snapshots, dtype=np.uint64),
        field=field,
        sensor=dense(sensor.astype(np.int64)),
        sensor_xy_m=np.asfortranarray(np.stack([dense(columns["sensor_x_m"]), dense(columns["sensor_y_m"])], axis=-1)),
        range_m=dense(columns["range_m"]),
        range_std_m=dense(columns["range_std_m"]),
        path=np.full((snapshots, columns["range_m"].shape[0] // snapshots), -1, order="F"),
        sensor_height_m=dense(np.zeros_like(columns["range_m"])),
    )


def score(method: MethodSpec, spec: ScenarioSpec, draws: list[tuple[Any, int]], field: Field, **options: Any) -> Shares:
    """Return the shares over draws: (options of the scenario, snapshots) each from a seed of its own.

    The number of targets is that of the estimates: a ghost may have no row of its own in the flags, if it shares all
    its circles with better ones.
    """
    exact = number = total = 0
    confusion = np.zeros(4)
    for seed, (scenario_options, snapshots) in enumerate(draws):
        columns = spec.generate(scenario_options, np.random.default_rng([seed, 17]), snapshots)
        solution = method.solve(batch_of(columns, snapshots, field), method.options(**options))
        assert solution.flags is not None
        found = solution.flags.columns["target"]
        true = np.where(columns["truth_los"], columns["truth_target"], np.nan).reshape(found.shape)
        confusion += np.bincount((2 * np.isfinite(true) + np.isfinite(found)).ravel(), minlength=4)
        best = (solution.estimates.alternative == 0) & (solution.estimates.status <= Status.BOUNDARY)
        counts = np.bincount(solution.estimates.row[best], minlength=snapshots)
        for count, ours, theirs in zip(counts, found, true, strict=True):
            right = count == scenario_options.targets
            total, number = total + 1, number + right
            exact += right and _sets(ours) == _sets(theirs)
    return Shares(
        exact / total, number / total, confusion[3] / (confusion[1] + confusion[3]), confusion[3] / confusion[2:].sum()
    )


def _sets(target: Any) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(target == number).tolist()) for number in set(target[np.isfinite(target)])}


def paper_draws(sensors: int, noise_db: float, trials: int, scatterer_draws: int = 5) -> list[tuple[Any, int]]:
    """Return trials over several draws of scatterers; the noise is 10 log10(sigma), not of sigma squared."""
    std = 10.0 ** (noise_db / 10.0)
    return [
        (liang.LiangOptions(sensors=sensors, range_std_m=std, scatterer_seed=seed), trials // scatterer_draws)
        for seed in range(scatterer_draws)
    ]


def extended_tca(eta: float, sensors: int, noise_db: float, trials: int) -> Shares:
    """Return the shares of the paper's algorithm in the paper's scene."""
    draws = paper_draws(sensors, noise_db, trials)
    return score(ranges_extended_tca.METHOD, liang.SCENARIO, draws, PAPER_FIELD, eta=eta)


def test_zero_db_is_a_sigma_of_one_metre() -> None:
    """The paper's dB are 10 log10(sigma): at 0 dB, N = 5, eta = 15 the algorithm reaches about the paper's 758 of 1000.

    With 10 log10(sigma^2) the same number would stand at 0 dB, but 5 dB would be 1.78 m and not 3.16 m: there the
    paper has 336.
    """
    assert extended_tca(15.0, 5, 0.0, 200).exact == pytest.approx(0.775, abs=0.10)
    assert extended_tca(15.0, 5, 5.0, 200).exact == pytest.approx(0.353, abs=0.10)
    assert extended_tca(15.0, 5, 2.5, 200).exact > 0.45


def test_the_number_of_targets_at_low_noise() -> None:
    """N = 6, eta = 35, 0 dB: the paper finds the number of targets always, we at least in 99 of 100 trials."""
    assert extended_tca(35.0, 6, 0.0, 200).number >= 0.99


@pytest.mark.parametrize("sensors", [4, 6])
def test_assignment_is_better_than_the_papers_algorithm(sensors: int) -> None:
    """At 0 dB assignment identifies all sets more often than the paper's tables for any eta (755, 727)."""
    paper = {4: 0.755, 6: 0.727}[sensors]
    shares = score(ranges_assignment.METHOD, liang.SCENARIO, paper_draws(sensors, 0.0, 150), PAPER_FIELD)
    assert shares.exact > paper + 0.05
    assert shares.number >= 0.97


@pytest.mark.slow
@pytest.mark.parametrize(("eta", "sensors", "noise_db"), REPRODUCED)
def test_the_papers_algorithm_is_reproduced(eta: int, sensors: int, noise_db: int) -> None:
    """Exact identification is within 6 points (N = 4: 8) of the independent implementation, for five draws."""
    shares = extended_tca(float(eta), sensors, float(noise_db), 1000)
    assert shares.exact == pytest.approx(REPRODUCED[eta, sensors, noise_db], abs=0.08 if sensors == 4 else 0.06)


@pytest.mark.slow
@pytest.mark.parametrize(("noise_db", "least"), [(0.0, 0.99), (2.5, 0.96), (5.0, 0.90)])
def test_the_number_of_targets_of_figure_4(noise_db: float, least: float) -> None:
    """Fig. 4: N = 6, eta = 35 (paper: 1.000, .996, .979)."""
    assert extended_tca(35.0, 6, noise_db, 1000).number >= least


@pytest.mark.slow
@pytest.mark.parametrize(("sensors", "least"), [(4, 0.72), (5, 0.70), (6, 0.67)])
def test_assignment_at_high_noise(sensors: int, least: float) -> None:
    """At 5 dB assignment identifies all sets in more than 67 to 72 of 100 trials (paper: at most 44)."""
    shares = score(ranges_assignment.METHOD, liang.SCENARIO, paper_draws(sensors, 5.0, 1000), PAPER_FIELD)
    assert shares.exact >= least


def irregular_draws(trials: int) -> list[tuple[Any, int]]:
    """Return trials of 4 to 7 sensors, 1 to 5 targets, 2 to 5 scatterers."""
    generator = np.random.default_rng(5)
    counts = [[int(generator.integers(*span)) for span in ((4, 8), (1, 6), (2, 6))] for _ in range(trials // 5)]
    return [
        (echo_field.EchoFieldOptions(sensors=n, targets=k, scatterers=count, range_std_m=0.3), 5)
        for n, k, count in counts
    ]


@pytest.mark.slow
def test_irregular_layouts() -> None:
    """1000 x 600 m, sigma .3 m: assignment exact in 95 of 100, number right in 98; flags right in 99.5."""
    field = BoxField(xmin_m=0.0, xmax_m=1000.0, ymin_m=0.0, ymax_m=600.0)
    shares = score(ranges_assignment.METHOD, echo_field.SCENARIO, irregular_draws(500), field)
    assert shares.exact >= 0.95
    assert shares.number >= 0.98
    assert min(shares.precision, shares.recall) >= 0.995
    paper = score(ranges_extended_tca.METHOD, echo_field.SCENARIO, irregular_draws(500), field, eta=35.0)
    assert paper.exact >= 0.83
    assert paper.number >= 0.90
