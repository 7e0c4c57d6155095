"""The likelihood of bearings as a batched least-squares problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.geometry.blocks import sum_measurements, take_rows
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.models.bearings import SightLines
from nlosctl.solvers.levenberg_marquardt import Evaluation

__all__ = ["BearingProblem"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class BearingProblem:
    """Half the chi-square of the residuals of rays (B, K), as a function of a point about the local origin."""

    origin_x: FloatArray
    origin_y: FloatArray
    cosine: FloatArray
    sine: FloatArray
    inverse_std: FloatArray

    @classmethod
    def of_lines(cls, lines: SightLines) -> BearingProblem:
        """Return the problem of a block of sight lines."""
        return cls(lines.origin_x, lines.origin_y, lines.cosine, lines.sine, 1.0 / lines.std_rad)

    def take(self, rows: IntArray) -> BearingProblem:
        """Return the problems of some rows, in Fortran order."""
        return BearingProblem(
            *(
                take_rows(array, rows)
                for array in (self.origin_x, self.origin_y, self.cosine, self.sine, self.inverse_std)
            )
        )

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        """Return cost, gradient and Gauss-Newton matrix; the gradient of a bearing is (23) of Song et al."""
        dx, dy = x[:, None] - self.origin_x, y[:, None] - self.origin_y
        across = self.sine * dx - self.cosine * dy
        along = self.cosine * dx + self.sine * dy
        residual = np.arctan2(across, along)
        residual *= self.inverse_std
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            weight = self.inverse_std / (dx * dx + dy * dy)
            slope_x, slope_y = dy * weight, -dx * weight
            return Evaluation(
                0.5 * sum_measurements(residual * residual),
                sum_measurements(residual * slope_x),
                sum_measurements(residual * slope_y),
                Symmetric2x2(
                    sum_measurements(slope_x * slope_x),
                    sum_measurements(slope_x * slope_y),
                    sum_measurements(slope_y * slope_y),
                ),
            )
