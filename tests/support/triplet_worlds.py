"""Batches of triplets drawn from the paper's scenarios, for tests."""

from __future__ import annotations

import numpy as np

from nlosctl.contract.batches import TripletBatch


def batch_of(columns, rows=None):
    """Return the batch (N, 1) of flat columns, every row a snapshot of its own."""
    rows = slice(None) if rows is None else rows
    size = columns["dod_rad"][rows].shape[0]
    arrays = {}
    for name, parts in TripletBatch.SOURCES.items():
        values = [np.asfortranarray(columns[part][rows][:, None]) for part in parts]
        arrays[name] = values[0] if len(values) == 1 else np.asfortranarray(np.stack(values, axis=-1))
    return TripletBatch(seed=np.zeros(size, dtype=np.uint64), **arrays)


def one_path(tx=(-2.5, 0.0), rx=(2.5, 0.0), *, dod, doa, length, std=(0.01, 0.01, 0.05)):
    """Return the batch (1, 1) of one path; angles in radians."""
    columns = {
        "tx_x_m": tx[0],
        "tx_y_m": tx[1],
        "rx_x_m": rx[0],
        "rx_y_m": rx[1],
        "dod_rad": dod,
        "doa_rad": doa,
        "path_length_m": length,
        "dod_std_rad": std[0],
        "doa_std_rad": std[1],
        "path_length_std_m": std[2],
    }
    return batch_of({name: np.array([float(value)]) for name, value in columns.items()})
