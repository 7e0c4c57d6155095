"""Parameters shared by methods that expect outliers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from nlosctl.contract.options import option

__all__ = ["BearingOutlierOptions", "LateOptions", "MixtureModeOptions", "OutlierOptions"]


@dataclass(frozen=True, kw_only=True)
class OutlierOptions:
    """Share of outliers, which paths are direct, and when a fix is ambiguous."""

    alpha: float = option(
        0.25,
        minimum=0.0,
        maximum=1.0,
        exclusive=True,
        meaning="fraction of rows (of sensors, if they have several paths) to expect as outliers",
    )
    path_prior: Literal["uniform", "first", "falling"] = option(
        "uniform",
        meaning="which of a sensor's paths is direct: any, only the first arrival, or each half as likely as before",
    )
    ambiguous_within: float = option(
        2.0, unit="nat", minimum=0.0, meaning="another estimate this near makes a fix ambiguous"
    )
    ambiguous_rows: int = option(
        2,
        minimum=0,
        meaning="if sensors have several paths in unknown order, a fix is also ambiguous if another mode (of at least "
        "three rows) has at most this many fewer rows: one may be the mirror image of the other",
    )


@dataclass(frozen=True, kw_only=True)
class LateOptions:
    """Share of outliers that are late, among rows without competing paths."""

    alpha: float = option(0.25, minimum=0.0, maximum=1.0, exclusive=True, meaning="fraction of rows to expect as late")


@dataclass(frozen=True, kw_only=True)
class BearingOutlierOptions(OutlierOptions):
    """Properties of bearings with outliers, and of their ranges."""

    field_of_view_deg: float = option(
        180.0, unit="deg", minimum=1.0, maximum=360.0, meaning="angle over which an outlier's bearing is uniform"
    )
    use_ranges: bool = option(True, meaning="whether ranges are used, where present")
    range_noise: Literal["gaussian", "lognormal"] = option("gaussian", meaning="distribution of the range error")
    min_range_m: float | None = option(
        None,
        unit="m",
        minimum=0.0,
        meaning="a row can't be direct from closer than this; default: 0.5 % of the sensors' larger extent",
    )
    least_evidence: float = option(
        3.0,
        unit="nat",
        meaning="no_consensus below this log evidence of the best mode over that of outliers; -1000 keeps every fix",
    )
    search_outside: bool = option(
        True, meaning="whether points outside the search region are compared with the best inside (outside_field)"
    )
    exclude_behind_walls: bool = option(
        False, meaning="leave out points that walls of the scene hide from every sensor"
    )


@dataclass(frozen=True, kw_only=True)
class MixtureModeOptions:
    """Modes of a mixture likelihood: their largest number, initial estimates and covariance."""

    covariance: Literal["inliers", "posterior"] = option(
        "inliers", meaning="of the inlier rows (too small with outliers), or calibrated, of the whole posterior"
    )
    max_modes: int = option(20, minimum=1, maximum=100, meaning="largest number of modes; each is an alternative")
    max_pairs: int = option(5000, minimum=1, meaning="pairs of rows crossed; a random subset if there are more")
