"""What every peer program does around its solver: read the problems, be timed a round at a time, write the answers.

    python NAME.py PROBLEMS.npz ANSWERS.npy

Each line on standard input asks for one round over all problems, answered by a line on standard output; so the driver
lets programs of several environments take turns, and times them by its own clock. Nothing here needs more than NumPy.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

Problems = dict[str, np.ndarray]


def serve(solve: Callable[[Problems], np.ndarray]) -> None:
    """Answer rounds of ``solve`` until standard input ends; its last positions, (N, 2) in metres, go to a file.

    ``solve`` gets ``sensor_xy_m`` (N, K, 2), ``bearing_rad`` and ``bearing_std_rad`` (N, K) and ``start_m`` (N, 2).
    A row that did not converge is NaN.
    """
    with np.load(sys.argv[1], allow_pickle=False) as file:
        problems = dict(file)
    positions = np.full_like(problems["start_m"], np.nan)
    for _ in sys.stdin:
        positions = solve(problems)
        print("done", flush=True)
    np.save(sys.argv[2], positions, allow_pickle=False)


def bearing_errors(point, x, y, bearing, std):
    """Return residuals (K,), in standard deviations, and their Jacobian (K, 2) of bearings from sensors to a point."""
    dx, dy = point[0] - x, point[1] - y
    error = np.arctan2(dy, dx) - bearing
    scale = 1.0 / (std * (dx * dx + dy * dy))
    return (error - 2.0 * np.pi * np.round(error / (2.0 * np.pi))) / std, np.stack([-dy * scale, dx * scale], axis=1)


def rows(problems: Problems):
    """Yield start (2,), x, y, bearing and standard deviation (K,) of each snapshot, contiguous."""
    sensors = problems["sensor_xy_m"]
    yield from zip(
        problems["start_m"],
        np.ascontiguousarray(sensors[..., 0]),
        np.ascontiguousarray(sensors[..., 1]),
        problems["bearing_rad"],
        problems["bearing_std_rad"],
        strict=True,
    )
