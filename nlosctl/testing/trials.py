"""What a draw of random batches is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["Draw", "Trial"]


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A random batch with the size of its scene in metres, the reference for rounding errors."""

    batch: Any
    size_m: float


@dataclass(frozen=True, kw_only=True)
class Draw:
    """How batches of a kind are drawn and turned.

    ``trial(generator, snapshots, measurements, fault)`` draws a batch; ``fault`` is None for ordinary snapshots, or
    one of ``faults``, each a name of what is degenerate in every snapshot. ``directions`` names the batch's arrays
    that turn with the frame; those whose names end in ``_xy_m`` are positions.
    """

    trial: Callable[[np.random.Generator, int, int, str | None], Trial]
    faults: tuple[str, ...]
    directions: tuple[str, ...]
