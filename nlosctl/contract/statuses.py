"""The status words of an estimate. Imports no numpy."""

from __future__ import annotations

from enum import IntEnum

__all__ = ["Status"]


class Status(IntEnum):
    """How a snapshot's estimate ended; the table holds the name in lower case (``status.word``)."""

    OK = 0
    AMBIGUOUS = 1
    INFEASIBLE = 2
    BOUNDARY = 3
    TOO_FEW = 4
    DEGENERATE = 5
    BEHIND = 6
    NOT_CONVERGED = 7
    NO_CANDIDATE = 8
    NO_TARGET = 9

    @property
    def word(self) -> str:
        """The word in the ``status`` column."""
        return self.name.lower()

    @property
    def has_position(self) -> bool:
        """Whether a row of this status has x and y."""
        return self <= Status.BOUNDARY

    @property
    def has_covariance(self) -> bool:
        """Whether a row of this status has a covariance."""
        return self <= Status.INFEASIBLE

    @property
    def meaning(self) -> str:
        """One line that says what the word means."""
        return _MEANINGS[self]


_MEANINGS = {
    Status.OK: "a fix",
    Status.AMBIGUOUS: "another optimum is nearly as likely; x, y and covariance are of the best",
    Status.INFEASIBLE: "outside what the scene allows; the free estimate is kept",
    Status.BOUNDARY: "constrained estimate on the edge of what is allowed; no covariance",
    Status.TOO_FEW: "fewer measurements than the method needs; no answer",
    Status.DEGENERATE: "lines nearly parallel, or the fix lies on a sensor it uses; no answer",
    Status.BEHIND: "the lines meet behind a sensor that is used; no answer",
    Status.NOT_CONVERGED: "the iteration did not settle; no answer",
    Status.NO_CANDIDATE: "no candidate position within the search field; no answer",
    Status.NO_TARGET: "nothing in the measurements looks like a target; no answer",
}
