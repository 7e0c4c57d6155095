"""Is a number of ours the paper's? The one rule for all claims."""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal
from enum import StrEnum

__all__ = ["Expected", "Verdict", "about", "at_least", "at_most", "between", "printed", "verdict"]

_SIGMAS = 3.0
"""How many Monte-Carlo standard errors a number may be away: chance alone exceeds it three times in a thousand."""


class Verdict(StrEnum):
    """What we say of a claim."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    NO_NUMBERS = "no numbers in the text"


@dataclass(frozen=True, kw_only=True)
class Expected:
    """The range in which a number must lie for a claim to be right, and ``text``: the claim's number as we show it.

    ``standard_error`` is the Monte-Carlo error of the paper's own number, where its number of trials tells it.
    """

    low: float
    high: float
    text: str
    standard_error: float = 0.0


def printed(text: str, *, tolerance: float = 0.0, standard_error: float = 0.0) -> Expected:
    """Return what a printed number stands for: itself, plus or minus half its last digit and ``tolerance``.

    ``text`` is the number as the paper prints it; what follows the number (a unit, a percent sign) is for show.
    """
    number = Decimal(text.split()[0].rstrip("%"))
    last_digit = 10.0 ** int(number.as_tuple().exponent)
    slack = 0.5 * last_digit * (1.0 + 1e-9) + tolerance
    return Expected(low=float(number) - slack, high=float(number) + slack, text=text, standard_error=standard_error)


def about(value: float, relative: float, text: str) -> Expected:
    """Return a range of ``relative`` times the value about it: for words such as "equivalent to"."""
    return Expected(low=value - relative * abs(value), high=value + relative * abs(value), text=text)


def at_least(low: float, text: str = "") -> Expected:
    """Return everything from ``low`` up."""
    return Expected(low=low, high=math.inf, text=text or f">= {low:g}")


def at_most(high: float, text: str = "") -> Expected:
    """Return everything up to ``high``."""
    return Expected(low=-math.inf, high=high, text=text or f"<= {high:g}")


def between(low: float, high: float, text: str = "") -> Expected:
    """Return everything from ``low`` to ``high``."""
    return Expected(low=low, high=high, text=text or f"{low:g} to {high:g}")


def verdict(value: float, standard_error: float, expected: Expected | None) -> Verdict:
    """Return whether ``value`` lies in the expected range, or so near that Monte-Carlo error may explain it.

    Both standard errors count, three of their root sum of squares are allowed. A value that is missing, or whose error
    is unknown, reproduces nothing.
    """
    if expected is None:
        return Verdict.NO_NUMBERS
    slack = _SIGMAS * math.hypot(standard_error, expected.standard_error)
    inside = expected.low - slack <= value <= expected.high + slack
    return Verdict.REPRODUCED if inside else Verdict.NOT_REPRODUCED
