"""The columns of the table that ``evaluate`` writes: a row per group, a column per metric."""

from __future__ import annotations

from nlosctl.contract.statuses import Status
from nlosctl.contract.tables.columns import Column, ColumnType, Table

__all__ = ["SCORES"]

_RESIDUALS = (
    ("residual", "residuals"),
    ("residual_range", "residuals of ranges beside bearings"),
    ("residual_elevation", "residuals of elevations"),
    ("residual_dod", "residuals of departure directions"),
    ("residual_doa", "residuals of arrival directions"),
    ("residual_dod_elevation", "residuals of departure elevations"),
    ("residual_doa_elevation", "residuals of arrival elevations"),
)
_COUNTS = (
    ("rows", "rows with a truth (of flags: and a flag; of residuals: rows with a residual)"),
    ("rows_used", "rows with a residual that a fix uses"),
    ("without_truth", "rows without a truth, not in any other metric"),
    ("answered", "rows with a fix: a position, and a status other than no_consensus and outside_field"),
    ("nees_rows", "rows with a covariance"),
    ("bad_covariances", "rows whose covariance is not positive definite"),
    *((f"inside_{percent}", f"rows inside their {percent} % ellipse") for percent in (50, 90, 95, 99)),
    ("without_flag", "rows with a truth and no flag"),
    ("los_called_los", "line-of-sight rows flagged as line of sight"),
    ("los_called_nlos", "line-of-sight rows flagged as not line of sight"),
    ("nlos_called_los", "non-line-of-sight rows flagged as line of sight"),
    ("nlos_called_nlos", "non-line-of-sight rows flagged as not line of sight"),
    ("direct_called_direct", "direct paths flagged as direct"),
    ("direct_called_indirect", "direct paths flagged as indirect"),
    ("indirect_called_direct", "indirect paths flagged as direct"),
    ("indirect_called_indirect", "indirect paths flagged as indirect"),
    ("snapshots", "snapshots of several targets"),
    ("true_targets", "true targets"),
    ("found_targets", "estimated targets"),
    ("matched_targets", "estimated targets within the cutoff of a true target"),
    ("identity_switches", "matched targets in another track than when they were matched before"),
    *((f"case_{case}", f"estimated targets of case ({case})") for case in ("i", "ii", "iii", "iv", "v", "vi")),
    *((f"status_{status.word}", f"rows of status {status.word}") for status in Status),
)
_NUMBERS = (
    ("fix_rate", "", "fraction of rows with a fix"),
    ("mean_used_share", "", "mean share of a snapshot's rows that a fix uses"),
    ("share_p_below_0001", "", "fraction of fixes with fit_p_value below 0.001, of those that have one"),
    ("rmse_m", "m", "root mean square error of the rows with a fix"),
    ("horizontal_rmse_m", "m", "root mean square error in x and y, of estimates in three dimensions"),
    ("vertical_rmse_m", "m", "root mean square error in z"),
    ("rmse_std_error_m", "m", "standard error of the RMSE for independent rows"),
    ("bias_x_m", "m", "mean error along x"),
    ("bias_y_m", "m", "mean error along y"),
    ("bias_z_m", "m", "mean error along z"),
    ("settling_time_s", "s", "time of a track from which on errors stay below three stds (root of the trace)"),
    ("mean_m", "m", "mean distance from the truth"),
    ("median_m", "m", "median distance; empty if it falls on rows without a fix"),
    *((f"p{percent}_m", "m", f"{percent}th percentile of the distance") for percent in (90, 95, 99)),
    ("nees", "", "mean normalized estimation error squared; 2 (in three dimensions 3) if covariances are correct"),
    ("nees_low", "", "lower end of the 95 % acceptance interval of nees if covariances are correct"),
    ("nees_high", "", "upper end of the 95 % acceptance interval of nees"),
    *((f"coverage_{p}", "", f"fraction of rows inside their {p} % ellipse") for p in (50, 90, 95, 99)),
    ("precision", "", "fraction of rows flagged as line of sight that are"),
    ("recall", "", "fraction of line-of-sight rows flagged as line of sight"),
    ("false_alarm", "", "fraction of non-line-of-sight rows flagged as line of sight"),
    ("accuracy", "", "fraction of rows with a correct flag"),
    ("p_fa", "", "false-alarm probability: fraction of direct paths flagged as indirect"),
    ("p_d", "", "detection probability: fraction of indirect paths flagged as indirect"),
    ("auc", "", "area under the ROC curve, p_d over p_fa"),
    ("p_d_at_5", "", "p_d at p_fa = 5 %"),
    ("p_d_at_1", "", "p_d at p_fa = 1 %"),
    ("ks", "", "Kolmogorov-Smirnov distance between the p-values of direct paths and the uniform distribution"),
    ("ks_p_value", "", "p-value of that distance"),
    ("number_right", "", "fraction of snapshots with the correct number of targets"),
    ("exact", "", "fraction of snapshots in which every target has exactly its direct echoes"),
    ("los_precision", "", "fraction of echoes flagged as direct that are"),
    ("los_recall", "", "fraction of direct echoes flagged as direct"),
    *(
        (f"ospa{part}_m", "m", f"mean OSPA distance{part_meaning}")
        for part, part_meaning in (("", ""), ("_location", ": localization part"), ("_number", ": cardinality part"))
    ),
    *(
        (f"gospa{part}_m", "m", f"mean GOSPA distance{part_meaning}")
        for part, part_meaning in (
            ("", ""),
            ("_location", ": localization part"),
            ("_missed", ": part of missed targets"),
            ("_false", ": part of false targets"),
        )
    ),
    ("matched_rmse_m", "m", "root mean square error of the matched targets"),
    *(
        (f"{name}_{figure}", "", f"{words} of the {whose} over their standard deviations, of the rows used")
        for name, whose in _RESIDUALS
        for figure, words in (
            ("mean", "mean"),
            ("std", "standard deviation"),
            ("autocorrelation", "autocorrelation at lag 1, in the order of the snapshots,"),
        )
    ),
    ("outlier_share", "", "fraction of rows with a residual beyond three of its standard deviations"),
)


def _metric(name: str, type: ColumnType, unit: str, meaning: str) -> Column:
    return Column(name=name, type=type, unit=unit, nullable=True, meaning=meaning)


SCORES = Table(
    name="scores",
    title="Scores: a row per file, method and swept values; the metrics of estimates, flags, residuals or targets",
    columns=(
        Column(
            name="of", type="text", required=True, meaning="what was evaluated: estimates, flags, residuals or targets"
        ),
        Column(name="file", type="text", nullable=True, meaning="name of the input, if there are several"),
        Column(name="source", type="text", nullable=True, meaning="input of the earlier step, if there were several"),
        Column(name="method", type="text", nullable=True, meaning="name of the method"),
        *(_metric(name, "integer", "", meaning) for name, meaning in _COUNTS),
        *(_metric(name, "number", unit, meaning) for name, unit, meaning in _NUMBERS),
    ),
)
