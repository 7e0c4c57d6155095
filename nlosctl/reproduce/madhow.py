"""Ananthasubramaniam, Madhow: the paper, where its text is in error, and its ring of receivers."""

from __future__ import annotations

from typing import Any

from nlosctl.reproduce.experiment import Chunk, Paper
from nlosctl.reproduce.simulated import Fixes, Simulated, fixes, simulated

__all__ = ["FIELD", "PAPER", "ring", "solve"]

FIELD = "circle:0,0,1"
"""The paper's field: the unit disc of receivers; lengths are in radii."""


def ring(chunk: Chunk, **parameters: Any) -> Simulated:
    """Draw trials on the ring of Section V: receivers on the unit circle, 25 sources in turn."""
    return simulated("madhow-ring", chunk, **parameters)


def solve(given: Simulated, chunk: Chunk, method: str, **parameters: Any) -> Fixes:
    """Solve every trial within the paper's field."""
    return fixes(given, chunk, method, field=FIELD, **parameters)


PAPER = Paper(
    name="madhow",
    reference="Ananthasubramaniam, Madhow",
    errata=(),
)
