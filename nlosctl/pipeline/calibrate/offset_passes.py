"""Offsets of sensors and factors of their standard deviations: passes over the input until they stay.

Each pass seeks the position of every snapshot from the beginning, with the offsets so far subtracted: far from their
values a snapshot may have its best fit elsewhere. Its sums (`nlosctl.solvers.calibration.elimination`) give the step of
the offsets. The factors are f_j^2 = (Q_j + d F^2) / (D_j - 1 + d), Q_j the sum of sensor j's squared residuals over
stated std, D_j their degrees of freedom without the offset's own, F^2 the same of all sensors, and d = 5 prior degrees
of freedom, without which a sensor's factor may collapse.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.geometry.exact_sums import ExactSums
from nlosctl.pipeline.calibrate.offset_sums import PAIR, PLACE, SENSOR, SNAPSHOTS, Key, OffsetSums
from nlosctl.pipeline.engine.passes import InputPasses
from nlosctl.solvers.calibration.offset_solution import OffsetSolution, solve_offsets
from nlosctl.solvers.calibration.places import count_places

__all__ = ["MOST_PASSES", "OffsetEstimate", "estimate_offsets", "factors_of_stds"]

MOST_PASSES = 30
"""An iteration that has not settled by then stops; the summary states it."""

_SETTLED = 3e-3
"""Offsets have settled when none moves by more than this share of its std, factors when none changes by this share."""

_NEARLY_SETTLED = 0.03
"""With smaller steps than this, passes over a few snapshots have done their work."""

_FEW = 5000
"""About so many snapshots are enough for the first passes."""

_MOST_GAIN = 10.0
_LONGEST = 0.3
"""An extrapolation adds at most so many times the step of a pass, and so many stds."""

_PRIOR_DEGREES = 5.0
"""Degrees of freedom of the factor of all sensors as a prior of each sensor's."""

_LEAST_DEGREES = 0.5
"""With fewer degrees of freedom than this in the whole input there is no factor: it stays 1."""

_LEAST_FACTOR = 1e-3
"""Residuals of zero make no standard deviation of zero."""


@dataclass(frozen=True, kw_only=True)
class OffsetEstimate:
    """Offsets (J,) of the sensors ``keys``, sorted, in the unit of the measurements, with what is known about them.

    ``scale`` (J,) are the factors of stds with their ``degrees`` of freedom (J,), NaN where nothing determines any,
    ``solution`` that of the last pass, at these offsets. ``rows`` (J,) are the
    rows of snapshots that count, ``snapshots`` their number, ``known`` that of snapshots with a known position,
    ``places`` the number of different positions by group. ``step`` is the largest move of an offset in the last of the
    ``passes``, over its std, or change of a factor's logarithm.
    """

    keys: tuple[Key, ...]
    offsets: FloatArray
    scale: FloatArray
    degrees: FloatArray
    solution: OffsetSolution
    rows: FloatArray
    snapshots: int
    known: int
    places: Mapping[Key, int]
    passes: int
    step: float

    @property
    def settled(self) -> bool:
        """Whether the offsets stayed at the end."""
        return self.step <= _SETTLED


def estimate_offsets(
    sums: OffsetSums,
    prior_std: float | None,
    passes: InputPasses,
    columns: tuple[str, ...],
    show: Callable[[str], None],
    snapshots: int,
) -> OffsetEstimate:
    """Return the offsets by passes of the statistic ``sums``, from offsets of zero.

    Of many ``snapshots`` the first passes take a few thousand, chosen by their ids, until the offsets nearly stay. A
    prior of mean zero has ``prior_std`` in the unit of the measurements. ``columns`` are those of a chunk's table that
    the statistic needs; ``show`` receives a line a pass. Raises the errors of reading and of the method.
    """
    few, earlier = max(snapshots // _FEW, 1), None
    for count in range(1, MOST_PASSES + 1):
        sums = replace(sums, one_in=few)
        estimate = _advanced(passes.pool(sums, columns), sums.current, prior_std, count)
        show(f"{sums.run.label}: pass {count}: {estimate.snapshots} snapshots count, step {estimate.step:.2g} std")
        if few == 1 and estimate.step <= _SETTLED:
            break
        this = _Step.of(estimate, sums.current)
        pairs = zip(*this.extrapolated(earlier).tolist(), strict=True)
        sums = replace(sums, current=dict(zip(estimate.keys, pairs, strict=True)))
        earlier = this
        if few > 1 and (estimate.step <= _NEARLY_SETTLED or count >= MOST_PASSES // 2):
            few, earlier = 1, None
    return estimate


@dataclass(frozen=True)
class _Step:
    """The step of a pass: where it ends and how long it is, (2, J) offsets and logarithms of factors.

    ``unit`` (2, J) are the std of the offsets and 1.
    """

    end: FloatArray
    length: FloatArray
    unit: FloatArray

    @classmethod
    def of(cls, estimate: OffsetEstimate, current: Mapping[Key, tuple[float, float]]) -> _Step:
        """Return the step of a pass that began at the ``current`` offsets and factors."""
        offsets, factors = _values(current, estimate.keys)
        end = np.stack([estimate.offsets, np.log(estimate.scale)])
        std = np.sqrt(np.diag(estimate.solution.covariance))
        unit = np.stack([np.where(std > 0.0, std, 1.0), np.ones(std.shape)])
        return cls(end, end - np.stack([offsets, np.log(factors)]), unit)

    def extrapolated(self, earlier: _Step | None) -> FloatArray:
        """Return the next offsets and factors (2, J), by this step and the one before it."""
        end = self.end
        if earlier is not None:
            change = (self.length - earlier.length) / self.unit
            square = float(np.sum(change * change))
            gain = float(np.sum(self.length / self.unit * change)) / square if square > 0.0 else 0.0
            further = -gain * (end - earlier.end)
            size, step = (float(np.abs(part / self.unit).max()) for part in (further, self.length))
            limit = min(_MOST_GAIN * step, _LONGEST)
            end = end + further * (limit / size if size > limit else 1.0)
        return np.stack([end[0], np.maximum(np.exp(end[1]), _LEAST_FACTOR)])


def _values(current: Mapping[Key, tuple[float, float]], keys: tuple[Key, ...]) -> FloatArray:
    """Return the current offsets and factors (2, J) of the keys."""
    return np.array([current.get(key, (0.0, 1.0)) for key in keys]).T


def _advanced(
    pooled: ExactSums, current: Mapping[Key, tuple[float, float]], prior_std: float | None, count: int
) -> OffsetEstimate:
    """Return the offsets and factors after a pass with the ``current`` ones."""
    keys = tuple(sorted(key[1] for key in pooled.totals if isinstance(key, tuple) and key[0] == SENSOR))
    index = {key: number for number, key in enumerate(keys)}
    by_sensor = np.array([pooled.sums((SENSOR, key)) for key in keys])
    gradient, alone, squares, degrees, rows = by_sensor.T
    information = np.zeros((len(keys),) * 2)
    for key in pooled.totals:
        if isinstance(key, tuple) and key[0] == PAIR:
            one, other = index[key[1]], index[key[2]]
            information[one, other] = information[other, one] = pooled.sums(key)[0]
    before, factors = _values(current, keys)
    solution = solve_offsets(information, gradient, alone, before, prior_std)
    scale, spare = factors_of_stds(squares * factors * factors, degrees, solution)
    std = np.sqrt(np.diag(solution.covariance))
    moved = np.divide(np.abs(solution.step), std, out=np.zeros(std.shape), where=std > 0.0)
    changed = np.abs(np.log(scale / factors))
    snapshots, known = pooled.sums(SNAPSHOTS) or (0.0, 0.0)
    return OffsetEstimate(
        keys=keys,
        offsets=before + solution.step,
        scale=scale,
        degrees=spare,
        solution=solution,
        rows=rows,
        snapshots=int(snapshots),
        known=int(known),
        places=_places(pooled, keys),
        passes=count,
        step=float(max(moved.max(), changed.max())),
    )


def factors_of_stds(
    squares: FloatArray, degrees: FloatArray, solution: OffsetSolution, unknowns: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Return the factors (J,) of the stated stds by the squares over them (J,), and their degrees of freedom (J,).

    A factor has those of its own rows, without those of the ``unknowns`` of its sensor, and of its prior, and no more
    than the whole input.
    """
    spare = float(degrees.sum()) - solution.freedom
    known = spare > _LEAST_DEGREES
    whole = float(squares.sum()) / spare if known else 1.0
    own = np.maximum(degrees - unknowns, 0.0) + _PRIOR_DEGREES
    factor = np.sqrt((squares + _PRIOR_DEGREES * whole) / own)
    return np.maximum(factor, _LEAST_FACTOR), np.minimum(own, spare) if known else np.full(own.shape, np.nan)


def _places(pooled: ExactSums, keys: tuple[Key, ...]) -> dict[Key, int]:
    """Return the number of different positions of each group."""
    cells: dict[Key, list[tuple[int, ...]]] = {group: [] for group in sorted({key[1:] for key in keys})}
    for key in pooled.totals:
        if isinstance(key, tuple) and key[0] == PLACE:
            cells.setdefault(key[1], []).append(key[2:])
    return {group: count_places(found) for group, found in cells.items()}
