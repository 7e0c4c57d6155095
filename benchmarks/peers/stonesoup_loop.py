"""Stone Soup: one iterated extended Kalman update with the 8 bearings stacked, from a prior of 10 km about the start.

The update is Gauss-Newton on the same residuals. So wide a prior moves a fix of 10 m standard deviation by some
1e-5 m; a much wider one drowns the last digits of the gain.
"""

import warnings
from datetime import datetime

import numpy as np
from rounds import rows, serve
from stonesoup.models.measurement.nonlinear import Cartesian2DToBearing, CombinedReversibleGaussianMeasurementModel
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.state import StateVector
from stonesoup.updater.kalman import IteratedKalmanUpdater

_PRIOR = np.diag([1e8, 1e8])
_NOW = datetime(2026, 1, 1)


def _update(updater, start, x, y, bearing, std):
    models = [
        Cartesian2DToBearing(2, (0, 1), np.array([[s * s]]), translation_offset=np.array([[u], [v]]))
        for u, v, s in zip(x, y, std, strict=True)
    ]
    stacked = CombinedReversibleGaussianMeasurementModel(models)
    angles = np.vstack([StateVector([[b]]) for b in bearing]).view(StateVector)
    prior = GaussianStatePrediction(StateVector(start), _PRIOR, timestamp=_NOW)
    return updater.update(SingleHypothesis(prior, Detection(angles, timestamp=_NOW, measurement_model=stacked)))


def solve(problems):
    """Return all fixes; covariances come with them."""
    updater = IteratedKalmanUpdater(tolerance=1e-4, max_iterations=50)
    fixes = np.full_like(problems["start_m"], np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # an update that does not converge only warns
        for row, (start, *columns) in enumerate(rows(problems)):
            try:
                fixes[row] = np.asarray(_update(updater, start, *columns).state_vector, dtype=float).ravel()
            except UserWarning:
                continue
    return fixes


if __name__ == "__main__":
    serve(solve)
