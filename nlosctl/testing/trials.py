"""What a drawn batch is, and how batches of a kind of measurement are drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["Draw", "Trial"]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A drawn batch, with the size of its scene in metres: what rounding is measured against."""

    batch: Any
    size_m: float


@dataclass(frozen=True, kw_only=True)
class Draw:
    """How batches of a kind are drawn and turned.

    ``trial(generator, snapshots, measurements, fault)`` draws a batch; ``fault`` is None for ordinary snapshots, or
    one of ``faults``, words for what is degenerate in every snapshot of it. ``directions`` names the batch's arrays
    that turn with the frame; those that end in ``_xy_m`` are known to be positions.
    """

    trial: Callable[[np.random.Generator, int, int, str | None], Trial]
    faults: tuple[str, ...]
    directions: tuple[str, ...]
