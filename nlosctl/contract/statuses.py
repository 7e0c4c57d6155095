"""The status words of an estimate. Imports no numpy."""

from __future__ import annotations

from enum import IntEnum

__all__ = ["Status"]


class Status(IntEnum):
    """How the estimate of a snapshot ended; ``meaning`` is one line on it.

    ``word`` is the name in lower case, as in the ``status`` column. Rows have a position exactly where
    ``has_position``, and a covariance exactly where ``has_covariance``.
    """

    word: str
    meaning: str
    has_position: bool
    has_covariance: bool

    OK = 0, "a fix"
    AMBIGUOUS = 1, "another optimum is nearly as likely; x, y and covariance are of the best"
    INFEASIBLE = 2, "outside what the scene allows; the free estimate is kept"
    BOUNDARY = 3, "constrained estimate on the edge of what is allowed; no covariance"
    TOO_FEW = 4, "fewer measurements than the method needs; no answer"
    DEGENERATE = 5, "lines nearly parallel, or the fix lies on a sensor it uses; no answer"
    BEHIND = 6, "the lines meet behind a sensor that is used; no answer"
    NOT_CONVERGED = 7, "the iteration did not settle; no answer"
    NO_CANDIDATE = 8, "no candidate position within the search field; no answer"
    NO_TARGET = 9, "nothing in the measurements looks like a target; no answer"

    def __new__(cls, number: int, meaning: str = "") -> Status:
        """Return the member of a number."""
        member = int.__new__(cls, number)
        member._value_ = number
        member.meaning = meaning
        member.has_position, member.has_covariance = number <= 3, number <= 2
        return member

    def __init__(self, number: int, meaning: str = "") -> None:
        self.word = self.name.lower()
