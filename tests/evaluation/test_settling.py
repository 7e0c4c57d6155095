"""The settling time of a track."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.evaluation.settling import TrackErrors


def settling(errors: list[float], times: list[float] | None = None) -> float:
    """The settling time of a track of states a second apart whose positions have a std of 5 m."""
    size = len(errors)
    track = TrackErrors()
    covariance = np.tile([16.0, 1.0, 9.0], (size, 1))
    track.add(np.arange(10.0, 10.0 + size) if times is None else np.array(times), np.array(errors), covariance)
    return track.settling_time_s()


def test_the_time_is_that_after_the_last_large_error() -> None:
    """It counts from the first state; an error that is not below three stds, or a missing position, is large."""
    assert settling([1.0, 2.0, 14.9]) == 0.0
    assert settling([20.0, 1.0, 15.0, 1.0, 2.0]) == 3.0
    assert settling([1.0, np.inf, 1.0]) == 2.0
    assert settling([1.0, 20.0, 1.0], [12.0, 10.0, 11.0]) == 1.0


@pytest.mark.parametrize("errors", [[1.0, 16.0], []])
def test_a_track_that_does_not_settle_has_no_time(errors: list[float]) -> None:
    """NaN for a track that ends with a large error, and for none."""
    assert np.isnan(settling(errors))
