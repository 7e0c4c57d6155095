"""Trials of the paper on unlabelled echoes: scoring and noise in decibels."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.evaluation.targets import CASES
from nlosctl.reproduce.experiment import Chunk
from nlosctl.reproduce.liang.paper import candidates, direct_batch, echo_trials, identified

CHUNK = Chunk(seed=3, number=2, first=100, size=20, total=1000)


def test_decibels_are_of_the_standard_deviation() -> None:
    """-10 dB is 0.1 m and 5 dB 3.16 m: the ranges differ from noise-free ones by that."""
    quiet, loud = (echo_trials({"sensors": 5, "noise_db": noise_db}, CHUNK).columns for noise_db in (-60.0, 5.0))
    assert np.std(loud["range_m"] - quiet["range_m"]) == pytest.approx(10.0**0.5, rel=0.1)
    assert loud["range_std_m"][0] == pytest.approx(10.0**0.5)


def test_trials_are_scored_one_by_one() -> None:
    """At negligible noise all trials are right, with the three true sets first among the candidates."""
    given = echo_trials({"sensors": 6, "noise_db": -40.0}, CHUNK)
    found = identified(given, CHUNK, "assignment")
    assert found.count.tolist() == [3.0] * CHUNK.size
    assert found.exact.tolist() == [1.0] * CHUNK.size
    for some in candidates(given, CHUNK.size):
        assert some.case[some.kept][:3].tolist() == [CASES.index("i")] * 3


def test_a_wrong_number_is_not_exact() -> None:
    """With an elbow threshold near zero only one target is found, and no trial is right."""
    given = echo_trials({"sensors": 6, "noise_db": 5.0}, CHUNK)
    found = identified(given, CHUNK, "extended-tca", eta=1e-6)
    assert (found.count < 3.0).any()
    assert not found.exact[found.count != 3.0].any()


def test_every_chunk_has_scatterers_of_its_own() -> None:
    """The paper does not give its scatterers: chunks have different ones, trials of a chunk share them."""
    other = Chunk(seed=3, number=3, first=100, size=20, total=1000)
    condition = {"sensors": 4, "noise_db": -60.0}
    ours, theirs = (echo_trials(condition, chunk).columns["range_m"] for chunk in (CHUNK, other))
    assert ours.shape == theirs.shape
    assert not np.allclose(np.sort(ours), np.sort(theirs))


def test_the_reading_under_which_the_tables_reproduce() -> None:
    """N = 4, eta = 35, -10 dB: the paper has 888 of 1000 exact trials; target by target there are 679."""
    exact: list[float] = []
    for number in (0, 1):
        part = Chunk(seed=0, number=number, first=50 * number, size=50, total=100)
        trials = echo_trials({"sensors": 4, "noise_db": -10.0}, part)
        exact += identified(trials, part, "extended-tca", eta=35.0, seeds="first").exact.tolist()
    assert np.mean(exact) == pytest.approx(0.888, abs=3.0 * np.hypot(0.032, 0.022))


def test_rows_are_compared_as_one_set() -> None:
    """A trial is exact if the rows called direct are the direct ones, whichever target they are assigned to."""
    given = echo_trials({"sensors": 5, "noise_db": -10.0}, CHUNK)
    batch, truth_m = direct_batch(given, CHUNK.size)
    offset = np.hypot(*np.moveaxis(truth_m[:, None] - batch.sensor_xy_m, -1, 0)) - batch.range_m
    assert np.abs(offset).max() < 6.0 * 0.1
