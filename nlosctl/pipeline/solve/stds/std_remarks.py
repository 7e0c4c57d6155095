"""What the summary states of standard deviations that a run estimated."""

from __future__ import annotations

import math
from collections.abc import Sequence

from nlosctl.contract.statuses import Status
from nlosctl.contract.tables import KINDS
from nlosctl.pipeline.solve.method_runs import MethodRun, MethodTally
from nlosctl.pipeline.solve.stds.unknown_std import StdEstimate, StdFactor

__all__ = ["std_remarks"]

_MOST_NAMES = 10


def std_remarks(run: MethodRun, tally: MethodTally, kind: str, columns: Sequence[str]) -> list[str]:
    """Return the lines on the standard deviations of a method; ``columns`` are those of the input, and constants."""
    std = run.std
    if std is None:
        return []
    lacking = tally.statuses[Status.STD_NOT_ESTIMABLE.word]
    without = f"; {lacking} of {tally.total} fixes have no covariance (std_not_estimable): too few rows"
    if std.pool == "snapshot":
        line = f"{run.label}: the std of each snapshot is estimated from its residuals (std_factor, std_dof)"
        return [line + (without if lacking else "")]
    if std.file is None:
        return [
            f"{run.label}: no snapshot has spare rows with residuals to estimate the std from: the {lacking} fixes "
            "have no covariance (std_not_estimable)"
        ]
    unit = _unit(kind, columns)
    passes = f"in {std.passes} passes over the input"
    lines = [f"{run.label}: {_quantity(unit)} of the file, estimated from residuals {passes}: {_shown(std.file, unit)}"]
    if std.pool == "sensor":
        lines += _sensors(run.label, std, unit)
    if not std.settled:
        lines.append(f"{run.label}: these values had not settled {passes}: they may be inaccurate")
    return lines


def _sensors(label: str, std: StdEstimate, unit: str) -> list[str]:
    shown = [f"{name} {_shown(factor, unit)}" for name, factor in sorted(std.sensors.items())]
    lines = [f"{label}: {_quantity(unit)} of each sensor: {_listed(shown, '; ')}"]
    if std.alone:
        lines.append(
            f"{label}: the file's is that of sensors only in snapshots without spare rows: {_listed(std.alone, ', ')}"
        )
    return lines


def _listed(texts: Sequence[str], separator: str) -> str:
    more = len(texts) - _MOST_NAMES
    return separator.join(texts[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


def _unit(kind: str, columns: Sequence[str]) -> str:
    """Return the unit of the rows' scalar if no standard deviation is stated, else an empty text."""
    stds = [column for column in KINDS[kind].columns if column.estimable]
    stated = any(name in columns for column in stds for name in column.accepted_names)
    return "" if stated else next(column.unit for column in stds if column.required)


def _quantity(unit: str) -> str:
    return "std" if unit else "factor of the stated std"


def _shown(factor: StdFactor, unit: str) -> str:
    value = math.degrees(factor.value) if unit == "rad" else factor.value
    shown = f"{value:.4g} {'deg' if unit == 'rad' else unit}".rstrip()
    return f"{shown} ({factor.degrees:.4g} degrees of freedom)"
