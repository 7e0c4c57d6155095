"""Every exception that nlosctl raises on purpose. Each knows the exit code of the command line."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ["DataError", "MethodError", "MissingExtraError", "NlosctlError", "UsageError", "did_you_mean"]


class NlosctlError(Exception):
    """Base of all; its text is the one line (or few lines) that a user reads."""

    exit_code = 1


class DataError(NlosctlError):
    """The data are at fault: a bad file, a bad row, an output that can't be written."""

    exit_code = 1


class UsageError(NlosctlError):
    """The words of the command line (or the arguments of a function) are at fault."""

    exit_code = 2


class MethodError(NlosctlError):
    """A method broke its contract or could not be loaded; the text names the method and its distribution."""

    exit_code = 1


class MissingExtraError(NlosctlError):
    """A job needs a library of an optional extra that is not installed; the text has the line that installs it."""

    exit_code = 1

    def __init__(self, job: str, library: str, extra: str) -> None:
        super().__init__(
            f"{job} needs {library}, which is not installed; install it with: pip install 'nlosctl[{extra}]'"
        )


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return `` (did you mean 'x'?)`` for the nearest of ``known``, or an empty string where none is near."""
    near = get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f" (did you mean {near[0]!r}?)" if near else ""
