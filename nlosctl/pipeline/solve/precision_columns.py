"""What estimates may tell beside position and covariance: their place on earth, their ellipse, CEP50, GDOP."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import EarthFrame
from nlosctl.contract.tables import ELLIPSE, PRECISION
from nlosctl.errors import UsageError, did_you_mean
from nlosctl.geometry.error_ellipses import circular_error_probable, error_ellipse
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.io.scenes.scene_file import plane_of

__all__ = ["ADDABLE", "on_earth", "precision_columns", "precision_of"]


ADDABLE = {"cep50": "cep50_m", "gdop": "gdop"}
"""The words of ``--add``, and the column that each asks for."""


class _Estimates(Protocol):
    @property
    def covariance_m2(self) -> FloatArray: ...


def precision_columns(ellipse: float | None, add: Sequence[str]) -> tuple[str, ...]:
    """Return the columns that ``--ellipse`` and ``--add`` ask for, in the contract's order; raises UsageError."""
    for word in add:
        if word not in ADDABLE:
            raise UsageError(
                f"--add {word}: no such column{did_you_mean(word, ADDABLE)}; there are: {', '.join(ADDABLE)}"
            )
    asked = {ADDABLE[word] for word in add}
    if ellipse is not None:
        asked |= {column.name for column in ELLIPSE}
    return tuple(column.name for column in (*ELLIPSE, *PRECISION) if column.name in asked)


def on_earth(frame: EarthFrame | None, position_m: FloatArray) -> dict[str, FloatArray]:
    """Return latitude and longitude (E,) of positions (E, 2) in degrees, NaN where there is none.

    Nothing without a frame.
    """
    if frame is None:
        return {}
    lat, lon = plane_of(frame).to_earth(position_m[:, 0], position_m[:, 1])
    return {"lat_deg": lat, "lon_deg": lon}


def precision_of(estimates: _Estimates, ellipse: float | None, add: Sequence[str]) -> dict[str, FloatArray]:
    """Return the columns (E,) of the ellipse and of CEP50; NaN where there is no covariance.

    The ellipse that holds the share p of Gaussian errors has the one-sigma axes times sqrt(-2 ln(1 - p)).
    """
    if ellipse is None and "cep50" not in add:
        return {}
    one_sigma = error_ellipse(Symmetric2x2(*estimates.covariance_m2.T))
    found = {}
    if ellipse is not None:
        scale = float(np.sqrt(-2.0 * np.log1p(-ellipse)))
        found["semi_major_m"] = scale * one_sigma.semi_major_m
        found["semi_minor_m"] = scale * one_sigma.semi_minor_m
        found["orientation_rad"] = one_sigma.orientation_rad
        found["ellipse_probability"] = np.where(np.isnan(one_sigma.semi_major_m), np.nan, ellipse)
    if "cep50" in add:
        found["cep50_m"] = circular_error_probable(one_sigma.semi_major_m, one_sigma.semi_minor_m)
    return found
