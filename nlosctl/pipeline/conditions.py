"""Conditions on figures, as ``evaluate --fail-if`` takes them: ``rmse_m>5``."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from nlosctl.errors import UsageError, did_you_mean

__all__ = ["met_condition"]

_OPERATORS: dict[str, Callable[[float, float], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
}
_FORM = re.compile(r"\s*([A-Za-z_]\w*)\s*(>=|<=|>|<)\s*([-+.\w]+)\s*")


def met_condition(condition: str, figures: Sequence[Mapping[str, Any]]) -> str | None:
    """Return what meets ``condition`` in any of the ``figures``, in words, or None.

    A figure that is not there to be compared (None) meets every condition: what can't be shown to hold fails.
    Raises UsageError where the condition is of another form or names no figure.
    """
    match = _FORM.fullmatch(condition)
    if match is None:
        raise UsageError(f"--fail-if takes NAME>NUMBER (or <, >=, <=), such as 'rmse_m>5'. Got {condition!r} instead.")
    name, sign, text = match.groups()
    try:
        limit = float(text)
    except ValueError:
        raise UsageError(f"--fail-if {condition}: {text!r} is not a number") from None
    for figure in figures:
        known = [key for key, value in figure.items() if value is None or isinstance(value, int | float)]
        if name not in known:
            raise UsageError(f"--fail-if {condition}: no figure {name!r}{did_you_mean(name, known)}")
        value = figure[name]
        if value is None or _OPERATORS[sign](value, limit):
            whose = f" of {figure['method']}" if "method" in figure else ""
            return f"{name}{whose} is {'unknown' if value is None else f'{value:.6g}'}, which meets {condition!r}"
    return None
