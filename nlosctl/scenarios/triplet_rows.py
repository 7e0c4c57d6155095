"""Rows of a simulated triplets file: the columns that follow from a scenario's traced paths."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.geometry.angles import wrap_angle
from nlosctl.scenarios.spec import Columns

__all__ = ["triplet_columns"]


def triplet_columns(
    *,
    generator: np.random.Generator,
    snapshot: IntArray,
    path: IntArray,
    tx_xy_m: FloatArray,
    rx_xy_m: FloatArray,
    triplet: tuple[FloatArray, FloatArray, FloatArray],
    stds: tuple[FloatArray, FloatArray, FloatArray],
    truth_ip: BoolArray,
    target_xy_m: FloatArray,
) -> Columns:
    """Return the flat columns (N,) of a triplets file.

    ``triplet`` holds noise-free DOD, DOA (rad) and path length (m), to which Gaussian errors with ``stds`` are added;
    positions (N, 2) in metres. Noisy angles are wrapped to (-pi, pi].
    """
    noise = generator.standard_normal((3, snapshot.shape[0]))
    dod, doa, length = (value + std * error for value, std, error in zip(triplet, stds, noise, strict=True))
    return {
        "snapshot": snapshot,
        "path": path,
        "tx_x_m": tx_xy_m[:, 0],
        "tx_y_m": tx_xy_m[:, 1],
        "rx_x_m": rx_xy_m[:, 0],
        "rx_y_m": rx_xy_m[:, 1],
        "dod_rad": wrap_angle(dod),
        "doa_rad": wrap_angle(doa),
        "path_length_m": length,
        "dod_std_rad": stds[0],
        "doa_std_rad": stds[1],
        "path_length_std_m": stds[2],
        "truth_x_m": target_xy_m[:, 0],
        "truth_y_m": target_xy_m[:, 1],
        "truth_ip": truth_ip,
    }
