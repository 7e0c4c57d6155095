"""The statuses of an estimate. Does not import NumPy."""

from __future__ import annotations

from enum import IntEnum

__all__ = ["Status"]


class Status(IntEnum):
    """The outcome of a snapshot's estimate; ``meaning`` describes it in one line.

    ``word`` is the name in lower case, as in the ``status`` column. A row has a position if and only
    if ``has_position``, and a covariance if and only if ``has_covariance``. It counts as an estimate if and only if
    ``is_fix``: a position that the measurements do not support is no fix.
    """

    word: str
    meaning: str
    has_position: bool
    has_covariance: bool
    is_fix: bool

    OK = 0, "a fix"
    AMBIGUOUS = 1, "another optimum is nearly as likely; x, y and covariance are of the best"
    INFEASIBLE = 2, "outside the region that the scene allows; the free estimate is kept"
    BOUNDARY = 3, "constrained estimate on the edge of the allowed region; no covariance"
    TOO_FEW = 4, "fewer measurements than the method needs; no answer"
    DEGENERATE = 5, "lines nearly parallel, or the fix coincides with a sensor it uses; no answer"
    BEHIND = 6, "the lines meet behind a sensor that is used, as with bearings of the opposite sense; no answer"
    NOT_CONVERGED = 7, "the iteration did not settle; no answer"
    NO_CANDIDATE = 8, "no candidate position within the search region; no answer"
    NO_TARGET = 9, "the measurements contain no target; no answer"
    NO_CONSENSUS = 10, "the measurements agree no better than outliers do; x, y are of the best mode, not a fix"
    OUTSIDE_FIELD = (
        11,
        "a point outside the search region is likelier than any inside; x, y are that point, not a fix",
    )
    NOT_PROVEN = 12, "the search stopped at its limit; the best set found is kept"
    STD_NOT_ESTIMABLE = 13, "a fix whose unknown standard deviation the rows can't determine; no covariance"

    def __new__(cls, number: int, meaning: str = "") -> Status:
        """Return the member with a number."""
        member = int.__new__(cls, number)
        member._value_ = number
        member.meaning = meaning
        member.has_position = number <= 3 or number >= 10
        member.has_covariance = number <= 2 or number == 12
        member.is_fix = number <= 3 or number >= 12
        return member

    def __init__(self, number: int, meaning: str = "") -> None:
        self.word = self.name.lower()
