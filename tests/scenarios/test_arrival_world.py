"""The scenario of arrival times: arrivals are distances plus the offset, and ml reaches the bound."""

from __future__ import annotations

import numpy as np
import pytest

import nlosctl
from nlosctl.errors import UsageError


@pytest.mark.parametrize("dimension", [2, 3])
def test_arrivals_are_distances_plus_the_offset(dimension: int) -> None:
    """With tiny errors an arrival minus the distance of the truth from its sensor is the true offset."""
    drawn = nlosctl.simulate("arrivals", trials=20, seed=3, arrival_std_m=1e-9, dimensions=str(dimension))
    columns = {name: np.asarray(drawn[name]) for name in drawn.column_names if name != "sensor"}
    squares = [(columns[f"truth_{axis}_m"] - columns[f"sensor_{axis}_m"]) ** 2 for axis in "xyz"[:dimension]]
    offset = columns["arrival_m"] - np.sqrt(np.sum(squares, axis=0))
    assert offset == pytest.approx(columns["truth_offset_m"], abs=1e-6)


@pytest.mark.parametrize("dimension", [2, 3])
def test_pairs_are_differences_to_several_references(dimension: int) -> None:
    """With tiny errors a difference is that of the truth's distances; the pairs of a snapshot are all different."""
    drawn = nlosctl.simulate("arrivals", trials=20, seed=3, arrival_std_m=1e-9, dimensions=str(dimension), pairs=12)
    columns = {name: np.asarray(drawn[name]) for name in drawn.column_names}
    away = [
        np.sqrt(
            np.sum(
                [(columns[f"truth_{axis}_m"] - columns[f"{of}_{axis}_m"]) ** 2 for axis in "xyz"[:dimension]], axis=0
            )
        )
        for of in ("sensor", "reference")
    ]
    assert columns["tdoa_m"] == pytest.approx(away[0] - away[1], abs=1e-6)
    pairs = {
        (snapshot, *sorted(pair))
        for snapshot, *pair in zip(columns["snapshot"], columns["sensor"], columns["reference"], strict=True)
    }
    assert len(pairs) == 20 * 12
    assert all(len(set(pair)) == 3 for pair in pairs)
    with pytest.raises(UsageError, match="8 sensors have 28 pairs"):
        nlosctl.simulate("arrivals", trials=1, pairs=29)


def test_ml_reaches_the_bound_and_its_covariance_is_true() -> None:
    """In a ring of eight sensors the RMSE of ml is that of the Cramér-Rao bound, and the mean NEES is 2."""
    drawn = nlosctl.simulate("arrivals", trials=1000, seed=5)
    estimates = nlosctl.localize(drawn, method="ml").estimates
    bound = np.asarray(nlosctl.bound(drawn)["rms_m"])
    truth = {name: np.asarray(drawn[name])[::8] for name in ("truth_x_m", "truth_y_m", "truth_offset_m")}
    x, y = (np.asarray(estimates[f"{axis}_m"]) - truth[f"truth_{axis}_m"] for axis in "xy")
    xx, xy, yy = (np.asarray(estimates[f"cov_{pair}_m2"]) for pair in ("xx", "xy", "yy"))
    nees = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)
    assert np.sqrt(np.mean(x * x + y * y) / np.mean(bound**2)) == pytest.approx(1.0, abs=0.07)
    assert nees.mean() == pytest.approx(2.0, abs=0.21)
    offset = (np.asarray(estimates["offset_m"]) - truth["truth_offset_m"]) / np.asarray(estimates["offset_std_m"])
    assert np.mean(offset**2) == pytest.approx(1.0, abs=0.15)
