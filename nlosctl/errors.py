"""The exceptions that nlosctl raises on purpose, with the exit codes of the command line, and text of messages.

A message names a setting in backquotes: ```overwrite```, which the command line prints as ``--overwrite``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches
from itertools import islice

__all__ = [
    "DataError",
    "GatheredError",
    "MethodError",
    "MissingExtraError",
    "NlosctlError",
    "UsageError",
    "did_you_mean",
    "hide_secrets",
    "in_one_line",
    "printable",
]

_LONGEST_LINE = 1000
_LONGEST_WORD = 100
_MOST_WORDS = 10_000


_HIDDEN = "***"
_SECRET_KEYS = re.compile(
    r"sig|secret|token|passw|pwd|key|credential|auth|cookie|session|jwt|\bsas\b|\bcode\b", re.IGNORECASE
)
_SECRET_VALUE = re.compile(r"(?=[^&]*[0-9])(?=[^&]*[A-Za-z])[\w+/=%~-]{32,}")
_OPEN_KEYS = ("endpoint_override", "region", "scheme", "allow_bucket_creation", "allow_bucket_deletion")
_QUERY_ITEM = re.compile(r"(?<=[?&])([\w.~%$\[\]-]+)=((?:[^&\s'\"<>#|]*[^&\s'\"<>#|:;,.)\]])?)")
_USER = re.compile(
    r"(?<![\w+.-])(?!abfss?:|wasbs?:|hdfs:|viewfs:|sftp:|ssh:|ftp:|smb:)([A-Za-z][\w+.-]*://)[^/\s'\"?#@]+@"
)


def hide_secrets(text: str) -> str:
    """Return text in which user names and secret-looking values of queries in URLs are replaced by ``***``.

    A value is secret if its key names a signature, token, key or the like, or if it is long and random. Names of inputs
    are recorded in results and messages, where a secret would be found.
    """
    if "://" in text:
        text = _USER.sub(rf"\1{_HIDDEN}@", text)
    return _QUERY_ITEM.sub(_shown_item, text) if "=" in text else text


def _shown_item(item: re.Match[str]) -> str:
    key, value = item[1], item[2]
    is_secret = value and key not in _OPEN_KEYS and (_SECRET_KEYS.search(key) or _SECRET_VALUE.fullmatch(value))
    return f"{key}={_HIDDEN if is_secret else value}"


class NlosctlError(Exception):
    """Base class; the text is the one line (or the few lines) that a user reads, without secrets of URLs."""

    exit_code = 1

    def __init__(self, text: object = "") -> None:
        super().__init__(hide_secrets(str(text)))


class DataError(NlosctlError):
    """A fault of the data: a bad file, a bad row, an output that cannot be written."""

    exit_code = 1


class GatheredError(DataError):
    """Several faults of the data, one per line of the text."""


class UsageError(NlosctlError):
    """A usage error: invalid options of the command line or arguments of a function."""

    exit_code = 2


class MethodError(NlosctlError):
    """A method that broke its contract or could not be loaded; the text names the method and its distribution."""

    exit_code = 1


class MissingExtraError(NlosctlError):
    """A library of an optional extra that is not installed; the text contains the command that installs it."""

    exit_code = 1

    def __init__(self, job: str, library: str, extra: str) -> None:
        super().__init__(
            f"{job} needs {library}, which is not installed; install it with: pip install 'nlosctl[{extra}]'"
        )


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return `` (did you mean 'x'?)`` for the closest of ``known``, or an empty string if none is close."""
    candidates = [name for name in islice(known, _MOST_WORDS) if len(name) <= _LONGEST_WORD]
    near = get_close_matches(word, candidates, n=1, cutoff=0.6) if len(word) <= _LONGEST_WORD else []
    return f" (did you mean {near[0]!r}?)" if near else ""


def printable(text: str) -> str:
    """Return text in one printable line: control characters escaped, a long middle cut.

    Messages and tables contain text of input files; an escape sequence in it must not reach the terminal.
    """
    return _shortened(text) if text.isprintable() else _escaped(text)


def in_one_line(error: BaseException) -> str:
    """Return the type and the text of any exception in one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _escaped(line: str) -> str:
    shown = (character if character.isprintable() else repr(character)[1:-1] for character in line)
    return _shortened("".join(shown))


def _shortened(line: str) -> str:
    half = _LONGEST_LINE // 2
    return line if len(line) <= _LONGEST_LINE else f"{line[:half]} ... {line[-half:]}"
