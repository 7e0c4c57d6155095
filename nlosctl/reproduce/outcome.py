"""Outcome of an experiment: rows of claims with verdicts, and the figure's numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.reproduce.experiment import Experiment
from nlosctl.reproduce.samples import Results, at, measure
from nlosctl.reproduce.verdicts import Verdict, verdict

__all__ = ["ClaimRow", "claim_rows", "figure_columns", "with_error"]

_ROUNDING = 1e-9
"""A relative standard error up to this is rounding: the number has nothing random in it."""


@dataclass(frozen=True, kw_only=True)
class ClaimRow:
    """A claim with our number, its Monte-Carlo standard error and the verdict; a comparison has no verdict.

    ``paper`` is the paper's number or its words, ``allowed`` the range that we take to confirm it.
    """

    experiment: str
    claim: str
    ours: float
    standard_error: float
    unit: str
    where: str = ""
    paper: str = ""
    allowed: str = ""
    verdict: Verdict | None = None
    note: str = ""

    @property
    def ours_text(self) -> str:
        """Our number with its standard error and unit."""
        return with_error(self.ours, self.standard_error, self.unit)


def claim_rows(experiment: Experiment, results: Results) -> list[ClaimRow]:
    """Return the claims of the paper, then the comparisons with the methods that we recommend."""
    rows = []
    trials = next(iter(results.samples[0].values())).shape[0]
    for claim in experiment.claims:
        ours = measure(claim.ours, results)
        error = max(ours.standard_error, claim.per_trial / trials)
        rows.append(
            ClaimRow(
                experiment=experiment.name,
                claim=claim.text,
                where=claim.where,
                paper=claim.expected.text if claim.expected is not None else "",
                allowed=claim.expected.allowed if claim.expected is not None else "",
                ours=ours.value,
                standard_error=error,
                unit=claim.unit,
                verdict=verdict(ours.value, error, claim.expected),
                note=claim.note,
            )
        )
    for comparison in experiment.comparisons:
        ours = measure(comparison.ours, results)
        rows.append(
            ClaimRow(
                experiment=experiment.name,
                claim=comparison.text,
                ours=ours.value,
                standard_error=ours.standard_error,
                unit=comparison.unit,
            )
        )
    return rows


def figure_columns(experiment: Experiment, results: Results) -> Mapping[str, npt.NDArray[Any]]:
    """Return the numbers of the figure: a row per condition, each quantity with its standard error (``NAME_se``)."""
    columns: dict[str, list[Any]] = {}
    for condition, alone in results.separately():
        row: dict[str, Any] = {**condition, "trials": next(iter(alone.of().values())).shape[0]}
        for name, statistic in experiment.quantities.items():
            ours = measure(at(statistic), alone)
            row |= {name: ours.value, f"{name}_se": ours.standard_error}
        for name, value in row.items():
            columns.setdefault(name, []).append(value)
    return {name: np.array(values) for name, values in columns.items()}


def with_error(value: float, standard_error: float, unit: str = "") -> str:
    """Return a number with its standard error, to two digits of the error; a dash if it is not finite."""
    if not math.isfinite(value):
        return "-"
    suffix = f" {unit}" if unit else ""
    if not standard_error > _ROUNDING * abs(value):
        return f"{value:.6g}{suffix}"
    decimals = max(0, 1 - math.floor(math.log10(standard_error)))
    return f"{value:.{decimals}f} ± {standard_error:.{decimals}f}{suffix}"
