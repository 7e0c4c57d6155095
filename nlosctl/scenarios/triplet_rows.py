"""Rows of a simulated triplets file: the columns that follow from a scenario's traced paths."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.geometry.angles import wrap_angle
from nlosctl.scenarios.space_rows import in_table_order, within_zenith
from nlosctl.scenarios.spec import Columns

__all__ = ["triplet_columns"]

_SCALARS = ("dod_rad", "doa_rad", "path_length_m", "dod_elevation_rad", "doa_elevation_rad")
_STDS = ("dod_std_rad", "doa_std_rad", "path_length_std_m", "dod_elevation_std_rad", "doa_elevation_std_rad")


def triplet_columns(
    *,
    generator: np.random.Generator,
    snapshot: IntArray,
    path: IntArray,
    tx_m: FloatArray,
    rx_m: FloatArray,
    triplet: tuple[FloatArray, ...],
    stds: tuple[FloatArray, ...],
    truth_ip: BoolArray,
    target_m: FloatArray,
) -> Columns:
    """Return the flat columns (N,) of a triplets file.

    ``triplet`` holds noise-free DOD, DOA (rad) and path length (m), in space also the elevations of both directions, to
    which Gaussian errors with ``stds`` are added; positions (N, D) in metres. Noisy angles are wrapped to (-pi, pi].
    """
    noise = generator.standard_normal((len(triplet), snapshot.shape[0]))
    noisy = [value + std * error for value, std, error in zip(triplet, stds, noise, strict=True)]
    for azimuth in range(len(triplet) - 3):
        noisy[azimuth], noisy[azimuth + 3] = within_zenith(noisy[azimuth], noisy[azimuth + 3])
    noisy[:2] = [wrap_angle(angle) for angle in noisy[:2]]
    nodes = {"tx": tx_m, "rx": rx_m, "truth": target_m}
    columns = {
        "snapshot": snapshot,
        "path": path,
        **{f"{name}_{axis}_m": part for name, at in nodes.items() for axis, part in zip("xyz", at.T, strict=False)},
        **dict(zip(_SCALARS, noisy, strict=False)),
        **dict(zip(_STDS, stds, strict=False)),
        "truth_ip": truth_ip,
    }
    return in_table_order("triplets", columns)
