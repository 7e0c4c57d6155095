"""Curves over a swept condition, with Monte-Carlo error bars."""

from __future__ import annotations

import numpy as np

from nlosctl.plotting.panels import Series
from nlosctl.reproduce.samples import Drawn, Statistic, measure

__all__ = ["curve"]


def curve(
    drawn: Drawn,
    x: str,
    label: str,
    statistic: Statistic,
    *,
    marker: bool = True,
    style: int | None = None,
    **keys: float | int | str,
) -> Series:
    """Return a statistic over the condition ``x``, for those conditions that have the values ``keys``.

    Error bars are one Monte-Carlo standard error to each side; without ``marker`` (a bound, a theory) there are none.
    """
    places, values, errors = [], [], []
    for condition, samples in drawn.where(**keys):
        alone = Drawn(conditions=[condition], samples=[samples], random=drawn.random)
        ours = measure(lambda part: statistic(part.samples[0]), alone)
        places.append(float(condition[x]))
        values.append(ours.value)
        errors.append(ours.standard_error)
    bars = np.nan_to_num(np.array(errors)) if marker and drawn.random else None
    return Series(label=label, x=np.array(places), y=np.array(values), error=bars, marker=marker, style=style)
