"""Maps: the trials of an experiment that draws nothing are the points of a lattice."""

from __future__ import annotations

import math

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.reproduce.experiment import Chunk

__all__ = ["lattice_points", "on_lattice"]


def lattice_points(
    chunk: Chunk, x_range: tuple[float, float], y_range: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Return x and y (size,) of the chunk's points: cell centres of a square lattice over the box, row by row."""
    side = math.ceil(math.sqrt(chunk.total))
    x = x_range[0] + (x_range[1] - x_range[0]) * (chunk.trials % side + 0.5) / side
    y = y_range[0] + (y_range[1] - y_range[0]) * (chunk.trials // side + 0.5) / side
    return x, y


def on_lattice(x: FloatArray, y: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return columns (W,), rows (H,) and values (H, W) of all points of a lattice; NaN where the last row is short."""
    side = math.ceil(math.sqrt(x.shape[0]))
    rows = -(-x.shape[0] // side)
    grid = np.full(rows * side, np.nan)
    grid[: values.shape[0]] = values
    return x[:side], y[::side], grid.reshape(rows, side)
