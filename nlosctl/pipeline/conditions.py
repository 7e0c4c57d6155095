"""Conditions on figures, as ``evaluate --fail-if`` takes them: ``rmse_m>5``."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from nlosctl.errors import UsageError, did_you_mean

__all__ = ["Condition", "parse_condition"]

_OPERATORS: dict[str, Callable[[float, float], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
}
_FORM = re.compile(r"\s*([A-Za-z_]\w*)\s*(>=|<=|>|<)\s*([-+.\w]+)\s*")


@dataclass(frozen=True, kw_only=True)
class Condition:
    """A figure compared with a number; ``words`` are those of the command line."""

    words: str
    name: str
    sign: str
    limit: float

    def met(self, figures: Sequence[Mapping[str, Any]]) -> str | None:
        """Return what meets the condition in any of the ``figures``, in words, or None.

        A figure that is not known (NaN) meets every condition: what can't be shown to hold fails.
        Raises UsageError where no figure has the name.
        """
        for figure in figures:
            known = [key for key, value in figure.items() if isinstance(value, int | float)]
            if self.name not in known:
                raise UsageError(f"--fail-if {self.words}: no figure {self.name!r}{did_you_mean(self.name, known)}")
            value = figure[self.name]
            if math.isnan(value) or _OPERATORS[self.sign](value, self.limit):
                whose = f" of {figure['method']}" if "method" in figure else ""
                told = "unknown" if math.isnan(value) else f"{value:.6g}"
                return f"{self.name}{whose} is {told}, which meets {self.words!r}"
        return None


def parse_condition(words: str) -> Condition:
    """Return the condition that ``words`` say; raise UsageError where they have another form."""
    match = _FORM.fullmatch(words)
    if match is None:
        raise UsageError(f"--fail-if takes NAME>NUMBER (or <, >=, <=), such as 'rmse_m>5'. Got {words!r} instead.")
    name, sign, text = match.groups()
    try:
        return Condition(words=words, name=name, sign=sign, limit=float(text))
    except ValueError:
        raise UsageError(f"--fail-if {words}: {text!r} is not a number") from None
