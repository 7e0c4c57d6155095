"""Paths traced by Sionna RT, saved as arrays (NPZ) or rows (Parquet): bearings, or triplets via a target.

The arrays are those of ``sionna.rt.Paths`` with a synthetic array, shapes (receivers, transmitters, paths): ``tau`` (s,
-1 for no path), ``phi_r`` and ``phi_t`` (azimuths of arrival and departure, rad), ``interactions`` (depth, receivers,
transmitters, paths), and the positions ``targets`` (3, receivers), ``sources`` (3, transmitters). The truth of triplets
needs ``vertices`` (depth, receivers, transmitters, paths, 3). Pickled objects are not read.
"""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row
from nlosctl.contract.options import option
from nlosctl.errors import DataError, UsageError
from nlosctl.formats.sionna_table import arrays_of_table

__all__ = ["FORMAT"]

_LIGHT_M_S = 299_792_458.0
_LARGEST_BYTES = 4 << 30
_DIRECT_OFF_RAD = 0.02
_UNREADABLE = (zipfile.BadZipFile, zlib.error, EOFError, OSError, KeyError, NotImplementedError, RuntimeError)
"""Exceptions of damaged zip files, whose bytes may also look like encryption or an unknown compression method."""
_NEEDED = ("tau", "phi_r", "phi_t", "sources", "targets")


@dataclass(frozen=True, kw_only=True)
class SionnaOptions:
    """Kind of measurements to make of the paths, and their standard deviations."""

    kind: Literal["bearings", "triplets"] = option("bearings", meaning="bearings of the transmitters, or triplets")
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


@dataclass(frozen=True, kw_only=True)
class _Paths:
    """The checked arrays: lengths (R, T, P) in metres, NaN for no path."""

    length_m: FloatArray
    phi_r: FloatArray
    phi_t: FloatArray
    rx_m: FloatArray
    tx_m: FloatArray
    bounces: IntArray | None
    first_m: FloatArray | None


def _rows(file: ForeignFile, options: SionnaOptions) -> Iterator[Row | BadLine]:
    if options.kind == "bearings" and options.target is not None:
        raise UsageError("importer 'sionna' takes the parameter 'target' only with kind=triplets")
    paths = _read(file)
    _check_direct(file, paths)
    yield from _bearings(paths, options) if options.kind == "bearings" else _triplets(paths, options)


def _bearings(paths: _Paths, options: SionnaOptions) -> Iterator[Row]:
    """Yield the paths of each transmitter, shortest first, with the receivers as sensors."""
    receivers, transmitters, _ = paths.length_m.shape
    line = 0
    for tx in range(transmitters):
        for rx in range(receivers):
            for rank, path in enumerate(_by_length(paths.length_m[rx, tx])):
                line += 1
                bounces = None if paths.bounces is None else paths.bounces[rx, tx, path]
                values: dict[str, Any] = {
                    "snapshot": tx,
                    "sensor": f"rx{rx}",
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
                yield Row(line=line, values=values)


def _triplets(paths: _Paths, options: SionnaOptions) -> Iterator[Row]:
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
                    "snapshot": rx * transmitters + tx,
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
                yield Row(line=line, values=values)


def _target_truth(
    paths: _Paths, options: SionnaOptions, at: tuple[int, int, int], bounces: int | None
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


def _read(file: ForeignFile) -> _Paths:
    arrays = _arrays(file)
    for name in _NEEDED:
        if name not in arrays:
            raise DataError(
                f"{file.name}: no array {name!r}; got {', '.join(arrays) or 'none'}, expected {', '.join(_NEEDED)}"
            )
    tau = _numbers(file, arrays, "tau")
    if tau.ndim != 3:
        raise DataError(
            f"{file.name}, array 'tau': got shape {tau.shape}, expected (receivers, transmitters, paths); "
            f"trace with synthetic_array=True"
        )
    shape = tau.shape
    phi_r, phi_t = (_numbers(file, arrays, name, shape) for name in ("phi_r", "phi_t"))
    rx_m, tx_m = _numbers(file, arrays, "targets", (3, shape[0])), _numbers(file, arrays, "sources", (3, shape[1]))
    bounces, first_m = None, None
    if "interactions" in arrays:
        kinds = _numbers(file, arrays, "interactions")
        if kinds.shape[1:] != shape:
            raise DataError(f"{file.name}, array 'interactions': got shape {kinds.shape}, expected (depth, *tau.shape)")
        bounces = np.count_nonzero(kinds, axis=0).astype(np.int64)
        if "vertices" in arrays:
            first_m = _numbers(file, arrays, "vertices", (*kinds.shape, 3))[0]
    length_m = np.where(np.isfinite(tau) & (tau > 0.0), tau * _LIGHT_M_S, np.nan)
    return _Paths(length_m=length_m, phi_r=phi_r, phi_t=phi_t, rx_m=rx_m, tx_m=tx_m, bounces=bounces, first_m=first_m)


def _arrays(file: ForeignFile) -> dict[str, Any]:
    """Return the arrays of an NPZ file or a Parquet table; raise DataError for objects and excessive sizes."""
    head = file.stream.read(4)
    file.stream.seek(0)
    if head == b"PAR1":
        return arrays_of_table(file)
    try:
        with zipfile.ZipFile(file.stream) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > _LARGEST_BYTES:
            raise DataError(f"{file.name}: arrays of {size} bytes, expected at most {_LARGEST_BYTES}")
        file.stream.seek(0)
        with np.load(file.stream, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files if name in (*_NEEDED, "interactions", "vertices")}
    except _UNREADABLE as error:
        raise DataError(f"{file.name}: not a complete NPZ file: {error}") from error
    except ValueError as error:
        raise DataError(f"{file.name}: an array can't be read: {error}") from error


def _numbers(file: ForeignFile, arrays: dict[str, Any], name: str, shape: tuple[int, ...] | None = None) -> FloatArray:
    array = arrays[name]
    if array.dtype.kind not in "fiu" or (shape is not None and array.shape != shape):
        wanted = "numbers" if shape is None else f"numbers of shape {shape}"
        raise DataError(f"{file.name}, array {name!r}: got {array.dtype} of shape {array.shape}, expected {wanted}")
    return np.asarray(array, dtype=np.float64)


def _check_direct(file: ForeignFile, paths: _Paths) -> None:
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
            f"{file.name}, array 'phi_r': a line-of-sight path arrives {worst:.3g} deg off its transmitter, "
            f"expected the order (receivers, transmitters, paths) and angles in the scene's frame"
        )


FORMAT = ImporterSpec(
    name="sionna",
    summary="Paths traced by Sionna RT, saved as arrays (NPZ) or as a table (Parquet): bearings or triplets with truth",
    reference="Sionna RT documentation, class Paths: tau, phi_r, phi_t, interactions, vertices, sources, targets",
    options=SionnaOptions,
    kind=lambda options: str(options.kind),
    rows=_rows,
    arrays=(_NEEDED, ("rx", "tx", "tau", "phi_r", "phi_t")),
    extra={"interactions": "integer"},
)
"""The specification of the importer."""
