"""Results of an evaluation as plain numbers. NaN: not defined; infinite: rows without a fix reach into the figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

__all__ = ["DetectionSummary", "EstimateSummary", "FlagSummary", "TargetSummary"]


@dataclass(frozen=True, kw_only=True)
class EstimateSummary:
    """Estimates against truth. Lengths in metres.

    ``rows`` have a truth; ``without_truth`` have none and enter no other figure. ``answered`` rows have a fix (a
    position, and a status other than no_consensus and outside_field), ``fix_rate`` is their share; ``statuses``
    counts the rows of each status. RMSE, bias and mean are over
    answered rows, ``rmse_std_error_m`` is the standard error of the RMSE for independent rows; in the median and the
    percentiles a row without a fix is infinite. ``nees`` is the mean over the ``nees_rows`` that have a covariance;
    the interval from ``nees_low`` to ``nees_high`` contains it with 95 % probability if the covariances are correct
    and the rows independent. ``inside_p`` rows are inside their p % ellipse, ``coverage_p`` is their share.
    ``bad_covariances`` counts covariances that are not positive definite. ``mean_used_share`` is the mean of
    ``used_share`` over the fixes, ``share_p_below_0001`` the share with a ``fit_p_value`` below 0.001, of those that
    have one. Of positions in space, errors, ``rmse_m`` and ellipsoids are in space; ``horizontal_rmse_m``,
    ``vertical_rmse_m`` and ``bias_z_m`` are None in the plane. ``settling_time_s`` is of states of a track: the time
    from the first one after which errors stay below three standard deviations (of several tracks the longest).
    """

    rows: int
    without_truth: int
    answered: int
    fix_rate: float
    mean_used_share: float
    share_p_below_0001: float
    rmse_m: float
    rmse_std_error_m: float
    horizontal_rmse_m: float | None = None
    vertical_rmse_m: float | None = None
    bias_x_m: float
    bias_y_m: float
    bias_z_m: float | None = None
    settling_time_s: float | None = None
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
    """Line-of-sight flags against truth: a confusion table whose positives are line-of-sight rows.

    ``rows`` have both a flag and a truth, ``without_flag`` only a truth, ``without_truth`` no truth.
    ``precision``: share of true line of sight among rows flagged so; ``recall``: share flagged line of sight among
    true line-of-sight rows; ``false_alarm``: share flagged line of sight among the others. NaN without such rows.
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
    """Indirect-path flags against truth: a confusion table whose positives are indirect paths.

    ``rows`` have both a flag and a truth, ``without_flag`` only a truth, ``without_truth`` no truth. ``p_fa`` is the
    share of direct paths flagged indirect, ``p_d`` that of indirect paths flagged indirect. ``auc`` is the area under
    the ROC curve over the p-value's threshold, ``p_d_at_5`` and ``p_d_at_1`` are P_d at P_fa of 5 and 1 %. ``ks`` is
    the Kolmogorov-Smirnov distance of the direct paths' p-values from the uniform law, ``ks_p_value`` its p-value.
    ``roc`` holds ``p_d`` at a grid of ``p_fa``. NaN, or no values, without such rows or without p-values.
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
    """Targets estimated from unlabelled echoes against truth. Lengths in metres.

    ``number_right`` is the share of snapshots with the correct number of targets, ``exact`` the share in which every
    target also has exactly its direct echoes; ``los_precision`` and ``los_recall`` are over all echoes. OSPA and GOSPA
    (alpha = 2) are means over the snapshots, with their parts; ``matched_rmse_m`` is over the ``matched_targets``,
    estimated within the cutoff. ``case_i`` to ``case_vi`` count the estimated targets by the cases of Liang, Zeng,
    Li (see `nlosctl.evaluation.targets.case_of`). ``mean_used_share`` and ``share_p_below_0001`` are as in
    `EstimateSummary`, over the estimated targets. ``identity_switches`` counts the true targets, snapshot by snapshot,
    that are matched by another track than before; None without tracks. NaN: not defined.
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
    mean_used_share: float
    share_p_below_0001: float
    case_i: int
    case_ii: int
    case_iii: int
    case_iv: int
    case_v: int
    case_vi: int
    identity_switches: int | None = None
