"""The likelihood of triplets as a batched least-squares problem with the coordinates of the target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.contract.batches import TripletBatch
from nlosctl.geometry.angles import cosine_sine
from nlosctl.geometry.blocks import RowBlock, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.triplets import PathRows, SpacePaths, node_positions
from nlosctl.solvers.optimization.problem import Evaluation
from nlosctl.solvers.triplets.legs import Node, leg_to, length_residual

__all__ = ["LEAST_SCALARS", "Height", "HeldTriplets", "PathSums", "TripletProblem", "level_part", "with_height"]


_HELD_STD_M = 1e-3

LEAST_SCALARS = 3
"""The scalars of a triplet without elevations: azimuths of departure and arrival, and path length."""


@dataclass(frozen=True)
class Height(RowBlock):
    """Measured heights (B,) of targets about local origins, and their inverse standard deviations: 0 without a height.

    ``held`` heights are exact, and x and y the only unknowns.
    """

    z_m: FloatArray
    inverse_std: FloatArray
    held: bool

    @classmethod
    def of(cls, z_m: FloatArray, std_m: FloatArray) -> Height:
        """Return heights (B,), NaN where nothing is known; all are held, or not one."""
        measured = np.isfinite(z_m) & (std_m > 0.0)
        inverse_std = np.where(measured, 1.0 / np.where(measured, std_m, 1.0), 0.0)
        return cls(np.nan_to_num(z_m), inverse_std, bool((std_m == 0.0).any()))

    @property
    def precision(self) -> FloatArray:
        """The inverse variances (B,) in 1/m2; of held heights that of a millimetre, for methods that free them."""
        return np.full(self.z_m.shape, _HELD_STD_M**-2) if self.held else self.inverse_std * self.inverse_std

    def cost(self, z: FloatArray) -> FloatArray:
        """Return half the chi-square (..., B) of heights (..., B) of targets."""
        away = z - self.z_m
        return np.asarray(0.5 * self.precision * away * away)

    def add_to(self, z: FloatArray, gradient: tuple[FloatArray, ...], information: SymmetricMatrix) -> None:
        """Add gradient and second derivatives of that, in place, to those of targets (..., B)."""
        gradient[2][...] += self.precision * (z - self.z_m)
        self.add_information(information)

    def add_information(self, information: SymmetricMatrix) -> None:
        """Add the information of heights, in place, to that of targets (..., B)."""
        information.diagonal[2][...] += self.precision


@dataclass(frozen=True)
class TripletProblem(RowBlock):
    """Half the chi-square of triplets (B, K), as a function of a target about a local origin (B,); metres.

    ``scatter_m2`` is the variance, by each coordinate, of the point at which an extended target scatters a path. It is
    no part of the chi-square of a point.
    """

    tx: Node
    rx: Node
    path_length_m: FloatArray
    inverse_length_std: FloatArray
    scatter_m2: FloatArray
    height: Height | None = None

    @classmethod
    def of_paths(cls, rows: PathRows | SpacePaths) -> TripletProblem:
        """Return a problem for every path by itself (N, 1), in the frame of its baseline."""
        if isinstance(rows, SpacePaths):
            return cls.of_snapshots(rows.batch, rows.frame.center)
        rays, half = rows.rays, 0.5 * rows.frame.length_m
        zero = np.zeros_like(half)

        def column(array: FloatArray) -> FloatArray:
            return np.asfortranarray(array[:, None])

        ends = (
            (-half, rays.dod_cosine, rays.dod_sine, 1.0 / rows.dod_std_rad),
            (half, rays.doa_cosine, rays.doa_sine, 1.0 / rows.doa_std_rad),
        )
        tx, rx = (Node((column(x), column(zero)), *map(column, direction)) for x, *direction in ends)
        return cls(tx, rx, column(rays.path_length_m), column(1.0 / rows.path_length_std_m), column(zero))

    @classmethod
    def of_snapshots(
        cls, batch: TripletBatch, center: tuple[FloatArray, ...], target_radius_m: float | None = 0.0
    ) -> TripletProblem:
        """Return a problem for every snapshot, all its paths over one target; global axes about centers (B,).

        A target scatters paths at the distance ``target_radius_m`` from its centre; None: that of each row.
        """
        radius = batch.target_radius_m if target_radius_m is None else np.full(batch.dod_rad.shape, target_radius_m)
        scatter = np.zeros(batch.dod_rad.shape) if radius is None else np.nan_to_num(radius) ** 2 / len(center)
        directions = (
            (batch.dod_rad, batch.dod_std_rad, batch.dod_elevation_rad, batch.dod_elevation_std_rad),
            (batch.doa_rad, batch.doa_std_rad, batch.doa_elevation_rad, batch.doa_elevation_std_rad),
        )
        tx, rx = (
            Node(
                tuple(part - own[:, None] for part, own in zip(position, center, strict=True)),
                *cosine_sine(azimuth),
                1.0 / std,
                *(_elevations(azimuth.shape, *elevation) if batch.dimension == 3 else ()),
            )
            for position, (azimuth, std, *elevation) in zip(node_positions(batch), directions, strict=True)
        )
        height = None
        if batch.target_z_m is not None and batch.target_z_std_m is not None:
            height = Height.of(batch.target_z_m - center[2], batch.target_z_std_m)
        length = (batch.path_length_m, 1.0 / batch.path_length_std_m)
        return cls(tx, rx, *length, np.asfortranarray(scatter), height)

    @property
    def dimension(self) -> int:
        """The number of coordinates of a target."""
        return len(self.tx.position)

    @property
    def paths(self) -> int:
        """The number of paths of each snapshot, K."""
        return int(self.path_length_m.shape[1])

    @property
    def held(self) -> Height | None:
        """The heights of the targets, if they are exact."""
        return self.height if self.height is not None and self.height.held else None

    def scalars(self) -> IntArray:
        """Return the number of scalars (B, K) that each path measures: directions and path length."""
        count = np.full(self.path_length_m.shape, LEAST_SCALARS)
        for node in (self.tx, self.rx):
            count += node.has_elevation
        return count

    def degrees_of_freedom(self, paths: BoolArray) -> IntArray:
        """Return the scalars of some ``paths`` (..., B, K), and of the height, minus the unknowns."""
        spare = np.where(paths, self.scalars(), 0).sum(axis=-1) - self.dimension
        if self.height is not None:
            spare = spare + (1 if self.height.held else (self.height.inverse_std > 0.0))
        return np.asarray(spare, dtype=np.int64)

    def covariance(self, *point: FloatArray) -> SymmetricMatrix:
        """Return the inverse Fisher information (B,) of targets; zero in z where that is held."""
        information = self.information(*point)
        return information.inverse() if self.held is None else with_height(level_part(information).inverse())

    def residuals(self, *point: FloatArray) -> dict[str, FloatArray]:
        """Return measured minus predicted angles (radians) and path length (metres), (B, K), at targets (B,).

        They have the names of the flags; elevations are there in space only, NaN in rows without them.
        """
        dod, dod_elevation, from_tx = self.tx.residuals(*point)
        doa, doa_elevation, from_rx = self.rx.residuals(*point)
        from_tx += from_rx
        found = {
            "residual_dod_rad": dod,
            "residual_doa_rad": doa,
            "residual_m": self.path_length_m - from_tx,
            "residual_dod_elevation_rad": dod_elevation,
            "residual_doa_elevation_rad": doa_elevation,
        }
        return {name: part for name, part in found.items() if part is not None}

    def squares(self, *point: FloatArray) -> FloatArray:
        """Return the chi-square (B, K) of each path at targets (B,)."""
        dod, dod_elevation, from_tx = self.tx.residuals(*point)
        doa, doa_elevation, from_rx = self.rx.residuals(*point)
        from_tx += from_rx
        total = (dod * self.tx.inverse_std) ** 2 + (doa * self.rx.inverse_std) ** 2
        total += ((self.path_length_m - from_tx) * self.inverse_length_std) ** 2
        for node, elevation in ((self.tx, dod_elevation), (self.rx, doa_elevation)):
            if elevation is not None:
                total += (np.nan_to_num(elevation) * np.asarray(node.inverse_elevation_std)) ** 2
        return total

    def cost(self, *point: FloatArray) -> FloatArray:
        """Return half the chi-square (B,) at targets (B,)."""
        chi_square = sum_measurements(self.squares(*point))
        if self.height is not None:
            chi_square += ((point[2] - self.height.z_m) * self.height.inverse_std) ** 2
        return 0.5 * chi_square

    def chi_square(self, point: tuple[FloatArray, ...], paths: BoolArray) -> FloatArray:
        """Return the chi-square (B,) of the residuals of some ``paths`` (B, K) at targets (B,)."""
        with ignoring_overflow():
            return sum_measurements(np.where(paths, self.squares(*point), 0.0))

    def evaluate(self, *point: FloatArray) -> Evaluation:
        """Return cost, gradient and the exact second derivatives, or Gauss-Newton's where those are not positive."""
        return self.sums(*point).evaluation()

    def information(self, *point: FloatArray) -> SymmetricMatrix:
        """Return the Fisher information (B,) of targets (B,): the Gauss-Newton matrix there."""
        return self.sums(*point).gauss

    def sums(self, *point: FloatArray) -> PathSums:
        """Return the sums over all paths, and the height, at targets (B,)."""
        total = PathSums(point[0].shape, len(point))
        with ignoring_overflow():
            for k in range(self.paths):
                total.add_path(self, k, *point)
            if self.height is not None:
                total.add_height(self.height, point[2])
        return total


def _elevations(
    shape: tuple[int, ...], elevation_rad: FloatArray | None, std_rad: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return elevations and inverse standard deviations (B, K), 0 in rows without."""
    if elevation_rad is None or std_rad is None:
        return np.zeros(shape, order="F"), np.zeros(shape, order="F")
    measured = np.isfinite(elevation_rad)
    return np.where(measured, elevation_rad, 0.0), np.where(measured, 1.0 / np.where(measured, std_rad, 1.0), 0.0)


def level_part(matrix: SymmetricMatrix) -> SymmetricMatrix:
    """Return the matrices of x and y alone."""
    return SymmetricMatrix(*matrix.parts[:3])


def with_height(matrix: SymmetricMatrix) -> SymmetricMatrix:
    """Return matrices of x and y with a row of zeros for z."""
    return SymmetricMatrix(*matrix.parts, *(np.zeros(matrix.xx.shape) for _ in range(3)))


@dataclass(frozen=True)
class HeldTriplets(RowBlock):
    """Triplets whose targets have exact heights, as a function of x and y (B,)."""

    space: TripletProblem
    z_m: FloatArray

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        """Return the evaluation at x, y: that in space, without z."""
        sums = self.space.sums(x, y, self.z_m)
        gauss, bend = level_part(sums.gauss), level_part(sums.bend)
        with ignoring_overflow():
            return Evaluation.of_newton(0.5 * sums.cost, sums.gradient[:2], gauss + bend, gauss)


class PathSums:
    """Sums over paths: chi-square (``cost``), gradient, Gauss-Newton matrix, and what curvature adds to that."""

    def __init__(self, shape: tuple[int, ...], dimension: int = 2) -> None:
        self.cost, self.gradient = np.zeros(shape), tuple(np.zeros(shape) for _ in range(dimension))
        self.gauss = SymmetricMatrix.full(shape, 0.0, dimension)
        self.bend = SymmetricMatrix.full(shape, 0.0, dimension)

    def add_path(self, problem: TripletProblem, k: int, *point: FloatArray) -> None:
        """Add path k of every snapshot."""
        legs = [leg_to(node, k, *point) for node in (problem.tx, problem.rx)]
        for leg in legs:
            for angle in (leg.azimuth, leg.elevation):
                if angle is not None:
                    self._add(angle.value, angle.slope)
            leg.add_angle_bend(self.bend)
        inverse_std = problem.inverse_length_std[:, k]
        length = length_residual(legs, problem.path_length_m[:, k], inverse_std)
        self._add(length.value, length.slope)
        for leg in legs:
            leg.add_length_bend(self.bend, length.value * inverse_std)

    def add_height(self, height: Height, z: FloatArray) -> None:
        """Add a measured height of every snapshot."""
        zero = np.zeros_like(z)
        self._add((z - height.z_m) * height.inverse_std, (zero, zero, height.inverse_std))

    def _add(self, value: FloatArray, slope: tuple[FloatArray, ...]) -> None:
        self.cost += value * value
        for total, part in zip(self.gradient, slope, strict=True):
            total += value * part
        self.gauss += SymmetricMatrix.outer(*slope)

    def evaluation(self) -> Evaluation:
        """Return the evaluation, with a positive matrix of second derivatives."""
        with ignoring_overflow():
            return Evaluation.of_newton(0.5 * self.cost, self.gradient, self.gauss + self.bend, self.gauss)
