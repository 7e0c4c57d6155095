"""Traced paths between receivers and transmitters: as bearings of the transmitters, or as triplets via a target."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.formats import ForeignFile, Row
from nlosctl.contract.options import option
from nlosctl.errors import DataError, UsageError, did_you_mean

__all__ = ["LIGHT_M_S", "PathOptions", "TracedPaths", "check_direct", "kept_arrays", "rows_of_paths"]

LIGHT_M_S = 299_792_458.0
_DIRECT_OFF_RAD = 0.02


@dataclass(frozen=True, kw_only=True)
class PathOptions:
    """What to make of the paths, apart from the kind, and their standard deviations."""

    target: tuple[float, float] | None = option(None, meaning="x,y of the target of the triplets", unit="m")
    target_radius_m: float = option(
        0.5, meaning="a single interaction within this distance is on the target", unit="m", minimum=0.0
    )
    bearing_std_deg: float | None = option(
        None, meaning="standard deviation of every direction", unit="deg", minimum=0.0, exclusive=True
    )
    range_std_m: float | None = option(
        None, meaning="standard deviation of every length", unit="m", minimum=0.0, exclusive=True
    )
    keep: str | None = option(
        None, meaning="further arrays or columns with a value for each path to copy as text, separated by commas"
    )


@dataclass(frozen=True, kw_only=True)
class TracedPaths:
    """The checked arrays of R receivers, T transmitters and P paths.

    ``length_m`` (R, T, P) is NaN for no path, ``phi_r`` and ``phi_t`` (R, T, P) are the azimuths of arrival and
    departure in radians, ``rx_m`` (3, R) and ``tx_m`` (3, T) positions. ``bounces`` (R, T, P) counts the interactions
    and ``first_m`` (R, T, P, 3) is the first of them, None if unknown; so are the elevations ``elevation_r`` and
    ``elevation_t`` (R, T, P) in radians. ``kept`` are further arrays (R, T, P) by name. Receivers, transmitters and
    their links are numbered from ``first_rx``, ``first_tx`` and ``first_link``.
    """

    length_m: FloatArray
    phi_r: FloatArray
    phi_t: FloatArray
    rx_m: FloatArray
    tx_m: FloatArray
    bounces: IntArray | None
    first_m: FloatArray | None
    elevation_r: FloatArray | None = None
    elevation_t: FloatArray | None = None
    kept: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)
    first_rx: int = 0
    first_tx: int = 0
    first_link: int = 0

    def kept_at(self, receiver: int, transmitter: int, path: int) -> dict[str, str | None]:
        """Return the values of a path in the further arrays as text, None for NaN or none."""
        return {name: _text(values[receiver, transmitter, path]) for name, values in self.kept.items()}


def kept_arrays(
    file: ForeignFile, arrays: Mapping[str, Any], names: Sequence[str], shape: tuple[int, ...]
) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays to keep; raises DataError for one that is absent or has not a value for each path."""
    for name in names:
        if name not in arrays:
            raise DataError(f"{file.name}: no array {name!r}{did_you_mean(name, arrays)}; got {', '.join(arrays)}")
        found = arrays[name].shape
        if found != shape:
            raise DataError(f"{file.name}, array {name!r}: got shape {found}, expected a value for each path: {shape}")
    return {name: arrays[name] for name in names}


def _text(value: Any) -> str | None:
    return None if value is None or value != value else str(value)


def rows_of_paths(paths: TracedPaths, kind: str, options: PathOptions, importer: str) -> Iterator[Row]:
    """Yield the paths as ``bearings`` or ``triplets``; raise UsageError for a target of bearings."""
    if kind == "bearings" and options.target is not None:
        raise UsageError(f"importer {importer!r} takes the parameter 'target' only with kind=triplets")
    yield from _bearings(paths, options) if kind == "bearings" else _triplets(paths, options)


def _bearings(paths: TracedPaths, options: PathOptions) -> Iterator[Row]:
    """Yield the paths of each transmitter, shortest first, with the receivers as sensors."""
    receivers, transmitters, _ = paths.length_m.shape
    line = 0
    for tx in range(transmitters):
        for rx in range(receivers):
            for rank, path in enumerate(_by_length(paths.length_m[rx, tx])):
                line += 1
                bounces = None if paths.bounces is None else paths.bounces[rx, tx, path]
                values: dict[str, Any] = {
                    "snapshot": paths.first_tx + tx,
                    "sensor": f"rx{paths.first_rx + rx}",
                    "path": rank,
                    "sensor_x_m": paths.rx_m[0, rx],
                    "sensor_y_m": paths.rx_m[1, rx],
                    "bearing_rad": _wrapped(paths.phi_r[rx, tx, path]),
                    "bearing_std_deg": options.bearing_std_deg,
                    "range_m": paths.length_m[rx, tx, path],
                    "range_std_m": options.range_std_m,
                    "truth_x_m": paths.tx_m[0, tx],
                    "truth_y_m": paths.tx_m[1, tx],
                    "truth_los": None if bounces is None else bool(bounces == 0),
                    "interactions": None if bounces is None else int(bounces),
                }
                if paths.elevation_r is not None:
                    values["sensor_z_m"] = paths.rx_m[2, rx]
                    values["elevation_deg"] = math.degrees(paths.elevation_r[rx, tx, path])
                yield Row(line=line, values=values, kept=paths.kept_at(rx, tx, path))


def _triplets(paths: TracedPaths, options: PathOptions) -> Iterator[Row]:
    """Yield a snapshot of triplets per receiver and transmitter: all paths except the line of sight."""
    receivers, transmitters, _ = paths.length_m.shape
    line = 0
    for rx in range(receivers):
        for tx in range(transmitters):
            for rank, path in enumerate(_by_length(paths.length_m[rx, tx])):
                line += 1
                bounces = None if paths.bounces is None else int(paths.bounces[rx, tx, path])
                if bounces == 0:
                    continue
                values: dict[str, Any] = {
                    "snapshot": paths.first_link + rx * transmitters + tx,
                    "path": rank,
                    "tx_x_m": paths.tx_m[0, tx],
                    "tx_y_m": paths.tx_m[1, tx],
                    "rx_x_m": paths.rx_m[0, rx],
                    "rx_y_m": paths.rx_m[1, rx],
                    "dod_rad": _wrapped(paths.phi_t[rx, tx, path]),
                    "doa_rad": _wrapped(paths.phi_r[rx, tx, path]),
                    "path_length_m": paths.length_m[rx, tx, path],
                    "dod_std_deg": options.bearing_std_deg,
                    "doa_std_deg": options.bearing_std_deg,
                    "path_length_std_m": options.range_std_m,
                    "interactions": bounces,
                    **_target_truth(paths, options, (rx, tx, path), bounces),
                }
                if paths.elevation_r is not None and paths.elevation_t is not None:
                    values |= {"tx_z_m": paths.tx_m[2, tx], "rx_z_m": paths.rx_m[2, rx]}
                    values["dod_elevation_deg"] = math.degrees(paths.elevation_t[rx, tx, path])
                    values["doa_elevation_deg"] = math.degrees(paths.elevation_r[rx, tx, path])
                yield Row(line=line, values=values, kept=paths.kept_at(rx, tx, path))


def _target_truth(
    paths: TracedPaths, options: PathOptions, at: tuple[int, int, int], bounces: int | None
) -> dict[str, Any]:
    if options.target is None:
        return {}
    truth: dict[str, Any] = {"truth_x_m": options.target[0], "truth_y_m": options.target[1]}
    if bounces is not None and paths.first_m is not None:
        where = paths.first_m[at]
        near = math.hypot(where[0] - options.target[0], where[1] - options.target[1]) <= options.target_radius_m
        truth["truth_ip"] = not (bounces == 1 and near)
    return truth


def _by_length(length_m: FloatArray) -> list[int]:
    existing = np.flatnonzero(np.isfinite(length_m))
    ranked: list[int] = existing[np.argsort(length_m[existing], kind="stable")].tolist()
    return ranked


def _wrapped(angle: float) -> float:
    return math.remainder(float(angle), 2.0 * math.pi)


def check_direct(file: ForeignFile, paths: TracedPaths, array: str) -> None:
    """Raise DataError if line-of-sight paths do not arrive from the direction of their transmitter."""
    if paths.bounces is None:
        return
    direct = np.isfinite(paths.length_m) & (paths.bounces == 0)
    dx = paths.tx_m[0][None, :] - paths.rx_m[0][:, None]
    dy = paths.tx_m[1][None, :] - paths.rx_m[1][:, None]
    off = np.abs(np.angle(np.exp(1j * (paths.phi_r - np.arctan2(dy, dx)[:, :, None]))))
    level = np.hypot(dx, dy)[:, :, None] > 0.01 * np.nan_to_num(paths.length_m)
    if (direct & level & (off > _DIRECT_OFF_RAD)).any():
        worst = np.degrees(off[direct & level].max())
        raise DataError(
            f"{file.name}, array {array!r}: a line-of-sight path arrives {worst:.3g} deg off its transmitter, "
            f"expected the order (receivers, transmitters, paths) and angles in the scene's frame"
        )
