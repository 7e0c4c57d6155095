"""What a chunk adds to the normal equations of the offsets, as exact sums by sensor and by pair of sensors."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_invalid
from nlosctl.contract.random_streams import snapshot_seeds
from nlosctl.contract.run_options import SolveOptions
from nlosctl.contract.scene import Scene
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import max_measurements, sum_measurements
from nlosctl.geometry.exact_sums import ExactSums
from nlosctl.io.measurements.completion.calibrated_rows import calibrated_columns
from nlosctl.io.measurements.completion.references import FORM, Form
from nlosctl.io.measurements.completion.sensor_keys import group_texts, numbered, sensor_keys
from nlosctl.io.measurements.reader import Chunk
from nlosctl.models.scaled_residuals import SCALED_RESIDUALS, height_residual
from nlosctl.models.sight import has_geodesics
from nlosctl.pipeline.calibrate.known_positions import KnownPositions
from nlosctl.pipeline.solve.learned_options import pass_batches
from nlosctl.pipeline.solve.method_runs import MethodRun
from nlosctl.pipeline.solve.stds.row_squares import uses_ranges
from nlosctl.solvers.calibration.elimination import OffsetEquations, offset_equations, row_pairs
from nlosctl.solvers.calibration.places import cells_of

__all__ = ["PAIR", "PLACE", "SENSOR", "SNAPSHOTS", "Key", "OffsetSums"]

Key = tuple[str, ...]
"""A sensor's name, followed by the values of the columns that offsets are separate for."""

SENSOR, PAIR, PLACE, SNAPSHOTS = "sensor", "pair", "place", "snapshots"
"""What the first part of a key of the sums states.

Of a sensor: gradient, information if the positions were known, weighted squares of the residuals, their degrees of
freedom, rows. Of a pair of sensors: information. Of a place (group, cell): positions. Of all snapshots: those that
count, and those with a known position.
"""

_FARTHEST = 30.0
"""A position farther than this many sizes of the array has no say."""

_CHOICE = 1
"""The seed of the choice of snapshots."""

_NO_REFERENCE_ROW = "a calibration needs the row of each reference, whose difference is 0; add these rows"
_SEVERAL_REFERENCES = (
    "a difference to one of several references in a snapshot has the offsets of two sensors; a calibration needs one "
    "reference in a snapshot"
)
_NOT_IN_SPACE = (
    "a calibration is not for azimuths of geodesics or heights above a sphere; set `dimensions` to 2, or leave the "
    "heights out"
)

_TRUSTED = (Status.OK, Status.AMBIGUOUS, Status.INFEASIBLE)


@dataclass(frozen=True, kw_only=True)
class OffsetSums:
    """The statistic of a pass: the sums of a chunk with the offsets and factors of stds (`current`) so far.

    ``by`` are the columns for whose values offsets are separate. ``truth`` are known positions, None: they are
    estimated by the method of ``run``. Only one in ``one_in`` snapshots counts, chosen by their ids.
    """

    kind: str
    dimension: int
    scene: Scene
    run: MethodRun
    options: SolveOptions
    by: Sequence[str]
    current: Mapping[Key, tuple[float, float]]
    truth: KnownPositions | None = None
    one_in: int = 1

    def __call__(self, chunk: Chunk) -> ExactSums:
        """Return the sums of a chunk, by the keys above; raises UsageError for rows without an offset of their own."""
        _refuse_differences(chunk)
        sums = ExactSums()
        codes, keys = sensor_keys(chunk, self.by)
        groups, group_names = group_texts(chunk, self.by)
        sums.add_groups([(SENSOR, key) for key in keys], codes[:0], np.zeros((0, 5)))
        known = np.array([self.current.get(key, (0.0, 1.0)) for key in keys])
        columns = calibrated_columns(chunk.columns, self.kind, *known[codes].T)
        snapshots = np.repeat(np.arange(len(chunk.snapshot)), np.diff(chunk.offsets))
        chunk = dataclasses.replace(chunk, columns=columns, left_out=chunk.left_out | self._unchosen(chunk)[snapshots])
        truth_m = None if self.truth is None else self.truth.positions(chunk, self.dimension)
        for row, batch in pass_batches(chunk, self.kind, self.scene, self.options, self.dimension):
            if not row.shape[1]:
                continue
            truth = None if truth_m is None else truth_m[snapshots[row[:, 0]]]
            equations, position_m, size_m = self._equations(batch, truth)
            _add(sums, equations, codes[row], keys)
            has_truth = np.zeros(row.shape[0]) if truth is None else np.isfinite(truth[:, 0])
            sums.add(SNAPSHOTS, np.stack([equations.located, has_truth], axis=1).astype(np.float64))
            _add_places(sums, equations, position_m, size_m, groups[row[:, 0]], group_names)
        return sums

    def _unchosen(self, chunk: Chunk) -> BoolArray:
        """Return which snapshots (S,) of a chunk don't count."""
        if self.one_in == 1:
            return np.zeros(len(chunk.snapshot), dtype=bool)
        return np.asarray(snapshot_seeds(_CHOICE, chunk.snapshot_ids()) % np.uint64(self.one_in) != 0)

    def _equations(self, batch: Any, truth_m: FloatArray | None) -> tuple[OffsetEquations, FloatArray, FloatArray]:
        """Return the equations of a batch, and the positions (B, D) and array sizes (B,) of its snapshots."""
        if self.kind == "bearings" and (has_geodesics(batch) or batch.target_above_ground is not None):
            raise UsageError(_NOT_IN_SPACE)
        middle_m, size_m = _array_sizes(batch)
        position_m, weight = self._fixes(batch, truth_m)
        located = np.isfinite(position_m[:, 0])
        spec, options = self.run.spec, self.run.options
        scalars = SCALED_RESIDUALS[self.kind](batch, position_m, with_ranges=uses_ranges(spec, options))
        coordinates = 2 if batch.height_held else self.dimension
        if truth_m is not None:
            scalars = tuple(scalar.at_known_position(coordinates) for scalar in scalars)
            return offset_equations(scalars, weight, located, 0), position_m, size_m
        with ignoring_invalid():
            away_m = np.sqrt(np.sum((position_m - middle_m) ** 2, axis=1))
            located &= away_m <= _FARTHEST * size_m
        height = height_residual(self.kind, batch, position_m)
        return offset_equations(scalars, weight, located, coordinates, height), position_m, size_m

    def _fixes(self, batch: Any, truth_m: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Return the positions (B, D), NaN without one, and the probability (B, K) of each row to be direct."""
        spec, options = self.run.spec, self.run.options
        shape = next(getattr(batch, name) for name in batch.STDS if getattr(batch, name) is not None).shape
        position_m = np.full((shape[0], self.dimension), np.nan) if truth_m is None else truth_m
        if truth_m is None and shape[1] < spec.minimum_measurements:
            return position_m, np.ones(shape)
        if spec.direct_rows is not None:
            position_m, weight = spec.direct_rows(batch, options, truth_m)
            return position_m, np.asfortranarray(np.where(np.isfinite(weight), weight, 0.0))
        if truth_m is None:
            estimates = spec.solve(batch, options).estimates
            best = (estimates.alternative == 0) & np.isin(estimates.status, _TRUSTED)
            position_m[estimates.row[best]] = estimates.position_m[best]
        return position_m, np.ones(shape, order="F")


def _refuse_differences(chunk: Chunk) -> None:
    """Raise UsageError for differences of arrivals from which no sensor's offset can be taken off by its own row."""
    forms = chunk.columns.get(FORM, np.empty(0))
    if (forms == Form.OF_PAIRS).any():
        raise UsageError(_SEVERAL_REFERENCES)
    if (forms == Form.WITHOUT_REFERENCE).any():
        raise UsageError(_NO_REFERENCE_ROW)


def _array_sizes(batch: Any) -> tuple[FloatArray, FloatArray]:
    """Return the mean (B, D) of each snapshot's sensors, and the distance (B,) of the farthest from it."""
    axes = [batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1]]
    if batch.dimension == 3:
        axes.append(batch.sensor_z_m)
    middle = [sum_measurements(axis) / axis.shape[1] for axis in axes]
    squared = np.sum([(axis - part[:, None]) ** 2 for axis, part in zip(axes, middle, strict=True)], axis=0)
    return np.stack(middle, axis=1), np.sqrt(max_measurements(squared))


def _add(sums: ExactSums, equations: OffsetEquations, codes: IntArray, keys: Sequence[Key]) -> None:
    """Add the equations of snapshots whose rows (B, K) are of the sensors ``keys[code]``."""
    located = np.broadcast_to(equations.located[:, None], codes.shape)
    values = (equations.gradient, equations.alone, equations.squares, equations.degrees, located)
    by_row = np.stack([np.ravel(value).astype(np.float64) for value in values], axis=1)
    sums.add_groups([(SENSOR, key) for key in keys], codes.ravel(), by_row)
    later, earlier = row_pairs(codes.shape[1])
    one, other = codes[:, later], codes[:, earlier]
    twice = np.where((one == other) & (later != earlier), 2.0, 1.0)
    pairs, index = numbered(np.maximum(one, other) * len(keys) + np.minimum(one, other), len(keys) ** 2)
    names = [(PAIR, *sorted((keys[pair // len(keys)], keys[pair % len(keys)]))) for pair in pairs.tolist()]
    sums.add_groups(names, index.ravel(), (twice * equations.information).reshape(-1, 1))


def _add_places(
    sums: ExactSums,
    equations: OffsetEquations,
    position_m: FloatArray,
    size_m: FloatArray,
    groups: IntArray,
    names: Sequence[Key],
) -> None:
    """Count the snapshots at each place, by group (B,)."""
    rows = np.flatnonzero(equations.located)
    cells = cells_of(position_m[rows], size_m[rows], equations.position_std_m[rows])
    places, index = np.unique(np.column_stack([groups[rows], cells]), axis=0, return_inverse=True)
    keys = [(PLACE, names[group], *cell) for group, *cell in places.tolist()]
    sums.add_groups(keys, index.ravel(), np.ones((rows.shape[0], 1)))
