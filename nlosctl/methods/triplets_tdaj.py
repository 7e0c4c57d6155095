"""TOA, DOD and DOA joint detection of indirect paths by the differences of the three intersections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.contract.batches import TripletBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Flags, Solution, Words, no_estimates
from nlosctl.geometry.triplets import DIFFERENCES
from nlosctl.models.error_laws import ErrorLaw, parse_error_law
from nlosctl.models.triplets import PathRows, path_rows
from nlosctl.solvers.triplets.detail_columns import DETAIL_COLUMNS, detail_columns, reasons
from nlosctl.solvers.triplets.difference_rules import Decision, blind_rows, decide, decide_fusion, rule_quantity

__all__ = ["METHOD", "TdajOptions", "solve"]

RULES = tuple(DIFFERENCES)


@dataclass(frozen=True, kw_only=True)
class TdajOptions:
    """Parameters of ``tdaj``."""

    false_alarm: float = option(
        0.05, minimum=0.0, maximum=1.0, exclusive=True, meaning="probability of flagging a direct path"
    )
    rule: Literal["lambda1", "lambda2", "lambda3", "lambda4", "lambda5", "lambda6", "fusion", "ellipse"] = option(
        "lambda5",
        meaning="which difference decides; fusion: more than k of the six; ellipse: the crossing's distance from it",
    )
    k: int = option(
        0, minimum=0, maximum=5, meaning="with rule=fusion: indirect if more than k differences are significant"
    )
    noise: str = option("gaussian", meaning="distribution of the errors: gaussian, uniform, laplace or student-t:NU")
    behind_is_ip: bool = option(False, meaning="lines that meet behind transmitter or receiver are always indirect")
    eta_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="safe region: flag differences significantly larger than this"
    )

    def __post_init__(self) -> None:
        parse_error_law(self.noise)


def solve(batch: TripletBatch, options: TdajOptions) -> Solution:
    """Flag the paths of a batch, each by itself; Algorithm 1 of Shen, Molisch 2012.

    W is taken at the measured triplet, each coefficient at its own intersection. ``ip`` is false, with a ``reason``,
    where the rule cannot judge: no ellipse, parallel rays, transmitter and receiver at one point (no baseline frame).
    """
    rows, law = path_rows(batch), parse_error_law(options.noise)
    p_value, blind = _judge(rows, law, options)
    monostatic = ~(rows.rays.baseline_m > 0.0)
    if monostatic.any():
        p_value = np.where(monostatic, np.nan, p_value)
    significant = p_value < options.false_alarm
    behind = rows.rays.meets_behind & ~monostatic & options.behind_is_ip
    words = reasons(
        significant.shape,
        ("inconsistent", significant),
        ("behind", behind),
        ("no_ellipse", ~rows.rays.has_ellipse & ~monostatic),
        ("parallel", np.isnan(p_value) & rows.rays.has_ellipse & ~monostatic),
        ("monostatic", monostatic),
    )
    columns: dict[str, Any] = {
        "ip": rows.dense(significant | behind),
        "p_value": rows.dense(np.where(behind, 0.0, p_value)),
        "reason": Words(code=rows.dense(words.code), words=words.words),
        "blind": rows.dense(blind),
    }
    if options.eta_m > 0.0:
        columns["outside_safe_region"] = rows.dense(significant)
    if batch.want_details:
        columns |= detail_columns(rows, options.false_alarm, law=law, eta_m=options.eta_m)
    used = np.zeros(rows.shape, dtype=bool)
    return Solution(estimates=no_estimates(batch.size), flags=Flags(used=used, columns=columns))


def _decide(rows: PathRows, rule: int | str, law: ErrorLaw, options: TdajOptions) -> Decision:
    return decide(rows, rule_quantity(rows.rays, rule), law, options.eta_m)


def _judge(rows: PathRows, law: ErrorLaw, options: TdajOptions) -> tuple[FloatArray, BoolArray]:
    """Return the p-value of the chosen rule and where it is blind."""
    if options.rule == "fusion":
        blind = np.stack([blind_rows(rows, rule) for rule in RULES])
        # At least k + 1 usable rules are needed; nearly parallel rays invalidate the p-values of four of them.
        too_few = np.count_nonzero(~blind, axis=0) <= options.k
        p_values = [_decide(rows, rule, law, options).p_value for rule in RULES]
        return decide_fusion(p_values, options.k), too_few | blind_rows(rows, "ellipse")
    rule: int | str = options.rule if options.rule == "ellipse" else int(options.rule[-1])
    return _decide(rows, rule, law, options).p_value, blind_rows(rows, rule)


def _safe_region_columns(options: TdajOptions) -> tuple[str, ...]:
    return ("outside_safe_region",) if options.eta_m > 0.0 else ()


def _remark(options: TdajOptions) -> str:
    """Return for which rows the false-alarm probability holds."""
    if options.rule == "fusion":
        return (
            "the false-alarm probability is guaranteed at no level with rule=fusion, because each of six differences "
            "may exceed its threshold; a single rule or chi2 has one"
        )
    return (
        "the false-alarm probability is guaranteed (to a fifth, down to 0.001) where 'blind' is false; elsewhere the "
        "rule is not linear in the errors, and chi2 can judge"
    )


METHOD = MethodSpec(
    name="tdaj",
    kind="triplets",
    job="detect-ip",
    summary="differences of the three intersections of TOA, DOD and DOA against their noise, path by path",
    reference="Shen, Molisch 2012, Algorithm 1, equations (1)-(27), (35)-(36)",
    options=TdajOptions,
    solve=solve,
    cost="none: it estimates nothing",
    minimum_measurements=1,
    estimates=False,
    remark=_remark,
    flags=("ip", "p_value", "reason", "blind"),
    flags_with=_safe_region_columns,
    details=DETAIL_COLUMNS,
)
