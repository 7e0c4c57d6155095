"""True cases of the structured candidate sets of type-based clustering: the six cases of Liang, Zeng, Li, Fig. 2."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.batches import RangeBatch
from nlosctl.models.search_regions import search_region
from nlosctl.solvers.echoes.echoes import Echoes, read_echoes
from nlosctl.solvers.echoes.structured_sets import ClusteringOptions, StructuredSets, cluster_echoes
from nlosctl.solvers.echoes.type_sets import Gate, cross_all

__all__ = ["CandidateSets", "candidate_sets"]


@dataclass(frozen=True, kw_only=True)
class CandidateSets:
    """The S distinct structured candidate sets of one snapshot, in ascending order of their spread (S,) in metres.

    ``case`` (S,) indexes `nlosctl.evaluation.targets.CASES`; ``kept`` (S,) marks sets that pass the comparison (5);
    ``row`` (S, N) are the measurements of a set's circles, ``point_m`` (S, N (N - 1) / 2, 2) its points; ``larger``
    (S,) marks sets whose spread exceeds that of every TIP set with a common point.
    """

    spread_m: FloatArray
    case: IntArray
    kept: BoolArray
    row: IntArray
    point_m: FloatArray
    larger: BoolArray


def candidate_sets(
    batch: RangeBatch, snapshot: int, true_target: IntArray, true_los: BoolArray, options: ClusteringOptions
) -> CandidateSets:
    """Return the candidates of a snapshot with their cases, from the truth of its K rows (target -1: none).

    The TIP set of a target is the set of its direct circles with the smallest spread: the others have the wrong root of
    some pair. A set with a point of a TIP set has a TIP (ii, iii), any other set has none (iv-vi).
    """
    echoes = read_echoes(batch, snapshot, options.max_echoes)
    gate = _gate(batch, snapshot, echoes, options.field_margin_m)
    sets, unique = cluster_echoes(echoes, gate, options)
    first = np.sort(np.unique(sets.points, axis=0, return_index=True)[1])
    kept = np.isin(first, list(unique))
    distinct = StructuredSets(sets.spread_m[first], sets.circles[first], sets.points[first])
    row = echoes.row[np.arange(echoes.sensors), distinct.circles - np.arange(echoes.sensors) * echoes.most]
    case, larger = _cases(distinct, true_target[row], true_los[row])
    pair, root = np.divmod(distinct.points, 2)
    table = cross_all(echoes, options.gap_tolerance_m, gate)
    x, y = (np.reshape(axis, (2, -1))[root, pair] for axis in (table.x, table.y))
    point = np.stack([x + echoes.center_x, y + echoes.center_y], axis=-1)
    return CandidateSets(spread_m=distinct.spread_m, case=case, kept=kept, row=row, point_m=point, larger=larger)


def _gate(batch: RangeBatch, snapshot: int, echoes: Echoes, margin_m: float) -> Gate:
    xy = batch.sensor_xy_m[snapshot : snapshot + 1]
    center_x, center_y = np.array([echoes.center_x]), np.array([echoes.center_y])
    return Gate(search_region(batch.field, (xy[..., 0], xy[..., 1]), (center_x, center_y)), margin_m)


def _cases(sets: StructuredSets, target: IntArray, los: BoolArray) -> tuple[IntArray, BoolArray]:
    """Return the case (S,) of each set, and whether its spread exceeds that of all TIP sets with a common point.

    ``target`` and ``los`` (S, N) are those of each set's circles.
    """
    direct, some_direct = np.asarray(los.all(axis=1)), np.asarray(los.any(axis=1))
    of_one = direct & (target == target[:, :1]).all(axis=1)
    tips = [np.flatnonzero(of_one & (target[:, 0] == number))[0] for number in np.unique(target[of_one, 0])]
    case = np.where(direct, 3, np.where(some_direct, 4, 5))
    larger = np.ones(case.shape, dtype=bool)
    for tip in tips:
        shares = (sets.points == sets.points[tip]).any(axis=1)
        case[shares] = np.where(direct[shares], 1, 2)
        larger &= ~shares | (sets.spread_m > sets.spread_m[tip])
    case[tips] = 0
    return case, larger
