"""What a scenario is: a simulated world that yields measurements with their truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.contract.scene import Scene

__all__ = ["Columns", "ScenarioSpec"]

Columns = Mapping[str, npt.NDArray[Any]]
"""Flat columns (N,) of a measurement file by name; ``snapshot`` counts from 0 within the call."""


@dataclass(frozen=True, kw_only=True)
class ScenarioSpec:
    """A scenario, frozen.

    ``options`` is a frozen dataclass whose fields are its ``--param`` keys, ``scene(options)`` its sensors and
    reflectors, and ``generate(options, generator, snapshots)`` draws that many snapshots from ``generator`` alone.
    """

    name: str
    kind: str
    summary: str
    reference: str
    options: type[Any]
    scene: Callable[[Any], Scene]
    generate: Callable[[Any, np.random.Generator, int], Columns]
