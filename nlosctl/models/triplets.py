"""Triplets as their paths: rows in their baseline frames, what a triplet should read for a target, residuals."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, ignoring_division, ignoring_invalid
from nlosctl.contract.batches import TripletBatch
from nlosctl.geometry.angles import wrap_angle
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.directions import Vector, cross, length, scaled, subtract
from nlosctl.geometry.ellipses import nearest_on_ellipse
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.geometry.triplets import BaselineFrame, Quantity, TripletRays, baseline_frames

__all__ = [
    "PathRows",
    "SpaceFrame",
    "SpacePaths",
    "distance_to_ellipse",
    "node_positions",
    "path_rows",
    "predict_triplets",
    "snapshot_centers",
]

DTypeT = TypeVar("DTypeT", bound=np.generic)


@dataclass(frozen=True)
class SpaceFrame:
    """The axes of the file about the midpoints ``center`` of baselines in space; all shapes alike, metres.

    ``axes`` are right-handed unit vectors, the first along the baseline; that of +x where a baseline has no length.
    """

    center: Vector
    axes: tuple[Vector, Vector, Vector]
    length_m: FloatArray

    def to_global(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return points about the midpoints in global coordinates."""
        return tuple(map(np.add, self.center, point))

    def matrix_to_global(self, matrix: SymmetricMatrix) -> SymmetricMatrix:
        """Return covariances in global axes: they are."""
        return matrix


def _space_frames(tx: Vector, rx: Vector) -> SpaceFrame:
    """Return the frames of baselines from transmitters to receivers, three arrays each."""
    along = subtract(rx, tx)
    size = length(along)
    apart = size > 0.0
    inverse = 1.0 / np.where(apart, size, 1.0)
    axis = (np.where(apart, along[0] * inverse, 1.0), along[1] * inverse, along[2] * inverse)
    # The axis of the file that is farthest from the baseline's leads to the second.
    steep = np.abs(axis[2]) > 0.7
    second = cross((np.where(steep, 1.0, 0.0), np.zeros_like(size), np.where(steep, 0.0, 1.0)), axis)
    second = scaled(second, 1.0 / length(second))
    center = tuple(0.5 * (a + b) for a, b in zip(tx, rx, strict=True))
    return SpaceFrame(center, (axis, second, cross(axis, second)), size)


@dataclass(frozen=True)
class _FlatRows:
    """The paths of a batch, flat (N,), each in a frame of its own; N = B K, the snapshot index varies fastest."""

    frame: BaselineFrame | SpaceFrame
    shape: tuple[int, int]

    def dense(self, flat: npt.NDArray[DTypeT]) -> npt.NDArray[DTypeT]:
        """Return an array (N,) as a block (B, K)."""
        return flat.reshape(self.shape, order="F")

    def dense_from(self, center: tuple[FloatArray, ...], *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return points (N,) of the frames as blocks (B, K) about centers (B,), in global axes."""
        position = self.frame.to_global(*point)
        return tuple(self.dense(part) - own[:, None] for part, own in zip(position, center, strict=True))


@dataclass(frozen=True)
class PathRows(_FlatRows):
    """Paths in the plane, each in its baseline frame."""

    frame: BaselineFrame
    rays: TripletRays
    dod_std_rad: FloatArray
    doa_std_rad: FloatArray
    path_length_std_m: FloatArray

    @property
    def path_length_m(self) -> FloatArray:
        """The path lengths (N,)."""
        return self.rays.path_length_m

    def weights_m(self, quantity: Quantity) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what one standard deviation of DOA, DOD and path length moves a quantity by, in metres."""
        return quantity.weights_m(self.doa_std_rad, self.dod_std_rad, self.path_length_std_m)


@dataclass(frozen=True)
class SpacePaths(_FlatRows):
    """Paths in space, in the axes of the file about the midpoint of each baseline.

    ``batch`` has N snapshots of a single path.
    """

    frame: SpaceFrame
    batch: TripletBatch

    @property
    def path_length_m(self) -> FloatArray:
        """The path lengths (N,)."""
        return self.batch.path_length_m[:, 0]

    @property
    def path_length_std_m(self) -> FloatArray:
        """Their standard deviations (N,)."""
        return self.batch.path_length_std_m[:, 0]


def paths_of(batch: TripletBatch) -> PathRows | SpacePaths:
    """Return the paths of a batch as flat rows, in the plane or in space."""
    if batch.dimension == 2:
        return path_rows(batch)
    single = _single_paths(batch)
    frame = _space_frames(*(tuple(part[:, 0] for part in node) for node in node_positions(single)))
    return SpacePaths(frame=frame, shape=(batch.size, batch.measurements), batch=single)


def path_rows(batch: TripletBatch) -> PathRows:
    """Return the paths of a batch in the plane as flat rows."""

    def flat(array: FloatArray) -> FloatArray:
        return array.reshape(-1, order="F")

    tx, rx = batch.tx_xy_m, batch.rx_xy_m
    frame = baseline_frames(flat(tx[..., 0]), flat(tx[..., 1]), flat(rx[..., 0]), flat(rx[..., 1]))
    return PathRows(
        frame=frame,
        rays=frame.rays(flat(batch.dod_rad), flat(batch.doa_rad), flat(batch.path_length_m)),
        dod_std_rad=flat(batch.dod_std_rad),
        doa_std_rad=flat(batch.doa_std_rad),
        path_length_std_m=flat(batch.path_length_std_m),
        shape=(batch.size, batch.measurements),
    )


def _single_paths(batch: TripletBatch) -> TripletBatch:
    """Return a batch (N, 1) with a snapshot for each path."""
    changed: dict[str, Any] = {}
    for field in fields(batch):
        array = getattr(batch, field.name)
        if isinstance(array, np.ndarray):
            flat = (batch.size * batch.measurements, 1, *array.shape[2:])
            changed[field.name] = (
                np.tile(array, batch.measurements) if array.ndim == 1 else array.reshape(flat, order="F")
            )
    return replace(batch, **changed)


def node_positions(batch: TripletBatch) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
    """Return the coordinates of transmitters and receivers, as D arrays (B, K) each."""
    nodes = ((batch.tx_xy_m, batch.tx_z_m), (batch.rx_xy_m, batch.rx_z_m))
    tx, rx = ((xy[..., 0], xy[..., 1], *(() if z is None else (z,))) for xy, z in nodes)
    return tx, rx


def predict_triplets(
    tx_xy_m: FloatArray, rx_xy_m: FloatArray, target_xy_m: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return noise-free DOD, DOA (radians, in (-pi, pi]) and path length (m) of direct paths over targets (..., 2)."""
    from_tx, from_rx = target_xy_m - tx_xy_m, target_xy_m - rx_xy_m
    dod = np.arctan2(from_tx[..., 1], from_tx[..., 0])
    doa = np.arctan2(from_rx[..., 1], from_rx[..., 0])
    length = np.hypot(from_tx[..., 0], from_tx[..., 1]) + np.hypot(from_rx[..., 0], from_rx[..., 1])
    return wrap_angle(dod), wrap_angle(doa), length


def distance_to_ellipse(rays: TripletRays) -> Quantity:
    """Return the distance of point 1, where the two lines cross, from the ellipse; positive outside.

    The decision variable of Shen, Molisch 2011 (reference [36] of the paper of 2012). NaN without an ellipse, and
    where the lines are parallel.
    """
    x, y = rays.coordinate(1, "x"), rays.coordinate(1, "y")
    length, half = rays.path_length_m, 0.5 * rays.baseline_m
    semi_major = np.where(rays.has_ellipse, 0.5 * length, np.nan)
    with ignoring_invalid():
        semi_minor = np.sqrt((semi_major - half) * (semi_major + half))
    foot_x, foot_y = nearest_on_ellipse(x.value_m, y.value_m, semi_major, semi_minor)
    # The gradient of the sum of the distances from the foci is the normal; the ellipse moves by 1 / its length.
    to_tx, to_rx = np.hypot(foot_x + half, foot_y), np.hypot(foot_x - half, foot_y)
    with ignoring_division():
        gradient_x = (foot_x + half) / to_tx + (foot_x - half) / to_rx
        gradient_y = foot_y / to_tx + foot_y / to_rx
        scale = 1.0 / np.hypot(gradient_x, gradient_y)
        normal_x, normal_y = gradient_x * scale, gradient_y * scale
        return Quantity(
            (x.value_m - foot_x) * normal_x + (y.value_m - foot_y) * normal_y,
            x.by_doa * normal_x + y.by_doa * normal_y,
            x.by_dod * normal_x + y.by_dod * normal_y,
            -scale,
        )


def snapshot_centers(batch: TripletBatch) -> tuple[FloatArray, ...]:
    """Return the mean (D arrays (B,)) of the transmitters and receivers of each snapshot, metres."""
    count = 2.0 * max(batch.measurements, 1)
    nodes = zip(*node_positions(batch), strict=True)
    return tuple((sum_measurements(tx) + sum_measurements(rx)) / count for tx, rx in nodes)
