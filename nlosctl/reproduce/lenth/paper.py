"""Lenth 1981: the paper with the errors in its text, and the estimates of its bearings."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from nlosctl.api import localize
from nlosctl.reproduce.experiment import Erratum, Paper

__all__ = ["EXAMPLES", "PAPER", "example_figures"]

PAPER = Paper(
    name="lenth",
    reference="Lenth 1981",
    ours=(
        "The bearings and the printed positions are those of the data files of telemetr, an R package.",
        "Question 33352 of Cross Validated, the Gaussian fits, std and standard errors are not in the paper: their "
        "expected numbers are those of an independent implementation. The coverage is the nominal one.",
        "The world of the coverage: sensors and a source at random in a square kilometre, stds of 0.5, 1 and 2 times "
        "2 deg that are known as relative weights alone. A file is a chunk of 500 trials.",
    ),
    errata=(
        Erratum(
            "covariance",
            "kappa from the mean cosine C, standard errors .156 and .156 of seven bearings",
            "from 1 - (1 - C) n / (n - 2): with C it is the maximum-likelihood one, and 95 % ellipses of three "
            "bearings contain 41 % of the true positions",
        ),
    ),
)

_SEVEN = (
    (9.0, 3.2, 234.0),
    (9.4, 5.5, 215.0),
    (9.95, 9.05, 196.0),
    (8.7, 8.7, 193.0),
    (8.07, 9.7, 188.0),
    (4.4, 8.9, 160.0),
    (1.85, 5.25, 118.0),
)
EXAMPLES = {
    "seven bearings": _SEVEN,
    "eight bearings": (*_SEVEN, (5.6, 9.0, 250.0)),
    "question 33352": ((554045.0, 2813867.0, 300.0), (553355.0, 2813873.0, 20.0), (553207.0, 2814120.0, 90.0)),
}
"""x, y in the unit of the example and degrees clockwise from north, without standard deviations."""


@cache
def example_figures(example: str, law: str) -> Mapping[str, float]:
    """Return the ``ml`` estimate of an example by a law: x, y, their standard errors, std, 95 % radius in errors."""
    x, y, azimuth = np.array(EXAMPLES[example]).T
    table = {"sensor": [str(number) for number in range(x.size)], "sensor_x_m": x, "sensor_y_m": y}
    table |= {"azimuth_deg": azimuth}
    estimates = localize(table, method="ml", kind="bearings", estimate_std="snapshot", law=law, ellipse=0.95).estimates
    row = estimates.to_pylist()[0]
    off_diagonal = row["cov_xy_m2"]
    covariance = np.array([[row["cov_xx_m2"], off_diagonal], [off_diagonal, row["cov_yy_m2"]]])
    return {
        "x": row["x_m"],
        "y": row["y_m"],
        "error_x": float(np.sqrt(row["cov_xx_m2"])),
        "error_y": float(np.sqrt(row["cov_yy_m2"])),
        "std_deg": float(np.degrees(row["std_factor"])),
        "radius": float(row["semi_major_m"] / np.sqrt(np.linalg.eigvalsh(covariance)[1])),
    }
