"""Likely causes of triplets that do not fit: one change for all paths after which most of them do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.special import erfc

from nlosctl.contract.scene import Scene
from nlosctl.io.measurements.reader import Chunk
from nlosctl.models.triplets import path_rows
from nlosctl.pipeline.solve.method_runs import MethodTally
from nlosctl.pipeline.solve.solve_chunk import dense_batch
from nlosctl.solvers.triplets.target_fits import fit_paths

__all__ = ["cause_remarks", "fit_after_changes", "most_are_bad"]

_BAD_P_VALUE = 1e-3
_MOST = 0.5
_MOSTLY_INDIRECT = 0.8
_LARGEST_CHUNK = 2000
_TRIED = "tried"
_AS_GIVEN = "as given"
_TURNED = "turned"
_EXCHANGED = "exchanged"
_EXCHANGE = {"dod_rad": "doa_rad", "doa_rad": "dod_rad", "dod_std_rad": "doa_std_rad", "doa_std_rad": "dod_std_rad"}
_TEXTS = {
    _TURNED: "if all arrivals are turned by 180 degrees: are they directions of travel? The direction of arrival is "
    "that from the receiver to where the wave comes from; add 180 degrees to the column",
    _EXCHANGED: "if departure and arrival are exchanged; exchange the two columns of directions",
}


def most_are_bad(tally: MethodTally) -> bool:
    """Return whether most fits of a chunk are bad, or nearly all of its paths are flagged as indirect."""
    flagged = tally.verdicts["indirect"] + tally.verdicts["direct"]
    indirect = tally.verdicts["indirect"] > _MOSTLY_INDIRECT * flagged
    return indirect or tally.badly_fitted > _MOST * tally.tested


def fit_after_changes(chunk: Chunk) -> dict[str, int]:
    """Return how many paths were tried (at most the chunk's first 2000), and how many fit as given and after changes.

    Each path is fitted by itself. The changes: all arrivals turned by 180 degrees; departure and arrival exchanged.
    """
    rows = np.flatnonzero(~chunk.left_out)[:_LARGEST_CHUNK, None]
    turned = {**chunk.columns, "doa_rad": chunk.columns["doa_rad"] + np.pi}
    exchanged = {**chunk.columns, **{name: chunk.columns[other] for name, other in _EXCHANGE.items()}}
    changes = {_AS_GIVEN: chunk.columns, _TURNED: turned, _EXCHANGED: exchanged}
    counts = {_TRIED: rows.size}
    for name, columns in changes.items():
        batch: Any = dense_batch("triplets", columns, rows, scene=Scene())
        p_value = erfc(np.sqrt(fit_paths(path_rows(batch)).cost))
        counts[name] = int(np.count_nonzero(p_value >= _BAD_P_VALUE))
    return counts


def cause_remarks(counts: Mapping[str, int]) -> list[str]:
    """Return a line for the change after which most paths fit that do not fit as given; ``counts`` of all chunks."""
    tried = counts.get(_TRIED, 0)
    best = max(_TEXTS, key=lambda name: counts.get(name, 0))
    if not tried or counts[_AS_GIVEN] > _MOST * tried or counts[best] <= _MOST * tried:
        return []
    return [f"{counts[best]} of {tried} paths fit ({counts[_AS_GIVEN]} as given) {_TEXTS[best]}"]
