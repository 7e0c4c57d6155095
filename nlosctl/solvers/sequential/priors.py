"""Priors of a position: those of parameters, and those of a file's columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, Point
from nlosctl.contract.options import option
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["PRIOR_NAMES", "Prior", "PriorOptions", "check_prior", "prior_of"]

_POSITION = ("prior_x_m", "prior_y_m")
_STD = "prior_std_m"
_COVARIANCE = ("prior_cov_xx_m2", "prior_cov_xy_m2", "prior_cov_yy_m2")

PRIOR_NAMES = (*_POSITION, _STD, *_COVARIANCE)
"""The names of parameters and columns of a prior."""


@dataclass(frozen=True, kw_only=True)
class PriorOptions:
    """A prior of the source: its position with a standard deviation or a covariance."""

    prior_x_m: float | None = option(None, unit="m", meaning="prior x of the source, in place of a pair of rows")
    prior_y_m: float | None = option(None, unit="m", meaning="prior y of the source")
    prior_std_m: float | None = option(
        None, unit="m", minimum=0.0, exclusive=True, meaning="standard deviation of the prior in x and in y"
    )
    prior_cov_xx_m2: float | None = option(
        None, unit="m2", minimum=0.0, exclusive=True, meaning="covariance of the prior, in place of prior_std_m"
    )
    prior_cov_xy_m2: float | None = option(None, unit="m2", meaning="covariance of the prior")
    prior_cov_yy_m2: float | None = option(
        None, unit="m2", minimum=0.0, exclusive=True, meaning="covariance of the prior"
    )


@dataclass(frozen=True)
class Prior(RowBlock):
    """Where the sources (B,) were expected, about the local origin, with the covariance (B,) in square metres.

    ``known`` marks the snapshots that have a prior.
    """

    x: FloatArray
    y: FloatArray
    covariance: SymmetricMatrix
    known: BoolArray

    def information(self) -> SymmetricMatrix:
        """Return the inverse covariance (B,), zero where there is no prior."""
        nothing = SymmetricMatrix.full(self.x.shape, 0.0)
        return self.covariance.inverse().where(self.known, nothing)

    def half_chi_square(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return half the squared normalized distance of points (B, M) from the prior; 0 without one."""
        dx, dy = (np.where(self.known, part, 0.0)[:, None] for part in (self.x, self.y))
        return 0.5 * self.information().at(slice(None), None).quadratic_form(x - dx, y - dy)


def prior_of(batch: Any, center: Point, options: PriorOptions) -> Prior | None:
    """Return the prior of each snapshot about ``center`` (B,): that of the file, else that of the parameters.

    None without any. Raises UsageError for a part of a prior.
    """
    parts = [np.full(batch.size, value) for value in check_prior(options)]
    if getattr(batch, "prior_xy_m", None) is not None and batch.measurements:
        position = (batch.prior_xy_m[:, 0, 0], batch.prior_xy_m[:, 0, 1])
        for own in (_own_std(batch), _own_covariance(batch)):
            if own is not None:
                complete = np.isfinite([*position, *own]).all(axis=0)
                parts = [np.where(complete, mine, part) for mine, part in zip((*position, *own), parts, strict=True)]
    known: BoolArray = np.isfinite(np.stack(parts)).all(axis=0)
    if not known.any():
        return None
    x, y, *covariance = parts
    return Prior(x - center[0], y - center[1], SymmetricMatrix(*covariance), known)


def check_prior(options: PriorOptions) -> tuple[float, ...]:
    """Return x, y, xx, xy and yy of the parameters' prior, NaN without one; UsageError for a part of one."""
    values = {name: getattr(options, name) for name in (*_POSITION, _STD, *_COVARIANCE)}
    given = {name: float(value) for name, value in values.items() if value is not None}
    if not given:
        return (np.nan,) * 5
    needed = (*_POSITION, *(_COVARIANCE if given.keys() & set(_COVARIANCE) else (_STD,)))
    if given.keys() != set(needed):
        alone = f", without {_STD}" if _STD in given and _STD not in needed else ""
        raise UsageError(f"a prior needs all of {', '.join(needed[:-1])} and {needed[-1]}{alone}")
    if _STD in given:
        return given["prior_x_m"], given["prior_y_m"], given[_STD] ** 2, 0.0, given[_STD] ** 2
    x, y, xx, xy, yy = (given[name] for name in needed)
    if xy * xy >= xx * yy:
        raise UsageError(f"prior_cov_xy_m2 = {xy:g}: its square must be below the product of {xx:g} and {yy:g}")
    return x, y, xx, xy, yy


def _own_std(batch: Any) -> tuple[FloatArray, ...] | None:
    if batch.prior_std_m is None:
        return None
    variance = batch.prior_std_m[:, 0] * batch.prior_std_m[:, 0]
    return variance, np.where(np.isfinite(variance), 0.0, np.nan), variance


def _own_covariance(batch: Any) -> tuple[FloatArray, ...] | None:
    return None if batch.prior_cov_m2 is None else tuple(batch.prior_cov_m2[:, 0].T)
