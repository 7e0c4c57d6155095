"""The Cramér-Rao bound on position and velocity of sources that move within a snapshot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.contract.options import option
from nlosctl.contract.tables import VELOCITY
from nlosctl.errors import DataError, UsageError
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.results.evaluation_arrays import numbers
from nlosctl.models.information import Information
from nlosctl.solvers.tracking.moving_fix import moving_rows

__all__ = ["BoundParameters", "moving_information", "refuse_scene", "true_velocity", "velocity_names"]

_CONDITION_LIMIT = 1e10
"""Largest condition number of the information, movements within the duration, of a bound."""


@dataclass(frozen=True, kw_only=True)
class BoundParameters:
    """Parameters of ``bound``."""

    motion: Literal["none", "velocity"] = option(
        "none", meaning="motion of the source within a snapshot; velocity: one velocity, by the times of rows"
    )


def velocity_names(dimension: int) -> list[str]:
    """Return the columns of the bound on velocities."""
    of_velocity = (column for column in VELOCITY if dimension == 3 or not column.of_space)
    return [f"bound_{column.name[4:]}" for column in of_velocity if column.name.startswith("cov_")]


def refuse_scene(reader: MeasurementReader) -> None:
    """Raise UsageError for a kind or a scene whose bound has no model of motion."""
    if reader.kind not in ("bearings", "ranges"):
        raise UsageError(f"a bound with motion=velocity exists for bearings and ranges, not for {reader.kind}")
    if reader.scene.reflectors:
        raise UsageError("a bound with motion=velocity is for scenes without reflectors and walls; leave it out")


def true_velocity(chunk: Chunk, dimension: int) -> FloatArray:
    """Return the true velocities (S, D): of the columns ``truth_vx_m_s`` and others, else of the true positions.

    Those are the least-squares slopes over the times of rows, NaN where all rows are of one time. Raises DataError for
    a part of the columns.
    """
    names, starts = [f"truth_v{axis}_m_s" for axis in "xyz"[:dimension]], chunk.offsets[:-1]
    given = [name for name in names if name in chunk.table.column_names]
    if given and given != names:
        raise DataError(f"{chunk.source}: columns {', '.join(given)} without the rest of {', '.join(names)}; add it")
    if given:
        return np.stack([numbers(chunk.table.column(name))[starts] for name in names], axis=1)
    elapsed = np.where(chunk.left_out, 0.0, chunk.columns["elapsed_s"])
    places = [numbers(chunk.table.column(f"truth_{axis}_m")) for axis in "xyz"[:dimension]]
    with ignoring_overflow():
        spread = np.add.reduceat(elapsed * elapsed, starts)
        return np.stack([np.add.reduceat(elapsed * place, starts) / spread for place in places], axis=1)


def moving_information(
    batch: Any, place: FloatArray, velocity: FloatArray, per_variance: float
) -> tuple[Information, dict[str, FloatArray]]:
    """Return the information (B,) of positions whose velocities are unknown too, and the bound on those, by column.

    ``per_variance`` is the information of a row times its variance. NaN where they are not observable.
    """
    moving, center = moving_rows(batch)
    size = place.shape[1]
    movement = velocity * moving.duration_s[:, None]
    state = (*(part - middle for part, middle in zip(place.T, center, strict=True)), *movement.T)
    with ignoring_overflow():
        whole = moving.information(state).map(lambda part: per_variance * part)
        smallest, largest = whole.eigenvalues()
        observable = smallest * _CONDITION_LIMIT > largest
        covariance = whole.inverse().map(lambda part: np.where(observable, part, np.nan))
        pairs = [(one, other) for one in range(size) for other in range(one + 1)]
        per_second = moving.duration_s**-2.0
        bound = [covariance.entry(size + one, size + other) * per_second for one, other in pairs]
        matrix: SymmetricMatrix = covariance.leading(size).inverse()
    return Information(matrix, np.full(batch.size, moving.count)), dict(zip(velocity_names(size), bound, strict=True))
