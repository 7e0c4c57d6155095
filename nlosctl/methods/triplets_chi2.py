"""Consistency of a path with one target: the chi-square that the maximum-likelihood fit leaves over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, ndtr

from nlosctl.arrays import FloatArray
from nlosctl.contract.batches import TripletBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Flags, Solution, Words
from nlosctl.errors import UsageError
from nlosctl.models.triplets import PathRows, SpacePaths, paths_of
from nlosctl.solvers.triplets.detail_columns import DETAIL_COLUMNS, detail_columns, reasons
from nlosctl.solvers.triplets.difference_rules import rays_miss_by, skew_rays_miss_by
from nlosctl.solvers.triplets.target_fits import fit_paths
from nlosctl.solvers.triplets.target_status import p_values, path_estimates

__all__ = ["METHOD", "ConsistencyOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class ConsistencyOptions:
    """Parameters of ``chi2``."""

    false_alarm: float = option(
        0.05, minimum=0.0, maximum=1.0, exclusive=True, meaning="probability of flagging a direct path"
    )
    rays_miss: bool = option(
        False,
        meaning="also flag rays that miss each other (reported in reason anyway; the chi-square contains that angle, "
        "so that no flag changes)",
    )
    ambiguous_within: float = option(
        2.0, unit="nats", minimum=0.0, meaning="another optimum this near makes an estimate ambiguous"
    )
    noise: str = option("gaussian", meaning="distribution of the errors: only gaussian (tdaj supports others)")

    def __post_init__(self) -> None:
        if self.noise != "gaussian":
            raise UsageError(
                f"The 'noise' parameter of chi2 must be 'gaussian': its chi-square distribution requires it. "
                f"Got {self.noise!r} instead; use `method` tdaj."
            )


def solve(batch: TripletBatch, options: ConsistencyOptions) -> Solution:
    """Flag the paths of a batch, each by itself.

    The fit of two coordinates to three measurements leaves a chi-square of one degree of freedom for a direct path,
    wherever the target is and in every frame. In the plane the rays meet at the fit, so that the chi-square is at least
    the square of the angle, in standard deviations, by which they miss each other. In space three coordinates and five
    measurements leave two degrees of freedom, four measurements one; a path without elevations has no p-value.
    """
    rows = paths_of(batch)
    fits = fit_paths(rows)
    p_value = p_values(rows, fits)
    significant = p_value < options.false_alarm
    miss_p_value = _miss_p_values(rows)
    baseline_m = rows.frame.length_m
    missing = miss_p_value < options.false_alarm
    ip = significant
    if options.rays_miss:
        ip, p_value = significant | missing, np.minimum(p_value, miss_p_value)
    words = reasons(
        ip.shape,
        ("inconsistent", significant),
        ("rays_miss", missing),
        ("no_ellipse", (rows.path_length_m <= baseline_m) & (baseline_m > 0.0)),
        ("monostatic", ~(baseline_m > 0.0)),
        ("no_elevations", np.isnan(p_value)),
    )
    estimates = path_estimates(rows, fits, options.ambiguous_within)
    flags = Flags(
        used=estimates.n_used.reshape(rows.shape) > 0,
        columns={
            "ip": rows.dense(ip),
            "p_value": rows.dense(p_value),
            "reason": Words(code=rows.dense(words.code), words=words.words),
            **(detail_columns(rows, options.false_alarm) if batch.want_details else {}),
        },
    )
    return Solution(estimates=estimates, flags=flags)


def _miss_p_values(rows: PathRows | SpacePaths) -> FloatArray:
    """Return the p-values (N,) of rays that miss each other.

    In space of as many degrees of freedom as the path has, so that they never are below its own.
    """
    if isinstance(rows, PathRows):
        return 2.0 * ndtr(-rays_miss_by(rows))
    return chdtrc(2, skew_rays_miss_by(rows) ** 2)


METHOD = MethodSpec(
    name="chi2",
    kind="triplets",
    job="detect-ip",
    summary="consistency of each path with a single target, calibrated path by path",
    reference="Shen, Molisch 2012, equations (1)-(3) as the model; its likelihood-ratio test, one degree of freedom",
    options=ConsistencyOptions,
    solve=solve,
    cost="half the chi-square of the triplet's residuals",
    minimum_measurements=1,
    dimensions=(2, 3),
    flags=("ip", "p_value", "reason"),
    details=DETAIL_COLUMNS,
)
