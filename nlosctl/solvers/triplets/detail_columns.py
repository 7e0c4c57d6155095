"""What flags of triplets can show of how a path looks: its three points, the six differences, their thresholds."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.contract.results import Words
from nlosctl.geometry.triplets import DIFFERENCES
from nlosctl.models.error_laws import ErrorLaw, GaussianErrors
from nlosctl.models.triplets import PathRows
from nlosctl.solvers.triplets.difference_rules import decide, rule_quantity

__all__ = ["DETAIL_COLUMNS", "detail_columns", "reasons"]


_POINTS = ((1, "dod_doa"), (2, "dod_toa"), (3, "doa_toa"))

DETAIL_COLUMNS = (
    *(f"{name}_{axis}_m" for _, name in _POINTS for axis in ("x", "y")),
    *(f"lambda{rule}_m" for rule in DIFFERENCES),
    *(f"threshold{rule}_m" for rule in DIFFERENCES),
)

"""The columns, in order."""


def detail_columns(
    rows: PathRows, false_alarm: float, *, law: ErrorLaw | None = None, eta_m: float = 0.0
) -> dict[str, FloatArray]:
    """Return the details (B, K) by name: points in global coordinates, lambda and thresholds in the baseline frame.

    Metres; NaN where a point does not exist. ``law`` is Gaussian unless given; ``eta_m`` as in `decide`.
    """
    law = law or GaussianErrors()
    flat: dict[str, FloatArray] = {}
    for point, name in _POINTS:
        x, y = rows.rays.coordinate(point, "x").value_m, rows.rays.coordinate(point, "y").value_m
        flat[f"{name}_x_m"], flat[f"{name}_y_m"] = rows.frame.to_global(x, y)
    for rule in DIFFERENCES:
        decision = decide(rows, rule_quantity(rows.rays, rule), law, eta_m)
        flat[f"lambda{rule}_m"] = decision.value_m
        flat[f"threshold{rule}_m"] = decision.threshold_m(law, false_alarm, eta_m)
    return {name: rows.dense(flat[name]) for name in DETAIL_COLUMNS}


def reasons(shape: tuple[int, ...], *parts: tuple[str, BoolArray]) -> Words:
    """Return the words of rows: the words of all ``parts`` that hold for a row, in order, joined by a comma.

    An empty text where none holds; eight words at most. ``parts`` are a word and where it holds, each of ``shape``.
    """
    held = [(word, where) for word, where in parts if where.any()]
    code = np.zeros(shape, dtype=np.uint8)
    for place, (_, where) in enumerate(held):
        code += where * np.uint8(1 << place)
    found = np.flatnonzero(np.bincount(code.ravel(), minlength=1))
    names = [",".join(word for place, (word, _) in enumerate(held) if value >> place & 1) for value in found]
    places = np.zeros(1 << len(held), dtype=np.uint8)
    places[found] = np.arange(found.shape[0])
    return Words(code=places[code], words=tuple(names))
