"""Rows per snapshot, to 10,000, for every method, against scipy on the same rows in the same run.

    python benchmarks/rows.py [ROWS ...]

One snapshot of a drive: a single moving sensor on a circle of 500 m, so that all rows have one name. Bearings: 5 deg,
30 % uniform over the circle. Ranges: 0.5 m, 20 % late. Triplets: receivers with 4 paths each in a room. Echoes: sensors
in a field, 3 targets. The peer is one `scipy.optimize.least_squares` of the same rows from one initial estimate near
the source, with a soft loss where rows are outliers (triplets: of each path alone; echoes: of the direct rows).
A method in ``_LIMITED`` is not run beyond the rows named there.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from nlosctl.cli.main import run

_ROWS = (100, 1000, 2400, 10_000)
_SOURCE = np.array([-60.0, 170.0])
_METHODS = {
    "bearings": ("ls", "stansfield", "stansfield-focused", "ml", "sequential", "mixture-ml", "suppress", "ml-grid"),
    "ranges": ("sr-ls", "r-ls", "ml", "mixture-ml"),
    "triplets": ("ml", "chi2", "tdaj", "joint"),
    "echoes": ("tca", "extended-tca", "assignment"),
}
_JOBS = {"chi2": "detect-ip", "tdaj": "detect-ip", "joint": "detect-ip"}
_LIMITED: dict[tuple[str, str], int] = {}
