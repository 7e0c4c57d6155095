"""Batches of unlabelled bearings drawn from the scenario ``bearing-field``, with their truth."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scenario_draws import draw_columns

from nlosctl.arrays import IntArray
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import BoxField, Field
from nlosctl.evaluation.summaries import TargetSummary
from nlosctl.evaluation.targets import EchoRows, TargetScores
from nlosctl.methods.bearings_assignment import AssignmentOptions, solve
from nlosctl.scenarios.spec import Columns

FIELD = BoxField(xmin_m=-100.0, xmax_m=1100.0, ymin_m=-100.0, ymax_m=1100.0)


def blocks(columns: Columns, field: Field = FIELD) -> Iterator[tuple[IntArray, BearingBatch]]:
    """Yield the rows (B, K) of all snapshots of K rows, and their batch."""
    counts = np.bincount(columns["snapshot"])
    first = np.cumsum(counts) - counts
    for count in np.unique(counts[counts > 0]):
        rows = first[counts == count][:, None] + np.arange(count)
        yield rows, batch_of(columns, rows, field)


def batch_of(columns: Columns, rows: IntArray, field: Field = FIELD) -> BearingBatch:
    """Return the batch of some rows (B, K) of columns."""
    _, codes = np.unique(columns["sensor"].astype(str), return_inverse=True)
    space = ("sensor_z_m", "elevation_rad", "elevation_std_rad")
    optional: dict[str, Any] = {name: np.asfortranarray(columns[name][rows]) for name in space if name in columns}
    return BearingBatch(
        field=field,
        dimension=3 if optional else 2,
        seed=np.zeros(rows.shape[0], dtype=np.uint64),
        sensor=np.asfortranarray(codes[rows]),
        sensor_xy_m=np.asfortranarray(np.stack([columns["sensor_x_m"][rows], columns["sensor_y_m"][rows]], axis=2)),
        bearing_rad=np.asfortranarray(columns["bearing_rad"][rows]),
        bearing_std_rad=np.asfortranarray(columns["bearing_std_rad"][rows]),
        path=np.full(rows.shape, -1, dtype=np.int64, order="F"),
        reflector=np.full(rows.shape, -1, dtype=np.int64, order="F"),
        **optional,
    )


def scored(options: AssignmentOptions, snapshots: int, **world: Any) -> tuple[TargetSummary, float]:
    """Return the scores of a draw of ``bearing-field``, and the mean NEES of targets of one source's rows alone."""
    columns = draw_columns("bearing-field", snapshots, **world)
    scores, nees = TargetScores(cutoff_m=50.0), []
    axes = [name for name in ("truth_x_m", "truth_y_m", "truth_z_m") if name in columns]
    for rows, batch in blocks(columns):
        solution = solve(batch, options)
        estimates, flags = solution.estimates, solution.flags
        assert flags is not None
        for snapshot, own in enumerate(rows):
            truth = EchoRows(
                target=numbered(flags.columns["target"][snapshot]),
                true_target=numbered(columns["truth_target"][own]),
                los=np.asarray(flags.columns["los"][snapshot], dtype=bool),
                true_los=columns["truth_los"][own],
                true_m=np.stack([columns[name][own] for name in axes], axis=1),
            )
            found = (estimates.row == snapshot) & (estimates.alternative == 0) & (estimates.n_used > 0)
            scores.add(truth, estimates.position_m[found])
            for index in np.flatnonzero(found):
                mine = truth.target == estimates.target[index]
                if np.unique(truth.true_target[mine]).size == 1 and truth.true_los[mine].all():
                    error = estimates.position_m[index] - truth.true_m[mine][0]
                    nees.append(error @ np.linalg.solve(dense(estimates.covariance_m2[index]), error))
    return scores.overall(), float(np.mean(nees))


def numbered(values: Any) -> IntArray:
    """Return numbers of targets, -1 for none."""
    return np.where(np.isnan(values), -1, values).astype(np.int64)


def dense(covariance: Any) -> Any:
    """Return a covariance as a matrix."""
    size = 2 if covariance.shape[0] == 3 else 3
    matrix = np.zeros((size, size))
    rows, columns = np.tril_indices(size)
    matrix[rows, columns] = matrix[columns, rows] = covariance
    return matrix
