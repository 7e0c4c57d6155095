"""Paths traced by Sionna RT, saved as arrays (NPZ) or rows (Parquet): bearings, or triplets via a target.

The arrays are those of ``sionna.rt.Paths`` with a synthetic array, shapes (receivers, transmitters, paths): ``tau`` (s,
-1 for no path), ``phi_r`` and ``phi_t`` (azimuths of arrival and departure, rad), ``interactions`` (depth, receivers,
transmitters, paths), and the positions ``targets`` (3, receivers), ``sources`` (3, transmitters). The truth of triplets
needs ``vertices`` (depth, receivers, transmitters, paths, 3). Pickled objects are not read.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row
from nlosctl.contract.options import option
from nlosctl.errors import DataError
from nlosctl.formats.fields import listed
from nlosctl.formats.npz import numbers, read_npz
from nlosctl.formats.sionna_table import arrays_of_table
from nlosctl.formats.traced_paths import LIGHT_M_S, PathOptions, TracedPaths, check_direct, kept_arrays, rows_of_paths

__all__ = ["FORMAT"]

_NEEDED = ("tau", "phi_r", "phi_t", "sources", "targets")


@dataclass(frozen=True, kw_only=True)
class SionnaOptions(PathOptions):
    """Kind of measurements to make of the paths, and their standard deviations."""

    kind: Literal["bearings", "triplets"] = option("bearings", meaning="bearings of the transmitters, or triplets")


def _rows(file: ForeignFile, options: SionnaOptions) -> Iterator[Row | BadLine]:
    paths = _read(file, listed(options.keep))
    check_direct(file, paths, "phi_r")
    yield from rows_of_paths(paths, options.kind, options, "sionna")


def _read(file: ForeignFile, keep: Sequence[str]) -> TracedPaths:
    arrays = _arrays(file, keep)
    for name in _NEEDED:
        if name not in arrays:
            raise DataError(
                f"{file.name}: no array {name!r}; got {', '.join(arrays) or 'none'}, expected {', '.join(_NEEDED)}"
            )
    tau = numbers(file, arrays, "tau")
    if tau.ndim != 3:
        raise DataError(
            f"{file.name}, array 'tau': got shape {tau.shape}, expected (receivers, transmitters, paths); "
            f"trace with synthetic_array=True"
        )
    shape = tau.shape
    phi_r, phi_t = (numbers(file, arrays, name, shape) for name in ("phi_r", "phi_t"))
    rx_m, tx_m = numbers(file, arrays, "targets", (3, shape[0])), numbers(file, arrays, "sources", (3, shape[1]))
    bounces, first_m = None, None
    if "interactions" in arrays:
        kinds = numbers(file, arrays, "interactions")
        if kinds.shape[1:] != shape:
            raise DataError(f"{file.name}, array 'interactions': got shape {kinds.shape}, expected (depth, *tau.shape)")
        bounces = np.count_nonzero(kinds, axis=0).astype(np.int64)
        if "vertices" in arrays:
            first_m = numbers(file, arrays, "vertices", (*kinds.shape, 3))[0]
    length_m = np.where(np.isfinite(tau) & (tau > 0.0), tau * LIGHT_M_S, np.nan)
    return TracedPaths(
        length_m=length_m,
        phi_r=phi_r,
        phi_t=phi_t,
        rx_m=rx_m,
        tx_m=tx_m,
        bounces=bounces,
        first_m=first_m,
        kept=kept_arrays(file, arrays, keep, shape),
    )


def _arrays(file: ForeignFile, keep: Sequence[str]) -> dict[str, Any]:
    """Return the arrays of an NPZ file or a Parquet table; raise DataError for objects and excessive sizes."""
    head = file.stream.read(4)
    file.stream.seek(0)
    if head == b"PAR1":
        return arrays_of_table(file, keep)
    return read_npz(file, (*_NEEDED, "interactions", "vertices", *keep))


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
