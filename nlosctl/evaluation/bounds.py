"""The Cramér-Rao bound on positions, from their Fisher information."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.geometry.ellipses import circular_error_probable, error_ellipse
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["Bounds", "SpaceBounds", "bounds_of"]

_CONDITION_LIMIT = 1e12


@dataclass(frozen=True)
class Bounds:
    """Bounds (B,) on the covariance of unbiased estimates, with their ellipse; NaN where the bound does not exist.

    Covariances in square metres, lengths in metres, the orientation in radians from +x. ``rms_m`` is the square root
    of the trace. The ellipse and ``cep50_m``, the radius of the circle that contains half of Gaussian errors with that
    covariance, are those of x and y.
    """

    bound_xx_m2: FloatArray
    bound_xy_m2: FloatArray
    bound_yy_m2: FloatArray
    rms_m: FloatArray
    semi_major_m: FloatArray
    semi_minor_m: FloatArray
    orientation_rad: FloatArray
    cep50_m: FloatArray


@dataclass(frozen=True)
class SpaceBounds(Bounds):
    """Bounds in space: ``rms_m`` is of x, y and z."""

    bound_xz_m2: FloatArray
    bound_yz_m2: FloatArray
    bound_zz_m2: FloatArray


def bounds_of(information: SymmetricMatrix) -> Bounds:
    """Return the bounds: the inverse of the information (equation (20) of Song, Willett, Zhou 2013).

    NaN where the larger eigenvalue exceeds 1e12 times the smaller, or anything is not finite.
    """
    with ignoring_overflow():
        smaller, larger = information.eigenvalues()
        regular = (smaller * _CONDITION_LIMIT > larger) & np.isfinite(larger)
    parts = (np.where(regular, part, np.nan) for part in information)
    covariance = SymmetricMatrix(*parts).inverse()
    ellipse = error_ellipse(SymmetricMatrix(*covariance.parts[:3]))
    bounds = Bounds(
        bound_xx_m2=covariance.xx,
        bound_xy_m2=covariance.xy,
        bound_yy_m2=covariance.yy,
        rms_m=np.sqrt(covariance.trace),
        semi_major_m=ellipse.semi_major_m,
        semi_minor_m=ellipse.semi_minor_m,
        orientation_rad=ellipse.orientation_rad,
        cep50_m=circular_error_probable(ellipse.semi_major_m, ellipse.semi_minor_m),
    )
    return bounds if covariance.dimension == 2 else SpaceBounds(*vars(bounds).values(), *covariance.parts[3:])
