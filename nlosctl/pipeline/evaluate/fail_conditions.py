"""Conditions on metrics, as in ``evaluate --fail-if``: ``rmse_m>5``, ``ml:rmse_m>5``."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError, did_you_mean
from nlosctl.pipeline.evaluate.groups import group_title, is_label

__all__ = ["Condition", "parse_condition"]

_OPERATORS: dict[str, Callable[[float, float], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    "==": operator.eq,
    "!=": operator.ne,
    ">": operator.gt,
    "<": operator.lt,
}
_FORM = re.compile(r"\s*(?:([^:<>=!]+):)?\s*([A-Za-z_]\w*)\s*(>=|<=|==|!=|>|<)\s*([-+.\w]+)\s*")


@dataclass(frozen=True, kw_only=True)
class Condition:
    """A comparison of a metric, of all methods or of ``method``, with a number; ``text`` is the original form."""

    text: str
    method: str | None
    name: str
    sign: str
    limit: float

    def reasons(self, groups: Sequence[Mapping[str, Any]]) -> list[str]:
        """Return a line for each of the ``groups`` of metrics that meets the condition.

        An undefined metric (NaN) meets every condition. Raises UsageError if no group is of the method, or a group does
        not have the metric.
        """
        reasons = []
        for group in self._matching(groups):
            metrics = {**group, **_status_counts(group)}
            known = [key for key, value in metrics.items() if _is_metric(key, value)]
            self._require(known)
            value = metrics[self.name]
            if math.isnan(value) or _OPERATORS[self.sign](value, self.limit):
                whose = f" of {group_title(group)}" if group_title(group) else ""
                shown = "unknown" if math.isnan(value) else f"{value:.6g}"
                reasons.append(f"{self.name}{whose} is {shown}, which meets {self.text!r}")
        return reasons

    def check(self, groups: Sequence[Mapping[str, Any]], metrics: Sequence[str]) -> None:
        """Raise UsageError if no group is of the method, or the metric is not one of ``metrics``."""
        self._matching(groups)
        self._require(metrics)

    def _require(self, known: Sequence[str]) -> None:
        if self.name not in known:
            near, there = did_you_mean(self.name, known), ", ".join(known)
            raise UsageError(f"`fail_if` {self.text}: no metric {self.name!r}{near}; there are: {there}")

    def _matching(self, groups: Sequence[Mapping[str, Any]]) -> Sequence[Mapping[str, Any]]:
        if self.method is None:
            return groups
        matching = [group for group in groups if group.get("method") == self.method]
        if not matching:
            known = list(dict.fromkeys(str(group["method"]) for group in groups if "method" in group))
            raise UsageError(
                f"`fail_if` {self.text}: no method {self.method!r} in the input{did_you_mean(self.method, known)}; "
                f"there are: {', '.join(known) or 'none'}"
            )
        return matching


def parse_condition(text: str) -> Condition:
    """Return the condition that ``text`` describes; raise UsageError if it can't be parsed."""
    match = _FORM.fullmatch(text)
    if match is None:
        raise UsageError(
            f"`fail_if` takes [METHOD:]FIGURE>NUMBER (or <, >=, <=, ==, !=), such as 'rmse_m>5'. Got {text!r} instead."
        )
    method, name, sign, number = match.groups()
    try:
        limit = float(number)
    except ValueError:
        raise UsageError(f"`fail_if` {text}: {number!r} is not a number") from None
    if math.isnan(limit):
        raise UsageError(f"`fail_if` {text}: nothing compares with {number!r}; give a number")
    return Condition(text=text, method=None if method is None else method.strip(), name=name, sign=sign, limit=limit)


def _status_counts(group: Mapping[str, Any]) -> dict[str, int]:
    """Return the number of rows of each status as metrics ``status_ok``, ..."""
    if "statuses" not in group:
        return {}
    return {f"status_{status.word}": group["statuses"].get(status.word, 0) for status in Status}


def _is_metric(name: str, value: object) -> bool:
    """Return whether a value of a group is a metric: a number that is not an identifier."""
    return isinstance(value, int | float) and not isinstance(value, bool) and not is_label(name)
