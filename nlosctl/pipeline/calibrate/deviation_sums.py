"""What a chunk adds to the normal equations of the deviations of arrays, as exact sums by array and pair of terms."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_division, ignoring_invalid
from nlosctl.geometry.angles import deviation, deviation_terms
from nlosctl.geometry.blocks import max_measurements, sum_measurements
from nlosctl.geometry.exact_sums import ExactSums
from nlosctl.io.measurements.completion.array_deviations import DeviatedRows, deviated_rows, sector_of
from nlosctl.io.measurements.completion.sensor_keys import sensor_keys
from nlosctl.io.measurements.reader import Chunk
from nlosctl.models.scaled_residuals import SCALED_RESIDUALS, ScaledResiduals
from nlosctl.pipeline.calibrate.offset_sums import PAIR, SENSOR, SNAPSHOTS, Key, OffsetSums
from nlosctl.pipeline.solve.learned_options import pass_batches
from nlosctl.solvers.calibration.deviation_equations import DeviationEquations, deviation_equations

__all__ = ["SECTOR", "SECTORS", "TERM", "DeviationSums"]

TERM, SECTOR = "term", "sector"
"""First parts of keys of the sums, beside those of offsets. Of a term: gradient, and information if the positions were
known. Of a sector of the direction from the heading: rows."""

SECTORS = 36
_FARTHEST = 30.0
"""A position farther than this many sizes of the array of sensors has no say."""

_MOST_NUMBERS = 1 << 21
"""So many entries of the snapshots' equations are in memory at a time."""


@dataclass(frozen=True, kw_only=True)
class DeviationSums(OffsetSums):
    """The statistic of a pass with the ``deviations`` so far: the terms of each array, and its factor of the stds.

    Bearings are taken with the terms at the direction of the position, so that the equations are exact where that is
    known. A snapshot may be a whole drive around one transmitter.
    """

    harmonics: int
    deviations: Mapping[Key, tuple[tuple[float, ...], float]] = field(default_factory=dict)

    @property
    def terms(self) -> int:
        """The number of terms of a deviation."""
        return 1 + 2 * self.harmonics

    def __call__(self, chunk: Chunk) -> ExactSums:
        """Return the sums of a chunk, by the keys above."""
        sums = ExactSums()
        codes, keys = sensor_keys(chunk, self.by)
        sums.add_groups([(SENSOR, key) for key in keys], codes[:0], np.zeros((0, 3)))
        known = [self.deviations.get(key, ((0.0,) * self.terms, 1.0)) for key in keys]
        terms, scale = np.array([part for part, _ in known])[codes], np.array([factor for _, factor in known])[codes]
        columns, deviated = deviated_rows(chunk.columns, terms)
        columns["bearing_std_rad"] = columns["bearing_std_rad"] * scale
        snapshots = np.repeat(np.arange(len(chunk.snapshot)), np.diff(chunk.offsets))
        chunk = dataclasses.replace(chunk, columns=columns, left_out=chunk.left_out | self._unchosen(chunk)[snapshots])
        truth_m = None if self.truth is None else self.truth.positions(chunk, self.dimension)
        for row, batch in pass_batches(chunk, self.kind, self.scene, self.options, self.dimension):
            truth = None if truth_m is None or not row.shape[1] else truth_m[snapshots[row[:, 0]]]
            if row.shape[1]:
                self._add_batch(sums, batch, truth, _Rows(deviated, terms, codes, row), keys)
        return sums

    def _add_batch(
        self, sums: ExactSums, batch: Any, truth_m: FloatArray | None, rows: _Rows, keys: Sequence[Key]
    ) -> None:
        position_m, weight = self._fixes(batch, truth_m)
        located = np.isfinite(position_m[:, 0])
        (plain,) = SCALED_RESIDUALS[self.kind](batch, position_m, with_ranges=False)
        if truth_m is None:
            located &= _is_near(batch, position_m)
        else:
            plain = plain.at_known_position(self.dimension)
        scalars, direction = rows.with_deviation(plain, batch.bearing_std_rad)
        terms = deviation_terms(direction, self.terms)
        arrays = np.unique(rows.code)
        array = np.searchsorted(arrays, rows.code)
        named = [keys[code] for code in arrays.tolist()]
        size = max(_MOST_NUMBERS // (arrays.size * self.terms) ** 2, 1)
        for start in range(0, located.size, size):
            part = slice(start, start + size)
            own = _part(scalars, part)
            equations = deviation_equations(own, terms[part], array[part], arrays.size, weight[part], located[part])
            _add(sums, equations, array[part], direction[part], named, self.terms)
        has_truth = np.zeros(located.shape) if truth_m is None else np.isfinite(truth_m[:, 0])
        sums.add(SNAPSHOTS, np.stack([np.zeros(located.shape), has_truth], axis=1))


@dataclass(frozen=True)
class _Rows:
    """The rows (B, K) of a batch: those of a chunk with its deviations, their terms (N, T) and arrays (N,)."""

    deviated: DeviatedRows
    terms: FloatArray
    codes: IntArray
    row: IntArray

    @property
    def code(self) -> IntArray:
        """The array (B, K) of each row."""
        return self.codes[self.row]

    def with_deviation(self, plain: ScaledResiduals, std_rad: FloatArray) -> tuple[ScaledResiduals, FloatArray]:
        """Return the residuals of the measured bearings by the deviation at the position, and its directions (B, K).

        ``plain`` are those of the bearings without deviation, at the measured directions, over their stds (B, K).
        """
        assert plain.per_offset is not None  # noqa: S101 - bearings have it
        measured = 1.0 + self.deviated.slope[self.row]
        turned = -plain.per_offset * std_rad
        miss = turned * plain.residual * std_rad
        direction = self.deviated.direction[self.row] - miss
        value, slope = deviation(direction, self.terms[self.row])
        std = std_rad * measured
        with ignoring_division():
            residual = turned * (miss + self.deviated.value[self.row] - value) / std
            share = (1.0 + slope) / measured
            slopes = tuple(part * share for part in plain.slopes)
            exact = ScaledResiduals(residual, slopes, plain.measured, plain.per_offset / measured)
        return exact, direction


def _is_near(batch: Any, position_m: FloatArray) -> Any:
    """Return which positions (B, 2) are within `_FARTHEST` sizes of the array of sensors from its middle."""
    axes = [batch.sensor_xy_m[..., axis] for axis in range(2)]
    middle = [sum_measurements(axis) / axis.shape[1] for axis in axes]
    size = max_measurements(sum((axis - part[:, None]) ** 2 for axis, part in zip(axes, middle, strict=True)))
    with ignoring_invalid():
        away = sum((position_m[:, axis] - part) ** 2 for axis, part in enumerate(middle))
        return away <= _FARTHEST**2 * size


def _part(scalars: ScaledResiduals, part: slice) -> ScaledResiduals:
    assert scalars.per_offset is not None  # noqa: S101 - bearings have it
    slopes = tuple(slope[part] for slope in scalars.slopes)
    return ScaledResiduals(scalars.residual[part], slopes, scalars.measured[part], scalars.per_offset[part])


def _add(
    sums: ExactSums,
    equations: DeviationEquations,
    array: IntArray,
    direction_rad: FloatArray,
    names: Sequence[Key],
    terms: int,
) -> None:
    """Add the equations of snapshots whose rows (B, K) are of the arrays ``names[array]``."""
    located = np.broadcast_to(equations.located[:, None], array.shape)
    by_row = np.stack([np.ravel(part) for part in (equations.squares, equations.degrees, located * 1.0)], axis=1)
    sums.add_groups([(SENSOR, key) for key in names], array.ravel(), by_row)
    sector = sector_of(np.where(located, direction_rad, 0.0), SECTORS)
    filled, index = np.unique((array * SECTORS + sector)[located], return_inverse=True)
    keys = [(SECTOR, names[number // SECTORS], number % SECTORS) for number in filled.tolist()]
    sums.add_groups(keys, index.ravel(), np.ones((index.size, 1)))
    unknowns = [(name, term) for name in names for term in range(terms)]
    for number, unknown in enumerate(unknowns):
        sums.add((TERM, *unknown), np.stack([equations.gradient[:, number], equations.alone[:, number]], axis=1))
        for other in range(number + 1):
            pair = sorted((unknown, unknowns[other]))
            sums.add((PAIR, *pair), equations.information[:, number, other, None])
    sums.add(SNAPSHOTS, np.stack([equations.located, np.zeros(located.shape[0])], axis=1).astype(np.float64))
