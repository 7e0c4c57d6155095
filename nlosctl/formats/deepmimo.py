"""Paths of a DeepMIMO scenario, version 4: triplets via a target, or bearings of the base stations.

The matrices of a transmitter and a set of N receivers with P paths each are ``aoa_az`` and ``aod_az`` (N, P) in
degrees, counter-clockwise from +x, ``delay`` (N, P) in seconds (NaN: no path), ``inter`` (N, P) with a digit for each
interaction (0: line of sight), ``rx_pos`` (N, 3) and ``tx_pos`` (3). ``aoa_el`` and ``aod_el`` are angles
from +z, ``inter_pos`` (N, P, I, 3) the positions of the interactions. They are in one NPZ file under these names, or
in a scenario folder as DeepMIMO writes it: a file for each matrix, transmitter and set of receivers, such as
``delay_t001_tx000_r000.npz`` (or .mat).
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any, Literal

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row
from nlosctl.contract.options import option
from nlosctl.errors import DataError, UsageError
from nlosctl.formats.fields import listed
from nlosctl.formats.npz import numbers, read_npz
from nlosctl.formats.traced_paths import LIGHT_M_S, PathOptions, TracedPaths, check_direct, kept_arrays, rows_of_paths

__all__ = ["FORMAT"]

_NEEDED = ("aoa_az", "aod_az", "delay", "inter", "rx_pos", "tx_pos")
_OPTIONAL = ("aoa_el", "aod_el", "inter_pos")
_MATRIX = re.compile(r"(?P<name>[a-z_]+)_(?P<tx>t\d+_tx\d+)_(?P<rx>r\d+)")


@dataclass(frozen=True, kw_only=True)
class DeepMimoOptions(PathOptions):
    """Kind of measurements to make of the paths, and their standard deviations."""

    kind: Literal["triplets", "bearings"] = option(
        "triplets", meaning="triplets of the paths without line of sight, or bearings of the transmitters"
    )


def _rows(file: ForeignFile, options: DeepMimoOptions) -> Iterator[Row | BadLine]:
    keep = listed(options.keep)
    if "rx_pos" in keep:  # of the same shape as a matrix of three paths
        raise UsageError("importer 'deepmimo' keeps matrices with a value for each path, and 'rx_pos' is not one")
    pairs = _pairs(file, keep)
    if not pairs:
        raise DataError(f"{file.name}: no matrices of DeepMIMO 4, such as delay_t001_tx000_r000.npz")
    transmitters = {tx: index for index, tx in enumerate(dict.fromkeys(tx for tx, _ in pairs))}
    first_rx: dict[str, int] = {}
    links = count = 0
    for (tx, rx), arrays in pairs.items():
        paths = _paths(file, arrays, keep)
        if rx not in first_rx:
            first_rx[rx] = count
            count += paths.rx_m.shape[1]
        numbered = dataclasses.replace(paths, first_rx=first_rx[rx], first_tx=transmitters[tx], first_link=links)
        links += paths.rx_m.shape[1]
        check_direct(file, numbered, "aoa_az")
        yield from rows_of_paths(numbered, options.kind, options, "deepmimo")


def _pairs(file: ForeignFile, keep: Sequence[str]) -> dict[tuple[str, str], dict[str, Any]]:
    """Return the matrices of each transmitter and set of receivers, in the order of their names."""
    if not file.more and _MATRIX.fullmatch(PurePath(file.name).stem) is None:
        return {("", ""): read_npz(file, (*_NEEDED, *_OPTIONAL, *keep))}
    pairs: dict[tuple[str, str], dict[str, Any]] = {}
    for part in (file, *file.more):
        matrix = _MATRIX.fullmatch(PurePath(part.name).stem)
        if matrix is not None and matrix["name"] in (*_NEEDED, *_OPTIONAL, *keep):
            pairs.setdefault((matrix["tx"], matrix["rx"]), {})[matrix["name"]] = _matrix(part, matrix["name"])
    return dict(sorted(pairs.items()))


def _matrix(file: ForeignFile, name: str) -> Any:
    """Return the only array of a file of a scenario folder."""
    if PurePath(file.name).suffix == ".npz":
        found = read_npz(file)
    else:
        from scipy.io import loadmat  # only for such folders

        try:
            found = loadmat(file.stream)  # type: ignore[arg-type]
        except (ValueError, TypeError, OSError, NotImplementedError) as error:
            raise DataError(f"{file.name}: not a MAT file of version 5: {error}") from error
    if name not in found:
        names = ", ".join(key for key in found if not key.startswith("__")) or "none"
        raise DataError(f"{file.name}: got the arrays {names}, expected {name!r}")
    return found[name]


def _paths(file: ForeignFile, arrays: dict[str, Any], keep: Sequence[str]) -> TracedPaths:
    """Return the checked matrices of one transmitter."""
    for name in _NEEDED:
        if name not in arrays:
            raise DataError(
                f"{file.name}: no array {name!r}; got {', '.join(arrays) or 'none'}, expected {', '.join(_NEEDED)}"
            )
    delay_s = numbers(file, arrays, "delay")
    if delay_s.ndim != 2:
        raise DataError(f"{file.name}, array 'delay': got shape {delay_s.shape}, expected (receivers, paths)")
    shape = delay_s.shape
    aoa_az, aod_az, inter = (numbers(file, arrays, name, shape) for name in ("aoa_az", "aod_az", "inter"))
    rx_m = numbers(file, arrays, "rx_pos", (shape[0], 3)).T
    tx_m = numbers(file, arrays, "tx_pos")
    if tx_m.size != 3:
        raise DataError(f"{file.name}, array 'tx_pos': got shape {tx_m.shape}, expected one position (1, 3)")
    exists = np.isfinite(delay_s) & np.isfinite(aoa_az) & np.isfinite(aod_az) & (inter >= 0.0)
    return TracedPaths(
        length_m=np.where(exists, delay_s * LIGHT_M_S, np.nan)[:, None, :],
        phi_r=np.radians(aoa_az)[:, None, :],
        phi_t=np.radians(aod_az)[:, None, :],
        rx_m=rx_m,
        tx_m=tx_m.reshape(3, 1),
        bounces=_bounces(np.where(exists, inter, 0.0))[:, None, :],
        first_m=_first(file, arrays, shape),
        elevation_r=_elevation(file, arrays, "aoa_el", shape),
        elevation_t=_elevation(file, arrays, "aod_el", shape),
        kept={name: values[:, None, :] for name, values in kept_arrays(file, arrays, keep, shape).items()},
    )


def _elevation(file: ForeignFile, arrays: dict[str, Any], name: str, shape: tuple[int, ...]) -> FloatArray | None:
    """Return elevations above the horizontal of angles from +z, None without them."""
    return np.radians(90.0 - numbers(file, arrays, name, shape))[:, None, :] if name in arrays else None


def _bounces(inter: FloatArray) -> IntArray:
    """Return the number of interactions (N, P): the digits of their codes, 0 for line of sight."""
    digits = np.floor(np.log10(np.maximum(inter, 1.0))).astype(np.int64) + 1
    return np.where(inter == 0.0, 0, digits)


def _first(file: ForeignFile, arrays: dict[str, Any], shape: tuple[int, ...]) -> FloatArray | None:
    if "inter_pos" not in arrays:
        return None
    positions = numbers(file, arrays, "inter_pos")
    if positions.ndim != 4 or positions.shape[:2] != shape or positions.shape[3] != 3 or not positions.shape[2]:
        raise DataError(
            f"{file.name}, array 'inter_pos': got shape {positions.shape}, expected (receivers, paths, interactions, 3)"
        )
    return positions[:, None, :, 0, :]


FORMAT = ImporterSpec(
    name="deepmimo",
    summary="Paths of a DeepMIMO scenario, version 4 (one NPZ file or the scenario folder): triplets or bearings",
    reference="DeepMIMO 4, docs/resources/specs.md and conventions.md, deepmimo/consts.py (names, units, angles)",
    options=DeepMimoOptions,
    kind=lambda options: str(options.kind),
    rows=_rows,
    arrays=(_NEEDED,),
    several=True,
    extra={
        "interactions": "integer",
        "sensor_z_m": "number",
        "elevation_deg": "number",
        "tx_z_m": "number",
        "rx_z_m": "number",
        "dod_elevation_deg": "number",
        "doa_elevation_deg": "number",
    },
)
"""The specification of the importer."""
