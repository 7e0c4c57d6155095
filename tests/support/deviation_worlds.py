"""Drives of a car whose array has a deviation that depends on the direction relative to the heading."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

Floats = npt.NDArray[np.float64]

SOURCE_M = (400.0, 300.0)
TERMS_DEG = (2.0, 5.0, -3.0, 1.5, 4.0)
"""Offset, then cosine and sine of the orders 1 and 2."""


def design(direction_rad: Floats, terms: int = 5) -> Floats:
    """Return the derivatives (N, T) of a deviation by its terms."""
    parts = [np.ones(direction_rad.shape)]
    for order in range(1, terms // 2 + 1):
        parts += [np.cos(order * direction_rad), np.sin(order * direction_rad)]
    return np.stack(parts, axis=1)


def drive(
    rows: int = 300,
    seed: int = 0,
    *,
    std_deg: float = 2.0,
    terms_deg: tuple[float, ...] = TERMS_DEG,
    source_m: tuple[float, float] = SOURCE_M,
) -> tuple[pa.Table, Floats]:
    """Return bearings of one transmitter from a winding drive, and their true directions relative to the heading."""
    rng = np.random.default_rng(seed)
    heading_deg = rng.uniform(0.0, 360.0) + np.cumsum(rng.normal(0.0, 25.0, rows))
    forward = 0.5 * np.pi - np.radians(heading_deg)
    place = rng.uniform(-800.0, 800.0, (rows, 2))
    bearing = np.arctan2(source_m[1] - place[:, 1], source_m[0] - place[:, 0])
    direction = bearing - forward
    measured = bearing + np.radians(design(direction, len(terms_deg)) @ terms_deg)
    measured += np.radians(std_deg) * rng.standard_normal(rows)
    columns: dict[str, Any] = {
        "time_s": np.arange(rows, dtype=np.float64),
        "sensor": ["car"] * rows,
        "sensor_x_m": place[:, 0],
        "sensor_y_m": place[:, 1],
        "bearing_rad": np.angle(np.exp(1j * measured)),
        "bearing_std_rad": np.full(rows, np.radians(std_deg)),
        "heading_deg": heading_deg % 360.0,
        "truth_x_m": np.full(rows, source_m[0]),
        "truth_y_m": np.full(rows, source_m[1]),
    }
    return pa.table(columns), direction
