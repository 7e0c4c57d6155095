"""The likelihood of triplets as a batched least-squares problem with the target's two coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_overflow
from nlosctl.contract.batches import TripletBatch
from nlosctl.geometry.angles import cosine_sine
from nlosctl.geometry.blocks import RowBlock, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.triplets import PathRows
from nlosctl.solvers.optimization.problem import Evaluation

__all__ = ["SCALARS", "PathSums", "TripletProblem", "angle_residual"]


SCALARS = 3
"""The scalars of a triplet: directions of departure and arrival, and path length."""


@dataclass(frozen=True)
class TripletProblem(RowBlock):
    """Half the chi-square of triplets (B, K), as a function of a target about a local origin (B,); metres.

    ``scatter_m2`` is the variance, in x and in y, of the point at which an extended target scatters a path. It is no
    part of the chi-square of a point.
    """

    tx_x: FloatArray
    tx_y: FloatArray
    rx_x: FloatArray
    rx_y: FloatArray
    dod_cosine: FloatArray
    dod_sine: FloatArray
    doa_cosine: FloatArray
    doa_sine: FloatArray
    path_length_m: FloatArray
    inverse_dod_std: FloatArray
    inverse_doa_std: FloatArray
    inverse_length_std: FloatArray
    scatter_m2: FloatArray

    @classmethod
    def of_paths(cls, rows: PathRows) -> TripletProblem:
        """Return a problem for every path by itself (N, 1), in the frame of its baseline."""
        rays, half = rows.rays, 0.5 * rows.frame.length_m
        zero = np.zeros_like(half)
        arrays = (-half, zero, half, zero, rays.dod_cosine, rays.dod_sine, rays.doa_cosine, rays.doa_sine)
        inverse = (1.0 / rows.dod_std_rad, 1.0 / rows.doa_std_rad, 1.0 / rows.path_length_std_m)
        return cls(*(np.asfortranarray(array[:, None]) for array in (*arrays, rays.path_length_m, *inverse, zero)))

    @classmethod
    def of_snapshots(
        cls, batch: TripletBatch, center_x: FloatArray, center_y: FloatArray, target_radius_m: float | None = 0.0
    ) -> TripletProblem:
        """Return a problem for every snapshot, all its paths over one target; global axes about centers (B,).

        A target scatters paths at the distance ``target_radius_m`` from its centre; None: that of each row.
        """
        radius = batch.target_radius_m if target_radius_m is None else np.full(batch.dod_rad.shape, target_radius_m)
        scatter = np.zeros(batch.dod_rad.shape) if radius is None else 0.5 * np.nan_to_num(radius) ** 2
        return cls(
            batch.tx_xy_m[..., 0] - center_x[:, None],
            batch.tx_xy_m[..., 1] - center_y[:, None],
            batch.rx_xy_m[..., 0] - center_x[:, None],
            batch.rx_xy_m[..., 1] - center_y[:, None],
            *cosine_sine(batch.dod_rad),
            *cosine_sine(batch.doa_rad),
            batch.path_length_m,
            1.0 / batch.dod_std_rad,
            1.0 / batch.doa_std_rad,
            1.0 / batch.path_length_std_m,
            np.asfortranarray(scatter),
        )

    def residuals(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return measured minus predicted DOD, DOA (radians) and path length (metres), (B, K), at targets (B,)."""
        from_tx_x, from_tx_y = x[:, None] - self.tx_x, y[:, None] - self.tx_y
        from_rx_x, from_rx_y = x[:, None] - self.rx_x, y[:, None] - self.rx_y
        dod = angle_residual(self.dod_cosine, self.dod_sine, from_tx_x, from_tx_y)
        doa = angle_residual(self.doa_cosine, self.doa_sine, from_rx_x, from_rx_y)
        reach = np.sqrt(from_tx_x * from_tx_x + from_tx_y * from_tx_y)
        reach += np.sqrt(from_rx_x * from_rx_x + from_rx_y * from_rx_y)
        return dod, doa, self.path_length_m - reach

    def cost(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return half the chi-square (B,) at targets (B,)."""
        inverse_std = (self.inverse_dod_std, self.inverse_doa_std, self.inverse_length_std)
        scaled = [part * scale for part, scale in zip(self.residuals(x, y), inverse_std, strict=True)]
        return 0.5 * sum_measurements(scaled[0] ** 2 + scaled[1] ** 2 + scaled[2] ** 2)

    def chi_square(self, x: FloatArray, y: FloatArray, paths: BoolArray) -> FloatArray:
        """Return the chi-square (B,) of the residuals of some ``paths`` (B, K) at targets (B,)."""
        inverse_stds = (self.inverse_dod_std, self.inverse_doa_std, self.inverse_length_std)
        with ignoring_overflow():
            scaled = [part * inverse for part, inverse in zip(self.residuals(x, y), inverse_stds, strict=True)]
            return sum_measurements(np.where(paths, sum(part * part for part in scaled), 0.0))

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        """Return cost, gradient and the exact second derivatives, or Gauss-Newton's where those are not positive."""
        total = PathSums(x.shape)
        with ignoring_overflow():
            for k in range(self.tx_x.shape[1]):
                total.add_path(self, k, x, y)
            return total.evaluation()

    def information(self, x: FloatArray, y: FloatArray) -> SymmetricMatrix:
        """Return the Fisher information (B,) of targets (B,): the Gauss-Newton matrix there."""
        total = PathSums(x.shape)
        with ignoring_overflow():
            for k in range(self.tx_x.shape[1]):
                total.add_path(self, k, x, y)
        return total.gauss


def angle_residual(cosine: FloatArray, sine: FloatArray, dx: FloatArray, dy: FloatArray) -> FloatArray:
    """Return the angle from (dx, dy) to (cosine, sine)."""
    return np.arctan2(sine * dx - cosine * dy, cosine * dx + sine * dy)


class PathSums:
    """Sums over paths: chi-square (``cost``), gradient, Gauss-Newton matrix, and what curvature adds to that."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.cost, self.gradient_x, self.gradient_y = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        self.gauss, self.bend = SymmetricMatrix.full(shape, 0.0), SymmetricMatrix.full(shape, 0.0)

    def add_path(self, problem: TripletProblem, k: int, x: FloatArray, y: FloatArray) -> FloatArray:
        """Add path k of every snapshot; return the length (B,) of the direct path over the targets."""
        unit_tx = self._add_angle(
            x - problem.tx_x[:, k],
            y - problem.tx_y[:, k],
            problem.dod_cosine[:, k],
            problem.dod_sine[:, k],
            problem.inverse_dod_std[:, k],
        )
        unit_rx = self._add_angle(
            x - problem.rx_x[:, k],
            y - problem.rx_y[:, k],
            problem.doa_cosine[:, k],
            problem.doa_sine[:, k],
            problem.inverse_doa_std[:, k],
        )
        self._add_length(unit_tx, unit_rx, problem.path_length_m[:, k], problem.inverse_length_std[:, k])
        return unit_tx[0] + unit_rx[0]

    def _add_angle(
        self, dx: FloatArray, dy: FloatArray, cosine: FloatArray, sine: FloatArray, inverse_std: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Add an angle's residual; return distance, its inverse, and the unit vector to the target."""
        squared = dx * dx + dy * dy
        distance = np.sqrt(squared)
        inverse = 1.0 / distance
        scaled = angle_residual(cosine, sine, dx, dy) * inverse_std
        ux, uy = dx * inverse, dy * inverse
        slope = inverse_std * inverse
        slope_x, slope_y = uy * slope, -ux * slope
        self._add(scaled, slope_x, slope_y)
        curvature = scaled * slope * inverse
        both = 2.0 * ux * uy * curvature
        bend_xx, bend_xy, bend_yy = self.bend
        bend_xx -= both
        bend_yy += both
        bend_xy += (ux * ux - uy * uy) * curvature
        return distance, inverse, ux, uy

    def _add_length(
        self,
        unit_tx: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
        unit_rx: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
        path_length_m: FloatArray,
        inverse_std: FloatArray,
    ) -> None:
        scaled = (unit_tx[0] + unit_rx[0] - path_length_m) * inverse_std
        self._add(scaled, (unit_tx[2] + unit_rx[2]) * inverse_std, (unit_tx[3] + unit_rx[3]) * inverse_std)
        pull = scaled * inverse_std
        bend_xx, bend_xy, bend_yy = self.bend
        for _, inverse, ux, uy in (unit_tx, unit_rx):
            weight = pull * inverse
            bend_xx += weight * uy * uy
            bend_xy -= weight * ux * uy
            bend_yy += weight * ux * ux

    def _add(self, scaled: FloatArray, slope_x: FloatArray, slope_y: FloatArray) -> None:
        self.cost += scaled * scaled
        self.gradient_x += scaled * slope_x
        self.gradient_y += scaled * slope_y
        self.gauss += SymmetricMatrix.outer(slope_x, slope_y)

    def evaluation(self) -> Evaluation:
        """Return the evaluation, with a positive matrix of second derivatives."""
        gradient = (self.gradient_x, self.gradient_y)
        return Evaluation.of_newton(0.5 * self.cost, gradient, self.gauss + self.bend, self.gauss)
