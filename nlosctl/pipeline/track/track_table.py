"""The table of a track's states: a row per snapshot, with the columns of estimates and the velocity."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.scene import EarthFrame
from nlosctl.contract.statuses import Status
from nlosctl.contract.tables import PART, TRACK, VELOCITY
from nlosctl.io.results.layouts import OF_SPACE, ChunkEstimates
from nlosctl.io.scenes.scene_file import plane_of
from nlosctl.pipeline.track.track_options import TrackOptions
from nlosctl.solvers.tracking.acceleration import DensityEstimate

__all__ = ["SnapshotStates", "counted", "density_note", "optional_columns", "track_estimates", "with_tracks"]

_ON_EARTH = ("lat_deg", "lon_deg", "frame")


@dataclass(frozen=True)
class SnapshotStates:
    """The states of S snapshots: ``position_m`` (S, D), ``velocity_m_s`` (S, D), their covariances (S, D, D).

    ``known`` (S,) and ``moving`` (S,) mark known positions and velocities, ``settled`` (S,) tracks whose search ended.
    """

    position_m: FloatArray
    velocity_m_s: FloatArray
    position_covariance: FloatArray
    velocity_covariance: FloatArray
    known: BoolArray
    moving: BoolArray
    settled: BoolArray
    part: IntArray

    @classmethod
    def of(
        cls,
        states: FloatArray,
        covariance: FloatArray,
        origin_m: FloatArray,
        known: BoolArray,
        moving: BoolArray,
        settled: BoolArray,
        part: IntArray,
    ) -> SnapshotStates:
        """Return the parts of states (S, 2D) about origins (S, D), and of their covariances (S, 2D, 2D)."""
        d = states.shape[1] // 2
        return cls(
            states[:, :d] + origin_m,
            states[:, d:],
            covariance[:, :d, :d],
            covariance[:, d:, d:],
            known,
            moving,
            settled,
            part,
        )

    @property
    def status(self) -> npt.NDArray[np.uint8]:
        """The status (S,) of each snapshot."""
        status = np.where(self.known, Status.OK, Status.DEGENERATE).astype(np.uint8)
        status[self.known & ~self.settled] = Status.NOT_CONVERGED
        return status


def optional_columns(dimension: int, options: TrackOptions, frame: EarthFrame | None) -> frozenset[str]:
    """Return the optional columns of the estimates that a track has."""
    names = {"time_s", "covariance_kind"} | {
        column.name for column in VELOCITY if dimension == 3 or not column.of_space
    }
    names |= set(OF_SPACE) if dimension == 3 else set()
    names |= set(_ON_EARTH) if frame is not None else set()
    names |= set() if options.association is None else {TRACK.name}
    return frozenset(names if np.isinf(options.gap_s) else names | {PART.name})


def track_estimates(
    found: SnapshotStates,
    time_s: FloatArray,
    n_measurements: IntArray,
    n_used: IntArray,
    cost: FloatArray,
    options: TrackOptions,
    frame: EarthFrame | None,
    method: IntArray | None = None,
    target: IntArray | None = None,
) -> ChunkEstimates:
    """Return the estimates of S snapshots, whose row and snapshot have the same index."""
    size, dimension = found.position_m.shape
    status = found.status
    given = np.isin(status, (Status.OK,))
    pairs = [(one, other) for one in range(dimension) for other in range(one + 1)]

    def known(values: FloatArray, which: BoolArray) -> FloatArray:
        return np.where(which.reshape(-1, *[1] * (values.ndim - 1)), values, np.nan)

    position = known(found.position_m, given)
    columns: dict[str, FloatArray] = {"time_s": time_s, PART.name: found.part.astype(np.float64)}
    moving = given & found.moving
    names = [column.name for column in VELOCITY]
    columns |= dict(zip(names[:3], known(found.velocity_m_s, moving).T, strict=False))
    columns |= dict(zip(names[3:], (known(found.velocity_covariance[:, i, j], moving) for i, j in pairs), strict=False))
    if frame is not None:
        lat, lon = plane_of(frame).to_earth(position[:, 0], position[:, 1])
        columns |= {"lat_deg": lat, "lon_deg": lon}
    kind = np.full(size, None, dtype=object)
    kind[given] = options.covariance_kind
    nothing = np.zeros(size, dtype=np.int64)
    return ChunkEstimates(
        snapshot=np.arange(size),
        measurement=np.full(size, -1, dtype=np.int64),
        method=nothing if method is None else method,
        target=nothing if target is None else target,
        alternative=nothing,
        position_m=position,
        covariance_m2=known(np.stack([found.position_covariance[:, i, j] for i, j in pairs], axis=1), given),
        n_measurements=n_measurements,
        n_used=np.where(given, n_used, 0),
        cost=known(cost, given),
        fit_p_value=np.full(size, np.nan),
        search_failure=np.full(size, np.nan),
        status=status,
        covariance_kind=kind,
        on_edge=np.zeros(size, dtype=bool),
        columns=columns,
    )


def with_tracks(estimates: ChunkEstimates, track: IntArray) -> ChunkEstimates:
    """Return the estimates with the track (S,) of each; -1 for one without a position, which is then no target."""
    alone = track < 0
    column = np.where(alone, np.nan, track.astype(np.float64))
    status = np.where(alone, np.uint8(Status.NO_TARGET), estimates.status)
    return dataclasses.replace(estimates, status=status, columns={**estimates.columns, TRACK.name: column})


def counted(count: int, what: str) -> str:
    """Return a number of things as text."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def density_note(found: DensityEstimate, estimated: bool, tracks: int, parts: int) -> str:
    """Return the note on the motion of a run of so many tracks, split by gaps into ``parts``."""
    how = "estimated" if estimated else "as given"
    flat = "" if found.is_maximum else ": the likelihood is flat towards 0, so that the paths may be straight"
    more = f", {counted(parts, 'part')} by gaps" if parts > tracks else ""
    return f"{counted(tracks, 'track')}{more}; acceleration_psd {found.density:.4g} m2/s3, {how}{flat}"
