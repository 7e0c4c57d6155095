"""Trials of the paper on indirect paths: levels, variants, blind spots."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.reproduce.experiment import Chunk
from nlosctl.reproduce.shen.detection_theory import blind_spots
from nlosctl.reproduce.shen.paper import LEVELS, detection_samples, p_values, rate, rates, triplet_trials
from nlosctl.reproduce.shen.spots import REGION_M, SCENE, SPOTS

_LOW_M = 20.0 * 1e-3 / 0.5
"""Along the baseline reflectors are 1 mm above it, from 0.5 m on: within 20 m such a ray stays lower than this."""
CHUNK = Chunk(seed=5, number=0, first=0, size=2000, total=2000)


def test_samples_are_p_values() -> None:
    """The rate at every level is the fraction of p-values below it, one level at a time or all at once."""
    samples = detection_samples({}, CHUNK, number=3, rules=("lambda5", "chi2"))
    for truth in ("direct", "indirect"):
        for rule in ("lambda5", "chi2"):
            p_value = p_values(triplet_trials(CHUNK, indirect=truth == "indirect", number=3), CHUNK, rule)
            share = [np.mean(p_value < level) for level in LEVELS]
            assert [rate(samples, truth=truth, rule=rule, level=level) for level in LEVELS] == pytest.approx(share)
            assert rates(samples, truth=truth, rule=rule) == pytest.approx(share)


def test_chi2_always_uses_rays() -> None:
    """Lines in place of rays affect only the paper's rules: chi2 has the same samples for both."""
    rays, lines = (
        detection_samples({"reading": reading}, CHUNK, number=2, rules=("lambda5", "chi2"))
        for reading in ("rays", "lines")
    )
    assert np.array_equal(rays["indirect_chi2"], lines["indirect_chi2"])
    assert rate(lines, truth="indirect", rule="lambda5", level=0.05) > rate(
        rays, truth="indirect", rule="lambda5", level=0.05
    )


@pytest.mark.parametrize("rule", SPOTS)
def test_blind_spots_agree_with_table_i(rule: str) -> None:
    """On BS1 and BS3 the noise-free lambda is zero, on BS2 its divisor; BS1 is on the lines to the target."""
    for spot in SPOTS[rule]:
        points = spot.points(np.linspace(0.05, 0.95, 20))
        x_low, x_high, y_low, y_high = REGION_M
        assert ((points >= [x_low, y_low]) & (points <= [x_high, y_high])).all()
        found = blind_spots(SCENE, points, int(rule[-1]), spot.order)
        if spot.kind == "BS2":
            assert np.abs(found.divisor).max() < 1e-9
        else:
            assert np.abs(found.mean_m).max() < (
                _LOW_M if spot.kind == "BS3" and rule in ("lambda2", "lambda4") else 1e-9
            )
        if spot.kind == "BS1":
            off = np.minimum(np.abs(found.off_dod_line_m), np.abs(found.off_doa_line_m))
            assert off.max() < 1e-9
