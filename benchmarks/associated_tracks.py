"""`track --associate` and Stone Soup 1.9.1 on the same targets: tracks, errors, NEES, processor time a snapshot.

    pip install stonesoup==1.9.1
    python benchmarks/associated_tracks.py targets.csv drive.csv

The files are those of docs/tracks.md: targets by `identify-los`, and the measurements with the true positions. Both
associate by global nearest neighbours, filter, and smooth, with a density of 1 m2/s3 and the same gate.
"""

from __future__ import annotations

import os
import sys
import time
from datetime import datetime, timedelta

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import numpy as np
import pyarrow.csv
from scipy.stats import chi2
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.deleter.time import UpdateTimeStepsDeleter
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.initiator.simple import SimpleMeasurementInitiator
from stonesoup.measures import Mahalanobis
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.smoother.kalman import KalmanSmoother
from stonesoup.tracker.simple import MultiTargetTracker
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import KalmanUpdater

import nlosctl

_START = datetime(2026, 1, 1)
_POSITION = [0, 2]

State = tuple[float, np.ndarray, np.ndarray]
"""Time, position (2,) and its covariance (2, 2)."""


def _covariance(row: dict[str, float]) -> np.ndarray:
    return np.array([[row["cov_xx_m2"], row["cov_xy_m2"]], [row["cov_xy_m2"], row["cov_yy_m2"]]])


def _by_stonesoup(rows: list[dict[str, float]]) -> tuple[int, list[State]]:
    scans: dict[float, set[Detection]] = {}
    for row in rows:
        second, place = row["time_s"], np.array([[row["x_m"]], [row["y_m"]]])
        model = LinearGaussian(4, _POSITION, _covariance(row))
        found = Detection(place, timestamp=_START + timedelta(seconds=second), measurement_model=model)
        scans.setdefault(second, set()).add(found)
    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(1.0), ConstantVelocity(1.0)])
    updater = KalmanUpdater(None)
    gate = float(np.sqrt(chi2.isf(1e-4, 2)))
    hypothesiser = DistanceHypothesiser(KalmanPredictor(motion), updater, Mahalanobis(), missed_distance=gate)
    prior = GaussianState(np.zeros((4, 1)), np.diag([1e4, 100.0, 1e4, 100.0]), timestamp=_START)
    tracker = MultiTargetTracker(
        initiator=SimpleMeasurementInitiator(prior, measurement_model=LinearGaussian(4, _POSITION, np.eye(2))),
        deleter=UpdateTimeStepsDeleter(5),
        detector=[(_START + timedelta(seconds=second), found) for second, found in sorted(scans.items())],
        data_associator=GNNWith2DAssignment(hypothesiser),
        updater=updater,
    )
    tracks = set().union(*(found for _, found in tracker))
    states = []
    for track in tracks:
        for state in KalmanSmoother(motion).smooth(track).states:
            place = np.asarray(state.state_vector, dtype=float)[_POSITION, 0]
            spread = np.asarray(state.covar, dtype=float)[np.ix_(_POSITION, _POSITION)]
            states.append(((state.timestamp - _START).total_seconds(), place, spread))
    return len(tracks), states


def _by_nlosctl(table: pyarrow.Table) -> tuple[int, list[State]]:
    rows = nlosctl.track(table, associate=True, acceleration_psd=1.0).estimates.to_pylist()
    states = [(row["time_s"], np.array([row["x_m"], row["y_m"]]), _covariance(row)) for row in rows]
    return len({row["track"] for row in rows}), states


def main() -> None:
    """Print a line for each program."""
    targets, drive = (pyarrow.csv.read_csv(path) for path in sys.argv[1:3])
    truth: dict[float, set[tuple[float, float]]] = {}
    for row in drive.to_pylist():
        truth.setdefault(row["time_s"], set()).add((row["truth_x_m"], row["truth_y_m"]))
    programs = {"nlosctl": lambda: _by_nlosctl(targets), "Stone Soup": lambda: _by_stonesoup(targets.to_pylist())}
    for name, program in programs.items():
        program()
        start = time.process_time()
        tracks, states = program()
        spent = 1e3 * (time.process_time() - start) / len(truth)
        errors, squares = [], []
        for second, place, spread in states:
            off = min((place - np.array(true) for true in truth[second]), key=lambda away: float(away @ away))
            errors.append(off @ off)
            squares.append(off @ np.linalg.solve(spread, off))
        figures = f"RMSE {np.sqrt(np.mean(errors)):.3f} m, NEES {np.mean(squares):.3f}, {spent:.2f} ms a snapshot"
        print(f"{name}: {tracks} tracks, {len(states)} states, {figures}", flush=True)


if __name__ == "__main__":
    main()
