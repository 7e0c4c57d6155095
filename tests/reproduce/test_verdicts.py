"""Verdicts on claims, and the standard errors behind them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from nlosctl.reproduce.catalogue import find_experiment
from nlosctl.reproduce.experiment import Claim
from nlosctl.reproduce.outcome import claim_rows, with_error
from nlosctl.reproduce.samples import GROUPS, Results, jackknife_error, measure, median, rms, share
from nlosctl.reproduce.verdicts import Verdict, at_least, at_most, between, printed, verdict

YES, NO, OPEN = Verdict.REPRODUCED, Verdict.NOT_REPRODUCED, Verdict.UNDECIDED


@pytest.mark.parametrize(
    ("value", "standard_error", "expected", "right"),
    [
        (0.7184, 0.0, printed("0.718"), YES),  # within half of the last digit
        (0.7194, 0.0, printed("0.718"), NO),
        (0.7194, 0.0005, printed("0.718"), YES),  # explained by our Monte-Carlo error
        (0.7300, 0.0030, printed("0.718"), NO),  # four standard errors
        (0.7300, 0.0030, printed("0.718", standard_error=0.004), YES),  # the paper's own error counts too
        (0.7300, 0.0, printed("0.718", tolerance=0.012), YES),
        (0.7300, 0.1, printed("0.718"), OPEN),  # anything from 0.42 to 1.02 would agree
        (9.0, 0.1, printed("0.718"), NO),
        (1.84e-3, 0.0, printed("1.8e-3"), YES),
        (1.86e-3, 0.0, printed("1.8e-3"), NO),
        (15.4, 0.0, printed("15 m"), YES),
        (15.6, 0.0, printed("15 m"), NO),
        (1.02, 0.001, at_least(1.0, ""), YES),
        (1.02, 0.01, at_least(1.0, ""), OPEN),  # 0.99 is within three standard errors
        (0.98, 0.001, at_least(1.0, ""), NO),
        (0.98, 0.01, at_least(1.0, ""), OPEN),
        (1.0, 0.0, at_least(1.0, ""), YES),
        (1.04, 0.0, at_most(1.05, ""), YES),
        (1.04, 0.01, at_most(1.05, ""), OPEN),
        (1.10, 0.01, at_most(1.05, ""), NO),
        (math.inf, 0.0, at_least(5.0, ""), YES),
        (3.0, 0.1, between(1.0, 2.0, ""), NO),
        (1.5, 0.3, between(1.0, 2.0, ""), OPEN),
        (0.0, 0.0, printed("0"), YES),
        (0.0077, 0.0014, at_most(0.0, "0"), NO),  # 5.5 standard errors
        (math.nan, 0.0, at_least(0.0, ""), OPEN),
        (1.0, math.nan, at_least(0.0, ""), OPEN),
    ],
)
def test_the_verdict_allows_the_tolerance_and_three_standard_errors(
    value: float, standard_error: float, expected: object, right: Verdict
) -> None:
    """Reproduced exactly if the range and the error explain the difference; undecided if the error is too large."""
    assert verdict(value, standard_error, expected) == right  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("expected", "text"),
    [
        (printed("0.718"), "0.7175 to 0.7185"),
        (at_least(0.9, "usually"), ">= 0.9"),
        (at_most(0.0, "0"), "<= 0"),
        (between(1.0, 1.0, "1"), "1"),
    ],
)
def test_the_allowed_range_is_shown_beside_the_papers_words(expected: object, text: str) -> None:
    """The range is ours and never takes the place of what the paper says."""
    assert expected.allowed == text  # type: ignore[attr-defined]


def test_without_a_number_there_is_no_verdict() -> None:
    """A figure without values in the text is neither reproduced nor not."""
    assert verdict(1.0, 0.1, None) == "no numbers in the text"


def test_right_claims_are_seldom_rejected() -> None:
    """Of 2000 right claims with a known error a few in a thousand are rejected."""
    values = np.random.default_rng(1).normal(1.0, 0.1, 2000)
    wrong = sum(verdict(value, 0.1, between(1.0, 1.0, "1")) == Verdict.NOT_REPRODUCED for value in values)
    assert 0 < wrong < 20


@pytest.mark.parametrize(
    ("statistic", "true_error"),
    [(lambda x: float(x.mean()), 1.0), (rms, 1.0 / math.sqrt(2.0)), (median, math.sqrt(math.pi / 2.0))],
)
def test_the_jackknife_gives_the_textbook_standard_errors(statistic: object, true_error: float) -> None:
    """Mean, root mean square and median of a standard normal, over 60 draws of 4000: within 10 %."""
    generator = np.random.default_rng(2)
    found = []
    for _ in range(60):
        drawn = Results(conditions=[{}], samples=[{"x": generator.standard_normal(4000)}])
        found.append(measure(lambda part: statistic(part.samples[0]["x"]), drawn).standard_error)  # type: ignore[operator]
    assert math.sqrt(np.mean(np.square(found))) * math.sqrt(4000.0) == pytest.approx(true_error, rel=0.1)


def test_ratios_on_the_same_trials_are_paired() -> None:
    """The error of a ratio of two conditions with common noise is far below that of independent ones."""
    noise = np.random.default_rng(3).standard_normal(4000)
    drawn = Results(conditions=[{"s": 1}, {"s": 2}], samples=[{"x": noise}, {"x": 2.0 * noise + 0.01 * noise[::-1]}])
    ratio = measure(lambda part: rms(part.of(s=2)["x"]) / rms(part.of(s=1)["x"]), drawn)
    assert ratio.value == pytest.approx(2.0, rel=1e-2)
    assert ratio.standard_error < 0.001


def test_deterministic_numbers_have_no_error() -> None:
    """A number that does not depend on draws has standard error 0."""
    drawn = Results(conditions=[{}], samples=[{"x": np.arange(100.0)}], random=False)
    assert measure(lambda part: rms(part.samples[0]["x"]), drawn).standard_error == 0.0


def test_a_missing_statistic_has_no_error() -> None:
    """If a statistic is undefined without one group, its error is undefined."""
    assert math.isnan(jackknife_error([1.0] * (GROUPS - 1) + [math.nan]))


def test_missing_fixes_in_rms_and_median() -> None:
    """Trials without a fix are left out of the rms and are infinite in the median."""
    values = np.array([3.0, 4.0, np.nan])
    assert rms(values) == pytest.approx(math.sqrt(12.5))
    assert median(values) == 4.0
    assert share(values > 3.5) == pytest.approx(1.0 / 3.0)
    assert math.isnan(median(np.array([1.0, np.nan, np.nan])))
    assert math.isnan(rms(np.array([np.nan])))


@pytest.mark.parametrize(
    ("value", "standard_error", "text"),
    [(0.04158, 0.00031, "0.04158 ± 0.00031 m"), (335.8, 14.2, "336 ± 14 m"), (2.0, 0.0, "2 m"), (math.nan, 1.0, "-")],
)
def test_numbers_show_as_many_digits_as_their_error_allows(value: float, standard_error: float, text: str) -> None:
    """Two digits of the standard error, and the value to the same decimal."""
    assert with_error(value, standard_error, "m") == text


@pytest.mark.parametrize(("trials", "says"), [(10, Verdict.UNDECIDED), (10_000, Verdict.NOT_REPRODUCED)])
def test_success_in_all_trials_is_not_certainty(trials: int, says: Verdict) -> None:
    """Ten of ten trials do not decide on a printed 0.9, ten thousand of ten thousand contradict it."""
    experiment = find_experiment("liang-fig4")
    claim = Claim(
        text="", where="", ours=lambda drawn: share(drawn.samples[0]["right"]), expected=printed("0.9"), per_trial=1.0
    )
    drawn = Results(conditions=[{}], samples=[{"right": np.ones(trials)}])
    (row,) = claim_rows(dataclasses.replace(experiment, claims=(claim,), comparisons=()), drawn)
    assert row.verdict == says
    assert row.standard_error == pytest.approx(1.0 / trials)
