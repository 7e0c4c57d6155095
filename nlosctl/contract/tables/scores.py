"""The columns of the table that ``evaluate`` writes: a row per group of rows, a column per figure."""

from __future__ import annotations

from nlosctl.contract.statuses import Status
from nlosctl.contract.tables.columns import Column, ColumnType, Table

__all__ = ["SCORES"]

_COUNTS = (
    ("rows", "rows with a truth (of flags: and a flag)"),
    ("without_truth", "rows without a truth, in no other figure"),
    ("answered", "rows with a position"),
    ("nees_rows", "rows with a covariance"),
    ("bad_covariances", "rows whose covariance is not positive definite"),
    *((f"inside_{percent}", f"rows inside their {percent} % ellipse") for percent in (50, 90, 95, 99)),
    ("without_flag", "rows with a truth and no flag"),
    ("los_called_los", "rows in line of sight called so"),
    ("los_called_nlos", "rows in line of sight called otherwise"),
    ("nlos_called_los", "rows not in line of sight called so"),
    ("nlos_called_nlos", "rows not in line of sight called otherwise"),
    ("direct_called_direct", "direct paths called so"),
    ("direct_called_indirect", "direct paths called indirect"),
    ("indirect_called_direct", "indirect paths called direct"),
    ("indirect_called_indirect", "indirect paths called so"),
    ("snapshots", "snapshots of several targets"),
    ("true_targets", "targets that there are"),
    ("found_targets", "targets that were found"),
    ("matched_targets", "found targets within the cutoff of a true one"),
    *((f"case_{case}", f"found targets of case ({case})") for case in ("i", "ii", "iii", "iv", "v", "vi")),
    *((f"status_{status.word}", f"rows of status {status.word}") for status in Status),
)
_NUMBERS = (
    ("fix_rate", "", "share of the rows with a position"),
    ("rmse_m", "m", "root mean square error of the rows with a position"),
    ("rmse_std_error_m", "m", "standard error of the RMSE, rows independent"),
    ("bias_x_m", "m", "mean error along x"),
    ("bias_y_m", "m", "mean error along y"),
    ("mean_m", "m", "mean distance from the truth"),
    ("median_m", "m", "median distance; empty where rows without a position reach into it"),
    *((f"p{percent}_m", "m", f"{percent}th percentile of the distance") for percent in (90, 95, 99)),
    ("nees", "", "mean normalized estimation error squared; 2 where covariances are right"),
    ("nees_low", "", "lower end of the interval that holds nees 95 times in 100 if covariances are right"),
    ("nees_high", "", "upper end of that interval"),
    *((f"coverage_{p}", "", f"share of the rows inside their {p} % ellipse") for p in (50, 90, 95, 99)),
    ("precision", "", "of the rows called line of sight, the share that is"),
    ("recall", "", "of the rows in line of sight, the share called so"),
    ("false_alarm", "", "of the rows not in line of sight, the share called so"),
    ("accuracy", "", "share of the rows that are called what they are"),
    ("p_fa", "", "of the direct paths, the share called indirect"),
    ("p_d", "", "of the indirect paths, the share called so"),
    ("auc", "", "area under the curve of p_d over p_fa"),
    ("p_d_at_5", "", "p_d where p_fa is 5 %"),
    ("p_d_at_1", "", "p_d where p_fa is 1 %"),
    ("ks", "", "Kolmogorov-Smirnov distance of the direct paths' p-values from the uniform law"),
    ("ks_p_value", "", "how often chance explains so large a distance"),
    ("number_right", "", "share of the snapshots whose number of targets is right"),
    ("exact", "", "share of the snapshots in which every target has exactly its direct echoes"),
    ("los_precision", "", "of the echoes called direct, the share that is"),
    ("los_recall", "", "of the direct echoes, the share called so"),
    *(
        (f"ospa{part}_m", "m", f"mean OSPA distance{told}")
        for part, told in (
            ("", ""),
            ("_location", ": its part by location"),
            ("_number", ": its part by the number of targets"),
        )
    ),
    *(
        (f"gospa{part}_m", "m", f"mean GOSPA distance{told}")
        for part, told in (
            ("", ""),
            ("_location", ": its part by location"),
            ("_missed", ": its part by missed targets"),
            ("_false", ": its part by false targets"),
        )
    ),
    ("matched_rmse_m", "m", "root mean square error of the matched targets"),
)


def _figure(name: str, type: ColumnType, unit: str, meaning: str) -> Column:
    return Column(name=name, type=type, unit=unit, nullable=True, meaning=meaning)


SCORES = Table(
    name="scores",
    title="Scores: a row per file, method and swept values; the figures of estimates, flags or targets against truth",
    columns=(
        Column(name="of", type="text", required=True, meaning="what was evaluated: estimates, flags or targets"),
        Column(name="file", type="text", nullable=True, meaning="name of the input, where there are several"),
        Column(name="source", type="text", nullable=True, meaning="input of the earlier step, of several"),
        Column(name="method", type="text", nullable=True, meaning="name of the method"),
        *(_figure(name, "integer", "", meaning) for name, meaning in _COUNTS),
        *(_figure(name, "number", unit, meaning) for name, unit, meaning in _NUMBERS),
    ),
)
