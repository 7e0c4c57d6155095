"""When the error of a track settles: from then on it stays below three standard deviations."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from nlosctl.arrays import FloatArray

__all__ = ["TrackErrors"]

_STDS = 3.0


@dataclass
class TrackErrors:
    """Times (N,), errors over standard deviations (N,), of the states of one track in any order."""

    times: list[FloatArray] = field(default_factory=list)
    scaled: list[FloatArray] = field(default_factory=list)

    def add(self, time_s: FloatArray, error_m: FloatArray, covariance_m2: FloatArray) -> None:
        """Add states (N,) with their errors, infinite without a position, and covariances (N, D (D + 1) / 2).

        The standard deviation of a position is the root of the trace of its covariance.
        """
        variances = covariance_m2[:, [0, 2, 5][: 2 if covariance_m2.shape[1] == 3 else 3]]
        with np.errstate(invalid="ignore", divide="ignore"):
            scaled = error_m / np.sqrt(variances.sum(axis=1))
        self.times.append(time_s)
        self.scaled.append(np.where(np.isnan(scaled), np.inf, scaled))

    def settling_time_s(self) -> float:
        """Return the time from the first state to the first after which all errors are below three stds.

        NaN for a track that ends with a larger error, or has no states with a time.
        """
        times, scaled = np.concatenate(self.times), np.concatenate(self.scaled)
        order = np.argsort(times, kind="stable")
        times, scaled = times[order], scaled[order]
        known = np.isfinite(times)
        times, scaled = times[known], scaled[known]
        late = np.flatnonzero(~(scaled < _STDS))
        if not times.size or (late.size and late[-1] == times.size - 1):
            return float("nan")
        return float(times[late[-1] + 1] - times[0]) if late.size else 0.0
