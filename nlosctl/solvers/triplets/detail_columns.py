"""Detail columns of the flags of triplets: three points, six differences and their thresholds; reasons."""

from __future__ import annotations

from itertools import islice

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.contract.results import Words
from nlosctl.geometry.triplets import DIFFERENCES
from nlosctl.models.error_laws import ErrorLaw, GaussianErrors
from nlosctl.models.triplets import PathRows, SpacePaths
from nlosctl.solvers.triplets.difference_rules import decide, rule_quantity
from nlosctl.solvers.triplets.initial_space_estimates import space_crossings, space_starts
from nlosctl.solvers.triplets.likelihood import TripletProblem

__all__ = ["DETAIL_COLUMNS", "detail_columns", "reasons"]


_POINTS = ((1, "dod_doa"), (2, "dod_toa"), (3, "doa_toa"))

DETAIL_COLUMNS = (
    *(f"{name}_{axis}_m" for _, name in _POINTS for axis in ("x", "y")),
    *(f"lambda{rule}_m" for rule in DIFFERENCES),
    *(f"threshold{rule}_m" for rule in DIFFERENCES),
)

"""The columns, in order."""


def detail_columns(
    rows: PathRows | SpacePaths, false_alarm: float, *, law: ErrorLaw | None = None, eta_m: float = 0.0
) -> dict[str, FloatArray]:
    """Return the details (B, K) by name: points in global coordinates, lambda and thresholds in the baseline frame.

    Metres; NaN where a point does not exist. ``law`` is Gaussian by default; ``eta_m`` as in `decide`.
    """
    if isinstance(rows, SpacePaths):
        return _space_details(rows)
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


def _space_details(rows: SpacePaths) -> dict[str, FloatArray]:
    """Return the three points; the rules compare coordinates in the plane, and have no values in space."""
    problem = TripletProblem.of_paths(rows)
    on_ellipsoid = list(islice(space_starts(rows, problem), 3))[1:]
    details = {name: np.full(rows.shape, np.nan) for name in DETAIL_COLUMNS}
    for (_, name), point in zip(_POINTS, (space_crossings(rows, problem), *on_ellipsoid), strict=True):
        for axis, values in zip(("x", "y"), rows.frame.to_global(*point), strict=False):
            details[f"{name}_{axis}_m"] = rows.dense(values)
    return details


def reasons(shape: tuple[int, ...], *parts: tuple[str, BoolArray]) -> Words:
    """Return the reasons of each row: the words of all ``parts`` that apply, in order, joined by a comma.

    The text is empty if none applies. ``parts`` (at most eight) are a word and where it applies, each of ``shape``.
    """
    present = [(word, where) for word, where in parts if where.any()]
    code = np.zeros(shape, dtype=np.uint8)
    for index, (_, where) in enumerate(present):
        code += where * np.uint8(1 << index)
    combinations = np.flatnonzero(np.bincount(code.ravel(), minlength=1))
    names = [",".join(word for index, (word, _) in enumerate(present) if value >> index & 1) for value in combinations]
    indices = np.zeros(1 << len(present), dtype=np.uint8)
    indices[combinations] = np.arange(combinations.shape[0])
    return Words(code=indices[code], words=tuple(names))
