"""Columns drawn from a scenario."""

from __future__ import annotations

from typing import Any

import numpy as np

from nlosctl.scenarios.catalogue import scenarios
from nlosctl.scenarios.spec import Columns, ScenarioSpec


def draw_columns(scenario: str | ScenarioSpec, snapshots: int, *, seed: int = 0, **options: Any) -> Columns:
    """Return the columns of one draw; ``scenario`` is a name or a specification."""
    spec = scenarios()[scenario] if isinstance(scenario, str) else scenario
    return spec.generate(spec.options(**options), np.random.default_rng(seed), snapshots)
