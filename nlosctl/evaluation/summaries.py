"""What an evaluation says, as plain numbers. NaN: nothing to say; infinite: rows without a fix reach into it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

__all__ = ["DetectionSummary", "EstimateSummary", "FlagSummary", "TargetSummary"]


@dataclass(frozen=True, kw_only=True)
class EstimateSummary:
    """Estimates against truth. Lengths in metres.

    ``rows`` have a truth, ``without_truth`` have none and are in no other figure. ``answered`` rows have a
    position, ``fix_rate`` is their share; ``statuses`` counts the rows of each status word. RMSE, bias and mean
    are over answered rows, ``rmse_std_error_m`` is how far chance moves the RMSE (rows independent); in the median
    and the percentiles a row without a fix is infinite. ``nees`` is the mean over the ``nees_rows`` that have a
    covariance, ``nees_low`` and ``nees_high`` hold it 95 times in 100 if the covariances are right (rows
    independent). ``inside_p`` of them are inside their p % ellipse, ``coverage_p`` is the share.
    ``bad_covariances`` rows should have a covariance, and theirs is not positive definite.
    """

    rows: int
    without_truth: int
    answered: int
    fix_rate: float
    rmse_m: float
    rmse_std_error_m: float
    bias_x_m: float
    bias_y_m: float
    mean_m: float
    median_m: float
    p90_m: float
    p95_m: float
    p99_m: float
    nees: float
    nees_low: float
    nees_high: float
    nees_rows: int
    coverage_50: float
    coverage_90: float
    coverage_95: float
    coverage_99: float
    inside_50: int
    inside_90: int
    inside_95: int
    inside_99: int
    bad_covariances: int
    statuses: Mapping[str, int]


@dataclass(frozen=True, kw_only=True)
class FlagSummary:
    """Line-of-sight flags against truth: a confusion table where line of sight is the positive.

    ``rows`` have both a flag and a truth, ``without_flag`` have a truth alone, ``without_truth`` the rest.
    ``precision``: of the rows called line of sight, the share that is; ``recall``: of the rows that are, the share
    called so; ``false_alarm``: of the rows that are not, the share called so. NaN where there is no such row.
    """

    rows: int
    without_flag: int
    without_truth: int
    los_called_los: int
    los_called_nlos: int
    nlos_called_los: int
    nlos_called_nlos: int
    precision: float
    recall: float
    false_alarm: float
    accuracy: float


@dataclass(frozen=True, kw_only=True)
class DetectionSummary:
    """Indirect-path flags against truth: a confusion table where an indirect path is the positive.

    ``rows`` have both a flag and a truth, ``without_flag`` a truth alone, ``without_truth`` the rest. ``p_fa``: of the
    direct paths, the share called indirect; ``p_d``: of the indirect ones, the share called so. ``auc`` is the area
    under the curve of P_d over P_fa as the p-value's threshold moves, ``p_d_at_5`` and ``p_d_at_1`` the P_d on it where
    5 and 1 % of the direct paths are called indirect. ``ks`` is the Kolmogorov-Smirnov distance of the direct paths'
    p-values from the uniform law, ``ks_p_value`` how often chance explains so large a one. ``roc`` is that curve:
    ``p_d`` at each of some values of ``p_fa``. NaN, or no values, where there is no such row, or no p-values.
    """

    rows: int
    without_flag: int
    without_truth: int
    direct_called_direct: int
    direct_called_indirect: int
    indirect_called_direct: int
    indirect_called_indirect: int
    p_fa: float
    p_d: float
    accuracy: float
    auc: float
    p_d_at_5: float
    p_d_at_1: float
    ks: float
    ks_p_value: float
    roc: Mapping[str, Sequence[float]]


@dataclass(frozen=True, kw_only=True)
class TargetSummary:
    """Targets found among unlabelled echoes against truth. Lengths in metres.

    ``number_right`` is the share of the snapshots whose number of targets is right, ``exact`` that in which besides
    every target has exactly its direct echoes; ``los_precision`` and ``los_recall`` are over all echoes. OSPA and
    GOSPA (alpha = 2) are means over the snapshots, with their parts; ``matched_rmse_m`` is over the
    ``matched_targets``, found within the cutoff. ``case_i`` to ``case_vi`` count the found targets by the cases of
    Liang, Zeng, Li: (i) true ones; (ii), (iii) with two direct echoes of one target, the others direct or not;
    (iv), (v), (vi) without, of direct echoes alone, some, none. NaN where there is nothing to say.
    """

    snapshots: int
    true_targets: int
    found_targets: int
    number_right: float
    exact: float
    los_precision: float
    los_recall: float
    ospa_m: float
    ospa_location_m: float
    ospa_number_m: float
    gospa_m: float
    gospa_location_m: float
    gospa_missed_m: float
    gospa_false_m: float
    matched_targets: int
    matched_rmse_m: float
    case_i: int
    case_ii: int
    case_iii: int
    case_iv: int
    case_v: int
    case_vi: int
