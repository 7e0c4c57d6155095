"""Deviations of arrays and factors of their standard deviations: passes over the input until they stay.

As `nlosctl.pipeline.calibrate.offset_passes`, with the offset and the harmonics of each array as unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.errors import DataError
from nlosctl.geometry.exact_sums import ExactSums
from nlosctl.io.calibrations.harmonic_entries import term_names
from nlosctl.pipeline.calibrate.deviation_sums import SECTOR, TERM, DeviationSums
from nlosctl.pipeline.calibrate.offset_passes import MOST_PASSES, OffsetEstimate, factors_of_stds
from nlosctl.pipeline.calibrate.offset_sums import PAIR, SENSOR, SNAPSHOTS, Key
from nlosctl.pipeline.engine.passes import InputPasses
from nlosctl.solvers.calibration.offset_solution import solve_offsets

__all__ = ["DeviationEstimate", "estimate_deviations"]

_NEEDS = (
    "no snapshot has a position with rows to spare: `harmonics` need known positions (`truth`), or the bearings of a "
    "drive around one transmitter as one snapshot (`window` all); set `method` to mixture-ml if some are outliers"
)

_NOT_TOGETHER = (
    "the measurements don't determine the positions and the deviations together: drive around the transmitter, in all "
    "directions, or give known positions (`truth`)"
)
_TOO_FEW_DIRECTIONS = (
    "the bearings are from too few directions relative to the heading for so many `harmonics`: ask for fewer, turn the "
    "array, or state a prior (`offset_prior_deg`)"
)
_LARGEST_STD_RAD = 1.0
"""With a larger standard deviation than this nothing is known of a term."""

_LONGEST_STEP_RAD = 0.2
"""Weakly determined terms move by no more than this in a pass."""


@dataclass(frozen=True, kw_only=True)
class DeviationEstimate(OffsetEstimate):
    """Terms (J,) of the deviations of ``arrays``: offset, cosine and sine of each order, in radians.

    The ``keys`` are those of the terms: the array's, and the name of the term; ``rows``, ``scale`` and ``degrees`` (J,)
    are those of the array. ``sectors`` are the numbers of sectors of ten degrees from the heading with bearings of an
    array.
    """

    arrays: tuple[Key, ...]
    sectors: Mapping[Key, int]


def estimate_deviations(
    sums: DeviationSums,
    prior_std: float | None,
    passes: InputPasses,
    columns: tuple[str, ...],
    show: Callable[[str], None],
) -> DeviationEstimate:
    """Return the deviations by passes of the statistic ``sums``, from deviations of zero.

    A prior of mean zero has ``prior_std`` (radians) for each term. ``columns`` are those of a chunk's table that the
    statistic needs; ``show`` receives a line a pass. Raises DataError if no snapshot counts, or the bearings don't
    determine the terms, and the errors of reading and of the method.
    """
    for count in range(1, MOST_PASSES + 1):
        estimate = _advanced(passes.pool(sums, columns), sums, prior_std, count)
        if not estimate.snapshots:
            raise DataError(_NEEDS if count == 1 else _NOT_TOGETHER)
        show(f"{sums.run.label}: pass {count}: {estimate.snapshots} snapshots count, step {estimate.step:.2g} std")
        if estimate.settled:
            break
        size = sums.terms
        terms = estimate.offsets.reshape(-1, size).tolist()
        scale = estimate.scale[::size].tolist()
        known = {key: (tuple(own), factor) for key, own, factor in zip(estimate.arrays, terms, scale, strict=True)}
        sums = replace(sums, deviations=known)
    if not _is_determined(estimate, prior_std):
        raise DataError(_NOT_TOGETHER if sums.truth is None else _TOO_FEW_DIRECTIONS)
    return estimate


def _is_determined(estimate: DeviationEstimate, prior_std: float | None) -> bool:
    """Return whether the bearings, or a prior, determine all terms of the arrays that have some."""
    lost = [index for part in estimate.solution.lost for index in part.offsets]
    complete = prior_std is not None or not estimate.rows[lost].any()
    return complete and bool(np.diag(estimate.solution.covariance).max() <= _LARGEST_STD_RAD**2)


def _advanced(pooled: ExactSums, sums: DeviationSums, prior_std: float | None, count: int) -> DeviationEstimate:
    """Return the terms and factors after a pass with those of ``sums``."""
    arrays = tuple(sorted(key[1] for key in pooled.totals if isinstance(key, tuple) and key[0] == SENSOR))
    unknowns = [(key, term) for key in arrays for term in range(sums.terms)]
    index = {unknown: number for number, unknown in enumerate(unknowns)}
    by_term = np.array([pooled.sums((TERM, *unknown)) or (0.0, 0.0) for unknown in unknowns])
    squares, degrees, rows = np.array([pooled.sums((SENSOR, key)) for key in arrays]).T
    information = np.zeros((len(unknowns),) * 2)
    for key in pooled.totals:
        if isinstance(key, tuple) and key[0] == PAIR:
            one, other = index[key[1]], index[key[2]]
            information[one, other] = information[other, one] = pooled.sums(key)[0]
    known = [sums.deviations.get(key, ((0.0,) * sums.terms, 1.0)) for key in arrays]
    before = np.array([terms for terms, _ in known]).ravel()
    factors = np.array([factor for _, factor in known])
    solution = solve_offsets(information, by_term[:, 0], by_term[:, 1], before, prior_std)
    scale, spare = factors_of_stds(squares * factors * factors, degrees, solution, sums.terms)
    snapshots, with_truth = pooled.sums(SNAPSHOTS) or (0.0, 0.0)
    names = term_names(sums.harmonics)
    return DeviationEstimate(
        keys=tuple((*key, names[term]) for key, term in unknowns),
        arrays=arrays,
        offsets=before + solution.step * _share(solution.step),
        scale=np.repeat(scale, sums.terms),
        degrees=np.repeat(spare, sums.terms),
        solution=solution,
        rows=np.repeat(rows, sums.terms),
        snapshots=int(snapshots),
        known=int(with_truth),
        places={},
        sectors=_sectors(pooled, arrays),
        passes=count,
        step=_step(solution.step, np.sqrt(np.diag(solution.covariance)), scale / factors),
    )


def _share(step: FloatArray) -> float:
    """Return the share of a step (J,) that is taken."""
    largest = float(np.abs(step).max())
    return min(_LONGEST_STEP_RAD / largest, 1.0) if largest > 0.0 else 1.0


def _step(step: FloatArray, std: FloatArray, change: FloatArray) -> float:
    """Return the largest move of a term over its std, or change of a factor's logarithm."""
    moved = np.divide(np.abs(step), std, out=np.zeros(std.shape), where=std > 0.0)
    return float(max(moved.max(), np.abs(np.log(change)).max()))


def _sectors(pooled: ExactSums, arrays: tuple[Key, ...]) -> dict[Key, int]:
    found = dict.fromkeys(arrays, 0)
    for key in pooled.totals:
        if isinstance(key, tuple) and key[0] == SECTOR and pooled.sums(key)[0] > 0.0:
            found[key[1]] += 1
    return found
