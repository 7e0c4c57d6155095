"""What a job shows while it runs, and its report as text."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Protocol

__all__ = ["Console", "Silent", "json_text"]

Progress = Callable[[int, int | None], None]
"""Takes the rows done and the total, None if it is not known."""


class Console(Protocol):
    """Shows what a job does while it runs."""

    def progress(self, title: str) -> AbstractContextManager[Progress]:
        """Return a context manager that shows progress under ``title`` until it ends."""
        ...

    def detail(self, text: str) -> None:
        """Show a line about what the job is about to do."""

    def worded(self, text: str) -> str:
        """Return a message with the settings that it names as the user knows them."""
        ...


class Silent:
    """A console that shows nothing."""

    def progress(self, title: str) -> AbstractContextManager[Progress]:
        """Return a function that shows nothing."""
        return nullcontext(lambda done, total: None)

    def detail(self, text: str) -> None:
        """Show nothing."""

    def worded(self, text: str) -> str:
        """Return the text as it is."""
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
