"""Verdicts: one rule decides whether our number reproduces the paper's."""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal
from enum import StrEnum

__all__ = ["Expected", "Verdict", "about", "at_least", "at_most", "between", "printed", "verdict"]

_SIGMAS = 3.0
"""Largest deviation in Monte-Carlo standard errors: chance alone exceeds it three times in a thousand."""

_COARSEST = 0.25
"""Widest margin, as a share of the number, at which a number that agrees reproduces it."""


class Verdict(StrEnum):
    """The verdict on a claim."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    UNDECIDED = "undecided"
    NO_NUMBERS = "no numbers in the text"


@dataclass(frozen=True, kw_only=True)
class Expected:
    """The range of numbers that confirm a claim, which is ours, and ``text``, the number or the words of the paper.

    ``standard_error`` is the Monte-Carlo error of the paper's number, if its number of trials is known.
    """

    low: float
    high: float
    text: str
    standard_error: float = 0.0

    @property
    def allowed(self) -> str:
        """The range as text."""
        if self.low == self.high:
            return f"{self.low:g}"
        if math.isinf(self.high):
            return f">= {self.low:g}"
        return f"<= {self.high:g}" if math.isinf(self.low) else f"{self.low:.6g} to {self.high:.6g}"


def printed(text: str, *, tolerance: float = 0.0, standard_error: float = 0.0) -> Expected:
    """Return the range of a printed number: plus or minus half its last digit and ``tolerance``.

    ``text`` is the number as the paper prints it, optionally followed by a unit or a percent sign.
    """
    number = Decimal(text.split()[0].rstrip("%"))
    last_digit = 10.0 ** int(number.as_tuple().exponent)
    slack = 0.5 * last_digit * (1.0 + 1e-9) + tolerance
    return Expected(low=float(number) - slack, high=float(number) + slack, text=text, standard_error=standard_error)


def about(value: float, relative: float, text: str) -> Expected:
    """Return the range of ``relative`` times the value about it, for words such as "equivalent to"."""
    return Expected(low=value - relative * abs(value), high=value + relative * abs(value), text=text)


def at_least(low: float, text: str) -> Expected:
    """Return the range of ``low`` and more."""
    return Expected(low=low, high=math.inf, text=text)


def at_most(high: float, text: str) -> Expected:
    """Return the range up to ``high``."""
    return Expected(low=-math.inf, high=high, text=text)


def between(low: float, high: float, text: str) -> Expected:
    """Return the range from ``low`` to ``high``."""
    return Expected(low=low, high=high, text=text)


def verdict(value: float, standard_error: float, expected: Expected | None) -> Verdict:
    """Return whether ``value`` is in the expected range, up to Monte-Carlo error.

    The margin is three times the root sum of squares of both standard errors. A value outside of the range and the
    margin does not reproduce the claim. A value that the margin could move across a limit of "at least" or "at most" is
    undecided, and so is one in a range of two limits if the margin is wider than half the range and than a quarter of
    its middle: almost any number would be inside. A missing value, or an unknown error, is undecided too.
    """
    if expected is None:
        return Verdict.NO_NUMBERS
    margin = _SIGMAS * math.hypot(standard_error, expected.standard_error)
    if math.isnan(value) or math.isnan(margin):
        return Verdict.UNDECIDED
    low, high = expected.low, expected.high
    if not low - margin <= value <= high + margin:
        return Verdict.NOT_REPRODUCED
    if math.isinf(low) or math.isinf(high):
        decided = low + margin <= value <= high - margin
    else:
        decided = margin <= max(0.5 * (high - low), _COARSEST * abs(0.5 * (high + low)))
    return Verdict.REPRODUCED if decided else Verdict.UNDECIDED
