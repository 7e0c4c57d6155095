"""Places on the earth in three dimensions: batches in local axes or earth-centred, and their solutions as places again.

Positions in tables are x, y of the local plane and the height above the ellipsoid; covariances are in local east, north
and up at the estimate. Distances and directions are solved in the axes east, north and up of one point, which are a
rigid motion of earth-centred coordinates. A measured height is z only straight above that point, so such snapshots are
solved again in the axes at their own estimates, until these stay: the error of z falls with the square of the step. At
first the height is as uncertain as the ground bends.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_invalid
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import SensorsField
from nlosctl.contract.results import Estimates, Solution, has_covariance
from nlosctl.contract.scene import EarthFrame
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError
from nlosctl.geometry.earth_centred import local_axes, to_earth_centred, to_geodetic
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.io.scenes.places import places
from nlosctl.io.scenes.scene_file import plane_of
from nlosctl.pipeline.solve.local_frames import LocalFrames, RowsOnEarth
from nlosctl.pipeline.solve.method_runs import BlockSolver

__all__ = ["placed_on_earth", "seen_from", "solver_on_earth"]

_NEAR_M = 1.0
"""An estimate this close to the point whose axes it was solved in has its height as z, to a tenth of a micrometre."""

_MOST_STEPS = 12
_VECTORS = (("cov_x_offset_m2", "cov_y_offset_m2", "cov_z_offset_m2"),)
"""Columns of estimates that are vectors."""


def solver_on_earth(solve: BlockSolver, frame: EarthFrame) -> BlockSolver:
    """Return a method that solves places on the ellipsoid; it raises UsageError for what has no meaning there."""

    def solve_places(batch: Any, row: IntArray) -> Solution:
        _refuse_planes(batch)
        rows = RowsOnEarth.of(batch, frame)
        if _is_geodesic(batch):
            solution = solve(rows.earth_centred(), row)
            axes = np.broadcast_to(np.eye(3), (batch.size, 3, 3))
            frames = LocalFrames(np.zeros((batch.size, 3)), axes).take(solution.estimates.row)
        else:
            solution, frames = _Placed(solve, rows, row).solution()
        return dataclasses.replace(solution, estimates=_as_places(solution.estimates, frames, batch, frame))

    return solve_places


def seen_from(batch: Any, frame: EarthFrame, position_m: FloatArray) -> tuple[Any, FloatArray]:
    """Return a batch in the axes east, north and up below positions (B, 3) on earth, and the positions in them.

    Azimuths alone, which are of geodesics, stay in the plane of the frame.
    """
    if _is_geodesic(batch):
        return batch, position_m
    _refuse_planes(batch)
    place = np.stack(to_earth_centred(*places(position_m[:, :2], frame), position_m[:, 2]), axis=1)
    frames = LocalFrames.below(place)
    return RowsOnEarth.of(batch, frame).seen_in(frames, np.arange(batch.size)), frames.local(place)


def placed_on_earth(batch: Any, frame: EarthFrame) -> Any:
    """Return a batch as methods solve it at first, for statistics; UsageError for measured heights beside elevations.

    Azimuths alone are earth-centred, all others in the axes below the middle of each snapshot's sensors.
    """
    _refuse_planes(batch)
    rows = RowsOnEarth.of(batch, frame)
    if _is_geodesic(batch):
        return rows.earth_centred()
    if batch.target_z_m is not None:
        raise UsageError("options can't be estimated from places on earth with measured heights; give their values")
    return rows.seen_in(LocalFrames.below(rows.middle_m()), np.arange(batch.size))


def _refuse_planes(batch: Any) -> None:
    """Raise UsageError for rows by reflectors and search regions in x and y, which have no meaning on earth."""
    if not isinstance(batch.field, SensorsField):
        raise UsageError(
            f"the search region {str(batch.field)!r} is in x and y, which places on earth in three dimensions do not "
            "have; set `field` to sensors:FACTOR, or `dimensions` to 2"
        )
    reflector = getattr(batch, "reflector", None)
    if reflector is not None and (reflector >= 0).any():
        raise UsageError(
            "reflectors have no model among places on earth in three dimensions; give x, y, z in metres, or set "
            "`dimensions` to 2"
        )


def _is_geodesic(batch: Any) -> bool:
    """Whether all that a batch has is azimuths: of geodesics on the ground."""
    return isinstance(batch, BearingBatch) and batch.elevation_rad is None


@dataclasses.dataclass(frozen=True)
class _Placed:
    """Solves the snapshots of ``rows``, with the chunk indices ``row`` (B, K), in axes at any points."""

    solve: BlockSolver
    rows: RowsOnEarth
    row: IntArray

    def solution(self) -> tuple[Solution, LocalFrames]:
        """Return the solution, and the frame of each of its estimates (E)."""
        every = np.arange(self.rows.batch.size)
        frames = LocalFrames.below(self.rows.middle_m())
        if self.rows.batch.target_z_m is None:
            solution = self._seen_in(frames, every)
            return solution, frames.take(solution.estimates.row)
        loose = dataclasses.replace(self, rows=self.rows.with_loose_height())
        solution = loose._seen_in(frames, every)
        best = _first(solution.estimates.row)
        frames, settled = self._settled(frames, every, frames.earth_centred(solution.estimates.position_m[best]))
        solution = self._seen_in(frames, every)
        return self._alternatives_settled(solution, frames, settled)

    def _seen_in(self, frames: LocalFrames, index: IntArray) -> Solution:
        return self.solve(self.rows.seen_in(frames, index), self.row[index])

    def _settled(self, frames: LocalFrames, index: IntArray, place_m: FloatArray) -> tuple[LocalFrames, BoolArray]:
        """Return the frames below the estimates, one for each place (N, 3) of the snapshots ``index``, that stay.

        Also which of them (N,) did, or have no place.
        """
        origin, axes, place_m = frames.origin_m.copy(), frames.axes.copy(), place_m.copy()
        moving = np.flatnonzero(np.isfinite(place_m[:, 0]))
        for _ in range(_MOST_STEPS):
            now = LocalFrames.below(place_m[moving])
            origin[moving], axes[moving] = now.origin_m, now.axes
            estimates = self._seen_in(now, index[moving]).estimates
            found = now.take(estimates.row).earth_centred(estimates.position_m)
            nearest = _nearest(estimates.row, found - place_m[moving][estimates.row])
            place_m[moving] = found[nearest]
            with ignoring_invalid():
                moving = moving[now.away_m(place_m[moving]) > _NEAR_M]
            if not moving.size:
                break
        settled = np.ones(index.shape, dtype=bool)
        settled[moving] = False
        return LocalFrames(origin, axes), settled

    def _alternatives_settled(
        self, solution: Solution, frames: LocalFrames, settled: BoolArray
    ) -> tuple[Solution, LocalFrames]:
        """Return the solution with each estimate that is not above the origin of its frame solved in its own."""
        estimates = solution.estimates
        own = frames.take(estimates.row)
        place = own.earth_centred(estimates.position_m)
        with ignoring_invalid():
            away = np.flatnonzero(settled[estimates.row] & (own.away_m(place) > _NEAR_M))
        stays = settled[estimates.row]
        if away.size:
            index = estimates.row[away]
            further, stays[away] = self._settled(own.take(away), index, place[away])
            other = self._seen_in(further, index).estimates
            nearest = _nearest(
                other.row, further.take(other.row).earth_centred(other.position_m) - place[away][other.row]
            )
            estimates = _with(estimates, away, other, nearest)
            stays[away] &= np.isfinite(other.covariance_m2[nearest, 0]) | ~has_covariance(estimates.status[away])
            own.origin_m[away], own.axes[away] = further.origin_m, further.axes
        return dataclasses.replace(solution, estimates=_without_answers(estimates, ~stays)), own


def _first(row: IntArray) -> IntArray:
    """Return the index of the first, the best, estimate of each snapshot."""
    return np.unique(row, return_index=True)[1]


def _nearest(row: IntArray, away_m: FloatArray) -> IntArray:
    """Return for each snapshot the index of the estimate that is the least ``away_m`` (E, 3); NaN is the farthest."""
    distance = np.nan_to_num(np.linalg.norm(away_m, axis=1), nan=np.inf)
    order = np.lexsort((distance, row))
    return order[_first(row[order])]


def _with(estimates: Estimates, index: IntArray, other: Estimates, other_index: IntArray) -> Estimates:
    """Return the estimates with the values of others at an index; numbers and statuses stay."""
    changed: dict[str, Any] = {}
    for name in ("position_m", "covariance_m2", "cost"):
        values = getattr(estimates, name).copy()
        values[index] = getattr(other, name)[other_index]
        changed[name] = values
    columns = {name: values.copy() for name, values in estimates.columns.items()}
    for name, values in columns.items():
        values[index] = other.columns[name][other_index]
    return dataclasses.replace(estimates, **changed, columns=columns)


def _without_answers(estimates: Estimates, lost: BoolArray) -> Estimates:
    """Return the estimates, those ``lost`` (E,) as not converged."""
    if not lost.any():
        return estimates
    status = np.where(lost, np.uint8(Status.NOT_CONVERGED), estimates.status)
    cleared: dict[str, Any] = {
        name: np.where(lost.reshape(-1, *[1] * (values.ndim - 1)), np.nan, values)
        for name in ("position_m", "covariance_m2", "cost", "chi_square")
        if (values := getattr(estimates, name)) is not None
    }
    columns = {name: np.where(lost, np.nan, values) for name, values in estimates.columns.items()}
    n_used = np.where(lost, 0, estimates.n_used)
    return dataclasses.replace(estimates, status=status, n_used=n_used, columns=columns, **cleared)


def _as_places(estimates: Estimates, frames: LocalFrames, batch: Any, frame: EarthFrame) -> Estimates:
    """Return estimates, each in a local frame, with x, y of the plane, heights, and covariances of the ground."""
    latitude, longitude, height = to_geodetic(*frames.earth_centred(estimates.position_m).T)
    x, y = plane_of(frame).to_plane(np.degrees(latitude), np.degrees(longitude))
    turn = np.einsum("eij,ekj->eik", local_axes(latitude, longitude), frames.axes)
    dense = SymmetricMatrix(*estimates.covariance_m2.T).dense()
    local = np.einsum("eij,ejk,elk->eil", turn, dense, turn)
    covariance = np.stack([local[:, i, j] for i in range(3) for j in range(i + 1)], axis=1)
    columns = dict(estimates.columns)
    for names in _VECTORS:
        if set(names) <= set(columns):
            vector = np.stack([columns[name] for name in names], axis=1)
            columns |= zip(names, np.einsum("eij,ej->ei", turn, vector).T, strict=True)
    if _is_geodesic(batch) or (batch.target_z_m is not None and batch.height_held):
        held, std = (0.0 if part is None else part[estimates.row] for part in (batch.target_z_m, batch.target_z_std_m))
        height = np.where(np.isnan(height), np.nan, held)
        covariance[:, 3:] = np.where(np.isnan(covariance[:, 3:]), np.nan, 0.0)
        covariance[:, 5] += std * std
    position = np.stack([x, y, height], axis=1)
    return dataclasses.replace(estimates, position_m=position, covariance_m2=covariance, columns=columns)
