"""Bearings as rays, in the plane or in space: what solvers ask of either."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, Self, TypeAlias

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.batches import Batch, BearingBatch
from nlosctl.errors import UsageError
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.measured_height import GroundHeight

__all__ = ["Crossing", "Expansion", "RayResiduals", "Sight", "bearing_lines", "has_geodesics", "linear_lines"]

Expansion: TypeAlias = tuple[FloatArray, tuple[FloatArray, ...], SymmetricMatrix, SymmetricMatrix | None]
"""Half the chi-square (B, C) of some rows at a point, its D derivatives, the Gauss-Newton matrices of the rows, and
what the second derivatives of their residuals add to these; None where that is left out."""


def has_geodesics(batch: Batch) -> bool:
    """Return whether all that a batch has is azimuths of geodesics on the earth."""
    if not isinstance(batch, BearingBatch):
        return False
    return batch.dimension == 3 and batch.sensor_frame is not None and batch.elevation_rad is None


def bearing_lines(batch: BearingBatch) -> Sight:
    """Return the rays of a batch: in the plane, in space, or the geodesics of azimuths alone on the earth."""
    if has_geodesics(batch):
        from nlosctl.models.space.geodesic_lines import geodesic_lines

        return geodesic_lines(batch)
    if batch.dimension == 3:
        from nlosctl.models.space.rays import space_lines

        return space_lines(batch)
    from nlosctl.models.bearings import sight_lines

    return sight_lines(batch)


def linear_lines(batch: BearingBatch) -> Sight:
    """Return the rays of a batch for a linear fit; raises UsageError for rows that no plane contains."""
    lines = bearing_lines(batch)
    if getattr(lines, "has_azimuth_alone", False):
        raise UsageError("a row by a sphere without an elevation has no plane for a linear fit; use the method ml")
    if isinstance(getattr(lines, "height", None), GroundHeight):
        raise UsageError("a height above a sphere has no plane for a linear fit; use the method ml")
    return lines


@dataclass(frozen=True)
class RayResiduals:
    """Points (B,) relative to their rays: unfolded distances in metres, whether behind any origin, chi-square.

    ``at_zenith`` is where a row's azimuth is no Gaussian angle any more, since the point is nearly above or below it;
    None in the plane.
    """

    nearest_m: FloatArray
    farthest_m: FloatArray
    behind: BoolArray
    chi_square: FloatArray
    at_zenith: BoolArray | None = None


@dataclass(frozen=True)
class Crossing:
    """Points (B,) relative to lines without direction.

    By how many standard deviations (B, M) each scalar's line or plane misses the point; the nearest and the farthest
    origin, and the least distance along a ray (B,), negative behind its origin, in metres.
    """

    missed: FloatArray
    nearest_m: FloatArray
    farthest_m: FloatArray
    along_m: FloatArray


class Sight(Protocol):
    """Rays of B snapshots about a local origin (B,) each, and M scalars of each snapshot.

    In the plane a scalar is a bearing, M = K; in space a row has an azimuth and perhaps an elevation, and a measured
    height is one more. Points are D arrays (B,) about the local origins: the unknowns. Every function of points has
    the keyword ``paths``, the result of `paths_from` for the same points, if already computed.
    """

    @property
    def center(self) -> tuple[FloatArray, ...]:
        """The local origins."""
        ...

    @property
    def unknowns(self) -> int:
        """The number of unknown coordinates, D."""
        ...

    @property
    def std(self) -> FloatArray:
        """The standard deviations (B, M) of the scalars: radians, of a height metres."""
        ...

    def with_std(self, std: FloatArray) -> Self:
        """Return the same rays with other standard deviations (B, M)."""
        ...

    def take(self, rows: IntArray) -> Self:
        """Return the rays of some snapshots."""
        ...

    def scalars(self) -> IntArray | int:
        """Return the number of measured scalars of each snapshot (B,)."""
        ...

    def normals(self, at: slice) -> tuple[FloatArray, ...]:
        """Return the unit normals (B, C) of the lines or planes of the scalars ``at``, an array for each axis."""
        ...

    def planes(self, at: slice, weight: FloatArray | None) -> tuple[tuple[FloatArray, ...], FloatArray]:
        """Return the normals and the offsets (B, C) of lines or planes along them, both times a weight (B, C)."""
        ...

    @property
    def absolute(self) -> Callable[..., tuple[FloatArray, ...]]:
        """Return points as coordinates in the frame, a height that is exactly known included."""
        ...

    def whole_covariance(self, covariance: SymmetricMatrix, *point: FloatArray) -> SymmetricMatrix:
        """Return the covariances of `absolute`: a height that is exactly known has variance 0."""
        ...

    @property
    def stansfield_width_m(self) -> Callable[..., FloatArray]:
        """Return by how many metres (B, M) the weights of Stansfield's fit let a line move per radian, at points."""
        ...

    @property
    def tube_width_m(self) -> Callable[..., FloatArray]:
        """Return by how many metres (B, M) a line moves per radian of its scalar at points."""
        ...

    @property
    def paths_from(self) -> Callable[..., Any]:
        """Return what the other functions of the same points share."""
        ...

    @property
    def ray_residuals(self) -> Callable[..., RayResiduals]:
        """Return distances and chi-square of points."""
        ...

    @property
    def residual(self) -> Callable[..., FloatArray]:
        """Return measured minus predicted scalars (B, M) at points."""
        ...

    @property
    def slopes(self) -> Callable[..., tuple[FloatArray, ...]]:
        """Return the derivatives (B, M) of the residuals over their stds, as D arrays.

        With the keyword ``extra_m2`` (B,) squared distances are that much larger.
        """
        ...

    @property
    def information(self) -> Callable[..., SymmetricMatrix]:
        """Return the Fisher information (B,) of points; ``extra_m2`` as in `slopes`."""
        ...

    @property
    def residuals(self) -> Callable[..., dict[str, FloatArray]]:
        """Return measured minus predicted values (B, K) of a batch at points, by the name of their flag column."""
        ...

    @property
    def crossing(self) -> Callable[..., Crossing]:
        """Return points relative to the lines without their directions."""
        ...

    @property
    def beside_nearest_origin(self) -> Callable[..., tuple[FloatArray, ...]]:
        """Return the points a share of the farthest distance along the ray whose origin is nearest to given points."""
        ...

    @property
    def inside_circles(self) -> Callable[..., tuple[FloatArray, ...]]:
        """Return points that are moved into the circle or sphere of a row where they are not inside."""
        ...

    @property
    def outside_scene(self) -> Callable[..., BoolArray]:
        """Return which points (B,) the scene rules out."""
        ...

    def all_under_horizon(self) -> BoolArray:
        """Return in which snapshots (B,) no wave can come from any measured direction."""
        ...

    def under_horizon(self) -> BoolArray:
        """Return which rows (B, K) have a direction from which no wave can come."""
        ...
