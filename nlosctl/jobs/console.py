"""The output of a job while it runs, and its report as text."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Protocol

__all__ = ["Console", "Silent", "json_text"]

Progress = Callable[[int, int | None], None]
"""Receives the number of rows done and the total, None if unknown."""


class Console(Protocol):
    """Shows the progress of a job; a ``quiet`` one no summary."""

    quiet: bool

    def progress(self, title: str) -> AbstractContextManager[Progress]:
        """Return a context manager that shows progress under ``title`` until it ends."""
        ...

    def detail(self, text: str) -> None:
        """Show a line about the next step of the job."""

    def worded(self, text: str) -> str:
        """Return a message with its settings named as in the user interface."""
        ...


class Silent:
    """A console without output."""

    quiet = True

    def progress(self, title: str) -> AbstractContextManager[Progress]:
        """Return a function without output."""
        return nullcontext(lambda done, total: None)

    def detail(self, text: str) -> None:
        """Do nothing."""

    def worded(self, text: str) -> str:
        """Return the text unchanged."""
        return text


def json_text(value: object) -> str:
    """Return a value as JSON text; a number that is not finite becomes null."""
    return json.dumps(_finite(value), indent=2, allow_nan=False, default=str) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
