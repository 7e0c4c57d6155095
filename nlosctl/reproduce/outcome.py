"""What comes of an experiment: rows of claims with verdicts, the numbers of the figure, and its panels."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.reproduce.experiment import Experiment
from nlosctl.reproduce.samples import Drawn, Statistic, measure
from nlosctl.reproduce.verdicts import Verdict, verdict

__all__ = ["ClaimRow", "claim_rows", "figure_columns", "with_error"]

_ROUNDING = 1e-9
"""A standard error this small beside its number is rounding: nothing random is in it."""


@dataclass(frozen=True, kw_only=True)
class ClaimRow:
    """A claim with our number, its Monte-Carlo standard error and the verdict; None: not the paper's, but beside it."""

    experiment: str
    claim: str
    where: str
    paper: str
    ours: float
    standard_error: float
    unit: str
    verdict: Verdict | None
    note: str

    @property
    def told(self) -> str:
        """Our number as it is shown."""
        return with_error(self.ours, self.standard_error, self.unit)


def claim_rows(experiment: Experiment, drawn: Drawn) -> list[ClaimRow]:
    """Return the claims of the paper, then what the method that we recommend reaches beside them."""
    rows = []
    trials = next(iter(drawn.samples[0].values())).shape[0]
    for claim in experiment.claims:
        ours = measure(claim.ours, drawn)
        error = max(ours.standard_error, claim.per_trial / trials)
        rows.append(
            ClaimRow(
                experiment=experiment.name,
                claim=claim.says,
                where=claim.where,
                paper=claim.expected.text if claim.expected is not None else "",
                ours=ours.value,
                standard_error=error,
                unit=claim.unit,
                verdict=verdict(ours.value, error, claim.expected),
                note=claim.note,
            )
        )
    for beside in experiment.beside:
        ours = measure(beside.ours, drawn)
        rows.append(
            ClaimRow(
                experiment=experiment.name,
                claim=beside.says,
                where="",
                paper="",
                ours=ours.value,
                standard_error=ours.standard_error,
                unit=beside.unit,
                verdict=None,
                note="",
            )
        )
    return rows


def figure_columns(experiment: Experiment, drawn: Drawn) -> Mapping[str, npt.NDArray[Any]]:
    """Return the numbers of the figure: a row per condition, each quantity with its standard error (``NAME_se``)."""
    columns: dict[str, list[Any]] = {}
    for condition, samples in zip(drawn.conditions, drawn.samples, strict=True):
        alone = Drawn(conditions=[condition], samples=[samples], random=drawn.random)
        row: dict[str, Any] = {**condition, "trials": next(iter(samples.values())).shape[0]}
        for name, statistic in experiment.quantities.items():
            ours = measure(_of_one(statistic), alone)
            row |= {name: ours.value, f"{name}_se": ours.standard_error}
        for name, value in row.items():
            columns.setdefault(name, []).append(value)
    return {name: np.array(values) for name, values in columns.items()}


def _of_one(statistic: Statistic) -> Callable[[Drawn], float]:
    return lambda drawn: statistic(drawn.samples[0])


def with_error(value: float, standard_error: float, unit: str = "") -> str:
    """Return a number with its standard error, to two digits of the error; a dash where there is none."""
    if not math.isfinite(value):
        return "-"
    suffix = f" {unit}" if unit else ""
    if not standard_error > _ROUNDING * abs(value):
        return f"{value:.6g}{suffix}"
    decimals = max(0, 1 - math.floor(math.log10(standard_error)))
    return f"{value:.{decimals}f} ± {standard_error:.{decimals}f}{suffix}"
