"""Rows that are at fault: gathered, told in few lines, or set aside."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from nlosctl.arrays import BoolArray
from nlosctl.errors import GatheredError, printable

__all__ = ["SHOWN_PROBLEMS", "BadRow", "BadRowSink", "Describe", "Fault", "Problem", "ProblemLog"]

SHOWN_PROBLEMS = 20


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One fault of one row. ``row`` counts data rows from 1; ``line`` is the line of a text file, if it is one.

    A line of another program's file is no row yet: ``row`` is None.
    """

    file: str
    row: int | None
    line: int | None
    column: str | None
    fault: str

    def __str__(self) -> str:
        """Return the one line that a user reads."""
        if self.row is None:
            place = f", line {self.line}" if self.line is not None else ""
            field = f", field {self.column!r}" if self.column is not None else ""
            return f"{self.file}{place}{field}: {self.fault}"
        line = f" (line {self.line})" if self.line is not None and self.line != self.row else ""
        column = f", column {self.column!r}" if self.column is not None else ""
        return f"{self.file}, row {self.row}{line}{column}: {self.fault}"


@dataclass(frozen=True, kw_only=True)
class BadRow:
    """A row set aside: its first problem, and what the file held: by column as text, or the raw line."""

    problem: Problem
    values: dict[str, str | None]
    raw_line: str | None = None


BadRowSink = Callable[[Sequence[BadRow]], None]

"""Where bad rows go when they don't stop the run."""


class ProblemLog:
    """Counts the bad rows and keeps the first few; with a sink they are handed on, and the run continues."""

    def __init__(self, sink: BadRowSink | None = None) -> None:
        self.total = 0
        self.first: list[Problem] = []
        self._sink = sink

    @property
    def stops_the_run(self) -> bool:
        """Whether a bad row means that no result may come out."""
        return self._sink is None

    def add(self, rows: Sequence[BadRow], total: int | None = None) -> None:
        """Take bad rows; where ``total`` is larger than what is handed in, the others are counted only."""
        self.total += len(rows) if total is None else total
        self.first.extend(row.problem for row in rows[: SHOWN_PROBLEMS - len(self.first)])
        if self._sink is not None and rows:
            self._sink(rows)

    def wanted(self) -> int | None:
        """Return how many more bad rows are worth describing (None: all, for the sink)."""
        return None if self._sink is not None else SHOWN_PROBLEMS - len(self.first)

    def raise_if_stopping(self) -> None:
        """Raise GatheredError with the gathered problems, if there are any and they stop the run."""
        if self.total and self.stops_the_run:
            raise GatheredError(self.describe())

    def describe(self) -> str:
        """Return the problems, one per line, and the total where it is more than is shown."""
        lines = [printable(str(problem)) for problem in self.first]
        hint = "--bad-rows FILE sets bad rows aside and goes on"
        if len(lines) == self.total == 1:
            return f"{lines[0]} ({hint})"
        hidden = self.total - len(lines)
        more = f"... and {hidden} more; " if hidden else ""
        return "\n".join([*lines, f"{more}{self.total} bad rows in all; {hint}"])


Describe = Callable[[int], str]

"""Says what is wrong with a row."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Rows of a batch at fault in one column: ``mask`` (N,), and what to say of a row."""

    mask: BoolArray
    column: str
    describe: Describe
