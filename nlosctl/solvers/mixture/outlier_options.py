"""Parameters that methods share which expect outliers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from nlosctl.contract.options import option

__all__ = ["BearingOutlierOptions", "MixtureModeOptions", "OutlierOptions"]


@dataclass(frozen=True, kw_only=True)
class OutlierOptions:
    """How many outliers there are, which paths are direct, and what makes a fix ambiguous."""

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
        meaning="where sensors have several paths in no known order, another mode on which at most so many rows fewer "
        "agree (three or more) makes a fix ambiguous too: it may be the source, and this its mirror image",
    )


@dataclass(frozen=True, kw_only=True)
class BearingOutlierOptions(OutlierOptions):
    """What bearings with outliers, and ranges beside them, are like."""

    field_of_view_deg: float = option(
        180.0, unit="deg", minimum=1.0, maximum=360.0, meaning="angle over which an outlier's bearing is uniform"
    )
    use_ranges: bool = option(True, meaning="whether ranges are used where rows have them")
    range_noise: Literal["gaussian", "lognormal"] = option("gaussian", meaning="distribution of the range error")
    min_range_m: float | None = option(
        None,
        unit="m",
        minimum=0.0,
        meaning="a row can't be direct from closer than this; none: 0.5 % of the larger side of the box of the sensors",
    )


@dataclass(frozen=True, kw_only=True)
class MixtureModeOptions:
    """How many modes of a mixture likelihood are sought, from where, and what covariance a mode gets."""

    covariance: Literal["inliers", "posterior"] = option(
        "inliers",
        meaning="of the rows held to be direct (too small with outliers), or calibrated, from a posterior grid",
    )
    max_modes: int = option(20, minimum=1, maximum=100, meaning="modes sought; each is an alternative")
    max_pairs: int = option(5000, minimum=1, meaning="pairs of rows crossed; of more, so many are drawn at random")
