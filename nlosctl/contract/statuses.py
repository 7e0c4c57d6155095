"""The statuses of an estimate. Does not import NumPy."""

from __future__ import annotations

from enum import IntEnum

__all__ = ["Status"]


class Status(IntEnum):
    """The outcome of a snapshot's estimate; ``meaning`` describes it in one line.

    ``word`` is the name in lower case, as in the ``status`` column. A row has a position if and only
    if ``has_position``, and a covariance if and only if ``has_covariance``.
    """

    word: str
    meaning: str
    has_position: bool
    has_covariance: bool

    OK = 0, "a fix"
    AMBIGUOUS = 1, "another optimum is nearly as likely; x, y and covariance are of the best"
    INFEASIBLE = 2, "outside the region that the scene allows; the free estimate is kept"
    BOUNDARY = 3, "constrained estimate on the edge of the allowed region; no covariance"
    TOO_FEW = 4, "fewer measurements than the method needs; no answer"
    DEGENERATE = 5, "lines nearly parallel, or the fix coincides with a sensor it uses; no answer"
    BEHIND = 6, "the lines meet behind a sensor that is used; no answer"
    NOT_CONVERGED = 7, "the iteration did not settle; no answer"
    NO_CANDIDATE = 8, "no candidate position within the search region; no answer"
    NO_TARGET = 9, "the measurements contain no target; no answer"

    def __new__(cls, number: int, meaning: str = "") -> Status:
        """Return the member with a number."""
        member = int.__new__(cls, number)
        member._value_ = number
        member.meaning = meaning
        member.has_position, member.has_covariance = number <= 3, number <= 2
        return member

    def __init__(self, number: int, meaning: str = "") -> None:
        self.word = self.name.lower()
